//! JPEG pictures.
//!
//! # Format
//! Sequential and progressive pictures of 8 bits, grey, YCbCr, RGB or CMYK, which is converted without a profile. Two
//! decoders read them: the faster one does not decode sequential pictures whose scans hold single components, nor
//! unusual subsampling, nor CMYK.
//!
//! # Limits
//! Arithmetic coding, hierarchical pictures, and other than 8 bits are refused by name.

use std::io::Cursor;

use ::jpeg_decoder::ColorTransform;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use super::super::orientation::Orientation;
use super::super::{MAX_PIXELS, MAX_SIDE};
use super::{Decoded, Numbers, Problem, Result, check_content, exif, icc};

/// Greatest number of pixels per byte: a block of 64 takes at least a bit.
const MAX_PER_BYTE: usize = 512;

/// What the markers of a file say.
struct Markers {
    width: usize,
    height: usize,
    /// Sampling factors across and down of each component.
    sampling: Vec<[u8; 2]>,
    is_progressive: bool,
    /// Whether a sequential scan holds some of the components only.
    has_partial_scan: bool,
    is_adobe: bool,
    orientation: Orientation,
    warnings: Vec<String>,
}

pub(super) fn decode(bytes: &[u8], strict: bool) -> Result<Decoded> {
    let markers = Markers::read(bytes)?;
    let Markers { width, height, .. } = markers;
    check_content(width, height, bytes.len(), MAX_PER_BYTE)?;
    let mut warnings = markers.warnings.clone();
    let numbers = if markers.suits_fast_decoder() {
        fast(bytes, strict, &markers)?
    } else {
        let (_, channels, samples) = slow(bytes, None)?;
        match channels {
            1 => samples.iter().flat_map(|&grey| [grey; 3]).collect(),
            3 => samples,
            _ => {
                warnings.push("CMYK is converted to RGB without a profile".into());
                // the decoder takes inks as inverted, as programs of Adobe store them
                let inks = |c: &[u8]| if markers.is_adobe { [c[0], c[1], c[2], c[3]] } else { inverted(c) };
                samples.chunks_exact(4).flat_map(|c| rgb(inks(c))).collect()
            }
        }
    };
    if numbers.len() != 3 * width * height {
        let problem = format!("found {} numbers in a JPEG image of {width} x {height} pixels", numbers.len());
        return Err(Problem::Invalid(problem));
    }
    let mut decoded = Decoded::new([width, height], Numbers::U8(numbers));
    decoded.warnings = warnings;
    Ok(decoded.upright(markers.orientation))
}

/// Decodes a part of another file, such as a strip, after the tables that the parts share. Returns width and height, the
/// number of channels and the samples: YCbCr becomes RGB, all else is as stored.
pub(super) fn decode_part(tables: Option<&[u8]>, part: &[u8], is_ycbcr: bool) -> Result<([usize; 2], usize, Vec<u8>)> {
    let tables = tables.unwrap_or_default();
    let tables = tables.strip_suffix(b"\xff\xd9").unwrap_or(tables);
    let joined = match part.strip_prefix(b"\xff\xd8") {
        Some(rest) if !tables.is_empty() => [tables, rest].concat(),
        _ => part.to_vec(),
    };
    let markers = Markers::read(&joined)?;
    check_content(markers.width, markers.height, joined.len(), MAX_PER_BYTE)?;
    let transform = match (markers.sampling.len(), is_ycbcr) {
        (1, _) => ColorTransform::Grayscale,
        (3, true) => ColorTransform::YCbCr,
        (3, false) => ColorTransform::RGB,
        _ => ColorTransform::CMYK,
    };
    let (size, channels, mut samples) = slow(&joined, Some(transform))?;
    if channels == 4 {
        samples.iter_mut().for_each(|ink| *ink = 255 - *ink);
    }
    Ok((size, channels, samples))
}

fn inverted(c: &[u8]) -> [u8; 4] {
    [255 - c[0], 255 - c[1], 255 - c[2], 255 - c[3]]
}

fn rgb([c, m, y, k]: [u8; 4]) -> [u8; 3] {
    let light = |ink: u8| (u32::from(255 - ink) * u32::from(255 - k) + 127) / 255;
    [c, m, y].map(|ink| light(ink) as u8)
}

