//! `merl`: the `.binary` files of the MERL database.
//!
//! # Format
//! As read by the importer of that name; values are evaluated at the centres of cells. Cells below the surface hold -1.

use std::path::Path;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{BrdfExporter, check_finite};
use crate::Result;
use crate::direction::{HalfDifference, from_angles};
use crate::import::merl::{SCALE, middles};
use crate::material::{BrdfSample, Material};
use crate::params::Values;

const DIMS: [usize; 3] = [90, 90, 180];

pub(super) struct Merl;

impl BrdfExporter for Merl {
    fn name(&self) -> &'static str {
        "merl"
    }

    fn doc(&self) -> &'static str {
        "`NAME.binary`: the table of the MERL database over half and difference angles."
    }

    fn ending(&self) -> &'static str {
        "binary"
    }

    fn losses(&self, material: &dyn Material) -> Vec<&'static str> {
        let promises = material.promises();
        let mut losses = vec!["detail finer than the cells, which are one degree wide or less"];
        if !promises.isotropic {
            losses.push("the anisotropy: the half vector is taken along the tangent");
        }
        if !promises.reciprocal {
            losses.push("deviations from reciprocity: the mean over exchanged light and view is stored");
        }
        losses
    }

    fn write(&self, material: &dyn Material, _samples: &[BrdfSample], path: &Path, _options: &Values) -> Result<()> {
        let [theta_h, theta_d, phi_d] = middles(DIMS);
        let value = |i: usize| {
            let (h, d, p) = (i / (DIMS[1] * DIMS[2]), i / DIMS[2] % DIMS[1], i % DIMS[2]);
            let (wh, wd) = (from_angles(theta_h[h], 0.0), from_angles(theta_d[d], phi_d[p]));
            let (wi, wo) = HalfDifference { wh, wd }.directions();
            let mean = || 0.5 * (material.eval(Vec2::ZERO, wi, wo) + material.eval(Vec2::ZERO, wo, wi));
            (wi.z > 0.0 && wo.z > 0.0).then(mean)
        };
        let values: Vec<Option<Vec3>> = (0..DIMS.iter().product()).into_par_iter().map(value).collect();
        check_finite(values.iter().flatten().flat_map(|v| v.to_array()))?;
        crate::output::write_file(path, |file| {
            DIMS.iter().try_for_each(|&d| file.write_all(&(d as i32).to_le_bytes()))?;
            for channel in 0..3 {
                for value in &values {
                    let number = value.map_or(-1.0, |v| f64::from(v[channel]) / SCALE[channel]);
                    file.write_all(&number.to_le_bytes())?;
                }
            }
            Ok(())
        })
    }
}
