//! Dense linear algebra; the only file that names the linear-algebra crate.

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::solvers::Solve;
use faer::{Accum, Mat, MatRef, Par, Side};
use rayon::prelude::*;

/// Eigenpairs of a symmetric matrix, largest eigenvalue first.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigen {
    /// Eigenvalues, descending.
    pub values: Vec<f64>,
    /// Unit eigenvectors, one after the other; the entry of largest magnitude of each is positive.
    pub vectors: Vec<f64>,
}

/// Residual of a converged eigenpair, relative to the largest eigenvalue.
const TOLERANCE: f64 = 1e-11;

/// Blocks of a Krylov space before a restart.
const BLOCKS: usize = 6;

/// Restarts before falling back to the full decomposition.
const RESTARTS: usize = 12;

/// The `count` largest eigenpairs of the symmetric positive semidefinite n x n matrix `matrix`; `None` if a number is
/// not finite.
///
/// # Model
/// A block Krylov space from a fixed start, orthonormalised twice, with Rayleigh-Ritz and restarts, until the residual
/// of every wanted pair is below 1e-11 of the largest eigenvalue. Small matrices, many pairs, and spaces that break
/// down (rank below the block size) use the full decomposition.
pub fn largest_eigenpairs(matrix: &[f64], n: usize, count: usize) -> Option<Eigen> {
    if matrix.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let matrix = MatRef::from_row_major_slice(matrix, n, n);
    let block = count + 4;
    let few = block * BLOCKS * 2 <= n;
    let (values, vectors) = few.then(|| krylov(matrix, count, block)).flatten().or_else(|| full(matrix, count))?;
    let mut vectors: Vec<f64> = (0..count).flat_map(|k| vectors.col(k).iter().copied().collect::<Vec<_>>()).collect();
    vectors.chunks_exact_mut(n).for_each(|vector| {
        fix_sign(vector);
    });
    Some(Eigen { vectors, values })
}

fn full(matrix: MatRef<'_, f64>, count: usize) -> Option<(Vec<f64>, Mat<f64>)> {
    let n = matrix.nrows();
    let eigen = matrix.self_adjoint_eigen(Side::Lower).ok()?;
    let values = (0..count).map(|k| eigen.S()[n - 1 - k]).collect();
    Some((values, Mat::from_fn(n, count, |i, k| eigen.U()[(i, n - 1 - k)])))
}

fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    matmul(out.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    out
}

fn krylov(matrix: MatRef<'_, f64>, count: usize, block: usize) -> Option<(Vec<f64>, Mat<f64>)> {
    let n = matrix.nrows();
    let mut start = noise(n, block);
    for _ in 0..RESTARTS {
        let (basis, image) = krylov_basis(matrix, &start)?;
        let reduced = product(basis.transpose(), image.as_ref());
        let (values, ritz) = full(reduced.as_ref(), block)?;
        let vectors = product(basis.as_ref(), ritz.as_ref());
        let images = product(image.as_ref(), ritz.as_ref());
        let residual = |k: usize| {
            let pairs = images.col(k).iter().zip(vectors.col(k).iter());
            pairs.map(|(w, v)| (w - values[k] * v).powi(2)).sum::<f64>().sqrt()
        };
        if (0..count).all(|k| residual(k) <= TOLERANCE * values[0]) {
            return Some((values[..count].to_vec(), vectors));
        }
        start = vectors;
    }
    None
}

/// A matrix of fixed pseudo-random numbers in -1..1, which is practically never orthogonal to an eigenvector.
fn noise(rows: usize, columns: usize) -> Mat<f64> {
    let mut state = 0u64;
    Mat::from_fn(rows, columns, |_, _| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    })
}

/// An orthonormal basis of the span of start, A start, A^2 start ..., and its image under A.
fn krylov_basis(matrix: MatRef<'_, f64>, start: &Mat<f64>) -> Option<(Mat<f64>, Mat<f64>)> {
    let (n, block) = (start.nrows(), start.ncols());
    let mut basis = Mat::zeros(n, block * BLOCKS);
    let mut image = Mat::<f64>::zeros(n, block * BLOCKS);
    let mut next = start.clone();
    for first in (0..BLOCKS).map(|s| s * block) {
        orthonormalise_against(basis.subcols(0, first), &mut next)?;
        basis.subcols_mut(first, block).copy_from(&next);
        next = product(matrix, next.as_ref());
        image.subcols_mut(first, block).copy_from(&next);
    }
    Some((basis, image))
}

/// Makes `columns` orthonormal, and orthogonal to the orthonormal columns `known`; `None` if one of them depends on the
/// others. Twice, since rounding leaves the first result not quite orthogonal.
fn orthonormalise_against(known: MatRef<'_, f64>, columns: &mut Mat<f64>) -> Option<()> {
    for _ in 0..2 {
        let inner = product(known.transpose(), columns.as_ref());
        matmul(columns.as_mut(), Accum::Add, known, inner.as_ref(), -1.0, Par::Seq);
        orthonormalise(columns)?;
    }
    Some(())
}