fn fast(bytes: &[u8], strict: bool, markers: &Markers) -> Result<Vec<u8>> {
    let damaged = |e: zune_jpeg::errors::DecodeErrors| Problem::Invalid(format!("the JPEG image is damaged: {e}"));
    let options = DecoderOptions::default()
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE)
        .set_strict_mode(strict)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let numbers = decoder.decode().map_err(damaged)?;
    if numbers.len() == markers.width * markers.height {
        return Ok(numbers.iter().flat_map(|&grey| [grey; 3]).collect());
    }
    Ok(numbers)
}

/// Width and height, channels and samples.
fn slow(bytes: &[u8], transform: Option<ColorTransform>) -> Result<([usize; 2], usize, Vec<u8>)> {
    let problem = |error: ::jpeg_decoder::Error| match error {
        ::jpeg_decoder::Error::Unsupported(what) => {
            Problem::Unsupported(format!("this kind of JPEG image is not supported: {what:?}"))
        }
        other => Problem::Invalid(format!("the JPEG image is damaged: {other}")),
    };
    let mut decoder = ::jpeg_decoder::Decoder::new(Cursor::new(bytes));
    decoder.set_max_decoding_buffer_size(4 * MAX_PIXELS);
    if let Some(transform) = transform {
        decoder.set_color_transform(transform);
    }
    let samples = decoder.decode().map_err(problem)?;
    let info = decoder.info().ok_or_else(|| Problem::Invalid("the JPEG image has no frame header".into()))?;
    let channels = info.pixel_format.pixel_bytes();
    if info.pixel_format == ::jpeg_decoder::PixelFormat::L16 {
        return Err(Problem::Unsupported("JPEG images of 16 bits are not supported".into()));
    }
    Ok(([info.width, info.height].map(usize::from), channels, samples))
}

impl Markers {
    fn read(bytes: &[u8]) -> Result<Self> {
        let mut markers = Self {
            width: 0,
            height: 0,
            sampling: Vec::new(),
            is_progressive: false,
            has_partial_scan: false,
            is_adobe: false,
            orientation: Orientation::UPRIGHT,
            warnings: Vec::new(),
        };
        let mut at = 2;
        // the pieces of a profile, which may be longer than a segment
        let mut profile = Vec::new();
        while let Some((marker, segment, end)) = next_segment(bytes, at) {
            at = end;
            match marker {
                0xc0..=0xcf if ![0xc4, 0xc8, 0xcc].contains(&marker) => markers.frame(marker, segment)?,
                // a sequential picture whose first scan holds all components has no other
                0xda => {
                    let count = usize::from(segment.first().copied().unwrap_or(0));
                    markers.has_partial_scan = !markers.is_progressive && count < markers.sampling.len();
                    break;
                }
                0xe1 => {
                    if let Some(data) = segment.strip_prefix(b"Exif\0\0") {
                        markers.orientation = exif::orientation(data);
                    }
                }
                0xe2 => {
                    if let Some([_, _, piece @ ..]) = segment.strip_prefix(b"ICC_PROFILE\0") {
                        profile.extend_from_slice(piece);
                    }
                }
                0xee => markers.is_adobe |= segment.starts_with(b"Adobe"),
                _ => {}
            }
        }
        if markers.sampling.is_empty() {
            return Err(Problem::Invalid("the JPEG image has no frame header".into()));
        }
        if !profile.is_empty() {
            markers.warnings.extend(icc::warning(&profile));
        }
        Ok(markers)
    }

    /// Reads a frame header.
    fn frame(&mut self, marker: u8, segment: &[u8]) -> Result<()> {
        let unsupported = |what: String| Err(Problem::Unsupported(format!("JPEG images {what} are not supported")));
        match marker {
            0xc3 => return unsupported("without loss".into()),
            0xc5..=0xc7 | 0xcd..=0xcf => return unsupported("of several resolutions".into()),
            0xc9..=0xcb => return unsupported("with arithmetic coding".into()),
            _ => self.is_progressive = marker == 0xc2,
        }
        let [bits, h0, h1, w0, w1, count, components @ ..] = segment else {
            return Err(Problem::Invalid("the frame header of the JPEG image is too short".into()));
        };
        if *bits != 8 {
            return unsupported(format!("of {bits} bits"));
        }
        if ![1, 3, 4].contains(count) {
            return unsupported(format!("of {count} channels"));
        }
        (self.width, self.height) =
            (usize::from(*w0) << 8 | usize::from(*w1), usize::from(*h0) << 8 | usize::from(*h1));
        let factors = components.chunks_exact(3).take(usize::from(*count));
        self.sampling = factors.map(|component| [component[1] >> 4, component[1] & 15]).collect();
        if self.sampling.len() != usize::from(*count) {
            return Err(Problem::Invalid("the frame header of the JPEG image is too short".into()));
        }
        Ok(())
    }

