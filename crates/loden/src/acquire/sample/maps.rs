//! A sample made from a height map and an albedo map.

use std::path::Path;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::acquire::field::{Finish, HeightField};
use crate::color::{Encoding, luminance};
use crate::picture::decode::{Numbers, Reading, decode};
use crate::picture::located;
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

/// Largest width and height of a picture, in pixels.
const LIMIT: usize = 16_384;

/// A periodic linear picture, row 0 at the bottom.
struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<Vec3>,
}

impl Picture {
    /// Reads a picture. `linear` says that 8-bit and 16-bit values are linear instead of sRGB-encoded.
    fn open(path: &Path, linear: bool) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let decoded = decode(&bytes, Reading::default()).map_err(|e| located(path, e))?;
        let (width, height) = (decoded.width, decoded.height);
        for (field, found) in [("width", width), ("height", height)] {
            if found > LIMIT {
                let (found, limit) = (found as u64, LIMIT as u64);
                return Err(Error::Limit { path: path.into(), field: field.into(), found, limit });
            }
        }
        let is_float = matches!(decoded.numbers, Numbers::F32(_));
        let upright = decoded.linear((linear && !is_float).then_some(Encoding::Linear));
        if upright.iter().any(|p| !p.is_finite()) {
            return Err(Error::invalid(path, "pixels", "found a value that is not finite"));
        }
        let pixels = upright.chunks_exact(width).rev().flatten().copied().collect();
        Ok(Self { width, height, pixels })
    }

    /// The mean over the square of side 1/`grid` around grid point (x, y); a linear interpolation where pixels are
    /// larger than the square.
    fn sample(&self, x: usize, y: usize, grid: usize) -> Vec3 {
        let per = Vec2::new(self.width as f32, self.height as f32) / grid as f32;
        let taps = [per.x, per.y].map(|p| p.ceil().max(1.0) as usize);
        let mut sum = Vec3::ZERO;
        for (j, i) in (0..taps[1]).flat_map(|j| (0..taps[0]).map(move |i| (j, i))) {
            let tap = Vec2::new((i as f32 + 0.5) / taps[0] as f32, (j as f32 + 0.5) / taps[1] as f32);
            sum += self.linear((Vec2::new(x as f32, y as f32) + tap) * per - Vec2::splat(0.5));
        }
        sum / (taps[0] * taps[1]) as f32
    }

    fn linear(&self, q: Vec2) -> Vec3 {
        let (cell, f) = (q.floor(), q - q.floor());
        let at = |dx: i32, dy: i32| {
            let x = (cell.x as i32 + dx).rem_euclid(self.width as i32) as usize;
            let y = (cell.y as i32 + dy).rem_euclid(self.height as i32) as usize;
            self.pixels[y * self.width + x]
        };
        at(0, 0).lerp(at(1, 0), f.x).lerp(at(0, 1).lerp(at(1, 1), f.x), f.y)
    }
}

/// Builds a field from a height map (its luminance; 8-bit and 16-bit values are linear, white is 1) and an albedo map
/// (8-bit and 16-bit values are sRGB-encoded), both periodic. Without an albedo map, everything is mid-grey.
///
/// # Errors
/// [`Error::Io`], [`Error::Invalid`] or [`Error::Unsupported`] with the path of the picture; [`Error::Parameter`] if
/// `grid` is not a power of two or a height exceeds one period.
pub fn build(height_map: &Path, albedo_map: Option<&Path>, options: &Options, grid: usize) -> Result<HeightField> {
    let heights = Picture::open(height_map, true)?;
    let albedo = albedo_map.map(|path| Picture::open(path, false)).transpose()?;
    for (path, picture) in [(Some(height_map), Some(&heights)), (albedo_map, albedo.as_ref())] {
        let Some((path, p)) = path.zip(picture) else { continue };
        if p.width != p.height {
            let problem = format!("found {} x {} pixels, expected a square tile", p.width, p.height);
            return Err(Error::invalid(path, "size", problem));
        }
    }
    let Options { height_scale: scale, specular: f0, roughness } = *options;
    let points = (0..grid * grid).into_par_iter().map(|k| {
        let color = albedo.as_ref().map_or(Vec3::splat(0.5), |a| a.sample(k % grid, k / grid, grid));
        let height = scale * luminance(heights.sample(k % grid, k / grid, grid).to_array());
        (height, Finish::coated(color.clamp(Vec3::ZERO, Vec3::ONE), f0, roughness))
    });
    let (h, finish) = points.unzip();
    HeightField::new(grid, h, finish)
}
