//! How far a material is from the samples it was made of.

use glam::Vec2;
use rayon::prelude::*;
use serde::Serialize;

use crate::material::{BrdfSample, Material};

/// More samples than this are thinned out evenly.
const MOST: usize = 50_000;

/// The difference of a BRDF from samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RoundTrip {
    /// How many samples were compared.
    pub samples: usize,
    /// Sum of the absolute differences over the sum of the values, each times both cosines.
    pub relative_error: f64,
    /// The largest difference times both cosines over the largest value times both cosines.
    pub largest_error: f64,
}

/// Evaluates `material` at the directions of `samples`.
pub fn round_trip(samples: &[BrdfSample], material: &dyn Material) -> RoundTrip {
    let step = samples.len().div_ceil(MOST).max(1);
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
