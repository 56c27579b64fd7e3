//! Chained matrix factorisation: the remainder of one factorisation is factored again over other directions.

use glam::Vec3;
use rayon::prelude::*;

use super::matrix::Matrix;
use super::tables::{Factored, Grid, ProductSum, Projection};
use super::{Factorisation, RESOLUTION, TERMS};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values};
use crate::progress::Progress;

/// # Model
/// f = F1(H, D) F2(light, view) F3(H, D) ..., each a sum of products of two tables. F1 is the best approximation of f;
/// F2 is factored from the quotient f / F1, evaluated over light and view; and so on. With an odd number of factors,
/// the first step is a table of H alone, the mean over D: three factors give g(H) p(light) q(view).
///
/// # Limits
/// A quotient is weighted by the square of the product so far, so that the error of f itself is minimised; without
/// weights, as published, quotients of dark pairs dominate the highlight and a step can increase the error. Tables of
/// later steps are positive.
///
/// # References
/// suykens2003 (section 4), lee2000 (the updates, here weighted)
pub(super) struct Cmf;

crate::params! {
    struct Options {
        resolution: usize => RESOLUTION,
        terms: usize => TERMS,
        /// Number of tables in the chain, for one term.
        factors: usize [2..=8] = 4,
    }
}

impl Factorisation for Cmf {
    fn name(&self) -> &'static str {
        "cmf"
    }

    fn doc(&self) -> &'static str {
        "Chained matrix factorisation, over half and difference vectors and over light and view in turn."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        let Options { resolution: size, terms, factors } = Options::from_values(values)?;
        let mut steps: Vec<ProductSum> = Vec::new();
        for k in 0..factors.div_ceil(2) {
            let projections = match k % 2 {
                0 => [Projection::Half, Projection::Difference],
                _ => [Projection::Light, Projection::View],
            };
            let matrix = Matrix::of(brdf, projections, size, progress)?;
            let step = match k {
                0 if factors % 2 == 1 => mean_over_columns(&matrix),
                0 => matrix.singular(terms)?,
                _ => {
                    let known = |wi, wo| steps.iter().map(|step| step.value(wi, wo)).product::<Vec3>().max(Vec3::ZERO);
                    quotient(&matrix, &Matrix::from_values(known, projections, size, progress)?, terms)
                }
            };
            steps.push(step);
        }
        Ok(Factored::Product(steps))
    }
}

/// Rounds of updates for a quotient.
const ROUNDS: usize = 40;

/// The positive tables whose sum of products, times `known`, is closest to `f`.
fn quotient(f: &Matrix, known: &Matrix, terms: usize) -> ProductSum {
    let n = f.size * f.size;
    let channel = |c: usize| weighted_terms(&f.channels[c], &known.channels[c], n, terms, ROUNDS);
    let found: Vec<_> = (0..3).into_par_iter().map(channel).collect();
    // three channels, in order
    let mut found = found.into_iter();
    f.step(std::array::from_fn(|_| found.next().unwrap_or_default()))
}

/// The positive columns and rows whose sum of products, times `known`, is closest to the matrix `f` with rows of `n`
/// numbers: for each term, a number per row and a number per column.
pub(crate) fn weighted_terms(f: &[f32], known: &[f32], n: usize, terms: usize, rounds: usize) -> Vec<[Vec<f32>; 2]> {
    // equal terms would stay equal, so each starts with its own ripple
    let start =
        |k: usize, i: usize| (1.0 + 0.1 * k as f32 * (i as f32 * (k as f32 + 0.37)).sin()) / (terms as f32).sqrt();
    let first = |len: usize| (0..terms).map(|k| (0..len).map(|i| start(k, i)).collect()).collect();
    let rows = f.len() / n;
    let (mut w, mut h): (Vec<Vec<f32>>, Vec<Vec<f32>>) = (first(rows), first(n));
    for round in 0..2 * rounds {
        let len = if round % 2 == 0 { n } else { rows };
        let (mut up, mut down) = (vec![vec![0.0f32; len]; terms], vec![vec![0.0f32; len]; terms]);
        for i in 0..rows {
            let (f, known) = (&f[i * n..(i + 1) * n], &known[i * n..(i + 1) * n]);
            for j in 0..n {
                let model: f32 = (0..terms).map(|k| w[k][i] * h[k][j]).sum();
                let (a, b) = (known[j] * f[j].max(0.0), known[j] * known[j] * model);
                for k in 0..terms {
                    let (at, factor) = if round % 2 == 0 { (j, w[k][i]) } else { (i, h[k][j]) };
                    up[k][at] += factor * a;
                    down[k][at] += factor * b;
                }
            }
        }
        let tables = if round % 2 == 0 { &mut h } else { &mut w };
        for (table, (up, down)) in tables.iter_mut().zip(up.iter().zip(&down)) {
            for (value, (up, down)) in table.iter_mut().zip(up.iter().zip(down)) {
                // leave values unchanged where nothing is known
                if *down > 0.0 {
                    *value *= up / down;
                }
            }
        }
    }
    w.into_iter().zip(h).map(|(a, b)| [a, b]).collect()
}

/// A table over the first projection only.
fn mean_over_columns(matrix: &Matrix) -> ProductSum {
    let n = matrix.size * matrix.size;
    let mean = |c: usize, row: usize| matrix.channels[c][row * n..(row + 1) * n].iter().sum::<f32>() / n as f32;
    let texels = (0..n).map(|row| Vec3::new(mean(0, row), mean(1, row), mean(2, row))).collect();
    // interpolation needs at least two texels per side
    let one = Grid::filled(2, Vec3::ONE);
    ProductSum { projections: matrix.projections, terms: vec![[Grid { size: matrix.size, texels }, one]] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quotient_that_is_a_product_is_recovered() {
        let n = 16;
        let known: Vec<f32> = (0..n * n).map(|i| 1.0 + (i as f32 * 0.7).sin().powi(2)).collect();
        let (a, b) = (|i: usize| 1.0 + 0.1 * i as f32, |j: usize| 2.0 / (1.0 + j as f32));
        let f: Vec<f32> = known.iter().enumerate().map(|(i, k)| k * a(i / n) * b(i % n)).collect();
        let terms = weighted_terms(&f, &known, n, 1, ROUNDS);
        for (i, value) in f.iter().enumerate() {
            let found = known[i] * terms[0][0][i / n] * terms[0][1][i % n];
            assert!((found / value - 1.0).abs() < 1e-4, "{i}: {found} {value}");
        }
    }
}
