//! Samples to colours: grey, RGB, palettes, CMYK and YCbCr.

use super::super::{Numbers, Problem, Result};
use super::chunks::{Layout, Samples};
use super::{COLOR_MAP, EXTRA_SAMPLES, INK_SET, Page, REFERENCE_BLACK_WHITE, YCBCR_COEFFICIENTS};

/// How samples make colours.
pub(super) enum Colours {
    Grey {
        is_inverted: bool,
    },
    Rgb,
    /// Red, green and blue of each index.
    Palette(Vec<[u16; 3]>),
    Cmyk,
    YCbCr {
        luma: [f32; 3],
        black_white: [f32; 6],
    },
    /// YCbCr that a JPEG decoder made RGB.
    Converted,
}

impl Colours {
    pub(super) fn new(page: &Page, layout: &Layout, photometric: u64, warnings: &mut Vec<String>) -> Result<Self> {
        let unsupported = |what: &str| Err(Problem::Unsupported(format!("TIFF images of {what} are not supported")));
        let (colours, needed) = match photometric {
            0 | 1 => (Self::Grey { is_inverted: photometric == 0 }, 1),
            2 => (Self::Rgb, 3),
            3 => (Self::palette(page, layout)?, 1),
            5 if page.number(INK_SET, 1) == 1 => {
                warnings.push("CMYK is converted to RGB without a profile".into());
                (Self::Cmyk, 4)
            }
            6 if layout.is_jpeg() => (Self::Converted, 3),
            6 => (Self::ycbcr(page), 3),
            4 => return unsupported("masks"),
            5 => return unsupported("inks other than CMYK"),
            8..=10 => return unsupported("CIE L*a*b*"),
            32_803 => return unsupported("raw sensor data"),
            32_844 | 32_845 => return unsupported("LogLuv"),
            34_892 => return unsupported("linear raw data"),
            other => return unsupported(&format!("the unknown kind of colours {other}")),
        };
        if layout.channels < needed {
            let problem = format!("found {} channels, expected at least {needed}", layout.channels);
            return Err(Problem::Invalid(problem));
        }
        if matches!(colours, Self::Cmyk | Self::YCbCr { .. })
            && (layout.bits != 8 && layout.bits != 16 || layout.is_float)
        {
            return unsupported(&format!("CMYK or YCbCr of {} bits", layout.bits));
        }
        // 1 and 2 are kinds of alpha
        let extra = page.numbers(EXTRA_SAMPLES).unwrap_or_default();
        let is_alpha = |k: usize| extra.get(k).is_some_and(|kind| [1.0, 2.0].contains(kind));
        let others = (0..layout.channels - needed).filter(|&k| !is_alpha(k)).count();
        if others > 0 {
            warnings.push(format!("the first {needed} of {} channels are read", layout.channels));
        }
        Ok(colours)
    }

    fn palette(page: &Page, layout: &Layout) -> Result<Self> {
        let invalid = |problem: String| Err(Problem::Invalid(problem));
        if layout.is_float || layout.bits > 16 {
            return invalid(format!("found palette indices of {} bits", layout.bits));
        }
        let count = 1 << layout.bits;
        let map = page.numbers(COLOR_MAP).unwrap_or_default();
        if map.len() != 3 * count {
            return invalid(format!("found {} numbers in the palette, expected {}", map.len(), 3 * count));
        }
        // some programs write numbers of 8 bits
        let scale = if map.iter().all(|v| *v < 256.0) { 257.0 } else { 1.0 };
        let colour = |k: usize| [0, 1, 2].map(|channel| (map[channel * count + k] * scale) as u16);
        Ok(Self::Palette((0..count).map(colour).collect()))
    }

    fn ycbcr(page: &Page) -> Self {
        fn stated<const N: usize>(numbers: Option<Vec<f64>>, default: [f32; N]) -> [f32; N] {
            let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
            numbers.map_or(default, |numbers| numbers.map(|v| v as f32))
        }
        let luma = stated(page.numbers(YCBCR_COEFFICIENTS), [0.299, 0.587, 0.114]);
        let black_white = stated(page.numbers(REFERENCE_BLACK_WHITE), [0.0, 255.0, 128.0, 255.0, 128.0, 255.0]);
        Self::YCbCr { luma, black_white }
    }

