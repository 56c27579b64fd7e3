//! The result at one scale.

use rayon::prelude::*;

use super::super::Source;
use super::level::{Level, RADIUS};

/// The result at one scale: texels `step` apart.
pub(super) struct Canvas<const C: usize> {
    pub width: usize,
    pub height: usize,
    pub wraps: bool,
    pub sources: Vec<Source>,
    /// The texels that the sources name, with a frame of [`RADIUS`].
    pub texels: Vec<[f32; C]>,
}

impl<const C: usize> Canvas<C> {
    pub(super) fn new(width: usize, height: usize, wraps: bool, sources: Vec<Source>) -> Self {
        let texels = vec![[0.0; C]; (width + 2 * RADIUS) * (height + 2 * RADIUS)];
        Self { width, height, wraps, sources, texels }
    }

    /// The result at a finer scale: each texel becomes `ratio` x `ratio` that continue its source.
    pub(super) fn refined(&self, level: &Level<C>, [w, h]: [usize; 2], ratio: usize) -> Self {
        let source = |i: usize| {
            let (x, y) = (i % w, i / w);
            let parent = self.sources[y / ratio * self.width + x / ratio];
            let (dx, dy) = (x % ratio * level.step, y % ratio * level.step);
            level.domain.clamped(parent, dx as i32, dy as i32, 0)
        };
        Self::new(w, h, self.wraps, (0..w * h).map(source).collect())
    }

    /// The texels whose whole neighbourhood is a copy of a usable one.
    pub(super) fn copies(&self, level: &Level<C>) -> Vec<bool> {
        let mut copies = self.coherent(&self.sources, level);
        for (copy, source) in copies.iter_mut().zip(&self.sources) {
            *copy &= level.usable[level.domain.index(*source)];
        }
        copies
    }

    /// Texels per row with the frame.
    #[inline(always)]
    pub(super) fn stride(&self) -> usize {
        self.width + 2 * RADIUS
    }

    /// Copies the texels that the sources name. In the frame the copied regions continue, or the result wraps.
    pub(super) fn fill(&mut self, level: &Level<C>) {
        let (w, h, step) = (self.width as i32, self.height as i32, level.step as i32);
        let (sources, wraps) = (&self.sources, self.wraps);
        let stride = self.stride();
        self.texels.par_chunks_mut(stride).enumerate().for_each(|(y, row)| {
            let y = y as i32 - RADIUS as i32;
            for (x, out) in (-(RADIUS as i32)..).zip(row) {
                let (cx, cy) = place(x, y, w, h, wraps);
                let source = sources[(cy * w + cx) as usize];
                let (dx, dy) = if wraps { (0, 0) } else { ((x - cx) * step, (y - cy) * step) };
                *out = level.texels[level.domain.index(level.domain.clamped(source, dx, dy, 0))];
            }
        });
    }

    /// For each texel whether the given sources in its neighbourhood continue its own.
    pub(super) fn coherent(&self, of: &[Source], level: &Level<C>) -> Vec<bool> {
        let (w, h, step) = (self.width as i32, self.height as i32, level.step as i32);
        let r = level.radius as i32;
        let continues = |x: i32, y: i32, dx: i32, dy: i32| {
            let (cx, cy) = place(x + dx, y + dy, w, h, self.wraps);
            if (cx, cy) != (x + dx, y + dy) && !self.wraps {
                return true;
            }
            let expected = level.domain.shifted(of[(y * w + x) as usize], dx * step, dy * step, 0);
            expected == Some(of[(cy * w + cx) as usize])
        };
        let rows: Vec<bool> =
            (0..w * h).into_par_iter().map(|i| (-r..=r).all(|d| d == 0 || continues(i % w, i / w, d, 0))).collect();
        let both = |i: i32| {
            (-r..=r).all(|d| {
                let (cx, cy) = place(i % w, i / w + d, w, h, self.wraps);
                rows[(cy * w + cx) as usize] && (d == 0 || continues(i % w, i / w, 0, d))
            })
        };
        (0..w * h).into_par_iter().map(both).collect()
    }
}

/// The texel at a place, which may lie beyond the edge: the one that wraps there, or the nearest one.
#[inline(always)]
pub(super) fn place(x: i32, y: i32, w: i32, h: i32, wraps: bool) -> (i32, i32) {
    if wraps { (x.rem_euclid(w), y.rem_euclid(h)) } else { (x.clamp(0, w - 1), y.clamp(0, h - 1)) }
}
