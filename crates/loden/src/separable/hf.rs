//! Homomorphic factorisation: a product of any number of positive tables, solved as a linear system in the logarithm.

use glam::{Vec2, Vec3};

use super::tables::{Factored, Grid, Projection};
use super::{Factorisation, RESOLUTION, pairs};
use crate::material::Material;
use crate::params::{Param, Params, Values, YesNo};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// # Model
/// log((f + e A) / A) is the sum over the factors of a table of their projection, with e = 1e-5 and A the mean of f.
/// Every sample is an equation in the four texels around each of its projections; further equations ask for a vanishing
/// Laplacian of every table, with the weight `smoothness`. Conjugate gradients solve all of them in the least-squares
/// sense. With `shared`, light and view use the same table, which makes the result reciprocal.
///
/// # Limits
/// The error is relative, so highlights count no more than dark regions. There are 12 samples per unknown, spread
/// evenly over pairs of directions up to 80 degrees from the normal.
///
/// # References
/// mccool2001 (eq. 5-12)
pub(super) struct Hf;

/// Added to f, relative to its mean, to keep the logarithm of black finite.
const FLOOR: f32 = 1e-5;

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
        let Options { resolution: size, projections, shared, smoothness } = Options::from_values(values)?;
        let factors = projections.factors(shared == YesNo::Yes);
        let count = 1 + factors.iter().map(|f| f.1).max().unwrap_or(0);
        let samples: Vec<(Vec3, Vec3, Vec3)> =
            pairs(12 * count * size * size).map(|(wi, wo)| (wi, wo, brdf.eval(Vec2::ZERO, wi, wo))).collect();
        if samples.iter().any(|s| !s.2.is_finite()) {
            return Err(Error::non_finite("the BRDF"));
        }
        let mean = samples.iter().map(|s| s.2).sum::<Vec3>() / samples.len() as f32;
        let scale = mean.max(Vec3::splat(1e-12));
        let mut system = System::new(size, count, smoothness);
        for (wi, wo, _) in &samples {
            system.add(factors.iter().map(|&(projection, table)| (table, projection.of(*wi, *wo))));
        }
        let task = Task::new(progress, "factor", 3);
        let mut tables = vec![Grid::filled(size, Vec3::ZERO); count];
        for c in 0..3 {
            let right: Vec<f32> = samples.iter().map(|s| (s.2[c].max(0.0) / scale[c] + FLOOR).ln()).collect();
            let found = system.solve(&right);
            for (grid, part) in tables.iter_mut().zip(found.chunks_exact(size * size)) {
                grid.texels.iter_mut().zip(part).for_each(|(texel, v)| texel[c] = *v);
            }
            task.advance(1)?;
        }
        Ok(Factored::Exponential { scale, floor: FLOOR, factors, tables })
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

/// Sparse equations in the texels of all tables.
struct System {
    size: usize,
    tables: usize,
    /// (unknown, weight) of all equations, one after the other.
    weights: Vec<(u32, f32)>,
    /// Weights per equation.
    width: usize,
    smoothness: f32,
}

/// Iterations of conjugate gradients.
const ITERATIONS: usize = 120;

impl System {
    fn new(size: usize, tables: usize, smoothness: f32) -> Self {
        Self { size, tables, weights: Vec::new(), width: 0, smoothness }
    }

    fn add(&mut self, directions: impl Iterator<Item = (usize, Vec3)>) {
        let before = self.weights.len();
        for (table, w) in directions {
            let first = table * self.size * self.size;
            self.weights.extend(Grid::stencil(self.size, w).map(|(texel, weight)| ((first + texel) as u32, weight)));
        }
        self.width = self.weights.len() - before;
    }

    /// The left-hand sides of all equations: first the samples, then the Laplacian at every texel.
    fn apply(&self, x: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let rows = self.weights.chunks_exact(self.width);
        let samples = rows.map(|row| row.iter().map(|&(i, w)| w * x[i as usize]).sum()).collect();
        let smooth = (0..x.len()).map(|i| self.smoothness * self.neighbours(i).map(|j| x[j] - x[i]).sum::<f32>());
        (samples, smooth.collect())
    }

    fn apply_transposed(&self, samples: &[f32], smooth: &[f32]) -> Vec<f32> {
        let mut sum = vec![0.0f32; smooth.len()];
        for (row, value) in self.weights.chunks_exact(self.width).zip(samples) {
            row.iter().for_each(|&(i, w)| sum[i as usize] += w * value);
        }
        for (i, value) in smooth.iter().enumerate() {
            for j in self.neighbours(i) {
                sum[j] += self.smoothness * value;
                sum[i] -= self.smoothness * value;
            }
        }
        sum
    }

    fn neighbours(&self, i: usize) -> impl Iterator<Item = usize> + use<> {
        let size = self.size;
        let (table, texel) = (i / (size * size), i % (size * size));
        let (x, y) = (texel % size, texel / size);
        let steps = [
            (x > 0, i.wrapping_sub(1)),
            (x + 1 < size, i + 1),
            (y > 0, i.wrapping_sub(size)),
            (y + 1 < size, i + size),
        ];
        debug_assert!(table * size * size <= i);
        steps.into_iter().filter(|(inside, _)| *inside).map(|(_, j)| j)
    }

    /// Conjugate gradients on the normal equations, which are never formed.
    fn solve(&self, right: &[f32]) -> Vec<f32> {
        let n = self.tables * self.size * self.size;
        let square = |v: &[f32]| v.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
        let mut x = vec![0.0f32; n];
        let (mut samples, mut smooth) = (right.to_vec(), vec![0.0f32; n]);
        let mut gradient = self.apply_transposed(&samples, &smooth);
        let mut direction = gradient.clone();
        let mut norm = square(&gradient);
        let target = norm * 1e-12;
        for _ in 0..ITERATIONS {
            if norm <= target || norm == 0.0 {
                break;
            }
            let (a, b) = self.apply(&direction);
            let alpha = (norm / (square(&a) + square(&b)).max(f64::MIN_POSITIVE)) as f32;
            x.iter_mut().zip(&direction).for_each(|(x, d)| *x += alpha * d);
            samples.iter_mut().zip(&a).for_each(|(r, a)| *r -= alpha * a);
            smooth.iter_mut().zip(&b).for_each(|(r, b)| *r -= alpha * b);
            gradient = self.apply_transposed(&samples, &smooth);
            let next = square(&gradient);
            let beta = (next / norm) as f32;
            norm = next;
            direction.iter_mut().zip(&gradient).for_each(|(d, g)| *d = g + beta * *d);
        }
        x
    }
}
