//! Synthesis on surfaces: every point of a mesh copies a texel of the sample, and threads follow a direction field.
//!
//! # Model
//! A direction field that varies as little as possible, or follows strokes, says where the tangent of the sample points in each triangle. An
//! atlas holds every triangle by itself, turned so that its direction points right: the source of a texel is the map's, and the
//! rotation is in the texture coordinates, so the result is a material as any other. The points of the surface are the
//! texels inside of triangles. What lies around a point is found on straight ways over the surface, which cross edges. At
//! first, patches are laid side by side, each the best of several; then, from coarse to fine, each point looks for a
//! neighbourhood of the sample that resembles its own, among those that continue its neighbours' sources and those similar to
//! them (k-coherent search).
//!
//! # Limits
//! Edges of a mesh with more than two triangles are refused. At singularities of the field, which every surface but a torus has,
//! threads end. Very small or long triangles waste the atlas. About 300 bytes of memory per point.
//!
//! # References
//! tong2002, knoppel2013

mod atlas;
mod field;
mod fill;
mod mesh;
mod points;

use glam::{DVec3, Vec2, Vec3};

use super::optimise::Sample;
use super::{Exemplar, Source, SourceMap};
use crate::progress::{Progress, Task};
use crate::{Error, Result};
use atlas::Atlas;
use field::Field;
pub use field::Stroke;
use fill::{Filling, STEPS};
use mesh::Mesh;
use points::Points;

/// The largest side of an atlas.
pub const MAX_ATLAS: usize = 4096;

/// What to make on a surface.
#[derive(Debug, Clone)]
pub struct SurfaceGoal {
    /// Texels per side of the atlas.
    pub side: usize,
    /// Chooses one of many results.
    pub seed: u64,
    /// Directions that the tangent of the sample follows.
    pub strokes: Vec<Stroke>,
}

/// A corner of a triangle in the atlas.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtlasCorner {
    /// Its point in space.
    pub position: Vec3,
    /// Its texture coordinate.
    pub uv: Vec2,
}

/// A synthesis on a surface.
#[derive(Debug, Clone)]
pub struct OnSurface {
    /// The sources of the atlas.
    pub map: SourceMap,
    /// The triangles, oriented alike.
    pub corners: Vec<[AtlasCorner; 3]>,
    /// Points of the surface.
    pub points: usize,
    /// Singularities of the direction field, weighted with their indices: the Euler characteristic of the surface with its holes closed.
    pub singularities: i64,
}

/// Covers the triangles of a mesh, given by their corners, with copies of texels.
///
/// # Errors
/// [`Error::Parameter`] if the mesh is not a surface, naming the edge, or if the atlas is too small or too large; as
/// [`super::synthesize`].
pub fn on_surface(
    exemplar: &Exemplar,
    triangles: &[[Vec3; 3]],
    goal: &SurfaceGoal,
    progress: &dyn Progress,
) -> Result<OnSurface> {
    exemplar.check()?;
    if !(8..=MAX_ATLAS).contains(&goal.side) {
        return Err(Error::parameter("size", format!("found {}, expected 8 to {MAX_ATLAS}", goal.side)));
    }
    let corners: Vec<[DVec3; 3]> = triangles.iter().map(|corners| corners.map(|p| p.as_dvec3())).collect();
    let mesh = Mesh::new(&corners, &|warning| progress.warn(warning))?;
    progress.stage("find directions");
    let closed = mesh.closed();
    let mut field = Field::new(&closed, &goal.strokes);
    let singularities = field.indices(&closed).iter().sum::<f64>().round() as i64;
    field.0.truncate(mesh.triangles.len());
    let atlas = Atlas::new(&mesh, &field, goal.side)?;
    let points = Points::new(&atlas);
    let sample = Sample::<8>::new(exemplar)?;
    let task = Task::new(progress, "synthesise", STEPS.iter().map(|(_, passes)| *passes as u64).sum());
    let sources = vec![Source::default(); points.points.len()];
    let mut filling = Filling { atlas: &atlas, points: &points, sample: &sample, seed: goal.seed, sources };
    filling.lay(&task)?;
    for (step, passes) in STEPS {
        filling.refine(step, passes, &task)?;
    }
    let unused = filling.sources.first().copied().unwrap_or_default();
    let shown = points.shown().map(|point| point.map_or(unused, |point| filling.sources[point]));
    let map = SourceMap { width: atlas.width, height: atlas.height, sources: shown.collect() };
    let corner = |triangle: usize, k: usize| {
        let chart = &atlas.charts[triangle];
        let [left, top] = chart.place.map(|v| v as f64);
        let at = chart.corners[k];
        let (u, v) = ((at.x + left) / atlas.width as f64, 1.0 - (at.y + top) / atlas.height as f64);
        AtlasCorner {
            position: mesh.positions[mesh.triangles[triangle][k]].as_vec3(),
            uv: Vec2::new(u as f32, v as f32),
        }
    };
    let corners = (0..mesh.triangles.len()).map(|triangle| [0, 1, 2].map(|k| corner(triangle, k))).collect();
    Ok(OnSurface { map, corners, points: points.points.len(), singularities })
}

#[cfg(test)]
mod tests;
