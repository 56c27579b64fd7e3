//! TIFF pictures, BigTIFF too.
//!
//! # Format
//! A directory of tags says where strips or tiles of pixels are and how they are stored. Read are unsigned integers of 1 to
//! 64 bits and floating-point numbers of 16 to 64, grey, RGB, palette, CMYK and YCbCr, in one plane or several, with
//! predictors, in either order of bits, packed by LZW, deflate, PackBits, Zstandard or JPEG. Alpha is left out.
//!
//! # Limits
//! Signed and complex numbers, CIE L\*a\*b\*, LogLuv, raw sensor data and other compressions are refused by name.

mod chunks;
mod colour;

use super::super::primaries::Primaries;
use super::exif::{Directory, ORIENTATION, Tags};
use super::{Decoded, Problem, Result, check_size};
use chunks::{Layout, Samples};

/// Most directories that are looked at.
const MAX_DIRECTORIES: usize = 64;

const NEW_SUBFILE_TYPE: u16 = 254;
const WIDTH: u16 = 256;
const HEIGHT: u16 = 257;
const BITS: u16 = 258;
const COMPRESSION: u16 = 259;
const PHOTOMETRIC: u16 = 262;
const FILL_ORDER: u16 = 266;
const STRIP_OFFSETS: u16 = 273;
const SAMPLES: u16 = 277;
const ROWS_PER_STRIP: u16 = 278;
const STRIP_BYTES: u16 = 279;
const PLANAR: u16 = 284;
const TRANSFER_FUNCTION: u16 = 301;
const PREDICTOR: u16 = 317;
const WHITE_POINT: u16 = 318;
const PRIMARIES: u16 = 319;
const COLOR_MAP: u16 = 320;
const TILE_WIDTH: u16 = 322;
const TILE_HEIGHT: u16 = 323;
const TILE_OFFSETS: u16 = 324;
const TILE_BYTES: u16 = 325;
const INK_SET: u16 = 332;
const EXTRA_SAMPLES: u16 = 338;
const SAMPLE_FORMAT: u16 = 339;
const JPEG_TABLES: u16 = 347;
const YCBCR_COEFFICIENTS: u16 = 529;
const YCBCR_SUBSAMPLING: u16 = 530;
const REFERENCE_BLACK_WHITE: u16 = 532;
const ICC_PROFILE: u16 = 34_675;

/// A picture of a file.
struct Page<'a> {
    bytes: &'a [u8],
    tags: &'a Tags<'a>,
    directory: &'a Directory,
}

impl Page<'_> {
    /// The number of a tag, or the default.
    fn number(&self, tag: u16, default: u64) -> u64 {
        self.tags.number_of(self.directory, tag).unwrap_or(default)
    }

    fn numbers(&self, tag: u16) -> Option<Vec<f64>> {
        self.tags.numbers(self.directory, tag)
    }

    /// A tag whose numbers must be the same.
    fn same(&self, tag: u16, default: u64, what: &str) -> Result<u64> {
        let numbers = self.numbers(tag).filter(|numbers| !numbers.is_empty()).unwrap_or(vec![default as f64]);
        if numbers.iter().any(|number| *number != numbers[0]) {
            return Err(Problem::Unsupported(format!(
                "TIFF images whose channels differ in their {what} are not supported"
            )));
        }
        Ok(numbers[0] as u64)
    }
}

pub(super) fn decode(bytes: &[u8]) -> Result<Decoded> {
    let damaged = damaged_directory;
    let (tags, first) = Tags::new(bytes).ok_or_else(damaged)?;
    let (mut next, mut chosen, mut others) = (first, None, 0);
    for _ in 0..MAX_DIRECTORIES {
        let Some((directory, following)) = tags.directory(next) else { break };
        let kind = tags.number_of(&directory, NEW_SUBFILE_TYPE).unwrap_or(0);
        // smaller copies, masks
        let is_picture = kind & 5 == 0 && directory.has(WIDTH);
        others += usize::from(is_picture && chosen.is_some());
        if is_picture && chosen.is_none() {
            chosen = Some(directory);
        }
        if following == 0 || following == first {
            break;
        }
        next = following;
    }
    let directory = match chosen {
        Some(directory) => directory,
        None => tags.directory(first).ok_or_else(damaged)?.0,
    };
    let page = Page { bytes, tags: &tags, directory: &directory };
    let mut decoded = page.decode()?;
    if others > 0 {
        decoded.warnings.push(format!("the first of {} pictures is read", others + 1));
    }
    Ok(decoded)
}

