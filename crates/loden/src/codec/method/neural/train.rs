//! Training: rounds over all texels, each with steps of the network and one of the planes.

use std::sync::Mutex;

use rayon::prelude::*;

use super::planes::{Adam, Plane, Records, Steps, update};
use super::pool::Pool;
use super::step::{Errors, Group, Pair, Planes, RECORD, Round, Scratch, Trained, UNIT, Unit};
use crate::codec::network::lanes::{LANES, compute};
use crate::codec::network::layers::{Network, Shape};
use crate::random::{Stream, hash};

/// How a network is trained.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    pub size: [usize; 2],
    pub shape: Shape,
    /// Samples in all.
    pub samples: u64,
    /// Groups of samples in a step of the network.
    pub step: usize,
    /// Steps of the network in a round.
    pub steps: usize,
    /// Largest step of a weight and of a feature, and of a height in texels.
    pub rates: [f32; 3],
    /// Weight of the bits of a feature.
    pub bits: f32,
    /// Errors beyond this count by their size, smaller ones by their square.
    pub knee: f32,
    /// Texels per step of a height.
    pub unit: f32,
}

/// A network in training.
pub struct Training<'a> {
    plan: Plan,
    pairs: &'a [Pair],
    pub weights: Vec<f32>,
    moments: Vec<[f32; 2]>,
    trained: Trained,
    pub features: Plane,
    pub heights: Plane,
    pub planes: Planes,
    /// Unit of the network's values.
    pub scale: f32,
    /// Groups processed, steps of the network and rounds.
    done: usize,
    steps: usize,
    rounds: usize,
    records: Vec<f32>,
    places: Vec<u32>,
    gradients: Vec<Vec<f32>>,
    scratch: Mutex<Vec<Scratch>>,
}

const SEED: u64 = 0x6e65_7572;

impl<'a> Training<'a> {
    /// Begins at random weights and features.
    pub fn new(plan: Plan, pairs: &'a [Pair], pool: &Pool) -> Self {
        let (mean, deviation) = pool.moments();
        let scale = deviation.max(1e-3 * mean.iter().fold(0.0f32, |m, v| m.max(v.abs()))).max(1e-6);
        let shape = plan.shape;
        let mut random = Stream::new(hash(&[SEED, 1]));
        let mut weights = vec![0.0; shape.places().last().map_or(0, |place| place.end)];
        for (layer, place) in shape.places().into_iter().enumerate() {
            let [_, columns] = shape.layer(layer);
            let range = (6.0 / (columns - 1) as f32).sqrt() * if layer == shape.hidden { 0.3 } else { 1.0 };
            for (k, weight) in weights[place].iter_mut().enumerate() {
                let (row, column) = (k / columns, k % columns);
                *weight = match (layer == shape.hidden, column + 1 == columns) {
                    (true, true) => mean[row] / scale,
                    (false, true) => 0.0,
                    // features are in steps
                    _ if layer == 0 && column < shape.features => random.range(-range, range) * 0.25,
                    _ => random.range(-range, range),
                };
            }
        }
        let texels = plan.size[0] * plan.size[1];
        let features = (0..texels * shape.features).map(|_| random.range(-2.0, 2.0)).collect();
        let (features, heights) = (Plane::new(shape.features, features), Plane::new(1, vec![0.0; texels]));
        let planes = Planes { size: plan.size, features: Vec::new(), heights: Vec::new() };
        let trained = Trained::new(Network::new(shape, &weights));
        let moments = vec![[0.0; 2]; weights.len()];
        let (records, places, gradients, scratch) = Default::default();
        Self {
            plan,
            pairs,
            weights,
            moments,
            trained,
            features,
            heights,
            planes,
            scale,
            done: 0,
            steps: 0,
            rounds: 0,
            records,
            places,
            gradients,
            scratch,
        }
    }

    /// The part of the training that is done.
    pub fn progress(&self) -> f32 {
        ((self.done * LANES) as f64 / self.plan.samples as f64).min(1.0) as f32
    }

    /// Trains on every texel a few times; the errors before.
    pub fn round(&mut self, pool: &Pool) -> Errors {
        let plan = self.plan;
        self.features.looked_up(1.0, &mut self.planes.features);
        self.heights.looked_up(plan.unit, &mut self.planes.heights);
        let groups = self.groups(pool);
        self.records.resize(groups.len() * LANES * (plan.shape.features + RECORD), 0.0);
        let mut errors = Errors::default();
        for step in 0..plan.steps {
            errors.add(self.step(pool, &groups[step * plan.step..][..plan.step], step));
        }
        self.move_planes(pool, &groups);
        self.done += groups.len();
        self.rounds += 1;
        errors
    }