/// Gram-Schmidt in place; `None` if a column depends on those before it.
fn orthonormalise(columns: &mut Mat<f64>) -> Option<()> {
    for k in 0..columns.ncols() {
        let before = columns.col(k).norm_l2();
        for j in 0..k {
            let (done, mut rest) = columns.as_mut().split_at_col_mut(k);
            let (q, v) = (done.col(j), rest.as_mut().col_mut(0));
            let dot: f64 = q.iter().zip(v.as_ref().iter()).map(|(a, b)| a * b).sum();
            v.iter_mut().zip(q.iter()).for_each(|(v, q)| *v -= dot * q);
        }
        let norm = columns.col(k).norm_l2();
        if norm.is_nan() || norm <= 1e-10 * before || before < f64::MIN_POSITIVE {
            return None;
        }
        columns.col_mut(k).iter_mut().for_each(|v| *v /= norm);
    }
    Some(())
}

/// Flips the sign of a vector if its entry of largest magnitude is negative; returns whether it did.
pub fn fix_sign(vector: &mut [f64]) -> bool {
    let flip = vector.iter().fold(0.0f64, |m, &v| if v.abs() > m.abs() { v } else { m }) < 0.0;
    if flip {
        vector.iter_mut().for_each(|v| *v = -*v);
    }
    flip
}

/// The solution X of A X = B for a square matrix A of n rows and a matrix B, both row by row; `None` if A is singular.
pub fn solve(matrix: &[f64], n: usize, right: &[f64]) -> Option<Vec<f64>> {
    let matrix = MatRef::from_row_major_slice(matrix, n, n);
    let right = MatRef::from_row_major_slice(right, n, right.len() / n);
    let solution = matrix.partial_piv_lu().solve(right);
    let rows: Vec<f64> = solution.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<f64>>()).collect();
    rows.iter().all(|v| v.is_finite()).then_some(rows)
}

/// Linear combinations of `rows`, which have length `n`: one for each row of `factors`, which has a factor for each of
/// `rows`.
pub fn combine_rows(factors: &[f64], rows: &[f64], n: usize) -> Vec<f64> {
    let width = rows.len() / n;
    let mut out = vec![0.0; factors.len() / width * n];
    out.par_chunks_exact_mut(n).zip(factors.par_chunks_exact(width)).for_each(|(out, factors)| {
        for (row, factor) in rows.chunks_exact(n).zip(factors) {
            out.iter_mut().zip(row).for_each(|(out, v)| *out += factor * v);
        }
    });
    out
}

/// The products of all rows of `a` with all rows of `b`, which have length `n`: a b^T, row by row.
pub fn product_with_transposed(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let [a, b] = [a, b].map(|rows| MatRef::from_row_major_slice(rows, rows.len() / n, n));
    let product = product(a, b.transpose());
    product.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<f64>>()).collect()
}

/// Orthonormalises `rows`, which have length `n`, against each other and against the orthonormal rows `known`; `None` if
/// one of them depends on the others.
pub fn orthonormal_to(known: &[f64], rows: &[f64], n: usize) -> Option<Vec<f64>> {
    let known = MatRef::from_column_major_slice(known, n, known.len() / n);
    let mut columns = MatRef::from_column_major_slice(rows, n, rows.len() / n).to_owned();
    orthonormalise_against(known, &mut columns)?;
    Some(columns.col_iter().flat_map(|column| column.iter().copied().collect::<Vec<f64>>()).collect())
}

/// Orthonormalises `rows`, which have length `n`, one after the other; `None` if one depends on those before it.
pub fn orthonormal_rows(rows: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut columns = MatRef::from_column_major_slice(rows, n, rows.len() / n).to_owned();
    orthonormalise(&mut columns)?;
    orthonormalise(&mut columns)?;
    Some(columns.col_iter().flat_map(|column| column.iter().copied().collect::<Vec<f64>>()).collect())
}

/// Adds the inner products of all pairs of rows i >= j of `rows` (each of `stride` numbers) to the lower triangle of
/// `sums`. `scratch` has the size of `sums`. Products are summed in single precision.
pub fn add_row_products(rows: &[f32], stride: usize, scratch: &mut [f32], sums: &mut [f64]) {
    let n = rows.len() / stride;
    let matrix = MatRef::from_row_major_slice(rows, n, stride);
    let lower = BlockStructure::TriangularLower;
    triangular::matmul(
        faer::MatMut::from_row_major_slice_mut(scratch, n, n),
        lower,
        Accum::Replace,
        matrix,
        BlockStructure::Rectangular,
        matrix.transpose(),
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
    for i in 0..n {
        for (sum, part) in sums[i * n..=i * n + i].iter_mut().zip(&scratch[i * n..]) {
            *sum += f64::from(*part);
        }
    }
}

/// Rows of numbers, one after the other.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a> {
    data: &'a [f32],
    len: usize,
}

