//! Entropy coding of a map of sources.
//!
//! # Model
//! Most texels continue what a neighbour copies: the texel to the left, above, above right or above left, in this order; equal
//! continuations count once. A decision for each says whether it is the one. A source that continues none is written in full. Sources
//! go on at the opposite edge of the sample. A checksum of all sources ends the stream. The probability of a decision adapts to its place in the list, the number of
//! neighbours that agree with the first, and which continuation the texels to the left, above and above right were.

use super::{Source, SourceMap};
use crate::codec::entropy::{Bit, Coder, Decoder, Encoder, adaptive};

/// Most texels per byte of a stream: no decision has a probability above 1 - 32 / 65536.
pub const MAX_TEXELS_PER_BYTE: usize = 12_000;

/// Continuations.
const NEIGHBOURS: usize = 4;

/// Classes of what a neighbour was: the first continuation, the second, anything else.
const KINDS: usize = 3;

/// Adaptive probabilities, and what the texels of two rows were.
struct Model {
    decisions: [[[Bit; KINDS * KINDS * KINDS]; NEIGHBOURS]; NEIGHBOURS],
    /// With a texel on either side.
    above: Vec<usize>,
    row: Vec<usize>,
}

/// The stream of a map whose sources are texels of a sample of this width and height.
pub fn encoded(map: &SourceMap, sample: [usize; 2]) -> Vec<u8> {
    let mut encoder = Encoder::default();
    let mut sources = Vec::with_capacity(map.sources.len());
    coded(&mut encoder, &mut sources, [map.width, map.height], sample, |texel| map.sources[texel]);
    encoder.finish()
}

/// The map of a stream; `None` if it is damaged, or of another size.
pub fn decoded(stream: &[u8], [width, height]: [usize; 2], sample: [usize; 2]) -> Option<SourceMap> {
    let mut sources = Vec::with_capacity(width * height);
    let is_whole = coded(&mut Decoder::new(stream), &mut sources, [width, height], sample, |_| Source::default());
    is_whole.then_some(SourceMap { width, height, sources })
}

/// Codes all sources into `sources`; `given` is ignored by a decoder. Returns whether the checksum is right.
fn coded(
    coder: &mut impl Coder,
    sources: &mut Vec<Source>,
    [width, height]: [usize; 2],
    sample: [usize; 2],
    given: impl Fn(usize) -> Source,
) -> bool {
    let mut model = Model {
        decisions: [[[Bit::EVEN; KINDS * KINDS * KINDS]; NEIGHBOURS]; NEIGHBOURS],
        above: vec![0; width + 2],
        row: vec![0; width + 2],
    };
    for y in 0..height {
        for x in 0..width {
            let given = given(y * width + x);
            let source = model.code(coder, &continuations(sources, [x, y], width, sample), x, given);
            sources.push(source.unwrap_or_else(|| in_full(coder, sample, given)));
        }
        std::mem::swap(&mut model.above, &mut model.row);
    }
    let mut checksum = crc32fast::Hasher::new();
    sources.iter().for_each(|source| checksum.update(&[source.x.to_le_bytes(), source.y.to_le_bytes()].concat()));
    let checksum = checksum.finalize();
    (0..u32::BITS).all(|i| coder.bit(1 << 15, checksum >> i & 1 != 0) == (checksum >> i & 1 != 0))
}

impl Model {
    /// Codes whether a source is one of the continuations, and which.
    fn code(&mut self, coder: &mut impl Coder, list: &[Option<Source>], x: usize, given: Source) -> Option<Source> {
        let first = list.iter().flatten().next();
        let agreeing = list.iter().flatten().skip(1).filter(|other| Some(*other) == first).count();
        let context = (self.row[x] * KINDS + self.above[x + 1]) * KINDS + self.above[x + 2];
        let mut place = 0;
        let mut found = None;
        for (k, source) in list.iter().enumerate() {
            let Some(source) = source.filter(|_| !list[..k].contains(source)) else { continue };
            let other = adaptive(coder, &mut self.decisions[agreeing][place][context], source != given);
            if !other {
                found = Some(source);
                break;
            }
            place += 1;
        }
        self.row[x + 1] = place.min(KINDS - 1);
        found
    }
}

/// The sources that continue those of the texels to the left, above, above right and above left.
fn continuations(
    sources: &[Source],
    [x, y]: [usize; 2],
    width: usize,
    [columns, rows]: [usize; 2],
) -> [Option<Source>; 4] {
    let texel = sources.len();
    let next = |there: bool, back: usize, right: usize, down: usize| {
        let source = sources[there.then(|| texel - back)?];
        let (x, y) = (usize::from(source.x) + right, usize::from(source.y) + down);
        Some(Source::new(x % columns, y % rows))
    };
    let (left, above) = (x > 0, y > 0);
    [
        next(left, 1, 1, 0),
        next(above, width, 0, 1),
        next(above && x + 1 < width, width - usize::from(width > 1), columns - 1, 1),
        next(above && left, width + 1, 1, 1),
    ]
}

/// Codes a source by itself.
fn in_full(coder: &mut impl Coder, [columns, rows]: [usize; 2], given: Source) -> Source {
    let mut number = |size: usize, given: u16| {
        let bits = usize::BITS - (size - 1).leading_zeros();
        (0..bits).rev().fold(0, |sum: u16, i| sum << 1 | u16::from(coder.bit(1 << 15, given >> i & 1 != 0)))
    };
    let x = number(columns, given.x);
    Source { x, y: number(rows, given.y) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn maps_come_back(
            (width, height, columns, rows) in (1usize..30, 1usize..30, 1usize..20, 1usize..20),
            numbers in proptest::collection::vec(any::<(u16, u16)>(), 900),
            shift in 0usize..8,
        ) {
            // runs of continued sources between others
            let source = |x: usize, y: usize| {
                let (a, b) = numbers[(y >> shift) * 30 + (x >> shift)];
                Source::new((usize::from(a) + x) % columns, (usize::from(b) + y) % rows)
            };
            let map = SourceMap::from_fn(width, height, source);
            let stream = encoded(&map, [columns, rows]);
            prop_assert_eq!(decoded(&stream, [width, height], [columns, rows]), Some(map));
            prop_assert!(width * height <= (stream.len() + 1) * MAX_TEXELS_PER_BYTE);
        }

        #[test]
        fn other_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..64)) {
            prop_assert_eq!(decoded(&bytes, [40, 30], [17, 23]), None);
        }
    }

    #[test]
    fn a_sample_repeated_costs_next_to_nothing() {
        let map = SourceMap::from_fn(1000, 800, |x, y| Source::new(x % 64, y % 48));
        // a decision that never changes costs .003 bits
        assert!(encoded(&map, [64, 48]).len() < 400);
    }
}
