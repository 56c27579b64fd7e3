//! Sparse least squares over the texels of tables, by conjugate gradients.

/// Linear equations in the texels of one or more tables of equal size. Every equation has the same number of weights.
pub(super) struct Equations {
    /// (unknown, weight) of all equations, one after the other.
    pub weights: Vec<(u32, f32)>,
    /// Weights per equation.
    pub width: usize,
    /// Number of unknowns.
    pub unknowns: usize,
}

/// Further equations, which make the solution unique.
#[derive(Debug, Clone, Copy)]
pub(super) struct Penalty {
    /// Texels per side of a table.
    pub size: usize,
    /// Weight of a vanishing Laplacian of the solution at every texel.
    pub smoothness: f32,
    /// Weight of a vanishing change of every texel.
    pub damping: f32,
}

impl Equations {
    /// The left-hand sides.
    pub fn apply(&self, x: &[f32]) -> Vec<f32> {
        let rows = self.weights.chunks_exact(self.width);
        rows.map(|row| row.iter().map(|&(i, w)| w * x[i as usize]).sum()).collect()
    }

    fn apply_transposed(&self, y: &[f32]) -> Vec<f32> {
        let mut sum = vec![0.0f32; self.unknowns];
        for (row, value) in self.weights.chunks_exact(self.width).zip(y) {
            row.iter().for_each(|&(i, w)| sum[i as usize] += w * value);
        }
        sum
    }

    /// The change of `x` that brings the equations closer to `right`, in the least-squares sense and within so many
    /// iterations of conjugate gradients on the normal equations, which are never formed.
    pub fn change(&self, right: &[f32], x: &[f32], penalty: Penalty, iterations: usize) -> Vec<f32> {
        let square = |v: &[f32]| v.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>();
        // Residuals of the equations, of smoothness and of damping
        let mut residual: Vec<f32> = right.iter().zip(self.apply(x)).map(|(r, v)| r - v).collect();
        let mut rough: Vec<f32> = penalty.roughness(x).into_iter().map(|v| -v).collect();
        let mut change = vec![0.0f32; self.unknowns];
        let gradient = |residual: &[f32], rough: &[f32], change: &[f32]| {
            let mut sum = self.apply_transposed(residual);
            penalty.add_transposed(rough, &mut sum);
            let damping = penalty.damping.powi(2);
            sum.iter_mut().zip(change).for_each(|(sum, change)| *sum -= damping * change);
            sum
        };
        let mut direction = gradient(&residual, &rough, &change);
        let (mut norm, first) = (square(&direction), square(&direction));
        for _ in 0..iterations {
            if norm <= 1e-12 * first || norm == 0.0 {
                break;
            }
            let (along, bent) = (self.apply(&direction), penalty.roughness(&direction));
            let damping = f64::from(penalty.damping).powi(2) * square(&direction);
            let alpha = (norm / (square(&along) + square(&bent) + damping).max(f64::MIN_POSITIVE)) as f32;
            change.iter_mut().zip(&direction).for_each(|(x, d)| *x += alpha * d);
            residual.iter_mut().zip(&along).for_each(|(r, a)| *r -= alpha * a);
            rough.iter_mut().zip(&bent).for_each(|(r, b)| *r -= alpha * b);
            let steepest = gradient(&residual, &rough, &change);
            let next = square(&steepest);
            let beta = (next / norm) as f32;
            norm = next;
            direction.iter_mut().zip(&steepest).for_each(|(d, g)| *d = g + beta * *d);
        }
        change
    }
}

impl Penalty {
    /// The weighted Laplacian at every texel; nothing without smoothness.
    pub fn roughness(&self, x: &[f32]) -> Vec<f32> {
        if self.smoothness == 0.0 {
            return Vec::new();
        }
        (0..x.len()).map(|i| self.smoothness * self.neighbours(i).map(|j| x[j] - x[i]).sum::<f32>()).collect()
    }

    fn add_transposed(&self, rough: &[f32], sum: &mut [f32]) {
        for (i, value) in rough.iter().enumerate() {
            for j in self.neighbours(i) {
                sum[j] += self.smoothness * value;
                sum[i] -= self.smoothness * value;
            }
        }
    }

    /// The texels beside a texel of the same table.
    fn neighbours(&self, i: usize) -> impl Iterator<Item = usize> + use<> {
        let size = self.size;
        let (x, y) = (i % size, i / size % size);
        let steps = [
            (x > 0, i.wrapping_sub(1)),
            (x + 1 < size, i + 1),
            (y > 0, i.wrapping_sub(size)),
            (y + 1 < size, i + size),
        ];
        steps.into_iter().filter(|(inside, _)| *inside).map(|(_, j)| j)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equations_are_solved_and_the_rest_stays_or_becomes_smooth() {
        // x0 + x1 = 3, x0 - x1 = 1; x2 and x3 appear nowhere
        let weights = vec![(0, 1.0), (1, 1.0), (0, 1.0), (1, -1.0)];
        let equations = Equations { weights, width: 2, unknowns: 4 };
        let start = [0.0, 0.0, 7.0, 5.0];
        let free = Penalty { size: 2, smoothness: 0.0, damping: 0.0 };
        let change = equations.change(&[3.0, 1.0], &start, free, 20);
        let close = |found: &[f32], expected: [f32; 4]| {
            found.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 2e-3, "{found:?} {expected:?}"));
        };
        close(&change, [2.0, 1.0, 0.0, 0.0]);
        let smooth = Penalty { smoothness: 1e-2, ..free };
        let change = equations.change(&[3.0, 1.0], &start, smooth, 200);
        // the least sum of squared Laplacians beside 2 and 1
        close(&[change[0], change[1], 7.0 + change[2], 5.0 + change[3]], [2.0, 1.0, 1.8, 1.2]);
    }
}
