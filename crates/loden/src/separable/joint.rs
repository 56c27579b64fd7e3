//! A chain of sums of products fitted to samples of a BRDF, all of its tables jointly.

use glam::Vec3;

use super::sparse::{Equations, Penalty};
use super::tables::{Grid, Projection};
use super::{Evaluated, Metric, NOISE};
use crate::Result;
use crate::material::Material;
use crate::progress::Task;

/// Samples of a BRDF, and where they lie in the tables.
pub(super) struct Samples {
    /// Texels per side of a table.
    pub size: usize,
    /// For each projection of [`PROJECTIONS`] the four texels around the direction of every sample.
    stencils: [Vec<[(usize, f32); 4]>; 4],
    /// The cosine of the light.
    cosines: Vec<f32>,
    /// The values of each channel, relative to `scale`; negative ones are 0.
    values: [Vec<f32>; 3],
    /// The mean of each channel.
    pub scale: Vec3,
}

const PROJECTIONS: [Projection; 4] = [Projection::Light, Projection::View, Projection::Half, Projection::Difference];

fn place(projection: Projection) -> usize {
    match projection {
        Projection::Light => 0,
        Projection::View => 1,
        Projection::Half => 2,
        Projection::Difference => 3,
    }
}

/// Samples per unknown, and the least number in all: enough of them in a highlight.
const PER_UNKNOWN: usize = 24;
const LEAST: usize = 60_000;

impl Samples {
    /// Evaluates the BRDF at evenly spread pairs, enough for this many unknowns per channel.
    ///
    /// # Errors
    /// [`crate::Error::NonFinite`].
    pub fn of(brdf: &dyn Material, size: usize, unknowns: usize) -> Result<Self> {
        Self::at(brdf, size, LEAST.max(PER_UNKNOWN * unknowns))
    }

    /// Evaluates the BRDF at `count` pairs.
    ///
    /// # Errors
    /// As [`Samples::of`].
    pub fn at(brdf: &dyn Material, size: usize, count: usize) -> Result<Self> {
        let Evaluated { pairs, scale, relative } = Evaluated::at(brdf, count)?;
        let stencils = PROJECTIONS.map(|p| pairs.iter().map(|&(wi, wo)| Grid::stencil(size, p.of(wi, wo))).collect());
        let cosines = pairs.iter().map(|(wi, _)| wi.z).collect();
        let values = [0, 1, 2].map(|c| relative.iter().map(|v| v[c]).collect());
        Ok(Self { size, stencils, cosines, values, scale })
    }

    pub fn channel(&self, channel: usize, metric: Metric) -> Fit<'_> {
        Fit { samples: self, values: &self.values[channel], metric }
    }
}

/// A sum of products of two tables over two projections, in one channel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Step {
    pub projections: [Projection; 2],
    /// (term, texel) of both sides; a single table has no second side.
    pub tables: [Vec<f32>; 2],
}

impl Step {
    /// The constant 1 in so many terms: all but the first are 0 on the left and ripple on the right, to be told apart.
    pub fn one(projections: [Projection; 2], size: usize, terms: usize) -> Self {
        let mut step = Self { projections, tables: [vec![1.0; size * size], vec![1.0; size * size]] };
        (1..terms).for_each(|_| step.add_term(size));
        step
    }

    /// A single table of 1.
    pub fn single(projection: Projection, size: usize) -> Self {
        Self { projections: [projection; 2], tables: [vec![1.0; size * size], Vec::new()] }
    }

    pub fn is_single(&self) -> bool {
        self.tables[1].is_empty()
    }

    /// Appends a term that is 0.
    pub fn add_term(&mut self, size: usize) {
        let term = self.tables[0].len() / (size * size);
        let ripple = |i: usize| ((i * (2 * term + 1)) as f32 * 0.37 + term as f32).sin();
        self.tables[0].extend(vec![0.0; size * size]);
        self.tables[1].extend((0..size * size).map(ripple));
    }
}

/// The search for the tables of one channel.
pub(super) struct Fit<'a> {
    samples: &'a Samples,
    values: &'a [f32],
    metric: Metric,
}

/// Rounds over all tables.
const ROUNDS: usize = 30;
/// Relative decrease of the squared error in a round, below which the search ends.
const SETTLED: f64 = 1e-3;
/// Iterations of conjugate gradients for a table.
const ITERATIONS: usize = 8;
/// Weight of a table's values before a change, relative to that of the samples.
const DAMPING: f32 = 1e-3;
/// Halvings of a step that does not lower the error.
const HALVINGS: usize = 6;

