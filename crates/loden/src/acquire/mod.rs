//! The virtual goniometer: simulated measurements of built-in or user-made samples.
//!
//! A [`Sample`] builds a periodic [`HeightField`]; [`maps`] makes one from pictures. A [`Solid`] has overhangs and holes:
//! [`mesh`] reads one from a file, [`yarn`] weaves one. [`acquire()`] measures either for any direction sets, with
//! shadowing, masking and interreflection, [`coverage`] says how much of each texel is sample, and [`photograph`] renders raw
//! photographs. All samples built in as height fields are listed in [`SAMPLES`].
//!
//! Choose it where a measured BTF is not at hand or where a reference without camera noise is needed.

mod field;
mod goniometer;
pub mod photograph;
mod random;
mod reflect;
mod relief;
mod sample;
mod shade;
mod solid;
mod specimen;
mod surface;
#[cfg(test)]
mod tests;
mod texture;

pub use field::{Finish, GRID_RANGE, HeightField};
pub use goniometer::{Options, acquire, coverage, measure};
pub use sample::{SAMPLES, Sample, maps, named};
pub use solid::{Coat, Paint, Solid, mesh, yarn};
pub use specimen::Specimen;
pub use texture::Texture;