/// The samples of a picture of four channels of 8 bits, alpha and all, as they are stored, with its width and height.
pub(super) fn four_bytes(bytes: &[u8]) -> Result<([usize; 2], Vec<u8>)> {
    let (tags, first) = Tags::new(bytes).ok_or_else(damaged_directory)?;
    let (directory, _) = tags.directory(first).ok_or_else(damaged_directory)?;
    let page = Page { bytes, tags: &tags, directory: &directory };
    let (width, height) = page.size()?;
    let layout = Layout::new(&page, width, height)?;
    if (layout.channels, layout.bits, layout.is_float) != (4, 8, false) {
        let found = format!("found {} channels of {} bits, expected 4 of 8", layout.channels, layout.bits);
        return Err(Problem::Invalid(found));
    }
    match layout.read(&page)? {
        Samples::U8(samples) => Ok(([width, height], samples)),
        _ => Err(Problem::Invalid("its samples have no 8 bits".into())),
    }
}

fn damaged_directory() -> Problem {
    Problem::Invalid("the directory of the TIFF image is damaged".into())
}

fn missing(what: &str) -> Problem {
    Problem::Invalid(format!("the TIFF image does not say its {what}"))
}

impl Page<'_> {
    /// Width and height, within the limits.
    fn size(&self) -> Result<(usize, usize)> {
        let side = |tag: u16, what: &str| {
            self.tags.number_of(self.directory, tag).map(|side| side.min(1 << 40) as usize).ok_or_else(|| missing(what))
        };
        let (width, height) = (side(WIDTH, "width")?, side(HEIGHT, "height")?);
        check_size(width, height)?;
        Ok((width, height))
    }

    fn decode(&self) -> Result<Decoded> {
        let (width, height) = self.size()?;
        let layout = Layout::new(self, width, height)?;
        let photometric = self.tags.number_of(self.directory, PHOTOMETRIC).ok_or_else(|| missing("kind of colours"))?;
        let mut warnings = Vec::new();
        let colours = colour::Colours::new(self, &layout, photometric, &mut warnings)?;
        let samples = layout.read(self)?;
        let numbers = colours.numbers(&layout, samples);
        let mut decoded = Decoded::new([width, height], numbers);
        if !layout.is_float {
            decoded.encoding = crate::color::Encoding::Srgb;
        }
        decoded = self.with_profile(decoded, &mut warnings)?;
        decoded.warnings = warnings;
        let orientation = match self.tags.number_of(self.directory, ORIENTATION) {
            None => return Ok(decoded),
            Some(number) => match super::super::orientation::Orientation::of_tag(number) {
                Some(orientation) => orientation,
                None => {
                    decoded.warnings.push(format!("the orientation {number} is unknown and ignored"));
                    return Ok(decoded);
                }
            },
        };
        Ok(decoded.upright(orientation))
    }

    /// Applies primaries, and names what is not applied.
    fn with_profile(&self, decoded: Decoded, warnings: &mut Vec<String>) -> Result<Decoded> {
        if let Some(profile) = self.tags.bytes_of(self.directory, ICC_PROFILE) {
            warnings.extend(super::icc::warning(profile));
            return Ok(decoded);
        }
        if self.directory.has(TRANSFER_FUNCTION) {
            warnings.push("its transfer function is ignored".into());
        }
        let (Some(primaries), white) = (self.numbers(PRIMARIES), self.numbers(WHITE_POINT)) else { return Ok(decoded) };
        let (Ok(primaries), Ok(white)) =
            (<[f64; 6]>::try_from(primaries), <[f64; 2]>::try_from(white.unwrap_or(vec![0.3127, 0.3290])))
        else {
            return Err(Problem::Invalid(
                "the primaries of the TIFF image are not six numbers, or its white not two".into(),
            ));
        };
        decoded.with_primaries(Primaries::new(primaries, white))
    }
}
