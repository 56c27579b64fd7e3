//! Synthesis from coarse to fine: each texel copies the one whose neighbourhood, seen so far, is nearest in a tree.

mod neighbourhood;
mod search;

use super::{Exemplar, Goal, Source, SourceMap, Synthesis};
use crate::Result;
use crate::params::{Param, Params, Values};
use crate::progress::{Progress, Task};
use crate::random::{hash, unit};
use neighbourhood::{Image, Neighbourhood};
use search::{Exhaustive, Search, Tree};

crate::words! {
    /// How neighbourhoods are searched.
    enum Method {
        Tsvq = "tsvq",
        Exhaustive = "exhaustive",
    }
}

crate::params! {
    /// The parameters of the synthesis.
    struct Options {
        /// Levels of the pyramid; fewer for a small sample.
        levels: usize [1..=8] = 4,
        /// Side of the neighbourhood on each level; made odd.
        window: usize [3..=15, "texels"] = 5,
        /// How neighbourhoods are searched: in a tree of clusters, or all of them, which is slower.
        search: Method = "tsvq",
        /// Leaves of the tree that are searched for each texel; more are slower and nearer to an exhaustive search.
        leaves: usize [1..=1024] = 4,
    }
}

/// The smallest side of a level of the exemplar.
const SMALLEST: usize = 8;

/// # Model
/// Pyramids of the sample and of the result halve the resolution from level to level. From the coarsest level on, texels
/// are set row by row. The neighbourhood of a texel has those before it on its own level (above, and to the left) and all
/// around it on the next coarser level; its nearest neighbour among the neighbourhoods of the sample is copied. The
/// result begins as random texels and continues at its opposite edges; for a tileable result, texels near its edges are
/// set a second time, by neighbourhoods all around them. The neighbourhoods of the sample are split in two by 2-means,
/// again and again: tree-structured vector quantisation.
///
/// # Limits
/// The tree does not always find the nearest neighbourhood. Fine structure blurs into noise where the sample has few
/// similar neighbourhoods.
///
/// # References
/// wei2000
pub(super) struct WeiLevoy;

impl Synthesis for WeiLevoy {
    fn name(&self) -> &'static str {
        "wei-levoy"
    }

    fn doc(&self) -> &'static str {
        "Texel by texel from coarse to fine, searched in a tree: fast, for irregular samples."
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
        let options = Options::from_values(params)?;
        let pyramid = pyramid(exemplar, options.levels);
        let size = |level: usize, side: usize| side.div_ceil(1 << level);
        let rows = (0..pyramid.len()).map(|level| size(level, goal.height) as u64).sum();
        let task = Task::new(progress, "synthesise", rows);
        let mut coarser: Option<Image> = None;
        let mut map = SourceMap { width: 0, height: 0, sources: vec![] };
        for (level, sample) in pyramid.iter().enumerate().rev() {
            task.check()?;
            let pass = Pass::new(&options, sample, pyramid.get(level + 1), false);
            let (width, height) = (size(level, goal.width), size(level, goal.height));
            let random = |x: usize, y: usize| {
                let random = unit(hash(&[goal.seed, level as u64, x as u64, y as u64]));
                pass.candidates[(f64::from(random) * pass.candidates.len() as f64) as usize]
            };
            map = SourceMap::from_fn(width, height, random);
            let mut image = sample.rearranged(&map);
            for y in 0..height {
                (0..width).for_each(|x| pass.set((x, y), &mut map, &mut image, coarser.as_ref()));
                // coordinates are those of the sample at this level
                let own = |source: Source| [source.x, source.y].map(|at| at << level);
                task.unfinished(width, height, &|column, row| (row <= y).then(|| own(map.at(column, row))));
                task.advance(1)?;
            }
            if goal.tileable {
                // What was set first had random texels before it
                let pass = Pass::new(&options, sample, pyramid.get(level + 1), true);
                let near = |at: usize, side: usize| at.min(side - 1 - at) < options.window;
                let edges = (0..width * height).map(|texel| (texel % width, texel / width));
                for (x, y) in edges.filter(|&(x, y)| near(x, width) || near(y, height)) {
                    pass.set((x, y), &mut map, &mut image, coarser.as_ref());
                }
            }
            coarser = Some(image);
        }
        Ok(map)
    }
}

/// What sets the texels of a level.
struct Pass<'a> {
    sample: &'a Exemplar,
    around: Neighbourhood<'a>,
    candidates: Vec<Source>,
    search: Box<dyn Search>,
}

