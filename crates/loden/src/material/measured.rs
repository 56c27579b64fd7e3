//! Measured reflectance without texture.

use std::fmt::Debug;

use glam::Vec3;

use super::Material;

/// One measured value of a BRDF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrdfSample {
    /// Unit vector towards the light.
    pub wi: Vec3,
    /// Unit vector towards the viewer.
    pub wo: Vec3,
    /// The BRDF f_r in 1/sr, without the cosine; linear sRGB/Rec. 709.
    pub value: Vec3,
}

/// A BRDF read from a file: a material that does not depend on the texture coordinate, with the values it rests on.
pub trait MeasuredBrdf: Material + Debug {
    /// The values as measured, the nodes of a table, in the file's order; what fitting and factorisation work on.
    fn samples(&self) -> Vec<BrdfSample>;
}
