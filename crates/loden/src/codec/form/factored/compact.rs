//! Factors in 8 or 4 bits for many components: small enough to stay in memory, and evaluated without unpacking.

#[cfg(target_arch = "x86_64")]
mod x86;

use std::borrow::Cow;

use super::decode::{Coefficients, ViewFactors};
use crate::Result;
use crate::material::angles::AngularStencil;
use crate::memory::Pages;
use crate::simd::prefetch;

/// Components evaluated together; the last group is padded with zeros.
const LANES: usize = 16;

/// One group of components, or four single-precision numbers.
type Line = [u8; LANES];

/// Lines prefetched together.
const FETCHED: usize = 64 / LANES;

/// Bound on the sum of a texel's coefficients in [`Fixed`], so that products with components fit 32 bits.
const LARGEST: f32 = 60_000.0;

/// A mean and components times coefficients. The leading components have 8 bits per number, the others 4.
#[derive(Debug)]
pub struct Compact {
    /// Number of components, a multiple of [`LANES`].
    c: usize,
    /// Lines of 8-bit components; the number of remaining lines is even.
    fine: usize,
    /// (view, light): the mean (rgb and a zero), then (rgb, component), signed. With 4 bits, one line holds two lines
    /// of components.
    rows: Pages<Line>,
    /// (texel, component)
    coefficients: Pages<Line>,
    /// Offset and scale of each component's coefficients.
    range: Vec<[f32; 2]>,
    scale: Vec<f32>,
    fixed: Fixed,
}

/// Integer coefficients, premultiplied by the scale of the component.
#[derive(Debug, Clone)]
struct Fixed {
    /// Offset and scale of each coefficient; the scale is in units of 1/256, with 4 bits 1/16.
    lines: Vec<[[i16; LANES]; 2]>,
    /// Value of one integer unit.
    unit: f32,
}

/// The quantised coefficients of one component.
#[derive(Debug)]
pub struct Plane {
    numbers: Vec<u8>,
    /// Offset and scale of the numbers.
    range: [f32; 2],
    /// Least value and step of the 4-bit form, in 8-bit units.
    coarse: [f32; 2],
    will_do: bool,
}

