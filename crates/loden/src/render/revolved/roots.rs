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
            // Start from the point nearest to the middle, where differences of squares lose least.
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

/// The roots of (|p|^2 + major^2 - minor^2)^2 = 4 major^2 (x^2 + y^2) along a ray; NaN for those that are missing.
pub(super) fn torus(ray: &Ray, major: f64, minor: f64) -> [f64; 4] {
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let length = direction.length();
    let direction = direction / length;
    // Start from the point nearest to the centre.
    let start = -origin.dot(direction);
    let p: DVec3 = origin + start * direction;
    let mut found = [f64::NAN; 4];
    let reach = (major.abs() + minor.abs()).powi(2) - p.length_squared();
    if reach.is_nan() || reach <= 0.0 {
        return found;
    }
    let k = p.length_squared() + major * major - minor * minor;
    let ring = 4.0 * major * major;
    let quartic = [
        k * k - ring * (p.x * p.x + p.y * p.y),
        -2.0 * ring * (p.x * direction.x + p.y * direction.y),
        2.0 * k - ring * (direction.x * direction.x + direction.y * direction.y),
        0.0,
        1.0,
    ];
    let reach = reach.sqrt() * (1.0 + 1e-9);
    let (roots, count) = real(&quartic, [-reach, reach]);
    for (found, root) in found.iter_mut().zip(&roots[..count]) {
        *found = (start + root) / length;
    }
    found
}

/// The roots of a polynomial in an interval, ascending, and how many there are. The roots of its derivative divide the
/// interval; a root where the polynomial does not change its sign is left out. `coefficients` start with the constant;
/// the degree is 1 to 4.
fn real(coefficients: &[f64], [low, high]: [f64; 2]) -> ([f64; 4], usize) {
    let value = |x: f64| coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c);
    let mut derivative = [0.0; 4];
    let degree = coefficients.len() - 1;
    for (k, d) in derivative[..degree].iter_mut().enumerate() {
        *d = (k + 1) as f64 * coefficients[k + 1];
    }
    let slope = |x: f64| derivative[..degree].iter().rev().fold(0.0, |sum, c| sum * x + c);
    let (turns, turn_count) = if degree > 1 { real(&derivative[..degree], [low, high]) } else { ([0.0; 4], 0) };
    let (mut roots, mut count) = ([0.0; 4], 0);
    let mut from = low;
    for to in turns[..turn_count].iter().copied().chain([high]) {
        let falls = value(from) > 0.0;
        if falls != (value(to) > 0.0) {
            roots[count] = between([from, to], |x| (value(x) > 0.0) == falls, |x| x - value(x) / slope(x));
            count += 1;
        }
        from = to;
    }
    (roots, count)
}

/// The only root in an interval: by Newton's method, or by halves where a step would leave the interval. `is_left` says
/// whether the root is above a number.
fn between([mut low, mut high]: [f64; 2], is_left: impl Fn(f64) -> bool, newton: impl Fn(f64) -> f64) -> f64 {
    let mut x = 0.5 * (low + high);
    for _ in 0..80 {
        if is_left(x) {
            low = x;
        } else {
            high = x;
        }
        let step = newton(x);
        let next = if step > low && step < high { step } else { 0.5 * (low + high) };
        if (next - x).abs() <= 1e-15 * (low.abs() + high.abs()) {
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
    fn roots_of_polynomials_are_found() {
        // (x + 2) (x - 0.5) (x - 1) (x - 3)
        let (roots, count) = real(&[-3.0, 8.5, -4.0, -2.5, 1.0], [-5.0, 5.0]);
        assert_eq!(count, 4);
        for (found, expected) in roots.iter().zip([-2.0, 0.5, 1.0, 3.0]) {
            assert!((found - expected).abs() < 1e-12, "{roots:?}");
        }
        assert_eq!(real(&[-3.0, 8.5, -4.0, -2.5, 1.0], [0.0, 2.0]).1, 2);
        assert_eq!(real(&[1.0, 0.0, 1.0], [-9.0, 9.0]).1, 0);
        let (roots, count) = real(&[-6.0, 2.0], [-9.0, 9.0]);
        assert!(count == 1 && (roots[0] - 3.0).abs() < 1e-12, "{roots:?}");
    }
}
