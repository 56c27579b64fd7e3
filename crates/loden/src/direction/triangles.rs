//! Barycentric interpolation in a spherical Delaunay triangulation.

use delaunator::{EMPTY, Point, triangulate};
use glam::{DMat3, Mat3, Vec2, Vec3, Vec4};

use super::interpolate::Stencil;

/// Squares per side of the table of starting cells over the unit disk.
pub(crate) const GRID: usize = 128;

/// # Model
/// The stereographic projection from the nadir maps circles to circles, so the planar Delaunay triangulation of the
/// projected directions is the spherical one. A direction is located by walking from a nearby triangle across the edge
/// with the most negative weight; in a Delaunay triangulation this walk terminates. Below the measured region, the
/// hemisphere is divided into sectors between the meridians of its corners, which are walked like triangles.
#[derive(Debug, Clone)]
pub(super) struct Triangles {
    points: Vec<Vec3>,
    /// Triangles; then, if the measured region surrounds the normal, a sector for each of its edges.
    cells: Vec<Cell>,
    /// For each cell, the neighbour opposite each vertex; `u32::MAX` if there is none.
    neighbours: Vec<[u32; 3]>,
    triangles: usize,
    /// Starting cell for each square of the orthographic unit disk, modulo 65536, beyond which any start will do.
    start: Box<[u16; GRID * GRID]>,
    /// Edges of the measured region, counter-clockwise.
    hull: Vec<[u32; 2]>,
}

/// A triangle or sector; fills one cache line.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Cell {
    /// Samples at the corners; unused entries repeat the first.
    index: [u32; 4],
    /// Columns of the matrix that maps a direction to its weights, which are non-negative inside. For a triangle, it is
    /// the inverse of the matrix of corner directions; for a sector, it gives the weights on the meridian and the
    /// height below the plane of the edge. The fourth weight is zero.
    columns: [Vec4; 3],
}

/// The triangulation as plain tables, for renderers that interpolate by themselves.
#[derive(Debug, Clone)]
pub(crate) struct TriangleTables {
    /// Number of triangles; the cells after these are the sectors below the measured region.
    pub triangles: usize,
    /// The samples at the corners of each cell; of a sector the first two count.
    pub corners: Vec<[u32; 3]>,
    /// For each cell the matrix that maps a direction to its weights, row by row.
    pub rows: Vec<[f32; 9]>,
    /// For each cell the neighbours opposite its corners.
    pub neighbours: Vec<[u32; 3]>,
    /// Starting cell for each square of the orthographic unit disk: [`GRID`] x [`GRID`], y first.
    pub start: Vec<u16>,
}

impl Triangles {
    /// `None` if the samples do not surround the normal: directions outside need a search.
    pub(super) fn tables(&self) -> Option<TriangleTables> {
        let cells = || self.cells.iter();
        (self.cells.len() > self.triangles).then(|| TriangleTables {
            triangles: self.triangles,
            corners: cells().map(|cell| [0, 1, 2].map(|k| cell.index[k])).collect(),
            rows: cells().map(|cell| std::array::from_fn(|k| cell.columns[k % 3][k / 3])).collect(),
            neighbours: self.neighbours.clone(),
            start: self.start.to_vec(),
        })
    }

    pub(super) fn new(directions: &[Vec3]) -> Self {
        let plane: Vec<Point> = directions
            .iter()
            .map(|w| w.as_dvec3())
            .map(|w| Point { x: w.x / (1.0 + w.z), y: w.y / (1.0 + w.z) })
            .collect();
        let mesh = triangulate(&plane);
        let corners = |t: usize| [0, 1, 2].map(|k| mesh.triangles[3 * t + k] as u32);
        let across = |edge: usize| match mesh.halfedges[edge] {
            EMPTY => u32::MAX,
            twin => (twin / 3) as u32,
        };
        let cell =
            |t: usize| Cell { index: padded(corners(t)), columns: inverse(corners(t).map(|i| directions[i as usize])) };
        // half-edge k of a triangle runs from vertex k to k + 1, so it faces vertex k + 2
        let neighbours = |t: usize| [across(3 * t + 1), across(3 * t + 2), across(3 * t)];
        let triangles = mesh.triangles.len() / 3;
        let mut hull: Vec<[u32; 2]> =
            (0..mesh.hull.len()).map(|k| [mesh.hull[k] as u32, mesh.hull[(k + 1) % mesh.hull.len()] as u32]).collect();
        let side = |[a, b]: [u32; 2]| {
            let [a, b] = [a, b].map(|i| directions[i as usize].truncate());
            a.perp_dot(b)
        };
        if hull.iter().map(|&e| side(e)).sum::<f32>() < 0.0 {
            hull.iter_mut().for_each(|edge| edge.swap(0, 1));
            hull.reverse();
        }
        let surrounds = triangles > 0 && hull.iter().all(|&e| side(e) > 1e-6);
        let mut all = Self {
            points: directions.to_vec(),
            cells: (0..triangles).map(cell).collect(),
            neighbours: (0..triangles).map(neighbours).collect(),
            triangles,
            start: Box::new([0; GRID * GRID]),
            hull,
        };
        if surrounds {
            all.add_sectors();
        }
        if triangles > 0 {
            all.start = Box::new(std::array::from_fn(|square| all.start_of(square)));
        }
        all
    }