impl Plane {
    /// Quantises one value per texel, divided by `norm`. 4 bits are enough if their error does not exceed that of a
    /// quantisation step `tolerance`.
    pub fn new(values: &[f32], norm: f32, tolerance: f32) -> Self {
        let (low, high) = values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        let inverse = if high > low { 255.0 / (high - low) } else { 0.0 };
        let numbers: Vec<u8> = values.iter().map(|value| ((value - low) * inverse).round() as u8).collect();
        let mut counts = [0u32; 256];
        numbers.iter().for_each(|&n| counts[usize::from(n)] += 1);
        // extreme values are rare: clipping them may cost less than wider steps
        let (error, coarse) = (0..8)
            .map(|cut| [12.0 * cut as f32, (255.0 - 24.0 * cut as f32) / 15.0])
            .map(|coarse| {
                let off = |n: usize| n as f32 - (coarse[0] + coarse[1] * f32::from(nibble(n as u8, coarse)));
                (counts.iter().enumerate().map(|(n, &count)| count as f32 * off(n).powi(2)).sum::<f32>(), coarse)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or_default();
        let squared = error / values.len() as f32 * ((high - low) / 255.0).powi(2);
        let scale = if norm > 0.0 { 1.0 / norm } else { 0.0 };
        let will_do = squared <= tolerance.powi(2) / 12.0;
        Self { numbers, range: [low * scale, (high - low) / 255.0 * scale], coarse, will_do }
    }
}

/// An 8-bit number as a 4-bit one.
fn nibble(number: u8, [low, step]: [f32; 2]) -> u8 {
    ((f32::from(number) - low) / step).round().clamp(0.0, 15.0) as u8
}

impl Compact {
    /// All components zero, with these coefficients. `mean` has shape (view, light, rgb).
    ///
    /// # Errors
    /// [`crate::Error::Io`] if memory runs out.
    pub fn new(mean: &[f32], planes: &[Plane], texels: usize) -> Result<Self> {
        let groups = planes.len().div_ceil(LANES).max(1);
        // components that need 8 bits come first, with few exceptions
        let precise = planes.iter().filter(|plane| !plane.will_do).count().div_ceil(LANES);
        let fine = groups - (groups - precise) / 2 * 2;
        let c = groups * LANES;
        let lines = fine + (groups - fine) / 2;
        let mut rows = Pages::<Line>::zeros(mean.len() / 3 * (1 + 3 * lines))?;
        for (row, mean) in rows.chunks_exact_mut(1 + 3 * lines).zip(mean.chunks_exact(3)) {
            row[0] = bytemuck::cast([mean[0], mean[1], mean[2], 0.0]);
        }
        let mut coefficients = Pages::<Line>::zeros(texels * lines)?;
        let mut range = vec![[0.0; 2]; c];
        for (k, plane) in planes.iter().enumerate() {
            let (line, shift) = line_of(k / LANES, fine);
            let coarse = (k / LANES >= fine).then_some(plane.coarse);
            let stored: Vec<u8> = (0..=255).map(|n| coarse.map_or(n, |coarse| nibble(n, coarse) << shift)).collect();
            for (texel, &number) in coefficients.chunks_exact_mut(lines).zip(&plane.numbers) {
                texel[line][k % LANES] |= stored[usize::from(number)];
            }
            let ([offset, scale], [low, step]) = (plane.range, coarse.unwrap_or([0.0, 1.0]));
            range[k] = [offset + scale * low, scale * step];
        }
        let scale = vec![0.0; c];
        let fixed = Fixed::new(&range, &scale, fine);
        Ok(Self { c, fine, rows, coefficients, range, scale, fixed })
    }

    /// Sets component `k`, shape (view, light, rgb).
    pub fn set_component(&mut self, k: usize, values: &[f32]) {
        let (line, shift) = line_of(k / LANES, self.fine);
        // the largest integer, and its value in 8-bit units
        let (limit, worth, mask) = if k / LANES < self.fine { (127.0, 127.0, 0xff) } else { (7.0, 7.0 * 16.0, 0xf) };
        let largest = values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        self.scale[k] = largest / worth;
        let inverse = if largest > 0.0 { limit / largest } else { 0.0 };
        let (stride, lines) = (self.stride(), self.lines());
        for (row, rgb) in self.rows.chunks_exact_mut(stride).zip(values.chunks_exact(3)) {
            for (channel, value) in rgb.iter().enumerate() {
                let number = (value * inverse).round() as i8;
                let byte = &mut row[1 + channel * lines + line][k % LANES];
                *byte = *byte & !(mask << shift) | (number as u8 & mask) << shift;
            }
        }
        self.fixed = Fixed::new(&self.range, &self.scale, self.fine);
    }

    /// Lines of one texel, and of one channel of a pair.
    #[inline(always)]
    fn lines(&self) -> usize {
        self.fine + (self.c / LANES - self.fine) / 2
    }

    /// The stored coefficients of a range of texels, shape (texel, component).
    pub(super) fn numbers(&self, first: usize, count: usize) -> Vec<u8> {
        let mut numbers = Vec::with_capacity(count * self.c);
        for texel in self.coefficients[first * self.lines()..].chunks_exact(self.lines()).take(count) {
            for group in 0..self.c / LANES {
                let (line, shift) = line_of(group, self.fine);
                let mask = if group < self.fine { 0xff } else { 0xf };
                numbers.extend(texel[line].map(|byte| byte >> shift & mask));
            }
        }
        numbers
    }

    /// The lines of a pair.
    #[inline(always)]
    fn stride(&self) -> usize {
        1 + 3 * self.lines()
    }

    /// One number of a component.
    fn component(&self, pair: usize, k: usize, channel: usize) -> f32 {
        let (line, shift) = line_of(k / LANES, self.fine);
        let byte = self.rows[pair * self.stride() + 1 + channel * self.lines() + line][k % LANES];
        self.scale[k] * f32::from(widened(byte, k / LANES >= self.fine, shift)) / 256.0
    }

    #[inline(always)]
    fn mean(&self, pair: usize) -> [f32; 3] {
        let [r, g, b, _] = bytemuck::cast::<_, [f32; 4]>(self.rows[pair * self.stride()]);
        [r, g, b]
    }

    /// Number of components, padding included.
    pub fn components(&self) -> usize {
        self.c
    }

    /// Memory that evaluation takes, in bytes.
    pub fn bytes(&self) -> u64 {
        let tables = size_of_val(&self.rows[..]) + size_of_val(&self.coefficients[..]);
        (tables + size_of_val(&self.fixed.lines[..])) as u64
    }

    /// The coefficients of a range of texels, shape (texel, component), padding included.
    pub fn coefficients(&self, first: usize, count: usize) -> Vec<f32> {
        let value = |(number, [offset, scale]): (&u8, &[f32; 2])| offset + scale * f32::from(*number);
        let numbers = self.numbers(first, count);
        numbers.chunks_exact(self.c).flat_map(|texel| texel.iter().zip(&self.range).map(value)).collect()
    }

    /// The mean of a view, shape (light, rgb).
    pub fn mean_of(&self, view: usize, lights: usize) -> Vec<f32> {
        (view * lights..(view + 1) * lights).flat_map(|pair| self.mean(pair)).collect()
    }

    /// The first components of a view, shape (component, light, rgb).
    pub fn basis_of(&self, view: usize, lights: usize, count: usize) -> Vec<f32> {
        let pairs = view * lights..(view + 1) * lights;
        let component =
            |k: usize| pairs.clone().flat_map(move |pair| [0, 1, 2].map(|channel| self.component(pair, k, channel)));
        (0..count).flat_map(component).collect()
    }

    /// The factors of a view of `lights` images, for decoding.
    pub(super) fn factors(&self, view: usize, lights: usize) -> ViewFactors<'_> {
        ViewFactors {
            mean: Cow::Owned(self.mean_of(view, lights)),
            basis: Cow::Owned(self.basis_of(view, lights, self.c)),
            range: Some(&self.range),
            coefficients: Coefficients::Held(self),
        }
    }

    /// Prefetches the coefficients of a texel.
    #[inline(always)]
    pub(super) fn prefetch_texel(&self, texel: usize) {
        let lines = self.lines();
        (0..lines).step_by(FETCHED).for_each(|line| prefetch(&self.coefficients, texel * lines + line));
        prefetch(&self.coefficients, (texel + 1) * lines - 1);
    }

    /// Prefetches the pairs of a stencil.
    #[inline(always)]
    pub(super) fn prefetch_pairs(&self, stencil: &AngularStencil, lights: usize) {
        for (view, _) in stencil.view.iter() {
            for (light, _) in stencil.light.iter() {
                let row = (view * lights + light) * self.stride();
                (0..self.stride()).step_by(FETCHED).for_each(|line| prefetch(&self.rows, row + line));
                prefetch(&self.rows, row + self.stride() - 1);
            }
        }
    }

    /// Sum over views, lights and texels of weights x (mean + components . coefficients), in the domain.
    #[inline(always)]
    pub(super) fn sum<const T: usize>(
        &self,
        stencil: &AngularStencil,
        lights: usize,
        texels: [usize; T],
        weights: [f32; T],
    ) -> [f32; 3] {
        let mut pairs = Pairs { count: 0, line: [0; 16], weight: [0; 16] };
        let mut total = [0.0f32; 3];
        for (view, view_weight) in stencil.view.iter() {
            for (light, light_weight) in stencil.light.iter() {
                let (pair, weight) = (view * lights + light, view_weight * light_weight);
                pairs.line[pairs.count] = pair * self.stride() + 1;
                pairs.weight[pairs.count] = fraction(weight);
                pairs.count += 1;
                total.iter_mut().zip(self.mean(pair)).for_each(|(total, mean)| *total += weight * mean);
            }
        }
        let sums = self.products(&pairs, texels.map(|texel| texel * self.lines()), weights.map(fraction));
        for (total, sum) in total.iter_mut().zip(sums) {
            *total += self.fixed.unit * sum as f32;
        }
        total
    }

    /// [`Compact::sum`] for one texel per stencil.
    pub(super) fn sums(&self, stencils: &[AngularStencil], lights: usize, texels: &[usize], out: &mut [[f32; 3]]) {
        #[inline(always)]
        fn all(table: &Compact, stencils: &[AngularStencil], lights: usize, texels: &[usize], out: &mut [[f32; 3]]) {
            /// Number of queries that prefetching runs ahead.
            const AHEAD: usize = 4;
            for (stencil, texel) in stencils.iter().zip(texels).take(AHEAD) {
                table.prefetch_texel(*texel);
                table.prefetch_pairs(stencil, lights);
            }
            for (i, out) in out.iter_mut().enumerate().take(stencils.len()) {
                if let (Some(stencil), Some(texel)) = (stencils.get(i + AHEAD), texels.get(i + AHEAD)) {
                    table.prefetch_texel(*texel);
                    table.prefetch_pairs(stencil, lights);
                }
                *out = table.sum(&stencils[i], lights, [texels[i]], [1.0]);
            }
        }
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            fn avx2(t: &Compact, stencils: &[AngularStencil], lights: usize, texels: &[usize], out: &mut [[f32; 3]]) {
                all(t, stencils, lights, texels, out);
            }
            if crate::simd::has_avx2() {
                // SAFETY: the processor has AVX2.
                return unsafe { avx2(self, stencils, lights, texels, out) };
            }
        }
        all(self, stencils, lights, texels, out);
    }

