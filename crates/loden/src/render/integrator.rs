//! Path tracing.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::Ray;
use super::environment::{Environment, EnvironmentMap};
use super::filter::Pixel;
use super::sampler::Sampler;
use super::scene::{Body, Scene};
use super::texture::Shading;
use super::tracer::{Met, NO_LIGHT, Tracer};
use crate::Error;
use crate::material::Seen;

/// From which segment on Russian roulette may end a path.
const ROULETTE_FROM: u32 = 4;

/// Shadow rays end this much before a light, so that what the light lies on does not shadow it.
const SHORTER: f32 = 1.0 - 1e-4;

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
/// surface each light is connected to, and an environment map; area lights and the map are met by the direction
/// the material draws as well, and both are combined by multiple importance sampling (power heuristic). A constant
/// sky is met by the material's directions alone. From the fourth segment on, paths end with a probability given by
/// their throughput, without bias.
///
/// # Limits
/// Directional lights, points and spots are met by connection only, so a perfect mirror does not show them. Negative material
/// values count as 0.
///
/// # References
/// kajiya1986, veach1997 sections 9.2 and 10.2
#[inline(always)]
pub(super) fn radiance(
    tracer: &Tracer,
    mut ray: Ray,
    pixel: &Pixel,
    depth: u32,
    sampler: &mut Sampler,
) -> Result<Vec3, Box<Fault>> {
    let scene = tracer.scene;
    let mut sum = Vec3::ZERO;
    let mut throughput = Vec3::ONE;
    // the density with which the material drew the ray; none for the camera's
    let mut drawn = None;
    for segment in 1..=depth {
        let (body, hit, meeting) = match tracer.closest(&ray) {
            Some(Met::Body(body, hit, meeting)) => (body, hit, meeting),
            Some(Met::Light(light, t)) => {
                let (radiance, pdf) = light.seen(&ray, t);
                sum += throughput * radiance * drawn.map_or(1.0, |drawn| power_heuristic(drawn, pdf));
                break;
            }
            None => {
                sum += throughput * escaped(scene, ray.direction, drawn);
                break;
            }
        };
        if segment == depth {
            break;
        }
        let texels = body.material.texels();
        let shading = body.texture.shading(&hit, -ray.direction, texels, || sampler.next_1d());
        if !shading.covered {
            break;
        }
        let seen = |uv: Vec2| body.material.seen(uv, shading.wo);
        let others = if segment == 1 && body.texture.samples > 1 {
            let uvs = pixel.others(body, (&hit, &meeting), texels, || sampler.next_2d());
            uvs.into_iter().map(seen).collect()
        } else {
            Vec::new()
        };
        let point = Point { tracer, body, seen: seen(shading.uv), others, shading };
        sum += throughput * point.lit_by_lights(sampler)?;
        if let Environment::Map(map) = &scene.environment {
            sum += throughput * point.lit_by_map(map, sampler)?;
        }
        let Shading { frame, origin, .. } = &point.shading;
        let Some(sample) = body.material.sample_seen(&point.seen, sampler.next_2d()) else { break };
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
fn escaped(scene: &Scene, direction: Vec3, drawn: Option<f32>) -> Vec3 {
    let weight = match (&scene.environment, drawn, scene.background) {
        (_, None, Some(background)) => return background,
        (Environment::Map(map), Some(pdf), _) => power_heuristic(pdf, map.pdf(direction)),
        _ => 1.0,
    };
    scene.environment.radiance(direction) * weight
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
    tracer: &'a Tracer<'a>,
    body: &'a Body<'a>,
    shading: Shading,
    seen: Seen,
    /// Of the pixel, by which the material's value is averaged.
    others: Vec<Seen>,
}

impl Point<'_> {
    /// The material's apparent value, checked.
    #[inline]
    fn apparent(&self, wi: Vec3) -> Result<Vec3, Box<Fault>> {
        let mut value = self.apparent_at(&self.seen, wi)?;
        if !self.others.is_empty() {
            for seen in &self.others {
                value += self.apparent_at(seen, wi)?;
            }
            value /= (1 + self.others.len()) as f32;
        }
        Ok(value)
    }

    #[inline]
    fn apparent_at(&self, seen: &Seen, wi: Vec3) -> Result<Vec3, Box<Fault>> {
        let Seen { uv, wo, .. } = *seen;
        let value = self.body.material.apparent_seen(seen, wi);
        if value.is_finite() {
            return Ok(value.max(Vec3::ZERO));
        }
        Err(Box::new(Fault { material: self.body.material_name.clone(), uv, wi, wo, value }))
    }

    /// Light from all lights.
    #[inline(always)]
    fn lit_by_lights(&self, sampler: &mut Sampler) -> Result<Vec3, Box<Fault>> {
        let Shading { frame, origin, .. } = &self.shading;
        let mut sum = Vec3::ZERO;
        for (index, light) in self.tracer.scene.lights.iter().enumerate() {
            let Some(arriving) = light.arriving(*origin, || sampler.next_2d()) else { continue };
            let wi = frame.local(arriving.direction);
            if wi.z <= 0.0 {
                continue;
            }
            // the shadow first: it costs less than a BTF's value, whose memory arrives meanwhile
            let ray = Ray { origin: *origin, direction: arriving.direction };
            if self.tracer.occluded(&ray, arriving.distance * SHORTER, index) {
                continue;
            }
            let value = self.apparent(wi)? * arriving.irradiance * (1.0 / PI);
            let weight = if arriving.pdf > 0.0 {
                power_heuristic(arriving.pdf, self.body.material.pdf_seen(&self.seen, wi))
            } else {
                1.0
            };
            sum += value * weight;
        }
        Ok(sum)
    }

    /// Light from one direction drawn from an environment map.
    #[inline]
    fn lit_by_map(&self, map: &EnvironmentMap, sampler: &mut Sampler) -> Result<Vec3, Box<Fault>> {
        let Some((direction, pdf)) = map.sample(sampler.next_2d()) else { return Ok(Vec3::ZERO) };
        let Shading { frame, origin, .. } = &self.shading;
        let wi = frame.local(direction);
        if wi.z <= 0.0 || pdf <= 0.0 {
            return Ok(Vec3::ZERO);
        }
        let ray = Ray { origin: *origin, direction };
        if self.tracer.occluded(&ray, f32::INFINITY, NO_LIGHT) {
            return Ok(Vec3::ZERO);
        }
        let value = self.apparent(wi)?;
        let weight = power_heuristic(pdf, self.body.material.pdf_seen(&self.seen, wi));
        Ok(value * map.radiance(direction) * (weight / (PI * pdf)))
    }
}
