//! Shared by models: cosine-power lobes about an axis, and reflection about a half vector.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

/// `w` mirrored about the normal.
pub(super) fn mirror(w: DVec3) -> DVec3 {
    DVec3::new(-w.x, -w.y, w.z)
}

/// The half vector of two directions above the surface.
pub(super) fn half(wi: DVec3, wo: DVec3) -> DVec3 {
    (wi + wo).normalize()
}

/// `wo` reflected by the facet `wh`; `None` if the facet faces away or the result is below the surface.
pub(super) fn reflect(wo: DVec3, wh: DVec3) -> Option<DVec3> {
    let cosine = wo.dot(wh);
    let wi = 2.0 * cosine * wh - wo;
    (cosine > 0.0 && wi.z > 0.0).then_some(wi)
}

/// Draws a direction about the unit vector `axis` with density (n + 1) / (2 pi) cos^n.
pub(super) fn power_sample(axis: DVec3, exponent: f64, random: DVec2) -> DVec3 {
    let cos = random.x.powf(1.0 / (exponent + 1.0));
    let (sin, phi) = ((1.0 - cos * cos).max(0.0).sqrt(), 2.0 * PI * random.y);
    let (tangent, bitangent) = axis.any_orthonormal_pair();
    sin * phi.cos() * tangent + sin * phi.sin() * bitangent + cos * axis
}

/// The density of [`power_sample`] for a direction with this cosine to the axis.
pub(super) fn power_pdf(cosine: f64, exponent: f64) -> f64 {
    if cosine > 0.0 { (exponent + 1.0) / (2.0 * PI) * cosine.powf(exponent) } else { 0.0 }
}
