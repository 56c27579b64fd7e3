//! Quadrics and tori, intersected exactly.

mod roots;

use std::f32::consts::TAU;

use glam::{DVec3, Vec2, Vec3};

use super::bounds::Ball;
use super::bvh::{Bundle, Intersection, RAYS, Triangles};
use super::geometry::{Outline, Quadric};
use super::hit::{Hit, offset};
use super::ray::Ray;
use super::traced::{Surface, Traced};
use crate::Result;

/// A quadric or a torus, in object coordinates.
///
/// # Model
/// A ray meets x^2 + y^2 = a z^2 + b z + c at the roots of a quadratic, and a torus at those of a quartic. Roots are
/// computed in double precision, starting from the point of the ray nearest to the middle of the surface, sixteen
/// rays at a time. A root counts if its point belongs to the part of the surface selected by `z_min`, `z_max` and
/// `sweep`. The u and v of the point then give position, normal and tangent.
///
/// # Limits
/// Edges are widened by the rounding error, so that surfaces sharing an edge leave no gap.
#[derive(Debug, Clone, PartialEq)]
pub struct Revolved {
    quadric: Quadric,
    corners: [Vec2; 4],
    inside_out: bool,
    equation: Equation,
    /// Lowest and highest z, widened by rounding.
    z: [f32; 2],
    extent: [Vec3; 2],
}

/// The unbounded surface that a quadric is a part of.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Equation {
    /// x^2 + y^2 = a z^2 + b z + c.
    Round([f64; 3]),
    /// A plane of constant z, between two distances from the axis.
    Plane { z: f32, inner: f32, outer: f32 },
    /// A torus around the axis.
    Torus { major: f64, minor: f64 },
}

/// Angles are widened by this much, in radians.
const SLACK: f32 = 1e-6;

