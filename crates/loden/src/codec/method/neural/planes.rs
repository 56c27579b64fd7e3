//! The planes while they are trained: gradients gathered row by row, and steps of Adam.

use std::ops::Range;

use glam::Vec2;
use rayon::prelude::*;

use super::pool::Pool;
use super::step::RECORD;
use crate::codec::network::lanes::{Kernel, LANES, Lanes, compute};
use crate::codec::network::place::Corners;

/// Rows whose gradients are gathered together.
const BAND: usize = 8;

/// The largest magnitude of a stored number.
pub const LARGEST: f32 = 127.0;

/// Rounds numbers.
struct Round<'a> {
    unit: f32,
    values: &'a [f32],
    out: &'a mut [f32],
}

impl Kernel for Round<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        for (out, value) in self.out.iter_mut().zip(self.values) {
            *out = value.round_ties_even() * self.unit;
        }
    }
}

/// Moments and step sizes of Adam.
///
/// # References
/// kingma2015
#[derive(Debug, Clone, Copy)]
pub struct Adam {
    pub rate: f32,
    /// Decay of the mean gradient and of the mean square.
    pub decay: [f32; 2],
    /// Divisors that make up for the start from zero.
    pub start: [f32; 2],
}

impl Adam {
    pub fn new(rate: f32, decay: [f32; 2], step: usize) -> Self {
        Self { rate, decay, start: decay.map(|decay| 1.0 - decay.powi(step.min(1 << 20) as i32)) }
    }

    /// Moves a value against its gradient.
    #[inline(always)]
    pub fn step(&self, value: &mut f32, [mean, square]: &mut [f32; 2], gradient: f32) {
        let [a, b] = self.decay;
        *mean = a * *mean + (1.0 - a) * gradient;
        *square = b * *square + (1.0 - b) * gradient * gradient;
        let (mean, square) = (*mean / self.start[0], *square / self.start[1]);
        *value -= self.rate * mean / (square.sqrt() + 1e-12);
    }
}

/// A plane in training.
pub struct Plane {
    /// Numbers per texel.
    pub count: usize,
    /// (texel, number) in steps.
    pub values: Vec<f32>,
    moments: Vec<[f32; 2]>,
}

impl Plane {
    pub fn new(count: usize, values: Vec<f32>) -> Self {
        let moments = vec![[0.0; 2]; values.len()];
        Self { count, values, moments }
    }

    /// What is looked up: values rounded to whole steps, times `unit`.
    pub fn looked_up(&self, unit: f32, out: &mut Vec<f32>) {
        const PIECE: usize = 1 << 14;
        out.resize(self.values.len(), 0.0);
        let pieces = self.values.par_chunks(PIECE).zip(out.par_chunks_mut(PIECE));
        pieces.for_each(|(values, out)| compute(Round { unit, values, out }, true));
    }

    /// A plane of one of its numbers, rounded.
    pub fn rounded(&self, number: usize) -> Vec<i32> {
        self.values.iter().skip(number).step_by(self.count).map(|v| v.round_ties_even() as i32).collect()
    }
}

/// The records of a round, by group and lane.
pub struct Records<'a> {
    pub pool: &'a Pool,
    pub numbers: &'a [f32],
    pub features: usize,
    /// For each group of the pool the places in the round at which it occurs, up to `most`; `u32::MAX` for none.
    pub places: &'a [u32],
    pub most: usize,
    /// Rows that a place may be away from its texel.
    pub reach: usize,
}

/// A band of rows of both planes, with their moments.
struct Band<'a> {
    records: &'a Records<'a>,
    size: [usize; 2],
    /// Its first row.
    first: usize,
    features: (&'a mut [f32], &'a mut [[f32; 2]]),
    heights: (&'a mut [f32], &'a mut [[f32; 2]]),
    steps: &'a Steps,
}

