//! Surface points on paths, and the materials there.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::scene::Body;
use super::texture::{MAX_TEXTURE_SAMPLES, Shading};
use crate::Error;
use crate::material::{Point, Prepared};

/// Maximum number of further points of a pixel.
const MAX_OTHERS: usize = MAX_TEXTURE_SAMPLES as usize - 1;

/// A surface point on a path.
pub(super) struct Vertex<'a> {
    pub body: &'a Body<'a>,
    /// Index of the material in the scene.
    pub material: u32,
    pub path: u16,
    /// Whether the camera sees it, or a sharp reflection shows it.
    pub direct: bool,
    /// Whether the inside of the body is seen; computed only if a light casts no shadows.
    pub inside: bool,
    pub shading: Shading,
    /// Texture coordinates of further points of the pixel, over which the material's value is averaged.
    pub others: Vec<Vec2>,
    /// Index of its point among those of the material; further points follow it.
    pub point: u32,
    /// Reflected light so far.
    pub lit: Vec3,
}

/// The points of one material.
pub(super) struct Group<'p> {
    /// Indices of its vertices.
    pub vertices: Range<usize>,
    pub points: &'p [Point],
    pub prepared: Box<dyn Prepared + 'p>,
}

impl Group<'_> {
    /// The material's apparent value, checked and averaged over the pixel, given that at the vertex itself.
    #[inline(always)]
    pub(super) fn mean(&self, vertex: &Vertex, wi: Vec3, value: Vec3) -> Result<Vec3, Box<Fault>> {
        let mut sum = self.checked(vertex, vertex.point, wi, value)?;
        if vertex.others.is_empty() {
            return Ok(sum);
        }
        let count = vertex.others.len();
        let index: [u32; MAX_OTHERS] = std::array::from_fn(|k| vertex.point + 1 + k as u32);
        let mut values = [Vec3::ZERO; MAX_OTHERS];
        self.prepared.apparent(&index[..count], &[wi; MAX_OTHERS][..count], &mut values[..count]);
        for (point, value) in index.into_iter().zip(values).take(count) {
            sum += self.checked(vertex, point, wi, value)?;
        }
        Ok(sum / (1 + count) as f32)
    }

    #[inline(always)]
    fn checked(&self, vertex: &Vertex, point: u32, wi: Vec3, value: Vec3) -> Result<Vec3, Box<Fault>> {
        if value.is_finite() {
            return Ok(value.max(Vec3::ZERO));
        }
        let Point { uv, wo } = self.points[point as usize];
        Err(Box::new(Fault { material: vertex.body.material_name.clone(), uv, wi, wo, value }))
    }
}

/// Error for a material's value that is not finite.
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
