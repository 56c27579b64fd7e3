//! For each neighbourhood of the result a similar one of the exemplar.

use rayon::prelude::*;

use super::super::Source;
use super::canvas::{Canvas, place};
use super::known::Wanted;
use super::level::{FEATURES, Level, RADIUS, add_features};
use crate::random::{Stream, hash};
use crate::simd::wide;

/// Texels per side of a tile. Tiles see each other's matches of the round before, so their order does not matter.
const TILE: usize = 32;

/// The most similar neighbourhoods found so far.
pub(super) struct Matches {
    pub sources: Vec<Source>,
    /// Their distances.
    pub costs: Vec<f32>,
}

impl Matches {
    /// Takes over the sources of texels whose neighbourhood is a copy.
    pub(super) fn accept(&mut self, copies: &[bool], sources: &[Source]) {
        for (i, _) in copies.iter().enumerate().filter(|(_, copy)| **copy) {
            (self.sources[i], self.costs[i]) = (sources[i], 0.0);
        }
    }

    /// Mean distance of the neighbourhoods that are not copies.
    pub(super) fn mean_cost(&self, copies: &[bool]) -> f32 {
        let searched = copies.iter().zip(&self.costs).filter(|(copy, _)| !**copy).map(|(_, cost)| *cost);
        let (sum, count) = searched.fold((0.0f64, 0u64), |(sum, count), cost| (sum + f64::from(cost), count + 1));
        (sum / count.max(1) as f64) as f32
    }
}

/// What a round of search reads.
pub(super) struct Search<'a, const C: usize> {
    pub level: &'a Level<'a, C>,
    pub canvas: &'a Canvas<C>,
    /// Neighbourhoods that need no search: they are copies.
    pub copies: &'a [bool],
    /// What is added to the distance for each texel of the exemplar; infinite where it is not usable.
    pub penalties: &'a [f32],
    /// What a guide wants.
    pub wanted: Option<&'a Wanted<'a>>,
    /// Displacements at which the exemplar repeats itself.
    pub repeats: &'a [(i32, i32)],
    /// Whether to look anywhere, not only at repeats.
    pub anywhere: bool,
    pub seed: u64,
}

/// Part of the result.
struct Tile {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    sources: Vec<Source>,
    costs: Vec<f32>,
    features: Vec<[f32; FEATURES]>,
}

impl<const C: usize> Search<'_, C> {
    /// Improves all matches. `round` shifts the tiles.
    pub(super) fn improve(&self, matches: &mut Matches, round: usize) {
        let (w, h) = (self.canvas.width, self.canvas.height);
        let shift = round % 2 * (TILE / 2);
        let starts = |n: usize| {
            let first = if shift == 0 { None } else { Some(0) };
            first.into_iter().chain((shift..n).step_by(TILE)).collect::<Vec<usize>>()
        };
        let ends = |starts: &[usize], n: usize| starts.iter().skip(1).copied().chain([n]).collect::<Vec<_>>();
        let (xs, ys) = (starts(w), starts(h));
        let (x_ends, y_ends) = (ends(&xs, w), ends(&ys, h));
        let jobs: Vec<(usize, usize)> = (0..ys.len()).flat_map(|j| (0..xs.len()).map(move |i| (i, j))).collect();
        let tiles: Vec<Tile> = jobs
            .into_par_iter()
            .filter_map(|(i, j)| {
                let (width, height) = (x_ends[i] - xs[i], y_ends[j] - ys[j]);
                let mut tile = self.tile(matches, xs[i], ys[j], width, height)?;
                improve_tile(self, matches, &mut tile);
                tile.features = Vec::new();
                for (cost, source) in tile.costs.iter_mut().zip(&tile.sources) {
                    *cost = (*cost - self.penalties[self.level.domain.index(*source)]).max(0.0);
                }
                Some(tile)
            })
            .collect();
        for tile in tiles {
            for y in 0..tile.height {
                let to = (tile.y + y) * w + tile.x;
                let from = y * tile.width..(y + 1) * tile.width;
                matches.sources[to..to + tile.width].copy_from_slice(&tile.sources[from.clone()]);
                matches.costs[to..to + tile.width].copy_from_slice(&tile.costs[from]);
            }
        }
    }

    /// A tile with the matches so far; none if it has nothing to search for.
    fn tile(&self, matches: &Matches, x: usize, y: usize, width: usize, height: usize) -> Option<Tile> {
        let w = self.canvas.width;
        let rows = || (y..y + height).map(|row| row * w + x..row * w + x + width);
        if rows().all(|row| self.copies[row].iter().all(|copy| *copy)) {
            return None;
        }
        let sources = rows().flat_map(|row| matches.sources[row].iter().copied()).collect();
        let costs = vec![0.0; width * height];
        Some(Tile { x, y, width, height, sources, costs, features: vec![[0.0; FEATURES]; width * height] })
    }

    /// The features of a neighbourhood of the result.
    #[inline(always)]
    fn features(&self, x: usize, y: usize) -> [f32; FEATURES] {
        let (r, stride) = (self.level.radius, self.canvas.stride());
        let mut sums = [0.0; FEATURES];
        let n = 2 * r + 1;
        for row in 0..n {
            let from = (y + RADIUS - r + row) * stride + x + RADIUS - r;
            let numbers = self.canvas.texels[from..from + n].as_flattened();
            add_features(numbers, &self.level.basis[row * n * C..], &mut sums);
        }
        sums
    }

    #[inline(always)]
    fn cost(&self, features: &[f32; FEATURES], texel: usize, source: Source) -> f32 {
        let i = self.level.domain.index(source);
        let other = &self.level.features[i];
        let mut sums = [0.0; 8];
        for (a, b) in features.chunks_exact(8).zip(other.chunks_exact(8)) {
            for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                *sum += (a - b) * (a - b);
            }
        }
        let [a, b, c, d, e, f, g, h] = sums;
        let guided = self.wanted.map_or(0.0, |wanted| wanted.cost(texel, i));
        ((a + e) + (b + f)) + ((c + g) + (d + h)) + self.penalties[i] + guided
    }
}

