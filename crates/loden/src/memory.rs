//! Amounts of memory, and large tables in huge pages.

use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::str::FromStr;

use memmap2::MmapMut;

use crate::{Error, Result};

/// An amount of memory, written as `512M`, `2G` or a number of bytes; K, M and G are powers of 1024.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory(pub u64);

impl FromStr for Memory {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let digits = text.trim_end_matches(['K', 'M', 'G', 'k', 'm', 'g']);
        let factor = match &text[digits.len()..] {
            "" => Some(1),
            "K" | "k" => Some(1 << 10),
            "M" | "m" => Some(1 << 20),
            "G" | "g" => Some(1 << 30),
            _ => None,
        };
        let bytes = factor.and_then(|factor: u64| digits.parse::<u64>().ok()?.checked_mul(factor));
        bytes.map(Self).ok_or_else(|| format!("found {text:?}, expected an amount of memory such as 512M"))
    }
}

impl fmt::Display for Memory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} MiB", self.0 as f64 / f64::from(1 << 20))
    }
}

/// The peak resident memory of this process since the last job that measures it began, in bytes; 0 if the system does not report it.
pub fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

/// Starts a new measurement of [`peak`]. On systems that do not allow it, the peak counts from the start of the
/// process.
pub(crate) fn reset_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// A fixed-size array of numbers, initially zero, in memory for which huge pages are requested: random lookups in a
/// table of many megabytes are otherwise limited by address translation.
#[derive(Debug)]
pub(crate) struct Pages<T> {
    map: MmapMut,
    kind: PhantomData<T>,
}

impl<T: bytemuck::Pod> Pages<T> {
    /// Allocates `len` zeros.
    ///
    /// # Errors
    /// [`Error::Io`] if there is not enough memory.
    pub fn zeros(len: usize) -> Result<Self> {
        let bytes = len.saturating_mul(size_of::<T>());
        // mapping zero bytes is an error on some systems
        let map = MmapMut::map_anon(bytes.max(1)).map_err(Error::io("memory for decoding"))?;
        #[cfg(target_os = "linux")]
        // a hint, which the system may ignore
        let _ = map.advise(memmap2::Advice::HugePage);
        Ok(Self { map, kind: PhantomData })
    }
}

impl<T: bytemuck::Pod> Deref for Pages<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        // pages are aligned for any number; the single byte of an empty table is cut off
        bytemuck::cast_slice(&self.map[..self.map.len() / size_of::<T>() * size_of::<T>()])
    }
}

impl<T: bytemuck::Pod> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        let len = self.map.len() / size_of::<T>() * size_of::<T>();
        bytemuck::cast_slice_mut(&mut self.map[..len])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_of_memory() {
        for (text, bytes) in [("512M", 512 << 20), ("2G", 2 << 30), ("64k", 65_536), ("1000", 1000)] {
            assert_eq!(text.parse(), Ok(Memory(bytes)));
        }
        for wrong in ["", "M", "1MB", "-1M", "1.5G", "99999999999G"] {
            assert!(wrong.parse::<Memory>().unwrap_err().contains("512M"), "{wrong}");
        }
        assert_eq!(Memory(3 << 19).to_string(), "1.5 MiB");
    }

    #[test]
    fn the_peak_covers_what_was_touched() {
        let block = std::hint::black_box(vec![1u8; 64 << 20]);
        if cfg!(target_os = "linux") {
            assert!(peak() > block.len() as u64);
        }
    }
}
