//! Triangle meshes with normals, texture coordinates and tangents, and ray intersection.

mod normals;
mod tangents;

use glam::{Mat4, Vec2, Vec3, Vec4};

use super::bounds::{Ball, extent};
use super::bvh::{Bundle, Bvh, Intersection, Triangles};
use super::hit::{Corner, Place};
use super::ray::Ray;
use super::traced::{Surface, Traced};
use crate::{Error, Result};

/// Default crease angle of meshes without normals, degrees: edges that bend by less are smooth.
pub const CREASE_DEGREES: f32 = 40.0;

/// Maximum number of triangles in one mesh.
pub const MAX_TRIANGLES: usize = 1 << 28;

/// The data of a mesh, read from a file or computed; [`Mesh::new`] checks and completes it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshData {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Normals of any length, one per vertex. Those that are zero or not finite are computed; all if empty.
    pub normals: Vec<Vec3>,
    /// Unit tangents dP/du, one per vertex; w is 1, or -1 if dP/dv points against normal x tangent. Computed from the
    /// texture coordinates if empty.
    pub tangents: Vec<Vec4>,
    /// Texture coordinates, one per vertex. Triangles with a vertex where they are NaN get projected ones; all if empty.
    pub uvs: Vec<Vec2>,
    /// Three vertex indices per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl MeshData {
    /// Appends another mesh, transformed by an affine matrix. Tangents are kept only if both meshes have them; normals and
    /// texture coordinates are marked as missing where one of the meshes has none.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the matrix is singular or there are more than 2^32 vertices.
    pub fn append(&mut self, other: &Self, transform: Mat4) -> Result<()> {
        if transform.determinant().abs() < f32::MIN_POSITIVE || !transform.is_finite() {
            return Err(Error::parameter("transform", "the matrix is singular or not finite"));
        }
        let first = u32::try_from(self.positions.len() + other.positions.len())
            .map(|_| self.positions.len() as u32)
            .map_err(|_| Error::parameter("mesh", "found more than 2^32 vertices"))?;
        // Transform and append normals, tangents and texture coordinates
        let mirrored = transform.determinant() < 0.0;
        let counts = [self.positions.len(), self.positions.len() + other.positions.len()];
        if !(self.normals.is_empty() && other.normals.is_empty()) {
            let cofactor = transform.inverse().transpose();
            let normals = other.normals.iter().map(|&n| cofactor.transform_vector3(n).normalize_or_zero());
            self.normals.resize(counts[0], Vec3::ZERO);
            self.normals.extend(normals);
            self.normals.resize(counts[1], Vec3::ZERO);
        }
        if !(self.uvs.is_empty() && other.uvs.is_empty()) {
            self.uvs.resize(counts[0], Vec2::NAN);
            self.uvs.extend(&other.uvs);
            self.uvs.resize(counts[1], Vec2::NAN);
        }
        if self.tangents.len() == counts[0] && other.tangents.len() == other.positions.len() {
            let sign = if mirrored { -1.0 } else { 1.0 };
            let moved = |t: &Vec4| transform.transform_vector3(t.truncate()).normalize_or_zero().extend(t.w * sign);
            self.tangents.extend(other.tangents.iter().map(moved));
        } else {
            self.tangents.clear();
        }
        // Append vertices and triangles
        self.positions.extend(other.positions.iter().map(|&p| transform.transform_point3(p)));
        self.triangles.extend(other.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| i.saturating_add(first));
            if mirrored { [a, c, b] } else { [a, b, c] }
        }));
        Ok(())
    }

    /// Whether a triangle has texture coordinates.
    fn has_uvs(&self, triangle: &[u32; 3]) -> bool {
        triangle.iter().all(|&i| self.uvs.get(i as usize).is_some_and(|uv| uv.is_finite()))
    }

    /// Projects the texture coordinates of triangles that have none along the major axis of the triangle's normal, one
    /// repeat per bounding radius. Duplicates vertices, so that no triangle is distorted.
    fn project_uvs(&mut self) {
        let ball = Ball::around(&self.positions);
        let source = std::mem::take(self);
        if !source.uvs.is_empty() {
            (self.positions, self.normals, self.uvs) =
                (source.positions.clone(), source.normals.clone(), source.uvs.clone());
        }
        for &t in &source.triangles {
            if source.has_uvs(&t) {
                self.triangles.push(t);
                continue;
            }
            let n = source.area_vector(t);
            let first = self.positions.len() as u32;
            for i in t {
                let p = (source.positions[i as usize] - ball.centre) / ball.radius.max(f32::MIN_POSITIVE);
                let a = n.abs();
                let uv = if a.y >= a.x && a.y >= a.z {
                    Vec2::new(p.x, -p.z * n.y.signum())
                } else if a.x >= a.z {
                    Vec2::new(-p.z * n.x.signum(), p.y)
                } else {
                    Vec2::new(p.x * n.z.signum(), p.y)
                };
                self.positions.push(source.positions[i as usize]);
                self.normals.push(source.normals[i as usize]);
                self.uvs.push(uv);
            }
            self.triangles.push([first, first + 1, first + 2]);
        }
    }

    fn area_vector(&self, t: [u32; 3]) -> Vec3 {
        let [a, b, c] = t.map(|i| self.positions[i as usize]);
        (b - a).cross(c - a)
    }

    /// Checks a mesh and adds the normals and texture coordinates that it lacks, as [`Mesh::smoothed`] says.
    ///
    /// # Errors
    /// See [`Mesh::smoothed`].
    pub(crate) fn complete(&mut self, crease_degrees: f32) -> Result<()> {
        self.check()?;
        if !(0.0..=180.0).contains(&crease_degrees) {
            return Err(Error::parameter("crease", format!("found {crease_degrees}, expected 0 to 180 degrees")));
        }
        normals::complete(self, crease_degrees);
        if !self.triangles.iter().all(|t| self.has_uvs(t)) {
            self.tangents.clear();
            self.project_uvs();
        }
        Ok(())
    }

    fn check(&self) -> Result<()> {
        let bad = |problem: String| Err(Error::parameter("mesh", problem));
        let n = self.positions.len();
        let [normals, tangents, uvs] = [self.normals.len(), self.tangents.len(), self.uvs.len()];
        for (what, found) in [("normals", normals), ("tangents", tangents), ("texture coordinates", uvs)] {
            if found != 0 && found != n {
                return bad(format!("found {found} {what} for {n} vertices"));
            }
        }
        if self.triangles.is_empty() {
            return bad("found no triangles".into());
        }
        if self.triangles.len() > MAX_TRIANGLES {
            return bad(format!("found {} triangles, more than the limit of {MAX_TRIANGLES}", self.triangles.len()));
        }
        if let Some(k) = self.triangles.iter().position(|t| t.iter().any(|&i| i as usize >= n)) {
            return bad(format!("triangle {k} has the vertices {:?}, but there are {n}", self.triangles[k]));
        }
        // Squared distances must stay finite in single precision.
        if let Some(k) = self.positions.iter().position(|p| !p.is_finite() || p.abs().max_element() > 1e15) {
            return bad(format!("vertex {k} is at {}, expected finite coordinates up to 1e15", self.positions[k]));
        }
        match self.uvs.iter().position(|uv| !uv.is_finite() && !uv.is_nan()) {
            Some(k) => bad(format!("vertex {k} has the texture coordinates {}, expected finite ones", self.uvs[k])),
            None => Ok(()),
        }
    }
}

