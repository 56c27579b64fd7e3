//! Triangles with their neighbours, repaired or refused.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use crate::{Error, Result};

/// An oriented surface of triangles, each flat in a frame of its own.
#[derive(Debug, Clone)]
pub(super) struct Mesh {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[usize; 3]>,
    /// The number of the triangle that each was made from.
    pub origin: Vec<usize>,
    /// Beyond the edge from corner k to corner k + 1: the triangle, and the number of the edge there.
    pub across: Vec<[Option<(usize, usize)>; 3]>,
    /// The connected part that a triangle belongs to.
    pub part: Vec<usize>,
}

/// Triangles whose area is a smaller share of the square of their longest edge have no plane.
const FLAT: f64 = 1e-7;

/// Corners that are nearer to each other than this share of the mesh's size are one.
const EQUAL: f64 = 1e-6;

/// Points, each once.
struct Vertices {
    positions: Vec<DVec3>,
    /// The points in cells as wide as what is equal.
    cells: BTreeMap<[i64; 3], usize>,
    low: DVec3,
    width: f64,
}

impl Vertices {
    fn new<'a>(points: impl Iterator<Item = &'a DVec3> + Clone) -> Self {
        let low = points.clone().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = points.fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        let width = ((high - low).max_element() * EQUAL).max(f64::MIN_POSITIVE);
        Self { positions: Vec::new(), cells: BTreeMap::new(), low, width }
    }

    /// The number of a point, which is new if none is equal.
    fn index(&mut self, point: DVec3) -> usize {
        let cell = ((point - self.low) / self.width).floor().to_array().map(|v| v as i64);
        let around = (0..27).map(|k| [cell[0] + k % 3 - 1, cell[1] + k / 3 % 3 - 1, cell[2] + k / 9 - 1]);
        let near = around.filter_map(|cell| self.cells.get(&cell).copied());
        let equal = near.filter(|index| (self.positions[*index] - point).length() <= self.width).min();
        equal.unwrap_or_else(|| {
            self.positions.push(point);
            self.cells.insert(cell, self.positions.len() - 1);
            self.positions.len() - 1
        })
    }
}

impl Mesh {
    /// Triangles from their corners. Equal corners become one; triangles without area are left out; orientations are made the
    /// same. What was repaired is told by `warn`.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming an edge with more than two triangles, or if the surface has one side only, or no area.
    pub(super) fn new(corners: &[[DVec3; 3]], warn: &dyn Fn(&str)) -> Result<Self> {
        if corners.iter().flatten().any(|p| !p.is_finite()) {
            return Err(Error::non_finite("the mesh"));
        }
        let mut vertices = Vertices::new(corners.iter().flatten());
        let mut triangles = Vec::new();
        let mut origin = Vec::new();
        for (number, corners) in corners.iter().enumerate() {
            let [a, b, c] = *corners;
            let longest = [a - b, b - c, c - a].iter().map(|e| e.length_squared()).fold(0.0, f64::max);
            let indices = corners.map(|p| vertices.index(p));
            let is_flat = (b - a).cross(c - a).length() <= FLAT * longest;
            if !is_flat && indices[0] != indices[1] && indices[1] != indices[2] && indices[2] != indices[0] {
                triangles.push(indices);
                origin.push(number);
            }
        }
        let left_out = corners.len() - triangles.len();
        if left_out > 0 {
            warn(&format!("{left_out} triangles without area are left out"));
        }
        if triangles.is_empty() {
            return Err(Error::parameter("mesh", "has no triangle with an area"));
        }
        let mut mesh = Self { positions: vertices.positions, triangles, origin, across: vec![], part: vec![] };
        mesh.connect()?;
        let turned = mesh.orient()?;
        if turned > 0 {
            warn(&format!("{turned} triangles are turned over, to face the same side as their neighbours"));
            mesh.connect()?;
        }
        mesh.split();
        Ok(mesh)
    }

    /// Gives every fan of triangles around a vertex a vertex of its own, where parts only touch.
    fn split(&mut self) {
        let mut first: Vec<usize> = (0..3 * self.triangles.len()).collect();
        fn root(first: &mut [usize], mut corner: usize) -> usize {
            while first[corner] != corner {
                first[corner] = first[first[corner]];
                corner = first[corner];
            }
            corner
        }
        for triangle in 0..self.triangles.len() {
            for edge in 0..3 {
                let Some((other, back)) = self.across[triangle][edge] else { continue };
                for (here, there) in [(edge, (back + 1) % 3), ((edge + 1) % 3, back)] {
                    let (a, b) = (root(&mut first, 3 * triangle + here), root(&mut first, 3 * other + there));
                    first[a.max(b)] = a.min(b);
                }
            }
        }
        let mut taken = vec![None; self.positions.len()];
        for corner in 0..first.len() {
            let (fan, vertex) = (root(&mut first, corner), self.triangles[corner / 3][corner % 3]);
            if fan != corner {
                self.triangles[corner / 3][corner % 3] = self.triangles[fan / 3][fan % 3];
            } else if taken[vertex].replace(fan).is_some() {
                self.positions.push(self.positions[vertex]);
                self.triangles[corner / 3][corner % 3] = self.positions.len() - 1;
            }
        }
    }

