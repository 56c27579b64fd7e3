//! Components as functions of the angles, rotated so that few numbers matter.
//!
//! # Model
//! A slice is one component as a matrix (view, light) per channel. Channels are rotated to luminance and two
//! differences; views and lights are rotated to the principal directions of all slices together (a Tucker
//! decomposition with given texel factors).
//!
//! # References
//! delathauwer2000, ballester2020

use half::f16;

use crate::factor::linalg::{Rows, add_product, add_product_transposed, largest_eigenpairs};

/// Rows: luminance, red minus blue, green minus both; orthonormal.
fn opponents() -> [[f32; 3]; 3] {
    let (a, b, c) = (1.0 / 3.0f32.sqrt(), 1.0 / 2.0f32.sqrt(), 1.0 / 6.0f32.sqrt());
    [[a, a, a], [b, 0.0, -b], [-c, 2.0 * c, -c]]
}

/// Orthonormal rotations of views and lights, (direction, kept direction), as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Turns {
    /// Rotation of the views.
    pub views: Vec<f16>,
    /// Rotation of the lights.
    pub lights: Vec<f16>,
}

/// (slice, view, light, rgb) to (slice, channel, view, light).
pub fn channels_first(slices: &[f32], pairs: usize) -> Vec<f32> {
    let mut out = vec![0.0; slices.len()];
    for (slice, out) in slices.chunks_exact(3 * pairs).zip(out.chunks_exact_mut(3 * pairs)) {
        for (out, row) in out.chunks_exact_mut(pairs).zip(opponents()) {
            for (out, rgb) in out.iter_mut().zip(slice.chunks_exact(3)) {
                *out = row.iter().zip(rgb).map(|(a, b)| a * b).sum();
            }
        }
    }
    out
}

/// The inverse of [`channels_first`].
pub fn channels_last(slices: &[f32], pairs: usize) -> Vec<f32> {
    let mut out = vec![0.0; slices.len()];
    for (slice, out) in slices.chunks_exact(3 * pairs).zip(out.chunks_exact_mut(3 * pairs)) {
        for (values, row) in slice.chunks_exact(pairs).zip(opponents()) {
            for (rgb, value) in out.chunks_exact_mut(3).zip(values) {
                rgb.iter_mut().zip(row).for_each(|(out, factor)| *out += factor * value);
            }
        }
    }
    out
}

impl Turns {
    /// All principal directions of a sequence of matrices (view, light), most important first; `None` if a number is
    /// not finite.
    pub fn new(matrices: &[f32], views: usize, lights: usize) -> Option<Self> {
        let (mut of_views, mut of_lights) = (vec![0.0; views * views], vec![0.0; lights * lights]);
        for matrix in matrices.chunks_exact(views * lights) {
            let transposed = transposed(matrix, lights);
            add_product_transposed(Rows::new(matrix, lights), Rows::new(matrix, lights), &mut of_views);
            add_product_transposed(Rows::new(&transposed, views), Rows::new(&transposed, views), &mut of_lights);
        }
        let turn = |gram: &[f32], n: usize| {
            let gram: Vec<f64> = gram.iter().map(|&v| v.into()).collect();
            let eigen = largest_eigenpairs(&gram, n, n)?;
            Some(eigen.vectors.iter().map(|&v| f16::from_f64(v)).collect())
        };
        Some(Self { views: turn(&of_views, views)?, lights: turn(&of_lights, lights)? })
    }

    /// Matrices (view, light) in rotated directions.
    pub fn forward(&self, matrices: &[f32], views: usize, lights: usize) -> Vec<f32> {
        let (turn_views, turn_lights) = (single(&self.views), single(&self.lights));
        turned(matrices, [views, lights], &turn_views, &turn_lights)
    }

    /// The inverse of [`Turns::forward`], using the kept directions.
    pub fn inverse(&self, matrices: &[f32], views: usize, lights: usize) -> Vec<f32> {
        let kept = [self.views.len() / views, self.lights.len() / lights];
        let turn_views = transposed(&single(&self.views), views);
        let turn_lights = transposed(&single(&self.lights), lights);
        turned(matrices, kept, &turn_views, &turn_lights)
    }
}

fn single(values: &[f16]) -> Vec<f32> {
    values.iter().map(|v| v.to_f32()).collect()
}

/// Multiplies each matrix of `shape` by `left` from the left and by the transpose of `right` from the right.
fn turned(matrices: &[f32], [rows, columns]: [usize; 2], left: &[f32], right: &[f32]) -> Vec<f32> {
    let (out_rows, out_columns) = (left.len() / rows, right.len() / columns);
    let mut out = vec![0.0; matrices.len() / (rows * columns) * out_rows * out_columns];
    let mut half = vec![0.0; out_rows * columns];
    for (matrix, out) in matrices.chunks_exact(rows * columns).zip(out.chunks_exact_mut(out_rows * out_columns)) {
        half.fill(0.0);
        add_product(Rows::new(left, rows), Rows::new(matrix, columns), &mut half);
        add_product_transposed(Rows::new(&half, columns), Rows::new(right, columns), out);
    }
    out
}

fn transposed(matrix: &[f32], columns: usize) -> Vec<f32> {
    (0..columns).flat_map(|x| matrix.iter().skip(x).step_by(columns).copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_there_and_back_changes_nothing_and_gathers_the_energy() {
        let (slices, views, lights) = (4, 5, 7);
        let value = |i: usize| ((i % 7) as f32 * 0.3).sin() * ((i / 21) as f32 * 0.2).cos() + (i % 3) as f32 * 0.01;
        let original: Vec<f32> = (0..slices * 3 * views * lights).map(value).collect();
        let matrices = channels_first(&original, views * lights);
        let turns = Turns::new(&matrices, views, lights).unwrap();
        let core = turns.forward(&matrices, views, lights);
        let energy = |v: &[f32]| v.iter().map(|v| v * v).sum::<f32>();
        assert!((energy(&core) / energy(&original) - 1.0).abs() < 2e-3);
        let first: f32 = core.chunks_exact(lights).step_by(views).map(energy).sum();
        assert!(first > 1.5 / views as f32 * energy(&core), "the first view's direction holds only {first}");
        let back = channels_last(&turns.inverse(&core, views, lights), views * lights);
        assert!(original.iter().zip(&back).all(|(a, b)| (a - b).abs() < 2e-3));
    }
}