    /// The colours of all pixels.
    pub(super) fn numbers(&self, layout: &Layout, samples: Samples) -> Numbers {
        let (channels, bits) = (layout.channels, layout.bits);
        match samples {
            Samples::F32(all) => {
                let pixel = |c: &[f32]| match self {
                    Self::Grey { is_inverted } => [if *is_inverted { 1.0 - c[0] } else { c[0] }; 3],
                    _ => [c[0], c[1], c[2]],
                };
                Numbers::F32(all.chunks_exact(channels).flat_map(pixel).collect())
            }
            Samples::U16(all) => {
                let largest = (1u32 << bits) - 1;
                let full = |v: u16| ((u32::from(v) * 65_535 + largest / 2) / largest) as u16;
                Numbers::U16(all.chunks_exact(channels).flat_map(|c| self.colour(c, full, 65_535.0)).collect())
            }
            Samples::U8(all) => {
                if let Self::Palette(map) = self {
                    let pixels = all.chunks_exact(channels).flat_map(|c| map[usize::from(c[0])]);
                    // a palette of 8 bits, repeated in both bytes or in the upper one
                    let all = |is: fn(&u16) -> bool| map.iter().flatten().all(is);
                    if all(|v| v % 257 == 0) || all(|v| v % 256 == 0) {
                        return Numbers::U8(pixels.map(|v| (v >> 8) as u8).collect());
                    }
                    return Numbers::U16(pixels.collect());
                }
                let largest = (1u32 << bits) - 1;
                let full = |v: u8| ((u32::from(v) * 255 + largest / 2) / largest) as u8;
                Numbers::U8(all.chunks_exact(channels).flat_map(|c| self.colour(c, full, 255.0)).collect())
            }
        }
    }

    /// The colour of a pixel of integers, which `full` scales to the largest number `white`.
    fn colour<T: Integer>(&self, c: &[T], full: impl Fn(T) -> T, white: f32) -> [T; 3] {
        match self {
            Self::Grey { is_inverted: false } => [full(c[0]); 3],
            Self::Grey { is_inverted: true } => [T::new(white - full(c[0]).value()); 3],
            Self::Rgb | Self::Converted => [full(c[0]), full(c[1]), full(c[2])],
            Self::Palette(map) => map[c[0].value() as usize].map(|v| T::new(f32::from(v))),
            Self::Cmyk => {
                let ink = |k: usize| white - full(c[k]).value();
                [0, 1, 2].map(|k| T::new(ink(k) * ink(3) / white))
            }
            Self::YCbCr { luma: [r, g, b], black_white } => {
                // codes of 16 bits have the reference values of 8 bits, scaled
                let unit = white / 255.0;
                let code = |k: usize, range: f32| {
                    let [black, white] = [black_white[2 * k], black_white[2 * k + 1]];
                    (c[k].value() / unit - black) * range / (white - black).max(1e-6)
                };
                let (y, cb, cr) = (code(0, 255.0), code(1, 127.0), code(2, 127.0));
                let (red, blue) = (y + cr * (2.0 - 2.0 * r), y + cb * (2.0 - 2.0 * b));
                [red, (y - r * red - b * blue) / g, blue].map(|v| T::new(v * unit))
            }
        }
    }
}

/// Unsigned integers of 8 or 16 bits.
trait Integer: Copy {
    fn value(self) -> f32;
    /// Rounded, and limited to the range.
    fn new(value: f32) -> Self;
}

impl Integer for u8 {
    fn value(self) -> f32 {
        self.into()
    }

    fn new(value: f32) -> Self {
        value.round() as Self
    }
}

impl Integer for u16 {
    fn value(self) -> f32 {
        self.into()
    }

    fn new(value: f32) -> Self {
        value.round() as Self
    }
}
