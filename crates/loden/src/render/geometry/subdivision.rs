//! Catmull-Clark subdivision surfaces.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use crate::render::MeshData;
use crate::{Error, Result};

/// A semi-sharp crease.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crease {
    /// The vertices of the edge.
    pub edge: [u32; 2],
    /// Number of subdivision steps for which the edge is sharp; fractions blend.
    pub sharpness: f32,
}

/// The control mesh of a subdivision surface.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ControlMesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// The vertices of each face, counter-clockwise seen from outside.
    pub faces: Vec<Vec<u32>>,
    /// Texture coordinates of the corners of all faces, concatenated; empty if there are none.
    pub uvs: Vec<Vec2>,
    /// Indices of faces that are not drawn.
    pub holes: Vec<u32>,
    /// Creases; a vertex where three or more meet is sharp.
    pub creases: Vec<Crease>,
    /// Vertices that subdivision does not move.
    pub corners: Vec<u32>,
}

/// Maximum number of faces.
const MAX_FACES: usize = 1 << 18;

/// Subdivides a mesh `levels` times, or [`max_levels`] times if that is less, and triangulates it.
///
/// # Model
/// A face point is the mean F of the face. An edge point is the mean of the end points and the two face points, or the
/// midpoint R of a sharp or boundary edge. A vertex of valence n moves to (F + 2 R + (n - 3) P) / n, with means F and R
/// over its faces and edges; on a crease it moves to (a + 6 P + b) / 8.
///
/// # Limits
/// Vertices are those of the last level, not of the limit surface. Normals are averages over faces; across edges that
/// are still sharp, only of faces within 40 degrees. Texture coordinates are subdivided linearly.
///
/// # References
/// catmull1978, derose1998 (section 3, creases)
///
/// # Errors
/// [`Error::Parameter`] for a vertex or face index out of range, or a list of the wrong length.
pub fn subdivide(control: &ControlMesh, levels: u32) -> Result<MeshData> {
    let mut level = Level::new(control)?;
    for _ in 0..levels.min(max_levels(control)) {
        level = level.next();
    }
    Ok(level.triangles())
}

/// How often a mesh can be subdivided before it has more than 262 144 faces.
pub fn max_levels(control: &ControlMesh) -> u32 {
    // The first level has a face for each corner, and each level after it four times as many.
    let first: usize = control.faces.iter().map(Vec::len).sum();
    (MAX_FACES / first.max(1)).checked_ilog2().map_or(0, |doublings| 1 + doublings / 2)
}

/// A mesh after some steps of subdivision.
struct Level {
    positions: Vec<Vec3>,
    faces: Vec<Face>,
    sharpness: HashMap<[u32; 2], f32>,
    is_corner: Vec<bool>,
}

#[derive(Clone)]
struct Face {
    corners: Vec<u32>,
    uvs: Vec<Vec2>,
    hidden: bool,
}

/// Sums over the neighbourhood of a vertex.
#[derive(Clone, Copy, Default)]
struct Neighbourhood {
    faces: usize,
    face_points: Vec3,
    edges: usize,
    middles: Vec3,
    sharp: usize,
    sharpness: f32,
    /// Sum of the far ends of sharp edges.
    sharp_ends: Vec3,
}

struct Edge {
    ends: [u32; 2],
    faces: usize,
    face_points: Vec3,
}

