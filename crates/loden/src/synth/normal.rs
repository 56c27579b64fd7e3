//! The normal distribution.

use std::f64::consts::FRAC_1_SQRT_2;

/// The probability of a smaller number.
pub(super) fn distribution(x: f64) -> f64 {
    0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
}

/// The number below which lies this probability, which is inside 0 to 1.
pub(super) fn quantile(probability: f64) -> f64 {
    // bisection: 60 halvings of a range that holds all doubles but the last bits
    let (mut low, mut high) = (-9.0, 9.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if distribution(middle) < probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_invert_the_distribution() {
        for (probability, expected) in [(0.5, 0.0), (0.975, 1.959_963_984_540_054), (1e-6, -4.753_424_308_822_899)] {
            assert!((quantile(probability) - expected).abs() < 1e-9, "{probability}");
            assert!((distribution(expected) - probability).abs() < 1e-12);
        }
    }
}
