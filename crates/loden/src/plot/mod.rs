//! Plots of reflectance: spheres, polar slices, the hemisphere, albedo over angle, rate-distortion curves.

mod hemisphere;
mod polar;
mod rate;
mod spheres;
mod svg;

pub use hemisphere::hemisphere;
pub use polar::{albedo, polar};
pub use rate::{error_of_components, rate_distortion};
pub use spheres::{named_spheres, spheres};

use crate::material::Material;

/// A material and its name in the legend.
pub type NamedMaterial<'a> = (&'a str, &'a dyn Material);
