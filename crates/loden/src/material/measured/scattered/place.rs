//! Coordinates of pairs of directions in which samples are interpolated.

use std::f32::consts::PI;

use glam::Vec3;

use crate::direction::{HalfDifference, theta};

/// A point: half angle, difference angle, deviation from reciprocity; and the half vector across the normal and the turn of the
/// light about it, which are 0 if the surface is isotropic.
pub type Place = [f32; 6];

/// The symmetries that samples bear out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symmetry {
    /// Isotropic, reciprocal and symmetric under mirroring: one sample stands for all pairs that these give.
    Isotropic,
    /// None of these.
    None,
}

/// Weight of the third coordinate.
const DEVIATION: f32 = 2.0;
/// Weight of the half vector's azimuth and of the turn: anisotropy changes a lobe less than leaving it does.
const AZIMUTH: f32 = 0.5;

impl Symmetry {
    /// Number of coordinates in use.
    pub fn axes(self) -> usize {
        if self == Self::Isotropic { 3 } else { 6 }
    }

    /// The point of a pair and of all pairs equivalent to it by symmetry.
    pub fn place(self, wi: Vec3, wo: Vec3) -> Place {
        let HalfDifference { wh, wd } = HalfDifference::new(wi, wo);
        let [h, d] = [(theta(wh) * 2.0 / PI).sqrt(), theta(wd) * 2.0 / PI];
        let deviation = DEVIATION * (wi.z - wo.z);
        match self {
            Self::Isotropic => [h, d, deviation.abs(), 0.0, 0.0, 0.0],
            Self::None => {
                // where the half vector is along the normal, the azimuth is that of the light
                let across = wh.truncate().normalize_or_zero() * h + wi.truncate() * (1.0 - h);
                // which side of the plane of normal and half vector the light is on
                let turn = wh.cross(wi).z;
                [h, d, deviation, AZIMUTH * across.x, AZIMUTH * across.y, AZIMUTH * turn]
            }
        }
    }
}
