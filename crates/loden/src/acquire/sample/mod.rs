//! Built-in samples, one file each, and the sample made from pictures.

mod gravel;
mod lacquer;
mod leather;
pub mod maps;
mod noise;
mod twill;

use super::field::HeightField;
use crate::Result;
use crate::params::{Param, Values};

/// A sample that is modelled as geometry.
pub trait Sample: Sync {
    /// Name on the command line.
    fn name(&self) -> &'static str;

    /// One sentence for the reference page.
    fn doc(&self) -> &'static str;

    /// Its parameters.
    fn params(&self) -> &'static [Param];

    /// Builds the periodic height field on `grid` x `grid` points. `values` are those of [`Sample::params`]. The same
    /// seed gives the same field.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if `grid` is not a power of two or out of range, or if a value is not allowed.
    fn build(&self, values: &Values, grid: usize, seed: u64) -> Result<HeightField>;
}

/// All built-in samples.
pub const SAMPLES: &[&dyn Sample] = &[&gravel::Gravel, &lacquer::Lacquer, &leather::Leather, &twill::Twill];

/// The built-in sample of this name.
pub fn named(name: &str) -> Option<&'static dyn Sample> {
    SAMPLES.iter().copied().find(|s| s.name() == name)
}

/// A linear colour from 8-bit sRGB values.
fn srgb(r: u8, g: u8, b: u8) -> glam::Vec3 {
    glam::Vec3::from([r, g, b].map(|v| crate::color::Encoding::Srgb.decode(f32::from(v) / 255.0)))
}

/// Smooth step from 0 at `low` to 1 at `high`.
fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
