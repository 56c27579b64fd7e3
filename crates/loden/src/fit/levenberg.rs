//! Levenberg-Marquardt in a box.

/// Residuals and, row by row, their derivatives by the variables.
pub(super) struct Linearised {
    pub residuals: Vec<f64>,
    pub jacobian: Vec<f64>,
}

/// Makes the sum of squares of `residuals` small within the box low..high, from `start`, in at most `iterations`.
///
/// # Model
/// (J'J + lambda diag(J'J)) step = -J'r over the variables that are not held at a bound by their gradient; steps are
/// cut off at the box. Lambda falls after a success and grows after a failure.
///
/// # References
/// marquardt1963
pub(super) fn minimise(
    start: Vec<f64>,
    (low, high): (&[f64], &[f64]),
    iterations: usize,
    residuals: impl Fn(&[f64]) -> Vec<f64>,
    linearise: impl Fn(&[f64]) -> Linearised,
) -> Vec<f64> {
    let cost = |r: &[f64]| r.iter().map(|x| x * x).sum::<f64>();
    let (mut x, mut lambda, mut idle) = (start, 1e-3, 0);
    if x.is_empty() {
        return x;
    }
    for _ in 0..iterations {
        let at = linearise(&x);
        let before = cost(&at.residuals);
        let (normal, gradient) = normal_equations(&at, x.len());
        let mut after = before;
        while lambda < 1e6 {
            let next = step(&x, (low, high), &normal, &gradient, lambda);
            after = cost(&residuals(&next));
            if after < before {
                x = next;
                lambda = (lambda * 0.2).max(1e-12);
                break;
            }
            lambda *= 6.0;
        }
        // a small success may be followed by a large one, once
        idle = if before - after > 1e-5 * before { 0 } else { idle + 1 };
        if idle > 1 || after >= before || before < 1e-24 {
            break;
        }
    }
    x
}

/// J'J and J'r.
fn normal_equations(at: &Linearised, n: usize) -> (Vec<f64>, Vec<f64>) {
    let (mut normal, mut gradient) = (vec![0.0; n * n], vec![0.0; n]);
    for (row, r) in at.jacobian.chunks_exact(n).zip(&at.residuals) {
        for i in 0..n {
            gradient[i] += row[i] * r;
            for j in 0..=i {
                normal[i * n + j] += row[i] * row[j];
            }
        }
    }
    for i in 0..n {
        for j in 0..i {
            normal[j * n + i] = normal[i * n + j];
        }
    }
    (normal, gradient)
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
        let linearise =
            |x: &[f64]| Linearised { residuals: residuals(x), jacobian: vec![-20.0 * x[0], 10.0, -1.0, 0.0] };
        minimise(vec![-1.2, 1.0], (low, high), 60, residuals, linearise)
    }

    #[test]
    fn finds_the_end_of_a_bent_valley() {
        let x = rosenbrock(&[-5.0; 2], &[5.0; 2]);
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[1] - 1.0).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn stops_at_a_bound() {
        let x = rosenbrock(&[-5.0; 2], &[0.5, 5.0]);
        assert!((x[0] - 0.5).abs() < 1e-9 && (x[1] - 0.25).abs() < 1e-6, "{x:?}");
    }
}
