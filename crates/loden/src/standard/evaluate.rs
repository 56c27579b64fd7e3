//! The apparent values of a texel for many pairs of directions.

use glam::{DVec2, DVec3};

use super::{BASE, COAT, COUNT, GRAIN, LOG_ALPHA, Layers, METALLIC, SHEEN, SLOPE, WEIGHT};

/// Mean albedo of the sheen, which the base loses.
const SHEEN_ALBEDO: f64 = 0.157;

/// Reflectance of the coat at normal incidence.
const COAT_F0: f64 = 0.04;

/// Least cosine of the viewer to the normal of a texel.
const LEAST_COSINE: f64 = 1e-3;

/// What all texels have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shared {
    /// Reflectance of the dielectric layer at normal incidence.
    pub f0: f64,
    /// Whether texels may be anisotropic.
    pub grain: bool,
    /// Half the power of the sine of the sheen, if there is one.
    pub sheen: Option<i32>,
    /// GGX roughness of the clear coat, if there is one.
    pub coat: Option<f64>,
}

/// A pair of directions, and what of its values does not depend on the texel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction {
    wi: DVec3,
    wo: DVec3,
    half: DVec3,
    /// (1 - h.v)^5
    edge: f64,
    /// The clear coat: its apparent value, and what it takes from the layers below.
    coat: [f64; 2],
}

impl Direction {
    pub(super) fn new(wi: DVec3, wo: DVec3, shared: &Shared) -> Self {
        let half = (wi + wo).normalize_or(DVec3::Z);
        let edge = power5(1.0 - wo.dot(half).clamp(0.0, 1.0));
        let coat = shared.coat.map_or([0.0; 2], |alpha| {
            let facets = facets(wi, wo, half, alpha * alpha, DVec2::ZERO);
            let fresnel = |edge: f64| COAT_F0 + (1.0 - COAT_F0) * edge;
            [fresnel(edge) * facets, fresnel(power5(1.0 - wo.z.clamp(0.0, 1.0)))]
        });
        Self { wi, wo, half, edge, coat }
    }
}

fn power5(x: f64) -> f64 {
    let square = x * x;
    square * square * x
}

/// pi D V n.l of GGX facets, for directions about their normal. The matrix of the roughness is alpha exp [[x, y], [y, -x]], where
/// (x, y) is the grain.
#[inline(always)]
fn facets(wi: DVec3, wo: DVec3, half: DVec3, alpha2: f64, grain: DVec2) -> f64 {
    let (even, odd) = if grain == DVec2::ZERO {
        (1.0, DVec2::ZERO)
    } else {
        let strength = grain.length();
        ((2.0 * strength).cosh(), grain * ((2.0 * strength).sinh() / strength))
    };
    facets_of(wi, wo, half, alpha2, even, odd)
}

/// [`facets`] with the hyperbolic functions of the grain.
#[inline(always)]
fn facets_of(wi: DVec3, wo: DVec3, half: DVec3, alpha2: f64, even: f64, odd: DVec2) -> f64 {
    let form = |w: DVec3, sign: f64| {
        even * (w.x * w.x + w.y * w.y) + sign * (odd.x * (w.x * w.x - w.y * w.y) + 2.0 * odd.y * w.x * w.y)
    };
    let slopes = form(half, -1.0) / alpha2 + half.z * half.z;
    let root = |w: DVec3| (alpha2 * form(w, 1.0) + w.z * w.z).sqrt();
    let seen = 2.0 * (wi.z * root(wo) + wo.z * root(wi));
    wi.z / (alpha2 * slopes * slopes * seen).max(1e-12)
}

/// The parts of values that depend on normal and roughness: diffuse, mirrored, and sheen, times the cosine of the light.
pub(super) type Shapes = Vec<[f64; 3]>;

impl Shared {
    /// In the terms of renderers.
    pub(super) fn layers(&self) -> Layers {
        Layers {
            f0: self.f0 as f32,
            grain: self.grain,
            // the power of the sine is 1 / alpha
            sheen: self.sheen.map(|power| (0.5 / f64::from(power)).sqrt() as f32),
            coat: self.coat.map(|alpha| alpha.sqrt() as f32),
        }
    }

