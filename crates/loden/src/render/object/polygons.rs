//! The polygons of a mesh file, in double precision, and the mesh that is rendered.

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::render::MeshData;
use crate::render::geometry;
use crate::{Error, Result};

/// A mesh file as it was read: what is missing in the file is marked, not made up.
#[derive(Debug, Clone, Default)]
pub struct MeshFile {
    /// The mesh relative to `origin`. Normals that the file lacks are zero, texture coordinates NaN; a list is empty if
    /// the file has none at all.
    pub data: MeshData,
    /// Where the origin of the mesh is in the file's coordinates: zero, or the middle of a mesh that is so far from zero
    /// that single precision would distort it.
    pub origin: DVec3,
    /// Warnings for the user about what was ignored or repaired, one sentence each.
    pub warnings: Vec<String>,
    /// A warning that texture coordinates are missing, which matters only where they are used.
    pub no_uvs: Option<String>,
    /// The material of each triangle, an index into what [`super::paints`] reads; empty if the file has no materials.
    pub painted: Vec<u16>,
}

/// The base colour of a material of a mesh file.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshPaint {
    /// Albedo, linear RGB. It is multiplied by the texture.
    pub albedo: [f32; 3],
    /// The picture file of the texture and its content.
    pub texture: Option<(PathBuf, Vec<u8>)>,
}

impl Default for MeshPaint {
    /// Mid-grey.
    fn default() -> Self {
        Self { albedo: [0.5; 3], texture: None }
    }
}

/// A mesh whose middle is farther from zero than this many radii is moved.
const FAR: f64 = 16.0;

/// Polygons that share vertices.
#[derive(Debug, Default)]
pub(super) struct Polygons {
    pub positions: Vec<DVec3>,
    /// One per position; zero if the file has none.
    pub normals: Vec<Vec3>,
    /// One per position, or none.
    pub tangents: Vec<Vec4>,
    /// One per position; NaN if the file has none.
    pub uvs: Vec<Vec2>,
    /// The vertices of all polygons.
    pub corners: Vec<u32>,
    /// The end of each polygon in `corners`.
    pub ends: Vec<usize>,
    /// The material of each polygon, or none.
    pub painted: Vec<u16>,
    /// What was ignored or repaired, without the name of the file.
    pub warnings: Vec<String>,
}

impl Polygons {
    /// Appends a vertex without tangent and returns its index.
    pub(super) fn vertex(&mut self, position: DVec3, normal: Option<Vec3>, uv: Option<Vec2>) -> u32 {
        self.positions.push(position);
        self.normals.push(normal.unwrap_or(Vec3::ZERO));
        self.uvs.push(uv.unwrap_or(Vec2::NAN));
        (self.positions.len() - 1) as u32
    }

    pub(super) fn polygon(&mut self, corners: impl IntoIterator<Item = u32>) {
        self.corners.extend(corners);
        self.ends.push(self.corners.len());
    }