/// A triangle mesh prepared for ray intersection.
#[derive(Debug, Clone)]
pub struct Mesh {
    vertices: Vec<Corner>,
    triangles: Vec<[u32; 3]>,
    bvh: Bvh,
    bounds: Ball,
    extent: [Vec3; 2],
}

impl Mesh {
    /// Checks and completes a mesh, with [`CREASE_DEGREES`] as crease angle.
    ///
    /// # Errors
    /// See [`Mesh::smoothed`].
    pub fn new(data: MeshData) -> Result<Self> {
        Self::smoothed(data, CREASE_DEGREES)
    }

    /// Checks and completes a mesh. Missing normals are averaged over adjacent triangles, on whichever side they face,
    /// across edges that bend by at most `crease_degrees`. Missing texture coordinates are projected along the main axes,
    /// with one repeat per bounding radius.
    ///
    /// # Errors
    /// [`Error::Parameter`] if an index is out of range, a number is not finite, a list has the wrong length, the
    /// crease angle is outside 0..180, or there are no triangles.
    pub fn smoothed(mut data: MeshData, crease_degrees: f32) -> Result<Self> {
        data.complete(crease_degrees)?;
        if data.tangents.is_empty() {
            tangents::generate(&mut data);
        }
        let corners: Vec<_> = data.triangles.iter().map(|t| t.map(|i| data.positions[i as usize])).collect();
        let vertex = |i: usize| Corner {
            position: data.positions[i],
            normal: data.normals[i].normalize_or(Vec3::Y),
            tangent: data.tangents[i].truncate(),
            handedness: data.tangents[i].w,
            uv: data.uvs[i],
        };
        Ok(Self {
            vertices: (0..data.positions.len()).map(vertex).collect(),
            bvh: Bvh::new(&corners),
            bounds: Ball::around(&data.positions),
            extent: extent(&data.positions),
            triangles: data.triangles,
        })
    }