impl Revolved {
    /// Texture coordinates (u, v).
    pub const CORNERS: [Vec2; 4] = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];

    /// A quadric with texture coordinates interpolated from those at (u, v) = (0, 0), (1, 0), (0, 1), (1, 1).
    /// `inside_out` exchanges the two sides.
    ///
    /// # Errors
    /// See [`Quadric::check`].
    pub fn new(quadric: Quadric, corners: [Vec2; 4], inside_out: bool) -> Result<Self> {
        quadric.check()?;
        let (equation, [low, high]) = Equation::new(&quadric);
        let radius = equation.radius([low, high]);
        let extent = [Vec3::new(-radius, -radius, low), Vec3::new(radius, radius, high)];
        let slack = 2.0 * f32::EPSILON * low.abs().max(high.abs());
        let mut z = [low - slack, high + slack];
        if let Quadric::Sphere { radius, .. } = quadric {
            // Nothing is cut off at a pole.
            z = [
                if low <= -radius.abs() { f32::NEG_INFINITY } else { z[0] },
                if high >= radius.abs() { f32::INFINITY } else { z[1] },
            ];
        }
        Ok(Self { quadric, corners, inside_out, equation, z, extent })
    }

    /// What is revolved.
    pub fn quadric(&self) -> &Quadric {
        &self.quadric
    }

    /// Texture coordinates at (u, v) = (0, 0), (1, 0), (0, 1), (1, 1).
    pub fn corners(&self) -> [Vec2; 4] {
        self.corners
    }

    /// Whether its two sides are exchanged.
    pub fn is_inside_out(&self) -> bool {
        self.inside_out
    }

    /// The roots along the rays of a bundle, in rows of which so many are used, in no order; NaN where there is none.
    fn roots(&self, bundle: &Bundle) -> ([[f64; RAYS]; 4], usize) {
        let mut roots = [[f64::NAN; RAYS]; 4];
        let middle = 0.5 * (f64::from(self.extent[0].z) + f64::from(self.extent[1].z));
        let count = match self.equation {
            Equation::Round([a, b, c]) => {
                roots::round(bundle, &[a, b, c, middle], &mut roots);
                2
            }
            Equation::Plane { z, .. } => {
                let rays = bundle.origin[2].0.iter().zip(&bundle.direction[2].0);
                for (root, (origin, direction)) in roots[0].iter_mut().zip(rays) {
                    *root = (f64::from(z) - f64::from(*origin)) / f64::from(*direction);
                }
                1
            }
            Equation::Torus { major, minor } => {
                // Cut the rays to the cylinder around the torus, a little wider
                let wider = |radius: f64| radius.abs() * (1.0 + 1e-6);
                let mut parts = [[0.0; RAYS]; 2];
                roots::inside(bundle, wider(major.abs() + minor.abs()), wider(minor), &mut parts);
                let [near, far] = parts;
                for lane in (0..RAYS).filter(|&lane| near[lane] < far[lane]) {
                    let found = roots::torus(&bundle.ray(lane), [near[lane], far[lane]], major, minor);
                    roots.iter_mut().zip(found).for_each(|(row, root)| row[lane] = root);
                }
                4
            }
        };
        (roots, count)
    }

    /// Whether a point of the unbounded surface belongs to the quadric.
    #[inline]
    fn covers(&self, p: Vec3) -> bool {
        let along = match (&self.equation, &self.quadric) {
            (Equation::Round(_), _) => p.z >= self.z[0] && p.z <= self.z[1],
            (Equation::Plane { inner, outer, .. }, _) => {
                let r = p.truncate().length();
                r >= inner * (1.0 - SLACK) && r <= outer * (1.0 + SLACK)
            }
            (_, Quadric::Torus { phi_min, phi_max, .. }) => {
                let span = (phi_max - phi_min).abs().to_radians();
                let angle = self.v(p) * span;
                span >= TAU || angle <= span + SLACK || angle >= TAU - SLACK
            }
            _ => true,
        };
        let sweep = self.quadric.sweep().abs().to_radians();
        if !along || sweep >= TAU - SLACK {
            return along;
        }
        let angle = self.angle(p, self.v(p));
        angle <= sweep + SLACK || angle >= TAU - SLACK
    }

    /// The angle of revolution of a point, from 0 to 2 pi in the direction of the sweep.
    fn angle(&self, p: Vec3, v: f32) -> f32 {
        self.angle_of(turn(&self.quadric.outline(v.clamp(0.0, 1.0)), p))
    }

    /// The angle, from 0 to 2 pi in the direction of the sweep, from the x axis to a vector.
    fn angle_of(&self, turn: Vec2) -> f32 {
        let angle = turn.to_angle() * self.quadric.sweep().signum();
        if angle < 0.0 { angle + TAU } else { angle }
    }

    /// The parameter along the profile of a point.
    fn v(&self, p: Vec3) -> f32 {
        let r = p.truncate().length();
        let part = |z: f32, from: f32, to: f32| (z - from) / (to - from);
        match self.quadric {
            Quadric::Sphere { radius, z_min, z_max, .. } => {
                let angle = |z: f32| (z / radius).clamp(-1.0, 1.0).asin();
                part((p.z * radius.signum()).atan2(r), angle(z_min), angle(z_max))
            }
            Quadric::Cone { height, .. } if height != 0.0 => p.z / height,
            Quadric::Cone { radius, .. } | Quadric::Disk { radius, .. } => 1.0 - r / radius.abs(),
            Quadric::Cylinder { z_min, z_max, .. } | Quadric::Paraboloid { z_min, z_max, .. } => {
                part(p.z, z_min, z_max)
            }
            Quadric::Hyperboloid { from, to, .. } if from.z != to.z => part(p.z, from.z, to.z),
            Quadric::Hyperboloid { from, to, .. } => {
                // |from + v (to - from)| = r; of two solutions that which is on the segment, or nearest to it
                let (from, along) = (from.truncate(), (to - from).truncate());
                let (a, b, c) = (along.length_squared(), from.dot(along), from.length_squared() - r * r);
                let root = (b * b - a * c).max(0.0).sqrt();
                let outside = |v: f32| (v - 0.5).abs();
                let [near, far] = [(-b - root) / a, (-b + root) / a];
                if outside(near) <= outside(far) { near } else { far }
            }
            Quadric::Torus { major_radius, minor_radius, phi_min, phi_max, .. } => {
                // A tube that is wider than the ring crosses the axis.
                let off = |r: f32| ((r - major_radius).hypot(p.z) - minor_radius.abs()).abs();
                let r = if off(r) <= off(-r) { r } else { -r };
                let tube = (p.z * minor_radius.signum()).atan2((r - major_radius) * minor_radius.signum());
                let span = (phi_max - phi_min).to_radians();
                let angle = ((tube - phi_min.to_radians()) * span.signum()).rem_euclid(TAU);
                angle / span.abs()
            }
        }
    }

    /// The surface at a point, seen from the unit vector `viewer`.
    fn hit(&self, p: Vec3, viewer: Vec3) -> Hit {
        let quadric = &self.quadric;
        // Find the parameters
        let sweep = quadric.sweep().abs().to_radians();
        // Just before the start is at the start.
        let before =
            |past: f32, period: f32| if past > 1.0 && past > 0.5 * (1.0 + period) { 0.0 } else { past.min(1.0) };
        let v = if let Quadric::Torus { phi_min, phi_max, .. } = quadric {
            before(self.v(p), 360.0 / (phi_max - phi_min).abs())
        } else {
            self.v(p).clamp(0.0, 1.0)
        };
        let outline = quadric.outline(v);
        let turn = turn(&outline, p);
        let u = before(self.angle_of(turn) / sweep, TAU / sweep);
        // Compute the frame
        let at = quadric.turned(&outline, turn.try_normalize().unwrap_or(Vec2::X), Vec2::new(u, v));
        let (normal, tangent) = quadric.frame(&at);
        let normal = if self.inside_out { -normal } else { normal };
        let geometric = if normal.dot(viewer) < 0.0 { -normal } else { normal };
        // Interpolate texture coordinates
        let [a, b, c, d] = self.corners;
        let uv = a.lerp(b, u).lerp(c.lerp(d, u), v);
        let (by_u, by_v) = ((b - a).lerp(d - c, v), (c - a).lerp(d - b, u));
        let turn = 1.0f32.copysign(by_u.perp_dot(by_v));
        let along = (at.dpdu * (sweep * by_v.y) - at.dpdv * by_u.y) * turn;
        Hit {
            position: at.position,
            origin: offset(at.position, geometric, self.reach()),
            geometric,
            normal,
            tangent: along.try_normalize().unwrap_or(tangent),
            handedness: if self.inside_out { -turn } else { turn },
            uv,
        }
    }

    /// The largest coordinates.
    fn reach(&self) -> Vec3 {
        let [low, high] = self.extent;
        low.abs().max(high.abs())
    }
}

