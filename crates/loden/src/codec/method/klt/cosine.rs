//! Discrete cosine transform of image blocks.
//!
//! # Model
//! Type II, orthonormal, separable, in blocks of [`SIDE`] x [`SIDE`]; blocks at the right and lower edges are
//! smaller. The coefficient of frequency (v, u) of the block at (y, x) is stored at (y + v, x + u).

use std::collections::BTreeMap;

/// The side of a block.
pub const SIDE: usize = 32;

/// Start and size of the blocks along one side of the image.
pub fn blocks(side: usize) -> impl Iterator<Item = (usize, usize)> + Clone {
    (0..side).step_by(SIDE).map(move |begin| (begin, SIDE.min(side - begin)))
}

/// Transforms for one image size.
#[derive(Debug)]
pub struct Cosine {
    width: usize,
    height: usize,
    /// Transform matrices by block size: (frequency, place).
    matrices: BTreeMap<usize, Vec<f32>>,
}

impl Cosine {
    /// Prepares transforms of `width` x `height` images.
    pub fn new(width: usize, height: usize) -> Self {
        let sizes = blocks(width).chain(blocks(height)).map(|(_, size)| size);
        Self { width, height, matrices: sizes.map(|size| (size, matrix(size))).collect() }
    }

    /// Transforms pixels (y, x) to coefficients, in place.
    pub fn forward(&self, plane: &mut [f32]) {
        self.apply(plane, |matrix, from, to| {
            for (to, row) in to.iter_mut().zip(matrix.chunks_exact(from.len())) {
                *to = row.iter().zip(from.iter()).map(|(m, v)| m * v).sum();
            }
        });
    }

    /// Transforms coefficients to pixels, in place.
    pub fn inverse(&self, plane: &mut [f32]) {
        self.apply(plane, |matrix, from, to| {
            to.fill(0.0);
            for (&v, row) in from.iter().zip(matrix.chunks_exact(from.len())).filter(|(v, _)| **v != 0.0) {
                to.iter_mut().zip(row).for_each(|(to, m)| *to += m * v);
            }
        });
    }

    /// Transforms the rows, then the columns of each block.
    fn apply(&self, plane: &mut [f32], turn: impl Fn(&[f32], &[f32], &mut [f32])) {
        let (mut from, mut to) = ([0.0; SIDE], [0.0; SIDE]);
        for row in plane.chunks_exact_mut(self.width) {
            for (x, size) in blocks(self.width) {
                from[..size].copy_from_slice(&row[x..x + size]);
                turn(&self.matrices[&size], &from[..size], &mut row[x..x + size]);
            }
        }
        for (y, size) in blocks(self.height) {
            for x in 0..self.width {
                for (i, from) in from[..size].iter_mut().enumerate() {
                    *from = plane[(y + i) * self.width + x];
                }
                turn(&self.matrices[&size], &from[..size], &mut to[..size]);
                for (i, to) in to[..size].iter().enumerate() {
                    plane[(y + i) * self.width + x] = *to;
                }
            }
        }
    }
}

fn matrix(size: usize) -> Vec<f32> {
    let n = size as f64;
    let entry = |i: usize| {
        let (frequency, place) = ((i / size) as f64, (i % size) as f64 + 0.5);
        let scale = if i < size { 1.0 } else { 2.0 };
        ((scale / n).sqrt() * (std::f64::consts::PI * frequency * place / n).cos()) as f32
    };
    (0..size * size).map(entry).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_orthonormal_and_inverts_for_any_size() {
        for (width, height) in [(1, 1), (5, 40), (64, 33), (95, 2)] {
            let cosine = Cosine::new(width, height);
            let plane: Vec<f32> = (0..width * height).map(|i| ((i * i * 7919) % 1009) as f32 / 1009.0 - 0.3).collect();
            let mut turned = plane.clone();
            cosine.forward(&mut turned);
            let energy = |v: &[f32]| v.iter().map(|v| f64::from(v * v)).sum::<f64>();
            assert!((energy(&plane) - energy(&turned)).abs() < 1e-5 * energy(&plane));
            cosine.inverse(&mut turned);
            assert!(plane.iter().zip(&turned).all(|(a, b)| (a - b).abs() < 1e-5), "{width} {height}");
        }
    }

    #[test]
    fn a_constant_block_has_one_coefficient() {
        let mut plane = vec![0.5; SIDE * SIDE];
        Cosine::new(SIDE, SIDE).forward(&mut plane);
        assert!((plane[0] - 0.5 * SIDE as f32).abs() < 1e-4 && plane[1..].iter().all(|v| v.abs() < 1e-5));
    }
}
