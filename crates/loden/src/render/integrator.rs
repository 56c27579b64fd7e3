//! Path tracing.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::Ray;
use super::environment::{Environment, EnvironmentMap};
use super::sampler::Sampler;
use super::scene::{Body, Scene, Shading};
use crate::Error;

/// From which segment on Russian roulette may end a path.
const ROULETTE_FROM: u32 = 4;

/// A material's value that is not finite, and where.
#[derive(Debug, Clone)]
pub(super) struct Fault {
    material: String,
    uv: Vec2,
    wi: Vec3,
    wo: Vec3,
    value: Vec3,
}

impl From<Box<Fault>> for Error {
    fn from(fault: Box<Fault>) -> Self {
        let Fault { material, uv, wi, wo, value } = *fault;
        let problem = format!("its value is {value} at uv {uv}, wi {wi}, wo {wo} (local frame)");
        Self::parameter(format!("material {material}"), problem)
    }
}

/// The radiance that arrives along one camera ray.
///
/// # Model
/// The rendering equation is estimated by one path of at most `depth` segments, camera ray included. At every
/// surface each directional light is connected to; an environment map is connected to as well, and combined
/// with the direction the material draws by multiple importance sampling (power heuristic); a constant sky is
/// met by the material's directions alone. From the fourth segment on, paths end with a probability given by
/// their throughput, without bias.
///
/// # Limits
/// Directional lights are met by connection only, so a perfect mirror does not show them. Negative material
/// values count as 0.
///
/// # References
/// kajiya1986, veach1997 sections 9.2 and 10.2
#[inline]
pub(super) fn radiance(scene: &Scene, mut ray: Ray, depth: u32, sampler: &mut Sampler) -> Result<Vec3, Box<Fault>> {
    let mut sum = Vec3::ZERO;
    let mut throughput = Vec3::ONE;
    // the density with which the material drew the ray; none for the camera's
    let mut drawn = None;
    for segment in 1..=depth {
        let Some((body, hit)) = scene.closest(&ray) else {
            sum += throughput * escaped(&scene.environment, ray.direction, drawn);
            break;
        };
        if segment == depth {
            break;
        }
        let body = &scene.bodies[body];
        let point = Point { scene, body, shading: body.texture.shading(&hit, -ray.direction) };
        sum += throughput * point.lit_by_lights(sampler)?;
        if let Environment::Map(map) = &scene.environment {
            sum += throughput * point.lit_by_map(map, sampler)?;
        }
        let Shading { uv, frame, wo, origin } = &point.shading;
        let Some(sample) = body.material.sample(*uv, *wo, sampler.next_2d()) else { break };
        if sample.pdf.is_nan() || sample.pdf <= 0.0 {
            break;
        }
        throughput *= point.apparent(sample.wi)? / (PI * sample.pdf);
        if segment >= ROULETTE_FROM {
            let survival = throughput.max_element().min(0.95);
            if sampler.next_1d() >= survival {
                break;
            }
            throughput /= survival;
        }
        if throughput == Vec3::ZERO {
            break;
        }
        drawn = Some(sample.pdf);
        ray = Ray { origin: *origin, direction: frame.world(sample.wi).normalize() };
    }
    Ok(sum)
}

/// What the environment adds to a path that left the scene.
#[inline]
fn escaped(environment: &Environment, direction: Vec3, drawn: Option<f32>) -> Vec3 {
    let weight = match (environment, drawn) {
        (Environment::Map(map), Some(pdf)) => power_heuristic(pdf, map.pdf(direction)),
        _ => 1.0,
    };
    environment.radiance(direction) * weight
}

/// The weight of a sample drawn with density `a` that could have been drawn with density `b` too.
#[inline]
fn power_heuristic(a: f32, b: f32) -> f32 {
    // by the ratio, so that squares cannot overflow
    let ratio = b / a;
    1.0 / (1.0 + ratio * ratio)
}

/// A surface point on a path.
struct Point<'a> {
    scene: &'a Scene<'a>,
    body: &'a Body<'a>,
    shading: Shading,
}

impl Point<'_> {
    /// The material's apparent value, checked.
    #[inline]
    fn apparent(&self, wi: Vec3) -> Result<Vec3, Box<Fault>> {
        let Shading { uv, wo, .. } = self.shading;
        let value = self.body.material.apparent(uv, wi, wo);
        if value.is_finite() {
            return Ok(value.max(Vec3::ZERO));
        }
        Err(Box::new(Fault { material: self.body.material_name.clone(), uv, wi, wo, value }))
    }

    #[inline]
    fn sees(&self, direction: Vec3) -> bool {
        !self.scene.occluded(&Ray { origin: self.shading.origin, direction })
    }

    /// Light from the directional lights.
    #[inline]
    fn lit_by_lights(&self, sampler: &mut Sampler) -> Result<Vec3, Box<Fault>> {
        let mut sum = Vec3::ZERO;
        for light in &self.scene.lights {
            let direction = if light.radius_degrees > 0.0 { light.sample(sampler.next_2d()) } else { light.direction };
            let wi = self.shading.frame.local(direction);
            if wi.z <= 0.0 {
                continue;
            }
            let value = self.apparent(wi)? * light.irradiance * (1.0 / PI);
            if value != Vec3::ZERO && self.sees(direction) {
                sum += value;
            }
        }
        Ok(sum)
    }

    /// Light from one direction drawn from an environment map.
    #[inline]
    fn lit_by_map(&self, map: &EnvironmentMap, sampler: &mut Sampler) -> Result<Vec3, Box<Fault>> {
        let Some((direction, pdf)) = map.sample(sampler.next_2d()) else { return Ok(Vec3::ZERO) };
        let Shading { uv, frame, wo, .. } = &self.shading;
        let wi = frame.local(direction);
        if wi.z <= 0.0 || pdf <= 0.0 {
            return Ok(Vec3::ZERO);
        }
        let value = self.apparent(wi)?;
        if value == Vec3::ZERO || !self.sees(direction) {
            return Ok(Vec3::ZERO);
        }
        let weight = power_heuristic(pdf, self.body.material.pdf(*uv, wi, *wo));
        Ok(value * map.radiance(direction) * (weight / (PI * pdf)))
    }
}
