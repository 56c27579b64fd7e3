//! A sample from a mesh file.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::{Paint, Solid};
use crate::acquire::texture::Texture;
use crate::render::object::{self, MeshPaint};
use crate::render::{CREASE_DEGREES, MeshData};
use crate::{Error, Result};

crate::words! {
    /// The axis of a mesh file that points away from the sample.
    pub enum Up { Y = "y", Z = "z" }
}

crate::params! {
    /// The parameters of a sample from a mesh file.
    #[derive(Copy)]
    pub struct Options {
        /// Axis of the file that points up; x points to the right. y is the convention of glTF.
        pub up: Up = "y",
        /// Side of the square tile in the units of the file; by default the larger of the width and the depth of the mesh.
        pub tile: Option<f32> [1e-6..=1e6, "file units"],
        /// The tile repeats: the mesh continues on the other side, and what exceeds the tile reaches into its neighbours.
        pub periodic: bool,
        /// Reflectance of the coat at normal incidence; 0 is matt.
        pub specular: f32 [0.0..=1.0] = 0.04,
        /// GGX alpha of the coat.
        pub roughness: f32 [0.02..=1.0] = 0.4,
        /// GGX alpha of the coat across dP/du, if it differs.
        pub roughness_across: Option<f32> [0.02..=1.0],
    }
}

/// Builds a sample from a mesh file of any format of [`object::EXTENSIONS`]. Its middle is the middle of the tile. The albedo
/// is that of the file's own materials (base colours and textures of glTF, diffuse colours and textures of OBJ; mid-grey
/// without), or of the picture `albedo`, which is 8-bit or 16-bit sRGB or linear, placed by the texture coordinates.
/// Returns warnings, one sentence each.
///
/// # Limits
/// Colours of vertices and transparent textures are ignored. A periodic tile must be square.
///
/// # Errors
/// Errors of reading the files; [`Error::Invalid`] for a mesh without extent, or a periodic one that is not square when no
/// `tile` is given.
pub fn build(file: &Path, albedo: Option<&Path>, options: &Options) -> Result<(Solid, Vec<String>)> {
    let read = object::read(file)?;
    let mut warnings = read.warnings;
    let MeshData { mut positions, normals, uvs, triangles, .. } = completed(read.data, file)?;
    for p in &mut positions {
        *p = options.up.raised(*p);
    }
    let normals = normals.into_iter().map(|n| options.up.raised(n).normalize_or(Vec3::Z)).collect();
    place(&mut positions, file, options)?;
    let paints = match albedo {
        Some(path) => vec![options.paint(Vec3::ONE, Some(Texture::open(path)?))],
        None => {
            let (paints, unknown) = object::paints(file)?;
            warnings.extend(unknown);
            paints.into_iter().map(|paint| options.painted(paint)).collect::<Result<_>>()?
        }
    };
    if paints.iter().any(|paint| paint.texture.is_some()) {
        warnings.extend(read.no_uvs);
    }
    let painted = if albedo.is_some() { Vec::new() } else { read.painted };
    let periodic = options.periodic;
    let solid = Solid { positions, normals, uvs, albedo: Vec::new(), triangles, painted, paints, periodic };
    solid.check().map_err(|e| Error::invalid(file, "mesh", e.to_string()))?;
    Ok((solid, warnings))
}

/// The mesh with the normals and texture coordinates that it lacks.
fn completed(mut data: MeshData, file: &Path) -> Result<MeshData> {
    data.complete(CREASE_DEGREES).map_err(|e| Error::invalid(file, "mesh", e.to_string()))?;
    Ok(data)
}

impl Up {
    /// A vector of the file in coordinates with z up.
    fn raised(self, v: Vec3) -> Vec3 {
        match self {
            Self::Y => Vec3::new(v.x, -v.z, v.y),
            Self::Z => v,
        }
    }
}

/// Scales and moves positions so that the tile is the unit square around their middle, and heights are around 0.
fn place(positions: &mut [Vec3], file: &Path, options: &Options) -> Result<()> {
    let low = positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = positions.iter().copied().reduce(Vec3::max).unwrap_or_default();
    let extent = high - low;
    let [width, depth] = [extent.x, extent.y];
    if options.tile.is_none() && options.periodic && (width - depth).abs() > 0.01 * width.max(depth) {
        let problem = format!("found {width} x {depth}, expected a square tile; give its side by --tile");
        return Err(Error::invalid(file, "extent", problem));
    }
    let tile = options.tile.unwrap_or(width.max(depth));
    if !(tile.is_normal() && tile > 0.0) {
        return Err(Error::invalid(file, "extent", format!("found {width} x {depth}, expected a width or a depth")));
    }
    let middle = 0.5 * (low + high);
    positions.iter_mut().for_each(|p| *p = (*p - middle) / tile + Vec3::new(0.5, 0.5, 0.0));
    Ok(())
}

impl Options {
    fn paint(&self, albedo: Vec3, texture: Option<Texture>) -> Paint {
        let across = self.roughness_across.unwrap_or(self.roughness);
        Paint { texture: texture.map(Arc::new), ..Paint::plain(albedo, self.specular, [self.roughness, across]) }
    }

    fn painted(&self, paint: MeshPaint) -> Result<Paint> {
        let texture = paint.texture.map(|(path, bytes)| Texture::decode(&path, &bytes)).transpose()?;
        Ok(self.paint(Vec3::from(paint.albedo).clamp(Vec3::ZERO, Vec3::ONE), texture))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Params;
    use glam::Vec2;

    /// A square of 2 x 2 file units with a step, y up, as OBJ.
    const STEP: &str = "v 0 0 0\nv 2 0 0\nv 2 0 -2\nv 0 0 -2\nv 1 1 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt .5 .5\n\
                        f 1/1 2/2 5/5\nf 2/2 3/3 5/5\nf 3/3 4/4 5/5\nf 4/4 1/1 5/5\n";

    #[test]
    fn a_mesh_fills_its_tile_the_right_way_up() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.obj");
        std::fs::write(&path, STEP).unwrap();
        let (solid, _) = build(&path, None, &Options::default()).unwrap();
        let peak = solid.positions.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
        assert!((peak - Vec3::new(0.5, 0.5, 0.25)).length() < 1e-6, "{peak}");
        // the corner that is nearest in the file, with the largest z, is at the bottom
        let corner = solid.uvs.iter().position(|uv| *uv == Vec2::ZERO).unwrap();
        assert!((solid.positions[corner] - Vec3::new(0.0, 0.0, -0.25)).length() < 1e-6);
        let (half, _) = build(&path, None, &Options { tile: Some(4.0), ..Options::default() }).unwrap();
        assert!((half.positions[corner] - Vec3::new(0.25, 0.25, -0.125)).length() < 1e-6);
    }

    #[test]
    fn wrong_tiles_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.obj");
        std::fs::write(&path, STEP.replace("-2", "-3")).unwrap();
        let periodic = Options { periodic: true, ..Options::default() };
        let error = build(&path, None, &periodic).unwrap_err().to_string();
        assert!(error.contains("x.obj") && error.contains("found 2 x 3"), "{error}");
        build(&path, None, &Options { tile: Some(3.0), ..periodic }).unwrap();
        std::fs::write(&path, "v 0 0 0\nv 0 1 0\nv 0 2 0\nf 1 2 3\n").unwrap();
        assert!(build(&path, None, &Options::default()).unwrap_err().to_string().contains("extent"));
        assert!(Options::TABLE.iter().any(|param| param.name == "periodic"));
    }
}
