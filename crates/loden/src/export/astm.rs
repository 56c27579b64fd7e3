//! `astm`: a text table of directions and RGB values.
//!
//! # Format
//! As read by the importer of that name, with the columns `theta_i,phi_i,theta_s,phi_s,R,G,B`, angles in radians.

use std::f32::consts::PI;
use std::path::Path;

use glam::Vec2;

use super::{BrdfExporter, check_finite};
use crate::Result;
use crate::direction::{from_angles, phi, theta};
use crate::material::{BrdfSample, Material};
use crate::params::Values;

pub(super) struct Astm;

impl BrdfExporter for Astm {
    fn name(&self) -> &'static str {
        "astm"
    }

    fn doc(&self) -> &'static str {
        "`NAME.astm`: a text table of directions in radians and RGB values in 1/sr."
    }

    fn ending(&self) -> &'static str {
        "astm"
    }

    fn losses(&self, material: &dyn Material) -> Vec<&'static str> {
        let mut losses = vec!["the spectrum, if there is one", "what the measured directions do not show"];
        if !material.promises().isotropic {
            losses.push("the anisotropy: readers take the samples as isotropic");
        }
        losses
    }

    fn write(&self, material: &dyn Material, samples: &[BrdfSample], path: &Path, _options: &Values) -> Result<()> {
        let grid;
        let samples = if samples.is_empty() {
            grid = grid_samples(material);
            &grid
        } else {
            samples
        };
        check_finite(samples.iter().flat_map(|s| s.value.to_array()))?;
        crate::output::write_file(path, |file| {
            writeln!(file, "LAB_NAME loden\nMEAS_NAME BRDF\nNUM_POINTS {}", samples.len())?;
            writeln!(file, "VARS theta_i,phi_i,theta_s,phi_s,R,G,B\n")?;
            for s in samples {
                let [r, g, b] = s.value.to_array();
                writeln!(file, "{},{},{},{},{r},{g},{b}", theta(s.wi), phi(s.wi), theta(s.wo), phi(s.wo))?;
            }
            Ok(())
        })
    }
}

/// Samples in steps of 5, 5 and 10 degrees, for a material without measured directions.
fn grid_samples(material: &dyn Material) -> Vec<BrdfSample> {
    let degrees = |i: usize| (5.0 * i as f32).to_radians();
    let pairs = (0..17).flat_map(|i| (0..17).flat_map(move |o| (0..19).map(move |p| (i, o, p))));
    let sample = |(i, o, p): (usize, usize, usize)| {
        let (wi, wo) = (from_angles(degrees(i), 0.0), from_angles(degrees(o), p as f32 / 18.0 * PI));
        BrdfSample { wi, wo, value: material.eval(Vec2::ZERO, wi, wo) }
    };
    pairs.map(sample).collect()
}
