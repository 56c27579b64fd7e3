//! The virtual goniometer: measured materials made by simulation.
//!
//! A [`Sample`] builds a periodic [`HeightField`]; [`acquire`] measures it for any direction sets with shadowing,
//! masking and interreflection, and [`photograph`] takes raw photographs of it. All samples stand in [`SAMPLES`]; [`maps`] makes one from a user's pictures.

mod field;
mod goniometer;
pub mod photograph;
mod random;
mod reflect;
mod sample;
mod shade;
mod surface;
#[cfg(test)]
mod tests;

pub use field::{Finish, GRID_RANGE, HeightField};
pub use goniometer::{Options, acquire, measure};
pub use sample::{SAMPLES, Sample, maps, named};