wide! {
    /// Two passes over a tile, forwards and backwards.
    fn improve_tile<const C: usize>(search: &Search<'_, C>, matches: &Matches, tile: &mut Tile) {
        // Compute the features of the result, and what the matches so far are worth there
        for y in 0..tile.height {
            for x in 0..tile.width {
                let i = y * tile.width + x;
                if !search.copies[(tile.y + y) * search.canvas.width + tile.x + x] {
                    tile.features[i] = search.features(tile.x + x, tile.y + y);
                    let texel = (tile.y + y) * search.canvas.width + tile.x + x;
                    tile.costs[i] = search.cost(&tile.features[i], texel, tile.sources[i]);
                }
            }
        }
        for backwards in [false, true] {
            for k in 0..tile.width * tile.height {
                let i = if backwards { tile.width * tile.height - 1 - k } else { k };
                let (x, y) = (i % tile.width, i / tile.width);
                if !search.copies[(tile.y + y) * search.canvas.width + tile.x + x] {
                    improve_one(search, matches, tile, x, y, backwards);
                }
            }
        }
    }
}

/// Tries what continues the neighbours' matches, and random places.
#[inline(always)]
fn improve_one<const C: usize>(
    search: &Search<'_, C>,
    matches: &Matches,
    tile: &mut Tile,
    x: usize,
    y: usize,
    backwards: bool,
) {
    let level = search.level;
    let (domain, margin, step) = (level.domain, level.margin(), level.step as i32);
    let i = y * tile.width + x;
    let features = tile.features[i];
    let texel = (tile.y + y) * search.canvas.width + tile.x + x;
    let (mut best, mut cost) = (tile.sources[i], tile.costs[i]);
    let attempt = |candidate: Option<Source>, best: &mut Source, cost: &mut f32| {
        let Some(candidate) = candidate.filter(|candidate| candidate != best) else { return };
        let found = search.cost(&features, texel, candidate);
        if found < *cost {
            (*best, *cost) = (candidate, found);
        }
    };
    // Continue the matches of neighbours
    let side = if backwards { 1 } else { -1 };
    for (dx, dy) in [(side, 0), (0, side), (side, side), (-side, side)] {
        let Some(source) = neighbour(search, matches, tile, x as i32 + dx, y as i32 + dy) else { continue };
        attempt(domain.shifted(source, -dx * step, -dy * step, margin), &mut best, &mut cost);
    }
    // Try displacements at which the exemplar repeats itself, and random places nearer and nearer
    let mut random = Stream::new(hash(&[search.seed, texel as u64, u64::from(backwards)]));
    if !search.repeats.is_empty() {
        for _ in 0..3 {
            let (dx, dy) = search.repeats[random.below(search.repeats.len())];
            attempt(domain.shifted(best, dx, dy, margin), &mut best, &mut cost);
        }
    }
    if search.anywhere {
        let mut reach = domain.width.max(domain.height) as i32;
        while reach >= 1 {
            let (dx, dy) = (around(&mut random, reach), around(&mut random, reach));
            let (limit_x, limit_y) = (domain.width as i32, domain.height as i32);
            let candidate = domain.shifted(best, dx.clamp(-limit_x, limit_x), dy.clamp(-limit_y, limit_y), margin);
            attempt(candidate, &mut best, &mut cost);
            reach /= 2;
        }
    }
    (tile.sources[i], tile.costs[i]) = (best, cost);
}

/// The match of a texel of the tile, or of one beside it in the round before.
#[inline(always)]
fn neighbour<const C: usize>(search: &Search<'_, C>, matches: &Matches, tile: &Tile, x: i32, y: i32) -> Option<Source> {
    if x >= 0 && y >= 0 && x < tile.width as i32 && y < tile.height as i32 {
        return Some(tile.sources[y as usize * tile.width + x as usize]);
    }
    let (w, h) = (search.canvas.width as i32, search.canvas.height as i32);
    let (x, y) = (tile.x as i32 + x, tile.y as i32 + y);
    let (cx, cy) = place(x, y, w, h, search.canvas.wraps);
    let inside = search.canvas.wraps || (cx, cy) == (x, y);
    inside.then(|| matches.sources[(cy * w + cx) as usize])
}

/// A whole number in `-reach..=reach`.
#[inline(always)]
fn around(random: &mut Stream, reach: i32) -> i32 {
    random.below(2 * reach as usize + 1) as i32 - reach
}