impl Fit<'_> {
    /// The squared error of a chain.
    pub fn error(&self, chain: &[Step]) -> f64 {
        self.distance(&product(&self.factors(chain), usize::MAX))
    }

    /// Improves all tables in turn until the error settles.
    pub fn improve(&self, chain: &mut [Step], task: &Task) -> Result<f64> {
        let mut error = self.error(chain);
        for _ in 0..ROUNDS {
            task.check()?;
            let before = error;
            for step in 0..chain.len() {
                let rest = product(&self.factors(chain), step);
                for side in 0..if chain[step].is_single() { 1 } else { 2 } {
                    error = self.improve_side(&mut chain[step], side, &rest, error);
                }
                balance(&mut chain[step], self.texels());
            }
            if error >= (1.0 - SETTLED) * before {
                break;
            }
        }
        Ok(error)
    }

    /// The value of every step at every sample.
    fn factors(&self, chain: &[Step]) -> Vec<Vec<f32>> {
        chain.iter().map(|step| self.step_values(step)).collect()
    }

    fn step_values(&self, step: &Step) -> Vec<f32> {
        let left = self.side_values(step, 0);
        if step.is_single() {
            return left;
        }
        let (right, terms) = (self.side_values(step, 1), self.terms(step));
        left.chunks_exact(terms)
            .zip(right.chunks_exact(terms))
            .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum())
            .collect()
    }

    fn terms(&self, step: &Step) -> usize {
        step.tables[0].len() / self.texels()
    }

    fn texels(&self) -> usize {
        self.samples.size * self.samples.size
    }

    /// (sample, term)
    fn side_values(&self, step: &Step, side: usize) -> Vec<f32> {
        let stencils = &self.samples.stencils[place(step.projections[side])];
        let tables = step.tables[side].chunks_exact(self.texels());
        let value =
            |stencil: &[(usize, f32); 4], table: &[f32]| stencil.iter().map(|&(i, w)| w * table[i]).sum::<f32>();
        stencils.iter().flat_map(|stencil| tables.clone().map(move |table| value(stencil, table))).collect()
    }

    /// Improves the tables of one side of a step, whose value is multiplied by `rest`; returns the squared error.
    fn improve_side(&self, step: &mut Step, side: usize, rest: &[f32], error: f64) -> f64 {
        let terms = self.terms(step);
        let other = if step.is_single() { vec![1.0; rest.len()] } else { self.side_values(step, 1 - side) };
        let value: Vec<f32> = self.step_values(step).iter().zip(rest).map(|(a, b)| a * b).collect();
        // Linearise the error in the value
        let mut weights = Vec::with_capacity(rest.len() * 4 * terms);
        let mut right = Vec::with_capacity(rest.len());
        let texels = self.texels();
        for (i, stencil) in self.samples.stencils[place(step.projections[side])].iter().enumerate() {
            let (weight, target) = self.linearised(i, value[i]);
            right.push(target);
            for (term, other) in other[i * terms..][..terms].iter().enumerate() {
                let factor = weight * rest[i] * other;
                weights.extend(stencil.map(|(texel, w)| ((term * texels + texel) as u32, w * factor)));
            }
        }
        let energy = weights.iter().map(|(_, w)| f64::from(*w).powi(2)).sum::<f64>() / (terms * texels) as f64;
        let equations = Equations { weights, width: 4 * terms, unknowns: terms * texels };
        let penalty = Penalty { size: self.samples.size, smoothness: 0.0, damping: DAMPING * energy.sqrt() as f32 };
        let before = step.tables[side].clone();
        let change = equations.change(&right, &before, penalty, ITERATIONS);
        // Shorten the change until the error falls
        for halving in 0..=HALVINGS {
            let share = 0.5f32.powi(halving as i32);
            step.tables[side] = before.iter().zip(&change).map(|(x, d)| x + share * d).collect();
            let value: Vec<f32> = self.step_values(step).iter().zip(rest).map(|(a, b)| a * b).collect();
            let found = self.distance(&value);
            if found <= error {
                return found;
            }
        }
        step.tables[side] = before;
        error
    }

    /// The squared error of values at all samples.
    fn distance(&self, values: &[f32]) -> f64 {
        let squares = values.iter().enumerate().map(|(i, value)| {
            let (cosine, wanted) = (self.samples.cosines[i], self.values[i]);
            f64::from(match self.metric {
                Metric::Linear => cosine * (value - wanted),
                Metric::Log => (cosine * value.max(0.0) + NOISE).ln() - (cosine * wanted + NOISE).ln(),
            })
            .powi(2)
        });
        squares.sum()
    }

    /// The weight w and the right-hand side r of the equation w x = r, whose error is that of the metric near `value`.
    fn linearised(&self, sample: usize, value: f32) -> (f32, f32) {
        let (cosine, wanted) = (self.samples.cosines[sample], self.values[sample]);
        match self.metric {
            Metric::Linear => (cosine, cosine * wanted),
            Metric::Log => {
                let here = cosine * value.max(0.0) + NOISE;
                let weight = cosine / here;
                (weight, weight * value.max(0.0) + ((cosine * wanted + NOISE) / here).ln())
            }
        }
    }
}

/// The product over all factors but one, sample by sample.
fn product(factors: &[Vec<f32>], without: usize) -> Vec<f32> {
    let mut product = vec![1.0; factors.first().map_or(0, Vec::len)];
    for factor in factors.iter().enumerate().filter(|(k, _)| *k != without).map(|(_, factor)| factor) {
        product.iter_mut().zip(factor).for_each(|(p, v)| *p *= v);
    }
    product
}

/// Gives both sides of each term the same norm.
fn balance(step: &mut Step, texels: usize) {
    let [left, right] = &mut step.tables;
    for (a, b) in left.chunks_exact_mut(texels).zip(right.chunks_exact_mut(texels)) {
        let norm = |table: &[f32]| table.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
        let ratio = (norm(b) / norm(a)).sqrt() as f32;
        if ratio.is_normal() {
            a.iter_mut().for_each(|v| *v *= ratio);
            b.iter_mut().for_each(|v| *v /= ratio);
        }
    }
}
