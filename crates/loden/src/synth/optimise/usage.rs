//! How often each part of the exemplar is used.

use super::super::Source;
use super::level::Level;

/// How often each texel of the exemplar is used, compared with the mean.
pub(super) struct Usage {
    density: Vec<f32>,
}

impl Usage {
    /// Nothing is used yet.
    pub(super) fn new(texels: usize) -> Self {
        Self { density: vec![0.0; texels] }
    }

    /// Adds what a round uses; `share` is its weight against all rounds before. All texels see the same penalties in a
    /// round, so without memory they would change sides together.
    pub(super) fn add<const C: usize>(&mut self, level: &Level<C>, sources: &[Source], share: f32) {
        let usable = level.sample.open.iter().filter(|open| **open).count();
        let weight = usable as f32 / sources.len() as f32 * share;
        self.density.iter_mut().for_each(|density| *density *= 1.0 - share);
        let weights = &level.sample.weights;
        for source in sources {
            let texel = level.domain.index(*source);
            self.density[texel] += weight / weights.get(texel).copied().unwrap_or(1.0);
        }
    }

    /// What is added to the distance of each neighbourhood of the exemplar: `variety` if its texels are used as often as
    /// the mean. Infinite where a neighbourhood is not usable.
    pub(super) fn penalties<const C: usize>(&self, level: &Level<C>, variety: f32) -> Vec<f32> {
        let (w, h) = (level.domain.width, level.domain.height);
        let mut sums = vec![0.0f64; (w + 1) * (h + 1)];
        for y in 0..h {
            let mut row = 0.0;
            for x in 0..w {
                row += f64::from(self.density[y * w + x]);
                sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
            }
        }
        let reach = level.radius.max(1) * level.step;
        let mean = |i: usize| {
            let (x, y) = (i % w, i / w);
            let (left, right) = (x.saturating_sub(reach), (x + reach + 1).min(w));
            let (top, bottom) = (y.saturating_sub(reach), (y + reach + 1).min(h));
            let at = |x: usize, y: usize| sums[y * (w + 1) + x];
            let sum = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top);
            (sum / ((right - left) * (bottom - top)) as f64) as f32
        };
        (0..w * h).map(|i| if level.usable[i] { variety * mean(i) } else { f32::INFINITY }).collect()
    }
}
