//! Shared by microfacet models: distributions of facet normals, shadowing, sampling.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

/// Facet slopes with one roughness along the tangent and one along the bitangent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roughness {
    /// Along the tangent.
    pub x: f64,
    /// Along the bitangent.
    pub y: f64,
}

impl Roughness {
    /// tan^2 of the polar angle of `w`, each axis divided by its roughness.
    fn scaled_tan2(self, w: DVec3) -> f64 {
        ((w.x / self.x).powi(2) + (w.y / self.y).powi(2)) / (w.z * w.z)
    }

    /// tan^2 of the polar angle of `w`, each axis multiplied by its roughness: (alpha tan)^2.
    fn alpha_tan2(self, w: DVec3) -> f64 {
        ((w.x * self.x).powi(2) + (w.y * self.y).powi(2)) / (w.z * w.z)
    }
}

/// exp(-x) for x >= 0; zero where the result would be subnormal, which math libraries compute slowly.
pub(super) fn decay(x: f64) -> f64 {
    if x < 708.0 { (-x).exp() } else { 0.0 }
}

/// Beckmann's distribution: exp(-tan^2) / (pi ax ay cos^4), normalised so that its projected area is 1.
///
/// # References
/// cook1982, walter2007 (eq. 25)
pub fn beckmann(wh: DVec3, r: Roughness) -> f64 {
    if wh.z <= 0.0 {
        return 0.0;
    }
    decay(r.scaled_tan2(wh)) / (PI * r.x * r.y * wh.z.powi(4))
}

/// Draws a facet normal with density D cos of [`beckmann`].
///
/// # References
/// walter2007 (eq. 28, 29)
pub fn beckmann_sample(r: Roughness, random: DVec2) -> DVec3 {
    // 1 - u is never 0
    let tan = (-(1.0 - random.x).ln()).sqrt();
    let (sin, cos) = (2.0 * PI * random.y).sin_cos();
    DVec3::new(r.x * tan * cos, r.y * tan * sin, 1.0).normalize()
}

/// Smith's shadowing of one direction for [`beckmann`], as a rational function.
///
/// # References
/// walter2007 (eq. 27)
pub fn beckmann_g1(w: DVec3, r: Roughness) -> f64 {
    let a = r.alpha_tan2(w).sqrt().recip();
    if a >= 1.6 { 1.0 } else { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) }
}

/// The GGX distribution: 1 / (pi ax ay cos^4 (1 + tan^2)^2).
///
/// # References
/// walter2007 (eq. 33), burley2012 (anisotropic form)
pub fn ggx(wh: DVec3, r: Roughness) -> f64 {
    if wh.z <= 0.0 {
        return 0.0;
    }
    let d = (wh.x / r.x).powi(2) + (wh.y / r.y).powi(2) + wh.z * wh.z;
    1.0 / (PI * r.x * r.y * d * d)
}

/// Smith's Lambda for [`ggx`]: shadowing of one direction is 1 / (1 + Lambda).
///
/// # References
/// walter2007 (eq. 34), heitz2014 (eq. 72)
pub fn ggx_lambda(w: DVec3, r: Roughness) -> f64 {
    0.5 * ((1.0 + r.alpha_tan2(w)).sqrt() - 1.0)
}

/// Draws a facet normal of [`ggx`] visible from `wo`, with density G1 D (wh.wo) / (n.wo).
///
/// # References
/// dupuy2023 (listing 3)
pub fn ggx_visible_sample(wo: DVec3, r: Roughness, random: DVec2) -> DVec3 {
    let stretched = DVec3::new(wo.x * r.x, wo.y * r.y, wo.z).normalize();
    let (sin, cos) = (2.0 * PI * random.x).sin_cos();
    let z = (1.0 - random.y) * (1.0 + stretched.z) - stretched.z;
    let radius = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let wh = DVec3::new(radius * cos, radius * sin, z) + stretched;
    DVec3::new(wh.x * r.x, wh.y * r.y, wh.z.max(0.0)).normalize()
}

/// Shadowing and masking by V-shaped grooves.
///
/// # References
/// cook1982 (eq. for G), torrance1967
pub fn grooves(wi: DVec3, wo: DVec3, wh: DVec3) -> f64 {
    (2.0 * wh.z * wi.z.min(wo.z) / wo.dot(wh)).min(1.0)
}
