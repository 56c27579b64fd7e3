//! Emission and transparency of bodies, and bodies that keep light out of their inside.

use glam::Vec3;

use super::bvh::{Bundle, Row};
use super::hit::Hit;
use super::path::Path;
use super::ray::Ray;
use super::scene::Body;
use super::texture::Shading;
use super::vertex::Vertex;
use crate::material::OwnLight;

/// Sampling density, 1/sr, above which a reflection counts as sharp: a diffuse surface has at most 1 / pi.
const SHARP: f32 = 1.0;

/// Whether a surface is seen by the camera or in a sharp reflection, by a ray drawn with this density.
#[inline]
pub(super) fn is_seen_directly(drawn: Option<f32>) -> bool {
    drawn.is_none_or(|pdf| pdf > SHARP)
}

/// Adds the light that a body emits to a path. Returns the rest of the path if it passes through the body; weights
/// the path if it does not.
#[cold]
pub(super) fn add_own(body: &Body, shading: &Shading, hit: &Hit, path: &mut Path, sums: &mut [Vec3]) -> Option<Path> {
    let OwnLight { emitted, shown, opacity } = body.material.own(shading.uv, shading.wo);
    if opacity != Vec3::ONE {
        // Pass through the body at random, in proportion to its transmittance
        let stays = (opacity.element_sum() / 3.0).clamp(0.0, 1.0);
        if path.sampler.next_1d() >= stays {
            let Path { ray, throughput, drawn, sampler, place } = *path;
            let origin = hit.position * 2.0 - hit.origin;
            let throughput = throughput * (Vec3::ONE - opacity) / (1.0 - stays);
            return Some(Path { ray: Ray { origin, ..ray }, throughput, drawn, sampler, place });
        }
        path.throughput *= opacity / stays;
    }
    let shown = if is_seen_directly(path.drawn) { shown } else { Vec3::ZERO };
    sums[path.place as usize] += path.throughput * (emitted + shown);
    None
}

/// Returns a bit for each ray of a bundle that starts on the inside of a body and meets the same body again.
pub(super) fn shut_out<'v>(bundle: &Bundle, vertices: impl Iterator<Item = &'v Vertex<'v>>) -> u16 {
    let mut all = 0;
    for (lane, vertex) in vertices.enumerate().filter(|(_, vertex)| vertex.inside) {
        let mut single = Bundle::EMPTY;
        single.t_max = Row::ZERO;
        single.set(lane, &bundle.ray(lane), bundle.t_max.0[lane]);
        all |= vertex.body.shape.occluded_of(&single) & 1 << lane;
    }
    all
}
