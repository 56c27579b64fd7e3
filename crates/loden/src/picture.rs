//! Images in linear light: reads PNG, JPEG, TIFF, BMP, EXR and Radiance HDR; writes PNG, JPEG and EXR.

pub(crate) mod decode;

use std::fs;
use std::io::Cursor;
use std::path::Path;

use exr::prelude::{
    Encoding as ExrEncoding, Image, Layer, LayerAttributes, LineOrder, SpecificChannels, WritableImage,
};
use glam::Vec3;
use half::f16;
use image::{ImageError, ImageFormat, ImageReader};

use crate::btf::FloatType;
use crate::color::Encoding;
use crate::{Error, Result};
use decode::{Decoded, Numbers, Problem};

/// Maximum width or height of an image.
pub const MAX_SIDE: usize = 65_536;

/// Maximum number of pixels of an image that is read; at 12 bytes each they take 3 GiB.
pub const MAX_PIXELS: usize = 1 << 28;

/// An image in linear RGB; row 0 is the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Pixels row by row, linear Rec. 709.
    pub rgb: Vec<Vec3>,
}

impl Picture {
    /// An image of one colour.
    pub fn filled(width: usize, height: usize, rgb: Vec3) -> Self {
        Self { width, height, rgb: vec![rgb; width * height] }
    }

