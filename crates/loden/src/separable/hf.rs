//! Homomorphic factorisation: a product of any number of positive tables, solved as a linear system in the logarithm.

use glam::Vec3;
use rayon::prelude::*;

use super::sparse::{Equations, Penalty};
use super::tables::{Factored, Grid, Projection};
use super::{Evaluated, Factorisation, METRIC, Metric, NOISE, RESOLUTION};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values, YesNo};
use crate::progress::{Progress, Task};

/// # Model
/// log((f + e A) / A) is the sum over the factors of a table of their projection, with e = 1/100 and A the mean of f.
/// Every sample is an equation in the four texels around each of its projections; further equations ask for a vanishing
/// Laplacian of every table, with the weight `smoothness`. Conjugate gradients solve all of them in the least-squares
/// sense. With `shared`, light and view use the same table, which makes the result reciprocal. The published e is 1e-5: values
/// that are nothing but noise near 0 then have the largest logarithms of all and rule the tables.
///
/// The error of the logarithm is relative, so highlights count no more than dark regions. With the linear metric,
/// Gauss-Newton steps then lower the squared error of f cos, from that solution or from the mean of f, whichever is
/// closer: the result is never worse than the mean.
///
/// # Limits
/// There are 12 samples per unknown and at least 60 000, spread evenly over pairs of directions up to 80 degrees from the
/// normal.
///
/// # References
/// mccool2001 (eq. 5-12); the refinement is our addition
pub(super) struct Hf;

/// The largest logarithm of a value, relative to the mean.
const LARGEST: f32 = 40.0;

crate::words! {
    enum Projections {
        LightHalfView = "light-half-view",
        LightView = "light-view",
        HalfDifference = "half-difference",
        LightHalfDifferenceView = "light-half-difference-view",
    }
}

crate::params! {
    struct Options {
        resolution: usize => RESOLUTION,
        /// Directions that the tables depend on, one per table.
        projections: Projections = "light-half-view",
        /// Whether light and view use the same table, which makes the result reciprocal.
        shared: YesNo = "yes",
        /// Weight of the equations that smooth the tables.
        smoothness: f32 [0.0..=100.0] = 0.05,
        metric: Metric => METRIC,
    }
}

impl Factorisation for Hf {
    fn name(&self) -> &'static str {
        "hf"
    }

    fn doc(&self) -> &'static str {
        "Homomorphic factorisation: a product of positive tables, solved in the logarithm."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        let Options { resolution: size, projections, shared, smoothness, metric } = Options::from_values(values)?;
        let factors = projections.factors(shared == YesNo::Yes);
        let count = 1 + factors.iter().map(|f| f.1).max().unwrap_or(0);
        let Evaluated { pairs, scale, relative } = Evaluated::at(brdf, SAMPLES.max(12 * count * size * size))?;
        let stencils = |&(wi, wo): &(Vec3, Vec3)| {
            let table = |&(projection, table): &(Projection, usize)| {
                let first = table * size * size;
                Grid::stencil(size, projection.of(wi, wo)).map(|(texel, weight)| ((first + texel) as u32, weight))
            };
            factors.iter().flat_map(table).collect::<Vec<_>>()
        };
        let weights: Vec<(u32, f32)> = pairs.iter().flat_map(stencils).collect();
        let cosines: Vec<f32> = pairs.iter().map(|(wi, _)| wi.z).collect();
        let penalty = Penalty { size, smoothness, damping: 0.0 };
        let system = System { weights, width: 4 * factors.len(), unknowns: count * size * size, cosines, penalty };
        let task = Task::new(progress, "factor", 3);
        let channel = |c: usize| {
            let values: Vec<f32> = relative.iter().map(|v| v[c]).collect();
            let logarithms = system.logarithms(&values);
            task.advance(1)?;
            Ok(if metric == Metric::Log { logarithms } else { system.refined(&values, logarithms) })
        };
        let found: Vec<Vec<f32>> = (0..3).into_par_iter().map(channel).collect::<Result<_>>()?;
        let texel = |i: usize| Vec3::new(found[0][i], found[1][i], found[2][i]);
        let texels: Vec<Vec3> = (0..count * size * size).map(texel).collect();
        let tables = texels.chunks_exact(size * size).map(|texels| Grid { size, texels: texels.to_vec() }).collect();
        Ok(Factored::Exponential { scale, floor: NOISE, factors, tables })
    }
}

