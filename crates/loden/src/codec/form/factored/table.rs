//! Factors in evaluation order, and the sum that evaluates them.

use half::f16;
use rayon::prelude::*;

use super::decode::{Coefficients, ViewFactors};
use crate::Result;
use crate::btf::{BtfMeta, SampleType};
use crate::material::angles::AngularStencil;
use crate::memory::Pages;

/// Coefficients (texel, view, component), or (texel, component) if views share them, padded with zeros to
/// [`Table::stride`] components, so that one evaluation reads contiguous memory of each texel.
#[derive(Debug)]
pub(super) enum Numbers {
    F32(Pages<f32>),
    F16(Pages<f16>),
    U8(Pages<u8>),
}

/// Mean and components of each (view, light), in as many cache lines as they need.
#[derive(Debug)]
pub(super) struct Table {
    lines: Pages<Line>,
    texels: usize,
    views: usize,
    lights: usize,
    lines_per_pair: usize,
    /// Rows of coefficients per texel, and the stride between those of successive views.
    rows: usize,
    row_step: usize,
}

/// Rows (the mean or a component) of three channels per cache line.
const ROWS: usize = 5;

/// Five rows of three channels, and a zero.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Line([f32; 16]);

// SAFETY: 16 numbers fill the 64 aligned bytes without padding, and any bits are valid numbers.
unsafe impl bytemuck::Zeroable for Line {}
// SAFETY: as above.
unsafe impl bytemuck::Pod for Line {}

/// Texels transposed together.
const BLOCK: usize = 64;

impl Numbers {
    pub(super) fn new(factors: &[ViewFactors], texels: usize, c: usize) -> Result<Self> {
        Ok(match factors.first().map(|f| f.coefficients) {
            Some(Coefficients::F16(_)) => Self::F16(transpose(factors, texels, c, |f| match f {
                Coefficients::F16(values) => values,
                _ => &[],
            })?),
            Some(Coefficients::U8(_)) => Self::U8(transpose(factors, texels, c, |f| match f {
                Coefficients::U8(values) => values,
                _ => &[],
            })?),
            _ => Self::F32(transpose(factors, texels, c, |f| match f {
                Coefficients::F32(values) => values,
                _ => &[],
            })?),
        })
    }
}

