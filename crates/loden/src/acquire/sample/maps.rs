//! A sample made from a height map and an albedo map.

use std::path::Path;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::acquire::field::{Finish, HeightField};
use crate::acquire::texture::Texture;
use crate::color::luminance;
use crate::{Error, Result};

crate::params! {
    /// The parameters of a sample made from maps.
    #[derive(Copy)]
    pub struct Options {
        /// Height of white above black, as a fraction of the side of the tile.
        pub height_scale: f32 [0.0..=1.0, "periods"] = 0.05,
        /// Reflectance of the coat at normal incidence; 0 is matt.
        pub specular: f32 [0.0..=1.0] = 0.04,
        /// GGX alpha of the coat.
        pub roughness: f32 [0.02..=1.0] = 0.4,
    }
}

/// The mean of a picture over the square of side 1/`grid` around grid point (x, y); a linear interpolation where pixels are
/// larger than the square.
fn sample(picture: &Texture, x: usize, y: usize, grid: usize) -> Vec3 {
    let per = Vec2::new(picture.width as f32, picture.height as f32) / grid as f32;
    let taps = [per.x, per.y].map(|p| p.ceil().max(1.0) as usize);
    let mut sum = Vec3::ZERO;
    for (j, i) in (0..taps[1]).flat_map(|j| (0..taps[0]).map(move |i| (j, i))) {
        let tap = Vec2::new((i as f32 + 0.5) / taps[0] as f32, (j as f32 + 0.5) / taps[1] as f32);
        sum += picture.pixel((Vec2::new(x as f32, y as f32) + tap) * per - Vec2::splat(0.5));
    }
    sum / (taps[0] * taps[1]) as f32
}

/// Builds a field from a height map (its luminance; 8-bit and 16-bit values are linear, white is 1) and an albedo map
/// (8-bit and 16-bit values are sRGB-encoded), both periodic. Without an albedo map, everything is mid-grey.
///
/// # Errors
/// [`Error::Io`], [`Error::Invalid`] or [`Error::Unsupported`] with the path of the picture; [`Error::Parameter`] if
/// `grid` is not a power of two or a height exceeds one period.
pub fn build(height_map: &Path, albedo_map: Option<&Path>, options: &Options, grid: usize) -> Result<HeightField> {
    let heights = Texture::open_linear(height_map)?;
    let albedo = albedo_map.map(Texture::open).transpose()?;
    for (path, picture) in [(Some(height_map), Some(&heights)), (albedo_map, albedo.as_ref())] {
        let Some((path, p)) = path.zip(picture) else { continue };
        if p.width != p.height {
            let problem = format!("found {} x {} pixels, expected a square tile", p.width, p.height);
            return Err(Error::invalid(path, "size", problem));
        }
    }
    let Options { height_scale: scale, specular: f0, roughness } = *options;
    let points = (0..grid * grid).into_par_iter().map(|k| {
        let color = albedo.as_ref().map_or(Vec3::splat(0.5), |a| sample(a, k % grid, k / grid, grid));
        let height = scale * luminance(sample(&heights, k % grid, k / grid, grid).to_array());
        (height, Finish::coated(color.clamp(Vec3::ZERO, Vec3::ONE), f0, roughness))
    });
    let (h, finish) = points.unzip();
    HeightField::new(grid, h, finish)
}
