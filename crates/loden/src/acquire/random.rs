//! Well-distributed samples of a texel that depend only on a seed and their index.

use glam::Vec2;

use crate::random::mix;

/// The first four dimensions of the samples of a texel: a rank-1 sequence with a random shift, so every sample is
/// uniform and together they are well distributed.
///
/// # References
/// roberts2018
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread([u32; 4]);

impl Spread {
    pub(super) fn new(seed: u64) -> Self {
        let (a, b) = (mix(seed), mix(!seed));
        Self([a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32])
    }

    /// Sample `index` in [0, 1)^4: the position in the texel, and the random numbers of the first reflection.
    #[inline]
    pub(super) fn point(self, index: u32) -> (Vec2, Vec2) {
        // 2^32 / phi^k with phi^5 = phi + 1
        const STEP: [u32; 4] = [3_679_390_609, 3_152_041_523, 2_700_274_806, 2_313_257_605];
        let [a, b, c, d] = [0, 1, 2, 3]
            .map(|k| (self.0[k].wrapping_add(index.wrapping_mul(STEP[k])) >> 8) as f32 * (1.0 / (1 << 24) as f32));
        (Vec2::new(a, b), Vec2::new(c, d))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_powers_of_the_ratio() {
        let phi: f64 = 1.167_303_978_261_418_7;
        assert!((phi.powi(5) - phi - 1.0).abs() < 1e-12);
        let (a, b) = (Spread([0; 4]).point(1), [1, 2, 3, 4].map(|k| phi.powi(-k) as f32));
        for (found, expected) in [a.0.x, a.0.y, a.1.x, a.1.y].iter().zip(b) {
            assert!((found - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn spread_samples_fill_every_stratum() {
        for seed in 0..20 {
            let mut seen = [[false; 8]; 4];
            for k in 0..64 {
                let (a, b) = Spread::new(seed).point(k);
                for (row, v) in seen.iter_mut().zip([a.x, a.y, b.x, b.y]) {
                    row[(v * 8.0) as usize] = true;
                }
            }
            assert!(seen.as_flattened().iter().all(|&s| s));
        }
    }
}
