//! Boundaries between copied regions, moved to where they are seen least.

use rayon::prelude::*;

use super::super::Source;
use super::canvas::place;
use super::known::Known;
use super::sample::Sample;

/// Passes over the result.
const PASSES: usize = 6;

/// Moves the boundaries: a texel on one takes part in the neighbouring region where that costs less.
///
/// # Model
/// Two neighbours p and q from regions A and B cost |A(p) - B(p)|^2 + |A(q) - B(q)|^2, nothing within a region. Texels are
/// visited like the squares of a chessboard, so that the neighbours of those that change do not.
///
/// # References
/// kwatra2003
pub(super) fn refine<const C: usize>(
    sample: &Sample<C>,
    known: &Known,
    sources: &mut [Source],
    width: usize,
    wraps: bool,
) {
    for pass in 0..2 * PASSES {
        let seen = sources.to_vec();
        let regions =
            Regions { sample, sources: &seen, width: width as i32, height: (seen.len() / width) as i32, wraps };
        sources.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let turn = |x: usize| (x + y + pass).is_multiple_of(2) && known.at(y * width + x).is_none();
            for (x, source) in row.iter_mut().enumerate().filter(|(x, _)| turn(*x)) {
                *source = regions.best(x as i32, y as i32);
            }
        });
    }
}

/// The result before a pass.
struct Regions<'a, const C: usize> {
    sample: &'a Sample<C>,
    sources: &'a [Source],
    width: i32,
    height: i32,
    wraps: bool,
}

/// The four neighbours.
const SIDES: [(i32, i32); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];

impl<const C: usize> Regions<'_, C> {
    fn neighbour(&self, x: i32, y: i32, (dx, dy): (i32, i32)) -> Option<Source> {
        let (nx, ny) = place(x + dx, y + dy, self.width, self.height, self.wraps);
        let inside = self.wraps || (nx, ny) == (x + dx, y + dy);
        inside.then(|| self.sources[(ny * self.width + nx) as usize])
    }

    fn best(&self, x: i32, y: i32) -> Source {
        let domain = self.sample.domain;
        let current = self.sources[(y * self.width + x) as usize];
        let mut best = (self.cost(current, x, y), current);
        for side in SIDES {
            if best.0 == 0.0 {
                break;
            }
            let Some(neighbour) = self.neighbour(x, y, side) else { continue };
            let Some(offer) = domain.shifted(neighbour, -side.0, -side.1, 0) else { continue };
            if offer == best.1 || !self.sample.open[domain.index(offer)] {
                continue;
            }
            let cost = self.cost(offer, x, y);
            if cost < best.0 {
                best = (cost, offer);
            }
        }
        best.1
    }

    /// What the boundaries around a texel cost if it copies this source.
    fn cost(&self, source: Source, x: i32, y: i32) -> f32 {
        let (domain, texels) = (self.sample.domain, &self.sample.texels);
        let difference = |a: Source, b: Source| -> f32 {
            let (a, b) = (&texels[domain.index(a)], &texels[domain.index(b)]);
            a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
        };
        let side = |side: (i32, i32)| {
            let Some(other) = self.neighbour(x, y, side) else { return 0.0 };
            let here = domain.clamped(other, -side.0, -side.1, 0);
            let there = domain.clamped(source, side.0, side.1, 0);
            if there == other { 0.0 } else { difference(source, here) + difference(there, other) }
        };
        SIDES.into_iter().map(side).sum()
    }
}
