//! Diffuse reflection of a rough surface.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::{KD, MAX_TERMS, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};

/// # Model
/// f = kd/pi (A + B max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta)), alpha the larger and beta the smaller polar
/// angle, A = 1 - 0.5 s^2 / (s^2 + 0.33), B = 0.45 s^2 / (s^2 + 0.09), s the standard deviation of the slope angle.
///
/// # Limits
/// Interreflection between facets is ignored, as in the paper's qualitative model. For very rough surfaces A falls to
/// 0.5, so bright ones lose energy.
///
/// # References
/// oren1994 (eq. 30)
pub(super) struct OrenNayarModel;

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        /// Standard deviation of the facets' slope angle.
        sigma: f64 [0.0..=90.0, "degrees"] = 25,
    }
}

impl Model for OrenNayarModel {
    fn name(&self) -> &'static str {
        "oren-nayar"
    }

    fn doc(&self) -> &'static str {
        "Diffuse reflection of a rough surface, brighter when seen from the light."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd"]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let s2 = Options::from_values(values)?.sigma.to_radians().powi(2);
        Ok(Box::new(OrenNayar { a: 1.0 - 0.5 * s2 / (s2 + 0.33), b: 0.45 * s2 / (s2 + 0.09) }))
    }
}

#[derive(Debug)]
struct OrenNayar {
    a: f64,
    b: f64,
}

impl Shape for OrenNayar {
    fn count(&self) -> usize {
        1
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        // sin(alpha) sin(beta) cos(phi) is the product of the tangential parts; tan(beta) takes the larger cosine
        let along = wi.truncate().dot(wo.truncate()).max(0.0);
        let mut terms = [DVec3::ZERO; MAX_TERMS];
        terms[0] = DVec3::splat((self.a + self.b * along / wi.z.max(wo.z)) / PI);
        terms
    }

    fn sample(&self, _term: usize, _wo: DVec3, random: DVec2) -> Option<DVec3> {
        Some(diffuse_sample(random))
    }

    fn pdf(&self, _term: usize, wi: DVec3, _wo: DVec3) -> f64 {
        diffuse_pdf(wi)
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: true, isotropic: true }
    }
}
