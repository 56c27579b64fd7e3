//! Results laid out in overlapping blocks, each a window of the exemplar.

use super::matching::{Known, Windows, fitting};
use super::{Exemplar, Goal, Source, SourceMap};
use crate::progress::{Progress, Task};
use crate::random::hash;
use crate::{Error, Result};

/// The default side of blocks: a quarter of the exemplar's smaller side.
const SHARE: usize = 4;

crate::params! {
    /// The parameters that all methods with blocks have.
    pub(super) struct Layout {
        /// Side of the blocks; by default a quarter of the sample's smaller side, from 8 to 64.
        block: Option<usize> [2..=1024, "texels"],
        /// Fraction of a block that covers the next one.
        overlap: f64 [0.01..=0.5] = 0.1667,
    }
}

/// A block that is being placed.
pub(super) struct Block {
    /// The column and row of blocks.
    column: usize,
    row: usize,
    /// Random number of the block.
    pub random: u64,
    /// How many texels of its left, top, right and bottom side cover blocks placed before.
    pub overlap: [usize; 4],
}

/// A result that is filled block by block.
pub(super) struct Blocks<'a> {
    pub exemplar: &'a Exemplar,
    pub windows: Windows<'a>,
    pub goal: &'a Goal,
    /// The first texel of each column and row of blocks; beyond the edge of a tileable result, blocks continue at its other
    /// side.
    columns: Vec<usize>,
    rows: Vec<usize>,
    sources: Vec<Option<Source>>,
}

impl<'a> Blocks<'a> {
    /// No block is placed yet.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the mask leaves no block.
    pub fn new(exemplar: &'a Exemplar, goal: &'a Goal, layout: &Layout) -> Result<Self> {
        let Layout { block: side, overlap } = *layout;
        let usual = (exemplar.width.min(exemplar.height) / SHARE).clamp(8, 64);
        let block = |source: usize, size: usize| {
            let block = fitting(side.unwrap_or(usual), source);
            if goal.tileable { block.min(size) } else { block }
        };
        let (width, height) = (block(exemplar.width, goal.width), block(exemplar.height, goal.height));
        let windows = Windows::new(exemplar, width, height)?;
        let columns = places(goal.width, width, overlap, goal.tileable);
        let rows = places(goal.height, height, overlap, goal.tileable);
        Ok(Self { exemplar, windows, goal, columns, rows, sources: vec![None; goal.width * goal.height] })
    }

    /// Places all blocks, row by row. `choose` gives the window for a block, from the texels that are known there; `keeps`
    /// says which texels of the overlap stay.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn fill(
        mut self,
        choose: impl Fn(&Self, &Block, &[Known]) -> usize,
        keeps: impl Fn(&Self, &Block, usize) -> Vec<bool>,
        progress: &dyn Progress,
    ) -> Result<SourceMap> {
        let task = Task::new(progress, "synthesise", (self.columns.len() * self.rows.len()) as u64);
        for (row, column) in (0..self.rows.len()).flat_map(|row| (0..self.columns.len()).map(move |k| (row, k))) {
            let block = self.block(column, row);
            let window = choose(&self, &block, &self.known(&block));
            let keeps = keeps(&self, &block, window);
            for (place, keep) in keeps.into_iter().enumerate() {
                let (x, y) = (place % self.windows.width, place / self.windows.width);
                if let Some(texel) = self.texel(&block, x, y).filter(|_| !keep) {
                    self.sources[texel] = Some(self.windows.texel(window, x, y));
                }
            }
            let Goal { width, height, .. } = *self.goal;
            task.unfinished(width, height, &|x, y| self.sources[y * width + x].map(<[u16; 2]>::from));
            task.advance(1)?;
        }
        let sources = self.sources.into_iter().collect::<Option<Vec<_>>>();
        let sources = sources.ok_or_else(|| Error::parameter("overlap", "blocks leave gaps"))?;
        Ok(SourceMap { width: self.goal.width, height: self.goal.height, sources })
    }

    fn block(&self, column: usize, row: usize) -> Block {
        let before = |places: &[usize], at: usize, side: usize| match at {
            0 => 0,
            at => (places[at - 1] + side).saturating_sub(places[at]),
        };
        let after = |places: &[usize], at: usize, side: usize, size: usize| {
            let last = self.goal.tileable && at > 0 && at + 1 == places.len();
            if last { (places[at] + side).saturating_sub(size) } else { 0 }
        };
        let Windows { width, height, .. } = self.windows;
        let overlap = [
            before(&self.columns, column, width),
            before(&self.rows, row, height),
            after(&self.columns, column, width, self.goal.width),
            after(&self.rows, row, height, self.goal.height),
        ];
        Block { column, row, random: hash(&[self.goal.seed, column as u64, row as u64]), overlap }
    }

    /// The texel of the result at a place of a block; `None` outside.
    fn texel(&self, block: &Block, x: usize, y: usize) -> Option<usize> {
        let Goal { width, height, tileable, .. } = *self.goal;
        let inside = |at: usize, size: usize| if tileable { Some(at % size) } else { Some(at).filter(|at| *at < size) };
        Some(inside(self.rows[block.row] + y, height)? * width + inside(self.columns[block.column] + x, width)?)
    }

    /// What is known at a place of a block.
    pub fn source(&self, block: &Block, x: usize, y: usize) -> Option<Source> {
        self.texel(block, x, y).and_then(|texel| self.sources[texel])
    }

    fn known(&self, block: &Block) -> Vec<Known> {
        let places = (0..self.windows.height).flat_map(|y| (0..self.windows.width).map(move |x| (x, y)));
        let known = |(x, y)| Some(Known { x, y, source: self.source(block, x, y)?, weight: 1.0 });
        places.filter_map(known).collect()
    }
}

/// The first texel of each block along one axis of `size` texels.
fn places(size: usize, block: usize, overlap: f64, tileable: bool) -> Vec<usize> {
    let step =
        block - ((block as f64 * overlap).round() as usize).clamp(usize::from(block > 1), block - block.div_ceil(2));
    if !tileable {
        let count = 1 + size.saturating_sub(block).div_ceil(step);
        return (0..count).map(|k| k * step).collect();
    }
    // a block cannot continue itself
    let count = size.div_ceil(step).max(2).min(size);
    (0..count).map(|k| k * size / count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_cover_every_texel() {
        for (size, block) in (1..40).flat_map(|size| (1..12).map(move |block| (size, block))) {
            for overlap in [0.05, 0.25, 0.5] {
                let open = places(size, block, overlap, false);
                assert!(
                    open.iter().zip(&open[1..]).all(|(a, b)| b - a <= block) && open[open.len() - 1] + block >= size
                );
                let block = block.min(size);
                let closed = places(size, block, overlap, true);
                let next = closed[1..].iter().copied().chain([size]);
                assert!(closed.iter().zip(next).all(|(a, b)| b - a <= block), "{size} {block} {closed:?}");
            }
        }
    }
}
