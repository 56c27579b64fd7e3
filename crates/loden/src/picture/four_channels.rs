//! Writes TIFF pictures of four channels, which hold numbers rather than colours.

use std::fs;
use std::path::Path;

use crate::output::failed;
use crate::{Error, Result};

/// Number of channels.
const CHANNELS: u32 = 4;

/// The samples of a picture, channel by channel and row by row.
pub(crate) enum Samples<'a> {
    Bytes(&'a [u8]),
    Singles(&'a [f32]),
}

/// Writes a picture without compression, in one strip. The fourth channel is a number like the others, not coverage.
///
/// # Errors
/// [`Error::Unsupported`] for more than 4 GiB; [`Error::Io`].
pub(crate) fn write(path: &Path, [width, height]: [usize; 2], samples: Samples) -> Result<()> {
    let (pixels, bits, format) = match samples {
        Samples::Bytes(bytes) => (bytes.to_vec(), 8, 1),
        Samples::Singles(numbers) => (numbers.iter().flat_map(|number| number.to_le_bytes()).collect(), 32, 3),
    };
    let side = |side: usize| u32::try_from(side).map_err(|_| too_large(path));
    let (width, height) = (side(width)?, side(height)?);
    let bytes =
        u32::try_from(pixels.len()).ok().filter(|bytes| *bytes < u32::MAX - 1024).ok_or_else(|| too_large(path))?;
    // lists of numbers for each channel, then the directory, stand after the pixels
    let lists = 8 + bytes;
    let (short, long) = (3, 4);
    let tags: [(u16, u16, u32, u32); 12] = [
        (256, long, 1, width),
        (257, long, 1, height),
        (258, short, CHANNELS, lists),
        (259, short, 1, 1),
        (262, short, 1, 2),
        (273, long, 1, 8),
        (277, short, 1, CHANNELS),
        (278, long, 1, height),
        (279, long, 1, bytes),
        (284, short, 1, 1),
        (338, short, 1, 0),
        (339, short, CHANNELS, lists + 2 * CHANNELS),
    ];
    let mut file = b"II*\0".to_vec();
    file.extend((lists + 4 * CHANNELS).to_le_bytes());
    file.extend(pixels);
    let of_channels = |number: u16| std::iter::repeat_n(number.to_le_bytes(), CHANNELS as usize).flatten();
    file.extend(of_channels(bits).chain(of_channels(format)));
    file.extend((tags.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in tags {
        file.extend(tag.to_le_bytes().into_iter().chain(kind.to_le_bytes()));
        file.extend(count.to_le_bytes().into_iter().chain(value.to_le_bytes()));
    }
    file.extend([0; 4]);
    fs::write(path, file).map_err(failed(path))
}

fn too_large(path: &Path) -> Error {
    Error::unsupported(path, "a TIFF file holds at most 4 GiB")
}