    /// The groups of this round: the next of a walk through all of them, each with a random pair.
    fn groups(&mut self, pool: &Pool) -> Vec<Group> {
        let (count, groups) = (self.plan.step * self.plan.steps, pool.groups());
        let stride = stride(groups);
        let most = count.div_ceil(groups) + 1;
        self.places.clear();
        self.places.resize(groups * most, u32::MAX);
        let mut found = Vec::with_capacity(count);
        for place in 0..count {
            let at = self.done + place;
            let group = (at % groups * stride + at / groups) % groups;
            let random = hash(&[SEED, 3, at as u64]);
            found.push(Group { group, slot: (random % pool.slots() as u64) as usize });
            let places = &mut self.places[group * most..][..most];
            if let Some(free) = places.iter_mut().find(|place| **place == u32::MAX) {
                *free = place as u32;
            }
        }
        found
    }

    /// Moves the weights against the gradient of some groups, and records the gradients of the planes.
    fn step(&mut self, pool: &Pool, groups: &[Group], step: usize) -> Errors {
        let plan = self.plan;
        self.trained.set(&self.weights);
        let length = plan.shape.features + RECORD;
        let records = &mut self.records[step * plan.step * LANES * length..][..groups.len() * LANES * length];
        self.gradients.resize(groups.len().div_ceil(UNIT), Vec::new());
        let (planes, trained, pairs) = (&self.planes, &self.trained, self.pairs);
        let round = Round { pool, planes, trained, pairs, knee: plan.knee, scale: self.scale };
        let (weights, scratch) = (self.weights.len(), &self.scratch);
        let units = groups.par_chunks(UNIT).zip(records.par_chunks_mut(UNIT * LANES * length));
        let units = units.zip(self.gradients.par_iter_mut());
        let errors: Vec<Errors> = units
            .map(|((groups, records), gradient)| {
                let free = scratch.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).pop();
                let mut own = free.unwrap_or_else(|| Scratch::new(&round.trained.network));
                gradient.clear();
                gradient.resize(weights, 0.0);
                let unit = Unit { round: &round, groups, scratch: &mut own, gradient, records };
                let errors = compute(unit, true);
                scratch.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).push(own);
                errors
            })
            .collect();
        self.steps += 1;
        let adam = Adam::new(plan.rates[0] * self.pace(), [0.9, 0.99], self.steps);
        let mut sum = vec![0.0f32; weights];
        for gradient in &self.gradients {
            sum.iter_mut().zip(gradient).for_each(|(sum, part)| *sum += part);
        }
        for ((weight, moments), gradient) in self.weights.iter_mut().zip(&mut self.moments).zip(sum) {
            adam.step(weight, moments, gradient);
        }
        let mut all = Errors::default();
        errors.into_iter().for_each(|errors| all.add(errors));
        all
    }

    /// Moves the planes against the gradients of this round.
    fn move_planes(&mut self, pool: &Pool, groups: &[Group]) {
        let (plan, size) = (self.plan, self.plan.size);
        let steepest = self.pairs.iter().fold(0.0f32, |most, pair| most.max(pair.slope.y.abs()));
        let highest = self.planes.heights.iter().fold(0.0f32, |most, height| most.max(height.abs()));
        let reach = ((steepest * highest).min(size[1] as f32) + 2.0) as usize;
        let most = groups.len().div_ceil(pool.groups()) + 1;
        let numbers = &self.records[..];
        let records = Records { pool, numbers, features: plan.shape.features, places: &self.places, most, reach };
        let (pace, step) = (self.pace(), self.rounds + 1);
        let per_texel = (groups.len() * LANES) as f32 / (size[0] * size[1]) as f32;
        let steps = Steps {
            features: Adam::new(plan.rates[1] * pace, [0.9, 0.99], step),
            heights: Adam::new(plan.rates[2] / plan.unit * pace, [0.9, 0.99], step),
            bits: plan.bits * per_texel,
            unit: plan.unit,
        };
        update(&records, size, &mut self.features, &mut self.heights, &steps);
    }

    /// Step size as a part of the largest: a short rise, then a cosine.
    fn pace(&self) -> f32 {
        let progress = self.progress();
        let rise = (self.steps as f32 / 100.0).min(1.0);
        rise * (0.5 * (1.0 + (std::f32::consts::PI * progress).cos())).max(0.01)
    }
}

/// A step through `count` groups that meets all of them and seldom neighbours.
fn stride(count: usize) -> usize {
    let common = |mut a: usize, mut b: usize| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let start = (count as f64 * 0.618_033_988_749_895) as usize;
    (start.max(1)..).find(|stride| common(*stride, count) == 1).unwrap_or(1)
}
