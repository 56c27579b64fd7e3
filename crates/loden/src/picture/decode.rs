//! Decoders of image files: PNG, JPEG, TIFF, BMP, EXR and Radiance HDR.

use std::borrow::Cow;
use std::io::Cursor;

use image::{DynamicImage, ImageError, ImageFormat, ImageReader};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use super::{MAX_PIXELS, MAX_SIDE};

/// Pixel values as stored: three per pixel, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Numbers {
    /// 8-bit values; 255 encodes 1.
    U8(Vec<u8>),
    /// 16-bit values; 65535 encodes 1.
    U16(Vec<u16>),
    /// Linear light.
    F32(Vec<f32>),
}

/// A decoded image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Decoded {
    pub width: usize,
    pub height: usize,
    pub numbers: Numbers,
    /// Features of the file that are ignored, one sentence each, without the name of the file.
    pub warnings: Vec<String>,
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

/// Decodes an image file. A truncated or damaged JPEG file is an error if `strict`; otherwise its readable part is used.
pub(crate) fn decode(bytes: &[u8], strict: bool) -> Result<Decoded> {
    match image::guess_format(bytes) {
        Ok(ImageFormat::Jpeg) => jpeg(bytes, strict),
        Ok(ImageFormat::Hdr) => {
            let (bytes, flipped) = with_standard_order(bytes);
            let mut decoded = other(&bytes, ImageFormat::Hdr, "HDR")?;
            if flipped {
                flip(&mut decoded);
            }
            Ok(decoded)
        }
        Ok(ImageFormat::Png) => other(bytes, ImageFormat::Png, "PNG"),
        Ok(ImageFormat::OpenExr) => other(bytes, ImageFormat::OpenExr, "EXR"),
        Ok(ImageFormat::Tiff) => other(bytes, ImageFormat::Tiff, "TIFF"),
        Ok(ImageFormat::Bmp) => other(bytes, ImageFormat::Bmp, "BMP"),
        _ if bytes.is_empty() => Err(Problem::Invalid("the file is empty".into())),
        _ => Err(Problem::Unsupported("expected a PNG, JPEG, TIFF, BMP, EXR or Radiance HDR image".into())),
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

fn jpeg(bytes: &[u8], strict: bool) -> Result<Decoded> {
    let damaged = |e: zune_jpeg::errors::DecodeErrors| Problem::Invalid(format!("the JPEG image is damaged: {e}"));
    let options = DecoderOptions::default()
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE)
        .set_strict_mode(strict)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(damaged)?;
    let info = decoder.info().ok_or_else(|| Problem::Invalid("the JPEG image has no frame header".into()))?;
    let (width, height) = (usize::from(info.width), usize::from(info.height));
    check_size(width, height)?;
    let mut numbers = decoder.decode().map_err(damaged)?;
    if numbers.len() == width * height {
        numbers = numbers.iter().flat_map(|&grey| [grey; 3]).collect();
    }
    if numbers.len() != 3 * width * height {
        let channels = numbers.len() / (width * height);
        return Err(Problem::Invalid(format!("found a JPEG image of {channels} channels, expected 1 or 3")));
    }
    Ok(Decoded { width, height, numbers: Numbers::U8(numbers), warnings: Vec::new() })
}

fn other(bytes: &[u8], format: ImageFormat, name: &str) -> Result<Decoded> {
    let problem = |error: ImageError| match error {
        ImageError::Unsupported(e) => Problem::Unsupported(e.to_string()),
        other => Problem::Invalid(format!("the {name} image is damaged: {other}")),
    };
    let reader = || ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(problem)?;
    let (width, height) = (width as usize, height as usize);
    check_size(width, height)?;
    let mut reader = reader();
    reader.no_limits(); // the size was checked
    let decoded = reader.decode().map_err(problem)?;
    let numbers = match decoded {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => Numbers::F32(decoded.into_rgb32f().into_raw()),
        _ if decoded.color().bytes_per_pixel() == decoded.color().channel_count() => {
            Numbers::U8(decoded.into_rgb8().into_raw())
        }
        _ => Numbers::U16(decoded.into_rgb16().into_raw()),
    };
    Ok(Decoded { width, height, numbers, warnings: Vec::new() })
}

/// Rewrites the resolution line `+X width -Y height` of a Radiance file, as in the HDR archives of Bonn, to the order
/// that decoders support. Such files store their rows from the bottom; `true` means that they have to be flipped.
fn with_standard_order(bytes: &[u8]) -> (Cow<'_, [u8]>, bool) {
    let Some(end) = bytes.windows(2).position(|w| w == b"\n\n") else { return (Cow::Borrowed(bytes), false) };
    let rest = &bytes[end + 2..];
    let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
    let line = String::from_utf8_lossy(&rest[..length]).into_owned();
    let ["+X", width, "-Y", height] = line.split_whitespace().collect::<Vec<_>>()[..] else {
        return (Cow::Borrowed(bytes), false);
    };
    let standard = format!("-Y {height} +X {width}");
    (Cow::Owned([&bytes[..end + 2], standard.as_bytes(), &rest[length..]].concat()), true)
}

fn flip(decoded: &mut Decoded) {
    fn rows<T: Copy>(numbers: &mut [T], row: usize) {
        let count = numbers.len() / row;
        for y in 0..count / 2 {
            let (low, high) = numbers.split_at_mut((count - 1 - y) * row);
            low[y * row..(y + 1) * row].swap_with_slice(&mut high[..row]);
        }
    }
    let row = 3 * decoded.width;
    match &mut decoded.numbers {
        Numbers::U8(numbers) => rows(numbers, row),
        Numbers::U16(numbers) => rows(numbers, row),
        Numbers::F32(numbers) => rows(numbers, row),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hdr_files_with_a_swapped_resolution_line_are_flipped() {
        let pixels: Vec<_> = (0..12u8).map(|i| image::Rgb([f32::from(i), 1.0, 2.0])).collect();
        let mut bytes = Vec::new();
        image::codecs::hdr::HdrEncoder::new(&mut bytes).encode(&pixels, 4, 3).unwrap();
        let standard = decode(&bytes, true).unwrap();
        let text = b"-Y 3 +X 4";
        let at = bytes.windows(text.len()).position(|w| w == text).unwrap();
        bytes[at..at + text.len()].copy_from_slice(b"+X 4 -Y 3");
        let odd = decode(&bytes, true).unwrap();
        let (Numbers::F32(standard), Numbers::F32(odd)) = (standard.numbers, odd.numbers) else {
            panic!("floats expected")
        };
        assert_eq!(odd[..12], standard[24..]);
        assert_eq!(odd[24..], standard[..12]);
    }

    #[test]
    fn sixteen_bit_tiff_keeps_its_numbers() {
        let numbers: Vec<u16> = (0..36).map(|i| i * 1800).collect();
        let image = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(4, 3, numbers.clone()).unwrap();
        let mut bytes = Cursor::new(Vec::new());
        DynamicImage::ImageRgb16(image).write_to(&mut bytes, ImageFormat::Tiff).unwrap();
        let decoded = decode(bytes.get_ref(), true).unwrap();
        assert_eq!(decoded, Decoded { width: 4, height: 3, numbers: Numbers::U16(numbers), warnings: Vec::new() });
    }
}
