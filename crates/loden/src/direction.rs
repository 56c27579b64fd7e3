//! Directions: the conventions for angles and frames, half and difference vectors, sampled direction sets.
//!
//! The local frame is x = tangent (dP/du), y = bitangent, z = normal. Directions are unit vectors that point away from
//! the surface. The polar angle theta is measured from the normal, the azimuth phi = atan2(y, x) lies in [0, 2 pi).
//! Angles are in radians; degrees appear only in file names, tables and user-facing options. No other module defines an
//! angle.

mod interpolate;
mod rings;
mod set;
mod triangles;

pub use interpolate::{Interpolator, Scheme, Stencil};
pub use set::DirectionSet;
#[cfg(feature = "renderers")]
pub(crate) use triangles::TriangleTables;

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

/// The unit vector at polar angle `theta` and azimuth `phi`, in radians.
#[inline]
pub fn from_angles(theta: f32, phi: f32) -> Vec3 {
    let (st, ct) = theta.sin_cos();
    let (sp, cp) = phi.sin_cos();
    Vec3::new(st * cp, st * sp, ct)
}

/// The angle of the point (x, y) in radians, in [-pi, pi], to within three units in the last place.
///
/// # Model
/// t P(t^2) in the first octant, the others by symmetry, without branches: a third of the cost of the standard
/// library's. P is the minimax polynomial, with a relative error of 1.5e-8 before rounding.
#[inline(always)]
pub(crate) fn atan2(y: f32, x: f32) -> f32 {
    const P: [f32; 9] = [
        1.0,
        -0.333_330_72,
        0.199_926_2,
        -0.142_036_44,
        0.106_409_34,
        -0.075_042_94,
        0.042_691_514,
        -0.016_068_626,
        0.002_849_888_8,
    ];
    let (ax, ay) = (x.abs(), y.abs());
    let t = ax.min(ay) / ax.max(ay).max(f32::MIN_POSITIVE);
    let first = t * P.iter().rev().fold(0.0, |sum, c| sum * (t * t) + c);
    let quadrant = if ay > ax { FRAC_PI_2 - first } else { first };
    let half = if x < 0.0 { PI - quadrant } else { quadrant };
    half.copysign(y)
}

/// Polar angle of a vector in radians, in [0, pi]; exact near the pole, where acos is not.
#[inline(always)]
pub fn theta(w: Vec3) -> f32 {
    atan2(w.truncate().length(), w.z)
}

/// Azimuth of a vector in radians, in [0, 2 pi); 0 at the pole.
#[inline(always)]
pub fn phi(w: Vec3) -> f32 {
    let phi = atan2(w.y, w.x);
    // -tiny + TAU rounds to TAU, which is outside the half-open range
    if phi >= 0.0 { phi } else { (phi + TAU).min(TAU.next_down()) }
}

/// `w` mirrored about the normal.
#[inline]
pub fn mirror(w: Vec3) -> Vec3 {
    Vec3::new(-w.x, -w.y, w.z)
}

/// Sine and cosine of an angle up to 45 degrees, by their Taylor series, which are exact to rounding there.
#[inline(always)]
fn sin_cos_octant(phi: f32) -> (f32, f32) {
    let x = phi * phi;
    let sin = phi * (1.0 - x * (1.0 / 6.0 - x * (1.0 / 120.0 - x * (1.0 / 5040.0 - x / 362_880.0))));
    let cos = 1.0 - x * (0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x / 40_320.0)));
    (sin, cos)
}

/// Sine and cosine of an angle in turns, 0 to 1, without calls or branches.
#[inline(always)]
pub(crate) fn sin_cos_turns(turns: f32) -> (f32, f32) {
    // the nearest quarter turn, and the angle relative to it
    let quarter = (4.0 * turns + 0.5) as i32;
    let (sin, cos) = sin_cos_octant((turns - 0.25 * quarter as f32) * TAU);
    let (a, b) = if quarter & 1 == 0 { (sin, cos) } else { (cos, -sin) };
    if quarter & 2 == 0 { (a, b) } else { (-a, -b) }
}

/// Maps two uniform random numbers to a uniform point of the unit disk, by the concentric map.
///
/// # References
/// shirley1997
#[inline(always)]
pub(crate) fn concentric_disk(random: Vec2) -> Vec2 {
    let p = 2.0 * random - Vec2::ONE;
    let (r, s) = if p.x.abs() > p.y.abs() { (p.x, p.y) } else { (p.y, p.x) };
    let (sin, cos) = sin_cos_octant(if r == 0.0 { 0.0 } else { FRAC_PI_4 * (s / r) });
    r * if p.x.abs() > p.y.abs() { Vec2::new(cos, sin) } else { Vec2::new(sin, cos) }
}

/// Maps two uniform random numbers to a cosine-distributed direction of the upper hemisphere, whose density is
/// cos(theta) / pi.
#[inline(always)]
pub fn cosine_hemisphere(random: Vec2) -> Vec3 {
    let d = concentric_disk(random);
    d.extend((1.0 - d.length_squared()).max(0.0).sqrt())
}

/// A right-handed orthonormal frame: tangent, bitangent and normal in world coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Frame {
    /// The x axis of the local frame, dP/du.
    pub tangent: Vec3,
    /// The y axis of the local frame.
    pub bitangent: Vec3,
    /// The z axis of the local frame.
    pub normal: Vec3,
}