    /// Interpolated coefficients of the texels times interpolated components of the pairs.
    #[inline(always)]
    fn products<const T: usize>(&self, pairs: &Pairs, texels: [usize; T], weights: [i16; T]) -> [i32; 3] {
        #[cfg(target_arch = "x86_64")]
        if crate::simd::has_avx2() {
            // SAFETY: the processor has AVX2.
            return unsafe { self.products_avx2(pairs, texels, weights) };
        }
        self.products_portable(pairs, texels, weights)
    }

    fn products_portable<const T: usize>(&self, pairs: &Pairs, texels: [usize; T], weights: [i16; T]) -> [i32; 3] {
        let (mut totals, lines) = ([0i32; 3], self.lines());
        for (k, [offset, scale]) in
            self.fixed.lines.iter().flat_map(|[o, s]| o.iter().zip(s).map(|(o, s)| [*o, *s])).enumerate()
        {
            let (group, lane) = (k / LANES, k % LANES);
            let (line, shift) = line_of(group, self.fine);
            let coarse = group >= self.fine;
            // in units of 1/128, with 4 bits 1/2048
            let mut number = 0i16;
            for (texel, weight) in texels.iter().zip(weights) {
                let byte = self.coefficients[texel + line][lane];
                let wide = if coarse { i16::from(byte >> shift & 0xf) << 11 } else { i16::from(byte) << 7 };
                number = number.wrapping_add(times(wide, weight));
            }
            let coefficient = times(number, scale).wrapping_add(offset);
            for (channel, total) in totals.iter_mut().enumerate() {
                // in units of 1/256
                let mut component = 0i16;
                for (first, weight) in pairs.line[..pairs.count].iter().zip(pairs.weight) {
                    let byte = self.rows[first + channel * lines + line][lane];
                    component = component.wrapping_add(times(widened(byte, coarse, shift), weight));
                }
                *total = total.wrapping_add(i32::from(coefficient) * i32::from(component));
            }
        }
        totals
    }
}

