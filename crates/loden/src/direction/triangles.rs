//! Barycentric interpolation in a spherical Delaunay triangulation.

use std::f32::consts::TAU;

use delaunator::{EMPTY, Point, triangulate};
use glam::{DMat3, Mat3A, Vec2, Vec3, Vec3A};

use super::interpolate::Stencil;

/// Cells per side of the table of starting triangles over the unit disk.
const GRID: usize = 64;

/// Azimuth bins of the table of edges of the measured region.
const BINS: usize = 256;

/// # Model
/// The stereographic projection from the nadir maps circles to circles, so the planar Delaunay triangulation
/// of the projected directions is the spherical one. A direction is located by walking from a nearby triangle
/// across the edge with the most negative weight, which ends in a Delaunay triangulation.
#[derive(Debug, Clone)]
pub(super) struct Triangles {
    points: Vec<Vec3>,
    triangles: Vec<Triangle>,
    /// Starting triangle of each cell of the orthographic unit disk; modulo 65536, where any start is good enough.
    start: Vec<u16>,
    /// Counter-clockwise edges of the measured region.
    hull: Vec<[u32; 2]>,
    /// The hull edge at the middle of each azimuth bin; empty if the hull does not surround the normal.
    hull_at: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Triangle {
    index: [u32; 3],
    /// The triangle across from each vertex, `u32::MAX` outside.
    neighbour: [u32; 3],
    /// The inverse of the matrix of corner directions, whose product with a direction is the weights.
    inverse: Mat3A,
}

impl Triangles {
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
        let triangles = (0..mesh.triangles.len() / 3).map(|t| Triangle {
            index: corners(t),
            // half-edge k of a triangle runs from vertex k to k + 1, so it faces vertex k + 2
            neighbour: [across(3 * t + 1), across(3 * t + 2), across(3 * t)],
            inverse: inverse(corners(t).map(|i| directions[i as usize])),
        });
        let mut hull: Vec<[u32; 2]> =
            (0..mesh.hull.len()).map(|k| [mesh.hull[k] as u32, mesh.hull[(k + 1) % mesh.hull.len()] as u32]).collect();
        let side = |[a, b]: [u32; 2]| {
            let [a, b] = [a, b].map(|i| directions[i as usize].truncate());
            a.perp_dot(b)
        };
        if hull.iter().map(|&e| side(e)).sum::<f32>() < 0.0 {
            hull.iter_mut().for_each(|edge| edge.swap(0, 1));
        }
        let surrounds = !mesh.triangles.is_empty() && hull.iter().all(|&e| side(e) > 1e-6);
        let mut all = Self {
            points: directions.to_vec(),
            triangles: triangles.collect(),
            start: Vec::new(),
            hull,
            hull_at: Vec::new(),
        };
        if surrounds {
            all.hull_at = (0..BINS).map(|k| all.hull_edge_at((k as f32 + 0.5) / BINS as f32 * TAU)).collect();
        }
        all.start =
            (0..if all.triangles.is_empty() { 0 } else { GRID * GRID }).map(|cell| all.start_of(cell)).collect();
        all
    }

    fn hull_edge_at(&self, phi: f32) -> u32 {
        let d = Vec2::from_angle(phi);
        let holds = |edge: &[u32; 2]| {
            let [a, b] = edge.map(|i| self.points[i as usize].truncate());
            a.perp_dot(d) >= 0.0 && d.perp_dot(b) >= 0.0
        };
        self.hull.iter().position(holds).unwrap_or(0) as u32
    }

    fn start_of(&self, cell: usize) -> u16 {
        let p = Vec2::new((cell % GRID) as f32 + 0.5, (cell / GRID) as f32 + 0.5) * (2.0 / GRID as f32) - Vec2::ONE;
        let w = p.extend((1.0 - p.length_squared()).max(0.0).sqrt()).normalize();
        let middle = |t: &Triangle| t.index.iter().map(|&i| self.points[i as usize]).sum::<Vec3>().normalize().dot(w);
        let best = (0..self.triangles.len())
            .max_by(|&a, &b| middle(&self.triangles[a]).total_cmp(&middle(&self.triangles[b])));
        self.walk(w, best.unwrap_or(0)).0 as u16
    }

    /// The last triangle on the walk from `t` towards `w`, and the unnormalised weights if `w` is inside.
    #[inline(always)]
    fn walk(&self, w: Vec3, mut t: usize) -> (usize, Option<Vec3A>) {
        // rounding could make the walk turn in a circle on an edge: it never needs more steps than triangles
        for _ in 0..self.triangles.len() {
            let triangle = &self.triangles[t];
            let weight = triangle.inverse * Vec3A::from(w);
            if weight.cmpge(Vec3A::splat(-1e-6)).all() {
                return (t, Some(weight.max(Vec3A::ZERO)));
            }
            let weight = weight.to_array();
            let lowest = if weight[0] < weight[1] { 0 } else { 1 };
            let lowest = if weight[lowest] < weight[2] { lowest } else { 2 };
            match triangle.neighbour[lowest] {
                u32::MAX => return (t, None),
                next => t = next as usize,
            }
        }
        (t, None)
    }

    #[inline(always)]
    pub(super) fn stencil(&self, w: Vec3) -> Stencil {
        if self.triangles.is_empty() {
            return self.nearest(w);
        }
        let cell = |x: f32| (((x + 1.0) * (GRID / 2) as f32) as usize).min(GRID - 1);
        let start = self.start[cell(w.y) * GRID + cell(w.x)] as usize;
        let (t, weight) = self.walk(w, start);
        let Some(weight) = weight else { return self.outside(w) };
        let weight = weight / weight.element_sum();
        let [a, b, c] = self.triangles[t].index;
        Stencil { index: [a, b, c, a], weight: [weight.x, weight.y, weight.z, 0.0], count: 3, fade: 1.0 }
    }

    /// The value at the edge of the measured region: on the same meridian, else the nearest.
    #[cold]
    fn outside(&self, w: Vec3) -> Stencil {
        let on_meridian = || {
            let phi = super::phi(w);
            let mut edge = *self.hull_at.get((phi * (BINS as f32 / TAU)) as usize)? as usize;
            let d = w.truncate();
            // the bin's edge can be off by a few where edges are shorter than bins
            for _ in 0..self.hull.len() {
                let [a, b] = self.hull[edge].map(|i| self.points[i as usize].truncate());
                let (left, right) = (a.perp_dot(d), d.perp_dot(b));
                if left >= 0.0 && right >= 0.0 {
                    return Some((edge, left / (left + right).max(f32::MIN_POSITIVE)));
                }
                edge = (edge + if left < 0.0 { self.hull.len() - 1 } else { 1 }) % self.hull.len();
            }
            None
        };
        let (edge, t) = on_meridian().unwrap_or_else(|| self.nearest_on_hull(w));
        let [a, b] = self.hull[edge];
        let at_edge = self.points[a as usize].lerp(self.points[b as usize], t).normalize();
        Stencil { index: [a, b, a, a], weight: [1.0 - t, t, 0.0, 0.0], count: 2, fade: fade(w.z, at_edge.z) }
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

/// cos(theta) over its value at the edge, for directions below the edge.
pub(super) fn fade(cosine: f32, at_edge: f32) -> f32 {
    if at_edge > 1e-6 { (cosine / at_edge).clamp(0.0, 1.0) } else { 1.0 }
}

fn inverse(corners: [Vec3; 3]) -> Mat3A {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    Mat3A::from(DMat3::from_cols(a, b, c).inverse().as_mat3())
}
