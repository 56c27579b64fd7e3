//! What is given: sources that stay, and numbers that a guide wants.

use rayon::prelude::*;

use super::super::{Goal, Guide, Source};
use super::canvas::{Canvas, place};

/// The sources that are given at one scale; none if all are to be found.
pub(super) struct Known(Option<Vec<Option<Source>>>);

impl Known {
    /// Every `step`-th source of a goal in each direction.
    pub(super) fn new(goal: &Goal, step: usize) -> Self {
        let columns = (0..goal.width).step_by(step);
        let rows = (0..goal.height).step_by(step);
        let of = |known: &Vec<Option<Source>>| {
            rows.flat_map(|y| columns.clone().map(move |x| y * goal.width + x)).map(|texel| known[texel]).collect()
        };
        Self(goal.known.as_ref().map(of))
    }

    /// The source of a texel, if it is given.
    #[inline]
    pub(super) fn at(&self, texel: usize) -> Option<Source> {
        self.0.as_ref().and_then(|known| known[texel])
    }

    /// Puts the given sources back.
    pub(super) fn restore(&self, sources: &mut [Source]) {
        for (source, known) in sources.iter_mut().zip(self.0.iter().flatten()) {
            *source = known.unwrap_or(*source);
        }
    }

    /// Which texels have no unknown one within their neighbourhood; empty if all are unknown.
    pub(super) fn settled<const C: usize>(&self, canvas: &Canvas<C>, radius: usize) -> Vec<bool> {
        let Some(known) = &self.0 else { return Vec::new() };
        let (w, h, r) = (canvas.width as i32, canvas.height as i32, radius as i32);
        let along = |from: &[bool], [dx, dy]: [i32; 2]| -> Vec<bool> {
            let all = |i: i32| {
                (-r..=r).all(|d| {
                    let (x, y) = place(i % w + d * dx, i / w + d * dy, w, h, canvas.wraps);
                    from[(y * w + x) as usize]
                })
            };
            (0..w * h).into_par_iter().map(all).collect()
        };
        let here: Vec<bool> = known.iter().map(Option::is_some).collect();
        along(&along(&here, [1, 0]), [0, 1])
    }
}

/// The numbers of a guide at one scale.
pub(super) struct Wanted<'a> {
    guide: &'a Guide,
    result: Vec<f32>,
}

impl<'a> Wanted<'a> {
    /// Means over `step` x `step` texels of a goal.
    pub(super) fn new(goal: &'a Goal, step: usize) -> Option<Self> {
        let guide = goal.guide.as_ref()?;
        let mean = |x0: usize, y0: usize| {
            let (x1, y1) = ((x0 + step).min(goal.width), (y0 + step).min(goal.height));
            let sum: f32 =
                (y0..y1).map(|y| guide.result[y * goal.width + x0..y * goal.width + x1].iter().sum::<f32>()).sum();
            sum / ((x1 - x0) * (y1 - y0)) as f32
        };
        let rows = (0..goal.height).step_by(step);
        let result = rows.flat_map(|y| (0..goal.width).step_by(step).map(move |x| (x, y))).map(|(x, y)| mean(x, y));
        Some(Self { guide, result: result.collect() })
    }

    /// What it costs that a texel of the result copies a texel of the sample.
    #[inline(always)]
    pub(super) fn cost(&self, texel: usize, source: usize) -> f32 {
        let difference = self.guide.sample[source] - self.result[texel];
        self.guide.weight * difference * difference
    }
}