    /// The pixel in column `x` of row `y`.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    pub fn at(&self, x: usize, y: usize) -> Vec3 {
        self.rgb[y * self.width + x]
    }

    /// Multiplies all pixels by a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f32) -> Self {
        self.rgb.iter_mut().for_each(|c| *c *= factor);
        self
    }

    /// 8-bit sRGB, three bytes per pixel; values outside 0..1 are clamped.
    pub fn to_srgb8(&self) -> Vec<u8> {
        let byte = |v: f32| (Encoding::Srgb.encode(v.clamp(0.0, 1.0)) * 255.0).round() as u8;
        self.rgb.iter().flat_map(|c| c.to_array().map(byte)).collect()
    }

    /// The content of an 8-bit sRGB PNG file; values outside 0..1 are clamped.
    ///
    /// # Errors
    /// If the image is empty or too large for the format.
    pub fn to_png(&self) -> std::result::Result<Vec<u8>, ImageError> {
        let mut bytes = Cursor::new(Vec::new());
        let (width, height) = (self.width as u32, self.height as u32);
        let colour = image::ExtendedColorType::Rgb8;
        image::write_buffer_with_format(&mut bytes, &self.to_srgb8(), width, height, colour, ImageFormat::Png)?;
        Ok(bytes.into_inner())
    }

    /// The content of a JPEG file of this quality, 1 to 100, with chroma at half resolution; values outside 0..1 are
    /// clamped. `None` if the image is empty or too large for the format.
    pub fn to_jpeg(&self, quality: u8) -> Option<Vec<u8>> {
        let (width, height) = (u16::try_from(self.width).ok()?, u16::try_from(self.height).ok()?);
        let mut bytes = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, quality);
        encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::R_4_2_0);
        encoder.encode(&self.to_srgb8(), width, height, jpeg_encoder::ColorType::Rgb).ok()?;
        Some(bytes)
    }

    /// Reads an image file; the format is detected from its content. Features of the file that are ignored are added
    /// to `warnings`, one sentence each.
    ///
    /// Integers are decoded from sRGB, and floating-point values are linear, unless the file says otherwise. Other
    /// primaries are converted to Rec. 709, and pictures are turned upright. Alpha is ignored. See `docs/formats.md`.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Unsupported`] for other formats; [`Error::Limit`] for an image larger than [`MAX_PIXELS`],
    /// before memory is allocated; [`Error::Invalid`] for damaged content.
    pub fn read(path: impl AsRef<Path>, warnings: &mut Vec<String>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = fs::read(path).map_err(Error::io(path))?;
        let decoded = decode::decode(&bytes, false).map_err(|e| located(path, e))?;
        let Decoded { width, height, numbers, warnings: found } = decoded;
        warnings.extend(found.iter().map(|warning| format!("{}: {warning}", path.display())));
        let srgb = |v: f32| Encoding::Srgb.decode(v);
        let rgb = match numbers {
            Numbers::U8(numbers) => {
                let table: Vec<f32> = (0..256).map(|i| srgb(i as f32 / 255.0)).collect();
                numbers.chunks_exact(3).map(|c| Vec3::from([0, 1, 2].map(|k| table[usize::from(c[k])]))).collect()
            }
            Numbers::U16(numbers) => {
                let value = |v: u16| srgb(f32::from(v) / 65_535.0);
                numbers.chunks_exact(3).map(|c| Vec3::new(value(c[0]), value(c[1]), value(c[2]))).collect()
            }
            Numbers::F32(numbers) => numbers.chunks_exact(3).map(Vec3::from_slice).collect(),
        };
        Ok(Self { width, height, rgb })
    }

    /// Reads a picture of light, as [`Picture::read`]; negative values, which camera pictures have, become 0 with a
    /// warning.
    ///
    /// # Errors
    /// See [`Picture::read`].
    pub fn read_light(path: impl AsRef<Path>, warnings: &mut Vec<String>) -> Result<Self> {
        let path = path.as_ref();
        let mut picture = Self::read(path, warnings)?;
        let (mut count, mut lowest) = (0, 0.0f32);
        for value in picture.rgb.iter_mut().flat_map(|c| c.as_mut()).filter(|value| **value < 0.0) {
            (count, lowest) = (count + 1, lowest.min(*value));
            *value = 0.0;
        }
        if count > 0 {
            warnings.push(format!("{}: {count} negative values become 0; the lowest is {lowest:e}", path.display()));
        }
        Ok(picture)
    }

    /// Width and height of an image file, from its header.
    ///
    /// # Errors
    /// See [`Picture::read`].
    pub fn dimensions(path: impl AsRef<Path>) -> Result<(usize, usize)> {
        let path = path.as_ref();
        let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format).map_err(Error::io(path))?;
        let (width, height) = reader.into_dimensions().map_err(|e| image_error(path, e))?;
        Ok((width as usize, height as usize))
    }

    /// Writes an 8-bit sRGB PNG or a 32-bit EXR; the extension of the file name selects the format.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for another extension; see also [`Picture::write_png`].
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("png") => self.write_png(path),
            Some("exr") => self.write_exr(path, FloatType::F32),
            _ => Err(Error::unsupported(path, "expected an image file ending in .png or .exr")),
        }
    }

    /// Writes an 8-bit sRGB PNG; values outside 0..1 are clamped.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the first pixel that is not finite; [`Error::Io`]. No partial file is left.
    pub fn write_png(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        self.check(path)?;
        let bytes = self.to_png().map_err(|e| image_error(path, e))?;
        crate::output::write_file(path, |f| f.write_all(&bytes))
    }

    /// Writes a linear EXR, losslessly compressed.
    ///
    /// # Errors
    /// See [`Picture::write_png`]. In half precision, a value above 65504 is an error too.
    pub fn write_exr(&self, path: impl AsRef<Path>, number: FloatType) -> Result<()> {
        let path = path.as_ref();
        self.check(path)?;
        if let (FloatType::F16, Some(i)) =
            (number, self.rgb.iter().position(|c| c.abs().max_element() > f16::MAX.to_f32()))
        {
            return Err(Error::invalid(path, self.pixel_name(i), format!("{} overflows half precision", self.rgb[i])));
        }
        let bytes = self.to_exr(number).map_err(|problem| Error::invalid(path, "EXR", problem))?;
        crate::output::write_file(path, |f| f.write_all(&bytes))
    }

    /// The content of a linear EXR file, losslessly compressed.
    ///
    /// # Errors
    /// If the image is empty, or a value is not finite or overflows the number type.
    pub fn to_exr(&self, number: FloatType) -> std::result::Result<Vec<u8>, String> {
        let largest = if number == FloatType::F16 { f16::MAX.to_f32() } else { f32::MAX };
        if let Some(i) = self.rgb.iter().position(|c| c.is_nan() || c.abs().max_element() > largest) {
            return Err(format!("{}: {} is not finite or overflows the number type", self.pixel_name(i), self.rgb[i]));
        }
        let mut file = Cursor::new(Vec::new());
        let size = (self.width, self.height);
        let attributes = LayerAttributes::default;
        // Otherwise blocks are stored in the order in which threads finish them.
        let encoding = ExrEncoding { line_order: LineOrder::Increasing, ..ExrEncoding::SMALL_FAST_LOSSLESS };
        let written = match number {
            FloatType::F32 => {
                let channels = SpecificChannels::rgb(|p: exr::math::Vec2<usize>| {
                    let c = self.at(p.x(), p.y());
                    (c.x, c.y, c.z)
                });
                let layer = Layer::new(size, attributes(), encoding, channels);
                Image::from_layer(layer).write().to_buffered(&mut file)
            }
            FloatType::F16 => {
                let channels = SpecificChannels::rgb(|p: exr::math::Vec2<usize>| {
                    let c = self.at(p.x(), p.y());
                    (f16::from_f32(c.x), f16::from_f32(c.y), f16::from_f32(c.z))
                });
                let layer = Layer::new(size, attributes(), encoding, channels);
                Image::from_layer(layer).write().to_buffered(&mut file)
            }
        };
        written.map_err(|e| e.to_string())?;
        Ok(file.into_inner())
    }

    fn pixel_name(&self, i: usize) -> String {
        format!("pixel ({}, {})", i % self.width.max(1), i / self.width.max(1))
    }

    fn check(&self, path: &Path) -> Result<()> {
        if self.rgb.is_empty() || self.rgb.len() != self.width * self.height {
            let problem = format!("found {} pixels for an image of {} x {}", self.rgb.len(), self.width, self.height);
            return Err(Error::invalid(path, "size", problem));
        }
        decode::check_size(self.width, self.height).map_err(|e| located(path, e))?;
        match self.rgb.iter().position(|c| !c.is_finite()) {
            Some(i) => Err(Error::invalid(
                path,
                self.pixel_name(i),
                format!("{} is not finite; the file is not written", self.rgb[i]),
            )),
            None => Ok(()),
        }
    }
}