impl Projections {
    /// The projections, and the index of the table of each.
    fn factors(self, shared: bool) -> Vec<(Projection, usize)> {
        use Projection::{Difference, Half, Light, View};
        let view = if shared { 0 } else { 1 };
        match self {
            Self::LightHalfView if shared => vec![(Light, 0), (Half, 1), (View, 0)],
            Self::LightHalfView => vec![(Light, 0), (Half, 1), (View, 2)],
            Self::LightView => vec![(Light, 0), (View, view)],
            Self::HalfDifference => vec![(Half, 0), (Difference, 1)],
            Self::LightHalfDifferenceView if shared => vec![(Light, 0), (Half, 1), (Difference, 2), (View, 0)],
            Self::LightHalfDifferenceView => vec![(Light, 0), (Half, 1), (Difference, 2), (View, 3)],
        }
    }
}

/// The equations of all samples in the logarithms of the texels of all tables.
struct System {
    /// As in [`Equations`].
    weights: Vec<(u32, f32)>,
    width: usize,
    unknowns: usize,
    /// The cosine of the light of each sample.
    cosines: Vec<f32>,
    penalty: Penalty,
}

/// Least number of samples.
const SAMPLES: usize = 60_000;
/// Iterations of conjugate gradients.
const ITERATIONS: usize = 120;
/// Gauss-Newton steps of the refinement, and conjugate gradients in each.
const STEPS: usize = 25;
const STEP_ITERATIONS: usize = 30;
/// Relative decrease of the squared error in a step, below which the refinement ends.
const SETTLED: f64 = 1e-4;
/// Halvings of a step that does not lower the error.
const HALVINGS: usize = 8;

impl System {
    /// The equations, each multiplied by a number.
    fn scaled(&self, by: impl Fn(usize) -> f32) -> Equations {
        let rows = self.weights.chunks_exact(self.width).enumerate();
        let weights = rows.flat_map(|(i, row)| {
            let by = by(i);
            row.iter().map(move |&(texel, weight)| (texel, by * weight))
        });
        Equations { weights: weights.collect(), width: self.width, unknowns: self.unknowns }
    }

    /// The solution in the logarithm.
    fn logarithms(&self, values: &[f32]) -> Vec<f32> {
        let right: Vec<f32> = values.iter().map(|v| (v + NOISE).ln()).collect();
        self.scaled(|_| 1.0).change(&right, &vec![0.0; self.unknowns], self.penalty, ITERATIONS)
    }

    /// The values that tables give.
    fn values(&self, tables: &[f32]) -> Vec<f32> {
        let sums = self
            .weights
            .chunks_exact(self.width)
            .map(|row| row.iter().map(|&(i, w)| w * tables[i as usize]).sum::<f32>());
        sums.map(|sum| sum.min(LARGEST).exp()).collect()
    }

    /// The squared error of f cos, and that of smoothness.
    fn error(&self, wanted: &[f32], tables: &[f32]) -> f64 {
        let found = self.values(tables);
        let distances = found.iter().zip(wanted).zip(&self.cosines);
        let square = |v: f32| f64::from(v).powi(2);
        let rough: f64 = self.penalty.roughness(tables).into_iter().map(square).sum();
        distances.map(|((a, b), cosine)| square(cosine * (a - b - NOISE))).sum::<f64>() + rough
    }

    /// Lowers the error of f cos from the solution in the logarithm, or from the mean if that is closer.
    fn refined(&self, values: &[f32], logarithms: Vec<f32>) -> Vec<f32> {
        let level = vec![0.0; self.unknowns];
        let (mut tables, mut error) = (logarithms, f64::INFINITY);
        let of_logarithms = self.error(values, &tables);
        if of_logarithms.is_finite() {
            error = of_logarithms;
        }
        if self.error(values, &level) < error {
            (error, tables) = (self.error(values, &level), level);
        }
        for _ in 0..STEPS {
            let before = error;
            let found = self.values(&tables);
            let equations = self.scaled(|i| self.cosines[i] * found[i]);
            let here = equations.apply(&tables);
            let target = |i: usize| here[i] + self.cosines[i] * (values[i] + NOISE - found[i]);
            let right: Vec<f32> = (0..values.len()).map(target).collect();
            let change = equations.change(&right, &tables, self.penalty, STEP_ITERATIONS);
            for halving in 0..=HALVINGS {
                let share = 0.5f32.powi(halving as i32);
                let moved: Vec<f32> = tables.iter().zip(&change).map(|(x, d)| x + share * d).collect();
                let found = self.error(values, &moved);
                if found < error {
                    (error, tables) = (found, moved);
                    break;
                }
            }
            if error >= (1.0 - SETTLED) * before {
                break;
            }
        }
        tables
    }
}
