//! The samples that a network is trained on.

use half::f16;
use rayon::prelude::*;

use crate::codec::network::lanes::LANES;
use crate::random::{hash, unit};

/// Display values of texels for some pairs, in groups of texels that are far apart: lane k of group g is texel
/// k x groups + g.
pub struct Pool {
    texels: usize,
    pairs: usize,
    groups: usize,
    /// Pairs that each group has values for.
    slots: usize,
    seed: u64,
    /// (group, slot, channel, lane)
    values: Values,
}

/// Number types of [`Pool`].
pub enum Values {
    /// Fractions of 255.
    U8(Vec<u8>),
    F16(Vec<f16>),
}

/// Numbers of a group in a slot.
const SLOT: usize = 3 * LANES;

impl Pool {
    /// Room for as many pairs of each texel as fit into `bytes`, chosen by `seed`; for all if they fit.
    pub fn new(texels: usize, pairs: usize, bytes: usize, is_u8: bool, seed: u64) -> Self {
        let groups = texels.div_ceil(LANES);
        let size = if is_u8 { 1 } else { 2 };
        let slots = (bytes / (groups * SLOT * size)).clamp(1, pairs);
        let count = groups * slots * SLOT;
        let values = if is_u8 { Values::U8(vec![0; count]) } else { Values::F16(vec![f16::ZERO; count]) };
        Self { texels, pairs, groups, slots, seed, values }
    }

    pub fn groups(&self) -> usize {
        self.groups
    }

    pub fn slots(&self) -> usize {
        self.slots
    }

    /// The texel of a lane; lanes beyond the last texel repeat the first.
    #[inline(always)]
    pub fn texel(&self, group: usize, lane: usize) -> usize {
        let texel = lane * self.groups + group;
        if texel < self.texels { texel } else { group }
    }

    /// Number of lanes with a texel of their own.
    #[inline(always)]
    pub fn lanes(&self, group: usize) -> usize {
        (self.texels - group).div_ceil(self.groups).min(LANES)
    }

    /// The pair in a slot.
    #[inline(always)]
    pub fn pair(&self, group: usize, slot: usize) -> usize {
        if self.slots == self.pairs {
            return slot;
        }
        let random = unit(hash(&[self.seed, group as u64, slot as u64]));
        let (begin, end) = (slot * self.pairs / self.slots, (slot + 1) * self.pairs / self.slots);
        (begin + (random * (end - begin) as f32) as usize).min(end - 1)
    }

    /// The values of a slot, (channel, lane).
    #[inline(always)]
    pub fn values(&self, group: usize, slot: usize) -> [[f32; LANES]; 3] {
        let first = (group * self.slots + slot) * SLOT;
        let mut found = [[0.0; LANES]; 3];
        let numbers = found.as_flattened_mut().iter_mut();
        match &self.values {
            Values::U8(values) => {
                numbers.zip(&values[first..first + SLOT]).for_each(|(to, v)| *to = f32::from(*v) * (1.0 / 255.0));
            }
            Values::F16(values) => numbers.zip(&values[first..first + SLOT]).for_each(|(to, v)| *to = v.to_f32()),
        }
        found
    }

    /// Fills in the slots whose pairs are in `pairs` from their 8-bit images, (pair, texel, channel).
    pub fn fill_u8(&mut self, pairs: std::ops::Range<usize>, images: &[u8]) {
        let Values::U8(mut values) = std::mem::replace(&mut self.values, Values::U8(Vec::new())) else { return };
        self.fill(pairs, images, &mut values);
        self.values = Values::U8(values);
    }

    /// The same from images of other types in half precision.
    pub fn fill_f16(&mut self, pairs: std::ops::Range<usize>, images: &[f16]) {
        let Values::F16(mut values) = std::mem::replace(&mut self.values, Values::F16(Vec::new())) else { return };
        self.fill(pairs, images, &mut values);
        self.values = Values::F16(values);
    }

    fn fill<T: Copy + Send + Sync>(&self, pairs: std::ops::Range<usize>, images: &[T], values: &mut [T]) {
        // slots whose range of pairs meets these
        let first = pairs.start * self.slots / self.pairs;
        let last = (pairs.end * self.slots).div_ceil(self.pairs).min(self.slots);
        values.par_chunks_mut(self.slots * SLOT).enumerate().for_each(|(group, values)| {
            for slot in first..last {
                let pair = self.pair(group, slot);
                if !pairs.contains(&pair) {
                    continue;
                }
                let image = &images[(pair - pairs.start) * 3 * self.texels..][..3 * self.texels];
                let values = &mut values[slot * SLOT..][..SLOT];
                for lane in 0..LANES {
                    let texel = &image[3 * self.texel(group, lane)..][..3];
                    (0..3).for_each(|channel| values[channel * LANES + lane] = texel[channel]);
                }
            }
        });
    }

    /// The largest value.
    pub fn largest(&self) -> f32 {
        match &self.values {
            Values::U8(values) => f32::from(values.par_iter().copied().max().unwrap_or(0)) / 255.0,
            Values::F16(values) => {
                let pieces = values.par_chunks(1 << 14);
                let largest = |values: &[f16]| values.iter().fold(f32::NEG_INFINITY, |most, v| most.max(v.to_f32()));
                pieces.map(largest).reduce(|| f32::NEG_INFINITY, f32::max)
            }
        }
    }

    /// Mean and standard deviation of all values.
    pub fn moments(&self) -> ([f32; 3], f32) {
        let of_group = |group: usize| {
            let (mut sums, mut square, mut count) = ([0.0f64; 3], 0.0f64, 0.0f64);
            let step = (self.slots / 64).max(1);
            for slot in (0..self.slots).step_by(step) {
                let values = self.values(group, slot);
                for (sum, lanes) in sums.iter_mut().zip(&values) {
                    for value in &lanes[..self.lanes(group)] {
                        *sum += f64::from(*value);
                        square += f64::from(*value).powi(2);
                    }
                }
                count += self.lanes(group) as f64;
            }
            (sums, square, count)
        };
        let all: Vec<_> = (0..self.groups).into_par_iter().map(of_group).collect();
        let (mut sums, mut square, mut count) = ([0.0f64; 3], 0.0f64, 0.0f64);
        for (s, q, n) in all {
            sums.iter_mut().zip(s).for_each(|(sum, s)| *sum += s);
            (square, count) = (square + q, count + n);
        }
        let mean = sums.map(|sum| sum / count);
        let mean_square: f64 = mean.iter().map(|m| m * m).sum::<f64>() / 3.0;
        (mean.map(|m| m as f32), (square / (3.0 * count) - mean_square).max(0.0).sqrt() as f32)
    }
}