    fn add_sectors(&mut self) {
        let count = self.hull.len();
        for (i, [a, b]) in self.hull.clone().into_iter().enumerate() {
            let (p, q) = (self.points[a as usize], self.points[b as usize]);
            // for a direction d: d.perp_dot(q), p.perp_dot(d), and the distance outwards from the plane of the edge
            let rows = [Vec3::new(q.y, -q.x, 0.0), Vec3::new(-p.y, p.x, 0.0), -p.cross(q)];
            let has = |t: &Cell| t.index.contains(&a) && t.index.contains(&b);
            let faces_outside = |t: usize| {
                (0..3).any(|k| ![a, b].contains(&self.cells[t].index[k]) && self.neighbours[t][k] == u32::MAX)
            };
            let inside = (0..self.triangles).find(|&t| has(&self.cells[t]) && faces_outside(t));
            let sector = (self.triangles + i) as u32;
            if let Some(triangle) = inside {
                let vertex = self.cells[triangle].index[..3].iter().position(|&v| v != a && v != b).unwrap_or(0);
                self.neighbours[triangle][vertex] = sector;
            }
            let at = |k: usize| (self.triangles + k % count) as u32;
            let matrix = Mat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            self.cells.push(Cell { index: padded([a, b, a]), columns: columns(matrix) });
            self.neighbours.push([at(i + 1), at(i + count - 1), inside.map_or(u32::MAX, |t| t as u32)]);
        }
    }

    fn start_of(&self, square: usize) -> u16 {
        let p = Vec2::new((square % GRID) as f32, (square / GRID) as f32) * (2.0 / (GRID - 1) as f32) - Vec2::ONE;
        let w = p.extend((1.0 - p.length_squared()).max(0.0).sqrt()).normalize();
        let middle = |t: &Cell| t.index[..3].iter().map(|&i| self.points[i as usize]).sum::<Vec3>().normalize().dot(w);
        let best = (0..self.triangles).max_by(|&a, &b| middle(&self.cells[a]).total_cmp(&middle(&self.cells[b])));
        self.walk(w, best.unwrap_or(0)).0 as u16
    }

    /// Walks from cell `t` towards `w`: the last cell, and the unnormalised weights if `w` is inside it.
    fn walk(&self, w: Vec3, mut t: usize) -> (usize, Option<Vec4>) {
        // rounding errors could make the walk cycle on an edge: bound it by the number of cells
        for _ in 0..self.cells.len() {
            let weight = self.cells[t].weights(w);
            if is_inside(weight) {
                return (t, Some(weight));
            }
            match self.towards(t, weight) {
                Some(next) => t = next,
                None => return (t, None),
            }
        }
        (t, None)
    }

    /// The neighbour of a cell across the edge with the most negative weight of a direction.
    #[inline(always)]
    fn towards(&self, cell: usize, weight: Vec4) -> Option<usize> {
        let weight = weight.to_array();
        let lowest = if weight[0] < weight[1] { 0 } else { 1 };
        let lowest = if weight[lowest] < weight[2] { lowest } else { 2 };
        let next = self.neighbours[cell][lowest];
        (next != u32::MAX).then_some(next as usize)
    }

    /// Writes the stencil of `w` to `out`.
    #[inline(always)]
    pub(super) fn find(&self, w: Vec3, out: &mut Stencil) {
        let start = usize::from(self.start[(nearest_square(w.y) * GRID + nearest_square(w.x)) % (GRID * GRID)]);
        let Some(cell) = self.cells.get(start) else { return *out = self.nearest(w) };
        let weight = cell.weights(w);
        if is_inside(weight) {
            return self.write(start, weight, w, out);
        }
        self.find_by_walking(w, self.towards(start, weight), out);
    }

