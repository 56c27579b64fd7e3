//! Pictures of several channels, and their patches.

use super::super::{Exemplar, Source, SourceMap};
use crate::random::{Stream, hash};

/// A picture of several channels, and which of its texels count.
pub(super) struct Planes {
    pub width: usize,
    pub height: usize,
    pub channels: usize,
    pub values: Vec<f32>,
    pub usable: Vec<bool>,
}

impl Planes {
    pub(super) fn of(exemplar: &Exemplar) -> Self {
        let (width, height, channels) = (exemplar.width, exemplar.height, exemplar.channels);
        let usable = exemplar.mask.clone().unwrap_or_else(|| vec![true; width * height]);
        Self { width, height, channels, values: exemplar.values.clone(), usable }
    }

    pub(super) fn copied(exemplar: &Exemplar, map: &SourceMap) -> Self {
        let texel = |source: &Source| exemplar.texel(source.x.into(), source.y.into()).iter().copied();
        let values = map.sources.iter().flat_map(texel).collect();
        let usable = vec![true; map.sources.len()];
        Self { width: map.width, height: map.height, channels: exemplar.channels, values, usable }
    }

    /// Means of 2 x 2 texels.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let four = |i: usize| {
            let corner = i / width * 2 * self.width + i % width * 2;
            [corner, corner + 1, corner + self.width, corner + self.width + 1]
        };
        let value =
            |i: usize, c: usize| four(i).map(|at| self.values[at * self.channels + c]).iter().sum::<f32>() / 4.0;
        let texels = 0..width * height;
        let values = texels.clone().flat_map(|i| (0..self.channels).map(move |c| (i, c))).map(|(i, c)| value(i, c));
        let usable = texels.map(|i| four(i).iter().all(|at| self.usable[*at])).collect();
        Self { width, height, channels: self.channels, values: values.collect(), usable }
    }

    /// Top left corners of the patches of `side` texels that count, at most `most` evenly spread ones.
    pub(super) fn patches(&self, side: usize, most: usize) -> Vec<usize> {
        let columns = (self.width + 1).saturating_sub(side);
        let rows = (self.height + 1).saturating_sub(side);
        let is_usable =
            |corner: &usize| (0..side * side).all(|k| self.usable[corner + k / side * self.width + k % side]);
        let corners = (0..columns * rows).map(|i| i / columns * self.width + i % columns);
        let all: Vec<usize> = corners.filter(is_usable).collect();
        let count = all.len().min(most);
        let mut random = Stream::new(hash(&[count as u64]));
        (0..count).map(|k| all[(k * all.len() + random.below(all.len())) / count]).collect()
    }

    /// The sum of a patch's numbers times those of `direction`.
    pub(super) fn projection(&self, corner: usize, side: usize, direction: &[f32]) -> f32 {
        let row = side * self.channels;
        direction
            .chunks_exact(row)
            .enumerate()
            .map(|(y, shares)| {
                let from = (corner + y * self.width) * self.channels;
                shares.iter().zip(&self.values[from..from + row]).map(|(a, b)| a * b).sum::<f32>()
            })
            .sum()
    }

    /// Standard deviation over all channels together.
    pub(super) fn contrast(&self) -> f64 {
        let mut sum = 0.0;
        for c in 0..self.channels {
            let values =
                || self.values.iter().skip(c).step_by(self.channels).zip(&self.usable).filter(|(_, usable)| **usable);
            let count = values().count().max(1) as f64;
            let mean = values().map(|(v, _)| f64::from(*v)).sum::<f64>() / count;
            sum += values().map(|(v, _)| (f64::from(*v) - mean) * (f64::from(*v) - mean)).sum::<f64>() / count;
        }
        sum.sqrt()
    }

    /// Means of `side` x `side` texels from each texel to the right and down.
    pub(super) fn blurred(&self, side: usize) -> Self {
        if side > self.width.min(self.height) {
            return Self { width: 0, height: 0, channels: self.channels, values: vec![], usable: vec![] };
        }
        let (width, height, c) = (self.width + 1 - side, self.height + 1 - side, self.channels);
        // along rows, then along columns
        let rows = |i: usize, k: usize| {
            (0..side).map(|d| self.values[(i / width * self.width + i % width + d) * c + k]).sum::<f32>()
        };
        let sums: Vec<f32> = (0..width * self.height * c).map(|n| rows(n / c, n % c)).collect();
        let share = 1.0 / (side * side) as f32;
        let mean = |n: usize| (0..side).map(|d| sums[n + d * width * c]).sum::<f32>() * share;
        let all = |i: usize| {
            let texels = (0..side * side).map(|d| (i / width + d / side) * self.width + i % width + d % side);
            texels.into_iter().all(|texel| self.usable[texel])
        };
        Self {
            width,
            height,
            channels: c,
            values: (0..width * height * c).map(mean).collect(),
            usable: (0..width * height).map(all).collect(),
        }
    }
}
