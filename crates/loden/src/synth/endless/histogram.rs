//! The distribution of a coefficient, and its transform to a Gaussian one.

use super::super::normal;

/// Largest Gaussian value, in standard deviations, and the steps up to it.
const REACH: f32 = 4.0;
const STEPS: usize = 512;

/// Values of a coefficient by their Gaussian ones.
pub(super) struct Histogram {
    /// From -[`REACH`] to [`REACH`].
    values: Vec<f32>,
}

impl Histogram {
    /// The histogram of a coefficient in all texels, and the Gaussian value of each. `weights` tells how often texels are
    /// used, so that what is blended is Gaussian; transformed back, all count alike.
    pub(super) fn new(coefficients: &[f32], weights: &[f32]) -> (Self, Vec<f32>) {
        let mut order: Vec<u32> = (0..coefficients.len() as u32).collect();
        order.sort_by(|a, b| coefficients[*a as usize].total_cmp(&coefficients[*b as usize]));
        let total: f64 = weights.iter().map(|w| f64::from(*w)).sum();
        let mut gaussian = vec![0.0; coefficients.len()];
        let mut sum = 0.0;
        // Equal values get the same place, in the middle of theirs
        for equal in order.chunk_by(|a, b| coefficients[*a as usize] == coefficients[*b as usize]) {
            let weight: f64 = equal.iter().map(|texel| f64::from(weights[*texel as usize])).sum();
            let place = (sum + 0.5 * weight) / total;
            let value = normal::quantile(place.clamp(1e-9, 1.0 - 1e-9)).clamp(-f64::from(REACH), f64::from(REACH));
            equal.iter().for_each(|texel| gaussian[*texel as usize] = value as f32);
            sum += weight;
        }
        let sorted: Vec<f64> = order.iter().map(|texel| f64::from(coefficients[*texel as usize])).collect();
        (Self::of_sorted(&sorted), gaussian)
    }

    fn of_sorted(sorted: &[f64]) -> Self {
        let value = |place: f64| {
            let at = (place * sorted.len() as f64 - 0.5).clamp(0.0, (sorted.len() - 1) as f64);
            let first = (at.floor() as usize).min(sorted.len().saturating_sub(2));
            let next = (first + 1).min(sorted.len() - 1);
            sorted[first] + (at - first as f64) * (sorted[next] - sorted[first])
        };
        let step = |k: usize| f64::from(REACH) * (2.0 * k as f64 / STEPS as f64 - 1.0);
        Self { values: (0..=STEPS).map(|k| value(normal::distribution(step(k))) as f32).collect() }
    }

    /// The value of a Gaussian number.
    #[inline(always)]
    pub(super) fn value(&self, gaussian: f32) -> f32 {
        let at = ((gaussian + REACH) * (STEPS as f32 / (2.0 * REACH))).clamp(0.0, STEPS as f32 - 1e-3);
        let first = at as usize;
        let [a, b] = [self.values[first], self.values[first + 1]];
        a + (at - first as f32) * (b - a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;

    #[test]
    fn values_become_gaussian_and_back() {
        let mut random = Stream::new(3);
        let skewed: Vec<f32> = (0..10_000).map(|_| random.next().powi(3)).collect();
        let (histogram, gaussian) = Histogram::new(&skewed, &vec![1.0; skewed.len()]);
        let mean = |f: &dyn Fn(f32) -> f32| gaussian.iter().map(|g| f64::from(f(*g))).sum::<f64>() / 1e4;
        assert!(mean(&|g| g).abs() < 1e-3 && (mean(&|g| g * g) - 1.0).abs() < 5e-3);
        assert!(mean(&|g| g.powi(3)).abs() < 0.02);
        for (value, gaussian) in skewed.iter().zip(&gaussian) {
            assert!((histogram.value(*gaussian) - value).abs() < 0.01, "{value}");
        }
    }

    #[test]
    fn equal_values_stay_and_rare_use_does_not_change_the_distribution() {
        let (histogram, gaussian) = Histogram::new(&[2.5; 40], &[1.0; 40]);
        assert!(gaussian.iter().all(|g| g.abs() < 1e-6) && histogram.value(1.7) == 2.5);
        // large values are seldom used
        let values: Vec<f32> = (0..1000).map(|i| i as f32).collect();
        let weights: Vec<f32> = (0..1000).map(|i| if i < 500 { 1.5 } else { 0.5 }).collect();
        let (histogram, gaussian) = Histogram::new(&values, &weights);
        let sum: f32 = gaussian.iter().zip(&weights).map(|(g, w)| w * histogram.value(*g)).sum();
        assert!((sum / 1000.0 - 499.5).abs() < 3.0, "{}", sum / 1000.0);
    }
}
