//! Roots of polynomials along rays.

use glam::DVec3;

use crate::render::bvh::{Bundle, RAYS};
use crate::render::ray::Ray;
use crate::simd::wide;

wide! {
    /// Both roots of x^2 + y^2 = a z^2 + b z + c along the rays of a bundle, from a, b, c and the middle of the
    /// surface.
    pub(super) fn round(bundle: &Bundle, surface: &[f64; 4], roots: &mut [[f64; RAYS]; 4]) {
        let [a, b, c, middle] = *surface;
        let [near, far, ..] = roots;
        for lane in 0..RAYS {
            let [ox, oy, oz] = [0, 1, 2].map(|axis| f64::from(bundle.origin[axis].0[lane]));
            let [dx, dy, dz] = [0, 1, 2].map(|axis| f64::from(bundle.direction[axis].0[lane]));
            // Start from the point nearest to the middle, where differences of squares cancel least.
            let start = ((middle - oz) * dz - ox * dx - oy * dy) / (dx * dx + dy * dy + dz * dz);
            let (x, y, z) = (ox + start * dx, oy + start * dy, oz + start * dz);
            // Solve p t^2 + 2 q t + r = 0
            let p = dx * dx + dy * dy - a * dz * dz;
            let q = x * dx + y * dy - (a * z + 0.5 * b) * dz;
            let r = x * x + y * y - (a * z + b) * z - c;
            let sum = -(q + (q * q - p * r).sqrt().copysign(q));
            near[lane] = start + sum / p;
            far[lane] = start + r / sum;
        }
    }
}

wide! {
    /// The parts of rays inside the cylinder |z| <= height, x^2 + y^2 <= radius^2, up to their ends: starts and ends;
    /// the end is below the start where a ray misses it.
    pub(super) fn inside(bundle: &Bundle, radius: f64, height: f64, parts: &mut [[f64; RAYS]; 2]) {
        let [near, far] = parts;
        for lane in 0..RAYS {
            let [ox, oy, oz] = [0, 1, 2].map(|axis| f64::from(bundle.origin[axis].0[lane]));
            let [dx, dy, dz] = [0, 1, 2].map(|axis| f64::from(bundle.direction[axis].0[lane]));
            // Intersect the slab; a ray in its plane divides zero by a tiny number
            let slope = if dz.abs() > f64::MIN_POSITIVE { dz } else { f64::MIN_POSITIVE };
            let (low, high) = ((-height - oz) / slope, (height - oz) / slope);
            // Intersect the circle, from the point nearest to its centre
            let length = (dx * dx + dy * dy).max(f64::MIN_POSITIVE);
            let start = -(ox * dx + oy * dy) / length;
            let (x, y) = (ox + start * dx, oy + start * dy);
            let rest = radius * radius - x * x - y * y;
            let half = (rest.max(0.0) / length).sqrt();
            let end = f64::from(bundle.t_max.0[lane]);
            near[lane] = low.min(high).max(start - half).max(0.0);
            far[lane] = if rest > 0.0 { low.max(high).min(start + half).min(end) } else { -1.0 };
        }
    }
}

/// The roots of (|p|^2 + major^2 - minor^2)^2 = 4 major^2 (x^2 + y^2) along a part of a ray, ascending; NaN for those
/// that are missing.
pub(super) fn torus(ray: &Ray, part: [f64; 2], major: f64, minor: f64) -> [f64; 4] {
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let length = direction.length();
    let direction = direction / length;
    // Start from the point nearest to the centre, where the cubic term vanishes.
    let start = -origin.dot(direction);
    let p: DVec3 = origin + start * direction;
    let k = p.length_squared() + major * major - minor * minor;
    let ring = 4.0 * major * major;
    let quartic = [
        k * k - ring * (p.x * p.x + p.y * p.y),
        -2.0 * ring * (p.x * direction.x + p.y * direction.y),
        2.0 * k - ring * (direction.x * direction.x + direction.y * direction.y),
    ];
    depressed_quartic(quartic, part.map(|t| t * length - start)).map(|root| (start + root) / length)
}

