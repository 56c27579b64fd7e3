//! A BRDF sampled as a matrix over two projections, and its low-rank approximations.

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::tables::{Grid, ProductSum, Projection, from_half_difference, raised};
use super::{NOISE, relative};
use crate::factor::linalg;
use crate::material::Material;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// One matrix per channel: rows are texels of the first projection, columns texels of the second.
pub(super) struct Matrix {
    pub size: usize,
    pub projections: [Projection; 2],
    /// Per channel, row by row: (texel, texel). In units of `scale`, so that products of small values do not vanish.
    pub channels: [Vec<f32>; 3],
    /// The mean magnitude of each channel.
    scale: Vec3,
}

impl Matrix {
    /// Evaluates the BRDF at the centres of all pairs of texels.
    pub(super) fn of(
        brdf: &dyn Material,
        projections: [Projection; 2],
        size: usize,
        progress: &dyn Progress,
    ) -> Result<Self> {
        Self::from_values(|wi, wo| brdf.eval(Vec2::ZERO, wi, wo), projections, size, progress)
    }

    pub(super) fn from_values(
        value: impl Fn(Vec3, Vec3) -> Vec3 + Sync,
        projections: [Projection; 2],
        size: usize,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let n = size * size;
        let task = Task::new(progress, "evaluate", n as u64);
        let row = |row: usize| {
            let x = Grid::direction(size, row);
            let values = (0..n).map(|column| {
                let (wi, wo) = pair(projections, x, Grid::direction(size, column));
                value(wi, wo)
            });
            let values: Vec<Vec3> = values.collect();
            task.advance(1)?;
            Ok(values)
        };
        let rows: Vec<Vec<Vec3>> = (0..n).into_par_iter().map(row).collect::<Result<_>>()?;
        if rows.iter().flatten().any(|v| !v.is_finite()) {
            return Err(Error::non_finite("the BRDF"));
        }
        let sum: DVec3 = rows.iter().flatten().map(|v| v.abs().as_dvec3()).sum();
        let scale = (sum / (n * n) as f64).as_vec3();
        let channels = [0, 1, 2].map(|c| rows.iter().flatten().map(|v| relative(v[c], scale[c])).collect());
        Ok(Self { size, projections, channels, scale })
    }

    /// A channel in units of `scale`, divided by what is `known` of it. A divisor below the noise is replaced by the noise.
    pub(super) fn quotient(&self, channel: usize, scale: f32, known: impl Fn(Vec3, Vec3) -> f32) -> Vec<f32> {
        let unit = relative(self.scale[channel], scale);
        let n = self.size * self.size;
        let directions: Vec<Vec3> = (0..n).map(|i| Grid::direction(self.size, i)).collect();
        let divided = |(i, value): (usize, &f32)| {
            let (wi, wo) = pair(self.projections, directions[i / n], directions[i % n]);
            unit * value.max(0.0) / known(wi, wo).max(NOISE)
        };
        self.channels[channel].iter().enumerate().map(divided).collect()
    }

    /// Builds the sum of products from the columns of each channel: (left, right) of each term.
    pub(super) fn step(&self, channels: [Vec<[Vec<f32>; 2]>; 3]) -> ProductSum {
        let n = self.size * self.size;
        let terms = channels.iter().map(Vec::len).max().unwrap_or(0);
        let grid = |term: usize, side: usize| {
            let value = |c: usize, i: usize| channels[c].get(term).map_or(0.0, |pair| pair[side][i]);
            let unit = if side == 0 { self.scale } else { Vec3::ONE };
            let texels = (0..n).map(|i| Vec3::new(value(0, i), value(1, i), value(2, i)) * unit).collect();
            Grid { size: self.size, texels }
        };
        ProductSum { projections: self.projections, terms: (0..terms).map(|t| [grid(t, 0), grid(t, 1)]).collect() }
    }

    /// The best approximation of rank `terms` per channel: U and S V^T of the singular value decomposition.
    pub(super) fn singular(&self, terms: usize) -> Result<ProductSum> {
        let n = self.size * self.size;
        let mut channels = [const { Vec::new() }; 3];
        for (channel, terms_of) in self.channels.iter().zip(&mut channels) {
            *terms_of = singular(channel, n, terms.min(n))?;
        }
        Ok(self.step(channels))
    }
}

/// The light and the viewer that belong to the directions of two projections.
fn pair(projections: [Projection; 2], x: Vec3, y: Vec3) -> (Vec3, Vec3) {
    match projections {
        [Projection::Half, _] => from_half_difference(x, y),
        _ => (raised(x), raised(y)),
    }
}

/// The mean of each row of `n` numbers.
pub(super) fn row_means(matrix: &[f32], n: usize) -> Vec<f32> {
    matrix.chunks_exact(n).map(|row| row.iter().sum::<f32>() / n as f32).collect()
}

/// The best approximation of rank 1: a column and a row.
pub(super) fn singular_pair(matrix: &[f32], n: usize) -> Result<[Vec<f32>; 2]> {
    Ok(singular(matrix, n, 1)?.pop().unwrap_or_default())
}

fn singular(matrix: &[f32], n: usize, terms: usize) -> Result<Vec<[Vec<f32>; 2]>> {
    let (mut scratch, mut gram) = (vec![0.0f32; n * n], vec![0.0f64; n * n]);
    linalg::add_row_products(matrix, n, &mut scratch, &mut gram);
    for i in 0..n {
        for j in 0..i {
            gram[j * n + i] = gram[i * n + j];
        }
    }
    let eigen = linalg::largest_eigenpairs(&gram, n, terms);
    let eigen = eigen.ok_or_else(|| Error::not_converged("the decomposition of the BRDF"))?;
    let term = |left: &[f64]| {
        let mut right = vec![0.0f64; n];
        for (row, u) in matrix.chunks_exact(n).zip(left) {
            right.iter_mut().zip(row).for_each(|(r, v)| *r += u * f64::from(*v));
        }
        [left.iter().map(|v| *v as f32).collect(), right.iter().map(|v| *v as f32).collect()]
    };
    Ok(eigen.vectors.chunks_exact(n).map(term).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_of_low_rank_is_reproduced() {
        let n = 25;
        let a = |i: usize, k: usize| ((i * (k + 2)) as f32 * 0.7).sin() + 1.5;
        let matrix: Vec<f32> = (0..n * n).map(|i| (0..3).map(|k| a(i / n, k) * a(i % n, k + 3)).sum()).collect();
        let terms = singular(&matrix, n, 3).unwrap();
        for (i, value) in matrix.iter().enumerate() {
            let found: f32 = terms.iter().map(|[l, r]| l[i / n] * r[i % n]).sum();
            assert!((found - value).abs() < 2e-3 * value.abs().max(1.0), "{i}: {found} {value}");
        }
    }
}
