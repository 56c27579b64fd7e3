//! Sources for the points of a surface.

use rayon::prelude::*;

use super::super::Source;
use super::super::optimise::{FEATURES, Level, Sample, add_features};
use super::atlas::Atlas;
use super::points::{Neighbour, Points};
use crate::Result;
use crate::progress::Task;
use crate::random::{Stream, hash};
use glam::DVec2;

/// Radius of neighbourhoods, in steps.
const RADIUS: usize = 2;

/// Distances between the texels of neighbourhoods, and passes at each.
pub(super) const STEPS: [(usize, usize); 3] = [(4, 3), (2, 3), (1, 4)];

/// Similar neighbourhoods that are known for each of the sample.
const SIMILAR: usize = 4;

/// Candidates for a patch.
const CANDIDATES: usize = 300;

/// Compares channels of texels.
const C: usize = 8;

/// The sources so far.
pub(super) struct Filling<'a> {
    pub atlas: &'a Atlas,
    pub points: &'a Points,
    pub sample: &'a Sample<C>,
    pub seed: u64,
    pub sources: Vec<Source>,
}

impl Filling<'_> {
    /// Lays patches of the sample on the surface one by one, each the one of several that fits best to those before.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    pub(super) fn lay(&mut self, task: &Task) -> Result<()> {
        let domain = self.sample.domain;
        let reach = (domain.width.min(domain.height) as i32 / 5).clamp(1, 24);
        let count = self.points.points.len();
        let mut laid = vec![false; count];
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_key(|point| hash(&[self.seed, *point as u64]));
        // begin beside what is laid: a queue of points at the edges of patches, then any point
        let mut queue = std::collections::VecDeque::new();
        let mut rest = order.into_iter();
        loop {
            let next = queue.pop_front().or_else(|| rest.next());
            let Some(middle) = next else { break };
            if laid[middle] {
                continue;
            }
            task.check()?;
            let patch: Vec<([i32; 2], usize)> = offsets(reach + 2)
                .filter_map(|[x, y]| {
                    let found = self.points.at(self.atlas, middle, DVec2::new(f64::from(x), f64::from(y)))?;
                    Some(([x, y], found.point as usize))
                })
                .collect();
            let source = self.best_patch(middle, &patch, &laid);
            for ([x, y], point) in &patch {
                let inside = x * x + y * y <= reach * reach;
                if laid[*point] {
                    continue;
                }
                if inside {
                    self.sources[*point] = domain.clamped(source, *x, *y, 0);
                    laid[*point] = true;
                } else {
                    queue.push_back(*point);
                }
            }
            if !laid[middle] {
                (self.sources[middle], laid[middle]) = (source, true);
            }
        }
        Ok(())
    }

    /// The middle of the patch that fits best to the points that are laid.
    fn best_patch(&self, middle: usize, patch: &[([i32; 2], usize)], laid: &[bool]) -> Source {
        let (domain, texels) = (self.sample.domain, &self.sample.texels);
        let known: Vec<_> = patch.iter().filter(|(_, point)| laid[*point]).collect();
        let reach = patch.iter().map(|(at, _)| at[0].abs().max(at[1].abs())).max().unwrap_or(0);
        let mut random = Stream::new(hash(&[self.seed, middle as u64, 1]));
        let mut best = (f32::INFINITY, Source::default());
        for _ in 0..CANDIDATES {
            let along = |side: usize, random: &mut Stream| {
                let margin = if domain.periodic { 0 } else { (reach as usize).min((side - 1) / 2) };
                margin + random.below(side - 2 * margin)
            };
            let source = Source::new(along(domain.width, &mut random), along(domain.height, &mut random));
            let mut cost = 0.0;
            for ([x, y], point) in &known {
                let a = &texels[domain.index(domain.clamped(source, *x, *y, 0))];
                let b = &texels[domain.index(self.sources[*point])];
                cost += a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
                if cost >= best.0 {
                    break;
                }
            }
            if !self.sample.open[domain.index(source)] {
                continue;
            }
            if cost < best.0 {
                best = (cost, source);
            }
            if known.is_empty() {
                break;
            }
        }
        best.1
    }

    /// Replaces sources by those whose neighbourhoods are most similar to what is around each point.
    ///
    /// # Errors
    /// [`crate::Error::NonFinite`]; [`crate::Error::Cancelled`].
    pub(super) fn refine(&mut self, step: usize, passes: usize, task: &Task) -> Result<()> {
        let Some(level) = Level::new(self.sample, step, RADIUS)? else { return Ok(()) };
        let similar = Similar::new(&level);
        let around: Vec<Vec<Option<Neighbour>>> = (0..self.points.points.len())
            .into_par_iter()
            .map(|point| {
                let by = |[x, y]: [i32; 2]| DVec2::new(f64::from(x), f64::from(y)) * step as f64;
                let at = |offset| self.points.at(self.atlas, point, by(offset));
                offsets(RADIUS as i32).map(at).collect()
            })
            .collect();
        for _ in 0..passes {
            // Points of one class do not see each other change
            for class in 0..4 {
                let is_in = |point: &usize| {
                    let at = self.points.points[*point].at;
                    (at.x as usize % 2) + 2 * (at.y as usize % 2) == class
                };
                let members: Vec<usize> = (0..self.sources.len()).filter(is_in).collect();
                let found: Vec<Source> =
                    members.par_iter().map(|point| self.better(&level, &similar, *point, &around[*point])).collect();
                members.into_iter().zip(found).for_each(|(point, source)| self.sources[point] = source);
            }
            task.advance(1)?;
        }
        Ok(())
    }

    /// The source for a point by k-coherent search: what continues the sources around it, and what is similar to that.
    fn better(&self, level: &Level<C>, similar: &Similar, point: usize, around: &[Option<Neighbour>]) -> Source {
        let domain = level.domain;
        let own = self.sources[point];
        // The features of what is around the point; beyond the edge of the surface, its own source continues
        let mut features = [0.0; FEATURES];
        let places = offsets(RADIUS as i32).zip(around);
        for (k, ([x, y], neighbour)) in places.clone().enumerate() {
            let source = match neighbour {
                Some(neighbour) => self.sources[neighbour.point as usize],
                None => domain.clamped(own, x * level.step as i32, y * level.step as i32, 0),
            };
            let texel = &level.texels[domain.index(source)];
            add_features(texel, &level.basis[k * C..], &mut features);
        }
        let mut best = (f32::INFINITY, own);
        let mut attempt = |source: Source| {
            let index = domain.index(source);
            if level.usable[index] {
                let other = &level.features[index];
                let cost: f32 = features.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum();
                if cost < best.0 {
                    best = (cost, source);
                }
            }
        };
        attempt(own);
        let mut last = None;
        for (_, neighbour) in places {
            let Some(neighbour) = neighbour else { continue };
            let source = self.sources[neighbour.point as usize];
            let [x, y] = neighbour.back.map(i32::from);
            let Some(source) = domain.shifted(source, x, y, 0).filter(|source| last != Some(*source)) else { continue };
            last = Some(source);
            attempt(source);
            similar.of(domain.index(source)).iter().for_each(|other| attempt(*other));
        }
        best.1
    }
}