/// The roots of c0 + c1 x + c2 x^2 + x^4 in an interval, ascending; NaN for those that are missing. Roots where the
/// polynomial does not change its sign are left out.
fn depressed_quartic([c0, c1, c2]: [f64; 3], within: [f64; 2]) -> [f64; 4] {
    // The extrema of the derivative divide the line into parts with one extremum each
    let turn = (-c2 / 6.0).sqrt();
    let [a, b, c, _] =
        crossings([-turn, turn, f64::NAN], within, |x| (c1 + (2.0 * c2 + 4.0 * x * x) * x, 2.0 * c2 + 12.0 * x * x));
    crossings([a, b, c], within, |x| (c0 + (c1 + (c2 + x * x) * x) * x, c1 + (2.0 * c2 + 4.0 * x * x) * x))
}

/// Where a function changes its sign in an interval, ascending, followed by NaN. The function is monotone between its
/// extrema, which are given in ascending order; NaN is skipped. `evaluate` returns its value and its derivative.
fn crossings(extrema: [f64; 3], [low, high]: [f64; 2], evaluate: impl Fn(f64) -> (f64, f64)) -> [f64; 4] {
    let (mut roots, mut count) = ([f64::NAN; 4], 0);
    let (mut from, mut falls) = (low, evaluate(low).0 > 0.0);
    for to in extrema.into_iter().filter(|&x| x > low && x < high).chain([high]) {
        let above = evaluate(to).0 > 0.0;
        if falls != above {
            roots[count] = crossing([from, to], falls, &evaluate);
            count += 1;
        }
        (from, falls) = (to, above);
    }
    roots
}

/// The only crossing in an interval: by Newton's method, or by halves where a step would leave the interval.
fn crossing([mut low, mut high]: [f64; 2], falls: bool, evaluate: impl Fn(f64) -> (f64, f64)) -> f64 {
    let accuracy = 1e-14 * (low.abs() + high.abs());
    let mut x = 0.5 * (low + high);
    for _ in 0..80 {
        let (value, slope) = evaluate(x);
        if (value > 0.0) == falls {
            low = x;
        } else {
            high = x;
        }
        let step = x - value / slope;
        let next = if step > low && step < high { step } else { 0.5 * (low + high) };
        if (next - x).abs() <= accuracy {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_of_quartics_are_found() {
        // (x + 3.5) (x - 0.5) (x - 1) (x - 2)
        let quartic = [-3.5, 11.25, -8.75];
        let found = depressed_quartic(quartic, [-5.0, 5.0]);
        for (found, expected) in found.iter().zip([-3.5, 0.5, 1.0, 2.0]) {
            assert!((found - expected).abs() < 1e-12, "{found}");
        }
        let found = depressed_quartic(quartic, [0.0, 1.5]);
        assert!((found[0] - 0.5).abs() < 1e-12 && (found[1] - 1.0).abs() < 1e-12 && found[2].is_nan(), "{found:?}");
        assert!(depressed_quartic([1.0, 0.0, 1.0], [-9.0, 9.0])[0].is_nan());
    }

    #[test]
    fn rays_are_cut_to_a_cylinder() {
        let mut bundle = Bundle::EMPTY;
        let rays = [
            ([-5.0, 0.0, 0.0], [1.0, 0.0, 0.0], Some([3.0, 7.0])),
            ([0.0, 0.0, 9.0], [0.0, 0.0, -2.0], Some([4.0, 5.0])),
            ([3.0, 0.0, 9.0], [0.0, 0.0, -2.0], None),
            ([-5.0, 3.0, 0.0], [1.0, 0.0, 0.0], None),
            ([-5.0, 0.0, 1.5], [1.0, 0.0, 0.0], None),
            ([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], Some([0.0, 1.0])),
            ([-50.0, 0.0, 0.0], [1.0, 0.0, 0.0], None),
        ];
        for (lane, (origin, direction, _)) in rays.iter().enumerate() {
            bundle.set(lane, &Ray { origin: (*origin).into(), direction: (*direction).into() }, 40.0);
        }
        let mut parts = [[0.0; RAYS]; 2];
        inside(&bundle, 2.0, 1.0, &mut parts);
        for (lane, (_, _, expected)) in rays.into_iter().enumerate() {
            let [near, far] = [0, 1].map(|end: usize| parts[end][lane]);
            match expected {
                Some([start, end]) => assert!((near - start).abs() < 1e-12 && (far - end).abs() < 1e-12, "{lane}"),
                None => assert!(near > far, "{lane}: {near} {far}"),
            }
        }
    }
}
