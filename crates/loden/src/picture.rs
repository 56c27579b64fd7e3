//! Images in linear light: reads PNG, JPEG, TIFF, BMP, EXR and Radiance HDR; writes PNG, JPEG and EXR.

#[cfg(feature = "import-images")]
pub(crate) mod cubic;
pub(crate) mod decode;
pub(crate) mod four_channels;
mod label;
mod orientation;
mod primaries;
mod tone;

use std::fs;
use std::io::Cursor;
use std::path::Path;

use exr::meta::attribute::{Chromaticities, Text};
use exr::prelude::{
    Encoding as ExrEncoding, Image, Layer, LayerAttributes, LineOrder, SpecificChannels, WritableImage,
};
use glam::Vec3;
use half::f16;
use image::{ImageError, ImageFormat};

use crate::btf::FloatType;
use crate::color::Encoding;
use crate::{Error, Result};
use decode::{Problem, Reading};
pub use label::CELL;
pub use tone::ToneMap;

/// What pictures say that wrote them.
const PROGRAM: &str = concat!("loden ", env!("CARGO_PKG_VERSION"));

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
        self.png(None)
    }

    fn png(&self, command: Option<&str>) -> std::result::Result<Vec<u8>, ImageError> {
        let mut bytes = Cursor::new(Vec::new());
        let (width, height) = (self.width as u32, self.height as u32);
        let colour = image::ExtendedColorType::Rgb8;
        image::write_buffer_with_format(&mut bytes, &self.to_srgb8(), width, height, colour, ImageFormat::Png)?;
        Ok(with_notes(bytes.into_inner(), command))
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
        let decoded = decode::decode(&bytes, Reading::default()).map_err(|e| located(path, e))?;
        warnings.extend(decoded.warnings.iter().map(|warning| format!("{}: {warning}", path.display())));
        let (width, height) = (decoded.width, decoded.height);
        Ok(Self { width, height, rgb: decoded.linear(None) })
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
            let values = if count == 1 {
                "1 negative value becomes 0".into()
            } else {
                format!("{count} negative values become 0")
            };
            warnings.push(format!("{}: {values}; the lowest is {lowest:e}", path.display()));
        }
        Ok(picture)
    }

    /// Width and height of an image file, upright.
    ///
    /// # Errors
    /// See [`Picture::read`].
    pub fn dimensions(path: impl AsRef<Path>) -> Result<(usize, usize)> {
        let path = path.as_ref();
        let bytes = fs::read(path).map_err(Error::io(path))?;
        let [width, height] = decode::dimensions(&bytes).map_err(|e| located(path, e))?;
        Ok((width, height))
    }

    /// Writes an 8-bit sRGB PNG or a 32-bit EXR; the extension of the file name selects the format. The file states its
    /// colour space and the version of this program.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for another extension; see also [`Picture::write_png`].
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        self.write_noted(path, None)
    }

    /// [`Picture::write`], with the command that made the picture: in a PNG the text `Command`, in an EXR the attribute
    /// `comments`.
    ///
    /// # Errors
    /// As [`Picture::write`].
    pub fn write_noted(&self, path: impl AsRef<Path>, command: Option<&str>) -> Result<()> {
        let path = path.as_ref();
        let invalid = |problem: String| Error::invalid(path, "EXR", problem);
        let bytes = match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("png") => {
                self.check(path)?;
                self.png(command).map_err(|e| image_error(path, e))?
            }
            Some("exr") => {
                self.check(path)?;
                self.exr(FloatType::F32, command).map_err(invalid)?
            }
            _ => return Err(Error::unsupported(path, "expected an image file ending in .png or .exr")),
        };
        crate::output::write_file(path, |f| f.write_all(&bytes))
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
        self.exr(number, None)
    }

    fn exr(&self, number: FloatType, command: Option<&str>) -> std::result::Result<Vec<u8>, String> {
        let largest = if number == FloatType::F16 { f16::MAX.to_f32() } else { f32::MAX };
        if let Some(i) = self.rgb.iter().position(|c| c.is_nan() || c.abs().max_element() > largest) {
            return Err(format!("{}: {} is not finite or overflows the number type", self.pixel_name(i), self.rgb[i]));
        }
        let mut file = Cursor::new(Vec::new());
        let size = (self.width, self.height);
        let text = |text: &str| Text::new_or_none(text);
        let attributes = || LayerAttributes {
            software_name: text(PROGRAM),
            comments: command.and_then(text),
            ..LayerAttributes::default()
        };
        // Otherwise blocks are stored in the order in which threads finish them.
        let encoding = ExrEncoding { line_order: LineOrder::Increasing, ..ExrEncoding::SMALL_FAST_LOSSLESS };
        let written = match number {
            FloatType::F32 => {
                let channels = SpecificChannels::rgb(|p: exr::math::Vec2<usize>| {
                    let c = self.at(p.x(), p.y());
                    (c.x, c.y, c.z)
                });
                rec709(Image::from_layer(Layer::new(size, attributes(), encoding, channels)))
                    .write()
                    .to_buffered(&mut file)
            }
            FloatType::F16 => {
                let channels = SpecificChannels::rgb(|p: exr::math::Vec2<usize>| {
                    let c = self.at(p.x(), p.y());
                    (f16::from_f32(c.x), f16::from_f32(c.y), f16::from_f32(c.z))
                });
                rec709(Image::from_layer(Layer::new(size, attributes(), encoding, channels)))
                    .write()
                    .to_buffered(&mut file)
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

/// The image, which states its primaries: those of Rec. 709.
fn rec709<L>(mut image: Image<L>) -> Image<L> {
    let point = |x: f32, y: f32| exr::math::Vec2(x, y);
    let (red, green) = (point(0.64, 0.33), point(0.3, 0.6));
    let (blue, white) = (point(0.15, 0.06), point(0.3127, 0.329));
    image.attributes.chromaticities = Some(Chromaticities { red, green, blue, white });
    image
}

/// A PNG file with its colour space, this program's version and the command that made it, in chunks after the header.
fn with_notes(png: Vec<u8>, command: Option<&str>) -> Vec<u8> {
    /// Signature and header.
    const START: usize = 8 + 25;
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let sum = crc32fast::hash(&[kind, data].concat());
        [&(data.len() as u32).to_be_bytes()[..], kind, data, &sum.to_be_bytes()].concat()
    };
    let mut notes = chunk(b"sRGB", &[0]);
    notes.extend(chunk(b"tEXt", &[b"Software\0", PROGRAM.as_bytes()].concat()));
    if let Some(command) = command {
        // not compressed, in no language
        notes.extend(chunk(b"iTXt", &[b"Command\0\0\0\0\0", command.as_bytes()].concat()));
    }
    [&png[..START], &notes, &png[START..]].concat()
}

/// The error of a file that cannot be decoded.
pub(crate) fn located(path: &Path, problem: Problem) -> Error {
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
mod tests;
