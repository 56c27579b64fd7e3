//! Radiance pictures.
//!
//! # Format
//! Lines of a header that begin with `#?`, an empty line, the resolution, then scanlines of RGBE or XYZE pixels: as they
//! are, with runs of equal pixels, or with runs of each component. `EXPOSURE` and `COLORCORR` say by what pixels were
//! multiplied; there may be several. The first axis of the resolution counts scanlines, the second pixels in them.

use glam::Vec3;

use super::super::orientation::Orientation;
use super::super::primaries::Primaries;
use super::{Decoded, Numbers, Problem, Result, check_size};

/// What a header says about pixels.
struct Header {
    /// By what pixels were multiplied.
    scale: Vec3,
    primaries: Primaries,
    warnings: Vec<String>,
}

pub(super) fn decode(bytes: &[u8], bonn: bool) -> Result<Decoded> {
    let mut rest = bytes;
    let header = Header::read(&mut rest)?;
    let line = String::from_utf8_lossy(next_line(&mut rest)?);
    let words: Vec<&str> = line.split_whitespace().collect();
    let wrong = || Problem::Invalid(format!("found the resolution {line:?}, expected one such as \"-Y 480 +X 640\""));
    let [first, scanlines, second, pixels] = words[..] else { return Err(wrong()) };
    let (Ok(scanlines), Ok(pixels)) = (scanlines.parse::<usize>(), pixels.parse::<usize>()) else {
        return Err(wrong());
    };
    let (scanlines, pixels, orientation) = match (first, second) {
        ("+X", "-Y") if bonn => (pixels, scanlines, Orientation::new(false, false, true)),
        ("-Y" | "+Y", "-X" | "+X") => (scanlines, pixels, Orientation::new(false, second == "-X", first == "+Y")),
        ("-X" | "+X", "-Y" | "+Y") => (scanlines, pixels, Orientation::new(true, first == "-X", second == "+Y")),
        _ => return Err(wrong()),
    };
    check_size(pixels, scanlines)?;
    let mut numbers: Vec<f32> = Vec::new();
    let mut scanline = Vec::new();
    for y in 0..scanlines {
        let read = read_scanline(&mut rest, pixels, &mut scanline);
        read.map_err(|problem| Problem::Invalid(format!("scanline {y}: {problem}")))?;
        for &[r, g, b, exponent] in &scanline {
            let unit = if exponent == 0 { 0.0 } else { (f32::from(exponent) - 136.0).exp2() };
            let colour = Vec3::new(f32::from(r), f32::from(g), f32::from(b)) * unit / header.scale;
            numbers.extend(colour.to_array());
        }
    }
    let mut decoded = Decoded::new([pixels, scanlines], Numbers::F32(numbers)).with_primaries(header.primaries)?;
    decoded.warnings = header.warnings;
    Ok(decoded.upright(orientation))
}

impl Header {
    /// Reads the lines up to the empty one.
    fn read(rest: &mut &[u8]) -> Result<Self> {
        let mut header = Self { scale: Vec3::ONE, primaries: Primaries::REC_709, warnings: Vec::new() };
        let (mut is_xyz, mut stated) = (false, Primaries::REC_709);
        loop {
            let line = String::from_utf8_lossy(next_line(rest)?);
            if line.trim().is_empty() {
                break;
            }
            // lines of programs that made the picture before are indented: they do not hold for it any more
            let Some((key, value)) = line.split_once('=') else { continue };
            let wrong = |expected: &str| Problem::Invalid(format!("found {line:?}, expected {expected}"));
            match key {
                "FORMAT" => match value.trim() {
                    "32-bit_rle_rgbe" => is_xyz = false,
                    "32-bit_rle_xyze" => is_xyz = true,
                    _ => return Err(wrong("the format 32-bit_rle_rgbe or 32-bit_rle_xyze")),
                },
                "EXPOSURE" => {
                    let [exposure] = numbers(value).filter(|[e]| *e > 0.0).ok_or_else(|| wrong("a positive number"))?;
                    header.scale *= exposure as f32;
                }
                "COLORCORR" => {
                    let factors = numbers(value).filter(|f: &[f64; 3]| f.iter().all(|f| *f > 0.0));
                    let factors = factors.ok_or_else(|| wrong("three positive numbers"))?;
                    header.scale *= Vec3::from(factors.map(|f| f as f32));
                }
                "PRIMARIES" => {
                    let [rx, ry, gx, gy, bx, by, wx, wy] = numbers(value).ok_or_else(|| wrong("eight numbers"))?;
                    stated = Primaries::new([rx, ry, gx, gy, bx, by], [wx, wy]);
                }
                "GAMMA" if numbers(value) != Some([1.0]) => {
                    header.warnings.push(format!("{line} is ignored: Radiance pictures are linear"));
                }
                _ => {}
            }
        }
        header.primaries = if is_xyz { Primaries::XYZ } else { stated };
        if !header.scale.is_finite() || header.scale.min_element() < f32::MIN_POSITIVE {
            return Err(Problem::Invalid(format!("the exposures multiply to {}", header.scale)));
        }
        Ok(header)
    }
}

