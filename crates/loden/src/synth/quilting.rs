//! Quilting: blocks of the sample that overlap, joined along the path where they differ least.

use super::blocks::{Block, Blocks, Layout};
use super::{Exemplar, Goal, SourceMap, Synthesis};
use crate::Result;
use crate::params::{Param, Params, Values};
use crate::progress::Progress;

crate::words! {
    /// How blocks are chosen and joined.
    enum Strategy {
        Random = "random",
        Neighbour = "neighbour",
        Cut = "cut",
    }
}

crate::params! {
    /// The parameters of quilting.
    struct Options {
        /// Blocks drawn at random, chosen to match their neighbours, or also cut along the path of least difference.
        strategy: Strategy = "cut",
        layout: Layout,
        /// Blocks are candidates up to this fraction above the smallest distance.
        tolerance: f64 [0.0..=10.0] = 0.1,
    }
}

/// # Model
/// Row by row, one of the blocks is drawn whose squared difference in the overlap is at most 1 + tolerance times the
/// smallest. Between overlapping blocks, the path of least squared difference e across the overlap is found by dynamic
/// programming: E(i, j) = e(i, j) + min(E(i-1, j-1), E(i-1, j), E(i-1, j+1)), for vertical and horizontal edges alike.
///
/// # Limits
/// Blocks of one size: features that are larger break, and whole blocks are seen again.
///
/// # References
/// efros2001
pub(super) struct Quilting;

impl Synthesis for Quilting {
    fn name(&self) -> &'static str {
        "quilting"
    }

    fn doc(&self) -> &'static str {
        "Overlapping blocks that match their neighbours, cut along the path where they differ least."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn synthesize(
        &self,
        exemplar: &Exemplar,
        goal: &Goal,
        params: &Values,
        progress: &dyn Progress,
    ) -> Result<SourceMap> {
        let Options { strategy, layout, tolerance } = Options::from_values(params)?;
        let blocks = Blocks::new(exemplar, goal, &layout)?;
        let factor = 1.0 + tolerance as f32;
        blocks.fill(
            |blocks, block, known| match strategy {
                Strategy::Random => blocks.windows.any(block.random),
                _ => blocks.windows.choose(&blocks.windows.distances(known), |least| factor * least, block.random),
            },
            |blocks, block, window| match strategy {
                Strategy::Cut => kept(blocks, block, window),
                _ => vec![false; blocks.windows.width * blocks.windows.height],
            },
            progress,
        )
    }
}

/// The texels of a block that keep what is known there: those beyond the paths along its four sides.
fn kept(blocks: &Blocks, block: &Block, window: usize) -> Vec<bool> {
    let (width, height) = (blocks.windows.width, blocks.windows.height);
    let error = |x: usize, y: usize| {
        let known = blocks.source(block, x, y);
        known.map_or(0.0, |known| blocks.exemplar.distance(known, blocks.windows.texel(window, x, y)))
    };
    let mut kept = vec![false; width * height];
    for (side, &depth) in block.overlap.iter().enumerate().filter(|(_, depth)| **depth > 0) {
        // A place of the overlap from its distance to the outer edge and the distance along it
        let place = |across: usize, along: usize| match side {
            0 => (across, along),
            1 => (along, across),
            2 => (width - 1 - across, along),
            _ => (along, height - 1 - across),
        };
        let length = if side % 2 == 0 { height } else { width };
        let errors = |across, along| {
            let (x, y) = place(across, along);
            error(x, y)
        };
        for (along, cut) in least_path(depth, length, errors).into_iter().enumerate() {
            for (x, y) in (0..cut).map(|across| place(across, along)) {
                kept[y * width + x] = true;
            }
        }
    }
    kept
}

/// The path along a strip of `depth` x `length` places that has the least sum of `error(across, along)`: the place across, for
/// each place along.
fn least_path(depth: usize, length: usize, error: impl Fn(usize, usize) -> f32) -> Vec<usize> {
    // Sum the errors of the best path to every place
    let mut sums: Vec<Vec<f32>> = Vec::with_capacity(length);
    let best = |sums: &[f32], across: usize| {
        let near = across.saturating_sub(1)..(across + 2).min(depth);
        near.fold(across, |best, k| if sums[k] < sums[best] { k } else { best })
    };
    for along in 0..length {
        let sum = |across: usize| {
            let before = sums.last().map_or(0.0, |sums| sums[best(sums, across)]);
            before + error(across, along)
        };
        sums.push((0..depth).map(sum).collect());
    }
    // Go back from the best end
    let Some(last) = sums.last() else { return Vec::new() };
    let mut across = (0..depth).fold(0, |best, k| if last[k] < last[best] { k } else { best });
    let mut path = vec![across; length];
    for along in (0..length - 1).rev() {
        across = best(&sums[along], across);
        path[along] = across;
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_path_has_the_least_error_of_all() {
        for seed in 0..50u64 {
            let (depth, length) = (4, 5);
            let error =
                |x: usize, y: usize| crate::random::unit(crate::random::hash(&[seed, x as u64, y as u64])) + 0.01;
            let sum = |path: &[usize]| path.iter().enumerate().map(|(y, &x)| error(x, y)).sum::<f32>();
            let path = least_path(depth, length, error);
            // every path, as a number in base 4
            let all = (0..4usize.pow(5)).map(|n| (0..5).map(|k| n / 4usize.pow(k) % 4).collect::<Vec<_>>());
            let connected = all.filter(|path| path.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= 1));
            let least = connected.map(|path| sum(&path)).fold(f32::INFINITY, f32::min);
            assert!(path.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= 1), "{path:?}");
            assert!((sum(&path) - least).abs() < 1e-5, "{path:?}: {} {least}", sum(&path));
        }
    }
}
