//! Sun raster files, in which older databases of textures are kept.
//!
//! # Format
//! Eight big-endian numbers of 32 bits: the magic number, width, height, bits per pixel (8, 24 or 32), length, type (0 and 1: as it
//! is; 2: runs; 3: red first), type and length of the colour map. Then the map, as a row of reds, of greens and of blues, and
//! rows padded to an even number of bytes. Colours are stored blue first, with a byte before them if they have 32 bits.

use super::{Decoded, Numbers, Problem, Result, check_content};

/// The first four bytes of a file.
pub(super) const MAGIC: &[u8] = b"\x59\xa6\x6a\x95";
/// Bytes of the header.
const HEADER: usize = 32;
/// The byte that begins a run.
const RUN: u8 = 0x80;

pub(super) fn decode(bytes: &[u8]) -> Result<Decoded> {
    let truncated = || Problem::Invalid("the Sun raster image is truncated".into());
    let (header, rest) = bytes.split_at_checked(HEADER).ok_or_else(truncated)?;
    let number = |i: usize| u32::from_be_bytes([0, 1, 2, 3].map(|k| header[4 * i + k])) as usize;
    let [width, height, depth, kind, map] = [1, 2, 3, 5, 7].map(number);
    if ![8, 24, 32].contains(&depth) || kind > 3 {
        let problem = format!("a Sun raster image of {depth} bits and type {kind} is not supported");
        return Err(Problem::Unsupported(problem));
    }
    check_content(width, height, bytes.len(), 128)?;
    let (map, rest) = rest.split_at_checked(map).ok_or_else(truncated)?;
    let row = (width * depth / 8).next_multiple_of(2);
    let unpacked;
    let rows = if kind == 2 {
        unpacked = unpack(rest, row * height).ok_or_else(truncated)?;
        &unpacked[..]
    } else {
        rest.get(..row * height).ok_or_else(truncated)?
    };
    let colours = map.len() / 3;
    let pixel = |pixel: &[u8]| -> Option<[u8; 3]> {
        Some(match *pixel {
            [index] if colours > 0 => {
                let index = usize::from(index);
                (index < colours).then(|| [map[index], map[colours + index], map[2 * colours + index]])?
            }
            [grey] => [grey; 3],
            [.., a, b, c] if kind == 3 => [a, b, c],
            [.., a, b, c] => [c, b, a],
            _ => return None,
        })
    };
    let mut numbers = Vec::with_capacity(3 * width * height);
    for row in rows.chunks_exact(row) {
        for stored in row[..width * depth / 8].chunks_exact(depth / 8) {
            let outside = || Problem::Invalid("the Sun raster image has a pixel that is not in its colour map".into());
            numbers.extend(pixel(stored).ok_or_else(outside)?);
        }
    }
    Ok(Decoded::new([width, height], Numbers::U8(numbers)))
}

/// The first `count` bytes of runs; `None` if there are fewer.
fn unpack(bytes: &[u8], count: usize) -> Option<Vec<u8>> {
    let mut unpacked = Vec::with_capacity(count);
    let mut bytes = bytes.iter().copied();
    while unpacked.len() < count {
        match bytes.next()? {
            RUN => match bytes.next()? {
                0 => unpacked.push(RUN),
                more => unpacked.resize(unpacked.len() + 1 + usize::from(more), bytes.next()?),
            },
            byte => unpacked.push(byte),
        }
    }
    unpacked.truncate(count);
    Some(unpacked)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(size: [u32; 2], [depth, kind, map]: [u32; 3], content: &[u8]) -> Vec<u8> {
        let header = [0x59a6_6a95, size[0], size[1], depth, 0, kind, u32::from(map > 0), map];
        header.iter().flat_map(|n: &u32| n.to_be_bytes()).chain(content.iter().copied()).collect()
    }

    fn pixels(bytes: &[u8]) -> Vec<u8> {
        match decode(bytes).unwrap().numbers {
            Numbers::U8(numbers) => numbers,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_kind_is_read() {
        let grey = [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5, 5, 5, 128, 128, 128];
        // rows of three bytes are padded to four
        assert_eq!(pixels(&file([3, 2], [8, 1, 0], &[1, 2, 3, 0, 4, 5, 128, 0])), grey);
        let runs = [1, 2, 3, 0, 4, 5, 0x80, 0, 0];
        assert_eq!(pixels(&file([3, 2], [8, 2, 0], &runs)), grey);
        assert_eq!(pixels(&file([4, 1], [8, 2, 0], &[0x80, 3, 7])), [7; 12]);
        assert_eq!(pixels(&file([1, 1], [24, 1, 0], &[3, 2, 1, 0])), [1, 2, 3]);
        assert_eq!(pixels(&file([1, 1], [32, 3, 0], &[0, 1, 2, 3])), [1, 2, 3]);
        assert_eq!(pixels(&file([2, 1], [8, 1, 6], &[10, 20, 30, 40, 50, 60, 1, 0])), [20, 40, 60, 10, 30, 50]);
    }

    #[test]
    fn damaged_files_are_errors() {
        let wrong = |bytes: &[u8], expected: &str| {
            let problem = decode(bytes).unwrap_err().to_string();
            assert!(problem.contains(expected), "{problem}");
        };
        let good = file([3, 2], [8, 1, 0], &[0; 8]);
        wrong(&good[..20], "truncated");
        wrong(&good[..good.len() - 1], "truncated");
        wrong(&file([3, 2], [1, 1, 0], &[0; 8]), "1 bits and type 1");
        wrong(&file([1, 1], [8, 1, 3], &[1, 2, 3, 9, 0]), "not in its colour map");
        wrong(&file([4, 1], [8, 2, 0], &[0x80, 1]), "truncated");
        wrong(&file([1 << 20, 1 << 20], [8, 1, 0], &[0; 8]), "width");
    }
}
