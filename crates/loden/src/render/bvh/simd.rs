//! Vectors of numbers for each instruction set.

use std::ops::{Add, Div, Mul, Sub};

use glam::Vec4;

/// A vector register. Comparisons give a bit per number. All types give the same bits.
pub(super) trait Vector: Copy {
    /// Count of numbers.
    const SIZE: usize;

    fn splat(x: f32) -> Self;
    /// Loads the first numbers of a slice that is long enough.
    fn load(from: &[f32]) -> Self;
    fn store(self, to: &mut [f32]);
    /// Overwrites the numbers selected by a mask.
    fn store_some(self, mask: u16, to: &mut [f32]);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn lt(self, other: Self) -> u16;
    fn le(self, other: Self) -> u16;
}

/// The vectors of an instruction set: for sixteen rays, and for eight boxes.
pub(super) trait Simd {
    type Rays: Numbers;
    type Boxes: Numbers;
}

/// For processors without AVX2.
pub(super) struct Portable;

impl Simd for Portable {
    type Rays = Lanes<Vec4, 4>;
    type Boxes = Lanes<Vec4, 2>;
}

/// Several vectors used as one.
#[derive(Clone, Copy)]
pub(super) struct Lanes<V, const N: usize>([V; N]);

/// Operations composed of those of any vector.
pub(super) trait Numbers:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    fn splat(x: f32) -> Self;
    fn load(from: &[f32]) -> Self;
    fn store(self, to: &mut [f32]);
    fn store_some(self, mask: u16, to: &mut [f32]);
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn lt(self, other: Self) -> u16;
    fn le(self, other: Self) -> u16;
}

impl<V: Vector, const N: usize> Lanes<V, N> {
    #[inline(always)]
    fn both(self, other: Self, f: impl Fn(V, V) -> V) -> Self {
        let mut all = self.0;
        for (one, other) in all.iter_mut().zip(other.0) {
            *one = f(*one, other);
        }
        Self(all)
    }

    #[inline(always)]
    fn bits(self, other: Self, f: impl Fn(V, V) -> u16) -> u16 {
        let mut mask = 0;
        for k in 0..N {
            mask |= f(self.0[k], other.0[k]) << (k * V::SIZE);
        }
        mask
    }
}

impl<V: Vector, const N: usize> Numbers for Lanes<V, N> {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([V::splat(x); N])
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let mut all = [V::splat(0.0); N];
        for (one, from) in all.iter_mut().zip(from.chunks_exact(V::SIZE)) {
            *one = V::load(from);
        }
        Self(all)
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        self.0.iter().zip(to.chunks_exact_mut(V::SIZE)).for_each(|(one, to)| one.store(to));
    }

    #[inline(always)]
    fn store_some(self, mask: u16, to: &mut [f32]) {
        for (k, to) in to.chunks_exact_mut(V::SIZE).enumerate().take(N) {
            self.0[k].store_some(mask >> (k * V::SIZE), to);
        }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.both(other, V::min)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.both(other, V::max)
    }

    #[inline(always)]
    fn lt(self, other: Self) -> u16 {
        self.bits(other, V::lt)
    }

    #[inline(always)]
    fn le(self, other: Self) -> u16 {
        self.bits(other, V::le)
    }
}

macro_rules! operators {
    ($($name:ident $method:ident),*) => {
        $(impl<V: Vector, const N: usize> $name for Lanes<V, N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.both(other, V::$method)
            }
        })*
    };
}

operators!(Add add, Sub sub, Mul mul, Div div);

impl Vector for Vec4 {
    const SIZE: usize = 4;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self::splat(x)
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Self::from_slice(from)
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        self.write_to_slice(to);
    }

    #[inline(always)]
    fn store_some(self, mask: u16, to: &mut [f32]) {
        for (k, to) in to.iter_mut().enumerate().filter(|(k, _)| mask >> k & 1 != 0) {
            *to = self[k];
        }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self + other
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self - other
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self * other
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self / other
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.min(other)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.max(other)
    }

    #[inline(always)]
    fn lt(self, other: Self) -> u16 {
        self.cmplt(other).bitmask() as u16
    }

    #[inline(always)]
    fn le(self, other: Self) -> u16 {
        self.cmple(other).bitmask() as u16
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    #![expect(clippy::undocumented_unsafe_blocks, reason = "stated once, below")]
    // SAFETY of all blocks: functions that use these vectors require the instruction set. Callers and assertions
    // ensure that slices are at least as long as what is read or written.

    use std::arch::x86_64::*;

    use super::{Lanes, Simd, Vector};

    /// For processors with AVX2.
    pub(in super::super) struct Avx2;

    impl Simd for Avx2 {
        type Rays = Lanes<__m256, 2>;
        type Boxes = Lanes<__m256, 1>;
    }

    /// For processors with AVX-512.
    pub(in super::super) struct Avx512;

    impl Simd for Avx512 {
        type Rays = Lanes<__m512, 1>;
        type Boxes = Lanes<__m256, 1>;
    }

    /// Defines a method that is a single instruction.
    macro_rules! instructions {
        ($($name:ident $instruction:ident),*) => {
            $(#[inline(always)]
            fn $name(self, other: Self) -> Self {
                unsafe { $instruction(self, other) }
            })*
        };
    }

    impl Vector for __m256 {
        const SIZE: usize = 8;

        #[inline(always)]
        fn splat(x: f32) -> Self {
            unsafe { _mm256_set1_ps(x) }
        }

        #[inline(always)]
        fn load(from: &[f32]) -> Self {
            assert!(from.len() >= Self::SIZE);
            unsafe { _mm256_loadu_ps(from.as_ptr()) }
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            assert!(to.len() >= Self::SIZE);
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self) }
        }

        #[inline(always)]
        fn store_some(self, mask: u16, to: &mut [f32]) {
            assert!(to.len() >= Self::SIZE);
            unsafe {
                let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let own = _mm256_and_si256(_mm256_set1_epi32(i32::from(mask)), bits);
                _mm256_maskstore_ps(to.as_mut_ptr(), _mm256_cmpeq_epi32(own, bits), self);
            }
        }

        instructions!(add _mm256_add_ps, sub _mm256_sub_ps, mul _mm256_mul_ps, div _mm256_div_ps, min _mm256_min_ps,
            max _mm256_max_ps);

        #[inline(always)]
        fn lt(self, other: Self) -> u16 {
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self, other)) as u16 }
        }

        #[inline(always)]
        fn le(self, other: Self) -> u16 {
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self, other)) as u16 }
        }
    }

    impl Vector for __m512 {
        const SIZE: usize = 16;

        #[inline(always)]
        fn splat(x: f32) -> Self {
            unsafe { _mm512_set1_ps(x) }
        }

        #[inline(always)]
        fn load(from: &[f32]) -> Self {
            assert!(from.len() >= Self::SIZE);
            unsafe { _mm512_loadu_ps(from.as_ptr()) }
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            assert!(to.len() >= Self::SIZE);
            unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self) }
        }

        #[inline(always)]
        fn store_some(self, mask: u16, to: &mut [f32]) {
            assert!(to.len() >= Self::SIZE);
            unsafe { _mm512_mask_storeu_ps(to.as_mut_ptr(), mask, self) }
        }

        instructions!(add _mm512_add_ps, sub _mm512_sub_ps, mul _mm512_mul_ps, div _mm512_div_ps, min _mm512_min_ps,
            max _mm512_max_ps);

        #[inline(always)]
        fn lt(self, other: Self) -> u16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self, other) }
        }

        #[inline(always)]
        fn le(self, other: Self) -> u16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self, other) }
        }
    }
}