impl Frame {
    /// A frame around a unit normal, with an arbitrary tangent that varies continuously except at -z.
    ///
    /// # References
    /// duff2017
    #[inline]
    pub fn from_normal(n: Vec3) -> Self {
        let sign = 1.0f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            tangent: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            bitangent: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            normal: n,
        }
    }

    /// A frame around a unit normal, with the component of `tangent` orthogonal to it as the tangent (Gram-Schmidt). If
    /// `tangent` is parallel to the normal, the tangent is arbitrary.
    #[inline(always)]
    pub fn from_normal_tangent(n: Vec3, tangent: Vec3) -> Self {
        let mut across = tangent - n * n.dot(tangent);
        if across.length_squared() < 0.01 * tangent.length_squared() {
            // Remove what rounding has left along the normal
            across = across.normalize_or_zero();
            across -= n * n.dot(across);
        }
        match across.try_normalize() {
            Some(t) => Self { tangent: t, bitangent: n.cross(t), normal: n },
            None => Self::from_normal(n),
        }
    }

    /// Converts from world to local coordinates.
    #[inline]
    pub fn local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.tangent), v.dot(self.bitangent), v.dot(self.normal))
    }

    /// Converts from local to world coordinates.
    #[inline]
    pub fn world(&self, v: Vec3) -> Vec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }
}

/// The half vector of two directions; the normal if they are opposite.
#[inline]
pub fn half(wi: Vec3, wo: Vec3) -> Vec3 {
    (wi + wo).try_normalize().unwrap_or(Vec3::Z)
}

/// Half and difference vectors of a pair of directions.
///
/// # References
/// rusinkiewicz1998
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfDifference {
    /// The half vector in the local frame of the surface.
    pub wh: Vec3,
    /// `wi` in the frame whose pole is the half vector.
    pub wd: Vec3,
}

impl HalfDifference {
    /// Converts a light and a view direction.
    pub fn new(wi: Vec3, wo: Vec3) -> Self {
        let wh = half(wi, wo);
        Self { wh, wd: half_frame(wh).local(wi) }
    }

    /// Converts back to (`wi`, `wo`), where `wo` is `wi` mirrored about the half vector.
    pub fn directions(&self) -> (Vec3, Vec3) {
        let frame = half_frame(self.wh);
        (frame.world(self.wd), frame.world(mirror(self.wd)))
    }
}

/// The frame that results from rotating by theta_h about y, then by phi_h about z.
fn half_frame(wh: Vec3) -> Frame {
    let sin = wh.truncate().length();
    let (sp, cp) = if sin > 0.0 { (wh.y / sin, wh.x / sin) } else { (0.0, 1.0) };
    Frame { tangent: Vec3::new(wh.z * cp, wh.z * sp, -sin), bitangent: Vec3::new(-sp, cp, 0.0), normal: wh }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit() -> impl Strategy<Value = Vec3> {
        (0.0f32..1.57, 0.0f32..TAU).prop_map(|(t, p)| from_angles(t, p))
    }

    proptest! {
        #[test]
        fn angles_round_trip(t in 0.001f32..1.57, p in 0.0f32..TAU) {
            let w = from_angles(t, p);
            prop_assert!((theta(w) - t).abs() < 1e-5);
            let d = (phi(w) - p).abs();
            prop_assert!(d.min(TAU - d) * t.sin() < 1e-5);
        }

        #[test]
        fn half_difference_round_trips(wi in unit(), wo in unit()) {
            let (i, o) = HalfDifference::new(wi, wo).directions();
            prop_assert!((i - wi).length() < 1e-4 && (o - wo).length() < 1e-4, "{i} {o}");
        }

        #[test]
        fn frames_are_orthonormal_and_right_handed(n in unit(), t in unit()) {
            for frame in [Frame::from_normal(n), Frame::from_normal(-n), Frame::from_normal_tangent(n, t)] {
                prop_assert!((frame.tangent.cross(frame.bitangent) - frame.normal).length() < 1e-4);
                prop_assert!(frame.tangent.dot(frame.normal).abs() < 1e-5);
                let v = Vec3::new(0.3, -0.5, 0.7);
                prop_assert!((frame.world(frame.local(v)) - v).length() < 1e-5);
            }
        }
    }

    #[test]
    fn atan2_matches_the_standard_library() {
        for i in 0..200_000 {
            let (angle, length) = (i as f64 * 3.2e-5 - 3.1999, f64::from(i % 40 - 20).exp2());
            let (y, x) = ((length * angle.sin()) as f32, (length * angle.cos()) as f32);
            let expected = f64::from(y).atan2(f64::from(x));
            assert!((f64::from(atan2(y, x)) - expected).abs() <= 3e-7 * expected.abs(), "{y} {x}: {}", atan2(y, x));
        }
        assert_eq!([atan2(0.0, 0.0), atan2(0.0, 1.0), atan2(1.0, 0.0), atan2(0.0, -1.0)], [0.0, 0.0, FRAC_PI_2, PI]);
        assert!(atan2(f32::NAN, f32::NAN).is_nan() && theta(Vec3::NAN).is_nan());
    }

    #[test]
    fn sines_and_cosines_of_turns_are_accurate() {
        for i in 0..=100_000 {
            let turns = i as f32 / 100_000.0;
            let (sin, cos) = sin_cos_turns(turns);
            let (exact_sin, exact_cos) = (f64::from(turns) * std::f64::consts::TAU).sin_cos();
            let far = (f64::from(sin) - exact_sin).abs().max((f64::from(cos) - exact_cos).abs());
            assert!(far < 2e-7, "{turns}: {sin} {cos}");
        }
    }

    #[test]
    fn cosine_hemisphere_has_mean_cosine_two_thirds() {
        let n = 100;
        let grid = (0..n * n).map(|i| Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32);
        let mean = grid.map(|u| cosine_hemisphere(u).z).sum::<f32>() / (n * n) as f32;
        assert!((mean - 2.0 / 3.0).abs() < 1e-3, "{mean}");
    }
}
