//! Samples of triangles: meshes from files, and yarns.

pub mod mesh;
mod paint;
mod tile;
pub mod yarn;

use glam::{Vec2, Vec3};

pub use paint::{Coat, Paint};
pub(super) use tile::Tile;

use crate::{Error, Result};

/// Largest number of triangles of a solid.
const MOST_TRIANGLES: usize = 1 << 25;

/// Triangles with overhangs and holes over the unit square, periodic in x and y or alone. The unit of length is the side
/// of the tile; z is up.
///
/// # Model
/// Triangles are seen from both sides. Light is reflected about the normals of the vertices, interpolated linearly; fibres
/// lie along dP/du of each triangle.
#[derive(Debug, Clone, Default)]
pub struct Solid {
    /// Positions of the vertices.
    pub positions: Vec<Vec3>,
    /// Unit normals, one per vertex; none for flat triangles.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per vertex; none without textures and fibres.
    pub uvs: Vec<Vec2>,
    /// Albedo, linear RGB in 0..=1, one per vertex; none for white. It is multiplied by that of the paint.
    pub albedo: Vec<Vec3>,
    /// Three vertices per triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The paint of each triangle, an index into `paints`; none if there is one paint.
    pub painted: Vec<u16>,
    /// Paints.
    pub paints: Vec<Paint>,
    /// Whether the unit square repeats.
    pub periodic: bool,
}

impl Solid {
    /// Checks what [`Solid`] says of its fields.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the field.
    pub fn check(&self) -> Result<()> {
        let n = self.positions.len();
        let lists = [("normals", self.normals.len()), ("uvs", self.uvs.len()), ("albedo", self.albedo.len())];
        for (name, found) in lists {
            if found != 0 && found != n {
                return Err(Error::parameter(name, format!("found {found}, expected none or {n}")));
            }
        }
        let count = self.triangles.len();
        if count == 0 || count > MOST_TRIANGLES {
            return Err(Error::parameter("triangles", format!("found {count}, expected 1 to {MOST_TRIANGLES}")));
        }
        if self.triangles.iter().flatten().any(|&i| i as usize >= n) {
            return Err(Error::parameter("triangles", format!("a vertex does not exist: there are {n}")));
        }
        if let Some(p) = self.positions.iter().find(|p| !p.is_finite() || p.abs().max_element() > 1e3) {
            return Err(Error::parameter("positions", format!("found {p}, expected at most 1000 sides of the tile")));
        }
        if !self.painted.is_empty() && self.painted.len() != count {
            return Err(Error::parameter("painted", format!("found {}, expected {count}", self.painted.len())));
        }
        let most = self.painted.iter().copied().max().unwrap_or(0);
        if usize::from(most) >= self.paints.len() {
            return Err(Error::parameter("paints", format!("found {}, but number {most} is used", self.paints.len())));
        }
        let fraction = |v: &Vec3| v.cmpge(Vec3::ZERO).all() && v.cmple(Vec3::ONE).all();
        if let Some(found) = self.albedo.iter().find(|v| !fraction(v)) {
            return Err(Error::parameter("albedo", format!("found {found}, expected 0 to 1")));
        }
        self.paints.iter().try_for_each(Paint::check)
    }

    /// The lowest and the highest z.
    pub fn heights(&self) -> [f32; 2] {
        let z = || self.positions.iter().map(|p| p.z);
        [z().fold(f32::MAX, f32::min), z().fold(f32::MIN, f32::max)]
    }
}
