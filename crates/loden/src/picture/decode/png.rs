//! PNG pictures.
//!
//! # Format
//! Colours are as the first of these chunks says: `cICP` (numbers of primaries and of a transfer function), `iCCP` (a
//! profile, which is named but not applied), `sRGB`, `gAMA` and `cHRM`. Without any they are sRGB. `eXIf` may turn the
//! picture. Of animations the first picture is read; alpha is left out.
//!
//! # References
//! png2025

use std::io::Read;

use glam::DVec2;
use image::ImageFormat;

use super::super::orientation::Orientation;
use super::super::primaries::Primaries;
use super::{Decoded, Problem, Result, by_image_crate, check_size, exif, icc, numbers};
use crate::color::Encoding;

/// Greatest number of pixels per byte: deflate expands 1032 times, and a byte may hold eight pixels.
const MAX_PER_BYTE: usize = 8 * 1032;

/// Greatest size of a colour profile.
const MAX_PROFILE: u64 = 1 << 22;

pub(super) fn decode(bytes: &[u8]) -> Result<Decoded> {
    let chunks = Chunks::read(bytes);
    let mut warnings = Vec::new();
    let (encoding, primaries) = chunks.colours(&mut warnings)?;
    let (size, image) = by_image_crate(bytes, ImageFormat::Png, "PNG", MAX_PER_BYTE)?;
    let decoded = Decoded { encoding, warnings, ..Decoded::new(size, numbers(image)) };
    Ok(decoded.with_primaries(primaries)?.upright(chunks.orientation()))
}

pub(super) fn dimensions(bytes: &[u8]) -> Result<[usize; 2]> {
    let side = |at: usize| bytes.get(at..at + 4).map(|b| b.iter().fold(0, |sum, &b| sum << 8 | usize::from(b)));
    let (Some(width), Some(height)) = (side(16), side(20)) else {
        return Err(Problem::Invalid("the PNG image is damaged: the file ends in its header".into()));
    };
    check_size(width, height)?;
    Ok(Chunks::read(bytes).orientation().size(width, height))
}

/// Chunks that say what colours mean.
#[derive(Default)]
struct Chunks<'a> {
    cicp: Option<&'a [u8]>,
    iccp: Option<&'a [u8]>,
    srgb: bool,
    gamma: Option<&'a [u8]>,
    chromaticities: Option<&'a [u8]>,
    exif: Option<&'a [u8]>,
}

impl<'a> Chunks<'a> {
    fn read(bytes: &'a [u8]) -> Self {
        let mut chunks = Self::default();
        let mut rest = bytes.get(8..).unwrap_or_default();
        while let Some((head, behind)) = rest.split_first_chunk::<8>() {
            let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
            let Some(content) = behind.get(..length) else { break };
            match &head[4..] {
                b"cICP" => chunks.cicp = Some(content),
                b"iCCP" => chunks.iccp = Some(content),
                b"sRGB" => chunks.srgb = true,
                b"gAMA" => chunks.gamma = Some(content),
                b"cHRM" => chunks.chromaticities = Some(content),
                b"eXIf" => chunks.exif = Some(content),
                _ => {}
            }
            rest = behind.get(length + 4..).unwrap_or_default();
        }
        chunks
    }

    fn orientation(&self) -> Orientation {
        self.exif.map_or(Orientation::UPRIGHT, exif::orientation)
    }

    /// The encoding and the primaries that the chunks state.
    fn colours(&self, warnings: &mut Vec<String>) -> Result<(Encoding, Primaries)> {
        if let Some(content) = self.cicp {
            return of_video(content);
        }
        let mut colours = (Encoding::Srgb, Primaries::REC_709);
        if let Some(content) = self.iccp {
            let end = content.iter().position(|&b| b == 0).map_or(content.len(), |end| (end + 2).min(content.len()));
            let mut profile = Vec::new();
            // what can be read of a damaged profile
            let _ = flate2::read::ZlibDecoder::new(&content[end..]).take(MAX_PROFILE).read_to_end(&mut profile);
            warnings.extend(icc::warning(&profile));
            return Ok(colours);
        }
        if self.srgb {
            return Ok(colours);
        }
        let number = |content: &[u8], k: usize| {
            content.get(4 * k..4 * k + 4).map(|b| f64::from(u32::from_be_bytes([b[0], b[1], b[2], b[3]])) / 1e5)
        };
        if let Some(stored) = self.gamma {
            colours.0 = match number(stored, 0).map(|gamma| 1.0 / gamma) {
                Some(gamma) if (gamma - 1.0).abs() < 1e-3 => Encoding::Linear,
                // two digits, as 0.45455 stands for 1 / 2.2
                Some(gamma) if (0.1..=10.0).contains(&gamma) => Encoding::Gamma((gamma * 100.0).round() as f32 / 100.0),
                _ => return Err(Problem::Invalid("the chunk gAMA of the PNG image holds no possible gamma".into())),
            };
        }
        if let Some(stored) = self.chromaticities {
            let point = |k: usize| Some(DVec2::new(number(stored, 2 * k)?, number(stored, 2 * k + 1)?));
            let primaries = || Some(Primaries { white: point(0)?, red: point(1)?, green: point(2)?, blue: point(3)? });
            let short = || Problem::Invalid("the chunk cHRM of the PNG image is too short".into());
            colours.1 = primaries().ok_or_else(short)?;
        }
        Ok(colours)
    }
}

