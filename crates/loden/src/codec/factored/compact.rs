//! Factors with 8 bits each, for many components: small enough to stay in memory, and evaluated as they are.

use std::borrow::Cow;

use super::decode::{Coefficients, ViewFactors};
use crate::Result;
use crate::codec::pages::Pages;
use crate::factor::simd::{prefetch, wide};
use crate::material::angles::AngularStencil;

/// Components that are evaluated together; others are filled up with zeros.
const LANES: usize = 8;

/// A mean, and components times coefficients.
#[derive(Debug)]
pub struct Compact {
    /// Components, a multiple of [`LANES`].
    c: usize,
    /// (view, light, rgb), each with a zero.
    mean: Vec<[f32; 4]>,
    /// (view, light, group of components, rgb, component)
    basis: Pages<i8>,
    /// (texel, component)
    coefficients: Pages<u8>,
    /// Offset and scale of each component's coefficients, and the scale of the component.
    range: Vec<[f32; 2]>,
    scale: Vec<f32>,
    /// Offset and scale of coefficients, with that of the component worked in.
    lines: Vec<[[f32; LANES]; 2]>,
}

impl Compact {
    /// `count` components that are zero. `mean` has the shape (view, light, rgb).
    ///
    /// # Errors
    /// [`crate::Error::Io`] if there is not enough memory.
    pub fn new(mean: Vec<f32>, count: usize, texels: usize) -> Result<Self> {
        let c = count.next_multiple_of(LANES).max(LANES);
        Ok(Self {
            c,
            basis: Pages::zeros(mean.len() * c)?,
            mean: mean.chunks_exact(3).map(|m| [m[0], m[1], m[2], 0.0]).collect(),
            coefficients: Pages::zeros(texels * c)?,
            range: vec![[0.0; 2]; c],
            scale: vec![0.0; c],
            lines: vec![[[0.0; LANES]; 2]; c / LANES],
        })
    }

    /// Sets component `k`, shape (view, light, rgb).
    pub fn set_component(&mut self, k: usize, values: &[f32]) {
        let largest = values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        self.scale[k] = largest / 127.0;
        let inverse = if largest > 0.0 { 127.0 / largest } else { 0.0 };
        for (pair, rgb) in values.chunks_exact(3).enumerate() {
            for (channel, value) in rgb.iter().enumerate() {
                let place = self.place(pair, k, channel);
                self.basis[place] = (value * inverse).round() as i8;
            }
        }
        self.work_in(k);
    }

    /// Sets the coefficients of component `k`, a number for each texel, to be divided by `norm`.
    pub fn set_plane(&mut self, k: usize, values: &[f32], norm: f32) {
        let (low, high) = values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        let inverse = if high > low { 255.0 / (high - low) } else { 0.0 };
        for (texel, value) in self.coefficients.chunks_exact_mut(self.c).zip(values) {
            texel[k] = ((value - low) * inverse).round() as u8;
        }
        let scale = if norm > 0.0 { 1.0 / norm } else { 0.0 };
        self.range[k] = [low * scale, (high - low) / 255.0 * scale];
        self.work_in(k);
    }

    fn work_in(&mut self, k: usize) {
        let [offset, scale] = self.range[k].map(|v| v * self.scale[k]);
        let line = &mut self.lines[k / LANES];
        (line[0][k % LANES], line[1][k % LANES]) = (offset, scale);
    }

    fn place(&self, pair: usize, k: usize, channel: usize) -> usize {
        ((pair * (self.c / LANES) + k / LANES) * 3 + channel) * LANES + k % LANES
    }

    /// Components, those that fill up included.
    pub fn components(&self) -> usize {
        self.c
    }

    /// Bytes that evaluation needs in memory.
    pub fn bytes(&self) -> u64 {
        let tables = self.basis.len() + self.coefficients.len();
        (tables + size_of_val(&self.mean[..]) + size_of_val(&self.lines[..])) as u64
    }

