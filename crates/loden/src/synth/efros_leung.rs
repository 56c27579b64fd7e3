//! Growth texel by texel: each copies the centre of a window of the sample that looks like what is around it.

use std::cmp::Reverse;

use super::matching::{Known, Windows, fitting};
use super::{Exemplar, Goal, Source, SourceMap, Synthesis};
use crate::Result;
use crate::params::{Param, Params, Values};
use crate::progress::{Progress, Task};
use crate::random::hash;

/// Side of the piece of the sample that growth begins with.
const SEED: usize = 3;

crate::params! {
    /// The parameters of the growth.
    struct Options {
        /// Side of the window, as large as the largest regular feature; made odd, and smaller for a small sample.
        window: usize [3..=65, "texels"] = 11,
        /// Windows are candidates up to this fraction above the smallest distance.
        tolerance: f64 [0.0..=10.0] = 0.1,
    }
}

/// # Model
/// From a piece in the middle, or from what is known, layer by layer, texels with the most known neighbours first. The distance d of a window to
/// the known neighbours of a texel is the squared difference weighted by a Gaussian of standard deviation window / 6.4.
/// One of the windows with d <= (1 + tolerance) d_min is drawn, and its centre is copied.
///
/// # Limits
/// Every texel is compared with the whole sample: minutes for results of 512 texels a side. Growth can go astray and then
/// repeat one place or produce noise.
///
/// # References
/// efros1999
pub(super) struct EfrosLeung;

impl Synthesis for EfrosLeung {
    fn name(&self) -> &'static str {
        "efros-leung"
    }

    fn doc(&self) -> &'static str {
        "Growth texel by texel, compared with the whole sample: slow, good for small irregular samples."
    }

    fn fills(&self) -> bool {
        true
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
        let Options { window, tolerance } = Options::from_values(params)?;
        let side = |side: usize| (fitting(window, side) - 1) / 2 * 2 + 1;
        let windows = Windows::new(exemplar, side(exemplar.width), side(exemplar.height))?;
        let sigma = windows.width.max(windows.height) as f32 / 6.4;
        let mut growth = Growth { windows, goal, sources: vec![None; goal.width * goal.height], sigma };
        let mut layer = growth.plant(exemplar)?;
        let task = Task::new(progress, "synthesise", (goal.width * goal.height - layer.len()) as u64);
        while !layer.is_empty() {
            layer = growth.beside(&layer);
            for &texel in &layer {
                growth.grow(texel, tolerance as f32);
                task.unfinished(goal.width, goal.height, &|x, y| {
                    growth.sources[y * goal.width + x].map(<[u16; 2]>::from)
                });
                task.advance(1)?;
            }
        }
        let sources = growth.sources.into_iter().map(Option::unwrap_or_default).collect();
        Ok(SourceMap { width: goal.width, height: goal.height, sources })
    }
}

/// A result that is partly known.
struct Growth<'a> {
    windows: Windows<'a>,
    goal: &'a Goal,
    sources: Vec<Option<Source>>,
    /// Standard deviation of the weights, in texels.
    sigma: f32,
}