    /// The number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// Its vertices and triangles, with normals, tangents and texture coordinates.
    pub fn data(&self) -> MeshData {
        let tangent = |v: &Corner| v.tangent.extend(v.handedness);
        MeshData {
            positions: self.vertices.iter().map(|v| v.position).collect(),
            normals: self.vertices.iter().map(|v| v.normal).collect(),
            tangents: self.vertices.iter().map(tangent).collect(),
            uvs: self.vertices.iter().map(|v| v.uv).collect(),
            triangles: self.triangles.clone(),
        }
    }

    /// The corner positions of all triangles.
    pub fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> {
        self.triangles.iter().map(|t| t.map(|i| self.vertices[i as usize].position))
    }

    /// The intersection of a ray with the plane of a triangle.
    pub(super) fn plane(&self, ray: &Ray, triangle: u32) -> Option<Intersection> {
        let [a, b, c] = self.triangles[triangle as usize].map(|i| self.vertices[i as usize].position);
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(ac);
        let t = (a - ray.origin).dot(normal) / ray.direction.dot(normal);
        let p = ray.origin + ray.direction * t - a;
        let weights = Vec2::new(p.cross(ac).dot(normal), ab.cross(p).dot(normal)) / normal.length_squared();
        (t > 0.0 && weights.is_finite()).then_some(Intersection { t, triangle, u: weights.x, v: weights.y })
    }

    /// The point of a hit on its triangle.
    #[inline(always)]
    pub(super) fn place(&self, hit: &Intersection) -> Place {
        let corners = self.triangles[hit.triangle as usize].map(|i| self.vertices[i as usize]);
        let [a, b, c] = corners.map(|corner| corner.position.abs());
        Place { corners, weights: Vec2::new(hit.u, hit.v), reach: a.max(b).max(c) }
    }
}

impl Traced for Mesh {
    fn closest(&self, ray: &Ray, t_max: f32) -> Option<Intersection> {
        self.bvh.closest(ray, t_max)
    }

    fn closest_of(&self, bundle: &mut Bundle, triangles: &mut Triangles) -> u16 {
        self.bvh.closest_of(bundle, triangles)
    }

    fn occluded_of(&self, bundle: &Bundle) -> u16 {
        self.bvh.occluded_of(bundle)
    }

    fn surface(&self, _ray: &Ray, at: &Intersection) -> Surface {
        Surface::Triangle(self.place(at))
    }

