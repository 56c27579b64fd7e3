//! A power of the cosine to the mirror direction.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::lambert::diffuse_term;
use super::lobe::{mirror, power_pdf, power_sample};
use super::{KD, KS, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};

/// # Model
/// R is wi mirrored about the normal. Normalised: f = kd/pi + ks (m + 2) / (2 pi) (R.wo)^m.
/// Original: f = kd/pi + ks (R.wo)^m / (n.wi).
///
/// # Limits
/// The original is not reciprocal and reflects more than it receives at grazing light.
///
/// # References
/// phong1975, lewis1993 (the normalised form). We divide the diffuse part by pi in both forms.
pub(super) struct PhongModel;

crate::words! {
    enum Form { Normalised = "normalised", Original = "original" }
}

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        ks: [f64; 3] => KS,
        /// Sharpness of the lobe.
        exponent: f64 [0.0..=100_000.0] = 40,
        /// Energy-conserving normalisation, or the formula as published.
        form: Form = "normalised",
    }
}

impl Model for PhongModel {
    fn name(&self) -> &'static str {
        "phong"
    }

    fn doc(&self) -> &'static str {
        "A power of the cosine to the mirror direction."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks"]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let Options { exponent, form, .. } = Options::from_values(values)?;
        Ok(Box::new(Phong { exponent, original: form == Form::Original }))
    }
}

#[derive(Debug)]
struct Phong {
    exponent: f64,
    original: bool,
}

impl Shape for Phong {
    fn count(&self) -> usize {
        2
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let mut terms = diffuse_term();
        let cosine = mirror(wi).dot(wo);
        if cosine > 0.0 {
            let factor = if self.original { 1.0 / wi.z } else { (self.exponent + 2.0) / (2.0 * PI) };
            terms[1] = DVec3::splat(factor * cosine.powf(self.exponent));
        }
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        Some(if term == 0 { diffuse_sample(random) } else { power_sample(mirror(wo), self.exponent, random) })
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 { diffuse_pdf(wi) } else { power_pdf(mirror(wo).dot(wi), self.exponent) }
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: !self.original, energy_conserving: !self.original, isotropic: true }
    }
}
