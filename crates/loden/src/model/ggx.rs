//! Mirror facets with GGX slopes.

use std::f32::consts::PI;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::fresnel::{Fresnel, Interface};
use super::lambert::diffuse_term;
use super::lobe::{half, reflect};
use super::microfacet::{Roughness, ggx, ggx_lambda, ggx_visible_sample};
use super::{KD, KS, MAX_TERMS, Model, Shape, Terms};
use crate::Result;
use crate::direction::{cosine_hemisphere, sin_cos_turns};
use crate::material::plain::{Plain, PlainPoints};
use crate::material::{Bounce, Material, Point, Prepared, Promises, Sample};
use crate::params::{Param, Params, Values};

/// # Model
/// f = kd/pi + ks F D G / (4 (n.wi) (n.wo)) with the anisotropic GGX distribution, F exact for the index n + ik,
/// G = 1 / (1 + L(wi) + L(wo)) (heights correlated) or 1 / ((1 + L(wi)) (1 + L(wo))) (separable). Sampled by the
/// normals that `wo` sees.
///
/// # Limits
/// Multiple scattering between facets is ignored.
///
/// # References
/// walter2007 (eq. 20, 33, 34), heitz2014 (eq. 72, 99), dupuy2023 (sampling), burley2012 (anisotropic form)
pub(super) struct GgxModel;

crate::words! {
    enum Shadowing { Correlated = "correlated", Separable = "separable" }
}

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        ks: [f64; 3] => KS,
        /// Roughness along the tangent.
        alpha_x: f64 [0.001..=2.0] = 0.25,
        /// Roughness along the bitangent.
        alpha_y: f64 [0.001..=2.0] = 0.25,
        interface: Interface,
        /// Whether shadowing and masking are correlated.
        shadowing: Shadowing = "correlated",
    }
}

impl Model for GgxModel {
    fn name(&self) -> &'static str {
        "ggx"
    }

    fn doc(&self) -> &'static str {
        "Mirror facets with GGX slopes and Smith's shadowing, anisotropic."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks"]
    }

    fn ties(&self) -> &'static [(&'static str, &'static str)] {
        &[("alpha-y", "alpha-x")]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let Options { alpha_x, alpha_y, interface, shadowing, .. } = Options::from_values(values)?;
        let separable = shadowing == Shadowing::Separable;
        Ok(Box::new(Ggx { roughness: Roughness { x: alpha_x, y: alpha_y }, fresnel: interface.fresnel(), separable }))
    }
}

#[derive(Debug)]
struct Ggx {
    roughness: Roughness,
    fresnel: Fresnel,
    separable: bool,
}

impl Shape for Ggx {
    fn count(&self) -> usize {
        2
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let mut terms = diffuse_term();
        let wh = half(wi, wo);
        let (li, lo) = (ggx_lambda(wi, self.roughness), ggx_lambda(wo, self.roughness));
        let g = if self.separable { 1.0 / ((1.0 + li) * (1.0 + lo)) } else { 1.0 / (1.0 + li + lo) };
        terms[1] = self.fresnel.reflectance(wo.dot(wh)) * (ggx(wh, self.roughness) * g / (4.0 * wi.z * wo.z));
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        if term == 0 {
            return Some(diffuse_sample(random));
        }
        reflect(wo, ggx_visible_sample(wo, self.roughness, random))
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        // G1 D (h.wo) / (n.wo), over the Jacobian 4 (h.wo)
        ggx(half(wi, wo), self.roughness) / (4.0 * wo.z * (1.0 + ggx_lambda(wo, self.roughness)))
    }

    fn single(&self, factors: &Terms, shares: &[f64; MAX_TERMS]) -> Option<Box<dyn Material>> {
        Some(Box::new(Single {
            kd: factors[0].as_vec3(),
            ks: factors[1].as_vec3(),
            alpha: DVec2::new(self.roughness.x, self.roughness.y).as_vec2(),
            fresnel: self.fresnel,
            separable: self.separable,
            diffuse_share: shares[0] as f32,
        }))
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: true, isotropic: self.roughness.x == self.roughness.y }
    }
}

