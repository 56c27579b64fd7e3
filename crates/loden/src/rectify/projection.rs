//! Projection of the sample plane into a photograph.

use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Radial lens distortion: an ideal image point at radius r appears at r (1 + k1 r^2 + k2 r^4), with r in half widths
/// from the centre of the photograph.
///
/// # References
/// brown1971 (the radial terms)
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(from = "[f64; 2]", into = "[f64; 2]")]
pub(crate) struct Distortion {
    /// Coefficient of r^2.
    pub k1: f64,
    /// Coefficient of r^4.
    pub k2: f64,
}

impl From<[f64; 2]> for Distortion {
    fn from([k1, k2]: [f64; 2]) -> Self {
        Self { k1, k2 }
    }
}

impl From<Distortion> for [f64; 2] {
    fn from(distortion: Distortion) -> Self {
        [distortion.k1, distortion.k2]
    }
}

/// A distorting lens for photographs of a certain size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    distortion: Distortion,
    middle: DVec2,
    unit: f64,
}

impl Lens {
    /// A lens for photographs of `width` x `height` pixels.
    pub fn new(distortion: Distortion, width: usize, height: usize) -> Self {
        let middle = DVec2::new(width as f64, height as f64) / 2.0;
        Self { distortion, middle, unit: middle.x }
    }

    /// Whether the distortion is invertible over the whole photograph: the distorted radius grows with the radius.
    pub fn is_monotonic(&self) -> bool {
        let Distortion { k1, k2 } = self.distortion;
        let farthest = 1.5 * self.middle.length() / self.unit;
        let steps = (0..=64).map(|i| (farthest * f64::from(i) / 64.0).powi(2));
        [k1, k2].iter().all(|k| k.is_finite())
            && steps.into_iter().all(|r2| 1.0 + 3.0 * k1 * r2 + 5.0 * k2 * r2 * r2 > 0.05)
    }

    /// Maps an ideal image point to its distorted position, in pixels.
    #[inline]
    pub fn distort(&self, ideal: DVec2) -> DVec2 {
        let d = (ideal - self.middle) / self.unit;
        let r2 = d.length_squared();
        self.middle + d * (self.unit * (1.0 + r2 * (self.distortion.k1 + r2 * self.distortion.k2)))
    }

    /// Inverts [`Lens::distort`] by Newton's method along the radius.
    pub fn undistort(&self, seen: DVec2) -> DVec2 {
        let d = (seen - self.middle) / self.unit;
        let Distortion { k1, k2 } = self.distortion;
        let target = d.length();
        let mut r = target;
        for _ in 0..8 {
            let r2 = r * r;
            r -= (r * (1.0 + r2 * (k1 + r2 * k2)) - target) / (1.0 + r2 * (3.0 * k1 + r2 * 5.0 * k2));
        }
        if target > 0.0 { self.middle + d * (self.unit * r / target) } else { seen }
    }
}

/// A homography from the sample plane to an undistorted photograph.
///
/// Points of the plane are in sample sides: (0, 0) is the top left corner of the sample, (1, 1) the bottom right one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homography(DMat3);

impl Homography {
    /// The homography that maps the corners of the square low..high (top left, top right, bottom right, bottom left) to
    /// `corners` in pixels; `None` if these are not a convex quadrilateral in this order.
    ///
    /// # References
    /// heckbert1989 (section 2.2.3: square to quadrilateral)
    pub fn from_square(low: f64, high: f64, corners: [DVec2; 4]) -> Option<Self> {
        // Require a convex, clockwise quadrilateral
        let turns = [0, 1, 2, 3].map(|i| {
            let [a, b, c] = [corners[i], corners[(i + 1) % 4], corners[(i + 2) % 4]];
            (b - a).perp_dot(c - b)
        });
        if !turns.iter().all(|turn| *turn > 1e-6) {
            return None;
        }
        // Map the unit square to the corners
        let [p0, p1, p2, p3] = corners;
        let (sum, d1, d2) = (p0 - p1 + p2 - p3, p1 - p2, p3 - p2);
        let bottom = d1.perp_dot(d2);
        let (g, h) = (sum.perp_dot(d2) / bottom, d1.perp_dot(sum) / bottom);
        let (x, y) = (p1 - p0 + g * p1, p3 - p0 + h * p3);
        let square = DMat3::from_cols(x.extend(g), y.extend(h), p0.extend(1.0));
        // Map the given square to the unit square
        let scale = 1.0 / (high - low);
        let unit = DMat3::from_cols(DVec3::X * scale, DVec3::Y * scale, DVec3::new(-low * scale, -low * scale, 1.0));
        Some(Self(square * unit))
    }

    /// Maps a point of the plane to the photograph, in pixels.
    #[inline]
    pub fn apply(&self, point: DVec2) -> DVec2 {
        let p = self.0 * point.extend(1.0);
        p.truncate() / p.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_mapped_and_lines_stay_straight() {
        let corners = [(10.0, 20.0), (110.0, 12.0), (90.0, 80.0), (5.0, 95.0)].map(DVec2::from);
        let map = Homography::from_square(-0.5, 1.5, corners).unwrap();
        for (at, corner) in [(-0.5, -0.5), (1.5, -0.5), (1.5, 1.5), (-0.5, 1.5)].into_iter().zip(corners) {
            assert!((map.apply(at.into()) - corner).length() < 1e-9);
        }
        let [a, b, c] = [0.0, 0.4, 1.0].map(|t| map.apply(DVec2::new(t, 0.2 + 0.5 * t)));
        assert!((b - a).perp_dot(c - a).abs() < 1e-9);
        let mirrored = [corners[1], corners[0], corners[3], corners[2]];
        assert_eq!(Homography::from_square(0.0, 1.0, mirrored), None);
    }

    #[test]
    fn undistort_inverts_distort() {
        let lens = Lens::new(Distortion { k1: -0.08, k2: 0.01 }, 200, 150);
        assert!(lens.is_monotonic());
        for (x, y) in [(100.0, 75.0), (3.0, 4.0), (190.0, 20.0), (100.0, 149.0)] {
            let p = DVec2::new(x, y);
            assert!((lens.undistort(lens.distort(p)) - p).length() < 1e-9);
        }
        assert!((lens.distort(DVec2::new(200.0, 75.0)).x - 193.0).abs() < 1e-9);
        assert!(!Lens::new(Distortion { k1: -0.5, k2: 0.0 }, 200, 150).is_monotonic());
    }
}
