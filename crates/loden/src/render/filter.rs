//! Several points of a texture for one camera ray.

use glam::Vec2;

use super::Ray;
use super::camera::Rays;
use super::progressive::tent;
use super::scene::Body;
use super::shape::Meeting;
use super::surface::Hit;

/// The most points of a texture that one camera ray looks at.
pub const MAX_TEXTURE_SAMPLES: u32 = 64;

/// Steps by which points fill a square evenly, however many there are.
///
/// # References
/// roberts2018
const STEPS: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// Where a camera ray is within its pixel, and the rays beside it.
///
/// # Model
/// Other points of the pixel are drawn as the camera ray's is, from the filter of the picture, and the rays through them meet the
/// surface, or the plane of the triangle, that the camera ray met. The mean of what the material shows at all of their
/// texture coordinates, in linear light, takes the place of what it shows at one: the picture stays what it was on average,
/// and nothing is searched for further rays. There are as many points as texels in the square of the longer derivative
/// of the texture coordinates by the pixel, within the limit that was asked for.
///
/// # Limits
/// Of the surface that the camera ray met alone, seen along this ray: later segments of a path look at one point. No
/// blended projections, and no materials that are mirrored or end at their edge. Beyond a silhouette of triangles their
/// planes go on.
///
/// # References
/// igehy1999 (derivatives of texture coordinates from the rays beside)
#[derive(Clone, Copy)]
pub(super) struct Pixel<'a> {
    /// Of the picture.
    pub rays: &'a Rays,
    /// Middle of the pixel.
    pub middle: Vec2,
    /// From there to the camera ray, pixels.
    pub offset: Vec2,
    /// Where on the lens it begins.
    pub lens: Vec2,
}

impl Pixel<'_> {
    /// Texture coordinates of further points of the pixel, on a body where the camera ray met it. `random` gives two
    /// numbers in [0, 1), asked for only if there are further points.
    pub(super) fn others(
        &self,
        body: &Body,
        (hit, meeting): (&Hit, &Meeting),
        texels: Option<[usize; 2]>,
        random: impl FnOnce() -> Vec2,
    ) -> Vec<Vec2> {
        let (Some(size), map) = (texels, &body.texture) else { return Vec::new() };
        if map.samples <= 1 || !map.can_be_averaged() {
            return Vec::new();
        }
        let laying = map.laying();
        let raw = |offset: Vec2| Some(map.raw(&body.shape.beside(&self.ray(offset), meeting)?));
        let derivative = |step: Vec2| {
            let change = raw(self.offset + step)? - map.raw(hit);
            // coordinates may jump by whole repeats
            Some((laying.laid(change - change.round()) * Vec2::new(size[0] as f32, size[1] as f32)).length_squared())
        };
        let (Some(right), Some(below)) = (derivative(Vec2::X), derivative(Vec2::Y)) else { return Vec::new() };
        let points = right.max(below).ceil().min(map.samples as f32) as u32;
        if points <= 1 {
            return Vec::new();
        }
        let start = random();
        let place = |k: u32| raw(tent((start + STEPS * k as f32).fract_gl())).filter(|uv| uv.is_finite());
        (1..points).filter_map(place).map(|uv| map.wrapped(laying.laid(uv), texels).0).collect()
    }

    fn ray(&self, offset: Vec2) -> Ray {
        self.rays.through(self.middle + offset, self.lens)
    }
}
