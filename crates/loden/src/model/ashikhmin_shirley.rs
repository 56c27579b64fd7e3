//! An anisotropic power of the half vector's cosine over a diffuse base that fades at grazing angles.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::fresnel::schlick_weight;
use super::lobe::{half, reflect};
use super::{KD, MAX_TERMS, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};

/// # Model
/// f = f_d + f_s, f_d = 28 kd / (23 pi) (1 - ks) (1 - (1 - (n.wi)/2)^5) (1 - (1 - (n.wo)/2)^5),
/// f_s = sqrt((nu + 1)(nv + 1)) / (8 pi) (n.h)^e F / ((h.wi) max(n.wi, n.wo)),
/// e = (nu (h.x)^2 + nv (h.y)^2) / (1 - (n.h)^2), F = ks + (1 - ks) (1 - h.wi)^5.
///
/// # References
/// ashikhminshirley2000 (eq. 3-5 and the sampling of section 3)
pub(super) struct AshikhminShirleyModel;

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        /// Reflectance of the coat at normal incidence.
        ks: [f64; 3] [0.0..=1.0] = 0.2,
        /// Sharpness of the lobe along the tangent.
        nu: f64 [0.0..=100_000.0] = 60,
        /// Sharpness of the lobe along the bitangent.
        nv: f64 [0.0..=100_000.0] = 60,
    }
}

impl Model for AshikhminShirleyModel {
    fn name(&self) -> &'static str {
        "ashikhmin-shirley"
    }

    fn doc(&self) -> &'static str {
        "An anisotropic Phong lobe with Fresnel reflection over a diffuse base."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks"]
    }

    fn ties(&self) -> &'static [(&'static str, &'static str)] {
        &[("nv", "nu")]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let Options { nu, nv, .. } = Options::from_values(values)?;
        Ok(Box::new(AshikhminShirley { nu, nv }))
    }

    fn is_coated(&self) -> bool {
        true
    }

    fn coefficients(&self, colors: &[DVec3]) -> Terms {
        coated(colors)
    }

    fn colors_of(&self, factors: &Terms) -> Vec<DVec3> {
        uncoated(factors)
    }
}

/// The factors of a base kd under a coat ks: kd (1 - ks), ks, and 1 for what every coat reflects.
pub(super) fn coated(colors: &[DVec3]) -> Terms {
    let mut factors = [DVec3::ZERO; MAX_TERMS];
    factors[0] = colors[0] * (DVec3::ONE - colors[1]);
    factors[1] = colors[1];
    factors[2] = DVec3::ONE;
    factors
}

/// The inverse of [`coated`]; a coat that transmits nothing hides its base.
pub(super) fn uncoated(factors: &Terms) -> Vec<DVec3> {
    let ks = factors[1].clamp(DVec3::ZERO, DVec3::ONE);
    let open = (DVec3::ONE - ks).max(DVec3::splat(1e-9));
    vec![(factors[0] / open).clamp(DVec3::ZERO, DVec3::ONE), ks]
}

#[derive(Debug)]
struct AshikhminShirley {
    nu: f64,
    nv: f64,
}

impl AshikhminShirley {
    /// The density of half vectors: sqrt((nu + 1)(nv + 1)) / (2 pi) (n.h)^e.
    fn distribution(&self, wh: DVec3) -> f64 {
        let sin2 = wh.x * wh.x + wh.y * wh.y;
        let exponent = if sin2 > 0.0 { (self.nu * wh.x * wh.x + self.nv * wh.y * wh.y) / sin2 } else { 0.0 };
        ((self.nu + 1.0) * (self.nv + 1.0)).sqrt() / (2.0 * PI) * wh.z.powf(exponent)
    }
}

impl Shape for AshikhminShirley {
    fn count(&self) -> usize {
        3
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let mut terms = [DVec3::ZERO; MAX_TERMS];
        let open = |cosine: f64| 1.0 - (1.0 - 0.5 * cosine).powi(5);
        terms[0] = DVec3::splat(28.0 / (23.0 * PI) * open(wi.z) * open(wo.z));
        let wh = half(wi, wo);
        let cosine = wi.dot(wh);
        let lobe = self.distribution(wh) / (4.0 * cosine * wi.z.max(wo.z));
        let grazing = schlick_weight(cosine);
        terms[1] = DVec3::splat(lobe * (1.0 - grazing));
        terms[2] = DVec3::splat(lobe * grazing);
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        if term == 0 {
            return Some(diffuse_sample(random));
        }
        // the square roots map a uniform angle to the density over azimuths, in all quadrants at once
        let (sin, cos) = (2.0 * PI * random.x).sin_cos();
        let (x, y) = ((self.nv + 1.0).sqrt() * cos, (self.nu + 1.0).sqrt() * sin);
        let (x, y) = (x / x.hypot(y), y / x.hypot(y));
        let cosine = random.y.powf(1.0 / (self.nu * x * x + self.nv * y * y + 1.0));
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        reflect(wo, DVec3::new(sine * x, sine * y, cosine))
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        let wh = half(wi, wo);
        self.distribution(wh) / (4.0 * wo.dot(wh))
    }

    fn importance(&self, term: usize) -> f64 {
        // on average, the increase at grazing light is small
        if term == 2 { 0.05 } else { 1.0 }
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: true, isotropic: self.nu == self.nv }
    }
}
