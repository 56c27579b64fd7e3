//! Measured reflectance without texture.

mod half_table;
mod in_out_table;
mod rgl;
pub(super) mod scattered;

use std::f32::consts::PI;
use std::fmt::Debug;

use glam::{Vec2, Vec3};

pub use half_table::{HalfTable, Period};
pub use in_out_table::{Azimuths, InOutTable};
pub use rgl::{RglBrdf, RglData};
pub use scattered::{Asymmetry, Scattered};

use super::sampler::HalfSampler;
use super::{Material, Promises, Sample};
use crate::{Error, Result};

/// Upper bound of measured numbers; products of a few such numbers stay finite.
const LARGEST: f32 = 1e12;

/// Fails if a number exceeds [`LARGEST`]. NaN stands for a missing number and is accepted.
fn possible(name: &str, numbers: impl IntoIterator<Item = f32>) -> Result<()> {
    match numbers.into_iter().enumerate().find(|(_, v)| v.abs() > LARGEST) {
        Some((i, v)) => Err(Error::parameter(name, format!("number {i} is {v}, expected at most {LARGEST:e}"))),
        None => Ok(()),
    }
}

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

/// A BRDF, measured or given by a formula: a material without texture, with values at pairs of directions.
pub trait Brdf: Material + Debug {
    /// The measured values, or the nodes of a table, in the file's order; for a formula, values on a grid. Fitting
    /// and factorisation use these.
    fn samples(&self) -> Vec<BrdfSample>;

    /// Facts and warnings about the file.
    fn notes(&self) -> &Notes {
        const NONE: &Notes = &Notes { facts: Vec::new(), warnings: Vec::new() };
        NONE
    }

    /// The measured wavelengths in nm, ascending; empty for a file of RGB values.
    fn wavelengths(&self) -> &[f32] {
        &[]
    }

    /// The BRDF in 1/sr at each of [`Brdf::wavelengths`]; empty for a file of RGB values.
    fn spectrum(&self, wi: Vec3, wo: Vec3) -> Vec<f32> {
        let _ = (wi, wo);
        Vec::new()
    }
}

/// Facts and warnings about a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Notes {
    /// (name, value), as shown to the user.
    pub facts: Vec<(&'static str, String)>,
    /// Sentences about what was assumed, repaired or is doubtful.
    pub warnings: Vec<String>,
}

impl Notes {
    /// Adds a fact.
    pub fn fact(&mut self, name: &'static str, value: impl ToString) {
        self.facts.push((name, value.to_string()));
    }

    /// Replaces negative values by 0, and notes how many there were.
    pub fn clamp_negative(&mut self, values: &mut [f32]) {
        let (count, lowest) = (values.iter().filter(|v| **v < 0.0).count(), values.iter().copied().fold(0.0, f32::min));
        values.iter_mut().for_each(|v| *v = v.max(0.0));
        self.negative(count, values.len(), lowest);
    }

    /// Notes that `count` of `total` values were negative and were set to 0.
    pub fn negative(&mut self, count: usize, total: usize, lowest: f32) {
        self.fact("negative", count);
        if count > 0 {
            self.warnings.push(format!("{count} of {total} values are negative, down to {lowest}; they are set to 0"));
        }
    }
}

/// A tabulated BRDF with its rule of interpolation.
pub trait Table: Send + Sync + Debug {
    /// f_r in 1/sr, without the cosine, for two directions above the surface.
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3;

    /// The tabulated values.
    fn samples(&self) -> Vec<BrdfSample>;

    /// The properties of the interpolated BRDF.
    fn promises(&self) -> Promises;

    /// Like [`Brdf::wavelengths`].
    fn wavelengths(&self) -> &[f32] {
        &[]
    }

    /// Like [`Brdf::spectrum`], for two directions above the surface.
    fn spectrum(&self, wi: Vec3, wo: Vec3) -> Vec<f32> {
        let _ = (wi, wo);
        Vec::new()
    }
}

/// A [`Table`] with importance sampling: a material.
#[derive(Debug)]
pub struct Tabulated<T> {
    table: T,
    sampler: HalfSampler,
    notes: Notes,
}

impl<T: Table> Tabulated<T> {
    /// Creates the material. Evaluates the table some thousand times to build the sampler.
    pub fn new(table: T, notes: Notes) -> Self {
        let sampler = HalfSampler::new(table.promises().isotropic, |wi, wo| table.value(wi, wo));
        Self { table, sampler, notes }
    }

    /// The table itself.
    pub fn table(&self) -> &T {
        &self.table
    }
}

impl<T: Table> Material for Tabulated<T> {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.eval(uv, wi, wo) * (PI * wi.z.max(0.0))
    }

    fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        // This form of the condition also rejects NaN
        if wi.z > 0.0 && wo.z > 0.0 { self.table.value(wi, wo).max(Vec3::ZERO) } else { Vec3::ZERO }
    }

    fn promises(&self) -> Promises {
        self.table.promises()
    }

    fn sample(&self, _uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.sampler.sample(wo, random)
    }

    fn pdf(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.sampler.pdf(wi, wo)
    }
}

impl<T: Table> Brdf for Tabulated<T> {
    fn samples(&self) -> Vec<BrdfSample> {
        self.table.samples()
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }

    fn wavelengths(&self) -> &[f32] {
        self.table.wavelengths()
    }

    fn spectrum(&self, wi: Vec3, wo: Vec3) -> Vec<f32> {
        if wi.z > 0.0 && wo.z > 0.0 { self.table.spectrum(wi, wo) } else { vec![0.0; self.wavelengths().len()] }
    }
}

/// The two nodes of an ascending list around `x`, and the weight of the second. Clamped at the ends.
fn bracket(nodes: &[f32], x: f32) -> (usize, usize, f32) {
    let above = nodes.partition_point(|&node| node <= x);
    if above == 0 || above == nodes.len() {
        let end = above.saturating_sub(1);
        return (end, end, 0.0);
    }
    let (a, b) = (nodes[above - 1], nodes[above]);
    (above - 1, above, (x - a) / (b - a))
}
