//! `slice`: the image slice of a BRDF.
//!
//! # Format
//! An EXR picture of 90 x 90 pixels: the column is theta_h in degrees, the row theta_d from 90 at the top down to 0, phi_d is
//! 90 degrees; f_r in 1/sr.
//!
//! # References
//! burley2012

use std::path::Path;

use glam::Vec2;

use super::BrdfExporter;
use crate::Result;
use crate::btf::FloatType;
use crate::direction::{HalfDifference, from_angles};
use crate::material::{BrdfSample, Material};
use crate::params::Values;
use crate::picture::Picture;

pub(super) struct Slice;

impl BrdfExporter for Slice {
    fn name(&self) -> &'static str {
        "slice"
    }

    fn doc(&self) -> &'static str {
        "`NAME.exr`: a picture of the plane phi_d = 90 degrees, theta_h to the right and theta_d upwards."
    }

    fn ending(&self) -> &'static str {
        "exr"
    }

    fn losses(&self, _material: &dyn Material) -> Vec<&'static str> {
        vec!["everything outside the plane phi_d = 90 degrees; the picture cannot be read back as a BRDF"]
    }

    fn write(&self, material: &dyn Material, _samples: &[BrdfSample], path: &Path, _options: &Values) -> Result<()> {
        let pixel = |i: usize| {
            let (theta_h, theta_d) = ((i % 90) as f32 + 0.5, 89.5 - (i / 90) as f32);
            let wh = from_angles(theta_h.to_radians(), 0.0);
            let wd = from_angles(theta_d.to_radians(), std::f32::consts::FRAC_PI_2);
            let (wi, wo) = HalfDifference { wh, wd }.directions();
            material.eval(Vec2::ZERO, wi, wo)
        };
        Picture { width: 90, height: 90, rgb: (0..8100).map(pixel).collect() }.write_exr(path, FloatType::F32)
    }
}
