//! The first result, at the coarsest scale: blocks of the exemplar that fit to those placed before.

use super::super::{Goal, Source};
use super::canvas::{Canvas, place};
use super::known::{Known, Wanted};
use super::lattice::Lattice;
use super::level::Level;
use crate::Result;
use crate::progress::Task;
use crate::random::{Stream, hash};

/// Random candidates for each block.
const CANDIDATES: usize = 400;

/// Width of the border of a block that is compared with blocks placed before.
const BORDER: i32 = 3;

/// What it costs to use a place once more, as a squared distance of texels.
const REPETITION: f32 = 0.1;

/// Blocks placed so far.
struct Layout<'a, const C: usize> {
    level: &'a Level<'a, C>,
    width: i32,
    height: i32,
    wraps: bool,
    /// Texels per side of a block.
    side: i32,
    placed: Vec<Option<Source>>,
    /// How often each texel of the exemplar has been the centre of a block or near it.
    used: Vec<f32>,
}

/// Covers the result with blocks, row by row. Blocks of a regular exemplar stay on its lattice.
///
/// # Errors
/// [`crate::Error::Cancelled`].
pub(super) fn lay_out<const C: usize>(
    level: &Level<C>,
    (known, wanted): (&Known, Option<&Wanted>),
    [width, height]: [usize; 2],
    goal: &Goal,
    lattice: Option<&Lattice>,
    task: &Task,
) -> Result<Canvas<C>> {
    let (w, h, step) = (level.domain.width as i32, level.domain.height as i32, level.step as i32);
    let mut layout = Layout {
        level,
        width: width as i32,
        height: height as i32,
        wraps: goal.tileable,
        side: (w.min(h) / (4 * step)).max(2),
        placed: (0..width * height).map(|texel| known.at(texel)).collect(),
        used: vec![0.0; level.texels.len()],
    };
    for y in (0..layout.height).step_by(layout.side as usize) {
        task.check()?;
        for x in (0..layout.width).step_by(layout.side as usize) {
            if layout.is_known(known, x, y) {
                continue;
            }
            let mut random = Stream::new(hash(&[goal.seed, x as u64, y as u64]));
            let mut best = (f32::INFINITY, [-x * step, -y * step]);
            let mut attempt = |offset: [i32; 2]| {
                let cost = layout.misfit(wanted, [x, y], offset);
                if cost < best.0 {
                    best = (cost, offset);
                }
                best.0.is_finite()
            };
            let origin = [-x * step, -y * step];
            let points = lattice.map(|lattice| lattice.within(origin, [origin[0] + w, origin[1] + h]));
            let mut found = false;
            for offset in layout.continued(known, x, y) {
                attempt(offset);
            }
            for (x, y) in points.into_iter().flatten() {
                found = attempt([x, y]);
            }
            for _ in 0..if found { 0 } else { CANDIDATES } {
                attempt([origin[0] + random.below(w as usize) as i32, origin[1] + random.below(h as usize) as i32]);
            }
            layout.place(known, x, y, best.1);
        }
    }
    let sources = layout.placed.into_iter().map(Option::unwrap_or_default).collect();
    Ok(Canvas::new(width, height, goal.tileable, sources))
}

impl<const C: usize> Layout<'_, C> {
    /// The source of a texel of the result at this offset; none outside the exemplar.
    fn source(&self, x: i32, y: i32, [dx, dy]: [i32; 2]) -> Option<Source> {
        let (domain, step) = (self.level.domain, self.level.step as i32);
        let (sx, sy) = (x * step + dx, y * step + dy);
        let inside = (0..domain.width as i32).contains(&sx) && (0..domain.height as i32).contains(&sy);
        (domain.periodic || inside).then(|| domain.clamped(Source::default(), sx, sy, 0))
    }

    /// How badly a block fits to those around it; infinite if it leaves the exemplar.
    fn misfit(&self, wanted: Option<&Wanted>, [x0, y0]: [i32; 2], offset: [i32; 2]) -> f32 {
        let (level, side) = (self.level, self.side);
        let (right, bottom) = ((x0 + side).min(self.width) - 1, (y0 + side).min(self.height) - 1);
        if [(x0, y0), (right, bottom)].iter().any(|(x, y)| self.source(*x, *y, offset).is_none()) {
            return f32::INFINITY;
        }
        let (mut sum, mut count) = (0.0, 0);
        for y in y0 - BORDER..=bottom + BORDER {
            for x in x0 - BORDER..=right + BORDER {
                let (cx, cy) = place(x, y, self.width, self.height, self.wraps);
                if !self.wraps && (cx, cy) != (x, y) {
                    continue;
                }
                let Some(other) = self.placed[(cy * self.width + cx) as usize] else { continue };
                let Some(source) = self.source(x, y, offset) else { return f32::INFINITY };
                let texels = [source, other].map(|source| &level.texels[level.domain.index(source)]);
                sum += texels[0].iter().zip(texels[1]).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
                count += 1;
            }
        }
        let guided: f32 = wanted.map_or(0.0, |wanted| {
            let texels = (y0..=bottom).flat_map(|y| (x0..=right).map(move |x| (x, y)));
            let cost = |(x, y)| {
                let source = self.source(x, y, offset).unwrap_or_default();
                wanted.cost((y * self.width + x) as usize, level.domain.index(source))
            };
            texels.map(cost).sum::<f32>() / ((right - x0 + 1) * (bottom - y0 + 1)) as f32
        });
        let centre = self.source((x0 + right) / 2, (y0 + bottom) / 2, offset);
        let repetition = centre.map_or(0.0, |source| self.used[level.domain.index(source)]);
        sum / count.max(1) as f32 + REPETITION * repetition + guided
    }

    /// Displacements that continue what is given around a block.
    fn continued(&self, known: &Known, x0: i32, y0: i32) -> Vec<[i32; 2]> {
        let (side, step) = (self.side, self.level.step as i32);
        let border = (-1..=side).flat_map(|k| [(k, -1), (k, side), (-1, k), (side, k)]);
        let offset = |(dx, dy): (i32, i32)| {
            let (x, y) = place(x0 + dx, y0 + dy, self.width, self.height, self.wraps);
            let source = known.at((y * self.width + x) as usize)?;
            Some([i32::from(source.x) - x * step, i32::from(source.y) - y * step])
        };
        let mut offsets: Vec<_> = border.filter_map(offset).collect();
        offsets.sort_unstable();
        offsets.dedup();
        offsets
    }

    /// Whether all of a block is given.
    fn is_known(&self, known: &Known, x0: i32, y0: i32) -> bool {
        let (right, bottom) = ((x0 + self.side).min(self.width), (y0 + self.side).min(self.height));
        (y0..bottom).all(|y| (x0..right).all(|x| known.at((y * self.width + x) as usize).is_some()))
    }

    fn place(&mut self, known: &Known, x0: i32, y0: i32, offset: [i32; 2]) {
        let (domain, step) = (self.level.domain, self.level.step as i32);
        for y in y0..(y0 + self.side).min(self.height) {
            for x in x0..(x0 + self.side).min(self.width) {
                let texel = (y * self.width + x) as usize;
                let copied = domain.clamped(Source::default(), x * step + offset[0], y * step + offset[1], 0);
                let source = known.at(texel).unwrap_or(copied);
                self.placed[texel] = Some(source);
                self.used[domain.index(source)] += 1.0;
            }
        }
    }
}