    /// Finds what is across every edge.
    fn connect(&mut self) -> Result<()> {
        let mut edges: BTreeMap<[usize; 2], Vec<(usize, usize)>> = BTreeMap::new();
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                edges.entry([a.min(b), a.max(b)]).or_default().push((triangle, k));
            }
        }
        self.across = vec![[None; 3]; self.triangles.len()];
        for (ends, sides) in edges {
            match sides[..] {
                [_] => {}
                [a, b] if a.0 != b.0 => {
                    self.across[a.0][a.1] = Some(b);
                    self.across[b.0][b.1] = Some(a);
                }
                _ => {
                    let [a, b] = ends.map(|end| self.positions[end]);
                    let count = sides.len();
                    let problem = format!("{count} triangles meet at the edge from {a} to {b}, expected two at most");
                    return Err(Error::parameter("mesh", problem));
                }
            }
        }
        Ok(())
    }

    /// Turns triangles over until neighbours face the same side, and numbers the connected parts. Returns how many were turned.
    fn orient(&mut self) -> Result<usize> {
        let count = self.triangles.len();
        let mut turned = vec![None; count];
        self.part = vec![0; count];
        let mut parts = 0;
        for first in 0..count {
            if turned[first].is_some() {
                continue;
            }
            turned[first] = Some(false);
            let mut open = vec![first];
            while let Some(triangle) = open.pop() {
                self.part[triangle] = parts;
                for k in 0..3 {
                    let Some((other, edge)) = self.across[triangle][k] else { continue };
                    let same = self.triangles[triangle][k] == self.triangles[other][edge];
                    let wanted = turned[triangle] != Some(same);
                    match turned[other] {
                        None => {
                            turned[other] = Some(wanted);
                            open.push(other);
                        }
                        Some(found) if found != wanted => {
                            return Err(Error::parameter("mesh", "has one side only, like a Moebius strip"));
                        }
                        Some(_) => {}
                    }
                }
            }
            parts += 1;
        }
        let all: Vec<usize> = (0..count).filter(|triangle| turned[*triangle] == Some(true)).collect();
        all.iter().for_each(|triangle| self.triangles[*triangle].swap(1, 2));
        Ok(all.len())
    }

    /// The corners of a triangle in its plane: the first at the origin, the second on the positive x axis.
    pub(super) fn flat(&self, triangle: usize) -> [DVec2; 3] {
        let [a, b, c] = self.triangles[triangle].map(|corner| self.positions[corner]);
        let (ab, ac) = (b - a, c - a);
        let along = ab.length();
        let x = ab.dot(ac) / along;
        [DVec2::ZERO, DVec2::new(along, 0.0), DVec2::new(x, ab.cross(ac).length() / along)]
    }

    /// The direction of an edge in the plane of its triangle: its angle from the x axis.
    pub(super) fn edge_angle(&self, triangle: usize, edge: usize) -> f64 {
        let corners = self.flat(triangle);
        let along = corners[(edge + 1) % 3] - corners[edge];
        libm::atan2(along.y, along.x)
    }

    /// The x axis of a triangle's plane, its y axis and its normal.
    pub(super) fn frame(&self, triangle: usize) -> [DVec3; 3] {
        let [a, b, c] = self.triangles[triangle].map(|corner| self.positions[corner]);
        let x = (b - a).normalize();
        let normal = (b - a).cross(c - a).normalize();
        [x, normal.cross(x), normal]
    }

    pub(super) fn area(&self, triangle: usize) -> f64 {
        let [_, b, c] = self.flat(triangle);
        0.5 * b.x * c.y
    }

    /// The angle of a triangle at a corner.
    pub(super) fn corner_angle(&self, triangle: usize, corner: usize) -> f64 {
        let corners = self.flat(triangle);
        let (a, b) = (corners[(corner + 1) % 3] - corners[corner], corners[(corner + 2) % 3] - corners[corner]);
        libm::atan2(a.perp_dot(b).abs(), a.dot(b))
    }

    /// The same surface with a triangle fan over every hole.
    pub(super) fn closed(&self) -> Self {
        let mut corners: Vec<[usize; 3]> = self.triangles.clone();
        let mut positions = self.positions.clone();
        // From each open edge to the next one at its end
        let mut seen = vec![[false; 3]; self.triangles.len()];
        for triangle in 0..self.triangles.len() {
            for k in 0..3 {
                if self.across[triangle][k].is_some() || seen[triangle][k] {
                    continue;
                }
                let mut edges = Vec::new();
                let mut at = (triangle, k);
                while !seen[at.0][at.1] {
                    seen[at.0][at.1] = true;
                    edges.push([self.triangles[at.0][at.1], self.triangles[at.0][(at.1 + 1) % 3]]);
                    at = self.next_open(at);
                }
                let middle = edges.iter().map(|[a, _]| self.positions[*a]).sum::<DVec3>() / edges.len() as f64;
                // away from the plane of the hole, so that no triangle is flat
                let normal = edges.iter().map(|e| (self.positions[e[0]] - middle).cross(self.positions[e[1]] - middle));
                let normal = normal.sum::<DVec3>().normalize_or(DVec3::Z);
                let size = edges.iter().map(|[a, b]| (self.positions[*a] - self.positions[*b]).length()).sum::<f64>();
                positions.push(middle - normal * size * 0.01);
                corners.extend(edges.iter().map(|[a, b]| [*b, *a, positions.len() - 1]));
            }
        }
        let origin = (0..corners.len()).map(|k| self.origin.get(k).copied().unwrap_or(usize::MAX)).collect();
        let mut closed = Self { positions, triangles: corners, origin, across: vec![], part: vec![] };
        // the surface was manifold, and so is it with its holes closed, unless two of them touch
        if closed.connect().is_err() || closed.orient().is_err() {
            return self.clone();
        }
        closed
    }

    /// The open edge that begins where this one ends.
    fn next_open(&self, (triangle, edge): (usize, usize)) -> (usize, usize) {
        let mut at = (triangle, (edge + 1) % 3);
        while let Some((other, back)) = self.across[at.0][at.1] {
            at = (other, (back + 1) % 3);
        }
        at
    }
}
