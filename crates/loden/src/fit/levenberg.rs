//! Levenberg-Marquardt within bounds.

/// Minimises the sum of squares of `residuals` within the box low..high, from `start`, in at most `iterations`
/// iterations. `derivatives` takes a point and its residuals, and returns the derivatives with respect to each
/// variable.
///
/// # Model
/// (J^T J + lambda diag(J^T J)) step = -J^T r, over the variables that the gradient does not hold at a bound; steps are
/// clamped to the box. Lambda shrinks after a success and grows after a failure.
///
/// # References
/// marquardt1963
pub(crate) fn minimise(
    start: Vec<f64>,
    (low, high): (&[f64], &[f64]),
    iterations: usize,
    residuals: impl Fn(&[f64]) -> Vec<f64>,
    derivatives: impl Fn(&[f64], &[f64]) -> Vec<Vec<f64>>,
) -> Vec<f64> {
    let cost = |r: &[f64]| r.iter().map(|x| x * x).sum::<f64>();
    let (mut x, mut lambda, mut idle) = (start, 1e-3, 0);
    if x.is_empty() {
        return x;
    }
    let mut here = residuals(&x);
    for _ in 0..iterations {
        let before = cost(&here);
        let (normal, gradient) = normal_equations(&derivatives(&x, &here), &here);
        let mut after = before;
        while lambda < 1e6 {
            let next = step(&x, (low, high), &normal, &gradient, lambda);
            let there = residuals(&next);
            after = cost(&there);
            if after < before {
                (x, here) = (next, there);
                lambda = (lambda * 0.2).max(1e-12);
                break;
            }
            lambda *= 6.0;
        }
        // a single small gain may precede a large one
        idle = if before - after > 1e-5 * before { 0 } else { idle + 1 };
        if idle > 1 || after >= before || before < 1e-24 {
            break;
        }
    }
    x
}

/// J^T J and J^T r, from the columns of J.
fn normal_equations(columns: &[Vec<f64>], residuals: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let n = columns.len();
    let mut normal = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let value = dot(&columns[i], &columns[j]);
            (normal[i * n + j], normal[j * n + i]) = (value, value);
        }
    }
    (normal, columns.iter().map(|column| dot(column, residuals)).collect())
}

/// The inner product, with several independent sums for speed.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        (0..8).for_each(|i| sums[i] += a[i] * b[i]);
    }
    sums.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f64>()
}

fn step(x: &[f64], (low, high): (&[f64], &[f64]), normal: &[f64], gradient: &[f64], lambda: f64) -> Vec<f64> {
    let n = x.len();
    let held = |i: usize| (x[i] <= low[i] && gradient[i] > 0.0) || (x[i] >= high[i] && gradient[i] < 0.0);
    let free: Vec<usize> = (0..n).filter(|&i| !held(i)).collect();
    let largest = (0..n).map(|i| normal[i * n + i]).fold(0.0, f64::max);
    let mut matrix = Vec::with_capacity(free.len() * free.len());
    for &i in &free {
        for &j in &free {
            let damping =
                if i == j { lambda * normal[i * n + i].max(1e-12 * largest) + f64::MIN_POSITIVE } else { 0.0 };
            matrix.push(normal[i * n + j] + damping);
        }
    }
    let right: Vec<f64> = free.iter().map(|&i| -gradient[i]).collect();
    let mut next = x.to_vec();
    if let Some(delta) = super::linear::solve(matrix, right) {
        for (&i, d) in free.iter().zip(delta) {
            next[i] = (x[i] + d).clamp(low[i], high[i]);
        }
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rosenbrock(low: &[f64; 2], high: &[f64; 2]) -> Vec<f64> {
        let residuals = |x: &[f64]| vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]];
        let derivatives = |x: &[f64], _: &[f64]| vec![vec![-20.0 * x[0], -1.0], vec![10.0, 0.0]];
        minimise(vec![-1.2, 1.0], (low, high), 60, residuals, derivatives)
    }

    #[test]
    fn finds_the_minimum_of_a_curved_valley() {
        let x = rosenbrock(&[-5.0; 2], &[5.0; 2]);
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[1] - 1.0).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn stops_at_a_bound() {
        let x = rosenbrock(&[-5.0; 2], &[0.5, 5.0]);
        assert!((x[0] - 0.5).abs() < 1e-9 && (x[1] - 0.25).abs() < 1e-6, "{x:?}");
    }
}