/// The complex quotient of a point and the start of its circle, both projected along the axis, up to a factor.
fn turn(outline: &Outline, p: Vec3) -> Vec2 {
    let start = outline.position.truncate();
    Vec2::new(start.dot(p.truncate()), start.perp_dot(p.truncate()))
}

impl Equation {
    /// The equation of a quadric, and its lowest and highest z.
    fn new(quadric: &Quadric) -> (Self, [f32; 2]) {
        let sorted = |a: f32, b: f32| [a.min(b), a.max(b)];
        let plane = |z: f32, inner: f32, outer: f32| (Self::Plane { z, inner, outer }, [z, z]);
        match *quadric {
            Quadric::Sphere { radius, z_min, z_max, .. } => {
                let clamped = |z: f32| z.clamp(-radius.abs(), radius.abs());
                (Self::Round([-1.0, 0.0, f64::from(radius).powi(2)]), sorted(clamped(z_min), clamped(z_max)))
            }
            Quadric::Cone { height, radius, .. } if height != 0.0 => {
                let (r, slope) = (f64::from(radius), f64::from(radius) / f64::from(height));
                (Self::Round([slope * slope, -2.0 * slope * r, r * r]), sorted(0.0, height))
            }
            Quadric::Cone { radius, .. } => plane(0.0, 0.0, radius.abs()),
            Quadric::Disk { height, radius, .. } => plane(height, 0.0, radius.abs()),
            Quadric::Cylinder { radius, z_min, z_max, .. } => {
                (Self::Round([0.0, 0.0, f64::from(radius).powi(2)]), sorted(z_min, z_max))
            }
            Quadric::Paraboloid { r_max, z_min, z_max, .. } => {
                (Self::Round([0.0, f64::from(r_max).powi(2) / f64::from(z_max), 0.0]), sorted(z_min, z_max))
            }
            Quadric::Hyperboloid { from, to, .. } if from.z != to.z => {
                // |from + (z - z0) slope|^2 in the plane
                let (start, end) = (from.as_dvec3(), to.as_dvec3());
                let slope = (end - start).truncate() / (end.z - start.z);
                let at_zero = start.truncate() - start.z * slope;
                let round = [slope.length_squared(), 2.0 * slope.dot(at_zero), at_zero.length_squared()];
                (Self::Round(round), sorted(from.z, to.z))
            }
            Quadric::Hyperboloid { from, to, .. } => {
                let (start, along) = (from.truncate(), (to - from).truncate());
                let nearest = start + along * (-start.dot(along) / along.length_squared()).clamp(0.0, 1.0);
                plane(from.z, nearest.length(), start.length().max(to.truncate().length()))
            }
            Quadric::Torus { major_radius, minor_radius, .. } => {
                let torus = Self::Torus { major: major_radius.into(), minor: minor_radius.into() };
                (torus, sorted(-minor_radius, minor_radius))
            }
        }
    }

