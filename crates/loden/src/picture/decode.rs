//! Decoders of image files: PNG, JPEG, TIFF, BMP, EXR, Radiance HDR, Netpbm and Sun raster.

pub(crate) mod dwa;
mod exif;
mod exr;
mod hdr;
mod icc;
mod jpeg;
mod png;
mod pnm;
mod sun;
mod tiff;

use glam::{Mat3, Vec3};
use image::{DynamicImage, ImageError, ImageFormat, ImageReader};

use super::orientation::Orientation;
use super::primaries::Primaries;
use super::{MAX_PIXELS, MAX_SIDE};
use crate::color::Encoding;
use crate::input::guarded;

/// Pixel values as stored: three per pixel, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Numbers {
    /// 8-bit values; 255 encodes 1.
    U8(Vec<u8>),
    /// 16-bit values; 65535 encodes 1.
    U16(Vec<u16>),
    /// Values that encode themselves.
    F32(Vec<f32>),
}

/// A decoded image, upright.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Decoded {
    pub width: usize,
    pub height: usize,
    pub numbers: Numbers,
    /// How the numbers encode light, as the file says, or as is usual in its format.
    pub encoding: Encoding,
    /// The matrix from linear colours of the file to Rec. 709; `None` if they are the same.
    pub to_rec709: Option<Mat3>,
    /// Features of the file that are ignored, one sentence each, without the name of the file.
    pub warnings: Vec<String>,
}

/// How to read a file.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Reading {
    /// A truncated or damaged JPEG file is an error; otherwise its readable part is used.
    pub strict: bool,
    /// Radiance files with the resolution `+X width -Y height` hold rows from the bottom, as in the archives of Bonn,
    /// instead of columns.
    pub bonn: bool,
}

/// The samples of a TIFF picture of four channels of 8 bits, alpha and all, as they are stored, with its width and height.
pub(crate) fn four_bytes(bytes: &[u8]) -> Result<([usize; 2], Vec<u8>)> {
    tiff::four_bytes(bytes)
}

/// The reason why a file cannot be decoded.
#[derive(Debug)]
pub(crate) enum Problem {
    /// The format is not supported.
    Unsupported(String),
    /// The file is damaged.
    Invalid(String),
    /// The image is too large: field, found, limit.
    Limit(&'static str, u64, u64),
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unsupported(text) | Self::Invalid(text) => f.write_str(text),
            Self::Limit(field, found, limit) => write!(f, "{field}: found {found}, more than the limit of {limit}"),
        }
    }
}

type Result<T> = std::result::Result<T, Problem>;

impl Decoded {
    /// An sRGB image with the primaries of Rec. 709.
    fn new([width, height]: [usize; 2], numbers: Numbers) -> Self {
        let encoding = if matches!(numbers, Numbers::F32(_)) { Encoding::Linear } else { Encoding::Srgb };
        Self { width, height, numbers, encoding, to_rec709: None, warnings: Vec::new() }
    }

    fn with_primaries(mut self, primaries: Primaries) -> Result<Self> {
        self.to_rec709 = primaries.to_rec709().map_err(Problem::Invalid)?;
        Ok(self)
    }

    /// The image turned upright.
    fn upright(mut self, orientation: Orientation) -> Self {
        let (width, height) = (self.width, self.height);
        [self.width, self.height] = match &mut self.numbers {
            Numbers::U8(numbers) => orientation.apply(width, height, numbers),
            Numbers::U16(numbers) => orientation.apply(width, height, numbers),
            Numbers::F32(numbers) => orientation.apply(width, height, numbers),
        };
        self
    }

    /// The numbers as stored with their encoding, or linear ones if colours are converted to Rec. 709. A `given` encoding
    /// replaces that of the file.
    pub(crate) fn resolved(self, given: Option<Encoding>) -> (Numbers, Encoding) {
        if self.to_rec709.is_none() {
            return (self.numbers, given.unwrap_or(self.encoding));
        }
        let linear = self.linear(given);
        (Numbers::F32(linear.iter().flat_map(|c| c.to_array()).collect()), Encoding::Linear)
    }

