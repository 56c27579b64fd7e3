//! The exemplar at one scale: blurred texels, and the features by which neighbourhoods are compared.

use rayon::prelude::*;

use super::super::Source;
use super::domain::Domain;
use super::sample::{Sample, inner_products, variance};
use crate::factor::linalg;
use crate::{Error, Result};

/// Features of a neighbourhood.
pub(in crate::synth) const FEATURES: usize = 24;

/// The largest distance of a neighbourhood's texels from its centre, in steps.
pub(super) const RADIUS: usize = 3;

/// Neighbourhoods from which principal components are computed.
const TRAINING: usize = 2500;

/// The exemplar at one scale. Neighbours are `step` texels apart, and coordinates are those of the finest scale.
pub(in crate::synth) struct Level<'a, const C: usize> {
    pub sample: &'a Sample<C>,
    pub step: usize,
    /// Radius of neighbourhoods in steps.
    pub radius: usize,
    pub domain: Domain,
    /// Blurred texels.
    pub texels: Vec<[f32; C]>,
    /// Whether all texels of the neighbourhood may be used.
    pub usable: Vec<bool>,
    /// Features of the neighbourhood of each texel; zero where it is not usable.
    pub features: Vec<[f32; FEATURES]>,
    /// For each number of a neighbourhood its share in each feature.
    pub basis: Vec<[f32; FEATURES]>,
    /// Variance of the blurred texels, as a share of that of the exemplar.
    pub contrast: f32,
}

impl<'a, const C: usize> Level<'a, C> {
    /// The exemplar at one scale; none if no neighbourhood is usable.
    ///
    /// # Errors
    /// [`Error::NonFinite`] if numbers overflow.
    pub(in crate::synth) fn new(sample: &'a Sample<C>, step: usize, radius: usize) -> Result<Option<Self>> {
        let domain = sample.domain;
        let sharp = step == 1;
        let texels = if sharp { sample.texels.clone() } else { blurred(sample, 0.5 * step as f64) };
        let contrast = variance(&texels, &sample.open) / variance(&sample.texels, &sample.open).max(f32::MIN_POSITIVE);
        let (usable, features, basis) = (Vec::new(), Vec::new(), Vec::new());
        let mut level = Self { sample, step, radius, domain, texels, usable, features, basis, contrast };
        level.usable = level.usable_centres();
        if !level.usable.contains(&true) {
            return Ok(None);
        }
        level.basis = level.principal_components()?;
        level.features = level.all_features();
        Ok(Some(level))
    }

    /// Distance of usable centres from the edge, in texels.
    pub(super) fn margin(&self) -> i32 {
        if self.domain.periodic { 0 } else { (self.radius * self.step) as i32 }
    }

