//! Small dense systems: symmetric ones, and least squares within bounds.

/// Solves a symmetric positive definite system, given row by row; `None` if it is not positive definite.
pub(super) fn solve(mut matrix: Vec<f64>, mut right: Vec<f64>) -> Option<Vec<f64>> {
    let n = right.len();
    // Cholesky in place, in the lower triangle
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
            let value = matrix[i * n + j] - dot;
            if i == j {
                if value.is_nan() || value <= 0.0 {
                    return None;
                }
                matrix[i * n + i] = value.sqrt();
            } else {
                matrix[i * n + j] = value / matrix[j * n + j];
            }
        }
    }
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| matrix[i * n + k] * right[k]).sum();
        right[i] = (right[i] - dot) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| matrix[k * n + i] * right[k]).sum();
        right[i] = (right[i] - dot) / matrix[i * n + i];
    }
    Some(right)
}

/// The x in 0..high that minimises x^T A x / 2 - b^T x, exactly: tries every combination of variables at their bounds,
/// of which there are at most four.
pub(super) fn bounded(gram: &[f64], right: &[f64], high: &[f64]) -> Vec<f64> {
    let n = right.len();
    let scale = (0..n).map(|i| gram[i * n + i]).fold(0.0, f64::max);
    let value = |x: &[f64]| {
        (0..n).map(|i| x[i] * (0.5 * (0..n).map(|j| gram[i * n + j] * x[j]).sum::<f64>() - right[i])).sum::<f64>()
    };
    let mut best: Option<(f64, Vec<f64>)> = None;
    // the states of all variables in base 3: free, zero, high
    for choice in 0..3usize.pow(n as u32) {
        let state = |i: usize| choice / 3usize.pow(i as u32) % 3;
        let mut x: Vec<f64> = (0..n).map(|i| if state(i) == 2 { high[i] } else { 0.0 }).collect();
        let free: Vec<usize> = (0..n).filter(|&i| state(i) == 0).collect();
        let rest = |i: usize| right[i] - (0..n).map(|j| gram[i * n + j] * x[j]).sum::<f64>();
        let right: Vec<f64> = free.iter().map(|&i| rest(i)).collect();
        // a small ridge keeps terms solvable that vanish or coincide
        let ridge = 1e-13 * scale + f64::MIN_POSITIVE;
        let entry = |i: usize, j: usize| gram[i * n + j] + if i == j { ridge } else { 0.0 };
        let matrix = free.iter().flat_map(|&i| free.iter().map(move |&j| entry(i, j))).collect();
        let Some(solution) = solve(matrix, right) else { continue };
        if free.iter().zip(&solution).any(|(&i, v)| !(0.0..=high[i]).contains(v)) {
            continue;
        }
        free.iter().zip(solution).for_each(|(&i, v)| x[i] = v);
        if choice == 0 {
            // the unbounded optimum is inside the box: nothing is better
            return x;
        }
        let value = value(&x);
        if best.as_ref().is_none_or(|(least, _)| value < *least) {
            best = Some((value, x));
        }
    }
    best.map_or_else(|| vec![0.0; n], |(_, x)| x)
}

/// As [`bounded`] with bounds of 1, for two variables with a sum of at most 1.
pub(super) fn shared(gram: &[f64], right: &[f64]) -> Vec<f64> {
    let x = bounded(gram, right, &[1.0, 1.0]);
    if x[0] + x[1] <= 1.0 {
        return x;
    }
    // minimise over the edge (1 - t, t): the function is convex and its minimum in the square is beyond the edge
    let slope = (right[1] - gram[2]) - (right[0] - gram[0]);
    let curvature = gram[0] - gram[1] - gram[2] + gram[3];
    let t = if curvature > 0.0 { (slope / curvature).clamp(0.0, 1.0) } else { f64::from(u8::from(slope > 0.0)) };
    vec![1.0 - t, t]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definite_systems_are_solved_and_others_refused() {
        let x = solve(vec![4.0, 1.0, 1.0, 3.0], vec![1.0, 2.0]).unwrap();
        assert!((x[0] - 1.0 / 11.0).abs() < 1e-15 && (x[1] - 7.0 / 11.0).abs() < 1e-15);
        assert!(solve(vec![1.0, 2.0, 2.0, 1.0], vec![1.0, 1.0]).is_none());
    }

    #[test]
    fn shared_pairs_are_optimal() {
        for (gram, right) in [
            ([2.0, 0.5, 0.5, 1.0], [1.0, 0.5]),
            ([2.0, 0.5, 0.5, 1.0], [9.0, 3.0]),
            ([1.0, 0.9, 0.9, 1.0], [0.4, 5.0]),
            ([1.0, 0.2, 0.2, 3.0], [2.0, 1.5]),
            ([1.0, 1.0, 1.0, 1.0], [3.0, 2.0]),
        ] {
            let value = |x: f64, y: f64| {
                0.5 * (gram[0] * x * x + 2.0 * gram[1] * x * y + gram[3] * y * y) - right[0] * x - right[1] * y
            };
            let found = shared(&gram, &right);
            assert!(found.iter().all(|v| (0.0..=1.0).contains(v)) && found[0] + found[1] <= 1.0 + 1e-12, "{found:?}");
            let least = value(found[0], found[1]);
            for i in 0..=100 {
                for j in 0..=100 - i {
                    assert!(value(f64::from(i) / 100.0, f64::from(j) / 100.0) >= least - 1e-9, "{right:?}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn bounds_hold_and_are_optimal() {
        let gram = [2.0, 1.0, 0.5, 1.0, 3.0, 1.0, 0.5, 1.0, 1.5];
        for right in [[1.0, 1.0, 1.0], [-1.0, 4.0, 1.0], [9.0, -2.0, 3.0], [0.1, 0.1, -5.0]] {
            let high = [1.0, 0.8, 2.0];
            let x = bounded(&gram, &right, &high);
            for i in 0..3 {
                let gradient: f64 = (0..3).map(|j| gram[i * 3 + j] * x[j]).sum::<f64>() - right[i];
                let inside = x[i] > 0.0 && x[i] < high[i];
                // the gradient vanishes, or points out of the box at the bound
                let held = (x[i] == 0.0 && gradient > -1e-9) || (x[i] == high[i] && gradient < 1e-9);
                assert!(if inside { gradient.abs() < 1e-9 } else { held }, "{right:?}: {x:?} {gradient}");
            }
        }
    }
}
