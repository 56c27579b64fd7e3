//! The surfaces that the rays of a bundle hit.

use super::bvh::{Bundle, RAYS, lanes};
use super::hit::{Hit, Place};
use super::scene::Scene;
use super::texture::{Mapping, Shading, TextureTransform};
use super::traced::Surface;
use super::tracer::Met;
use crate::simd::many::Many;

/// The surfaces of the bodies that the rays of a bundle hit.
pub(super) struct Surfaces {
    places: Many<Place, 41>,
    /// With the texture coordinates of the mapping, wrapped.
    pub hits: Many<Hit, 18>,
    transforms: Many<TextureTransform, 3>,
    /// With texture coordinates before wrapping.
    pub shadings: Many<Shading, 17>,
}

impl Surfaces {
    pub(super) fn new() -> Self {
        Self { places: Many::ZERO, hits: Many::ZERO, transforms: Many::ZERO, shadings: Many::ZERO }
    }

    /// Finds the surfaces of the lanes whose bits are set in `bodies`. `random` returns a number in [0, 1) for a
    /// lane.
    #[inline(always)]
    pub(super) fn find(
        &mut self,
        scene: &Scene,
        bundle: &Bundle,
        met: &Met,
        bodies: u16,
        mut random: impl FnMut(usize) -> f32,
    ) {
        let Self { places, hits, transforms, shadings } = self;
        // Interpolate triangles for all rays together
        let mut exact = [None; RAYS];
        for lane in lanes(bodies) {
            let Some(body) = met.body(scene, lane) else { continue };
            transforms.set(lane, body.texture.transform());
            match body.shape.surface(&bundle.ray(lane), &met.intersection(bundle, lane)) {
                Surface::Triangle(place) => places.set(lane, place),
                Surface::Smooth(hit) => exact[lane] = Some(hit),
            }
        }
        for lane in 0..RAYS {
            hits.set(lane, places.get(lane).surface(-bundle.ray(lane).direction));
        }
        // Query the surfaces of other shapes
        for (lane, hit) in exact.into_iter().enumerate() {
            if let Some(hit) = hit {
                hits.set(lane, hit);
            }
        }
        // Apply texture mappings
        for lane in lanes(bodies) {
            let Some(body) = met.body(scene, lane) else { continue };
            if body.texture.mapping != Mapping::Surface {
                hits.set(lane, body.texture.mapped(&hits.get(lane), || random(lane)));
            }
        }
        // Compute shading frames
        for lane in 0..RAYS {
            shadings.set(lane, transforms.get(lane).shading(&hits.get(lane), -bundle.ray(lane).direction));
        }
    }
}
