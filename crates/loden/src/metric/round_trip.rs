//! Error of a material at the samples it was made from.

use glam::Vec2;
use rayon::prelude::*;
use serde::Serialize;

use crate::material::{BrdfSample, Material};

/// Maximum number of samples; larger sets are thinned out evenly.
const MAX_SAMPLES: usize = 50_000;

/// Difference of a BRDF from samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RoundTrip {
    /// Number of samples compared.
    pub samples: usize,
    /// Sum of absolute differences over the sum of values, both weighted with both cosines.
    pub relative_error: f64,
    /// Largest difference over the largest value, both weighted with both cosines.
    pub largest_error: f64,
}

/// Evaluates `material` at the directions of `samples` and compares the values.
pub fn round_trip(samples: &[BrdfSample], material: &dyn Material) -> RoundTrip {
    let step = samples.len().div_ceil(MAX_SAMPLES).max(1);
    let rows: Vec<[f64; 4]> = samples
        .par_iter()
        .step_by(step)
        .map(|s| {
            let weight = f64::from(s.wi.z.max(0.0) * s.wo.z.max(0.0));
            let difference = (material.eval(Vec2::ZERO, s.wi, s.wo) - s.value).abs();
            let sum = |v: glam::Vec3| f64::from(v.x) + f64::from(v.y) + f64::from(v.z);
            let largest = |v: glam::Vec3| f64::from(v.max_element());
            [sum(difference), sum(s.value.abs()), largest(difference), largest(s.value)].map(|v| v * weight)
        })
        .collect();
    let sum = |i: usize| rows.iter().map(|row| row[i]).sum::<f64>();
    let most = |i: usize| rows.iter().map(|row| row[i]).fold(0.0, f64::max);
    let share = |a: f64, b: f64| if b > 0.0 { a / b } else { a };
    RoundTrip { samples: rows.len(), relative_error: share(sum(0), sum(1)), largest_error: share(most(2), most(3)) }
}
