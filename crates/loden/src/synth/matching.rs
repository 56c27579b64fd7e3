//! Windows of an exemplar, compared with texels that are already known.

use rayon::prelude::*;

use super::{Exemplar, Source};
use crate::random::unit;
use crate::simd::wide;
use crate::{Error, Result};

/// Windows compared at a time; their sums stay in registers.
const LANES: usize = 32;

/// Every position of a window of one size in an exemplar.
pub(super) struct Windows<'a> {
    exemplar: &'a Exemplar,
    /// Texels per row of a window.
    pub width: usize,
    /// Rows of a window.
    pub height: usize,
    /// Positions along a row.
    columns: usize,
    /// Rows of positions.
    rows: usize,
    /// (channel, y, x): continued beyond the edges of a periodic exemplar, and padded
    planes: Vec<f32>,
    stride: usize,
    /// Windows without masked texels, shape (row, column).
    usable: Vec<bool>,
}

/// A texel that is known: its place in the window, what it is, and how much it counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub x: usize,
    pub y: usize,
    pub source: Source,
    pub weight: f32,
}

/// One channel of a known texel: where that of the first window is.
struct Term {
    place: usize,
    value: f32,
    weight: f32,
}

/// The size of a window along a side of the exemplar: as wanted if a quarter of the side is left for positions.
pub(super) fn fitting(wanted: usize, side: usize) -> usize {
    wanted.clamp(1, side - side / 4)
}

impl<'a> Windows<'a> {
    /// All windows of `width` x `height` texels, which the exemplar must have.
    ///
    /// # Errors
    /// [`Error::Parameter`] if every window has a masked texel.
    pub fn new(exemplar: &'a Exemplar, width: usize, height: usize) -> Result<Self> {
        let positions = |side: usize, window: usize| if exemplar.periodic { side } else { side + 1 - window };
        let (columns, rows) = (positions(exemplar.width, width), positions(exemplar.height, height));
        let (stride, lines) = (columns + width - 1, rows + height - 1);
        let mut planes = Vec::with_capacity(exemplar.channels * stride * lines + LANES);
        for channel in 0..exemplar.channels {
            let texel =
                |at: usize| exemplar.texel(at % stride % exemplar.width, at / stride % exemplar.height)[channel];
            planes.extend((0..stride * lines).map(texel));
        }
        planes.resize(planes.len() + LANES, 0.0);
        let usable = usable(exemplar, width, height, columns, rows);
        if !usable.contains(&true) {
            let problem = format!("leaves no window of {width} x {height} texels: choose a smaller one");
            return Err(Error::parameter("mask", problem));
        }
        Ok(Self { exemplar, width, height, columns, rows, planes, stride, usable })
    }

    /// The texel of the exemplar at a place of a window.
    pub fn texel(&self, window: usize, x: usize, y: usize) -> Source {
        let (left, top) = (window % self.columns, window / self.columns);
        Source::new((left + x) % self.exemplar.width, (top + y) % self.exemplar.height)
    }

    /// The weighted squared distance of every window to the known texels.
    pub fn distances(&self, known: &[Known]) -> Vec<f32> {
        let plane = self.stride * (self.rows + self.height - 1);
        let terms = known.iter().flat_map(|known| {
            let values = self.exemplar.texel(known.source.x.into(), known.source.y.into()).iter().enumerate();
            let first = known.y * self.stride + known.x;
            values.map(move |(channel, &value)| Term { place: channel * plane + first, value, weight: known.weight })
        });
        let terms: Vec<Term> = terms.collect();
        let mut distances = vec![0.0; self.columns * self.rows];
        let each = |(row, out): (usize, &mut [f32])| sums(&self.planes[row * self.stride..], &terms, out);
        distances.par_chunks_mut(self.columns).with_min_len(4).enumerate().for_each(each);
        distances
    }

    /// One of the usable windows with a distance of at most `limit(smallest)`, or the nearest if there is none; `random`
    /// chooses.
    pub fn choose(&self, distances: &[f32], limit: impl Fn(f32) -> f32, random: u64) -> usize {
        let candidates = || distances.iter().zip(&self.usable).enumerate().filter(|(_, (_, usable))| **usable);
        let smallest = candidates().fold(f32::INFINITY, |least, (_, (distance, _))| least.min(*distance));
        let limit = limit(smallest).max(smallest);
        let mut near = candidates().filter(|(_, (distance, _))| **distance <= limit).map(|(window, _)| window);
        let count = near.clone().count();
        near.nth((f64::from(unit(random)) * count as f64) as usize).unwrap_or(0)
    }

