//! Texture filtering: several texture samples per camera ray.

use glam::Vec2;

use super::bvh::Intersection;
use super::camera::Rays;
use super::hit::Hit;
use super::ray::Ray;
use super::scene::Body;

/// Increments of the R2 sequence, which fills the unit square evenly for any number of points.
///
/// # References
/// roberts2018
const STEPS: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// A camera ray with its pixel; gives the texture samples of the ray.
///
/// # Model
/// Further points are drawn from the pixel filter, as the camera ray was. The rays through them are intersected with
/// the surface that the camera ray hit, or with the plane of its triangle; the scene is not traversed again. The
/// renderer averages the material's value, in linear light, over the texture coordinates of all points. The expectation
/// of the pixel is unchanged. The number of points is the number of texels in the square over the longer derivative of
/// the texture coordinates per pixel, limited by [`super::TextureMap::samples`].
///
/// # Limits
/// Only the surface seen by the camera ray is filtered: later segments of a path use one sample. Blended projections
/// and materials that are mirrored or end at their edge are not filtered. Beyond a silhouette, the planes of triangles
/// are extrapolated.
///
/// # References
/// igehy1999 (derivatives of texture coordinates from ray differentials)
#[derive(Clone, Copy)]
pub(super) struct Pixel<'a> {
    /// Camera rays of the image.
    pub rays: &'a Rays,
    /// Centre of the pixel, in pixels.
    pub middle: Vec2,
    /// Offset of the camera ray from the centre, in pixels.
    pub offset: Vec2,
    /// Lens sample of the camera ray.
    pub lens: Vec2,
}

impl Pixel<'_> {
    /// Texture coordinates of the further points, on a body that the camera ray hit. `random` returns two numbers in
    /// [0, 1); it is called only if there are further points.
    pub(super) fn others(
        &self,
        body: &Body,
        (hit, at): (&Hit, &Intersection),
        texels: Option<[usize; 2]>,
        random: impl FnOnce() -> Vec2,
    ) -> Vec<Vec2> {
        let (Some(size), map) = (texels, &body.texture) else { return Vec::new() };
        if map.samples <= 1 || !map.can_be_averaged() {
            return Vec::new();
        }
        let transform = map.transform();
        let raw = |offset: Vec2| Some(map.raw(&body.shape.beside(&self.ray(offset), at)?));
        let derivative = |step: Vec2| {
            let change = raw(self.offset + step)? - map.raw(hit);
            // Texture coordinates may jump by whole repeats.
            Some(
                (transform.apply(change - change.round()) * Vec2::new(size[0] as f32, size[1] as f32)).length_squared(),
            )
        };
        let (Some(right), Some(below)) = (derivative(Vec2::X), derivative(Vec2::Y)) else { return Vec::new() };
        let points = right.max(below).ceil().min(map.samples as f32) as u32;
        if points <= 1 {
            return Vec::new();
        }
        let start = random();
        let place = |k: u32| raw(tent((start + STEPS * k as f32).fract_gl())).filter(|uv| uv.is_finite());
        (1..points).filter_map(place).map(|uv| map.wrapped(transform.apply(uv), texels).0).collect()
    }

    fn ray(&self, offset: Vec2) -> Ray {
        self.rays.through(self.middle + offset, self.lens)
    }
}

/// Maps two uniform numbers to the density (1 - |x|) (1 - |y|) on -1..1.
#[inline(always)]
pub(super) fn tent(random: Vec2) -> Vec2 {
    let one = |u: f32| (1.0 - (2.0 * u.min(1.0 - u)).sqrt()).copysign(u - 0.5);
    Vec2::new(one(random.x), one(random.y))
}
