//! Texture optimisation: every neighbourhood of the result looks like one of the sample.
//!
//! The method to choose if nothing speaks for another one: it holds weaves, bricks and tiles as well as grain and gravel.
//!
//! # Model
//! From coarse to fine, two steps alternate. The search finds for every neighbourhood of the result a similar one of the
//! exemplar: it continues what neighbours found and tries random places. Neighbourhoods are compared by their leading
//! principal components, so many channels cost little more than three. In the vote, all neighbourhoods around a texel
//! offer it the texel that they would copy there, and it copies the one nearest to the mean of all offers; nothing is ever
//! averaged. A penalty on regions that are used often keeps the result from repeating one of them. At every scale,
//! coordinates are those of the finest one. A regular exemplar has a lattice, found by autocorrelation; the first result
//! consists of blocks that are displaced by points of the lattice. At the end, boundaries between copied regions move to
//! where they are seen least. What is known stays, and only neighbourhoods with something unknown are searched for.
//!
//! # Limits
//! Structure larger than half of the exemplar is not reproduced. The lattice of a result that is tileable breaks at the
//! edges unless its size is a multiple of the lattice. About 40 bytes of memory per texel of the result, 60 from five
//! channels on, up to 2^23 texels; larger results are made in bands, each of which goes on with the one before, and cannot be
//! tileable.
//!
//! # References
//! kwatra2005, barnes2009, kaspar2015, han2006, kwatra2003

mod bands;
mod canvas;
mod domain;
mod known;
mod lattice;
mod layout;
mod level;
mod sample;
mod seam;
mod search;
mod usage;
mod vote;

use super::{Exemplar, Goal, Source, SourceMap, Synthesis};
use crate::params::{Param, Params, Values};
use crate::progress::{Progress, Task};
use crate::{Error, Result, random};
use canvas::Canvas;
use known::{Known, Wanted};
use lattice::Lattice;
use level::RADIUS;
pub(super) use level::{FEATURES, Level, add_features};
pub(super) use sample::Sample;
use search::{Matches, Search};
use usage::Usage;

crate::params! {
    /// Parameters of texture optimisation.
    struct Table {
        /// Penalty on regions of the sample that are used often, relative to the mean distance of neighbourhoods; too
        /// much gives up similarity.
        variety: f64 [0.0..=4.0] = 1.5,
        /// Rounds of search and vote at each scale; twice as many at coarse ones.
        rounds: usize [1..=100] = 5,
    }
}

/// Texture optimisation with copied texels.
pub(super) struct Optimise;

impl Synthesis for Optimise {
    fn name(&self) -> &'static str {
        "optimise"
    }

    fn doc(&self) -> &'static str {
        "Texture optimisation: makes every neighbourhood of the result look like one of the sample, from coarse to fine."
    }

    fn params(&self) -> &'static [Param] {
        Table::TABLE
    }

    fn fills(&self) -> bool {
        true
    }

    fn guides(&self) -> bool {
        true
    }

    fn synthesize(
        &self,
        exemplar: &Exemplar,
        goal: &Goal,
        params: &Values,
        progress: &dyn Progress,
    ) -> Result<SourceMap> {
        let table = Table::from_values(params)?;
        let sources = if exemplar.channels <= 4 {
            bands::run(&Sample::<4>::new(exemplar)?, goal, &table, progress)?
        } else {
            bands::run(&Sample::<8>::new(exemplar)?, goal, &table, progress)?
        };
        Ok(SourceMap { width: goal.width, height: goal.height, sources })
    }
}

/// The rounds of all scales.
fn rounds<const C: usize>(sample: &Sample<C>, goal: &Goal, table: &Table) -> u64 {
    steps(sample, goal).iter().map(|step| table.rounds_at(*step) as u64).sum()
}