    /// Whether the fast decoder gets the file right. In its version 0.5.15 it gives sequential files with partial scans
    /// wrong colours.
    fn suits_fast_decoder(&self) -> bool {
        let usual = match self.sampling[..] {
            [_] => true,
            [[across, down], [1, 1], [1, 1]] => across <= 2 && down <= 2,
            _ => false,
        };
        usual && !self.has_partial_scan
    }
}

/// The next marker from a place on, its segment without the length, and the place behind it.
fn next_segment(bytes: &[u8], mut at: usize) -> Option<(u8, &[u8], usize)> {
    // skip what is no marker, and fill bytes
    while *bytes.get(at)? != 0xff || [0, 0xff].contains(bytes.get(at + 1)?) {
        at += 1;
    }
    let marker = bytes[at + 1];
    if matches!(marker, 0x01 | 0xd0..=0xd9) {
        return Some((marker, &[], at + 2));
    }
    let length = usize::from(*bytes.get(at + 2)?) << 8 | usize::from(*bytes.get(at + 3)?);
    let end = (at + 2 + length.max(2)).min(bytes.len());
    Some((marker, bytes.get(at + 4..end).unwrap_or_default(), end))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey picture of 16 x 8 pixels, then the same with another frame header.
    fn grey() -> Vec<u8> {
        let mut bytes = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut bytes, 90);
        encoder.encode(&[100; 16 * 8], 16, 8, jpeg_encoder::ColorType::Luma).unwrap();
        bytes
    }

    fn with_segment(mut bytes: Vec<u8>, marker: u8, content: &[u8]) -> Vec<u8> {
        let length = (content.len() as u16 + 2).to_be_bytes();
        bytes.splice(2..2, [&[0xff, marker][..], &length, content].concat());
        bytes
    }

    #[test]
    fn kinds_that_are_not_read_are_named() {
        let frame = |edit: fn(&mut [u8])| {
            let mut bytes = grey();
            let at = bytes.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
            edit(&mut bytes[at..]);
            decode(&bytes, true).unwrap_err().to_string()
        };
        assert!(frame(|f| f[4] = 12).contains("of 12 bits"));
        assert!(frame(|f| f[1] = 0xc9).contains("arithmetic coding"));
        assert!(frame(|f| f[1] = 0xc3).contains("without loss"));
        assert!(frame(|f| f[9] = 2).contains("of 2 channels"));
    }

    #[test]
    fn orientation_and_profile_are_found() {
        let exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
        let decoded = decode(&with_segment(grey(), 0xe1, exif), true).unwrap();
        assert_eq!([decoded.width, decoded.height], [8, 16]);
        assert!(decoded.warnings.is_empty());
        let profile = [&b"ICC_PROFILE\0\x01\x01"[..], &[0; 128], b"\0\0\0\0"].concat();
        let decoded = decode(&with_segment(grey(), 0xe2, &profile), true).unwrap();
        assert!(decoded.warnings[0].contains("profile"), "{:?}", decoded.warnings);
    }

    #[test]
    fn scans_of_single_components_are_decoded() {
        // 4:2:0, one scan per component
        let bytes = include_bytes!("../../../tests/data/pictures/scans.jpg");
        assert!(Markers::read(bytes).unwrap().has_partial_scan);
        let decoded = decode(bytes, true).unwrap();
        let Numbers::U8(numbers) = decoded.numbers else { panic!("bytes expected") };
        let texel = &numbers[3 * (5 * decoded.width + 5)..][..3];
        assert!(texel.iter().zip([54u8, 185, 91]).all(|(found, expected)| found.abs_diff(expected) <= 2), "{texel:?}");
    }
}
