//! Directories of tags, as in TIFF files and in the EXIF part of others.

use super::super::orientation::Orientation;

/// The number of the tag of the orientation.
pub(super) const ORIENTATION: u16 = 274;

/// The directories of a file.
pub(super) struct Tags<'a> {
    bytes: &'a [u8],
    is_big_endian: bool,
    /// Whether offsets have eight bytes.
    is_big: bool,
}

/// A directory: tags with their place in the file.
#[derive(Default)]
pub(super) struct Directory(Vec<Entry>);

#[derive(Clone, Copy)]
struct Entry {
    tag: u16,
    kind: u16,
    count: usize,
    offset: usize,
}

impl<'a> Tags<'a> {
    /// Reads the header; also returns the place of the first directory.
    pub(super) fn new(bytes: &'a [u8]) -> Option<(Self, usize)> {
        let is_big_endian = match bytes.get(..2)? {
            b"II" => false,
            b"MM" => true,
            _ => return None,
        };
        let mut tags = Self { bytes, is_big_endian, is_big: false };
        match tags.number(2, 2)? {
            42 => Some(tags.number(4, 4)?),
            43 => {
                tags.is_big = true;
                Some(tags.number(8, 8)?)
            }
            _ => None,
        }
        .and_then(|first| Some((tags, usize::try_from(first).ok()?)))
    }

    /// Reads the directory at a place; also returns the place of the next one, 0 for none.
    pub(super) fn directory(&self, at: usize) -> Option<(Directory, usize)> {
        let (count_bytes, entry_bytes, word) = if self.is_big { (8, 20, 8) } else { (2, 12, 4) };
        let count = usize::try_from(self.number(at, count_bytes)?).ok()?;
        let start = at.checked_add(count_bytes)?;
        let end = start.checked_add(count.checked_mul(entry_bytes)?)?;
        self.bytes.get(start..end)?;
        let entry = |k: usize| {
            let at = start + k * entry_bytes;
            let kind = self.number(at + 2, 2)? as u16;
            let count = usize::try_from(self.number(at + 4, word)?).ok()?;
            let value = at + 4 + word;
            let length = count.checked_mul(bytes_of(kind)?)?;
            let offset = if length <= word { value } else { usize::try_from(self.number(value, word)?).ok()? };
            self.bytes.get(offset..offset.checked_add(length)?)?;
            Some(Entry { tag: self.number(at, 2)? as u16, kind, count, offset })
        };
        // entries of unknown types or beyond the file are as good as none
        let entries = (0..count).filter_map(entry).collect();
        Some((Directory(entries), self.number(end, word).and_then(|next| usize::try_from(next).ok()).unwrap_or(0)))
    }

    /// The numbers of a tag.
    pub(super) fn numbers(&self, directory: &Directory, tag: u16) -> Option<Vec<f64>> {
        let entry = directory.entry(tag)?;
        let size = bytes_of(entry.kind)?;
        (0..entry.count).map(|k| self.value(entry.kind, entry.offset + k * size)).collect()
    }

    /// The first number of a tag, if it is not negative.
    pub(super) fn number_of(&self, directory: &Directory, tag: u16) -> Option<u64> {
        let entry = directory.entry(tag).filter(|entry| entry.count > 0)?;
        let value = self.value(entry.kind, entry.offset)?;
        (value >= 0.0).then_some(value as u64)
    }

    /// The bytes of a tag.
    pub(super) fn bytes_of(&self, directory: &Directory, tag: u16) -> Option<&'a [u8]> {
        let entry = directory.entry(tag)?;
        self.bytes.get(entry.offset..entry.offset + entry.count * bytes_of(entry.kind)?)
    }

    /// The orientation that a directory states.
    pub(super) fn orientation(&self, directory: &Directory) -> Option<Orientation> {
        Orientation::of_tag(self.number_of(directory, ORIENTATION)?)
    }

    /// Whether numbers have their most significant byte first.
    pub(super) fn is_big_endian(&self) -> bool {
        self.is_big_endian
    }

    /// An unsigned number of `size` bytes.
    fn number(&self, at: usize, size: usize) -> Option<u64> {
        let bytes = self.bytes.get(at..at.checked_add(size)?)?;
        let join = |sum: u64, &byte: &u8| sum << 8 | u64::from(byte);
        Some(if self.is_big_endian { bytes.iter().fold(0, join) } else { bytes.iter().rev().fold(0, join) })
    }

    fn value(&self, kind: u16, at: usize) -> Option<f64> {
        let number = self.number(at, bytes_of(kind)?.min(8))?;
        Some(match kind {
            5 => number_pair(self.number(at, 4)? as f64, self.number(at + 4, 4)? as f64),
            6 => f64::from(number as u8 as i8),
            8 => f64::from(number as u16 as i16),
            9 => f64::from(number as u32 as i32),
            10 => number_pair(
                f64::from(self.number(at, 4)? as u32 as i32),
                f64::from(self.number(at + 4, 4)? as u32 as i32),
            ),
            11 => f64::from(f32::from_bits(number as u32)),
            12 => f64::from_bits(number),
            17 => number as i64 as f64,
            _ => number as f64,
        })
    }
}

impl Directory {
    fn entry(&self, tag: u16) -> Option<Entry> {
        self.0.iter().find(|entry| entry.tag == tag).copied()
    }

    pub(super) fn has(&self, tag: u16) -> bool {
        self.entry(tag).is_some()
    }
}

fn number_pair(numerator: f64, denominator: f64) -> f64 {
    if denominator == 0.0 { 0.0 } else { numerator / denominator }
}

/// The bytes of a number of each type of a tag.
fn bytes_of(kind: u16) -> Option<usize> {
    Some(match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16..=18 => 8,
        _ => return None,
    })
}

/// The orientation that EXIF data states; upright if there is none.
pub(super) fn orientation(exif: &[u8]) -> Orientation {
    let stated = || {
        let (tags, first) = Tags::new(exif)?;
        tags.orientation(&tags.directory(first)?.0)
    };
    stated().unwrap_or(Orientation::UPRIGHT)
}
