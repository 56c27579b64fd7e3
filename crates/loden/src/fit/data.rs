//! Measured samples, and the error of a model.

use glam::DVec3;

use crate::material::BrdfSample;
use crate::model::Analytic;
use crate::{Error, Result};

/// Largest number of samples used for a fit.
pub const MAX_SAMPLES: usize = 4096;

crate::words! {
    /// The error that a fit minimises: a root mean square over samples and channels.
    pub enum Metric {
        /// Of the difference in f cos: reflected light itself.
        Cosine = "cosine",
        /// Of the difference in ln(1 + f cos): highlights count less.
        Logarithmic = "log",
        /// Of the difference in the cube root of f cos: close to lightness.
        CubeRoot = "cube-root",
    }
}

impl Metric {
    /// The function of f cos whose differences are measured.
    #[inline]
    pub(super) fn compress(self, x: f64) -> f64 {
        match self {
            Self::Cosine => x,
            Self::Logarithmic => x.ln_1p(),
            Self::CubeRoot => x.cbrt(),
        }
    }

    /// The derivative of [`Metric::compress`].
    #[inline]
    pub(super) fn slope(self, x: f64) -> f64 {
        match self {
            Self::Cosine => 1.0,
            Self::Logarithmic => 1.0 / (1.0 + x),
            // keep the slope finite at black, where the cube root's is infinite
            Self::CubeRoot => 1.0 / (3.0 * x.max(1e-9).cbrt().powi(2)),
        }
    }
}

/// One sample: directions, the weight of a reflectance (the cosine of the light), and the measured value times the
/// weight.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub wi: DVec3,
    pub wo: DVec3,
    pub weight: f64,
    pub value: DVec3,
}

/// Measured values ready for fitting.
#[derive(Debug, Clone)]
pub struct Data {
    pub(super) points: Vec<Point>,
}

impl Data {
    /// Takes the samples with both directions above the surface and finite values; negative values become zero. If
    /// there are more than [`MAX_SAMPLES`], evenly spread ones are taken.
    ///
    /// # Errors
    /// [`Error::Parameter`] if none is usable.
    pub fn new(samples: &[BrdfSample]) -> Result<Self> {
        let usable = |s: &&BrdfSample| s.wi.z > 0.0 && s.wo.z > 0.0 && s.value.is_finite();
        let usable: Vec<&BrdfSample> = samples.iter().filter(usable).collect();
        if usable.is_empty() {
            return Err(Error::parameter("samples", "found no finite value above the surface"));
        }
        let count = usable.len().min(MAX_SAMPLES);
        let points = (0..count).map(|i| {
            // the golden ratio keeps the stride from aligning with the rows of a table
            let slot = (i as f64 + (i as f64 * 0.618_033_988_749_895).fract()) * usable.len() as f64 / count as f64;
            let sample = usable[if count == usable.len() { i } else { (slot as usize).min(usable.len() - 1) }];
            let (wi, wo) = (sample.wi.as_dvec3().normalize(), sample.wo.as_dvec3().normalize());
            Point { wi, wo, weight: wi.z, value: sample.value.as_dvec3().max(DVec3::ZERO) * wi.z }
        });
        Ok(Self { points: points.collect() })
    }

    /// A subset of at most about `count` samples, reweighted so that its sum of squares estimates that of all. Half
    /// of the samples are chosen in proportion to the squared values, so narrow highlights are kept.
    pub(super) fn thinned(&self, count: usize) -> Self {
        if self.len() <= count {
            return self.clone();
        }
        let squares: Vec<f64> = self.points.iter().map(|p| p.value.length_squared()).collect();
        let total = squares.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mut due = 0.5;
        let one = |(point, square): (&Point, &f64)| {
            let chance = (0.5 * count as f64 * (1.0 / self.len() as f64 + square / total)).min(1.0);
            due += chance;
            let weight = chance.sqrt().recip();
            (due >= 1.0).then(|| {
                due -= 1.0;
                Point { weight: point.weight * weight, value: point.value * weight, ..*point }
            })
        };
        Self { points: self.points.iter().zip(&squares).filter_map(one).collect() }
    }

    /// The samples in use.
    pub fn samples(&self) -> Vec<BrdfSample> {
        let sample =
            |p: &Point| BrdfSample { wi: p.wi.as_vec3(), wo: p.wo.as_vec3(), value: (p.value / p.weight).as_vec3() };
        self.points.iter().map(sample).collect()
    }

    /// Number of samples in use.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no samples; never true.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The error of a model.
    pub fn error(&self, brdf: &Analytic, metric: Metric) -> f64 {
        self.rms(metric, |point| brdf.brdf(point.wi, point.wo) * point.weight)
    }

    /// The error of a black material.
    pub fn scale(&self, metric: Metric) -> f64 {
        self.rms(metric, |_| DVec3::ZERO)
    }

    fn rms(&self, metric: Metric, value: impl Fn(&Point) -> DVec3) -> f64 {
        let distance = |point: &Point| {
            let (a, b) = (value(point), point.value);
            (0..3).map(|c| (metric.compress(a[c]) - metric.compress(b[c])).powi(2)).sum::<f64>()
        };
        (self.points.iter().map(distance).sum::<f64>() / (3 * self.points.len()) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::direction::from_angles;

    #[test]
    fn a_thinned_sum_is_close_to_the_full_one_and_keeps_the_highlight() {
        let sample = |i: usize| {
            let theta = 1.5 * i as f32 / 4000.0;
            // five samples hold nearly all of the energy
            let value = if (2000..2005).contains(&i) { 100.0 } else { 0.5 + theta };
            BrdfSample { wi: from_angles(theta, 0.0), wo: Vec3::Z, value: Vec3::splat(value) }
        };
        let data = Data::new(&(0..4000).map(sample).collect::<Vec<_>>()).unwrap();
        let few = data.thinned(500);
        assert!((200..=500).contains(&few.len()), "{}", few.len());
        // the squared error of a model with the constant reflectance `f`
        let left = |data: &Data, f: f64| -> f64 {
            data.points.iter().map(|p| (p.value - DVec3::splat(f * p.weight)).length_squared()).sum()
        };
        for f in [0.0, 1.0, 20.0] {
            let ratio = left(&few, f) / left(&data, f);
            assert!((ratio - 1.0).abs() < 0.05, "{f}: {ratio}");
        }
        assert_eq!(data.thinned(8000).len(), 4000);
    }
}