    /// The pixels in linear light. A `given` encoding replaces that of the file.
    pub(crate) fn linear(self, given: Option<Encoding>) -> Vec<Vec3> {
        let encoding = given.unwrap_or(self.encoding);
        let decode = |c: Vec3| Vec3::from(c.to_array().map(|v| encoding.decode(v)));
        let mut pixels: Vec<Vec3> = match &self.numbers {
            Numbers::U8(numbers) => {
                let table: Vec<f32> = (0..256).map(|i| encoding.decode(i as f32 / 255.0)).collect();
                numbers.chunks_exact(3).map(|c| Vec3::from([0, 1, 2].map(|k| table[usize::from(c[k])]))).collect()
            }
            Numbers::U16(numbers) => {
                let value = |v: u16| f32::from(v) / 65_535.0;
                numbers.chunks_exact(3).map(|c| decode(Vec3::new(value(c[0]), value(c[1]), value(c[2])))).collect()
            }
            Numbers::F32(numbers) => numbers.chunks_exact(3).map(|c| decode(Vec3::from_slice(c))).collect(),
        };
        if let Some(matrix) = self.to_rec709 {
            pixels.iter_mut().for_each(|c| *c = matrix * *c);
        }
        pixels
    }
}

/// Decodes an image file.
pub(crate) fn decode(bytes: &[u8], reading: Reading) -> Result<Decoded> {
    let kind = Kind::of(bytes)?;
    let decode = || match kind {
        Kind::Jpeg => jpeg::decode(bytes, reading.strict),
        Kind::Hdr => hdr::decode(bytes, reading.bonn),
        Kind::Png => png::decode(bytes),
        Kind::Exr => exr::decode(bytes),
        Kind::Tiff => tiff::decode(bytes),
        Kind::Bmp => bmp(bytes),
        Kind::Pnm => pnm::decode(bytes),
        Kind::Sun => sun::decode(bytes),
    };
    guarded(kind.name(), decode).map_err(Problem::Invalid)?
}

/// Width and height of an image file.
pub(crate) fn dimensions(bytes: &[u8]) -> Result<[usize; 2]> {
    let kind = Kind::of(bytes)?;
    let size = || match kind {
        Kind::Png => png::dimensions(bytes),
        Kind::Exr => exr::dimensions(bytes),
        _ => decode(bytes, Reading::default()).map(|decoded| [decoded.width, decoded.height]),
    };
    guarded(kind.name(), size).map_err(Problem::Invalid)?
}

/// A kind of image file.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Png,
    Jpeg,
    Tiff,
    Bmp,
    Exr,
    Hdr,
    Pnm,
    Sun,
}

impl Kind {
    fn of(bytes: &[u8]) -> Result<Self> {
        let starts = |signatures: &[&[u8]]| signatures.iter().any(|signature| bytes.starts_with(signature));
        Ok(match () {
            () if starts(&[b"\x89PNG\r\n\x1a\n"]) => Self::Png,
            () if starts(&[b"\xff\xd8\xff"]) => Self::Jpeg,
            () if starts(&[b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]) => Self::Tiff,
            () if starts(&[b"BM"]) => Self::Bmp,
            () if starts(&[b"\x76\x2f\x31\x01"]) => Self::Exr,
            () if starts(&[b"#?"]) => Self::Hdr,
            () if pnm::is_pnm(bytes) => Self::Pnm,
            () if starts(&[sun::MAGIC]) => Self::Sun,
            () if bytes.is_empty() => return Err(Problem::Invalid("the file is empty".into())),
            () => {
                let expected = "expected a PNG, JPEG, TIFF, BMP, EXR, Radiance HDR, Netpbm or Sun raster image";
                return Err(Problem::Unsupported(expected.into()));
            }
        })
    }

    fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Tiff => "TIFF",
            Self::Bmp => "BMP",
            Self::Exr => "EXR",
            Self::Hdr => "HDR",
            Self::Pnm => "Netpbm",
            Self::Sun => "Sun raster",
        }
    }
}

pub(super) fn check_size(width: usize, height: usize) -> Result<()> {
    match (width, height) {
        (w, _) if w > MAX_SIDE => Err(Problem::Limit("width", w as u64, MAX_SIDE as u64)),
        (_, h) if h > MAX_SIDE => Err(Problem::Limit("height", h as u64, MAX_SIDE as u64)),
        (w, h) if w * h > MAX_PIXELS => Err(Problem::Limit("pixels", (w * h) as u64, MAX_PIXELS as u64)),
        (0, _) | (_, 0) => Err(Problem::Invalid(format!("an image of {width} x {height} has no pixels"))),
        _ => Ok(()),
    }
}

/// Checks a size, and that a file of so many bytes can hold it if a byte is at most `per_byte` pixels.
fn check_content(width: usize, height: usize, bytes: usize, per_byte: usize) -> Result<()> {
    check_size(width, height)?;
    if width * height > bytes.saturating_mul(per_byte) {
        let problem = format!("an image of {width} x {height} pixels does not fit in {bytes} bytes");
        return Err(Problem::Invalid(problem));
    }
    Ok(())
}

fn bmp(bytes: &[u8]) -> Result<Decoded> {
    // run-length coded pixels of four bits
    let (size, image) = by_image_crate(bytes, ImageFormat::Bmp, "BMP", 128)?;
    Ok(Decoded::new(size, numbers(image)))
}

fn by_image_crate(
    bytes: &[u8],
    format: ImageFormat,
    name: &str,
    per_byte: usize,
) -> Result<([usize; 2], DynamicImage)> {
    let problem = |error: ImageError| match error {
        ImageError::Unsupported(_) => {
            Problem::Unsupported(format!("this kind of {name} image is not supported: {error}"))
        }
        other => Problem::Invalid(format!("the {name} image is damaged: {other}")),
    };
    let reader = || ImageReader::with_format(std::io::Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(problem)?;
    let (width, height) = (width as usize, height as usize);
    check_content(width, height, bytes.len(), per_byte)?;
    let mut reader = reader();
    reader.no_limits(); // the size was checked
    Ok(([width, height], reader.decode().map_err(problem)?))
}

/// The colours of an image as they are stored; alpha is left out.
fn numbers(image: DynamicImage) -> Numbers {
    let channels = usize::from(image.color().channel_count());
    match image {
        DynamicImage::ImageLuma8(image) => Numbers::U8(colours(image.as_raw(), channels)),
        DynamicImage::ImageLumaA8(image) => Numbers::U8(colours(image.as_raw(), channels)),
        DynamicImage::ImageRgb8(image) => Numbers::U8(image.into_raw()),
        DynamicImage::ImageRgba8(image) => Numbers::U8(colours(image.as_raw(), channels)),
        DynamicImage::ImageLuma16(image) => Numbers::U16(colours(image.as_raw(), channels)),
        DynamicImage::ImageLumaA16(image) => Numbers::U16(colours(image.as_raw(), channels)),
        DynamicImage::ImageRgb16(image) => Numbers::U16(image.into_raw()),
        DynamicImage::ImageRgba16(image) => Numbers::U16(colours(image.as_raw(), channels)),
        other => Numbers::F32(other.into_rgb32f().into_raw()),
    }
}

/// The first three of the channels of each pixel, or the first one three times if there are fewer.
fn colours<T: Copy>(numbers: &[T], channels: usize) -> Vec<T> {
    if channels == 3 {
        return numbers.to_vec();
    }
    let pixel = |c: &[T]| if channels > 2 { [c[0], c[1], c[2]] } else { [c[0]; 3] };
    numbers.chunks_exact(channels).flat_map(pixel).collect()
}

#[cfg(test)]
mod tests;
