//! Tree-structured clusters: leaves of points are split in two by 2-means, again and again.
//!
//! Choose it over [`super::kmeans`] where time matters more than the last few per cent of error.
//!
//! # Model
//! The leaf whose split lowers the squared error most is split next. A split starts from the points below and above the
//! mean in the coordinate of largest variance and is refined by Lloyd's iteration. Splitting n points into n_a with
//! mean a and n_b with mean b lowers the squared error by n_a n_b / n |a - b|^2.
//!
//! # Limits
//! Splits are never revised, so the error is somewhat larger than that of [`super::kmeans`], at a fraction of its time.
//!
//! # References
//! linde1980, riskin1991

use super::kmeans::Partition;
use crate::Result;

/// Maximum number of iterations of 2-means.
const ITERATIONS: usize = 30;

struct Leaf {
    /// Ascending.
    points: Vec<u32>,
    /// How much a split lowers the squared error, and the two halves.
    halves: Option<(f64, [Vec<u32>; 2])>,
}

/// Splits `values` (point, dimension) into at most `count` leaves; the two halves of a leaf have consecutive numbers.
/// Calls `step` after each split.
///
/// # Errors
/// Errors of `step`.
pub fn tree_clusters(
    values: &[f32],
    dimensions: usize,
    count: usize,
    step: &dyn Fn() -> Result<()>,
) -> Result<Partition> {
    let leaf = |points: Vec<u32>| Leaf { halves: halve(values, dimensions, &points), points };
    let points = (values.len() / dimensions) as u32;
    // in order of their numbers
    let mut leaves = vec![leaf((0..points).collect())];
    while leaves.len() < count {
        let gain = |leaf: &Leaf| leaf.halves.as_ref().map_or(0.0, |(gain, _)| *gain);
        let next = (0..leaves.len()).fold(0, |best, i| if gain(&leaves[i]) > gain(&leaves[best]) { i } else { best });
        let Some((_, [low, high])) = leaves[next].halves.take() else { break };
        let (low, high) = rayon::join(|| leaf(low), || leaf(high));
        leaves.splice(next..=next, [low, high]);
        step()?;
    }
    let mut index = vec![0; points as usize];
    for (k, leaf) in leaves.iter().enumerate() {
        leaf.points.iter().for_each(|&point| index[point as usize] = k as u32);
    }
    Ok(Partition { index, clusters: leaves.len() })
}

/// The mean of `points`, and their coordinate of largest variance.
fn mean_and_widest(values: &[f32], dimensions: usize, points: &[u32]) -> (Vec<f64>, usize) {
    let (mut mean, mut squares) = (vec![0.0f64; dimensions], vec![0.0f64; dimensions]);
    for &p in points {
        let point = &values[p as usize * dimensions..][..dimensions];
        for ((mean, square), &v) in mean.iter_mut().zip(&mut squares).zip(point) {
            *mean += f64::from(v);
            *square += f64::from(v) * f64::from(v);
        }
    }
    let n = points.len() as f64;
    mean.iter_mut().for_each(|m| *m /= n);
    let variance = |d: usize| squares[d] / n - mean[d] * mean[d];
    let widest = (1..dimensions).fold(0, |best, d| if variance(d) > variance(best) { d } else { best });
    (mean, widest)
}

/// Splits some points in two by 2-means: how much that lowers the squared error, and the halves; `None` if all points are equal.
pub fn halve(values: &[f32], dimensions: usize, points: &[u32]) -> Option<(f64, [Vec<u32>; 2])> {
    let point = |p: u32| &values[p as usize * dimensions..][..dimensions];
    let (mean, widest) = mean_and_widest(values, dimensions, points);
    let n = points.len() as f64;
    let mut high: Vec<bool> = points.iter().map(|&p| f64::from(point(p)[widest]) > mean[widest]).collect();
    let mut gain = 0.0;
    for _ in 0..=ITERATIONS {
        let (mut sums, mut count) = (vec![0.0f64; dimensions], 0.0);
        for (&p, _) in points.iter().zip(&high).filter(|(_, high)| **high) {
            sums.iter_mut().zip(point(p)).for_each(|(sum, &v)| *sum += f64::from(v));
            count += 1.0;
        }
        if count == 0.0 || count == n {
            return None;
        }
        // the lower mean follows from the upper mean and that of all points
        let upper: Vec<f64> = sums.iter().map(|sum| sum / count).collect();
        let lower: Vec<f64> = sums.iter().zip(&mean).map(|(sum, mean)| (mean * n - sum) / (n - count)).collect();
        let apart: Vec<f32> = upper.iter().zip(&lower).map(|(a, b)| (a - b) as f32).collect();
        let middle: f64 = upper.iter().zip(&lower).map(|(a, b)| 0.5 * (a * a - b * b)).sum();
        let previous = gain;
        gain = count * (n - count) / n * upper.iter().zip(&lower).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        if gain <= previous * (1.0 + 1e-9) {
            break;
        }
        for (&p, high) in points.iter().zip(&mut high) {
            *high = f64::from(dot(point(p), &apart)) > middle;
        }
    }
    let half = |side: bool| points.iter().zip(&high).filter(|(_, high)| **high == side).map(|(&p, _)| p).collect();
    let halves: [Vec<u32>; 2] = [half(false), half(true)];
    (gain > 0.0 && halves.iter().all(|half| !half.is_empty())).then_some((gain, halves))
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0f32; 8];
    let (whole_a, rest_a) = a.as_chunks::<8>();
    let (whole_b, rest_b) = b.as_chunks::<8>();
    for (a, b) in whole_a.iter().zip(whole_b) {
        (0..8).for_each(|i| lanes[i] += a[i] * b[i]);
    }
    lanes.iter().sum::<f32>() + rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separate_clusters_are_found_and_equal_points_stay_together() {
        let values: Vec<f32> =
            (0..800).map(|i| (i / 2 % 4) as f32 * [10.0, 3.0][i % 2] + (i % 7) as f32 * 0.01).collect();
        let found = tree_clusters(&values, 2, 4, &|| Ok(())).unwrap();
        assert_eq!(found.clusters, 4);
        assert!((0..400).all(|p| found.index[p] == found.index[p % 4]), "{found:?}");
        assert_eq!(found.index[..4], [0, 1, 2, 3]);
        let equal = tree_clusters(&[1.0, 2.0, 1.0, 2.0, 1.0, 2.0], 2, 3, &|| Ok(())).unwrap();
        assert_eq!(equal.clusters, 1);
        assert_eq!(tree_clusters(&[1.0, 2.0, 3.0], 1, 9, &|| Ok(())).unwrap().index, [0, 1, 2]);
    }
}
