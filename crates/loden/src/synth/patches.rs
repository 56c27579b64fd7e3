//! Patches: like quilting, but any patch that fits well enough is drawn, and edges are feathered instead of cut.

use super::blocks::{Block, Blocks, Layout};
use super::matching::Known;
use super::{Exemplar, Goal, SourceMap, Synthesis};
use crate::Result;
use crate::params::{Param, Params, Values};
use crate::progress::Progress;
use crate::random::{hash, unit};

crate::words! {
    /// What becomes of the overlap.
    enum Feather {
        Halve = "halve",
        Dissolve = "dissolve",
    }
}

crate::params! {
    /// The parameters of patches.
    struct Options {
        /// In the overlap, texels copy the nearer patch, or one of the two by chance, whose probability rises across the overlap.
        feather: Feather = "halve",
        layout: Layout,
        /// Root mean square difference in the overlap up to which patches are drawn, relative to the standard deviation of the sample.
        tolerance: f64 [0.0..=10.0] = 0.2,
    }
}

/// # Model
/// Row by row, one of the patches is drawn whose difference in the overlap is at most the tolerance, or the nearest if
/// there is none. The original blends the overlap with weights that rise linearly across it. A map of sources cannot
/// average two texels: here a texel copies the patch with the larger weight, or the weights are probabilities, so that the
/// mean over a neighbourhood is the blend.
///
/// # Limits
/// Patches that fit badly show as a line, or as a band of mixed texels, where the original shows a blurred one.
///
/// # References
/// liang2001 (section 3)
pub(super) struct Patches;

impl Synthesis for Patches {
    fn name(&self) -> &'static str {
        "patches"
    }

    fn doc(&self) -> &'static str {
        "Overlapping patches, any that fits well enough, with feathered edges."
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
        let Options { feather, layout, tolerance } = Options::from_values(params)?;
        let blocks = Blocks::new(exemplar, goal, &layout)?;
        let limit = tolerance.powi(2) * exemplar.variance();
        blocks.fill(
            |blocks, block, known: &[Known]| {
                let limit = (limit * known.len() as f64) as f32;
                blocks.windows.choose(&blocks.windows.distances(known), |_| limit, block.random)
            },
            |blocks, block, _| kept(blocks, block, feather),
            progress,
        )
    }
}

/// The texels of a block that keep what is known there.
fn kept(blocks: &Blocks, block: &Block, feather: Feather) -> Vec<bool> {
    let (width, height) = (blocks.windows.width, blocks.windows.height);
    let kept = |(x, y): (usize, usize)| {
        let ends = [x, y, width - 1 - x, height - 1 - y];
        let rise = |(end, depth): (usize, &usize)| if end < *depth { (end as f32 + 0.5) / *depth as f32 } else { 1.0 };
        let weight = ends.into_iter().zip(&block.overlap).map(rise).product::<f32>();
        weight
            <= match feather {
                Feather::Dissolve => unit(hash(&[block.random, x as u64, y as u64])),
                Feather::Halve => 0.5,
            }
    };
    (0..width * height).map(|place| kept((place % width, place / width))).collect()
}
