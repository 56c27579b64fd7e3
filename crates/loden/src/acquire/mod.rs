//! The virtual goniometer: simulated measurements of built-in or user-made samples.
//!
//! A [`Sample`] builds a periodic [`HeightField`]. [`acquire`] measures it for any direction sets, with shadowing,
//! masking and interreflection; [`photograph`] renders raw photographs of it. All built-in samples are listed in
//! [`SAMPLES`]; [`maps`] makes one from pictures.
//!
//! Choose it where a measured BTF is not at hand or where a reference without camera noise is needed.

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