impl Fixed {
    /// Computes integers from offset and scale of the coefficients and the scales of the components.
    fn new(range: &[[f32; 2]], scale: &[f32], fine: usize) -> Self {
        let ranges = || range.iter().zip(scale).map(|([offset, step], scale)| [offset * scale, step * scale]);
        // in units of the scale
        let part = |k: usize| if k / LANES < fine { 256.0 } else { 16.0 };
        let step = ranges().enumerate().map(|(k, [_, step])| step.abs() * part(k)).fold(0.0, f32::max);
        let most = |[offset, step]: [f32; 2], k: usize| {
            let last = if k / LANES < fine { 255.0 } else { 15.0 };
            offset.abs().max((offset + last * step).abs())
        };
        let together: f32 = ranges().enumerate().map(|(k, range)| most(range, k)).sum();
        let largest = ranges().enumerate().map(|(k, range)| most(range, k)).fold(0.0, f32::max);
        // keep the sum of all coefficients, each coefficient and each scale within the range of its integer
        let per_unit = (LARGEST / together).min(32_000.0 / largest).min(32_000.0 / step);
        if !per_unit.is_normal() {
            return Self { lines: vec![[[0; LANES]; 2]; range.len() / LANES], unit: 0.0 };
        }
        let mut lines = vec![[[0; LANES]; 2]; range.len() / LANES];
        for (k, [offset, step]) in ranges().enumerate() {
            let [offsets, steps] = &mut lines[k / LANES];
            offsets[k % LANES] = (offset * per_unit).round() as i16;
            steps[k % LANES] = (step * per_unit * part(k)).round() as i16;
        }
        // components are multiplied by fractions of 256
        Self { lines, unit: 1.0 / (256.0 * per_unit) }
    }
}

