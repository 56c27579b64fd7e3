//! Coding of quantised coefficients: planes of texels, and the core over the angles.

use super::cosine::{SIDE, blocks};
use crate::codec::entropy::{Coder, Numbers};

/// Integers on a grid; neighbours outside count as zero.
struct Grid<'a> {
    values: &'a [i32],
    width: usize,
}

impl Grid<'_> {
    fn size(&self, y: Option<usize>, x: Option<usize>) -> u32 {
        match (y, x) {
            (Some(y), Some(x)) if x < self.width => {
                self.values.get(y * self.width + x).map_or(0, |v| v.unsigned_abs().min(1 << 16))
            }
            _ => 0,
        }
    }
}

/// Codes a plane of [`super::cosine::Cosine`] coefficients in place, frequency by frequency over all blocks.
pub fn plane(coder: &mut impl Coder, values: &mut [i32], width: usize, height: usize) {
    let mut numbers = Numbers::default();
    for (v, u) in (0..SIDE.min(height)).flat_map(|v| (0..SIDE.min(width)).map(move |u| (v, u))) {
        let down = |by: usize, n: usize| (v >= n).then(|| by + v - n);
        let right = |bx: usize, n: usize| (u >= n).then(|| bx + u - n);
        for (by, _) in blocks(height).filter(|&(_, size)| v < size) {
            for (bx, _) in blocks(width).filter(|&(_, size)| u < size) {
                let grid = Grid { values, width };
                let (y, x) = (by + v, bx + u);
                let (above, before) = (y.checked_sub(SIDE), x.checked_sub(SIDE));
                // context: the same frequency in preceding blocks, then lower frequencies of this block
                let around = 2 * (grid.size(above, Some(x)) + grid.size(Some(y), before))
                    + grid.size(above, before)
                    + grid.size(above, Some(x + SIDE))
                    + 2 * (grid.size(down(by, 1), Some(x)) + grid.size(Some(y), right(bx, 1)))
                    + grid.size(down(by, 1), right(bx, 1))
                    + grid.size(down(by, 2), Some(x))
                    + grid.size(Some(y), right(bx, 2));
                values[y * width + x] = numbers.code(coder, values[y * width + x], around, v.max(u));
            }
        }
    }
}

/// Codes the core in place, shape (slice, channel, view, light).
pub fn core(coder: &mut impl Coder, values: &mut [i32], views: usize, lights: usize) {
    // the three channels have different statistics
    let mut numbers = [Numbers::default(), Numbers::default(), Numbers::default()];
    let pairs = views * lights;
    for begin in (0..values.len()).step_by(pairs) {
        let (done, rest) = values.split_at_mut(begin);
        let matrix = &mut rest[..pairs];
        let channel = begin / pairs % 3;
        // context: the same place in the preceding slice and channel
        let earlier = |back: usize| {
            let begin = done.len().checked_sub(back * pairs);
            Grid { values: begin.map_or(&[], |begin| &done[begin..][..pairs]), width: lights }
        };
        let slice = earlier(3);
        let other = if channel > 0 { earlier(1) } else { Grid { values: &[], width: lights } };
        for (y, x) in (0..views).flat_map(|y| (0..lights).map(move |x| (y, x))) {
            let grid = Grid { values: matrix, width: lights };
            let (up, left) = (|n| y.checked_sub(n), |n| x.checked_sub(n));
            let around = 2 * (grid.size(up(1), Some(x)) + grid.size(Some(y), left(1)))
                + grid.size(up(1), left(1))
                + grid.size(up(2), Some(x))
                + grid.size(Some(y), left(2))
                + 2 * slice.size(Some(y), Some(x))
                + other.size(Some(y), Some(x));
            matrix[y * lights + x] = numbers[channel].code(coder, matrix[y * lights + x], around, y + x);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::entropy::{Decoder, Encoder};

    fn some(count: usize) -> Vec<i32> {
        (0..count).map(|i| ((i * 7919 % 101) as i32 - 50) / 17 * i32::from(i % 5 == 0)).collect()
    }

    #[test]
    fn planes_come_back() {
        for (width, height) in [(1, 1), (70, 33), (32, 64), (3, 100)] {
            let mut values = some(width * height);
            let expected = values.clone();
            let mut encoder = Encoder::default();
            plane(&mut encoder, &mut values, width, height);
            assert_eq!(values, expected);
            let bytes = encoder.finish();
            let mut found = vec![0; width * height];
            plane(&mut Decoder::new(&bytes), &mut found, width, height);
            assert!(found == expected, "{width} {height}");
        }
    }

    #[test]
    fn cores_come_back() {
        for (slices, views, lights) in [(1, 1, 1), (3, 5, 7), (2, 1, 40)] {
            let mut values = some(slices * 3 * views * lights);
            let expected = values.clone();
            let mut encoder = Encoder::default();
            core(&mut encoder, &mut values, views, lights);
            let bytes = encoder.finish();
            let mut found = vec![0; values.len()];
            core(&mut Decoder::new(&bytes), &mut found, views, lights);
            assert!(found == expected, "{slices} {views} {lights}");
        }
    }
}