    fn beside(&self, ray: &Ray, other: &Intersection) -> Option<Intersection> {
        self.plane(ray, other.triangle)
    }

    fn extent(&self) -> [Vec3; 2] {
        self.extent
    }

    fn bounds(&self) -> Ball {
        self.bounds
    }
}

#[cfg(test)]
mod tests {
    use super::super::hit::Hit;
    use super::*;

    fn square() -> MeshData {
        MeshData {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
            normals: Vec::new(),
            tangents: Vec::new(),
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    fn look(mesh: &Mesh, from: Vec3, direction: Vec3) -> Hit {
        let hit = mesh.closest(&Ray { origin: from, direction }, f32::INFINITY).unwrap();
        mesh.place(&hit).surface(-direction)
    }

    #[test]
    fn hits_have_position_uv_and_frame() {
        let mesh = Mesh::new(square()).unwrap();
        let hit = look(&mesh, Vec3::new(0.25, 0.5, 3.0), -Vec3::Z);
        assert!((hit.position - Vec3::new(0.25, 0.5, 0.0)).length() < 1e-6);
        assert!((hit.uv - Vec2::new(0.25, 0.5)).length() < 1e-6);
        assert_eq!((hit.normal, hit.geometric, hit.tangent, hit.handedness), (Vec3::Z, Vec3::Z, Vec3::X, 1.0));
        let behind = look(&mesh, Vec3::new(0.25, 0.5, -3.0), Vec3::Z);
        assert_eq!(behind.geometric, -Vec3::Z);
    }

    #[test]
    fn mirrored_texture_coordinates_turn_the_handedness() {
        let mut data = square();
        data.uvs.iter_mut().for_each(|uv| uv.y = -uv.y);
        let hit = look(&Mesh::new(data).unwrap(), Vec3::new(0.25, 0.5, 3.0), -Vec3::Z);
        assert_eq!((hit.tangent, hit.handedness), (Vec3::X, -1.0));
    }

    #[test]
    fn missing_texture_coordinates_are_projected_without_smearing() {
        let mut data = square();
        data.uvs.clear();
        let back = Mat4::from_rotation_x(1.57) * Mat4::from_scale(Vec3::splat(2.0));
        data.append(&MeshData { uvs: Vec::new(), ..square() }, back).unwrap();
        let mesh = Mesh::new(data).unwrap();
        for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|i| mesh.vertices[i as usize])) {
            let edge = |to: Corner| to.position - a.position;
            let turn = |to: Corner| to.uv - a.uv;
            let world = edge(b).cross(edge(c)).length();
            let texture = turn(b).perp_dot(turn(c)) * mesh.bounds.radius.powi(2);
            assert!(texture > 0.55 * world && texture < 1.01 * world, "{texture} {world}");
        }
    }

    #[test]
    fn mirroring_preserves_the_outside() {
        let mut data = MeshData::default();
        data.append(&square(), Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0))).unwrap();
        let hit = look(&Mesh::new(data).unwrap(), Vec3::new(-0.5, 0.5, 3.0), -Vec3::Z);
        assert_eq!(hit.normal, Vec3::Z);
        assert!(MeshData::default().append(&square(), Mat4::ZERO).is_err());
    }

    #[test]
    fn invalid_meshes_are_errors() {
        let message = |change: &dyn Fn(&mut MeshData)| {
            let mut data = square();
            change(&mut data);
            Mesh::new(data).unwrap_err().to_string()
        };
        assert!(message(&|d| d.triangles[1][2] = 4).contains("triangle 1"));
        assert!(message(&|d| d.positions[3].x = f32::NAN).contains("vertex 3"));
        assert!(message(&|d| d.uvs[2].y = f32::INFINITY).contains("texture"));
        assert!(message(&|d| d.uvs.truncate(2)).contains("2 texture coordinates for 4"));
        assert!(message(&|d| d.triangles.clear()).contains("no triangles"));
    }
}