/// All scales, the coarsest first.
fn optimise<const C: usize>(sample: &Sample<C>, goal: &Goal, table: &Table, task: &Task) -> Result<Vec<Source>> {
    let domain = sample.domain;
    let lattice = Lattice::of(sample);
    let repeats = lattice.map_or_else(Vec::new, |lattice| {
        let (x, y) = (domain.width as i32 * 3 / 4, domain.height as i32 * 3 / 4);
        lattice.within([-x, -y], [x, y])
    });
    let mut canvas: Option<Canvas<C>> = None;
    let mut coarser = 1;
    for step in steps(sample, goal) {
        let Some(level) = finest_radius(sample, step)? else { continue };
        let (w, h) = (goal.width.div_ceil(step), goal.height.div_ceil(step));
        let (known, wanted) = (Known::new(goal, step), Wanted::new(goal, step));
        let next = match canvas {
            None => layout::lay_out(&level, (&known, wanted.as_ref()), [w, h], goal, lattice.as_ref(), task)?,
            Some(coarse) => coarse.refined(&level, [w, h], coarser / step),
        };
        let optimiser = Optimiser {
            level: &level,
            known: &known,
            wanted: wanted.as_ref(),
            repeats: &repeats,
            table,
            seed: goal.seed,
            task,
        };
        canvas = Some(optimiser.improved(next)?);
        coarser = step;
    }
    let mut canvas = canvas.ok_or_else(|| Error::parameter("mask", "leaves no texel of the exemplar"))?;
    seam::refine(sample, &Known::new(goal, 1), &mut canvas.sources, goal.width, goal.tileable);
    Ok(canvas.sources)
}

impl Table {
    fn rounds_at(&self, step: usize) -> usize {
        if step >= 4 { 2 * self.rounds } else { self.rounds }
    }
}

/// Distances between neighbours at each scale. At the coarsest, neighbourhoods span at most half of the exemplar.
fn steps<const C: usize>(sample: &Sample<C>, goal: &Goal) -> Vec<usize> {
    let smaller = sample.domain.width.min(sample.domain.height);
    let fits = |step: &usize| step * (2 * RADIUS + 1) * 2 <= smaller && *step < goal.width.max(goal.height);
    let coarse = std::iter::successors(Some(2), |step| Some(step * 2)).take_while(fits);
    let mut steps: Vec<usize> = std::iter::once(1).chain(coarse).collect();
    steps.reverse();
    steps
}

/// The exemplar at one scale. At the finest scale, neighbourhoods are made smaller until some are usable.
fn finest_radius<const C: usize>(sample: &Sample<C>, step: usize) -> Result<Option<Level<'_, C>>> {
    for radius in (0..=RADIUS).rev() {
        if let Some(level) = Level::new(sample, step, radius)? {
            return Ok(Some(level));
        }
        if step > 1 {
            break;
        }
    }
    Ok(None)
}

/// The work at one scale.
struct Optimiser<'a, const C: usize> {
    level: &'a Level<'a, C>,
    known: &'a Known,
    wanted: Option<&'a Wanted<'a>>,
    /// Displacements at which the exemplar repeats itself.
    repeats: &'a [(i32, i32)],
    table: &'a Table,
    seed: u64,
    task: &'a Task<'a>,
}

impl<const C: usize> Optimiser<'_, C> {
    /// Search and vote, several times.
    fn improved(&self, mut canvas: Canvas<C>) -> Result<Canvas<C>> {
        let level = self.level;
        self.known.restore(&mut canvas.sources);
        canvas.fill(level);
        let settled = self.known.settled(&canvas, level.radius);
        let sources = canvas.sources.iter().map(|source| level.domain.clamped(*source, 0, 0, level.margin())).collect();
        let mut matches = Matches { sources, costs: vec![0.0; canvas.sources.len()] };
        let mut usage = Usage::new(level.texels.len());
        let mut typical = 0.0;
        for round in 0..self.table.rounds_at(level.step) {
            usage.add(level, &canvas.sources, if round == 0 { 1.0 } else { 0.5 });
            let penalties = usage.penalties(level, self.table.variety as f32 * typical);
            // with a guide, a copy is not yet what is wanted
            let mut copies = match self.wanted {
                None => canvas.copies(level),
                Some(_) => vec![false; canvas.sources.len()],
            };
            copies.iter_mut().zip(&settled).for_each(|(copy, settled)| *copy |= settled);
            matches.accept(&copies, &canvas.sources);
            let search = Search {
                level,
                canvas: &canvas,
                copies: &copies,
                penalties: &penalties,
                wanted: self.wanted,
                repeats: self.repeats,
                // a lattice finer than the scale is not seen there, and a search would leave it
                anywhere: self.repeats.is_empty() || level.contrast > 0.5,
                seed: random::hash(&[self.seed, level.step as u64, round as u64]),
            };
            search.improve(&mut matches, round);
            typical = matches.mean_cost(&copies);
            canvas.sources = vote::vote(level, &canvas, &matches, typical);
            self.known.restore(&mut canvas.sources);
            canvas.fill(level);
            let (width, sources) = (canvas.width, &canvas.sources);
            self.task.unfinished(width, canvas.height, &|x, y| Some(sources[y * width + x].into()));
            self.task.advance(1)?;
        }
        Ok(canvas)
    }
}

#[cfg(test)]
mod tests;