    /// Texels of a neighbourhood row by row, as offsets in texels.
    fn offsets(&self) -> impl Iterator<Item = (i32, i32)> + use<'a, C> {
        let (r, step) = (self.radius as i32, self.step as i32);
        (-r..=r).flat_map(move |y| (-r..=r).map(move |x| (x * step, y * step)))
    }

    fn usable_centres(&self) -> Vec<bool> {
        let (domain, open) = (self.domain, &self.sample.open);
        // a neighbourhood does not meet itself
        let span = (2 * self.radius * self.step).max(1);
        if span > domain.width.min(domain.height) {
            return vec![false; self.texels.len()];
        }
        let is_open = |u, dx, dy| domain.shifted(u, dx, dy, 0).is_some_and(|s| open[domain.index(s)]);
        let inside = |u| self.offsets().all(|(dx, dy)| is_open(u, dx, dy));
        let texels = 0..domain.width * domain.height;
        texels.into_par_iter().map(|i| inside(Source::new(i % domain.width, i / domain.width))).collect()
    }

    /// The numbers of the neighbourhood of a usable centre.
    fn neighbourhood(&self, centre: Source, into: &mut Vec<[f32; C]>) {
        into.clear();
        into.extend(self.offsets().map(|(dx, dy)| {
            let source = self.domain.clamped(centre, dx, dy, 0);
            self.texels[self.domain.index(source)]
        }));
    }

    /// Square root of the weight of each texel of a neighbourhood; weights sum to one.
    fn weights(&self) -> Vec<f32> {
        let sigma = 0.65 * self.radius.max(1) as f64 * self.step as f64;
        let weight = |(x, y): (i32, i32)| libm::exp(-f64::from(x * x + y * y) / (2.0 * sigma * sigma));
        let sum: f64 = self.offsets().map(weight).sum();
        self.offsets().map(|offset| (weight(offset) / sum).sqrt() as f32).collect()
    }

    /// Principal components of weighted neighbourhoods, as shares of each number in each feature.
    fn principal_components(&self) -> Result<Vec<[f32; FEATURES]>> {
        let weights = self.weights();
        let n = weights.len() * C;
        let usable: Vec<usize> = (0..self.usable.len()).filter(|&i| self.usable[i]).collect();
        let count = usable.len().min(TRAINING);
        let mut rows = vec![0.0; n * count];
        let mut patch = Vec::new();
        for k in 0..count {
            let i = usable[k * usable.len() / count];
            self.neighbourhood(Source::new(i % self.domain.width, i / self.domain.width), &mut patch);
            for (e, (number, weight)) in
                patch.as_flattened().iter().zip(weights.iter().flat_map(|w| [w; C])).enumerate()
            {
                rows[e * count + k] = number * weight;
            }
        }
        for row in rows.chunks_exact_mut(count) {
            let mean = row.iter().sum::<f32>() / count as f32;
            row.iter_mut().for_each(|v| *v -= mean);
        }
        let covariance = inner_products(&rows, count);
        let kept = FEATURES.min(n);
        let eigen =
            linalg::largest_eigenpairs(&covariance, n, kept).ok_or_else(|| Error::non_finite("the exemplar"))?;
        let share = |e: usize, k: usize| if k < kept { eigen.vectors[k * n + e] as f32 * weights[e / C] } else { 0.0 };
        Ok((0..n).map(|e| std::array::from_fn(|k| share(e, k))).collect())
    }

    fn all_features(&self) -> Vec<[f32; FEATURES]> {
        let mut features = vec![[0.0; FEATURES]; self.texels.len()];
        features.par_chunks_mut(self.domain.width).enumerate().for_each_init(Vec::new, |patch, (y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                if self.usable[y * self.domain.width + x] {
                    self.neighbourhood(Source::new(x, y), patch);
                    *out = [0.0; FEATURES];
                    add_features(patch.as_flattened(), &self.basis, out);
                }
            }
        });
        features
    }
}

/// Adds the features of some numbers of a neighbourhood.
#[inline(always)]
pub(in crate::synth) fn add_features(numbers: &[f32], basis: &[[f32; FEATURES]], sums: &mut [f32; FEATURES]) {
    for (number, shares) in numbers.iter().zip(basis) {
        for (sum, share) in sums.iter_mut().zip(shares) {
            *sum += number * share;
        }
    }
}

/// Gaussian blur of usable texels, by rows and then by columns.
fn blurred<const C: usize>(sample: &Sample<C>, sigma: f64) -> Vec<[f32; C]> {
    let (domain, sharp) = (sample.domain, &sample.texels);
    let reach = (3.0 * sigma).ceil() as i32;
    let kernel: Vec<f32> =
        (-reach..=reach).map(|x| libm::exp(-f64::from(x * x) / (2.0 * sigma * sigma)) as f32).collect();
    let weight = |i: usize| if sample.open[i] { 1.0 } else { 0.0 };
    let start: Vec<([f32; C], f32)> =
        sharp.iter().enumerate().map(|(i, v)| (v.map(|v| v * weight(i)), weight(i))).collect();
    let pass = |from: &[([f32; C], f32)], dx: i32, dy: i32| -> Vec<([f32; C], f32)> {
        let sum = |i: usize| {
            let centre = Source::new(i % domain.width, i / domain.width);
            let mut sum = ([0.0; C], 0.0);
            for (k, weight) in (-reach..=reach).zip(&kernel) {
                let Some(source) = domain.shifted(centre, k * dx, k * dy, 0) else { continue };
                let (texel, share) = &from[domain.index(source)];
                sum.0.iter_mut().zip(texel).for_each(|(sum, v)| *sum += weight * v);
                sum.1 += weight * share;
            }
            sum
        };
        (0..from.len()).into_par_iter().map(sum).collect()
    };
    let both = pass(&pass(&start, 1, 0), 0, 1);
    both.into_iter().zip(sharp).map(|((sum, share), v)| if share > 0.0 { sum.map(|s| s / share) } else { *v }).collect()
}
