//! The highlight of a row on a relief, where each view sees other normals.
//!
//! # Model
//! Parallax moves the points of a relief from texel to texel as the view changes, and slopes hide each other. So every view has a normal of
//! its own: the one that explains the diffuse part of the view under all lights, by weighted least squares with that of the
//! row as a prior. Lights that do not reach the texel count little. The fraction of the light that does is what the diffuse part is of the shading by
//! that normal. One roughness and one strength about these normals, times that fraction, fit the highlights of the row.
//!
//! A change of both changes what was measured s as it changes the fitted highlight from m to n: by the factor n / m as far as there was a
//! highlight, by the sum n - m as far as there was none. Their weights are m and n.
//!
//! # Limits
//! A view still sees several normals at once, which widen the highlight like roughness does.
//!
//! # References
//! woodham1980

use glam::{Mat3, Vec3};

use super::reflectance::{Geometry, Reflectance, Separated, search};
use crate::color::luminance;

/// Weight of the normal of the row, relative to that of all lights of a view.
const PRIOR: f32 = 0.004;

/// Rounds in which the lights that reach a texel are chosen.
const ROUNDS: usize = 3;

/// Weight of a light that does not reach the texel.
const DARK: f32 = 0.02;

/// Least cosine between a normal and the vertical.
const MIN_HEIGHT: f32 = 0.2;

/// Highlights that are as good as none.
const FLOOR: f32 = 1e-3;

/// The largest factor of a measured highlight.
const MAX_FACTOR: f32 = 10.0;

/// What each view sees of a row.
pub(super) struct Facets {
    /// The fit of the row, with the strength and roughness of its highlight about the normals of the views.
    pub fit: Reflectance,
    normals: Vec<Vec3>,
    /// The fraction of the light that reaches each pair.
    lit: Vec<f32>,
}

impl Facets {
    /// Finds the normals of the views, and fits the highlight.
    pub(super) fn new(geometry: &Geometry, row: &Separated) -> Self {
        let albedo = luminance(row.fit.albedo.to_array()).max(1e-4);
        let (mut normals, mut lit) = (Vec::new(), Vec::new());
        for view in row.diffuse.chunks_exact(geometry.lights().len()) {
            let shading: Vec<f32> = view.iter().map(|value| luminance(value.to_array()) / albedo).collect();
            let slope = slope(geometry.lights(), &shading, row.fit.normal);
            let (level, normal) = (slope.length(), slope.normalize());
            let normal = normal.with_z(normal.z.max(MIN_HEIGHT)).normalize();
            let reached = |(wi, shading): (&Vec3, &f32)| {
                (shading / (level * normal.dot(*wi).max(0.02)).max(FLOOR)).clamp(0.0, 1.0)
            };
            lit.extend(geometry.lights().iter().zip(&shading).map(reached));
            normals.push(normal);
        }
        let mut facets = Self { fit: row.fit, normals, lit };
        let rest = row.fit.rest(geometry, &row.values());
        (facets.fit.alpha, facets.fit.strength) = search(|alpha| facets.highlight(geometry, alpha), &rest);
        facets
    }

    /// The highlight of strength 1 in all pairs.
    fn highlight(&self, geometry: &Geometry, alpha: f32) -> Vec<f32> {
        let mut highlight = geometry.highlights(alpha, |view| self.normals[view]);
        highlight.iter_mut().zip(&self.lit).for_each(|(value, lit)| *value *= lit);
        highlight
    }

    /// Measured highlights with another strength and roughness.
    pub(super) fn changed(&self, geometry: &Geometry, specular: &[f32], strength: f32, alpha: f32) -> Vec<f32> {
        if (strength, alpha) == (self.fit.strength, self.fit.alpha) {
            return specular.to_vec();
        }
        let old = self.highlight(geometry, self.fit.alpha);
        let new = self.highlight(geometry, alpha);
        let value = |((measured, old), new): ((&f32, &f32), &f32)| {
            let (old, new) = (self.fit.strength * old, strength * new);
            let scaled = measured * ((new + FLOOR) / (old + FLOOR)).min(MAX_FACTOR);
            let added = (measured + new - old).max(0.0);
            added + (scaled - added) * old / (old + new).max(f32::MIN_POSITIVE)
        };
        specular.iter().zip(&old).zip(&new).map(value).collect()
    }
}

/// The normal that explains how bright a view is under all lights, times its albedo relative to that of the row.
fn slope(lights: &[Vec3], shading: &[f32], normal: Vec3) -> Vec3 {
    let prior = PRIOR * lights.len() as f32;
    let mut weights = vec![1.0; lights.len()];
    let mut slope = normal;
    for _ in 0..ROUNDS {
        let (mut matrix, mut vector) = (Mat3::from_diagonal(Vec3::splat(prior)), normal * prior);
        for ((wi, value), weight) in lights.iter().zip(shading).zip(&weights) {
            let weighted = *wi * *weight;
            matrix += Mat3::from_cols(weighted * wi.x, weighted * wi.y, weighted * wi.z);
            vector += weighted * *value;
        }
        slope = matrix.inverse() * vector;
        for ((wi, value), weight) in lights.iter().zip(shading).zip(&mut weights) {
            let expected = slope.dot(*wi);
            *weight = if expected > 0.02 && *value > 0.5 * expected { 1.0 } else { DARK };
        }
    }
    if slope.length() > 1e-6 { slope } else { normal * 1e-6 }
}
