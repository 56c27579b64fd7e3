//! Several cosine lobes about generalised mirror directions.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::lambert::diffuse_term;
use super::lobe::{power_pdf, power_sample};
use super::{KD, Model, Shape, Terms, color, real};
use crate::material::Promises;
use crate::params::{Kind, Param, Values};

/// # Model
/// f = kd/pi + sum over lobes of ks (n + 2) / (2 pi) max(0, cx wi.x wo.x + cy wi.y wo.y + cz wi.z wo.z)^n.
/// cx = cy = -1, cz = 1 is Phong's normalised lobe, cx = cy = 1 one back towards the light; cx and cy of different
/// size are anisotropic. With |c| <= 1 a lobe reflects at most ks.
///
/// # Limits
/// Up to three lobes. Not normalised where |c| < 1: ks takes up the scale.
///
/// # References
/// lafortune1997 (eq. 6, 8). The paper folds the scale into the c; we bound them by 1 and give each lobe a colour.
pub(super) struct Entry;

const PARAMS: &[Param] = &[
    KD,
    Param {
        name: "lobes",
        unit: "",
        kind: Kind::Integer { min: 1, max: 3 },
        default: "1",
        doc: "How many lobes are used.",
    },
    color("ks", 1000.0, "0.5", "Factor of the first lobe."),
    real("cx", -1.0, 1.0, "-0.95", "Weight of x in the first lobe."),
    real("cy", -1.0, 1.0, "-0.95", "Weight of y in the first lobe."),
    real("cz", 0.0, 1.0, "0.9", "Weight of z in the first lobe."),
    real("exponent", 0.0, 100_000.0, "40", "Sharpness of the first lobe."),
    color("ks-2", 1000.0, "0.1", "Factor of the second lobe."),
    real("cx-2", -1.0, 1.0, "-0.8", "Weight of x in the second lobe."),
    real("cy-2", -1.0, 1.0, "-0.8", "Weight of y in the second lobe."),
    real("cz-2", 0.0, 1.0, "1", "Weight of z in the second lobe."),
    real("exponent-2", 0.0, 100_000.0, "8", "Sharpness of the second lobe."),
    color("ks-3", 1000.0, "0.1", "Factor of the third lobe."),
    real("cx-3", -1.0, 1.0, "0.9", "Weight of x in the third lobe."),
    real("cy-3", -1.0, 1.0, "0.9", "Weight of y in the third lobe."),
    real("cz-3", 0.0, 1.0, "0.9", "Weight of z in the third lobe."),
    real("exponent-3", 0.0, 100_000.0, "4", "Sharpness of the third lobe."),
];

impl Model for Entry {
    fn name(&self) -> &'static str {
        "lafortune"
    }

    fn doc(&self) -> &'static str {
        "Several cosine lobes about generalised mirror directions."
    }

    fn params(&self) -> &'static [Param] {
        PARAMS
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

    fn shape(&self, values: &Values) -> Box<dyn Shape> {
        let lobe = |suffix: &str| {
            let number = |name: &str| values.real(&format!("{name}{suffix}"));
            Lobe { c: DVec3::new(number("cx"), number("cy"), number("cz")), exponent: number("exponent") }
        };
        let count = values.integer("lobes") as usize;
        Box::new(Lafortune(["", "-2", "-3"].into_iter().take(count).map(lobe).collect()))
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
        // opposite signs of equal size turn with the surface, too
        let isotropic = self.0.iter().all(|lobe| lobe.c.x == lobe.c.y);
        Promises { reciprocal: true, energy_conserving: true, isotropic }
    }
}