    #[inline(never)]
    fn find_by_walking(&self, w: Vec3, start: Option<usize>, out: &mut Stencil) {
        match start.map(|start| self.walk(w, start)) {
            Some((cell, Some(weight))) => self.write(cell, weight, w, out),
            _ => *out = self.outside(w),
        }
    }

    /// Writes the stencil of a direction with these weights in a cell.
    #[inline(always)]
    fn write(&self, cell: usize, weight: Vec4, w: Vec3, out: &mut Stencil) {
        if cell < self.triangles {
            return self.cells[cell].write(weight, out);
        }
        let weight = weight.max(Vec4::ZERO);
        let along = weight.y / (weight.x + weight.y).max(f32::MIN_POSITIVE);
        let [a, b, ..] = self.cells[cell].index;
        *out = self.on_edge([a, b], along, w.z);
    }

    /// The stencil between two samples at the edge of the measured region, for a direction with the cosine `cosine`.
    #[inline]
    fn on_edge(&self, [a, b]: [u32; 2], t: f32, cosine: f32) -> Stencil {
        // The great circle between two samples of a ring is above the ring: the cosine is interpolated, so that the
        // measured region ends at the ring.
        let fade = fade(cosine, (1.0 - t) * self.points[a as usize].z + t * self.points[b as usize].z);
        Stencil { index: [a, b, a, a], weight: [1.0 - t, t, 0.0, 0.0], count: 2, fade }
    }

    /// The stencil of the nearest point at the edge of a measured region that does not surround the normal.
    #[cold]
    fn outside(&self, w: Vec3) -> Stencil {
        let (edge, t) = self.nearest_on_hull(w);
        self.on_edge(self.hull[edge], t, w.z)
    }

    fn nearest_on_hull(&self, w: Vec3) -> (usize, f32) {
        let candidate = |(edge, &[a, b]): (usize, &[u32; 2])| {
            let (a, b) = (self.points[a as usize], self.points[b as usize]);
            let t = ((w - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            (edge, t, a.lerp(b, t).normalize().dot(w))
        };
        let best = self.hull.iter().enumerate().map(candidate).max_by(|a, b| a.2.total_cmp(&b.2));
        best.map_or((0, 0.0), |(edge, t, _)| (edge, t))
    }

    #[cold]
    fn nearest(&self, w: Vec3) -> Stencil {
        let best = (0..self.points.len()).max_by(|&a, &b| self.points[a].dot(w).total_cmp(&self.points[b].dot(w)));
        let best = best.unwrap_or(0);
        let i = best as u32;
        Stencil { index: [i; 4], weight: [1.0, 0.0, 0.0, 0.0], count: 1, fade: fade(w.z, self.points[best].z) }
    }
}

/// The index of the nearest of the [`GRID`] squares along -1..1, taken from the mantissa of a sum that has no room for
/// a fraction, which is cheaper than a conversion. Arbitrary for numbers outside.
#[inline(always)]
fn nearest_square(x: f32) -> usize {
    const HALF: f32 = (GRID - 1) as f32 / 2.0;
    ((x * HALF + HALF + (1u32 << 23) as f32).to_bits() as usize) % GRID
}

/// Whether a direction with these weights is in the cell, up to rounding.
#[inline(always)]
fn is_inside(weight: Vec4) -> bool {
    weight.cmpge(Vec4::splat(-1e-6)).all()
}

impl Cell {
    /// Unnormalised weights of a direction; the fourth is zero.
    #[inline(always)]
    fn weights(&self, w: Vec3) -> Vec4 {
        let [x, y, z] = self.columns;
        x * w.x + y * w.y + z * w.z
    }

    /// Writes the stencil of a direction inside a triangle.
    #[inline(always)]
    fn write(&self, weight: Vec4, out: &mut Stencil) {
        let weight = weight.max(Vec4::ZERO);
        out.index = self.index;
        out.weight = (weight / weight.element_sum()).into();
        (out.count, out.fade) = (3, 1.0);
    }
}

/// cos(theta) divided by its value at the edge, for directions below the edge.
pub(super) fn fade(cosine: f32, at_edge: f32) -> f32 {
    if at_edge > 1e-6 { (cosine / at_edge).clamp(0.0, 1.0) } else { 1.0 }
}

fn inverse(corners: [Vec3; 3]) -> [Vec4; 3] {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    columns(DMat3::from_cols(a, b, c).inverse().as_mat3())
}

fn columns(matrix: Mat3) -> [Vec4; 3] {
    [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|column| column.extend(0.0))
}

fn padded([a, b, c]: [u32; 3]) -> [u32; 4] {
    [a, b, c, a]
}
