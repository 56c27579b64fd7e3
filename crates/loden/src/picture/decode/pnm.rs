//! Netpbm pictures: grey and colour, as text and as numbers of 8 and 16 bits.
//!
//! # Format
//! `P2`, `P3` (text), `P5` or `P6` (numbers), then width, height and the largest value as text, with comments from `#` to the end
//! of the line; one white space, then the pixels. Values above 255 have two bytes, the high one first.

use super::{Decoded, Numbers, Problem, Result, check_content};

/// Whether a file begins like one.
pub(super) fn is_pnm(bytes: &[u8]) -> bool {
    matches!(bytes, [b'P', b'2' | b'3' | b'5' | b'6', next, ..] if next.is_ascii_whitespace() || *next == b'#')
}

pub(super) fn decode(bytes: &[u8]) -> Result<Decoded> {
    let truncated = || Problem::Invalid("the Netpbm picture is truncated".into());
    let mut rest = bytes.get(2..).ok_or_else(truncated)?;
    let (is_text, channels) = (matches!(bytes[1], b'2' | b'3'), if matches!(bytes[1], b'3' | b'6') { 3 } else { 1 });
    let [width, height, most] = [number(&mut rest)?, number(&mut rest)?, number(&mut rest)?];
    if !(1..=65_535).contains(&most) {
        return Err(Problem::Invalid(format!("found the largest value {most}, expected 1 to 65535")));
    }
    check_content(width, height, bytes.len(), 1)?;
    let count = width * height * channels;
    let values: Vec<usize> = if is_text {
        (0..count).map(|_| number(&mut rest)).collect::<Result<_>>()?
    } else {
        // one white space ends the header
        let rest = rest.get(1..).ok_or_else(truncated)?;
        let size = if most > 255 { 2 } else { 1 };
        let rows = rest.get(..count * size).ok_or_else(truncated)?;
        rows.chunks_exact(size).map(|bytes| bytes.iter().fold(0, |value, b| 256 * value + usize::from(*b))).collect()
    };
    if let Some(value) = values.iter().find(|value| **value > most) {
        return Err(Problem::Invalid(format!("found the value {value}, more than the largest, {most}")));
    }
    let scaled = |value: &usize, full: usize| (value * full + most / 2) / most;
    let per_pixel = 3 / channels;
    let spread = |full: usize| values.iter().flat_map(move |v| std::iter::repeat_n(scaled(v, full), per_pixel));
    let numbers = if most > 255 {
        Numbers::U16(spread(65_535).map(|v| v as u16).collect())
    } else {
        Numbers::U8(spread(255).map(|v| v as u8).collect())
    };
    Ok(Decoded::new([width, height], numbers))
}

/// The next number of the text, up to the byte behind it.
fn number(rest: &mut &[u8]) -> Result<usize> {
    loop {
        match rest.first() {
            Some(byte) if byte.is_ascii_whitespace() => *rest = &rest[1..],
            Some(b'#') => {
                let end = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
                *rest = &rest[end..];
            }
            _ => break,
        }
    }
    let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let text = std::str::from_utf8(&rest[..digits]).unwrap_or_default();
    let found = text.parse().map_err(|_| Problem::Invalid("a number is missing in the Netpbm picture".into()))?;
    *rest = &rest[digits..];
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(bytes: &[u8]) -> Numbers {
        decode(bytes).unwrap().numbers
    }

    #[test]
    fn every_kind_is_read() {
        assert_eq!(numbers(b"P5\n# made by hand\n2 1\n255\n\x07\x09"), Numbers::U8(vec![7, 7, 7, 9, 9, 9]));
        assert_eq!(numbers(b"P6 1 1 255 \x01\x02\x03"), Numbers::U8(vec![1, 2, 3]));
        assert_eq!(numbers(b"P2 2 1 15\n0 15"), Numbers::U8(vec![0, 0, 0, 255, 255, 255]));
        assert_eq!(numbers(b"P3 1 1 255 4 5 6"), Numbers::U8(vec![4, 5, 6]));
        assert_eq!(numbers(b"P5 1 1 65535\n\x12\x34"), Numbers::U16(vec![0x1234; 3]));
        assert_eq!(numbers(b"P5 1 1 4095\n\x0f\xff"), Numbers::U16(vec![65_535; 3]));
    }

    #[test]
    fn damaged_files_are_errors() {
        let wrong = |bytes: &[u8], expected: &str| {
            let problem = decode(bytes).unwrap_err().to_string();
            assert!(problem.contains(expected), "{problem}");
        };
        wrong(b"P5 2 2 255\n\x01", "truncated");
        wrong(b"P5 4 4 255\n\x01", "does not fit");
        wrong(b"P5 2 2 0\n0000", "largest value 0");
        wrong(b"P2 1 1 9 10", "more than the largest");
        wrong(b"P2 1 1 ", "number is missing");
        wrong(b"P5 4000000000 4 255\n", "width");
    }
}
