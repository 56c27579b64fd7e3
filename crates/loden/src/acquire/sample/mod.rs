//! Built-in samples, one file each, and the sample made from a user's pictures.

mod gravel;
mod lacquer;
mod leather;
pub mod maps;
mod noise;
mod twill;

use super::field::HeightField;
use crate::Result;
use crate::params::{Param, Values};

/// A material built from geometry.
pub trait Sample: Sync {
    /// The user's word for it.
    fn name(&self) -> &'static str;

    /// One sentence.
    fn doc(&self) -> &'static str;

    /// What can be chosen.
    fn params(&self) -> &'static [Param];

    /// The height field on `grid` x `grid` points; `values` are of the table [`Sample::params`]. It is periodic, and
    /// the same for the same seed.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if `grid` is not a power of two or out of range, or values contradict each other.
    fn build(&self, values: &Values, grid: usize, seed: u64) -> Result<HeightField>;
}

/// All built-in samples.
pub const SAMPLES: &[&dyn Sample] = &[&gravel::Gravel, &lacquer::Lacquer, &leather::Leather, &twill::Twill];

/// The built-in sample of this name.
pub fn named(name: &str) -> Option<&'static dyn Sample> {
    SAMPLES.iter().copied().find(|s| s.name() == name)
}

/// A colour from the display values of a picture, 0..=255.
fn srgb(r: u8, g: u8, b: u8) -> glam::Vec3 {
    glam::Vec3::from([r, g, b].map(|v| crate::color::Encoding::Srgb.decode(f32::from(v) / 255.0)))
}

/// 0 below `low`, 1 above `high`, smooth between.
fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
