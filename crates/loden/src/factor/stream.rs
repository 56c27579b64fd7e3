//! Singular value decomposition of a matrix that is read once, a block of rows at a time.

use rayon::prelude::*;

use super::linalg::largest_eigenpairs;

/// Extra rows of V kept until the end, since later blocks may need them.
const SPARE: usize = 16;

/// The rows x columns matrix M as U V, with a fixed number of rows of V.
///
/// # Model
/// V holds the right singular vectors of the rows so far, times the singular values. A new block B is appended below V;
/// the eigenvectors W of the Gram matrix of both give the new V = W^T (V; B) and U = (U 0; 0 1) W, both truncated to
/// the largest values. Without truncation this is the exact decomposition; truncation loses what later blocks would
/// have brought back, so a few extra rows are kept.
///
/// # References
/// levy2000
#[derive(Debug, Clone)]
pub struct StreamedSvd {
    columns: usize,
    capacity: usize,
    kept: usize,
    /// rows x kept
    u: Vec<f32>,
    /// kept x columns
    v: Vec<f32>,
    rows: usize,
}

impl StreamedSvd {
    /// A decomposition of rows of `columns` numbers that keeps at most `capacity` rows of V.
    pub fn new(columns: usize, capacity: usize) -> Self {
        Self { columns, capacity: capacity.max(1), kept: 0, u: Vec::new(), v: Vec::new(), rows: 0 }
    }

    /// As [`StreamedSvd::new`], with room for some extra rows: for `wanted` singular vectors of at most `rows` rows.
    pub fn with_spare(columns: usize, rows: usize, wanted: usize) -> Self {
        Self::new(columns, (wanted + SPARE.max(wanted / 2)).min(columns.min(rows)))
    }

    /// Appends a block of rows; `None` if a number is not finite.
    #[must_use]
    pub fn push(&mut self, block: &[f32]) -> Option<()> {
        let count = block.len() / self.columns;
        let (old, n) = (self.kept, self.kept + count);
        let row = |i: usize| {
            let (values, i) = if i < old { (&self.v[..], i) } else { (block, i - old) };
            &values[i * self.columns..(i + 1) * self.columns]
        };
        // Compute the Gram matrix of old and new rows
        let mut gram = vec![0.0; n * n];
        gram.par_chunks_exact_mut(n).enumerate().for_each(|(i, out)| {
            out.iter_mut().enumerate().for_each(|(j, v)| *v = dot(row(i), row(j)));
        });
        if !gram.iter().all(|v| v.is_finite()) {
            return None;
        }
        // Keep the largest eigenpairs
        let wanted = self.capacity.min(n);
        let eigen = largest_eigenpairs(&gram, n, wanted)?;
        let floor = eigen.values.first().copied().unwrap_or(0.0) * 1e-14;
        let kept = eigen.values.iter().take_while(|&&value| value > floor).count().max(1);
        let weight = |k: usize, i: usize| eigen.vectors[k * n + i] as f32;
        // Combine the rows of V
        let mut v = vec![0.0; kept * self.columns];
        v.par_chunks_exact_mut(self.columns).enumerate().for_each(|(k, out)| {
            for i in 0..n {
                let w = weight(k, i);
                out.iter_mut().zip(row(i)).for_each(|(out, value)| *out += w * value);
            }
        });
        // Rotate U and append the new rows
        let mut u = vec![0.0; (self.rows + count) * kept];
        u.par_chunks_exact_mut(kept).enumerate().for_each(|(r, out)| {
            if r < self.rows {
                let before = &self.u[r * old..(r + 1) * old];
                let sum = |k: usize| before.iter().enumerate().map(|(i, u)| u * weight(k, i)).sum();
                out.iter_mut().enumerate().for_each(|(k, out)| *out = sum(k));
            } else {
                out.iter_mut().enumerate().for_each(|(k, out)| *out = weight(k, old + r - self.rows));
            }
        });
        (self.u, self.v, self.kept, self.rows) = (u, v, kept, self.rows + count);
        Some(())
    }

    /// The singular values, U (rows x k), and the right singular vectors times the singular values (columns x k), for k
    /// = `count` or the rank if that is lower.
    pub fn finish(&self, count: usize) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
        let k = count.min(self.kept);
        let row = |i: usize| &self.v[i * self.columns..(i + 1) * self.columns];
        let singular = (0..k).map(|i| dot(row(i), row(i)).sqrt() as f32).collect();
        let u = self.u.chunks_exact(self.kept.max(1)).flat_map(|row| row[..k].iter().copied()).collect();
        let v = (0..self.columns).flat_map(|x| (0..k).map(move |i| (i, x))).map(|(i, x)| row(i)[x]).collect();
        (singular, u, v)
    }
}

/// The inner product, in pieces that are short enough for single precision.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let piece = |(a, b): (&[f32], &[f32])| {
        let mut lanes = [0.0f32; 16];
        let (whole_a, rest_a) = a.as_chunks::<16>();
        let (whole_b, rest_b) = b.as_chunks::<16>();
        for (a, b) in whole_a.iter().zip(whole_b) {
            (0..16).for_each(|i| lanes[i] += a[i] * b[i]);
        }
        let rest: f32 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
        f64::from(lanes.iter().sum::<f32>() + rest)
    };
    a.chunks(256).zip(b.chunks(256)).map(piece).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_of_low_rank_is_recovered_from_its_blocks() {
        let (rows, columns) = (60, 40);
        let value = |r: usize, c: usize| {
            (0..4).map(|k| ((r * (k + 3)) as f32 * 0.37).sin() * ((c * (k + 2)) as f32 * 0.21).cos()).sum::<f32>()
        };
        let mut svd = StreamedSvd::new(columns, 8);
        for first in (0..rows).step_by(7) {
            let block: Vec<f32> =
                (first..(first + 7).min(rows)).flat_map(|r| (0..columns).map(move |c| value(r, c))).collect();
            svd.push(&block).unwrap();
        }
        let (singular, u, v) = svd.finish(4);
        assert!(singular.is_sorted_by(|a, b| a >= b));
        for r in 0..rows {
            for c in 0..columns {
                let found: f32 = (0..4).map(|k| u[r * 4 + k] * v[c * 4 + k]).sum();
                assert!((found - value(r, c)).abs() < 1e-3, "{r} {c}: {found}");
            }
        }
        let mut bad = StreamedSvd::new(2, 2);
        assert!(bad.push(&[1.0, f32::NAN]).is_none());
    }
}
