//! Non-negative matrix factorisation: a sum of products of positive tables.

use super::matrix::Matrix;
use super::tables::Factored;
use super::{Factorisation, Sum};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values};
use crate::progress::{Progress, Task};

/// # Model
/// F = W H with non-negative entries. The squared error is reduced by the updates H <- H (W^T F) / (W^T W H) and W <- W
/// (F H^T) / (W H H^T), from fixed pseudo-random tables.
///
/// # Limits
/// Converges to a local optimum only.
///
/// # References
/// lee1999, lee2000 (the updates, theorem 1)
pub(super) struct Nmf;

crate::params! {
    struct Options {
        sum: Sum,
        /// Rounds of updates.
        iterations: usize [1..=10_000] = 150,
    }
}

impl Factorisation for Nmf {
    fn name(&self) -> &'static str {
        "nmf"
    }

    fn doc(&self) -> &'static str {
        "Non-negative matrix factorisation: a sum of products of positive tables."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        let Options { sum, iterations: rounds } = Options::from_values(values)?;
        let Sum { resolution: size, terms, parametrisation } = sum;
        let matrix = Matrix::of(brdf, parametrisation.projections(), size, progress)?;
        let task = Task::new(progress, "factor", 3 * rounds as u64);
        let mut channels = [const { Vec::new() }; 3];
        for (channel, found) in matrix.channels.iter().zip(&mut channels) {
            *found = positive_terms(channel, size * size, terms, rounds, &task)?;
        }
        Ok(Factored::Product(vec![matrix.step(channels)]))
    }
}

fn positive_terms(f: &[f32], n: usize, terms: usize, rounds: usize, task: &Task) -> Result<Vec<[Vec<f32>; 2]>> {
    // start between 0.5 and 1.5 times the scale of the matrix; column k of w is w[k]
    let scale = (f.iter().map(|v| v.max(0.0)).sum::<f32>() / (n * n * terms) as f32).sqrt();
    let mut state = 1u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        scale * (0.5 + (state >> 8) as f32 / (1u32 << 24) as f32)
    };
    let mut w: Vec<Vec<f32>> = (0..terms).map(|_| (0..n).map(|_| noise()).collect()).collect();
    let mut h = w.clone();
    h.iter_mut().flatten().for_each(|v| *v = noise());
    for _ in 0..rounds {
        let projected: Vec<Vec<f32>> = w.iter().map(|column| weighted_rows(f, n, column)).collect();
        update(&mut h, &projected, &w);
        let projected: Vec<Vec<f32>> = h.iter().map(|row| dot_rows(f, n, row)).collect();
        update(&mut w, &projected, &h);
        task.advance(1)?;
    }
    Ok(w.into_iter().zip(h).map(|(a, b)| [a, b]).collect())
}

/// x <- x projected / (other^T other x), elementwise.
fn update(x: &mut [Vec<f32>], projected: &[Vec<f32>], other: &[Vec<f32>]) {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f32>();
    let gram: Vec<Vec<f32>> = other.iter().map(|a| other.iter().map(|b| dot(a, b)).collect()).collect();
    let before = x.to_vec();
    for (k, row) in x.iter_mut().enumerate() {
        for (i, value) in row.iter_mut().enumerate() {
            let whole: f32 = (0..before.len()).map(|j| gram[k][j] * before[j][i]).sum();
            *value *= projected[k][i].max(0.0) / whole.max(1e-30);
        }
    }
}

/// The weighted sum of the rows of `f`.
fn weighted_rows(f: &[f32], n: usize, weights: &[f32]) -> Vec<f32> {
    let mut sum = vec![0.0; n];
    for (row, weight) in f.chunks_exact(n).zip(weights) {
        sum.iter_mut().zip(row).for_each(|(s, v)| *s += weight * v);
    }
    sum
}

/// The inner product of every row of `f` with `vector`.
fn dot_rows(f: &[f32], n: usize, vector: &[f32]) -> Vec<f32> {
    f.chunks_exact(n).map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum()).collect()
}
