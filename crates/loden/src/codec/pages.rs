//! Large tables in large pages.

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

use memmap2::MmapMut;

use crate::{Error, Result};

/// A fixed number of numbers, zero at first, in memory for which the system is asked for large pages: lookups all over
/// a table of many megabytes otherwise wait for the translation of addresses.
#[derive(Debug)]
pub(crate) struct Pages<T> {
    map: MmapMut,
    kind: PhantomData<T>,
}

impl<T: bytemuck::Pod> Pages<T> {
    /// Room for `len` numbers.
    ///
    /// # Errors
    /// [`Error::Io`] if there is not enough memory.
    pub fn zeros(len: usize) -> Result<Self> {
        let bytes = len.saturating_mul(size_of::<T>());
        // an empty map is an error on some systems
        let map = MmapMut::map_anon(bytes.max(1)).map_err(Error::io("memory for decoding"))?;
        #[cfg(target_os = "linux")]
        // a wish that may be refused
        let _ = map.advise(memmap2::Advice::HugePage);
        Ok(Self { map, kind: PhantomData })
    }
}

impl<T: bytemuck::Pod> Deref for Pages<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        // pages are aligned to more than any number; the one byte of an empty table is cut off
        bytemuck::cast_slice(&self.map[..self.map.len() / size_of::<T>() * size_of::<T>()])
    }
}

impl<T: bytemuck::Pod> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        let len = self.map.len() / size_of::<T>() * size_of::<T>();
        bytemuck::cast_slice_mut(&mut self.map[..len])
    }
}
