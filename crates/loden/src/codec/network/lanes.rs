//! Vectors of numbers for the kernels of networks, in the widest instruction set of the processor.
//!
//! # Model
//! Sixteen samples lie side by side, so that one vector instruction advances several of them. A product and a sum are
//! rounded once ([`Lanes::fused`]), which every processor with AVX2 has an instruction for. Numbers of different
//! samples are added by halves ([`sum`]). So all widths give the same bits.

/// Number of samples side by side.
pub const LANES: usize = 16;

/// A vector of numbers, as wide as a register; its width divides [`LANES`].
pub trait Lanes: Copy {
    /// Numbers in the vector.
    const WIDTH: usize;

    /// The same number everywhere.
    fn splat(value: f32) -> Self;

    /// Reads [`Self::WIDTH`] numbers.
    fn load(from: &[f32]) -> Self;

    /// Writes [`Self::WIDTH`] numbers.
    fn store(self, to: &mut [f32]);

    /// `self` times `factor` plus `sum`.
    fn fused(self, factor: Self, sum: Self) -> Self;

    /// The larger numbers of both.
    fn max(self, other: Self) -> Self;

    /// `self` where `control` is positive, else zero.
    fn where_positive(self, control: Self) -> Self;
}

/// Work that is compiled for every width.
pub trait Kernel {
    /// Its result.
    type Output;

    /// Does the work. It and all that it calls must be inlined, which closures of library functions may not be.
    fn run<V: Lanes>(self) -> Self::Output;
}

/// Four numbers in portable code. A product and a sum are rounded once, as by the other widths, if `FUSED`; without an
/// instruction for that, rounding twice is much faster.
#[derive(Clone, Copy)]
struct Portable<const FUSED: bool>([f32; 4]);

impl<const FUSED: bool> Lanes for Portable<FUSED> {
    const WIDTH: usize = 4;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; 4])
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Self([from[0], from[1], from[2], from[3]])
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..4].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn fused(self, factor: Self, sum: Self) -> Self {
        let lane = |k: usize| match FUSED {
            true => self.0[k].mul_add(factor.0[k], sum.0[k]),
            false => self.0[k] * factor.0[k] + sum.0[k],
        };
        Self([lane(0), lane(1), lane(2), lane(3)])
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| if self.0[k] > other.0[k] { self.0[k] } else { other.0[k] }))
    }

    #[inline(always)]
    fn where_positive(self, control: Self) -> Self {
        Self(std::array::from_fn(|k| if control.0[k] > 0.0 { self.0[k] } else { 0.0 }))
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::Lanes;

    impl Lanes for __m256 {
        const WIDTH: usize = 8;

        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: only [`super::compute`] chooses this type, where the processor has AVX2 and FMA.
            unsafe { _mm256_set1_ps(value) }
        }

        #[inline(always)]
        fn load(from: &[f32]) -> Self {
            // SAFETY: as above; the slice is long enough.
            unsafe { _mm256_loadu_ps(from[..8].as_ptr()) }
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            // SAFETY: as above; the slice is long enough.
            unsafe { _mm256_storeu_ps(to[..8].as_mut_ptr(), self) }
        }

        #[inline(always)]
        fn fused(self, factor: Self, sum: Self) -> Self {
            // SAFETY: as above.
            unsafe { _mm256_fmadd_ps(self, factor, sum) }
        }

        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: as above.
            unsafe { _mm256_max_ps(self, other) }
        }

        #[inline(always)]
        fn where_positive(self, control: Self) -> Self {
            // SAFETY: as above.
            unsafe { _mm256_and_ps(self, _mm256_cmp_ps::<_CMP_GT_OQ>(control, _mm256_setzero_ps())) }
        }
    }

    impl Lanes for __m512 {
        const WIDTH: usize = 16;

        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: only [`super::compute`] chooses this type, where the processor has AVX-512.
            unsafe { _mm512_set1_ps(value) }
        }

        #[inline(always)]
        fn load(from: &[f32]) -> Self {
            // SAFETY: as above; the slice is long enough.
            unsafe { _mm512_loadu_ps(from[..16].as_ptr()) }
        }

        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            // SAFETY: as above; the slice is long enough.
            unsafe { _mm512_storeu_ps(to[..16].as_mut_ptr(), self) }
        }

        #[inline(always)]
        fn fused(self, factor: Self, sum: Self) -> Self {
            // SAFETY: as above.
            unsafe { _mm512_fmadd_ps(self, factor, sum) }
        }

        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: as above.
            unsafe { _mm512_max_ps(self, other) }
        }

        #[inline(always)]
        fn where_positive(self, control: Self) -> Self {
            // SAFETY: as above.
            unsafe { _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(control, _mm512_setzero_ps()), self) }
        }
    }
}