fn key(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

impl Level {
    fn new(control: &ControlMesh) -> Result<Self> {
        let bad = |problem: String| Err(Error::parameter("subdivision mesh", problem));
        let count = control.positions.len();
        let corners: usize = control.faces.iter().map(Vec::len).sum();
        if !control.uvs.is_empty() && control.uvs.len() != corners {
            return bad(format!("found {} texture coordinates for {corners} corners", control.uvs.len()));
        }
        if let Some(k) = control.faces.iter().position(|f| f.len() < 3 || f.iter().any(|&i| i as usize >= count)) {
            return bad(format!("face {k} has the vertices {:?}, expected at least 3 of 0..{count}", control.faces[k]));
        }
        let mut uvs = &control.uvs[..];
        let mut faces = Vec::with_capacity(control.faces.len());
        for corners in &control.faces {
            let (own, rest) = uvs.split_at(if uvs.is_empty() { 0 } else { corners.len() });
            uvs = rest;
            faces.push(Face { corners: corners.clone(), uvs: own.to_vec(), hidden: false });
        }
        for &hole in &control.holes {
            match faces.get_mut(hole as usize) {
                Some(face) => face.hidden = true,
                None => return bad(format!("the hole {hole} is not a face (there are {})", control.faces.len())),
            }
        }
        let mut is_corner = vec![false; count];
        for &vertex in &control.corners {
            match is_corner.get_mut(vertex as usize) {
                Some(corner) => *corner = true,
                None => return bad(format!("the corner {vertex} is not a vertex (there are {count})")),
            }
        }
        let sharpness = control.creases.iter().map(|c| (key(c.edge[0], c.edge[1]), c.sharpness)).collect();
        Ok(Self { positions: control.positions.clone(), faces, sharpness, is_corner })
    }

    /// The edges in the order of the faces, and their indices by vertices.
    fn edges(&self, face_points: &[Vec3]) -> (Vec<Edge>, HashMap<[u32; 2], u32>) {
        let mut edges: Vec<Edge> = Vec::new();
        let mut index = HashMap::new();
        for (face, point) in self.faces.iter().zip(face_points) {
            for (a, b) in pairs(&face.corners) {
                let at = *index.entry(key(a, b)).or_insert_with(|| {
                    edges.push(Edge { ends: key(a, b), faces: 0, face_points: Vec3::ZERO });
                    edges.len() as u32 - 1
                });
                edges[at as usize].faces += 1;
                edges[at as usize].face_points += *point;
            }
        }
        (edges, index)
    }

    /// Sharpness of an edge; a boundary is infinitely sharp.
    fn sharp(&self, edge: &Edge) -> f32 {
        if edge.faces == 2 { self.sharpness.get(&edge.ends).copied().unwrap_or(0.0) } else { f32::INFINITY }
    }

    /// One step of subdivision.
    fn next(&self) -> Self {
        // Compute face points
        let mean = |face: &Face| {
            face.corners.iter().map(|&i| self.positions[i as usize]).sum::<Vec3>() / face.corners.len() as f32
        };
        let face_points: Vec<Vec3> = self.faces.iter().map(mean).collect();
        // Move the vertices
        let (edges, index) = self.edges(&face_points);
        let around = self.around(&edges, &face_points);
        let mut positions: Vec<Vec3> = (0..self.positions.len()).map(|i| self.new_position(i, &around[i])).collect();
        // Compute edge points and the sharpness of the edge halves
        let first_edge = positions.len() as u32;
        let mut sharpness = HashMap::new();
        for (k, edge) in edges.iter().enumerate() {
            let [a, b] = edge.ends.map(|i| self.positions[i as usize]);
            let (middle, sharp) = (0.5 * (a + b), self.sharp(edge));
            let smooth = (a + b + edge.face_points) / 4.0;
            positions.push(if sharp >= 1.0 { middle } else { smooth.lerp(middle, sharp) });
            if edge.faces == 2 && sharp > 1.0 {
                let halves = edge.ends.map(|end| (key(end, first_edge + k as u32), sharp - 1.0));
                sharpness.extend(halves);
            }
        }
        // Split each face into quadrilaterals around its face point
        let first_face = positions.len() as u32;
        positions.extend(&face_points);
        let mut faces = Vec::with_capacity(4 * self.faces.len());
        for (k, face) in self.faces.iter().enumerate() {
            let n = face.corners.len();
            let edge = |i: usize| first_edge + index[&key(face.corners[i], face.corners[(i + 1) % n])];
            let centre = face.uvs.iter().sum::<Vec2>() / n as f32;
            let half = |i: usize| 0.5 * (face.uvs[i] + face.uvs[(i + 1) % n]);
            for i in 0..n {
                let before = (i + n - 1) % n;
                let corners = vec![face.corners[i], edge(i), first_face + k as u32, edge(before)];
                let uvs =
                    if face.uvs.is_empty() { Vec::new() } else { vec![face.uvs[i], half(i), centre, half(before)] };
                faces.push(Face { corners, uvs, hidden: face.hidden });
            }
        }
        let mut is_corner = self.is_corner.clone();
        is_corner.resize(positions.len(), false);
        Self { positions, faces, sharpness, is_corner }
    }

    fn around(&self, edges: &[Edge], face_points: &[Vec3]) -> Vec<Neighbourhood> {
        let mut around = vec![Neighbourhood::default(); self.positions.len()];
        for (face, point) in self.faces.iter().zip(face_points) {
            for &i in &face.corners {
                around[i as usize].faces += 1;
                around[i as usize].face_points += *point;
            }
        }
        for edge in edges {
            let [a, b] = edge.ends.map(|i| self.positions[i as usize]);
            let sharp = self.sharp(edge);
            for (end, other) in [(edge.ends[0], b), (edge.ends[1], a)] {
                let vertex = &mut around[end as usize];
                vertex.edges += 1;
                vertex.middles += 0.5 * (a + b);
                if sharp > 0.0 {
                    vertex.sharp += 1;
                    vertex.sharpness += sharp;
                    vertex.sharp_ends += other;
                }
            }
        }
        around
    }

    /// The new position of a vertex.
    fn new_position(&self, vertex: usize, around: &Neighbourhood) -> Vec3 {
        let p = self.positions[vertex];
        // A vertex with a single face is a corner of the surface.
        if self.is_corner[vertex] || around.faces < 2 && around.edges > 0 || around.edges == 0 || around.sharp > 2 {
            return p;
        }
        let n = around.edges as f32;
        let smooth = (around.face_points / around.faces as f32 + 2.0 * around.middles / n + (n - 3.0) * p) / n;
        if around.sharp < 2 {
            return smooth;
        }
        let crease = (around.sharp_ends + 6.0 * p) / 8.0;
        smooth.lerp(crease, (around.sharpness / 2.0).min(1.0))
    }

    /// Triangulates the visible faces, with normals.
    fn triangles(&self) -> MeshData {
        let shown = || self.faces.iter().filter(|face| !face.hidden);
        let area = |face: &Face| {
            let p = |i: usize| self.positions[face.corners[i] as usize];
            let fan = (1..face.corners.len() - 1).map(|i| (p(i) - p(0)).cross(p(i + 1) - p(0)));
            fan.sum::<Vec3>()
        };
        let mut of_vertex: Vec<Vec<Vec3>> = vec![Vec::new(); self.positions.len()];
        for face in shown() {
            let area = area(face);
            face.corners.iter().for_each(|&i| of_vertex[i as usize].push(area));
        }
        let mut on_crease = vec![false; self.positions.len()];
        self.sharpness.keys().flatten().for_each(|&i| {
            if let Some(on) = on_crease.get_mut(i as usize) {
                *on = true;
            }
        });
        let mut data = MeshData::default();
        for face in shown() {
            let own = area(face).normalize_or_zero();
            let first = data.positions.len() as u32;
            for (k, &i) in face.corners.iter().enumerate() {
                let i = i as usize;
                let near = |n: &&Vec3| !on_crease[i] || n.normalize_or_zero().dot(own) > 0.766;
                data.positions.push(self.positions[i]);
                data.normals.push(of_vertex[i].iter().filter(near).sum::<Vec3>().normalize_or(Vec3::Z));
                data.uvs.extend(face.uvs.get(k));
            }
            data.triangles.extend((1..face.corners.len() as u32 - 1).map(|i| [first, first + i, first + i + 1]));
        }
        data
    }
}

/// The edges around a face.
fn pairs(corners: &[u32]) -> impl Iterator<Item = (u32, u32)> {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(&a, &b)| (a, b))
}