/// [`Ggx`] and its diffuse part in single precision.
#[derive(Debug, Clone, Copy)]
struct Single {
    kd: Vec3,
    ks: Vec3,
    /// Roughness along tangent and bitangent.
    alpha: Vec2,
    fresnel: Fresnel,
    separable: bool,
    /// Fraction of the samples drawn from the diffuse term.
    diffuse_share: f32,
}

impl Single {
    /// The apparent value and the sampling density; 0 below the surface.
    #[inline(always)]
    fn value_and_pdf(&self, wi: Vec3, wo: Vec3) -> (Vec3, f32) {
        let half = (wi + wo).normalize_or_zero();
        let slope = Vec2::new(half.x, half.y) / self.alpha;
        let d = slope.length_squared() + half.z * half.z;
        let facets = 1.0 / (PI * self.alpha.x * self.alpha.y * d * d);
        let lambda = |w: Vec3| {
            let slope = Vec2::new(w.x, w.y) * self.alpha / w.z;
            0.5 * ((1.0 + slope.length_squared()).sqrt() - 1.0)
        };
        let (li, lo) = (lambda(wi), lambda(wo));
        let shadows = if self.separable { (1.0 + li) * (1.0 + lo) } else { 1.0 + li + lo };
        let mirrored = self.fresnel.reflectance_single(wo.dot(half)) * (facets * PI / (4.0 * wo.z * shadows));
        let value = (self.kd * wi.z + self.ks * mirrored).max(Vec3::ZERO);
        // G1 D (h.wo) / (n.wo), over the Jacobian 4 (h.wo)
        let drawn = facets / (4.0 * wo.z * (1.0 + lo));
        let pdf = self.diffuse_share * wi.z / PI + (1.0 - self.diffuse_share) * drawn;
        // This form of the condition also rejects NaN
        if wi.z > 0.0 && wo.z > 0.0 { (value, pdf) } else { (Vec3::ZERO, 0.0) }
    }

    /// `wo` reflected at a visible facet: [`ggx_visible_sample`].
    #[inline(always)]
    fn mirrored(&self, wo: Vec3, random: Vec2) -> Vec3 {
        let stretched = Vec3::new(wo.x * self.alpha.x, wo.y * self.alpha.y, wo.z).normalize_or_zero();
        let (sin, cos) = sin_cos_turns(random.x);
        // 1 - z of the cap, without cancellation
        let below = random.y * (1.0 + stretched.z);
        let radius = (below * (2.0 - below)).max(0.0).sqrt();
        let half = Vec3::new(radius * cos, radius * sin, 1.0 - below) + stretched;
        let half = Vec3::new(half.x * self.alpha.x, half.y * self.alpha.y, half.z.max(0.0)).normalize_or_zero();
        2.0 * wo.dot(half) * half - wo
    }
}

impl Plain for Single {
    #[inline(always)]
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3 {
        self.value_and_pdf(wi, wo).0
    }

    #[inline(always)]
    fn draw(&self, wo: Vec3, random: Vec2) -> Bounce {
        let is_diffuse = random.x < self.diffuse_share;
        let (from, share) =
            if is_diffuse { (0.0, self.diffuse_share) } else { (self.diffuse_share, 1.0 - self.diffuse_share) };
        let random = Vec2::new(((random.x - from) / share).min(1.0f32.next_down()), random.y);
        let mirrored = self.mirrored(wo, random);
        let diffuse = cosine_hemisphere(random);
        let wi = if is_diffuse { diffuse } else { mirrored };
        let (value, pdf) = self.value_and_pdf(wi, wo);
        Bounce { wi, pdf: if pdf < f32::INFINITY { pdf } else { 0.0 }, value }
    }

    #[inline(always)]
    fn density(&self, wi: Vec3, wo: Vec3) -> f32 {
        self.value_and_pdf(wi, wo).1
    }
}

impl Material for Single {
    fn apparent(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.value(wi, wo)
    }

    fn sample(&self, _uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        let Bounce { wi, pdf, .. } = self.draw(wo, random);
        (pdf > 0.0).then_some(Sample { wi, pdf })
    }

    fn pdf(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.density(wi, wo)
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        Box::new(PlainPoints { material: self, points })
    }
}
