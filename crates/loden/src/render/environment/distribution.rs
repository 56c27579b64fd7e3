//! A piecewise-constant density over the unit square.

use glam::Vec2;

/// Sampled by a marginal distribution over rows and a conditional one over columns. Both are inverted by bisection, which
/// preserves stratification.
#[derive(Debug, Clone)]
pub(super) struct Distribution {
    columns: usize,
    rows: usize,
    /// Cumulative probabilities of the rows: `rows + 1` numbers from 0 to 1.
    marginal: Vec<f32>,
    /// Cumulative probabilities within each row: `columns + 1` numbers from 0 to 1.
    conditional: Vec<f32>,
}

impl Distribution {
    /// A distribution of `columns * rows` non-negative weights; `None` if all are zero.
    pub(super) fn new(columns: usize, rows: usize, weights: &[f32]) -> Option<Self> {
        let mut conditional = Vec::with_capacity((columns + 1) * rows);
        let mut sums = Vec::with_capacity(rows);
        for row in weights.chunks_exact(columns) {
            sums.push(cumulate(row, &mut conditional));
        }
        let mut marginal = Vec::with_capacity(rows + 1);
        let total = cumulate(&sums, &mut marginal);
        (total > 0.0 && total.is_finite()).then_some(Self { columns, rows, marginal, conditional })
    }

    /// A random point and its density.
    #[inline]
    pub(super) fn sample(&self, random: Vec2) -> (Vec2, f32) {
        let (j, v, row) = invert(&self.marginal, random.y);
        let (i, u, cell) = invert(self.row(j), random.x);
        let point = Vec2::new((i as f32 + u) / self.columns as f32, (j as f32 + v) / self.rows as f32);
        (point, row * cell * (self.columns * self.rows) as f32)
    }

    /// The density at a point.
    #[inline]
    pub(super) fn pdf(&self, uv: Vec2) -> f32 {
        let i = ((uv.x * self.columns as f32) as usize).min(self.columns - 1);
        let j = ((uv.y * self.rows as f32) as usize).min(self.rows - 1);
        let row = self.row(j);
        (self.marginal[j + 1] - self.marginal[j]) * (row[i + 1] - row[i]) * (self.columns * self.rows) as f32
    }

    #[inline]
    fn row(&self, j: usize) -> &[f32] {
        &self.conditional[j * (self.columns + 1)..][..=self.columns]
    }
}

/// Appends the cumulative sums of `weights`, normalized to 0..1, and returns the total. All-zero weights become uniform.
fn cumulate(weights: &[f32], out: &mut Vec<f32>) -> f32 {
    let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    let mut sum = 0.0;
    out.push(0.0);
    for (k, &w) in weights.iter().enumerate() {
        sum += f64::from(w);
        let fraction = if total > 0.0 { sum / total } else { (k + 1) as f64 / weights.len() as f64 };
        out.push(fraction as f32);
    }
    if let Some(last) = out.last_mut() {
        *last = 1.0;
    }
    total as f32
}

/// The cell whose interval contains x, the position within it, and its length.
#[inline]
fn invert(cumulative: &[f32], x: f32) -> (usize, f32, f32) {
    let cell = cumulative.partition_point(|&c| c <= x).clamp(1, cumulative.len() - 1) - 1;
    let part = cumulative[cell + 1] - cumulative[cell];
    let position = if part > 0.0 { ((x - cumulative[cell]) / part).clamp(0.0, 1.0) } else { 0.5 };
    (cell, position.min(1.0f32.next_down()), part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_follow_the_weights() {
        let weights = [1.0, 0.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 2.0];
        let distribution = Distribution::new(4, 3, &weights).unwrap();
        let mut counts = [0.0; 12];
        let n = 160;
        for k in 0..n * n {
            let random = Vec2::new((k % n) as f32 + 0.5, (k / n) as f32 + 0.5) / n as f32;
            let (p, density) = distribution.sample(random);
            let cell = (p.y * 3.0) as usize * 4 + (p.x * 4.0) as usize;
            assert!((density - weights[cell] * 12.0 / 16.0).abs() < 1e-5);
            assert_eq!(density, distribution.pdf(p));
            counts[cell] += 16.0 / (n * n) as f32;
        }
        for (count, weight) in counts.iter().zip(weights) {
            assert!((count - weight).abs() < 1e-3, "{counts:?}");
        }
        assert!(Distribution::new(2, 1, &[0.0, 0.0]).is_none());
    }
}