impl<'a> Pass<'a> {
    /// By neighbourhoods of the texels before one, or all around it.
    fn new(options: &Options, sample: &'a Exemplar, coarser: Option<&'a Exemplar>, all: bool) -> Self {
        let around = Neighbourhood::new(options.window / 2, sample, coarser, all);
        let candidates = around.candidates();
        let vectors = around.vectors(&candidates);
        let search: Box<dyn Search> = match options.search {
            Method::Tsvq => Box::new(Tree::new(vectors, around.dimensions(), options.leaves)),
            Method::Exhaustive => Box::new(Exhaustive::new(&vectors, around.dimensions())),
        };
        Self { sample, around, candidates, search }
    }

    /// Sets a texel of a map and of the image of its values.
    fn set(&self, (x, y): (usize, usize), map: &mut SourceMap, image: &mut Image, coarser: Option<&Image>) {
        let vector = self.around.gather(image, coarser, (x, y));
        let source = self.candidates[self.search.nearest(&vector)];
        map.sources[y * map.width + x] = source;
        image.texel_mut(x, y).copy_from_slice(self.sample.texel(source.x.into(), source.y.into()));
    }
}

/// The exemplar, and the means of 2 x 2 texels of the level before, from fine to coarse.
fn pyramid(exemplar: &Exemplar, levels: usize) -> Vec<Exemplar> {
    let mut pyramid = vec![exemplar.clone()];
    while let Some(fine) = pyramid.last().filter(|fine| fine.width.min(fine.height) >= 2 * SMALLEST) {
        if pyramid.len() == levels {
            break;
        }
        let (width, height) = (fine.width.div_ceil(2), fine.height.div_ceil(2));
        let texels = |texel: usize| {
            let (x, y) = (2 * (texel % width), 2 * (texel / width));
            let last = |at: usize, side: usize| (at + 1).min(side - 1);
            [(x, y), (last(x, fine.width), y), (x, last(y, fine.height)), (last(x, fine.width), last(y, fine.height))]
        };
        let mean = |texel: usize| {
            let texels = texels(texel).map(|(x, y)| fine.texel(x, y));
            (0..fine.channels).map(move |k| 0.25 * texels.iter().map(|texel| texel[k]).sum::<f32>())
        };
        let mut coarse = Exemplar::new(width, height, fine.channels, (0..width * height).flat_map(mean).collect());
        coarse.periodic = fine.periodic;
        let all = |texel: usize| texels(texel).iter().all(|&(x, y)| fine.is_usable(x, y));
        coarse.mask = fine.mask.as_ref().map(|_| (0..width * height).map(all).collect());
        if coarse.mask.as_ref().is_some_and(|mask| !mask.contains(&true)) {
            break;
        }
        pyramid.push(coarse);
    }
    pyramid
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    fn noise(width: usize, height: usize) -> Exemplar {
        let value = |i: usize| unit(crate::random::mix(i as u64));
        Exemplar::new(width, height, 1, (0..width * height).map(value).collect())
    }

    fn run(exemplar: &Exemplar, goal: &Goal, given: &[(&str, &str)]) -> SourceMap {
        let params = Values::new(WeiLevoy.params(), given.iter().copied()).unwrap();
        super::super::synthesize(&WeiLevoy, exemplar, goal, &params, &Silent).unwrap()
    }

    #[test]
    fn levels_are_means() {
        let exemplar = Exemplar::new(17, 16, 1, (0..17 * 16).map(|i| (i % 17) as f32).collect());
        let pyramid = pyramid(&exemplar, 8);
        assert_eq!(pyramid.iter().map(|level| (level.width, level.height)).collect::<Vec<_>>(), [(17, 16), (9, 8)]);
        assert_eq!(pyramid[1].texel(3, 2), [6.5]);
        assert_eq!(pyramid[1].texel(8, 0), [16.0]);
    }

    #[test]
    fn a_tree_that_searches_every_leaf_finds_what_an_exhaustive_search_finds() {
        let (exemplar, goal) = (noise(24, 20), Goal::new(20, 20));
        let all = run(&exemplar, &goal, &[("search", "exhaustive")]);
        assert_eq!(all, run(&exemplar, &goal, &[("leaves", "1024")]));
        assert_ne!(all, run(&exemplar, &goal, &[("leaves", "1")]));
    }

    #[test]
    fn stripes_go_on() {
        // stripes 4 texels wide: a texel is the one that is 4 rows above
        let exemplar = Exemplar::new(32, 32, 1, (0..32 * 32).map(|i| (i / 32 / 4 % 2) as f32).collect());
        let map = run(&exemplar, &Goal::new(64, 64), &[("window", "9"), ("levels", "3")]);
        let value = |x: usize, y: usize| exemplar.texel(map.at(x, y).x.into(), map.at(x, y).y.into())[0];
        let equal = (0..64 * 63).filter(|i| value(i % 63, i / 63) == value(i % 63 + 1, i / 63)).count();
        assert!(equal > 64 * 63 * 9 / 10, "{equal} of {} texels continue to the right", 64 * 63);
    }
}