impl<'a> Rows<'a> {
    /// Rows of `len` numbers each.
    pub fn new(data: &'a [f32], len: usize) -> Self {
        Self { data, len }
    }

    fn matrix(self) -> MatRef<'a, f32> {
        MatRef::from_row_major_slice(self.data, self.data.len() / self.len, self.len)
    }
}

/// Adds the product a b to `out`, row by row.
pub fn add_product(a: Rows, b: Rows, out: &mut [f32]) {
    let (a, b) = (a.matrix(), b.matrix());
    let out = faer::MatMut::from_row_major_slice_mut(out, a.nrows(), b.ncols());
    matmul(out, Accum::Add, a, b, 1.0, Par::Seq);
}

/// Adds the product a b^T to `out`, row by row.
pub fn add_product_transposed(a: Rows, b: Rows, out: &mut [f32]) {
    let (a, b) = (a.matrix(), b.matrix());
    let out = faer::MatMut::from_row_major_slice_mut(out, a.nrows(), b.nrows());
    matmul(out, Accum::Add, a, b.transpose(), 1.0, Par::Seq);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A symmetric matrix with the given eigenvalues in a random orthonormal basis.
    fn with_spectrum(values: &[f64]) -> Vec<f64> {
        let n = values.len();
        let mut q = noise(n, n);
        orthonormalise(&mut q).unwrap();
        orthonormalise(&mut q).unwrap();
        let scaled = Mat::from_fn(n, n, |i, j| q[(i, j)] * values[j]);
        let matrix = product(scaled.as_ref(), q.transpose());
        (0..n * n).map(|k| 0.5 * (matrix[(k / n, k % n)] + matrix[(k % n, k / n)])).collect()
    }

    fn check(matrix: &[f64], n: usize, count: usize, expected: &[f64]) {
        let eigen = largest_eigenpairs(matrix, n, count).unwrap();
        let scale = expected[0].max(1e-300);
        for (k, &expected) in expected.iter().enumerate().take(count) {
            assert!((eigen.values[k] - expected).abs() <= 1e-10 * scale, "{k}: {} {expected}", eigen.values[k]);
            let v = &eigen.vectors[k * n..(k + 1) * n];
            for row in 0..n {
                let image: f64 = matrix[row * n..(row + 1) * n].iter().zip(v).map(|(a, b)| a * b).sum();
                assert!((image - eigen.values[k] * v[row]).abs() <= 1e-10 * scale);
            }
            for j in 0..=k {
                let dot: f64 = v.iter().zip(&eigen.vectors[j * n..]).map(|(a, b)| a * b).sum();
                assert!((dot - f64::from(u8::from(j == k))).abs() < 1e-10, "{j} {k} {dot}");
            }
            let largest = v.iter().fold(0.0f64, |m, x| if x.abs() > m.abs() { *x } else { m });
            assert!(largest > 0.0);
        }
    }

    #[test]
    fn the_largest_pairs_of_any_spectrum_are_found() {
        let n = 150;
        type Spectrum = (&'static str, fn(usize) -> f64);
        let spectra: [Spectrum; 7] = [
            ("geometric", |i| 0.5f64.powi(i as i32)),
            ("slow", |i| 1.0 / (i + 1) as f64),
            ("flat", |i| 1.0 - 1e-3 * i as f64),
            ("clustered", |i| if i < 6 { 1.0 } else { 0.1 }),
            ("identity", |_| 1.0),
            ("rank 2", |i| if i < 2 { 1.0 } else { 0.0 }),
            ("large", |i| 1e12 * 0.9f64.powi(i as i32)),
        ];
        for (name, spectrum) in spectra {
            println!("{name}");
            let values: Vec<f64> = (0..n).map(spectrum).collect();
            check(&with_spectrum(&values), n, 4, &values);
        }
        check(&vec![0.0; n * n], n, 4, &vec![0.0; n]);
        let values: Vec<f64> = (0..9).map(|i| 9.0 - i as f64).collect();
        check(&with_spectrum(&values), 9, 9, &values);
    }

    #[test]
    fn square_systems_are_solved() {
        // the first pivot is 0
        let found = solve(&[0.0, 2.0, 1.0, 1.0], 2, &[4.0, 2.0, 3.0, 0.0]).unwrap();
        let close = found.iter().zip([1.0, -1.0, 2.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close, "{found:?}");
        assert!(solve(&[1.0, 2.0, 2.0, 4.0], 2, &[1.0, 1.0]).is_none());
    }

    #[test]
    fn matrices_that_are_not_finite_are_refused() {
        assert!(largest_eigenpairs(&[f64::NAN], 1, 1).is_none());
        assert!(largest_eigenpairs(&[f64::INFINITY, 0.0, 0.0, 1.0], 2, 1).is_none());
    }
}
