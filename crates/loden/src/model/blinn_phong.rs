//! A power of the cosine between half vector and normal.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::lambert::diffuse_term;
use super::lobe::{half, power_pdf, power_sample, reflect};
use super::{KD, KS, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};

/// # Model
/// Normalised: f = kd/pi + ks (m + 2)(m + 4) / (8 pi (2^(-m/2) + m)) (n.h)^m, whose lobe reflects exactly ks at
/// normal view. Original: f = kd/pi + ks (n.h)^m / (n.wi). An exponent of 4 m here looks like m in Phong's model.
///
/// # Limits
/// The original is not reciprocal and reflects more than it receives at grazing light.
///
/// # References
/// blinn1977, akeninemoller2008 (the normalised form, section 7.6). We divide the diffuse part by pi in both forms.
pub(super) struct BlinnPhongModel;

crate::words! {
    enum Form { Normalised = "normalised", Original = "original" }
}

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        ks: [f64; 3] => KS,
        /// Sharpness of the lobe.
        exponent: f64 [0.0..=100_000.0] = 160,
        /// Energy-conserving normalisation, or the formula as published.
        form: Form = "normalised",
    }
}

impl Model for BlinnPhongModel {
    fn name(&self) -> &'static str {
        "blinn-phong"
    }

    fn doc(&self) -> &'static str {
        "A power of the cosine between half vector and normal."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks"]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let Options { exponent: m, form, .. } = Options::from_values(values)?;
        let normalised = (m + 2.0) * (m + 4.0) / (8.0 * PI * ((-m / 2.0).exp2() + m));
        Ok(Box::new(BlinnPhong { exponent: m, factor: (form == Form::Normalised).then_some(normalised) }))
    }
}

#[derive(Debug)]
struct BlinnPhong {
    exponent: f64,
    /// Terms of the normalised form.
    factor: Option<f64>,
}

impl Shape for BlinnPhong {
    fn count(&self) -> usize {
        2
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let mut terms = diffuse_term();
        let factor = self.factor.unwrap_or(1.0 / wi.z);
        terms[1] = DVec3::splat(factor * half(wi, wo).z.powf(self.exponent));
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        if term == 0 {
            Some(diffuse_sample(random))
        } else {
            reflect(wo, power_sample(DVec3::Z, self.exponent, random))
        }
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        let wh = half(wi, wo);
        power_pdf(wh.z, self.exponent) / (4.0 * wo.dot(wh))
    }

    fn promises(&self) -> Promises {
        let normalised = self.factor.is_some();
        Promises { reciprocal: normalised, energy_conserving: normalised, isotropic: true }
    }
}