    /// The shapes of a texel in all pairs.
    pub(super) fn shapes(&self, pairs: &[Direction], numbers: &[f64; COUNT]) -> Shapes {
        let normal = DVec3::new(numbers[SLOPE], numbers[SLOPE + 1], 1.0).normalize();
        let tangent = (DVec3::X - normal * normal.x).normalize();
        let bitangent = normal.cross(tangent);
        let alpha2 = (2.0 * numbers[LOG_ALPHA]).exp();
        let grain = DVec2::new(numbers[GRAIN], numbers[GRAIN + 1]);
        let strength = grain.length().max(1e-9);
        let (even, odd) = ((2.0 * strength).cosh(), grain * ((2.0 * strength).sinh() / strength));
        let local = |w: DVec3| DVec3::new(w.dot(tangent), w.dot(bitangent), w.dot(normal));
        let one = |pair: &Direction| {
            let (mut wi, mut wo, half) = (local(pair.wi), local(pair.wo), local(pair.half));
            (wi.z, wo.z) = (wi.z.max(0.0), wo.z.max(LEAST_COSINE));
            let mirrored = facets_of(wi, wo, half, alpha2, even, odd);
            let sheen = self.sheen.map_or(0.0, |power| {
                let lobe = (1.0 - half.z * half.z).max(0.0).powi(power) * f64::from(power + 1);
                lobe * wi.z / (4.0 * (wi.z + wo.z - wi.z * wo.z))
            });
            [wi.z, mirrored, sheen]
        };
        pairs.iter().map(one).collect()
    }

    /// The apparent values of a texel: (pair, channel).
    pub(super) fn values(&self, shapes: &Shapes, pairs: &[Direction], numbers: &[f64; COUNT]) -> Vec<f64> {
        let (metallic, weight, coat) = (numbers[METALLIC], numbers[WEIGHT], numbers[COAT]);
        let kept = 1.0 - SHEEN_ALBEDO * numbers[SHEEN].max(numbers[SHEEN + 1]).max(numbers[SHEEN + 2]);
        let mut values = Vec::with_capacity(3 * shapes.len());
        for ([diffuse, mirrored, sheen], pair) in shapes.iter().zip(pairs) {
            let layer = weight * (self.f0 + (1.0 - self.f0) * pair.edge);
            let below = (1.0 - metallic) * (1.0 - layer) * diffuse + metallic * (1.0 - pair.edge) * mirrored;
            let white = ((1.0 - metallic) * layer + metallic * pair.edge) * mirrored;
            let through = 1.0 - coat * pair.coat[1];
            for c in 0..3 {
                let uncoated = kept * (numbers[BASE + c] * below + white) + numbers[SHEEN + c] * sheen;
                values.push(through * uncoated + coat * pair.coat[0]);
            }
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::model::{Analytic, by_name};
    use crate::params::Values;

    fn shared() -> Shared {
        Shared { f0: 0.04, grain: true, sheen: Some(2), coat: Some(0.1) }
    }

    #[test]
    fn facets_are_those_of_the_ggx_model() {
        let model = by_name("ggx").unwrap();
        let given = [("kd", "0"), ("ks", "1"), ("alpha-x", "0.4"), ("alpha-y", "0.2"), ("metal", "mirror")];
        let ggx = Analytic::new(model, Values::new(model.params(), given).unwrap()).unwrap();
        let (wi, wo) = (DVec3::new(0.3, 0.2, 0.8).normalize(), DVec3::new(-0.5, 0.1, 0.6).normalize());
        let grain = DVec2::new(0.5 * 2.0f64.ln(), 0.0);
        let found = facets(wi, wo, (wi + wo).normalize(), 0.08, grain);
        let expected = PI * wi.z * ggx.brdf(wi, wo).x;
        assert!((found - expected).abs() < 1e-9 * expected, "{found} {expected}");
    }

    #[test]
    fn no_texel_reflects_more_than_it_receives() {
        let shared = shared();
        let mut numbers = [0.0; COUNT];
        numbers[..6].copy_from_slice(&[1.0, 1.0, 1.0, 0.3, 1.0, -1.0]);
        (numbers[SHEEN], numbers[COAT]) = (0.5, 1.0);
        let wo = DVec3::new(0.6, 0.0, 0.8);
        let (rings, sectors) = (64, 64);
        let pairs: Vec<Direction> = (0..rings * sectors)
            .map(|k| {
                // evenly spread over the disk below the hemisphere
                let (z2, phi) = ((k / sectors) as f64 + 0.5, (k % sectors) as f64 * 2.0 * PI / f64::from(sectors));
                let r2 = z2 / f64::from(rings);
                let wi = DVec3::new(r2.sqrt() * phi.cos(), r2.sqrt() * phi.sin(), (1.0 - r2).sqrt());
                Direction::new(wi, wo, &shared)
            })
            .collect();
        let values = shared.values(&shared.shapes(&pairs, &numbers), &pairs, &numbers);
        let albedo: f64 = values.iter().step_by(3).zip(&pairs).map(|(value, pair)| value / pair.wi.z).sum::<f64>();
        let albedo = albedo / pairs.len() as f64;
        assert!((0.5..1.02).contains(&albedo), "{albedo}");
    }
}
