//! `.btf` files without factorisation: the reflectance of every texel for all pairs.

use std::borrow::Cow;
use std::io::Read;
use std::ops::Range;
use std::path::Path;

use half::f16;

use super::header::{Header, size};
use crate::color::spectrum::RgbWeights;
use crate::input::{Cursor, guarded};
use crate::{Error, Result};

/// Texel by texel: `[view][light][channel]` of half floats.
pub(super) struct Bdi {
    /// The byte range of each chunk.
    chunks: Vec<Range<usize>>,
    /// The stored texels, in order.
    stored: Vec<u32>,
    /// Number of stored texels before each chunk, and the total.
    firsts: Vec<usize>,
    packed: bool,
    lights: usize,
    channels: usize,
    /// Numbers of one texel.
    numbers: usize,
    weights: Option<RgbWeights>,
}

impl Bdi {
    pub(super) fn read(header: &Header, cursor: &mut Cursor<'_>) -> Result<(Self, [usize; 2])> {
        let [width, height] = size(cursor)?;
        let lines = cursor.u32("scan_lines_per_chunk")? as usize;
        let compression = cursor.u8("compression")?;
        if lines == 0 || compression > 2 {
            let problem = format!("found {compression} with {lines} scan lines per chunk, expected 0, 1 or 2");
            return Err(cursor.invalid("compression", problem));
        }
        let mask = cursor.take("mask", (width * height) as u64)?;
        let rotations = cursor.u32("number of rotations")?;
        cursor.take("rotations", u64::from(rotations) * 36)?;
        let numbers = header.pairs() * header.channels;
        let kept = |texel: &usize| compression != 2 || mask[*texel] != 0;
        let (mut chunks, mut stored, mut firsts) = (Vec::new(), Vec::new(), vec![0]);
        for first in (0..height).step_by(lines) {
            let texels = first * width..(first.saturating_add(lines)).min(height) * width;
            stored.extend(texels.filter(kept).map(|texel| texel as u32));
            let expected = (stored.len() - firsts[firsts.len() - 1]) as u64 * numbers as u64 * 2;
            let bytes = cursor.u32("size of a chunk")?;
            if compression != 1 && u64::from(bytes) != expected {
                let problem = format!("found {bytes} bytes in chunk {}, expected {expected}", chunks.len());
                return Err(cursor.invalid("size of a chunk", problem));
            }
            let start = cursor.at();
            cursor.take("chunk", bytes.into())?;
            chunks.push(start..cursor.at());
            firsts.push(stored.len());
        }
        let (lights, channels, weights) = (header.lights.len(), header.channels, header.weights.clone());
        let packed = compression == 1;
        Ok((Self { chunks, stored, firsts, packed, lights, channels, numbers, weights }, [width, height]))
    }

    /// Calls back with the colours of all `lights` for each stored texel in turn.
    pub(super) fn decode(
        &self,
        path: &Path,
        bytes: &[u8],
        view: usize,
        lights: Range<usize>,
        put: &mut dyn FnMut(usize, &[[f32; 3]]),
    ) -> Result<()> {
        let mut colours = vec![[0.0; 3]; lights.len()];
        for (chunk, range) in self.chunks.iter().enumerate() {
            let texels = &self.stored[self.firsts[chunk]..self.firsts[chunk + 1]];
            let content = self.content(path, &bytes[range.clone()], chunk, texels.len() * self.numbers * 2)?;
            for (texel, all) in texels.iter().zip(content.chunks_exact(self.numbers * 2)) {
                for (colour, light) in colours.iter_mut().zip(lights.clone()) {
                    let first = (view * self.lights + light) * self.channels * 2;
                    let (halves, _) = all[first..first + self.channels * 2].as_chunks::<2>();
                    let mut values = halves.iter().map(|b| f16::from_le_bytes(*b).to_f32());
                    *colour = match &self.weights {
                        Some(weights) => weights.rgb(values),
                        None => [0; 3].map(|_| values.next().unwrap_or(0.0)),
                    };
                }
                put(*texel as usize, &colours);
            }
        }
        Ok(())
    }

    fn content<'a>(&self, path: &Path, bytes: &'a [u8], chunk: usize, expected: usize) -> Result<Cow<'a, [u8]>> {
        if !self.packed {
            return Ok(Cow::Borrowed(bytes));
        }
        let wrong = |problem: String| Error::invalid(path, format!("chunk {chunk}"), problem);
        // grow with the data that is really there, never by what the header claims
        let mut content = Vec::new();
        let mut decoder = bzip2::read::BzDecoder::new(bytes).take(expected as u64 + 1);
        let unpacked = guarded("bzip2", || decoder.read_to_end(&mut content)).map_err(wrong)?;
        unpacked.map_err(|e| wrong(format!("not a complete bzip2 stream: {e}")))?;
        if content.len() == expected {
            return Ok(Cow::Owned(content));
        }
        Err(wrong(format!("unpacked {} bytes, expected {expected}", content.len())))
    }
}
