//! The exemplar as it is searched: a few channels, of unit variance together.

use super::super::Exemplar;
use super::domain::Domain;
use crate::factor::linalg;
use crate::{Error, Result};

/// Texels from which principal components of many channels are computed.
const TRAINING: usize = 8192;

/// An exemplar of `C` channels.
pub(in crate::synth) struct Sample<const C: usize> {
    pub domain: Domain,
    /// Channels with mean zero, and variances whose sum is one unless the exemplar is constant.
    pub texels: Vec<[f32; C]>,
    /// Whether a texel may be copied.
    pub open: Vec<bool>,
    /// How often a texel is to be used, relative to the mean of usable ones; empty if all alike.
    pub weights: Vec<f32>,
}

impl<const C: usize> Sample<C> {
    /// The channels of the exemplar, or its leading principal components if it has more than `C`.
    ///
    /// # Errors
    /// [`Error::NonFinite`] if numbers overflow.
    pub(in crate::synth) fn new(exemplar: &Exemplar) -> Result<Self> {
        let n = exemplar.channels;
        let open = exemplar.mask.clone().unwrap_or_else(|| vec![true; exemplar.width * exemplar.height]);
        let mean = mean(&exemplar.values, n, &open);
        let basis = if n > C { principal_components(exemplar, &open, &mean, C)? } else { Vec::new() };
        let texel = |values: &[f32]| {
            let centred = |c: usize| values.get(c).map_or(0.0, |v| v - mean[c]);
            if basis.is_empty() {
                return std::array::from_fn(centred);
            }
            std::array::from_fn(|k| basis[k * n..][..n].iter().enumerate().map(|(c, b)| *b as f32 * centred(c)).sum())
        };
        let mut texels: Vec<[f32; C]> = exemplar.values.chunks_exact(n).map(texel).collect();
        let variance = variance(&texels, &open);
        if !variance.is_finite() {
            return Err(Error::non_finite("the variance of the exemplar"));
        }
        if variance > 0.0 {
            let scale = 1.0 / variance.sqrt();
            texels.iter_mut().flatten().for_each(|v| *v *= scale);
        }
        let domain = Domain { width: exemplar.width, height: exemplar.height, periodic: exemplar.periodic };
        let mut weights = exemplar.weights.clone().unwrap_or_default();
        let mean =
            weights.iter().zip(&open).filter(|(_, open)| **open).fold([0.0; 2], |[sum, n], (w, _)| [sum + w, n + 1.0]);
        weights.iter_mut().for_each(|weight| *weight *= mean[1] / mean[0]);
        Ok(Self { domain, texels, open, weights })
    }
}

/// The mean of each of `n` channels over usable texels.
fn mean(values: &[f32], n: usize, open: &[bool]) -> Vec<f32> {
    let (mut sums, mut count) = (vec![0.0f64; n], 0.0);
    for (texel, _) in values.chunks_exact(n).zip(open).filter(|(_, open)| **open) {
        count += 1.0;
        sums.iter_mut().zip(texel).for_each(|(sum, v)| *sum += f64::from(*v));
    }
    sums.iter().map(|sum| (sum / count) as f32).collect()
}

/// Unit vectors along which usable texels vary most.
fn principal_components(exemplar: &Exemplar, open: &[bool], mean: &[f32], count: usize) -> Result<Vec<f64>> {
    let n = exemplar.channels;
    let usable: Vec<usize> = (0..open.len()).filter(|i| open[*i]).collect();
    let training = usable.len().min(TRAINING);
    let mut rows = vec![0.0; n * training];
    for k in 0..training {
        let texel = &exemplar.values[usable[k * usable.len() / training] * n..][..n];
        for (c, (v, mean)) in texel.iter().zip(mean).enumerate() {
            rows[c * training + k] = v - mean;
        }
    }
    let covariance = inner_products(&rows, training);
    let eigen = linalg::largest_eigenpairs(&covariance, n, count);
    Ok(eigen.ok_or_else(|| Error::non_finite("the variance of the exemplar"))?.vectors)
}

/// The symmetric matrix of inner products of rows of `stride` numbers.
pub(super) fn inner_products(rows: &[f32], stride: usize) -> Vec<f64> {
    let n = rows.len() / stride;
    let mut products = vec![0.0; n * n];
    linalg::add_row_products(rows, stride, &mut vec![0.0; n * n], &mut products);
    for i in 0..n {
        for j in 0..i {
            products[j * n + i] = products[i * n + j];
        }
    }
    products
}

/// Mean squared distance of usable texels from their mean.
pub(super) fn variance<const C: usize>(texels: &[[f32; C]], open: &[bool]) -> f32 {
    let mean = mean(texels.as_flattened(), C, open);
    let (mut sum, mut count) = (0.0f64, 0.0);
    for (texel, _) in texels.iter().zip(open).filter(|(_, open)| **open) {
        count += 1.0;
        sum += texel.iter().zip(&mean).map(|(v, mean)| f64::from((v - mean) * (v - mean))).sum::<f64>();
    }
    (sum / count) as f32
}