/// Transposes (view, texel, component) to (texel, view, padded component).
fn transpose<'a, T: bytemuck::Pod + Send + Sync>(
    factors: &[ViewFactors<'a>],
    texels: usize,
    c: usize,
    values: impl Fn(Coefficients<'a>) -> &'a [T],
) -> Result<Pages<T>> {
    let views: Vec<&[T]> = factors.iter().map(|f| values(f.coefficients)).collect();
    let stride = stride(c);
    let mut out = Pages::zeros(texels * views.len() * stride)?;
    out.par_chunks_mut(BLOCK * views.len() * stride).enumerate().for_each(|(block, out)| {
        for (v, view) in views.iter().enumerate() {
            let texels = view[block * BLOCK * c..].chunks_exact(c);
            for (out, texel) in out.chunks_exact_mut(views.len() * stride).zip(texels) {
                out[v * stride..][..c].copy_from_slice(texel);
            }
        }
    });
    Ok(out)
}

/// Cache lines of a mean and `c` components.
fn lines_per_pair(c: usize) -> usize {
    c / ROWS + 1
}

/// Components for which these lines have room, beside the mean.
fn stride(c: usize) -> usize {
    lines_per_pair(c) * ROWS - 1
}

/// Memory of the tables of `c` components, in bytes: [`Numbers`] and [`Table`].
pub(super) fn bytes(meta: &BtfMeta, c: usize, precision: SampleType, blocks: usize) -> u64 {
    let numbers = meta.texels() * blocks * stride(c);
    (numbers * precision.bytes() + meta.pairs() * lines_per_pair(c) * size_of::<Line>()) as u64
}

/// The mean (row 0) or component `row - 1` of a light, with the range of 8-bit coefficients applied.
fn row_of(view: &ViewFactors, light: usize, row: usize, c: usize) -> [f32; 3] {
    let component = |k: usize, channel: usize| view.basis[k * view.mean.len() + 3 * light + channel];
    let range = |k: usize| view.range.map_or([0.0, 1.0], |r| r[k]);
    std::array::from_fn(|channel| match row {
        0 => {
            let offsets: f32 = (0..c).map(|k| range(k)[0] * component(k, channel)).sum();
            view.mean[3 * light + channel] + offsets
        }
        _ => range(row - 1)[1] * component(row - 1, channel),
    })
}

/// A stored coefficient.
pub(super) trait Coefficient: Copy {
    /// The value in single precision.
    fn number(self) -> f32;

    /// Loads four coefficients.
    ///
    /// # Safety
    /// `from` must point to four readable numbers, and the processor must have AVX2 and F16C.
    #[cfg(target_arch = "x86_64")]
    unsafe fn four(from: *const Self) -> std::arch::x86_64::__m128;
}

impl Coefficient for f32 {
    fn number(self) -> f32 {
        self
    }

    #[cfg(target_arch = "x86_64")]
    #[inline]
    #[target_feature(enable = "avx2,f16c")]
    unsafe fn four(from: *const Self) -> std::arch::x86_64::__m128 {
        // SAFETY: guaranteed by the caller.
        unsafe { std::arch::x86_64::_mm_loadu_ps(from) }
    }
}

impl Coefficient for f16 {
    fn number(self) -> f32 {
        self.to_f32()
    }

    #[cfg(target_arch = "x86_64")]
    #[inline]
    #[target_feature(enable = "avx2,f16c")]
    unsafe fn four(from: *const Self) -> std::arch::x86_64::__m128 {
        use std::arch::x86_64::{_mm_cvtph_ps, _mm_loadl_epi64};
        // SAFETY: guaranteed by the caller.
        _mm_cvtph_ps(unsafe { _mm_loadl_epi64(from.cast()) })
    }
}

impl Coefficient for u8 {
    fn number(self) -> f32 {
        f32::from(self)
    }

    #[cfg(target_arch = "x86_64")]
    #[inline]
    #[target_feature(enable = "avx2,f16c")]
    unsafe fn four(from: *const Self) -> std::arch::x86_64::__m128 {
        use std::arch::x86_64::{_mm_cvtepi32_ps, _mm_cvtepu8_epi32, _mm_cvtsi32_si128};
        // SAFETY: guaranteed by the caller.
        let bytes = unsafe { from.cast::<i32>().read_unaligned() };
        _mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_cvtsi32_si128(bytes)))
    }
}

impl Table {
    pub(super) fn new(factors: &[ViewFactors], meta: &BtfMeta, c: usize, per_view: bool) -> Result<Self> {
        let (texels, views, lights) = (meta.texels(), meta.views.len(), meta.lights.len());
        let lines_per_pair = lines_per_pair(c);
        let lines = Pages::zeros(views * lights * lines_per_pair)?;
        let mut table = Self {
            lines,
            texels,
            views,
            lights,
            lines_per_pair,
            rows: if per_view { views } else { 1 },
            row_step: usize::from(per_view),
        };
        for (v, view) in factors.iter().enumerate() {
            for light in 0..lights {
                let place = table.place(v, light);
                for row in 0..=c {
                    let line = &mut table.lines[place + row / ROWS].0;
                    line[3 * (row % ROWS)..][..3].copy_from_slice(&row_of(view, light, row, c));
                }
            }
        }
        Ok(table)
    }

    /// Index of the first line of a pair.
    #[inline]
    pub(super) fn place(&self, view: usize, light: usize) -> usize {
        (view * self.lights + light) * self.lines_per_pair
    }

    /// Index of the first coefficient of a texel in a view.
    #[inline]
    pub(super) fn coefficients(&self, texel: usize, view: usize) -> usize {
        (texel * self.rows + view * self.row_step) * self.stride()
    }

    #[inline]
    fn stride(&self) -> usize {
        self.lines_per_pair * ROWS - 1
    }

