//! Regularisation: what the measurement of a texel leaves open follows its neighbours.

use super::COUNT;

/// Weight of the neighbours, relative to that of the measurement of a usual texel.
const STRENGTH: f64 = 0.002;

/// Rounds over all texels.
const ROUNDS: usize = 12;

/// Minimises the sum over texels of the squared distance from their fit, weighted by its curvature, and of the squared differences
/// between neighbours, for each parameter by itself. `numbers` and `curvatures` go row by row.
pub(super) fn smooth(numbers: &mut [[f64; COUNT]], curvatures: &[[f64; COUNT]], width: usize) {
    let height = numbers.len() / width;
    let usual: [f64; COUNT] = std::array::from_fn(|i| median(curvatures.iter().map(|c| c[i])));
    let fitted = numbers.to_vec();
    // texels of one colour of a chessboard depend on those of the other only
    for (_, odd) in (0..ROUNDS).flat_map(|round| [(round, 0), (round, 1)]) {
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))).filter(|(y, x)| (y + x) % 2 == odd) {
            let around = [(y, x.wrapping_sub(1)), (y, x + 1), (y.wrapping_sub(1), x), (y + 1, x)];
            let around = around.map(|(y, x)| (y < height && x < width).then_some(y * width + x));
            let at = y * width + x;
            for i in (0..COUNT).filter(|&i| usual[i] > 0.0) {
                let (mut sum, mut weight) = (curvatures[at][i] * fitted[at][i], curvatures[at][i]);
                for other in around.into_iter().flatten() {
                    sum += STRENGTH * usual[i] * numbers[other][i];
                    weight += STRENGTH * usual[i];
                }
                numbers[at][i] = sum / weight;
            }
        }
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_not_known_follows_its_neighbours() {
        let mut numbers = vec![[0.5; COUNT]; 25];
        let mut curvatures = vec![[1.0; COUNT]; 25];
        (numbers[12][0], numbers[12][1], curvatures[12][1]) = (0.8, 0.8, 1e-4);
        smooth(&mut numbers, &curvatures, 5);
        assert!(numbers[12][0] > 0.76 && (numbers[12][1] - 0.5).abs() < 0.01, "{:?}", numbers[12]);
        assert!((numbers[0][2] - 0.5).abs() < 1e-12);
    }
}