/// The next line without its end.
fn next_line<'a>(rest: &mut &'a [u8]) -> Result<&'a [u8]> {
    let end = rest.iter().position(|&b| b == b'\n');
    let end = end.ok_or_else(|| Problem::Invalid("the header of the HDR image has no end".into()))?;
    let line = &rest[..end];
    *rest = &rest[end + 1..];
    Ok(line.strip_suffix(b"\r").unwrap_or(line))
}

/// All numbers of a text, exactly N.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    <[f64; N]>::try_from(numbers?).ok().filter(|numbers| numbers.iter().all(|v| v.is_finite()))
}

type Read = std::result::Result<(), &'static str>;

fn read_scanline(rest: &mut &[u8], pixels: usize, scanline: &mut Vec<[u8; 4]>) -> Read {
    scanline.clear();
    if let [2, 2, high, low, ..] = **rest
        && (8..0x8000).contains(&pixels)
        && usize::from(high) << 8 | usize::from(low) == pixels
    {
        *rest = &rest[4..];
        scanline.resize(pixels, [0; 4]);
        return (0..4).try_for_each(|component| read_component(rest, component, scanline));
    }
    // Read pixels, and runs of the pixel before
    let mut shift = 0;
    while scanline.len() < pixels {
        let (&pixel, others) = rest.split_first_chunk().ok_or(ENDS)?;
        *rest = others;
        let [1, 1, 1, count] = pixel else {
            shift = 0;
            scanline.push(pixel);
            continue;
        };
        let last = *scanline.last().ok_or("it begins with a run")?;
        let count = if shift < 24 { usize::from(count) << shift } else { usize::MAX };
        if count > pixels - scanline.len() {
            return Err(TOO_LONG);
        }
        scanline.resize(scanline.len() + count, last);
        shift += 8;
    }
    Ok(())
}

/// Reads one component of all pixels, in runs.
fn read_component(rest: &mut &[u8], component: usize, scanline: &mut [[u8; 4]]) -> Read {
    let mut at = 0;
    while at < scanline.len() {
        let (&count, others) = rest.split_first().ok_or(ENDS)?;
        let (count, is_run) = if count > 128 { (usize::from(count - 128), true) } else { (usize::from(count), false) };
        let values = others.get(..if is_run { 1 } else { count }).ok_or(ENDS)?;
        let target = scanline.get_mut(at..at + count).filter(|_| count > 0).ok_or(TOO_LONG)?;
        for (k, pixel) in target.iter_mut().enumerate() {
            pixel[component] = values[if is_run { 0 } else { k }];
        }
        *rest = &others[values.len()..];
        at += count;
    }
    Ok(())
}

