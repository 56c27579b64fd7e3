//! Several cosine lobes about generalised mirror directions.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::lambert::diffuse_term;
use super::lobe::{power_pdf, power_sample};
use super::{KD, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};

/// # Model
/// f = kd/pi + sum over lobes of ks (n + 2) / (2 pi) max(0, cx wi.x wo.x + cy wi.y wo.y + cz wi.z wo.z)^n.
/// cx = cy = -1, cz = 1 is Phong's normalised lobe; cx = cy = 1 is a retro-reflective lobe; cx and cy of different
/// magnitude are anisotropic. With |c| <= 1 a lobe reflects at most ks.
///
/// # Limits
/// At most three lobes. Not normalised where |c| < 1: ks absorbs the scale.
///
/// # References
/// lafortune1997 (eq. 6, 8). The paper folds the scale into the c; we bound them by 1 and give each lobe a colour.
pub(super) struct LafortuneModel;

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        /// Number of lobes in use.
        lobes: usize [1..=3] = 1,
        /// Factor of the first lobe.
        ks: [f64; 3] [0.0..=1000.0] = 0.5,
        /// Weight of x in the first lobe.
        cx: f64 [-1.0..=1.0] = -0.95,
        /// Weight of y in the first lobe.
        cy: f64 [-1.0..=1.0] = -0.95,
        /// Weight of z in the first lobe.
        cz: f64 [0.0..=1.0] = 0.9,
        /// Sharpness of the first lobe.
        exponent: f64 [0.0..=100_000.0] = 40,
        /// Factor of the second lobe.
        ks_2: [f64; 3] [0.0..=1000.0] = 0.1,
        /// Weight of x in the second lobe.
        cx_2: f64 [-1.0..=1.0] = -0.8,
        /// Weight of y in the second lobe.
        cy_2: f64 [-1.0..=1.0] = -0.8,
        /// Weight of z in the second lobe.
        cz_2: f64 [0.0..=1.0] = 1,
        /// Sharpness of the second lobe.
        exponent_2: f64 [0.0..=100_000.0] = 8,
        /// Factor of the third lobe.
        ks_3: [f64; 3] [0.0..=1000.0] = 0.1,
        /// Weight of x in the third lobe.
        cx_3: f64 [-1.0..=1.0] = 0.9,
        /// Weight of y in the third lobe.
        cy_3: f64 [-1.0..=1.0] = 0.9,
        /// Weight of z in the third lobe.
        cz_3: f64 [0.0..=1.0] = 0.9,
        /// Sharpness of the third lobe.
        exponent_3: f64 [0.0..=100_000.0] = 4,
    }
}

impl Model for LafortuneModel {
    fn name(&self) -> &'static str {
        "lafortune"
    }

    fn doc(&self) -> &'static str {
        "Several cosine lobes about generalised mirror directions."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks", "ks-2", "ks-3"]
    }

    fn ties(&self) -> &'static [(&'static str, &'static str)] {
        &[("cy", "cx"), ("cy-2", "cx-2"), ("cy-3", "cx-3")]
    }

    fn homogeneous(&self) -> &'static [&'static [&'static str]] {
        &[&["cx", "cy", "cz"], &["cx-2", "cy-2", "cz-2"], &["cx-3", "cy-3", "cz-3"]]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let o = Options::from_values(values)?;
        let lobes = [
            Lobe { c: DVec3::new(o.cx, o.cy, o.cz), exponent: o.exponent },
            Lobe { c: DVec3::new(o.cx_2, o.cy_2, o.cz_2), exponent: o.exponent_2 },
            Lobe { c: DVec3::new(o.cx_3, o.cy_3, o.cz_3), exponent: o.exponent_3 },
        ];
        Ok(Box::new(Lafortune(lobes.into_iter().take(o.lobes).collect())))
    }
}

#[derive(Debug)]
struct Lobe {
    c: DVec3,
    exponent: f64,
}

#[derive(Debug)]
struct Lafortune(Vec<Lobe>);

impl Shape for Lafortune {
    fn count(&self) -> usize {
        1 + self.0.len()
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let mut terms = diffuse_term();
        for (term, lobe) in terms[1..].iter_mut().zip(&self.0) {
            let cosine = (lobe.c * wi).dot(wo);
            if cosine > 0.0 {
                *term = DVec3::splat((lobe.exponent + 2.0) / (2.0 * PI) * cosine.powf(lobe.exponent));
            }
        }
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        if term == 0 {
            return Some(diffuse_sample(random));
        }
        let lobe = &self.0[term - 1];
        Some(power_sample((lobe.c * wo).try_normalize()?, lobe.exponent, random))
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        let lobe = &self.0[term - 1];
        (lobe.c * wo).try_normalize().map_or(0.0, |axis| power_pdf(axis.dot(wi), lobe.exponent))
    }

    fn promises(&self) -> Promises {
        // opposite signs of equal magnitude are isotropic, too
        let isotropic = self.0.iter().all(|lobe| lobe.c.x == lobe.c.y);
        Promises { reciprocal: true, energy_conserving: true, isotropic }
    }
}