fn located(path: &Path, problem: Problem) -> Error {
    match problem {
        Problem::Unsupported(what) => Error::unsupported(path, what),
        Problem::Invalid(problem) => Error::invalid(path, "image", problem),
        Problem::Limit(field, found, limit) => Error::Limit { path: path.into(), field: field.into(), found, limit },
    }
}

fn image_error(path: &Path, error: ImageError) -> Error {
    match error {
        ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => Error::io(path)(source),
        ImageError::Unsupported(e) => Error::unsupported(path, e.to_string()),
        other => Error::invalid(path, "image", other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Picture {
        let rgb = (0..35).map(|i| Vec3::new(i as f32 / 34.0, 0.5, 1.0 - i as f32 / 40.0)).collect();
        Picture { width: 7, height: 5, rgb }
    }

    fn largest_difference(a: &Picture, b: &Picture) -> f32 {
        assert_eq!((a.width, a.height), (b.width, b.height));
        a.rgb.iter().zip(&b.rgb).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max)
    }

    #[test]
    fn exr_files_are_deterministic() {
        // Enough blocks of unequal cost for threads to finish them out of order.
        let (width, height) = (256, 1024);
        let value = |i: usize| if (i / (32 * width)).is_multiple_of(2) { 0.5 } else { (i as f32 * 0.618).fract() };
        let picture = Picture { width, height, rgb: (0..width * height).map(|i| Vec3::splat(value(i))).collect() };
        let first = picture.to_exr(FloatType::F32).unwrap();
        assert!((0..24).all(|_| picture.to_exr(FloatType::F32).unwrap() == first));
    }

    #[test]
    fn every_format_round_trips() {
        let dir = tempfile::tempdir().unwrap();
        let picture = ramp();
        let (png, exr, half) = (dir.path().join("a.png"), dir.path().join("a.exr"), dir.path().join("h.exr"));
        picture.write(&png).unwrap();
        picture.write(&exr).unwrap();
        picture.write_exr(&half, FloatType::F16).unwrap();
        assert_eq!(Picture::read(&exr, &mut Vec::new()).unwrap(), picture);
        assert!(largest_difference(&Picture::read(&half, &mut Vec::new()).unwrap(), &picture) <= 1.0 / 2048.0);
        // Half an 8-bit step, at the steepest part of the sRGB curve.
        assert!(largest_difference(&Picture::read(&png, &mut Vec::new()).unwrap(), &picture) <= 0.5 / 255.0 * 2.4);
    }

    #[test]
    fn sixteen_bit_png_keeps_its_precision() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let values: Vec<u16> = (0..48).map(|i| i * 1300).collect();
        image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(4, 4, values.clone()).unwrap().save(&path).unwrap();
        let read = Picture::read(&path, &mut Vec::new()).unwrap();
        for (found, stored) in read.rgb.iter().flat_map(|c| c.to_array()).zip(values) {
            assert_eq!(found, Encoding::Srgb.decode(f32::from(stored) / 65_535.0));
        }
    }

    #[test]
    fn jpeg_round_trips() {
        let mut picture = Picture::filled(40, 24, Vec3::new(0.1, 0.3, 0.6));
        picture.rgb[..40 * 12].fill(Vec3::new(0.5, 0.2, 0.05));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.jpg");
        fs::write(&path, picture.to_jpeg(90).unwrap()).unwrap();
        let found = Picture::read(&path, &mut Vec::new()).unwrap();
        assert_eq!((found.width, found.height), (40, 24));
        let mean = |p: &Picture| p.rgb.iter().sum::<Vec3>() / p.rgb.len() as f32;
        assert!(mean(&found).abs_diff_eq(mean(&picture), 0.01), "{} {}", mean(&found), mean(&picture));
        assert_eq!(Picture::filled(70_000, 1, Vec3::ONE).to_jpeg(90), None);
    }

    #[test]
    fn hdr_and_jpeg_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.hdr");
        let file = fs::File::create(&path).unwrap();
        let pixels = [image::Rgb([4.0f32, 2.0, 1.0]); 12];
        image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, 4, 3).unwrap();
        assert_eq!(Picture::read(&path, &mut Vec::new()).unwrap(), Picture::filled(4, 3, Vec3::new(4.0, 2.0, 1.0)));
        let path = dir.path().join("a.jpg");
        let encoder = jpeg_encoder::Encoder::new_file(&path, 100).unwrap();
        encoder.encode(&[188; 3 * 16 * 8], 16, 8, jpeg_encoder::ColorType::Rgb).unwrap();
        let grey = Picture::filled(16, 8, Vec3::splat(Encoding::Srgb.decode(188.0 / 255.0)));
        assert!(largest_difference(&Picture::read(&path, &mut Vec::new()).unwrap(), &grey) < 0.01);
    }

    #[test]
    fn images_that_are_not_finite_are_not_written() {
        let dir = tempfile::tempdir().unwrap();
        let mut picture = ramp();
        picture.rgb[9].y = f32::NAN;
        for name in ["a.png", "a.exr"] {
            let path = dir.path().join(name);
            let error = picture.write(&path).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("pixel (2, 1)"), "{error}");
            assert!(!path.exists());
        }
        let bright = Picture::filled(1, 1, Vec3::splat(1e6));
        assert!(bright.write_exr(dir.path().join("b.exr"), FloatType::F16).is_err());
        assert!(matches!(ramp().write(dir.path().join("a.gif")), Err(Error::Unsupported { .. })));
    }

    #[test]
    fn errors_of_damaged_files_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a.png", "a.exr"] {
            let path = dir.path().join(name);
            ramp().write(&path).unwrap();
            let bytes = fs::read(&path).unwrap();
            for length in [0, 5, 20, bytes.len() / 2] {
                fs::write(&path, &bytes[..length]).unwrap();
                let error = Picture::read(&path, &mut Vec::new()).unwrap_err().to_string();
                assert!(error.contains(name), "{error}");
            }
        }
    }

    #[test]
    fn a_huge_header_is_refused_before_allocation() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.hdr");
        fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n").unwrap();
        assert!(matches!(Picture::read(&path, &mut Vec::new()), Err(Error::Limit { found: 3_600_000_000, .. })));
    }
}