/// Runs a kernel in the widest instruction set. All processors give the same bits if `same_bits`, at a high price on those
/// without an instruction for a product and a sum; otherwise results differ there by rounding.
pub fn compute<K: Kernel>(kernel: K, same_bits: bool) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{__m256, __m512};
        #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
        fn avx512<K: Kernel>(kernel: K) -> K::Output {
            kernel.run::<__m512>()
        }
        #[target_feature(enable = "avx2,fma")]
        fn avx2<K: Kernel>(kernel: K) -> K::Output {
            kernel.run::<__m256>()
        }
        let fma = is_x86_feature_detected!("fma");
        if fma && crate::simd::has_avx512() {
            // SAFETY: the processor has these instructions.
            return unsafe { avx512(kernel) };
        }
        if fma && crate::simd::has_avx2() {
            // SAFETY: the processor has these instructions.
            return unsafe { avx2(kernel) };
        }
    }
    match same_bits {
        true => kernel.run::<Portable<true>>(),
        false => kernel.run::<Portable<false>>(),
    }
}

/// The sum over all lanes, by halves.
#[inline(always)]
pub fn sum(lanes: &[f32; LANES]) -> f32 {
    let (low, high) = lanes.split_at(LANES / 2);
    let (mut eight, mut four) = ([0.0; LANES / 2], [0.0; LANES / 4]);
    for ((sum, a), b) in eight.iter_mut().zip(low).zip(high) {
        *sum = a + b;
    }
    let (low, high) = eight.split_at(LANES / 4);
    for ((sum, a), b) in four.iter_mut().zip(low).zip(high) {
        *sum = a + b;
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

/// A matrix (row, column) packed for products: groups of `ROWS` rows, column by column.
#[derive(Debug, Clone)]
pub struct Packed {
    rows: usize,
    columns: usize,
    numbers: Vec<f32>,
}

/// What is done to a row of a product.
#[derive(Clone, Copy)]
pub enum Finish<'a> {
    /// Nothing.
    Plain,
    /// Negative numbers become zero.
    Rectify,
    /// It becomes zero where this one, of the same shape, is not positive.
    Where(&'a [f32]),
}

/// Rows that are computed together.
fn together(rows: usize) -> usize {
    match rows {
        rows if rows % 8 == 0 => 8,
        rows if rows % 4 == 0 => 4,
        rows if rows % 3 == 0 => 3,
        _ => 1,
    }
}

impl Packed {
    /// Room for a matrix.
    pub fn new(rows: usize, columns: usize) -> Self {
        Self { rows, columns, numbers: vec![0.0; rows * columns] }
    }

    /// Packs the matrix whose number in a row and column is `at`.
    pub fn set(&mut self, at: impl Fn(usize, usize) -> f32) {
        let group = together(self.rows);
        for (k, number) in self.numbers.iter_mut().enumerate() {
            let (first, rest) = (k / (group * self.columns) * group, k % (group * self.columns));
            *number = at(first + rest % group, rest / group);
        }
    }

    /// The product with `input` (column, lane), plus `start` (row), into `output` (row, lane). Rows of inputs and outputs
    /// are `stride` numbers apart.
    #[inline(always)]
    pub fn times<V: Lanes>(&self, start: &[f32], input: &[f32], output: &mut [f32], stride: usize, finish: Finish) {
        match together(self.rows) {
            8 => self.times_rows::<V, 8>(start, input, output, stride, finish),
            4 => self.times_rows::<V, 4>(start, input, output, stride, finish),
            3 => self.times_rows::<V, 3>(start, input, output, stride, finish),
            _ => self.times_rows::<V, 1>(start, input, output, stride, finish),
        }
    }

    #[inline(always)]
    fn times_rows<V: Lanes, const ROWS: usize>(
        &self,
        start: &[f32],
        input: &[f32],
        output: &mut [f32],
        stride: usize,
        finish: Finish,
    ) {
        for (group, numbers) in self.numbers.chunks_exact(ROWS * self.columns).enumerate() {
            let first = group * ROWS;
            for lane in (0..LANES).step_by(V::WIDTH) {
                let mut sums = [V::splat(0.0); ROWS];
                if !start.is_empty() {
                    for (sum, start) in sums.iter_mut().zip(&start[first..]) {
                        *sum = V::splat(*start);
                    }
                }
                for (column, numbers) in numbers.as_chunks::<ROWS>().0.iter().enumerate() {
                    let value = V::load(&input[column * stride + lane..]);
                    for (sum, number) in sums.iter_mut().zip(numbers) {
                        *sum = V::splat(*number).fused(value, *sum);
                    }
                }
                for (r, sum) in sums.into_iter().enumerate() {
                    let place = (first + r) * stride + lane;
                    let done = match finish {
                        Finish::Plain => sum,
                        Finish::Rectify => sum.max(V::splat(0.0)),
                        Finish::Where(control) => sum.where_positive(V::load(&control[place..])),
                    };
                    done.store(&mut output[place..]);
                }
            }
        }
    }
}

/// Two matrices (row, sample) with rows `stride` numbers apart and `samples` numbers in each, a multiple of [`LANES`].
#[derive(Clone, Copy)]
pub struct Samples<'a> {
    pub left: &'a [f32],
    pub right: &'a [f32],
    pub stride: usize,
    pub samples: usize,
}

impl Samples<'_> {
    /// Adds the sums over samples of products of rows of both to `sums`, (row of `left`, row of `right`), whose rows are
    /// `pitch` numbers apart.
    #[inline(always)]
    pub fn add_products<V: Lanes>(&self, [rows, columns]: [usize; 2], sums: &mut [f32], pitch: usize) {
        let (whole_rows, whole_columns) = (rows / 4 * 4, columns / 4 * 4);
        for row in (0..whole_rows).step_by(4) {
            for column in (0..whole_columns).step_by(4) {
                self.tile::<V, 4, 4>([row, column], sums, pitch);
            }
            for column in whole_columns..columns {
                self.tile::<V, 4, 1>([row, column], sums, pitch);
            }
        }
        for row in whole_rows..rows {
            for column in (0..whole_columns).step_by(4) {
                self.tile::<V, 1, 4>([row, column], sums, pitch);
            }
            for column in whole_columns..columns {
                self.tile::<V, 1, 1>([row, column], sums, pitch);
            }
        }
    }

    /// [`Self::add_products`] for a few rows of both.
    #[inline(always)]
    fn tile<V: Lanes, const ROWS: usize, const COLUMNS: usize>(
        &self,
        [row, column]: [usize; 2],
        sums: &mut [f32],
        pitch: usize,
    ) {
        let &Self { left, right, stride, samples } = self;
        let (mut lefts, mut rights) = ([&left[..0]; ROWS], [&right[..0]; COLUMNS]);
        for (r, row_of) in lefts.iter_mut().enumerate() {
            *row_of = &left[(row + r) * stride..][..samples];
        }
        for (c, row_of) in rights.iter_mut().enumerate() {
            *row_of = &right[(column + c) * stride..][..samples];
        }
        let mut lanes = [[[0.0f32; LANES]; COLUMNS]; ROWS];
        for lane in (0..LANES).step_by(V::WIDTH) {
            let mut totals = [[V::splat(0.0); COLUMNS]; ROWS];
            for place in (lane..samples).step_by(LANES) {
                let mut values = [V::splat(0.0); COLUMNS];
                for (value, right) in values.iter_mut().zip(&rights) {
                    *value = V::load(&right[place..]);
                }
                for (totals, left) in totals.iter_mut().zip(&lefts) {
                    let factor = V::load(&left[place..]);
                    for (total, value) in totals.iter_mut().zip(values) {
                        *total = factor.fused(value, *total);
                    }
                }
            }
            for (lanes, totals) in lanes.iter_mut().zip(totals) {
                for (lanes, total) in lanes.iter_mut().zip(totals) {
                    total.store(&mut lanes[lane..]);
                }
            }
        }
        for (r, lanes) in lanes.iter().enumerate() {
            for (c, lanes) in lanes.iter().enumerate() {
                sums[(row + r) * pitch + column + c] += sum(lanes);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;

    /// A product and the sums of products with its result.
    struct Both {
        rows: usize,
        columns: usize,
    }

    impl Kernel for Both {
        type Output = Vec<f32>;

        #[inline(always)]
        fn run<V: Lanes>(self) -> Vec<f32> {
            let Self { rows, columns } = self;
            let (stride, mut random) = (3 * LANES, Stream::new(7));
            let mut numbers = |count: usize| (0..count).map(|_| random.range(-1.0, 1.0)).collect::<Vec<f32>>();
            let (matrix, start, input) = (numbers(rows * columns), numbers(rows), numbers(columns * stride));
            let mut packed = Packed::new(rows, columns);
            packed.set(|row, column| matrix[row * columns + column]);
            let mut output = vec![0.0; rows * stride];
            for group in 0..2 {
                let first = group * LANES;
                packed.times::<V>(&start, &input[first..], &mut output[first..], stride, Finish::Rectify);
            }
            let mut sums = vec![0.0; rows * columns];
            let samples = Samples { left: &output, right: &input, stride, samples: 2 * LANES };
            samples.add_products::<V>([rows, columns], &mut sums, columns);
            // the same in double precision
            for row in 0..rows {
                for sample in 0..2 * LANES {
                    let product = |column: usize| {
                        f64::from(matrix[row * columns + column]) * f64::from(input[column * stride + sample])
                    };
                    let expected = (f64::from(start[row]) + (0..columns).map(product).sum::<f64>()).max(0.0);
                    assert!((f64::from(output[row * stride + sample]) - expected).abs() < 1e-5, "{row} {sample}");
                }
                for column in 0..columns {
                    let product = |sample: usize| {
                        f64::from(output[row * stride + sample]) * f64::from(input[column * stride + sample])
                    };
                    let expected: f64 = (0..2 * LANES).map(product).sum();
                    assert!((f64::from(sums[row * columns + column]) - expected).abs() < 1e-4, "{row} {column}");
                }
            }
            output.extend(sums);
            output
        }
    }

    #[test]
    fn products_are_right_and_have_the_same_bits_in_every_width() {
        for (rows, columns) in [(3, 5), (8, 4), (12, 7), (1, 1), (48, 33)] {
            let widest = compute(Both { rows, columns }, true);
            assert_eq!(widest, Both { rows, columns }.run::<Portable<true>>(), "{rows} x {columns}");
            let rounded_twice = Both { rows, columns }.run::<Portable<false>>();
            assert!(widest.iter().zip(&rounded_twice).all(|(a, b)| (a - b).abs() < 1e-4), "{rows} x {columns}");
        }
    }
}