const ENDS: &str = "the file ends too early";
const TOO_LONG: &str = "a run does not fit";

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of six pixels with the red values 1 to 6 in the order of the file.
    fn picture(header: &str, resolution: &str) -> Vec<u8> {
        let mut bytes = format!("#?RADIANCE\n{header}\n{resolution}\n").into_bytes();
        (1..=6).for_each(|k| bytes.extend([k, 1, 2, 136]));
        bytes
    }

    fn red(bytes: &[u8], bonn: bool) -> ([usize; 2], Vec<f32>) {
        let decoded = decode(bytes, bonn).unwrap();
        let Numbers::F32(numbers) = decoded.numbers else { panic!("floats expected") };
        ([decoded.width, decoded.height], numbers.iter().step_by(3).copied().collect())
    }

    #[test]
    fn all_orientations_are_turned_upright() {
        for (resolution, width, expected) in [
            ("-Y 2 +X 3", 3, [1, 2, 3, 4, 5, 6]),
            ("-Y 2 -X 3", 3, [3, 2, 1, 6, 5, 4]),
            ("+Y 2 +X 3", 3, [4, 5, 6, 1, 2, 3]),
            ("+Y 2 -X 3", 3, [6, 5, 4, 3, 2, 1]),
            ("+X 2 -Y 3", 2, [1, 4, 2, 5, 3, 6]),
            ("-X 2 -Y 3", 2, [4, 1, 5, 2, 6, 3]),
            ("+X 2 +Y 3", 2, [3, 6, 2, 5, 1, 4]),
            ("-X 2 +Y 3", 2, [6, 3, 5, 2, 4, 1]),
        ] {
            let (size, found) = red(&picture("FORMAT=32-bit_rle_rgbe\n", resolution), false);
            assert_eq!((size, found), ([width, 6 / width], expected.map(|v| v as f32).to_vec()), "{resolution}");
        }
        // rows from the bottom, as in the archives of Bonn
        let (size, found) = red(&picture("", "+X 3 -Y 2"), true);
        assert_eq!((size, found), ([3, 2], [4.0, 5.0, 6.0, 1.0, 2.0, 3.0].to_vec()));
    }

    #[test]
    fn exposures_and_corrections_are_divided_out() {
        for (header, factor) in [
            ("EXPOSURE=4\n", 0.25),
            ("EXPOSURE= 4.0\r\nEXPOSURE=0.5\n\tEXPOSURE=7\n", 0.5),
            ("COLORCORR=2 1 1\nEXPOSURE=2\n", 0.25),
        ] {
            assert_eq!(red(&picture(header, "-Y 2 +X 3"), false).1[0], factor, "{header}");
        }
    }

    #[test]
    fn primaries_are_converted() {
        let rec_2020 = "PRIMARIES= 0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290\n";
        let decoded = decode(&picture(rec_2020, "-Y 2 +X 3"), false).unwrap();
        let matrix = decoded.to_rec709.unwrap();
        assert!((matrix.x_axis - Vec3::new(1.6605, -0.1246, -0.0182)).length() < 1e-3, "{matrix}");
        let xyz = decode(&picture("FORMAT=32-bit_rle_xyze\n", "-Y 2 +X 3"), false).unwrap();
        assert!((xyz.to_rec709.unwrap().y_axis - Vec3::new(-1.5372, 1.8758, -0.2040)).length() < 3e-3);
        assert!(decode(&picture("", "-Y 2 +X 3"), false).unwrap().to_rec709.is_none());
    }

    #[test]
    fn runs_are_read_in_both_ways() {
        let old = b"#?RGBE\n\n-Y 1 +X 8\n\x05\x01\x02\x88\x01\x01\x01\x07".to_vec();
        assert_eq!(red(&old, false).1, [5.0; 8]);
        let mut new = b"#?RADIANCE\n\n-Y 1 +X 8\n\x02\x02\x00\x08".to_vec();
        new.extend([0x88, 5, 0x88, 1, 4, 1, 2, 3, 4, 0x84, 9, 0x88, 136]);
        let blue = [1.0, 2.0, 3.0, 4.0, 9.0, 9.0, 9.0, 9.0];
        assert_eq!(decode(&new, false).unwrap().numbers, Numbers::F32(blue.map(|b| [5.0, 1.0, b]).concat()));
    }

    #[test]
    fn damage_is_named() {
        for (bytes, fault) in [
            (picture("FORMAT=hdr\n", "-Y 2 +X 3"), "FORMAT=hdr"),
            (picture("EXPOSURE=0\n", "-Y 2 +X 3"), "a positive number"),
            (picture("PRIMARIES=1 2\n", "-Y 2 +X 3"), "eight numbers"),
            (picture("", "-Y 2 +Y 3"), "found the resolution"),
            (picture("", "-Y 3 +X 3"), "scanline 2: the file ends too early"),
            (b"#?RADIANCE\nFORMAT=32".to_vec(), "has no end"),
            (b"#?RGBE\n\n-Y 1 +X 8\n\x01\x01\x01\x07".to_vec(), "begins with a run"),
            (b"#?RGBE\n\n-Y 1 +X 2\n\x05\x01\x02\x88\x01\x01\x01\x07".to_vec(), "does not fit"),
        ] {
            let error = decode(&bytes, false).unwrap_err().to_string();
            assert!(error.contains(fault), "{error}");
        }
    }
}
