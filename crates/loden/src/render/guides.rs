//! What can be seen of a scene without light: the colours and directions of its surfaces, pixel by pixel.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::bvh::{Bundle, RAYS, Row, lanes};
use super::filter::tent;
use super::sampler::Sampler;
use super::scene::Scene;
use super::settings::Settings;
use super::surface::Surfaces;
use super::tracer::{Met, Tracer, What};
use crate::Result;
use crate::direction::cosine_hemisphere;
use crate::progress::{Progress, Task};

/// Camera rays of each pixel.
const SAMPLES: usize = RAYS;

/// The surfaces in the pixels of a picture, row by row, averaged over the pixel filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Guides {
    /// Reflectance towards the camera under even light; 0 where there is no surface.
    pub albedo: Vec<Vec3>,
    /// Shading normal; 0 where there is no surface.
    pub normal: Vec<Vec3>,
}

impl Guides {
    /// Looks at a scene. The result depends on the scene and the size alone.
    ///
    /// # Model
    /// Sixteen camera rays are followed to the first surface. Its reflectance is estimated with one direction of light for
    /// each ray; these directions are the same for all pixels, so that pixels of equal surfaces are equal.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] for an impossible camera; [`crate::Error::Cancelled`].
    pub fn of(scene: &Scene, settings: &Settings, progress: &dyn Progress) -> Result<Self> {
        settings.check()?;
        let Settings { width, height, .. } = *settings;
        let rays = scene.camera.prepare(width, height)?;
        let tracer = Tracer::new(scene);
        let task = Task::new(progress, "look", height as u64);
        let pixel = |work: &mut Work, x: usize, y: usize| {
            work.bundle.t_max = Row::ZERO;
            for lane in 0..RAYS {
                let mut sampler = Sampler::new(0, x as u32, y as u32, lane as u32);
                let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + tent(sampler.next_2d());
                let lens = if rays.has_lens() { sampler.next_2d() } else { Vec2::ZERO };
                work.bundle.set(lane, &rays.through(at, lens), f32::INFINITY);
            }
            work.look(&tracer)
        };
        let row = |y: usize| {
            let mut work = Work::new();
            let row: Vec<(Vec3, Vec3)> = (0..width).map(|x| pixel(&mut work, x, y)).collect();
            task.advance(1).map(|()| row)
        };
        let rows = (0..height).into_par_iter().map(row).collect::<Result<Vec<_>>>()?;
        tracer.check_materials()?;
        let (albedo, normal) = rows.into_iter().flatten().unzip();
        Ok(Self { albedo, normal })
    }
}

/// What one thread needs.
struct Work {
    bundle: Bundle,
    met: Met,
    surfaces: Surfaces,
    lights: [Vec3; SAMPLES],
}

impl Work {
    fn new() -> Self {
        // points of an even sequence
        let light = |k: usize| {
            let step = Vec2::new(0.754_877_7, 0.569_840_3) * (k as f32 + 0.5);
            cosine_hemisphere(step.fract_gl())
        };
        let (bundle, met, surfaces) = (Bundle::EMPTY, Met::nothing(), Surfaces::new());
        Self { bundle, met, surfaces, lights: std::array::from_fn(light) }
    }

    /// Mean albedo and normal of what the rays of the bundle meet.
    fn look(&mut self, tracer: &Tracer) -> (Vec3, Vec3) {
        let Self { bundle, met, surfaces, lights } = self;
        let scene = tracer.scene;
        tracer.closest(bundle, met);
        let mut bodies = 0;
        for lane in 0..RAYS {
            bodies |= u16::from(matches!(met.what[lane], What::Body(_))) << lane;
        }
        if bodies == 0 {
            return (Vec3::ZERO, Vec3::ZERO);
        }
        surfaces.find(scene, bundle, met, bodies, |_| 0.5);
        let (mut albedo, mut normal) = (Vec3::ZERO, Vec3::ZERO);
        for lane in lanes(bodies) {
            let Some(body) = met.body(scene, lane) else { continue };
            let mut shading = surfaces.shadings.get(lane);
            if !body.texture.wrap(&mut shading, body.material.texels()) {
                continue;
            }
            let wi = lights[lane];
            let value = body.material.apparent(shading.uv, wi, shading.wo) / wi.z.max(0.05);
            // a highlight says little about the surface
            albedo += if value.is_finite() { value.clamp(Vec3::ZERO, Vec3::ONE) } else { Vec3::ZERO };
            normal += surfaces.hits.get(lane).normal;
        }
        (albedo / SAMPLES as f32, normal / SAMPLES as f32)
    }
}
