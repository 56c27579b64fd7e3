//! A direction in every triangle that varies as little as possible.
//!
//! # Model
//! A direction is a complex number u in the frame of its triangle. Across an edge, frames turn by a known angle r; the field
//! minimises the sum over edges of w |u_g - exp(i r) u_f|^2, where w is the length of the edge over the distance of the
//! triangles' centres, for a given sum of area |u|^2. That is an eigenvector, found by inverse iteration; with strokes the
//! field also fits their directions and is the solution of one linear system. The index of a vertex is the number of turns
//! of the field around it; over a closed surface, indices add up to the Euler characteristic.
//!
//! # References
//! knoppel2013

use glam::DVec3;

use super::mesh::Mesh;
use crate::random::Stream;

/// Iterations of the eigenvector, and of each linear system.
const ITERATIONS: usize = 24;
const STEPS: usize = 4000;

/// The weight of a stroke against the smoothness around it.
const STROKE: f64 = 100.0;

/// The angle of a direction from the x axis of each triangle.
pub(super) struct Field(pub Vec<f64>);

/// A direction that the field follows near a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// The point.
    pub at: [f64; 3],
    /// The direction.
    pub along: [f64; 3],
}

type Complex = [f64; 2];

fn product([a, b]: Complex, [c, d]: Complex) -> Complex {
    [a * c - b * d, a * d + b * c]
}

/// The turn from the frame of a triangle to that beyond its edge.
pub(super) fn turn(mesh: &Mesh, triangle: usize, edge: usize, (other, back): (usize, usize)) -> f64 {
    // the edge runs the other way there
    mesh.edge_angle(other, back) + std::f64::consts::PI - mesh.edge_angle(triangle, edge)
}

/// The matrix of the energy.
struct Laplacian {
    /// For each triangle the three beyond its edges, with weights and turns of what is there to the frame here.
    links: Vec<[Option<(usize, f64, Complex)>; 3]>,
    diagonal: Vec<f64>,
}

impl Laplacian {
    fn new(mesh: &Mesh) -> Self {
        let centre = |t: usize| mesh.triangles[t].iter().map(|corner| mesh.positions[*corner]).sum::<DVec3>() / 3.0;
        let link = |triangle: usize, edge: usize| {
            let (other, back) = mesh.across[triangle][edge]?;
            let ends = [edge, (edge + 1) % 3].map(|k| mesh.positions[mesh.triangles[triangle][k]]);
            let middle = 0.5 * (ends[0] + ends[1]);
            let apart = (centre(triangle) - middle).length() + (centre(other) - middle).length();
            let turn = turn(mesh, other, back, (triangle, edge));
            Some((other, (ends[1] - ends[0]).length() / apart, [libm::cos(turn), libm::sin(turn)]))
        };
        let links: Vec<_> =
            (0..mesh.triangles.len()).map(|triangle| std::array::from_fn(|edge| link(triangle, edge))).collect();
        let sum =
            |links: &[Option<(usize, f64, Complex)>; 3]| links.iter().flatten().map(|(_, weight, _)| weight).sum();
        let diagonal = links.iter().map(sum).collect();
        Self { links, diagonal }
    }

    /// The product with `shift` added to the diagonal.
    fn apply(&self, shift: &[f64], of: &[Complex], to: &mut [Complex]) {
        for (i, out) in to.iter_mut().enumerate() {
            let own = self.diagonal[i] + shift[i];
            *out = of[i].map(|v| own * v);
            for (other, weight, turn) in self.links[i].iter().flatten() {
                let turned = product(*turn, of[*other]);
                (out[0], out[1]) = (out[0] - weight * turned[0], out[1] - weight * turned[1]);
            }
        }
    }

