//! Rational functions in place of the exponentials of microfacet models.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::ashikhmin_shirley::{coated, uncoated};
use super::fresnel::schlick_weight;
use super::lobe::{half, reflect};
use super::{KD, MAX_TERMS, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};

/// # Model
/// With t = n.h, u = h.wi, w the cosine of the half vector's azimuth, v and v' the cosines of light and view:
/// S = ks + (1 - ks) (1 - u)^5, f = S D + (1 - S) kd/pi, D = G(v) G(v') Z A / (4 pi v v') + (1 - G(v) G(v')) / pi,
/// Z = r / (1 + r t^2 - t^2)^2, A = sqrt(p / (p^2 - p^2 w^2 + w^2)), G(v) = v / (r - r v + v).
/// p = 1 is isotropic.
///
/// # Limits
/// The paper's `a`, `b`, `c` split, which turns part of a smooth surface into a perfect mirror, is left out because a
/// mirror has no value for a pair of directions. A is not normalised, so anisotropic surfaces darken. At grazing
/// light a bright base and its coat together reflect a few per cent too much (1.03 at 85 degrees for kd 0.8).
///
/// # References
/// schlick1994 (eq. 15, 19, 22-24, 28)
pub(super) struct SchlickModel;

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        /// Reflectance of the facets at normal incidence.
        ks: [f64; 3] [0.0..=1.0] = 0.2,
        /// Roughness: 0 is a mirror, 1 is diffuse.
        roughness: f64 [0.0001..=1.0] = 0.1,
        /// Isotropy: 0 is anisotropic along the tangent, 1 is isotropic.
        isotropy: f64 [0.01..=1.0] = 1,
    }
}

impl Model for SchlickModel {
    fn name(&self) -> &'static str {
        "schlick"
    }

    fn doc(&self) -> &'static str {
        "Rational functions in place of the exponentials of microfacet models."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks"]
    }

    fn ties(&self) -> &'static [(&'static str, &'static str)] {
        &[("isotropy", "")]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let Options { roughness: r, isotropy: p, .. } = Options::from_values(values)?;
        Ok(Box::new(Schlick { r, p }))
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

#[derive(Debug)]
struct Schlick {
    r: f64,
    p: f64,
}

impl Schlick {
    fn z(&self, wh: DVec3) -> f64 {
        self.r / (1.0 + (self.r - 1.0) * wh.z * wh.z).powi(2)
    }

    /// p^2 - p^2 w^2 + w^2.
    fn ellipse(&self, wh: DVec3) -> f64 {
        let sin2 = wh.x * wh.x + wh.y * wh.y;
        let w2 = if sin2 > 0.0 { wh.x * wh.x / sin2 } else { 1.0 };
        let p2 = self.p * self.p;
        p2 - p2 * w2 + w2
    }

    fn g(&self, v: f64) -> f64 {
        v / (self.r - self.r * v + v)
    }
}

impl Shape for Schlick {
    fn count(&self) -> usize {
        3
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let wh = half(wi, wo);
        let g = self.g(wi.z) * self.g(wo.z);
        let a = (self.p / self.ellipse(wh)).sqrt();
        let d = g * self.z(wh) * a / (4.0 * PI * wi.z * wo.z) + (1.0 - g) / PI;
        let grazing = schlick_weight(wi.dot(wh));
        let mut terms = [DVec3::ZERO; MAX_TERMS];
        terms[0] = DVec3::splat((1.0 - grazing) / PI);
        terms[1] = DVec3::splat(d * (1.0 - grazing));
        terms[2] = DVec3::splat(d * grazing);
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        if term == 0 {
            return Some(diffuse_sample(random));
        }
        let cosine = ((1.0 - random.x) / (1.0 + (self.r - 1.0) * random.x)).max(0.0).sqrt();
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        // an ellipse with half axes p and 1: density p / (2 pi (p^2 sin^2 + cos^2)), similar to the square of A
        let (sin, cos) = (2.0 * PI * random.y).sin_cos();
        let (x, y) = (self.p * cos, sin);
        reflect(wo, DVec3::new(sine * x / x.hypot(y), sine * y / x.hypot(y), cosine))
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        let wh = half(wi, wo);
        self.z(wh) * wh.z / PI * self.p / self.ellipse(wh) / (4.0 * wo.dot(wh))
    }

    fn importance(&self, term: usize) -> f64 {
        if term == 2 { 0.05 } else { 1.0 }
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: false, isotropic: self.p == 1.0 }
    }
}
