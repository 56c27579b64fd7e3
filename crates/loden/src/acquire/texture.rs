//! Pictures on samples.

use std::path::Path;

use glam::{Vec2, Vec3};

use crate::color::Encoding;
use crate::picture::decode::{Numbers, Reading, decode};
use crate::picture::located;
use crate::{Error, Result};

/// Largest width and height of a texture, in pixels.
const LIMIT: usize = 16_384;

/// A picture in linear light that repeats; row 0 is at the bottom.
#[derive(Debug, Clone)]
pub struct Texture {
    pub(super) width: usize,
    pub(super) height: usize,
    pixels: Vec<Vec3>,
}

impl Texture {
    /// Reads a picture file; 8-bit and 16-bit values are sRGB-encoded.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Invalid`], [`Error::Unsupported`] or [`Error::Limit`] with the path of the picture.
    pub fn open(path: &Path) -> Result<Self> {
        Self::decode(path, &std::fs::read(path).map_err(Error::io(path))?)
    }

    /// Reads a picture file whose 8-bit and 16-bit values are linear.
    pub(super) fn open_linear(path: &Path) -> Result<Self> {
        Self::read(path, &std::fs::read(path).map_err(Error::io(path))?, true)
    }

    /// Decodes the bytes of a picture file; errors name the file `path`, which they are from.
    ///
    /// # Errors
    /// As [`Texture::open`].
    pub fn decode(path: &Path, bytes: &[u8]) -> Result<Self> {
        Self::read(path, bytes, false)
    }

    fn read(path: &Path, bytes: &[u8], linear: bool) -> Result<Self> {
        let decoded = decode(bytes, Reading::default()).map_err(|e| located(path, e))?;
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

    /// The value at a texture coordinate, bilinear between pixels.
    #[inline]
    pub(super) fn at(&self, uv: Vec2) -> Vec3 {
        self.pixel((uv - uv.floor()) * Vec2::new(self.width as f32, self.height as f32) - 0.5)
    }

    /// The value at a position in pixels, whose centres are at whole numbers.
    #[inline]
    pub(super) fn pixel(&self, q: Vec2) -> Vec3 {
        let (cell, f) = (q.floor(), q - q.floor());
        let at = |dx: i32, dy: i32| {
            let x = (cell.x as i32 + dx).rem_euclid(self.width as i32) as usize;
            let y = (cell.y as i32 + dy).rem_euclid(self.height as i32) as usize;
            self.pixels[y * self.width + x]
        };
        at(0, 0).lerp(at(1, 0), f.x).lerp(at(0, 1).lerp(at(1, 1), f.x), f.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_stand_upright_and_repeat() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.png");
        // red above, blue below
        let picture = image::RgbImage::from_fn(4, 4, |_, y| image::Rgb(if y < 2 { [255, 0, 0] } else { [0, 0, 255] }));
        picture.save(&path).unwrap();
        let texture = Texture::open(&path).unwrap();
        for (uv, expected) in [(Vec2::new(0.3, 0.75), Vec3::X), (Vec2::new(5.3, -0.75), Vec3::Z)] {
            assert!((texture.at(uv) - expected).length() < 1e-5, "{uv}");
        }
        assert!((texture.at(Vec2::new(0.3, 0.5)) - Vec3::new(0.5, 0.0, 0.5)).length() < 1e-5);
    }
}