    /// The largest distance from the axis between two heights.
    fn radius(&self, [low, high]: [f32; 2]) -> f32 {
        match *self {
            Self::Round([a, b, c]) => {
                let at = |z: f64| ((a * z + b) * z + c).max(0.0).sqrt();
                let (low, high) = (f64::from(low), f64::from(high));
                let widest = if a < 0.0 { (-0.5 * b / a).clamp(low, high) } else { low };
                at(low).max(at(high)).max(at(widest)) as f32
            }
            Self::Plane { outer, .. } => outer,
            Self::Torus { major, minor } => (major.abs() + minor.abs()) as f32,
        }
    }
}

impl Traced for Revolved {
    fn closest(&self, ray: &Ray, t_max: f32) -> Option<Intersection> {
        let mut bundle = Bundle::EMPTY;
        bundle.set(0, ray, t_max);
        let hits = self.closest_of(&mut bundle, &mut Triangles::none());
        (hits != 0).then(|| Intersection::at(bundle.t_max.0[0]))
    }

    fn closest_of(&self, bundle: &mut Bundle, _triangles: &mut Triangles) -> u16 {
        let (roots, count) = self.roots(bundle);
        let mut hits = 0;
        for lane in 0..RAYS {
            for row in &roots[..count] {
                let t = row[lane] as f32;
                // Comparisons with NaN are false.
                if t > 0.0 && t < bundle.t_max.0[lane] {
                    let ray = bundle.ray(lane);
                    let p: DVec3 = ray.origin.as_dvec3() + ray.direction.as_dvec3() * row[lane];
                    if self.covers(p.as_vec3()) {
                        bundle.t_max.0[lane] = t;
                        hits |= 1 << lane;
                    }
                }
            }
        }
        hits
    }

    fn surface(&self, ray: &Ray, at: &Intersection) -> Surface {
        Surface::Smooth(self.hit(ray.origin + ray.direction * at.t, -ray.direction))
    }

    fn extent(&self) -> [Vec3; 2] {
        self.extent
    }