impl ControlMesh {
    /// Hides the faces at the boundary, as RenderMan does without `interpolateboundary`.
    pub fn hide_boundary(&mut self) {
        let mut count: HashMap<[u32; 2], usize> = HashMap::new();
        self.faces.iter().flat_map(|f| pairs(f)).for_each(|(a, b)| *count.entry(key(a, b)).or_default() += 1);
        let outer: std::collections::HashSet<u32> =
            count.iter().filter(|(_, faces)| **faces == 1).flat_map(|(ends, _)| *ends).collect();
        let at_boundary = |(k, face): (usize, &Vec<u32>)| face.iter().any(|i| outer.contains(i)).then_some(k as u32);
        self.holes.extend(self.faces.iter().enumerate().filter_map(at_boundary));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> ControlMesh {
        let positions = (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - 1.0);
        let faces: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y].repeat(6);
        ControlMesh {
            positions: positions.collect(),
            faces: faces.map(Vec::from).into(),
            uvs,
            ..ControlMesh::default()
        }
    }

    fn radii(data: &MeshData) -> (f32, f32) {
        let all = || data.positions.iter().map(|p| p.length());
        (all().fold(f32::INFINITY, f32::min), all().fold(0.0, f32::max))
    }

    #[test]
    fn a_cube_becomes_the_known_rounded_shape() {
        assert_eq!(max_levels(&cube()), 7);
        assert_eq!(subdivide(&cube(), 30).unwrap().triangles.len(), (2 * 24) << 12);
        let once = subdivide(&cube(), 1).unwrap();
        assert_eq!(once.triangles.len(), 48);
        // Corners move to (F + 2 R) / 3 = 5/9, edge points to 3/4 along two axes.
        let expected = [5.0 / 9.0 * 3f32.sqrt(), 0.75 * 2f32.sqrt()];
        assert!((radii(&once).0 - expected[0]).abs() < 1e-6 && (radii(&once).1 - expected[1]).abs() < 1e-6);
        let data = subdivide(&cube(), 4).unwrap();
        assert_eq!((data.triangles.len(), data.uvs.len()), (6 * 256 * 2, 6 * 256 * 4));
        for (p, n) in data.positions.iter().zip(&data.normals) {
            assert!(n.dot(p.normalize()) > 0.9, "{p} {n}");
        }
        // The limit of a corner is (9 P + 12 R' + 3 F') / 24, summed over three edges and faces: 1/2 of it.
        let along = |p: &Vec3| p.dot(Vec3::ONE.normalize());
        let tip = data.positions.iter().map(along).fold(0.0, f32::max);
        assert!((tip - 3f32.sqrt() * 0.5).abs() < 0.02, "{tip}");
    }