    /// Sum over views, lights and texels of weights x (mean + components . coefficients), in the domain.
    #[inline]
    pub(super) fn sum<N: Coefficient, const T: usize>(
        &self,
        values: &[N],
        stencil: &AngularStencil,
        texels: [usize; T],
        weights: [f32; T],
    ) -> [f32; 3] {
        #[cfg(target_arch = "x86_64")]
        if has_avx2() {
            // SAFETY: the processor has AVX2 and F16C.
            return unsafe {
                match (self.lines_per_pair, stencil.view.count.max(stencil.light.count)) {
                    (1, 0..4) => self.sum_avx2::<N, T, 3, 1>(values, stencil, texels, weights),
                    (1, _) => self.sum_avx2::<N, T, 4, 1>(values, stencil, texels, weights),
                    (_, 0..4) => self.sum_avx2::<N, T, 3, 0>(values, stencil, texels, weights),
                    _ => self.sum_avx2::<N, T, 4, 0>(values, stencil, texels, weights),
                }
            };
        }
        self.sum_portable(values, stencil, texels, weights)
    }

    /// [`Table::sum`] for one texel per stencil.
    pub(super) fn sums<N: Coefficient>(
        &self,
        values: &[N],
        stencils: &[AngularStencil],
        texels: &[usize],
        out: &mut [[f32; 3]],
    ) {
        #[cfg(target_arch = "x86_64")]
        if has_avx2() {
            // SAFETY: the processor has what the kernels need.
            return unsafe {
                match crate::simd::has_avx512() {
                    true => self.sums_avx512(values, stencils, texels, out),
                    false => self.sums_avx2(values, stencils, texels, out),
                }
            };
        }
        for ((stencil, &texel), out) in stencils.iter().zip(texels).zip(out) {
            *out = self.sum_portable(values, stencil, [texel], [1.0]);
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,f16c")]
    fn sums_avx2<N: Coefficient>(
        &self,
        values: &[N],
        stencils: &[AngularStencil],
        texels: &[usize],
        out: &mut [[f32; 3]],
    ) {
        for ((stencil, &texel), out) in stencils.iter().zip(texels).zip(out) {
            *out = match (self.lines_per_pair, stencil.view.count.max(stencil.light.count)) {
                (1, 0..4) => self.sum_avx2::<N, 1, 3, 1>(values, stencil, [texel], [1.0]),
                (1, _) => self.sum_avx2::<N, 1, 4, 1>(values, stencil, [texel], [1.0]),
                _ => self.sum_avx2::<N, 1, 4, 0>(values, stencil, [texel], [1.0]),
            };
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx2,f16c")]
    fn sums_avx512<N: Coefficient>(
        &self,
        values: &[N],
        stencils: &[AngularStencil],
        texels: &[usize],
        out: &mut [[f32; 3]],
    ) {
        for ((stencil, &texel), out) in stencils.iter().zip(texels).zip(out) {
            *out = match (self.lines_per_pair, stencil.view.count.max(stencil.light.count)) {
                (1, 0..4) => self.sum_avx512::<N, 3>(values, stencil, texel),
                (1, _) => self.sum_avx512::<N, 4>(values, stencil, texel),
                _ => self.sum_avx2::<N, 1, 4, 0>(values, stencil, [texel], [1.0]),
            };
        }
    }

    fn sum_portable<N: Coefficient, const T: usize>(
        &self,
        values: &[N],
        stencil: &AngularStencil,
        texels: [usize; T],
        weights: [f32; T],
    ) -> [f32; 3] {
        let mut total = [0.0f32; 3];
        for (view, view_weight) in stencil.view.iter() {
            let rows: [&[N]; T] = texels.map(|texel| &values[self.coefficients(texel, view)..][..self.stride()]);
            for row in 0..=self.stride() {
                let blend = |k: usize| (0..T).map(|t| weights[t] * rows[t][k].number()).sum::<f32>();
                let coefficient = view_weight * if row == 0 { 1.0 } else { blend(row - 1) };
                for (light, weight) in stencil.light.iter() {
                    let line = &self.lines[self.place(view, light) + row / ROWS].0;
                    for (total, value) in total.iter_mut().zip(&line[3 * (row % ROWS)..]) {
                        *total += coefficient * weight * value;
                    }
                }
            }
        }
        total
    }

    /// [`Table::sum_avx2`] of one texel where a pair has one line: a line is one register. The same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx2,f16c")]
    #[inline]
    fn sum_avx512<N: Coefficient, const P: usize>(
        &self,
        values: &[N],
        stencil: &AngularStencil,
        texel: usize,
    ) -> [f32; 3] {
        use std::arch::x86_64::*;
        let lanes = _mm512_setr_epi32(4, 4, 4, 0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 3);
        let (views, lights) = (stencil.view, stencil.light);
        const STRIDE: usize = ROWS - 1;
        assert!(self.lines_per_pair == 1 && self.lines.len() == self.views * self.lights);
        assert!(values.len() == self.texels * self.rows * STRIDE);
        let mut in_range = texel < self.texels;
        for i in 0..P {
            in_range &= (lights.index[i] as usize) < self.lights && (views.index[i] as usize) < self.views;
        }
        assert!(in_range, "the texel and the stencil belong to this table");
        let mut total = _mm512_setzero_ps();
        for i in 0..P {
            let (view, view_weight) = (views.index[i] as usize, views.weight[i]);
            // SAFETY: texel and view are in range; a row has STRIDE = 4 numbers.
            let numbers = unsafe { N::four(values.as_ptr().add((texel * self.rows + view * self.row_step) * STRIDE)) };
            let four = _mm_mul_ps(_mm_set1_ps(view_weight), numbers);
            let five = _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(four), _mm_set_ss(view_weight));
            let mut sum = _mm512_setzero_ps();
            for j in 0..P {
                // SAFETY: view and light are in range; a line has 16 numbers and is aligned to 64 bytes.
                let line = unsafe {
                    _mm512_load_ps(self.lines.as_ptr().add(view * self.lights + lights.index[j] as usize).cast())
                };
                sum = _mm512_add_ps(sum, _mm512_mul_ps(_mm512_set1_ps(lights.weight[j]), line));
            }
            let coefficients = _mm512_permutexvar_ps(lanes, _mm512_castps256_ps512(five));
            total = _mm512_add_ps(total, _mm512_mul_ps(coefficients, sum));
        }
        // add the five rows of three lanes
        let mut rows = Line([0.0; 16]);
        // SAFETY: a line has 16 numbers and is aligned to 64 bytes.
        unsafe { _mm512_store_ps(rows.0.as_mut_ptr(), total) };
        // SAFETY: four numbers from each of these lie in the line.
        let row = |k: usize| unsafe { _mm_loadu_ps(rows.0.as_ptr().add(3 * k)) };
        let sum = _mm_add_ps(_mm_add_ps(_mm_add_ps(row(0), row(1)), _mm_add_ps(row(2), row(3))), row(4));
        let mut rgb = [0.0f32; 4];
        // SAFETY: four numbers.
        unsafe { _mm_storeu_ps(rgb.as_mut_ptr(), sum) };
        [rgb[0], rgb[1], rgb[2]]
    }

    /// Uses the first P entries of the stencil's lists; unused entries have weight 0. LINES is the number of lines
    /// per pair, or 0 if it is known only at run time.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,f16c")]
    #[inline]
    #[expect(clippy::needless_range_loop, reason = "one index runs over several arrays")]
    fn sum_avx2<N: Coefficient, const T: usize, const P: usize, const LINES: usize>(
        &self,
        values: &[N],
        stencil: &AngularStencil,
        texels: [usize; T],
        weights: [f32; T],
    ) -> [f32; 3] {
        use std::arch::x86_64::*;
        // plain loops, because closures passed to the standard library would be neither compiled for AVX2 nor inlined
        // which of five coefficients a lane takes: in the first line lane 4 has the mean's, otherwise lanes 0..4 go
        // in order
        let first = [_mm256_setr_epi32(4, 4, 4, 0, 0, 0, 1, 1), _mm256_setr_epi32(1, 2, 2, 2, 3, 3, 3, 3)];
        let later = [_mm256_setr_epi32(0, 0, 0, 1, 1, 1, 2, 2), _mm256_setr_epi32(2, 3, 3, 3, 4, 4, 4, 4)];
        let (views, lights) = (stencil.view, stencil.light);
        let lines = if LINES == 0 { self.lines_per_pair } else { LINES };
        let (stride, pairs) = (lines * ROWS - 1, self.lights * lines);
        assert!(lines == self.lines_per_pair && self.lines.len() == self.views * pairs);
        assert!(values.len() == self.texels * self.rows * stride);
        let (mut in_range, mut light_lines) = (true, [0; P]);
        for i in 0..P {
            in_range &= (lights.index[i] as usize) < self.lights && (views.index[i] as usize) < self.views;
            light_lines[i] = lights.index[i] as usize * lines;
        }
        for texel in texels {
            in_range &= texel < self.texels;
        }
        assert!(in_range, "the texel and the stencil belong to this table");
        let mut total = [_mm256_setzero_ps(); 2];
        for i in 0..P {
            let (view, view_weight) = (views.index[i] as usize, views.weight[i]);
            for line in 0..lines {
                let begin = (line * ROWS).saturating_sub(1);
                let mut four = _mm_setzero_ps();
                let mut fifth = if line == 0 { view_weight } else { 0.0 };
                for t in 0..T {
                    let scale = view_weight * weights[t];
                    // SAFETY: texel and view are in range; a row has 5 x lines - 1 numbers, so the four from `begin`
                    // lie in this line, and a fifth in every line but the first.
                    let numbers = unsafe {
                        let row = texels[t] * self.rows + view * self.row_step;
                        let row = values.as_ptr().add(row * stride + begin);
                        if line > 0 {
                            fifth += scale * (*row.add(4)).number();
                        }
                        N::four(row)
                    };
                    four = _mm_add_ps(four, _mm_mul_ps(_mm_set1_ps(scale), numbers));
                }
                let five = _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(four), _mm_set1_ps(fifth));
                let (mut low, mut high) = (_mm256_setzero_ps(), _mm256_setzero_ps());
                for j in 0..P {
                    // SAFETY: view and light are in range; a line has 16 numbers and is aligned to 64 bytes.
                    let halves = unsafe {
                        let row = self.lines.as_ptr().add(view * pairs + light_lines[j] + line).cast::<f32>();
                        (_mm256_load_ps(row), _mm256_load_ps(row.add(8)))
                    };
                    let weight = _mm256_set1_ps(lights.weight[j]);
                    low = _mm256_add_ps(low, _mm256_mul_ps(weight, halves.0));
                    high = _mm256_add_ps(high, _mm256_mul_ps(weight, halves.1));
                }
                let lanes = if line == 0 { &first } else { &later };
                total[0] = _mm256_add_ps(total[0], _mm256_mul_ps(_mm256_permutevar8x32_ps(five, lanes[0]), low));
                total[1] = _mm256_add_ps(total[1], _mm256_mul_ps(_mm256_permutevar8x32_ps(five, lanes[1]), high));
            }
        }
        // move the rows of three lanes each to the first three lanes and add them
        let [low, high] = total;
        let move_to_front = |from: __m256, first: i32, second: i32, third: i32| {
            let lanes = _mm256_setr_epi32(first, second, third, 0, 0, 0, 0, 0);
            _mm256_castps256_ps128(_mm256_permutevar8x32_ps(from, lanes))
        };
        let across = _mm256_blend_ps::<1>(low, high);
        let one = _mm_add_ps(_mm256_castps256_ps128(low), move_to_front(low, 3, 4, 5));
        let two = _mm_add_ps(move_to_front(across, 6, 7, 0), move_to_front(high, 1, 2, 3));
        let sum = _mm_add_ps(_mm_add_ps(one, two), move_to_front(high, 4, 5, 6));
        let mut rgb = [0.0f32; 4];
        // SAFETY: four numbers.
        unsafe { _mm_storeu_ps(rgb.as_mut_ptr(), sum) };
        [rgb[0], rgb[1], rgb[2]]
    }
}

/// Whether the AVX2 and half-precision kernels can run.
#[cfg(target_arch = "x86_64")]
#[inline]
fn has_avx2() -> bool {
    crate::simd::has_avx2() && is_x86_feature_detected!("f16c")
}