    fn bounds(&self) -> Ball {
        let [low, high] = self.extent;
        Ball { centre: 0.5 * (low + high), radius: 0.5 * (high - low).length() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::Frame;
    use crate::direction::from_angles;

    fn all() -> Vec<Quadric> {
        let sweep = 360.0;
        vec![
            Quadric::Sphere { radius: 2.0, z_min: -2.0, z_max: 2.0, sweep },
            Quadric::Sphere { radius: 2.0, z_min: -1.0, z_max: 1.5, sweep: 200.0 },
            Quadric::Sphere { radius: -1.5, z_min: 1.0, z_max: -1.5, sweep: -70.0 },
            Quadric::Cone { height: 2.0, radius: 1.0, sweep },
            Quadric::Cone { height: -2.0, radius: 1.0, sweep: 100.0 },
            Quadric::Cone { height: 0.0, radius: 1.0, sweep: 100.0 },
            Quadric::Cylinder { radius: 0.5, z_min: -1.0, z_max: 2.0, sweep: 90.0 },
            Quadric::Cylinder { radius: 0.5, z_min: 2.0, z_max: -1.0, sweep: -270.0 },
            Quadric::Hyperboloid { from: Vec3::new(1.0, 0.0, -1.0), to: Vec3::new(0.0, 1.0, 1.0), sweep: 120.0 },
            Quadric::Hyperboloid { from: Vec3::new(0.3, 0.0, 1.0), to: Vec3::new(1.5, 0.0, 1.0), sweep },
            Quadric::Paraboloid { r_max: 1.5, z_min: 0.0, z_max: 2.0, sweep },
            Quadric::Paraboloid { r_max: 1.5, z_min: 0.5, z_max: 2.0, sweep: 45.0 },
            Quadric::Disk { height: 0.3, radius: 1.2, sweep: 300.0 },
            Quadric::Torus { major_radius: 2.0, minor_radius: 0.5, phi_min: 0.0, phi_max: 360.0, sweep },
            Quadric::Torus { major_radius: 1.2, minor_radius: 0.7, phi_min: -40.0, phi_max: 200.0, sweep: 250.0 },
            Quadric::Torus { major_radius: 0.5, minor_radius: 1.0, phi_min: 0.0, phi_max: 360.0, sweep },
        ]
    }

    /// A fine mesh of a quadric: three corners, three (u, v) of each triangle.
    fn tessellated(quadric: &Quadric) -> Vec<[(Vec3, Vec2); 3]> {
        let n = 96;
        let at = |i: usize, j: usize| {
            let uv = Vec2::new(i as f32, j as f32) / n as f32;
            (quadric.at(uv.x, uv.y).position, uv)
        };
        let cells = (0..n * n).map(|k| (k % n, k / n));
        cells
            .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]])
            .collect()
    }

    /// All distances at which a ray meets triangles, sorted.
    fn crossings(mesh: &[[(Vec3, Vec2); 3]], ray: &Ray) -> Vec<f32> {
        let mut found: Vec<f32> = mesh
            .iter()
            .filter_map(|[a, b, c]| {
                let (ab, ac) = (b.0 - a.0, c.0 - a.0);
                let cross = ray.direction.cross(ac);
                let (to, det) = (ray.origin - a.0, ab.dot(cross));
                let (u, w) = (to.dot(cross) / det, ray.direction.dot(to.cross(ab)) / det);
                let t = ac.dot(to.cross(ab)) / det;
                (u >= 0.0 && w >= 0.0 && u + w <= 1.0 && t > 0.0).then_some(t)
            })
            .collect();
        found.sort_by(f32::total_cmp);
        found
    }

    #[test]
    fn rays_meet_what_a_fine_mesh_shows() {
        for quadric in all() {
            let shape = Revolved::new(quadric, Revolved::CORNERS, false).unwrap();
            let mesh = tessellated(&quadric);
            let (mut met, mut different) = (0, 0);
            for k in 0..400 {
                let random = |i: u32| {
                    let bits = (k * 31 + i).wrapping_mul(2_654_435_769);
                    ((bits ^ bits >> 15).wrapping_mul(2_246_822_519) >> 8) as f32 / 2f32.powi(24)
                };
                let towards = Vec3::new(random(0) - 0.5, random(1) - 0.5, random(2) - 0.5) * 3.0;
                let origin = from_angles(3.1 * random(3), 6.2 * random(4)) * 5.0 * random(5);
                let ray = Ray { origin, direction: (towards - origin).normalize() };
                let expected = crossings(&mesh, &ray).first().copied();
                let found = shape.closest(&ray, f32::INFINITY).map(|hit| hit.t);
                met += usize::from(found.is_some());
                // A mesh differs near edges and silhouettes.
                different += usize::from(match (found, expected) {
                    (Some(a), Some(b)) => (a - b).abs() > 0.02,
                    (a, b) => a.is_some() != b.is_some(),
                });
            }
            assert!(met > 8 && different < 12, "{quadric:?}: {met} {different}");
        }
    }

    #[test]
    fn hits_have_the_parameters_and_the_frame_of_the_surface() {
        for quadric in all() {
            for inside_out in [false, true] {
                let corners = [Vec2::new(0.1, 0.9), Vec2::new(1.3, 0.8), Vec2::new(0.0, -0.2), Vec2::new(1.1, 0.0)];
                let shape = Revolved::new(quadric, Revolved::CORNERS, inside_out).unwrap();
                let mapped = Revolved::new(quadric, corners, inside_out).unwrap();
                for (i, j) in (1..12).flat_map(|i| (1..12).map(move |j| (i, j))) {
                    let (u, v) = (i as f32 / 12.0, j as f32 / 12.0);
                    let at = quadric.at(u, v);
                    let normal = quadric.frame(&at).0;
                    assert!(shape.covers(at.position), "{quadric:?} {u} {v}");
                    let hit = shape.hit(at.position, normal);
                    let apart = (hit.uv - Vec2::new(u, v)).abs().max_element();
                    // The two branches of a tube that crosses the axis meet there.
                    let crossing = matches!(quadric, Quadric::Torus { major_radius: 0.5, .. });
                    assert!(apart < 1e-3 || crossing, "{quadric:?}: {} {u} {v}", hit.uv);
                    assert!((hit.position - at.position).length() < 1e-3);
                    assert!((hit.normal.dot(normal) - if inside_out { -1.0 } else { 1.0 }).abs() < 1e-3 || crossing);
                    if crossing {
                        continue;
                    }
                    // The frame follows the texture coordinates
                    for shape in [&shape, &mapped] {
                        let hit = shape.hit(at.position, normal);
                        let frame = Frame::from_normal_tangent(hit.normal, hit.tangent);
                        let step = |d: Vec2| {
                            let near = quadric.at(u + d.x, v + d.y).position - quadric.at(u - d.x, v - d.y).position;
                            let uv = shape.hit(quadric.at(u + d.x, v + d.y).position, normal).uv;
                            (near, uv - shape.hit(quadric.at(u - d.x, v - d.y).position, normal).uv)
                        };
                        let [(pu, tu), (pv, tv)] = [step(Vec2::X * 0.01), step(Vec2::Y * 0.01)];
                        // The direction in which s grows and t stays
                        let along = (pu * tv.y - pv * tu.y) * tu.perp_dot(tv).signum();
                        assert!(along.normalize().dot(frame.tangent) > 0.99, "{quadric:?} {u} {v}");
                        let across = (pv * tu.x - pu * tv.x) * tu.perp_dot(tv).signum();
                        assert!(across.dot(frame.bitangent * hit.handedness) > 0.0, "{quadric:?} {u} {v}");
                    }
                }
            }
        }
    }

    #[test]
    fn all_rays_of_a_bundle_meet_what_each_alone_meets() {
        for quadric in all() {
            let shape = Revolved::new(quadric, Revolved::CORNERS, false).unwrap();
            let ray = |lane: usize| {
                let origin = from_angles(0.2 * lane as f32, 1.1 * lane as f32) * 4.0;
                Ray { origin, direction: (Vec3::splat(0.05 * lane as f32 - 0.4) - origin).normalize() }
            };
            let mut bundle = Bundle::EMPTY;
            (0..RAYS - 1).for_each(|lane| bundle.set(lane, &ray(lane), 100.0));
            let occluded = shape.occluded_of(&bundle);
            let hits = shape.closest_of(&mut bundle, &mut Triangles::none());
            assert_eq!(hits, occluded);
            for lane in 0..RAYS - 1 {
                let alone = shape.closest(&ray(lane), 100.0);
                assert_eq!((hits >> lane & 1 != 0).then_some(bundle.t_max.0[lane]), alone.map(|hit| hit.t));
            }
            assert_eq!(hits >> (RAYS - 1), 0);
        }
    }

    #[test]
    fn extents_hold_the_surface() {
        for quadric in all() {
            let [low, high] = Revolved::new(quadric, Revolved::CORNERS, false).unwrap().extent();
            for (i, j) in (0..=40).flat_map(|i| (0..=40).map(move |j| (i, j))) {
                let p = quadric.at(i as f32 / 40.0, j as f32 / 40.0).position;
                assert!((low - 1e-5).cmple(p).all() && (high + 1e-5).cmpge(p).all(), "{quadric:?}: {p}");
            }
        }
    }
}