/// The pairs around a query: first lines and weights.
struct Pairs {
    count: usize,
    line: [usize; 16],
    weight: [i16; 16],
}

/// The texel's line that holds a line of components, and the bit position within its bytes.
#[inline(always)]
fn line_of(group: usize, fine: usize) -> (usize, u32) {
    match group.checked_sub(fine) {
        None => (group, 0),
        Some(coarse) => (fine + coarse / 2, if coarse.is_multiple_of(2) { 0 } else { 4 }),
    }
}

/// A signed byte, or four bits of it, in the high bits of a 16-bit number.
#[inline(always)]
fn widened(byte: u8, coarse: bool, shift: u32) -> i16 {
    let bits = u16::from(byte);
    let bits = if coarse { (bits >> shift) << 12 } else { bits << 8 };
    bits as i16
}

/// A weight of 0..1 in units of 1/32768.
#[inline(always)]
fn fraction(weight: f32) -> i16 {
    (weight * 32_768.0 + 0.5) as i16
}

/// The rounded product with a fraction in units of 1/32768.
#[inline(always)]
fn times(a: i16, fraction: i16) -> i16 {
    ((i32::from(a) * i32::from(fraction) + 0x4000) >> 15) as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::portable;

    #[test]
    fn both_kernels_give_the_same_bits_and_are_near_single_precision() {
        let (pairs, texels, count) = (12, 7, 61);
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1u32 << 23) as f32 - 1.0
        };
        let mean: Vec<f32> = (0..3 * pairs).map(|_| random()).collect();
        let components: Vec<Vec<f32>> = (0..count).map(|_| (0..3 * pairs).map(|_| random()).collect()).collect();
        let size = |k: usize| 1.0 / (1 + k) as f32;
        let planes: Vec<Vec<f32>> =
            (0..count).map(|k| (0..texels).map(|_| (random() + 0.3) * size(k)).collect()).collect();
        let held: Vec<Plane> = planes.iter().map(|plane| Plane::new(plane, 1.0, 0.01)).collect();
        let mut compact = Compact::new(&mean, &held, texels).unwrap();
        components.iter().enumerate().for_each(|(k, component)| compact.set_component(k, component));
        assert_eq!((compact.fine, compact.lines()), (2, 3), "both precisions occur");
        let weights = [0.5f32, 0.25, 0.125, 0.125];
        let query = Pairs {
            count: 4,
            line: std::array::from_fn(|i| (i % 4 * 2 + 1) * compact.stride() + 1),
            weight: std::array::from_fn(|i| fraction(weights[i % 4])),
        };
        let rows = [0usize, 3, 5, 6];
        let run = || compact.products(&query, rows.map(|t| t * compact.lines()), weights.map(fraction));
        let found = run();
        assert_eq!(found, portable(run));
        for (channel, sum) in found.into_iter().enumerate() {
            let expected: f32 = (0..count)
                .map(|k| {
                    let coefficient: f32 = (0..4).map(|t| weights[t] * planes[k][rows[t]]).sum();
                    let component: f32 = (0..4).map(|i| weights[i] * components[k][3 * (2 * i + 1) + channel]).sum();
                    coefficient * component
                })
                .sum();
            let found = compact.fixed.unit * sum as f32;
            assert!((found - expected).abs() < 0.02, "{channel}: {found} {expected}");
        }
    }
}