impl Kernel for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { features: (features, of_features), heights: (heights, of_heights), steps, .. } = self;
        let mut gradients = (vec![0.0; features.len()], vec![0.0; heights.len()]);
        let range = self.first * self.size[0]..self.first * self.size[0] + heights.len();
        self.records.gather(self.size, range, &mut gradients.0, &mut gradients.1);
        for ((value, moments), gradient) in features.iter_mut().zip(of_features).zip(gradients.0) {
            // the derivative of ln(1 + value^2): about that of the bits that the value takes
            let bits = steps.bits * *value / (1.0 + *value * *value);
            steps.features.step(value, moments, gradient + bits);
            *value = value.clamp(-LARGEST, LARGEST);
        }
        for ((value, moments), gradient) in heights.iter_mut().zip(of_heights).zip(gradients.1) {
            steps.heights.step(value, moments, gradient * steps.unit);
            *value = value.clamp(-LARGEST, LARGEST);
        }
    }
}

impl Records<'_> {
    /// Adds the gradients of the texels of `range`, whole rows, to `features` (texel, feature) and `heights` (texel), sample
    /// by sample in a fixed order.
    #[inline(always)]
    fn gather(&self, [width, height]: [usize; 2], range: Range<usize>, features: &mut [f32], heights: &mut [f32]) {
        let (length, groups) = (self.features + RECORD, self.pool.groups());
        let (first, rows) = (range.start / width, range.len() / width);
        let all = rows + 2 * self.reach >= height;
        let (begin, count) = if all { (0, height) } else { (first + height - self.reach, rows + 2 * self.reach) };
        for row in begin..begin + count {
            let row = row % height;
            let (mut lane, mut group) = (row * width / groups, row * width % groups);
            for _ in 0..width {
                for &place in &self.places[group * self.most..][..self.most] {
                    if place != u32::MAX {
                        let record = &self.numbers[(place as usize * LANES + lane) * length..][..length];
                        self.add(record, [width, height], &range, features, heights);
                    }
                }
                group += 1;
                if group == groups {
                    (lane, group) = (lane + 1, 0);
                }
            }
        }
    }

    #[inline(always)]
    fn add(&self, record: &[f32], size: [usize; 2], range: &Range<usize>, features: &mut [f32], heights: &mut [f32]) {
        let count = self.features;
        let (gradient, rest) = record.split_at(count);
        let corners = Corners::new(Vec2::new(rest[0], rest[1]), size);
        for (texel, weight) in corners.texel.into_iter().zip(corners.weights()) {
            if range.contains(&texel) {
                let to = &mut features[(texel - range.start) * count..][..count];
                to.iter_mut().zip(gradient).for_each(|(to, from)| *to += weight * from);
            }
        }
        let corners = Corners::new(Vec2::new(rest[3], rest[4]), size);
        for (texel, weight) in corners.texel.into_iter().zip(corners.weights()) {
            if range.contains(&texel) {
                heights[texel - range.start] += weight * rest[2];
            }
        }
    }
}

/// Steps of both planes.
#[derive(Debug, Clone, Copy)]
pub struct Steps {
    pub features: Adam,
    pub heights: Adam,
    /// Weight of the bits of a feature relative to the sum of a texel's errors.
    pub bits: f32,
    /// Heights per step.
    pub unit: f32,
}

/// Moves features and heights against the gradients of a round.
pub fn update(records: &Records, size: [usize; 2], features: &mut Plane, heights: &mut Plane, steps: &Steps) {
    let (texels, count) = (BAND * size[0], features.count);
    let bands = features.values.par_chunks_mut(texels * count).zip(features.moments.par_chunks_mut(texels * count));
    let bands = bands.zip(heights.values.par_chunks_mut(texels).zip(heights.moments.par_chunks_mut(texels)));
    bands.enumerate().for_each(|(band, (features, heights))| {
        compute(Band { records, size, first: band * BAND, features, heights, steps }, true);
    });
}