/// The encoding and the primaries by their numbers (ITU-T H.273).
fn of_video(content: &[u8]) -> Result<(Encoding, Primaries)> {
    let unsupported = |what: String| Err(Problem::Unsupported(format!("PNG images with {what} are not supported")));
    let [primaries, transfer, matrix, range] = content[..] else {
        return Err(Problem::Invalid("the chunk cICP of the PNG image does not have four bytes".into()));
    };
    if (matrix, range) != (0, 1) {
        return unsupported("the colours of video (matrix or narrow range)".into());
    }
    let encoding = match transfer {
        // unspecified
        2 | 13 => Encoding::Srgb,
        8 => Encoding::Linear,
        4 => Encoding::Gamma(2.2),
        5 => Encoding::Gamma(2.8),
        16 => return unsupported("the transfer function PQ (high dynamic range)".into()),
        18 => return unsupported("the transfer function HLG (high dynamic range)".into()),
        other => return unsupported(format!("the transfer function {other}")),
    };
    match (primaries, Primaries::of_video(primaries)) {
        (2, _) => Ok((encoding, Primaries::REC_709)),
        (_, Some(primaries)) => Ok((encoding, primaries)),
        _ => unsupported(format!("the primaries {primaries}")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Numbers;
    use super::*;

    /// A picture of 2 x 1 pixels with a chunk before its pixels.
    fn picture(name: &str, content: &[u8]) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = image::RgbImage::from_raw(2, 1, vec![10, 100, 200, 0, 255, 128]).unwrap();
        image.write_to(&mut bytes, ImageFormat::Png).unwrap();
        let mut bytes = bytes.into_inner();
        let named = [name.as_bytes(), content].concat();
        let chunk =
            [&(content.len() as u32).to_be_bytes()[..], &named, &crc32fast::hash(&named).to_be_bytes()].concat();
        bytes.splice(33..33, chunk);
        bytes
    }

    #[test]
    fn chunks_say_what_numbers_mean() {
        for (name, content, expected) in [
            ("sRGB", &[0u8][..], Encoding::Srgb),
            ("tEXt", b"a\0b", Encoding::Srgb),
            ("gAMA", &45_455u32.to_be_bytes(), Encoding::Gamma(2.2)),
            ("gAMA", &55_556u32.to_be_bytes(), Encoding::Gamma(1.8)),
            ("gAMA", &100_000u32.to_be_bytes(), Encoding::Linear),
            ("cICP", &[1, 13, 0, 1], Encoding::Srgb),
            ("cICP", &[1, 8, 0, 1], Encoding::Linear),
        ] {
            let decoded = decode(&picture(name, content)).unwrap();
            assert_eq!((decoded.encoding, decoded.to_rec709), (expected, None), "{name} {content:?}");
            assert_eq!(decoded.numbers, Numbers::U8(vec![10, 100, 200, 0, 255, 128]));
        }
        let display_p3 = decode(&picture("cICP", &[12, 13, 0, 1])).unwrap();
        assert!((display_p3.to_rec709.unwrap().x_axis.x - 1.2249).abs() < 1e-3);
        let chromaticities = [31_270u32, 32_900, 68_000, 32_000, 26_500, 69_000, 15_000, 6_000];
        let chromaticities: Vec<u8> = chromaticities.iter().flat_map(|v| v.to_be_bytes()).collect();
        assert_eq!(decode(&picture("cHRM", &chromaticities)).unwrap().to_rec709, display_p3.to_rec709);
    }

    #[test]
    fn what_is_not_applied_is_named() {
        for (content, fault) in
            [([9, 16, 0, 1], "PQ"), ([9, 18, 0, 1], "HLG"), ([1, 13, 1, 1], "matrix"), ([3, 13, 0, 1], "primaries 3")]
        {
            let error = decode(&picture("cICP", &content)).unwrap_err().to_string();
            assert!(error.contains(fault), "{error}");
        }
        assert!(decode(&picture("gAMA", &[0; 4])).unwrap_err().to_string().contains("gAMA"));
        let decoded = decode(&picture("iCCP", b"Adobe RGB\0\0")).unwrap();
        assert!(decoded.warnings[0].contains("profile"), "{:?}", decoded.warnings);
    }

    #[test]
    fn an_orientation_turns_the_picture() {
        let exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        let bytes = picture("eXIf", exif);
        let decoded = decode(&bytes).unwrap();
        assert_eq!(([decoded.width, decoded.height], dimensions(&bytes).unwrap()), ([1, 2], [1, 2]));
    }
}
