//! Several values at a time, stored component by component.

use std::marker::PhantomData;

use bytemuck::Pod;

/// Number of values that are computed at a time.
pub(crate) const LANES: usize = 16;

/// A value of `N` 32-bit numbers for each of several lanes, stored as all first numbers, then all second ones, and so
/// on.
///
/// # Model
/// Compilers vectorise a loop over lanes that gets values, computes without branches and sets the results, so one
/// function on a single value serves all lanes.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(crate) struct Many<T, const N: usize> {
    rows: [[u32; LANES]; N],
    of: PhantomData<T>,
}

impl<T: Pod, const N: usize> Many<T, N> {
    /// All bits zero.
    pub(crate) const ZERO: Self = {
        assert!(size_of::<T>() == 4 * N && align_of::<T>() == 4);
        Self { rows: [[0; LANES]; N], of: PhantomData }
    };

    #[inline(always)]
    pub(crate) fn get(&self, lane: usize) -> T {
        let numbers: [u32; N] = std::array::from_fn(|row| self.rows[row][lane]);
        bytemuck::pod_read_unaligned(bytemuck::cast_slice(&numbers))
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, lane: usize, value: T) {
        let numbers: &[u32] = bytemuck::cast_slice(std::slice::from_ref(&value));
        self.rows.iter_mut().zip(numbers).for_each(|(row, number)| row[lane] = *number);
    }
}