    /// Appends the triangles of a strip, without degenerate ones.
    pub(super) fn strip(&mut self, strip: &[u32]) {
        for (k, window) in strip.windows(3).enumerate() {
            let [a, b, c] = [window[0], window[1], window[2]];
            if a != b && b != c && c != a {
                self.polygon(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
            }
        }
    }

    /// Adds a warning with a count if there is anything to count.
    pub(super) fn count(&mut self, count: usize, what: &str) {
        if count > 0 {
            self.warnings.push(format!("{what} ({count})"));
        }
    }

    /// Cuts the polygons into triangles and moves far meshes to their middle.
    pub(super) fn finish(mut self, path: &Path) -> Result<MeshFile> {
        let wrong = |field: String, problem: String| Error::invalid(path, field, problem);
        let count = self.positions.len();
        if u32::try_from(count).is_err() {
            return Err(wrong("mesh".into(), "more than 2^32 vertices".into()));
        }
        if let Some(index) = self.corners.iter().find(|&&i| i as usize >= count) {
            let index =
                if *index == u32::MAX { "a negative vertex index".into() } else { format!("vertex index {index}") };
            return Err(wrong("faces".into(), format!("found {index}, but there are {count} vertices")));
        }
        self.drop_unused();
        if let Some(k) = self.positions.iter().position(|p| !p.is_finite() || p.abs().max_element() > 1e30) {
            let problem = format!("vertex {k} is at {}, expected finite coordinates", self.positions[k]);
            return Err(wrong("mesh".into(), problem));
        }
        let origin = origin(&self.positions);
        let positions: Vec<Vec3> = self.positions.iter().map(|p| (*p - origin).as_vec3()).collect();
        let (triangles, painted) = self.triangles(&positions).map_err(|e| wrong("faces".into(), e.to_string()))?;
        if triangles.is_empty() {
            let reasons = self.warnings.iter().map(|warning| format!("; {warning}")).collect::<String>();
            return Err(wrong("mesh".into(), format!("found no triangles{reasons}")));
        }
        let no_uvs = self.missing_uvs(&triangles).map(|what| format!("{}: {what}", path.display()));
        self.check_normals();
        let warnings = self.warnings.iter().map(|warning| format!("{}: {warning}", path.display())).collect();
        let Self { normals, tangents, uvs, .. } = self;
        let data = MeshData { positions, normals, tangents, uvs, triangles };
        Ok(MeshFile { data, origin, warnings, no_uvs, painted })
    }

    /// Drops vertices that no polygon uses: they would count in the size of the mesh.
    fn drop_unused(&mut self) {
        let mut place = vec![u32::MAX; self.positions.len()];
        self.corners.iter().for_each(|&i| place[i as usize] = 0);
        if !place.contains(&u32::MAX) {
            return;
        }
        let used = |i: usize| place[i] == 0;
        fn keep<T: Copy>(list: &mut Vec<T>, used: impl Fn(usize) -> bool) {
            *list = list.iter().enumerate().filter(|(i, _)| used(*i)).map(|(_, value)| *value).collect();
        }
        keep(&mut self.positions, used);
        keep(&mut self.normals, used);
        keep(&mut self.tangents, used);
        keep(&mut self.uvs, used);
        for (next, place) in (0..).zip(place.iter_mut().filter(|place| **place == 0)) {
            *place = next;
        }
        self.corners.iter_mut().for_each(|i| *i = place[*i as usize]);
    }

    /// The triangles of all polygons, and their materials.
    fn triangles(&self, positions: &[Vec3]) -> Result<(Vec<[u32; 3]>, Vec<u16>)> {
        let mut triangles = Vec::with_capacity(self.ends.len());
        let mut painted = Vec::with_capacity(self.painted.len());
        let mut start = 0;
        for (k, &end) in self.ends.iter().enumerate() {
            let corners = &self.corners[start..end];
            start = end;
            if let Ok(triangle) = <[u32; 3]>::try_from(corners) {
                triangles.push(triangle);
                painted.extend(self.painted.get(k));
                continue;
            }
            let points: Vec<Vec3> = corners.iter().map(|&i| positions[i as usize]).collect();
            let outline = (0..corners.len() as u32).collect();
            let cut = geometry::polygons(&points, &[vec![outline]]).map_err(|error| match error {
                Error::Parameter { problem, .. } => Error::parameter(format!("polygon {k}"), problem),
                other => other,
            })?;
            triangles.extend(cut.iter().map(|t| t.map(|i| corners[i as usize])));
            painted.extend(self.painted.get(k).into_iter().flat_map(|paint| std::iter::repeat_n(paint, cut.len())));
        }
        Ok((triangles, painted))
    }

    /// Clears texture coordinates if there are none, and says which are missing.
    fn missing_uvs(&mut self, triangles: &[[u32; 3]]) -> Option<String> {
        self.uvs.iter_mut().filter(|uv| !uv.is_finite()).for_each(|uv| *uv = Vec2::NAN);
        let without = triangles.iter().filter(|t| t.iter().any(|&i| self.uvs[i as usize].is_nan())).count();
        let projected = "they are projected along the main axes";
        if without == triangles.len() {
            self.uvs.clear();
            return Some(format!("no texture coordinates; {projected}"));
        }
        (without > 0)
            .then(|| format!("{without} of {} triangles have no texture coordinates; {projected}", triangles.len()))
    }

    /// Clears normals if there are none, and warns of those that are missing.
    fn check_normals(&mut self) {
        let without = self.normals.iter().filter(|n| n.try_normalize().is_none()).count();
        let averaged = "they are averaged over adjacent triangles";
        if without == self.normals.len() {
            self.normals.clear();
            self.warnings.push(format!("no normals; {averaged}"));
        } else if without > 0 {
            self.warnings.push(format!("{without} of {} vertices have no normals; {averaged}", self.normals.len()));
        }
    }
}

/// Zero, or the middle of positions far from it.
fn origin(positions: &[DVec3]) -> DVec3 {
    let low = positions.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let high = positions.iter().copied().reduce(DVec3::max).unwrap_or_default();
    let (middle, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
    if middle.length() > FAR * radius { middle } else { DVec3::ZERO }
}