impl Growth<'_> {
    /// Copies what is known, or else a piece of the exemplar into the middle, and returns the texels.
    fn plant(&mut self, exemplar: &Exemplar) -> Result<Vec<usize>> {
        let known = self.goal.known.iter().flatten().enumerate();
        let known: Vec<usize> = known.filter(|(_, source)| source.is_some()).map(|(texel, _)| texel).collect();
        if let (Some(sources), false) = (&self.goal.known, known.is_empty()) {
            self.sources.clone_from(sources);
            return Ok(known);
        }
        let pieces = Windows::new(exemplar, fitting(SEED, exemplar.width), fitting(SEED, exemplar.height))?;
        let piece = pieces.any(hash(&[self.goal.seed]));
        let (width, height) = (pieces.width.min(self.goal.width), pieces.height.min(self.goal.height));
        let (left, top) = ((self.goal.width - width) / 2, (self.goal.height - height) / 2);
        let place = |(x, y): (usize, usize)| {
            let texel = (top + y) * self.goal.width + left + x;
            self.sources[texel] = Some(pieces.texel(piece, x, y));
            texel
        };
        Ok((0..width * height).map(|i| (i % width, i / width)).map(place).collect())
    }

    /// The texel at a distance from another, around the edges of a tileable result.
    fn neighbour(&self, texel: usize, dx: isize, dy: isize) -> Option<usize> {
        let Goal { width, height, tileable, .. } = *self.goal;
        let along = |at: usize, step: isize, size: usize| {
            let place = at as isize + step;
            let inside = (0..size as isize).contains(&place);
            (inside || tileable).then(|| place.rem_euclid(size as isize) as usize)
        };
        Some(along(texel / width, dy, height)? * width + along(texel % width, dx, width)?)
    }

    /// The known texels of the window around a texel.
    fn known(&self, texel: usize) -> Vec<Known> {
        let (width, height) = (self.windows.width, self.windows.height);
        let mut known = Vec::with_capacity(width * height);
        for (x, y) in (0..width * height).map(|i| (i % width, i / width)) {
            let (dx, dy) = (x as isize - width as isize / 2, y as isize - height as isize / 2);
            if let Some(source) = self.neighbour(texel, dx, dy).and_then(|at| self.sources[at]) {
                let weight = (-((dx * dx + dy * dy) as f32) / (2.0 * self.sigma * self.sigma)).exp();
                known.push(Known { x, y, source, weight });
            }
        }
        known
    }

    /// The unknown texels beside those of a layer, the ones with the most known neighbours first.
    fn beside(&self, layer: &[usize]) -> Vec<usize> {
        let around = |&texel: &usize| (0..9).filter_map(move |i| self.neighbour(texel, i % 3 - 1, i / 3 - 1));
        let mut beside: Vec<usize> = layer.iter().flat_map(around).filter(|at| self.sources[*at].is_none()).collect();
        beside.sort_unstable();
        beside.dedup();
        let order = |texel: usize| (Reverse(self.known(texel).len()), hash(&[self.goal.seed, 1, texel as u64]));
        beside.sort_by_cached_key(|&texel| order(texel));
        beside
    }

    fn grow(&mut self, texel: usize, tolerance: f32) {
        let distances = self.windows.distances(&self.known(texel));
        let random = hash(&[self.goal.seed, 2, texel as u64]);
        let window = self.windows.choose(&distances, |smallest| (1.0 + tolerance) * smallest, random);
        self.sources[texel] = Some(self.windows.texel(window, self.windows.width / 2, self.windows.height / 2));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    /// A hole in stripes is filled with the stripes, and nothing else changes.
    #[test]
    fn holes_are_filled() {
        let (width, height) = (24, 20);
        let mut exemplar = Exemplar::new(width, height, 1, (0..480).map(|i| (i / 24 / 2 % 2) as f32).collect());
        let hole = |texel: usize| (6..12).contains(&(texel % 24)) && (7..13).contains(&(texel / 24));
        exemplar.mask = Some((0..480).map(|texel| !hole(texel)).collect());
        let known = (0..480).map(|texel| (!hole(texel)).then(|| Source::new(texel % 24, texel / 24))).collect();
        let goal = Goal { known: Some(known), ..Goal::new(width, height) };
        let params = Values::new(EfrosLeung.params(), [("window", "5")]).unwrap();
        let map = super::super::synthesize(&EfrosLeung, &exemplar, &goal, &params, &Silent).unwrap();
        for (texel, source) in map.sources.iter().enumerate() {
            let (x, y) = (usize::from(source.x), usize::from(source.y));
            assert!(exemplar.is_usable(x, y), "{texel}");
            assert!(hole(texel) || source.texel(24) == texel, "{texel}");
            assert_eq!(exemplar.texel(x, y), exemplar.texel(texel % 24, texel / 24), "{texel}");
        }
        let tiling = super::super::by_name("tiling").unwrap_or(&EfrosLeung);
        let error = super::super::synthesize(tiling, &exemplar, &goal, &Values::defaults(&[]), &Silent).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("method: tiling cannot fill what is not known, expected optimise or efros-leung")
        );
    }
}