    /// Solves (L + shift) x = b by conjugate gradients, from `x`.
    fn solve(&self, shift: &[f64], b: &[Complex], x: &mut [Complex]) {
        let n = b.len();
        let dot = |a: &[Complex], b: &[Complex]| a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum::<f64>();
        let scaled = |r: &[Complex]| -> Vec<Complex> {
            (0..n).map(|i| r[i].map(|v| v / (self.diagonal[i] + shift[i]))).collect()
        };
        let mut product = vec![[0.0; 2]; n];
        self.apply(shift, x, &mut product);
        let mut r: Vec<Complex> = b.iter().zip(&product).map(|(b, p)| [b[0] - p[0], b[1] - p[1]]).collect();
        let mut z = scaled(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        let limit = 1e-16 * dot(b, b);
        for _ in 0..STEPS {
            if dot(&r, &r) <= limit {
                break;
            }
            self.apply(shift, &p, &mut product);
            let step = rz / dot(&p, &product);
            for i in 0..n {
                for k in 0..2 {
                    x[i][k] += step * p[i][k];
                    r[i][k] -= step * product[i][k];
                }
            }
            z = scaled(&r);
            let next = dot(&r, &z);
            let ratio = next / rz;
            rz = next;
            for (p, z) in p.iter_mut().zip(&z) {
                *p = [z[0] + ratio * p[0], z[1] + ratio * p[1]];
            }
        }
    }
}

impl Field {
    /// The smoothest field, or the one that follows strokes.
    pub(super) fn new(mesh: &Mesh, strokes: &[Stroke]) -> Self {
        let laplacian = Laplacian::new(mesh);
        let areas: Vec<f64> = (0..mesh.triangles.len()).map(|triangle| mesh.area(triangle)).collect();
        let mut random = Stream::new(1);
        let mut u: Vec<Complex> = areas.iter().map(|_| [0, 1].map(|_| f64::from(random.next()) - 0.5)).collect();
        let mean = areas.iter().sum::<f64>() / areas.len() as f64;
        let tiny: Vec<f64> = areas.iter().map(|area| 1e-6 * area / mean).collect();
        for _ in 0..ITERATIONS {
            let b: Vec<Complex> = u.iter().zip(&areas).map(|(u, area)| u.map(|v| v * area / mean)).collect();
            laplacian.solve(&tiny, &b, &mut u);
            normalise(mesh, &areas, &mut u);
        }
        if !strokes.is_empty() {
            let (mut shift, mut b) = (tiny, vec![[0.0; 2]; areas.len()]);
            for stroke in strokes {
                let triangle = nearest(mesh, DVec3::from_array(stroke.at));
                let [x, y, _] = mesh.frame(triangle);
                let along = DVec3::from_array(stroke.along);
                let (along, across) = (along.dot(x), along.dot(y));
                let length = along.hypot(across);
                if length > 0.0 {
                    let weight = STROKE * laplacian.diagonal[triangle].max(1e-9);
                    shift[triangle] += weight;
                    b[triangle] = [b[triangle][0] + weight * along / length, b[triangle][1] + weight * across / length];
                }
            }
            laplacian.solve(&shift, &b, &mut u);
        }
        Self(u.iter().map(|u| libm::atan2(u[1], u[0])).collect())
    }

    /// The index of the field at every vertex of a closed surface.
    pub(super) fn indices(&self, mesh: &Mesh) -> Vec<f64> {
        use std::f64::consts::TAU;
        let mut turns = vec![TAU; mesh.positions.len()];
        let mut used = vec![false; mesh.positions.len()];
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            for (k, corner) in corners.iter().enumerate() {
                turns[*corner] -= mesh.corner_angle(triangle, k);
                used[*corner] = true;
                // around the corner, from this triangle across the edge that ends there
                let edge = (k + 2) % 3;
                let Some(beyond) = mesh.across[triangle][edge] else { continue };
                let turn = self.0[beyond.0] - self.0[triangle] - turn(mesh, triangle, edge, beyond);
                turns[*corner] += turn - TAU * (turn / TAU).round();
            }
        }
        turns.iter().zip(used).map(|(turn, used)| if used { turn / TAU } else { 0.0 }).collect()
    }
}

/// Scales every connected part to the same mean square.
fn normalise(mesh: &Mesh, areas: &[f64], u: &mut [Complex]) {
    let parts = mesh.part.iter().max().map_or(0, |last| last + 1);
    let (mut squares, mut sizes) = (vec![0.0; parts], vec![0.0; parts]);
    for ((part, area), u) in mesh.part.iter().zip(areas).zip(u.iter()) {
        squares[*part] += area * (u[0] * u[0] + u[1] * u[1]);
        sizes[*part] += area;
    }
    for (part, u) in mesh.part.iter().zip(u) {
        let scale = (sizes[*part] / squares[*part].max(f64::MIN_POSITIVE)).sqrt();
        *u = u.map(|v| v * scale);
    }
}

/// The triangle whose centre is nearest to a point.
fn nearest(mesh: &Mesh, point: DVec3) -> usize {
    let distance = |triangle: usize| {
        let centre = mesh.triangles[triangle].iter().map(|corner| mesh.positions[*corner]).sum::<DVec3>() / 3.0;
        (centre - point).length_squared()
    };
    (0..mesh.triangles.len()).min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(0)
}