    #[test]
    fn sharp_edges_keep_a_cube() {
        let mut control = cube();
        let edges = control.faces.clone();
        let edges = edges.iter().flat_map(|f| pairs(f).collect::<Vec<_>>());
        control.creases = edges.map(|(a, b)| Crease { edge: [a, b], sharpness: 10.0 }).collect();
        let data = subdivide(&control, 3).unwrap();
        assert!((radii(&data).1 - 3f32.sqrt()).abs() < 1e-6);
        assert!(data.positions.iter().all(|p| (p.abs().max_element() - 1.0).abs() < 1e-6));
        assert!(data.normals.iter().all(|n| n.abs().max_element() > 0.999), "normals are not averaged across edges");
        control.creases.iter_mut().for_each(|c| c.sharpness = 0.5);
        assert!(radii(&subdivide(&control, 3).unwrap()).1 < 1.5);
    }

    #[test]
    fn boundaries_and_holes() {
        let mut control = cube();
        control.holes = vec![1];
        assert_eq!(subdivide(&control, 2).unwrap().triangles.len(), 5 * 16 * 2);
        control.holes.clear();
        control.faces.truncate(5);
        control.uvs.truncate(20);
        assert_eq!(subdivide(&control, 1).unwrap().triangles.len(), 5 * 4 * 2);
        control.hide_boundary();
        assert_eq!(control.holes, [0, 1, 2, 3], "all but the face opposite the missing one");
    }

    #[test]
    fn invalid_control_meshes_are_errors() {
        let bad = |change: &dyn Fn(&mut ControlMesh)| {
            let mut control = cube();
            change(&mut control);
            subdivide(&control, 2).unwrap_err().to_string()
        };
        assert!(bad(&|c| c.faces[2][1] = 8).contains("face 2"));
        assert!(bad(&|c| c.uvs.truncate(3)).contains("3 texture coordinates"));
        assert!(bad(&|c| c.holes = vec![6]).contains("hole 6"));
        assert!(bad(&|c| c.corners = vec![9]).contains("corner 9"));
    }
}