    /// Any usable window.
    pub fn any(&self, random: u64) -> usize {
        self.choose(&vec![0.0; self.usable.len()], |_| 0.0, random)
    }
}

/// Which windows have usable texels only.
fn usable(exemplar: &Exemplar, width: usize, height: usize, columns: usize, rows: usize) -> Vec<bool> {
    if exemplar.mask.is_none() {
        return vec![true; columns * rows];
    }
    let texel = |x: usize, y: usize| exemplar.is_usable(x % exemplar.width, y % exemplar.height);
    // usable texels to the right of each, then such runs below each other
    let mut below = vec![0; columns];
    let mut found = vec![false; columns * rows];
    for y in (0..rows + height - 1).rev() {
        let mut run = 0usize;
        for x in (0..columns + width - 1).rev() {
            run = if texel(x, y) { run + 1 } else { 0 };
            if x < columns {
                below[x] = if run >= width { below[x] + 1 } else { 0 };
                if y < rows {
                    found[y * columns + x] = below[x] >= height;
                }
            }
        }
    }
    found
}

wide! {
    /// The sums over all terms for the windows of a row.
    fn sums(planes: &[f32], terms: &[Term], out: &mut [f32]) {
        for (block, out) in out.chunks_mut(LANES).enumerate() {
            let mut sums = [0.0f32; LANES];
            for term in terms {
                let values = &planes[term.place + block * LANES..][..LANES];
                for (sum, value) in sums.iter_mut().zip(values) {
                    let difference = value - term.value;
                    *sum += term.weight * difference * difference;
                }
            }
            out.copy_from_slice(&sums[..out.len()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exemplar() -> Exemplar {
        let value = |i: usize| (i * i % 17) as f32;
        Exemplar::new(40, 7, 2, (0..2 * 40 * 7).map(value).collect())
    }

    #[test]
    fn distances_are_those_of_the_windows() {
        for periodic in [false, true] {
            let exemplar = Exemplar { periodic, ..exemplar() };
            let windows = Windows::new(&exemplar, 4, 3).unwrap();
            let known = [(0, 0, 5, 1, 1.0), (3, 2, 39, 6, 0.5), (1, 2, 0, 3, 0.25)];
            let known = known.map(|(x, y, a, b, weight)| Known { x, y, source: Source::new(a, b), weight });
            let found = windows.distances(&known);
            assert_eq!(found.len(), if periodic { 280 } else { 37 * 5 });
            for (window, found) in found.into_iter().enumerate() {
                let term = |k: &Known| k.weight * exemplar.distance(k.source, windows.texel(window, k.x, k.y));
                let expected: f32 = known.iter().map(term).sum();
                assert!((found - expected).abs() < 1e-3, "{periodic} {window}: {found} {expected}");
            }
        }
    }

    #[test]
    fn only_windows_without_masked_texels_are_chosen() {
        let mut exemplar = exemplar();
        exemplar.mask = Some((0..280).map(|texel| texel % 40 >= 30 && texel / 40 != 2).collect());
        let windows = Windows::new(&exemplar, 3, 2).unwrap();
        let mut seen = vec![];
        for random in 0..400 {
            let window = windows.any(crate::random::mix(random));
            let texels = (0..6).map(|i| windows.texel(window, i % 3, i / 3));
            assert!(texels.clone().all(|t| exemplar.is_usable(t.x.into(), t.y.into())));
            seen.push(window);
        }
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 8 * 4, "all of them are chosen");
        let error = Windows::new(&exemplar, 11, 1).err().unwrap().to_string();
        assert_eq!(error, "mask: leaves no window of 11 x 1 texels: choose a smaller one");
    }

    #[test]
    fn windows_leave_room() {
        assert_eq!([1, 2, 3, 4, 5, 40].map(|side| fitting(16, side)), [1, 2, 3, 3, 4, 16]);
    }
}