    /// The factors of a view of `lights` images, for decoding.
    pub(super) fn factors(&self, view: usize, lights: usize) -> ViewFactors<'_> {
        let pairs = view * lights..(view + 1) * lights;
        let component = |k: usize| {
            let value = move |pair: usize, channel: usize| f32::from(self.basis[self.place(pair, k, channel)]);
            pairs.clone().flat_map(move |pair| [0, 1, 2].map(|channel| self.scale[k] * value(pair, channel)))
        };
        ViewFactors {
            mean: Cow::Owned(self.mean[pairs.clone()].iter().flat_map(|m| [m[0], m[1], m[2]]).collect()),
            basis: Cow::Owned((0..self.c).flat_map(component).collect()),
            range: Some(&self.range),
            coefficients: Coefficients::U8(&self.coefficients),
        }
    }

    /// Asks for the memory that [`Compact::sum`] needs.
    #[inline(always)]
    pub(super) fn prefetch(&self, texel: usize, stencil: &AngularStencil, lights: usize) {
        prefetch(&self.coefficients, texel * self.c);
        prefetch(&self.coefficients, (texel + 1) * self.c - 1);
        let row = 3 * self.c;
        for (view, _) in stencil.view.iter() {
            for (light, _) in stencil.light.iter() {
                for place in (0..row).step_by(64) {
                    prefetch(&self.basis, (view * lights + light) * row + place);
                }
            }
        }
    }

    /// Sum over views, lights and texels of weights x (mean + components . coefficients), in the domain.
    pub(super) fn sum<const T: usize>(
        &self,
        stencil: &AngularStencil,
        lights: usize,
        texels: [usize; T],
        weights: [f32; T],
    ) -> [f32; 3] {
        let mut pairs = Pairs { count: 0, row: [&[]; 16], weight: [0.0; 16] };
        let mut total = [0.0f32; 3];
        for (view, view_weight) in stencil.view.iter() {
            for (light, light_weight) in stencil.light.iter() {
                let (pair, weight) = (view * lights + light, view_weight * light_weight);
                pairs.row[pairs.count] = &self.basis[pair * 3 * self.c..][..3 * self.c];
                pairs.weight[pairs.count] = weight;
                pairs.count += 1;
                total.iter_mut().zip(self.mean[pair]).for_each(|(total, mean)| *total += weight * mean);
            }
        }
        let rows = texels.map(|texel| &self.coefficients[texel * self.c..][..self.c]);
        let sums = products(&self.lines, &pairs, &rows, &weights);
        for (total, sum) in total.iter_mut().zip(sums) {
            *total += sum;
        }
        total
    }
}

/// The rows of the pairs around a query.
struct Pairs<'a> {
    count: usize,
    row: [&'a [i8]; 16],
    weight: [f32; 16],
}

wide! {
    /// Coefficients, interpolated between texels, times components, interpolated between pairs.
    fn products(lines: &[[[f32; LANES]; 2]], pairs: &Pairs, texels: &[&[u8]], weights: &[f32]) -> [f32; 3] {
        let mut totals = [[0.0f32; LANES]; 3];
        for (group, [offset, scale]) in lines.iter().enumerate() {
            let mut coefficient = [0.0f32; LANES];
            for (row, weight) in texels.iter().zip(weights) {
                if let Some(numbers) = row.get(group * LANES..(group + 1) * LANES) {
                    for (sum, number) in coefficient.iter_mut().zip(numbers) {
                        *sum += weight * f32::from(*number);
                    }
                }
            }
            let mut component = [[0.0f32; LANES]; 3];
            for (row, weight) in pairs.row[..pairs.count].iter().zip(&pairs.weight) {
                if let Some(numbers) = row.get(3 * group * LANES..3 * (group + 1) * LANES) {
                    for (sum, numbers) in component.iter_mut().zip(numbers.chunks_exact(LANES)) {
                        for (sum, number) in sum.iter_mut().zip(numbers) {
                            *sum += weight * f32::from(*number);
                        }
                    }
                }
            }
            for (total, component) in totals.iter_mut().zip(&component) {
                for i in 0..LANES {
                    total[i] += (offset[i] + scale[i] * coefficient[i]) * component[i];
                }
            }
        }
        totals.map(|total| total.iter().sum())
    }
}