/// Offsets within a square, row by row.
fn offsets(reach: i32) -> impl Iterator<Item = [i32; 2]> + Clone {
    (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |x| [x, y]))
}

/// For each texel of the sample others with similar neighbourhoods.
struct Similar(Vec<[Source; SIMILAR]>);

impl Similar {
    /// The most similar among texels that are near in one of the first features.
    fn new(level: &Level<C>) -> Self {
        const KEYS: usize = 3;
        const REACH: usize = 40;
        let domain = level.domain;
        let usable: Vec<u32> = (0..level.usable.len() as u32).filter(|texel| level.usable[*texel as usize]).collect();
        let orders: Vec<Vec<u32>> = (0..KEYS)
            .map(|key| {
                let mut order = usable.clone();
                order.sort_by(|a, b| {
                    let of = |texel: &u32| level.features[*texel as usize][key];
                    of(a).total_cmp(&of(b)).then(a.cmp(b))
                });
                order
            })
            .collect();
        let mut places = vec![[0u32; KEYS]; level.usable.len()];
        for (key, order) in orders.iter().enumerate() {
            order.iter().enumerate().for_each(|(place, texel)| places[*texel as usize][key] = place as u32);
        }
        let source = |texel: u32| Source::new(texel as usize % domain.width, texel as usize / domain.width);
        let of = |texel: usize| {
            let mut best = [(f32::INFINITY, source(texel as u32)); SIMILAR];
            if !level.usable[texel] {
                return best.map(|(_, source)| source);
            }
            let own = source(texel as u32);
            for (order, place) in orders.iter().zip(places[texel]) {
                let place = place as usize;
                for other in &order[place.saturating_sub(REACH)..(place + REACH).min(order.len())] {
                    let found = source(*other);
                    let near = |a: u16, b: u16| usize::from(a.abs_diff(b)) < 3 * level.step;
                    if near(found.x, own.x) && near(found.y, own.y) || best.iter().any(|(_, known)| *known == found) {
                        continue;
                    }
                    let pairs = level.features[texel].iter().zip(&level.features[*other as usize]);
                    let cost: f32 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
                    if cost < best[SIMILAR - 1].0 {
                        best[SIMILAR - 1] = (cost, found);
                        best.sort_by(|a, b| a.0.total_cmp(&b.0));
                    }
                }
            }
            best.map(|(_, source)| source)
        };
        Self((0..level.usable.len()).into_par_iter().map(of).collect())
    }

    fn of(&self, texel: usize) -> &[Source; SIMILAR] {
        &self.0[texel]
    }
}
