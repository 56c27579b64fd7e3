//! Random numbers that depend only on their purpose, not on the order of the calls.

use glam::Vec2;

/// One round of mixing: a bijection of 64-bit numbers.
///
/// # References
/// steele2014
#[inline]
pub(super) fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// Hashes several numbers into one, for use as a seed.
#[inline]
pub(super) fn hash(parts: &[u64]) -> u64 {
    parts.iter().fold(0, |state, &part| mix(state ^ part))
}

/// The upper 24 bits as a number in [0, 1).
#[inline]
pub(super) fn unit(bits: u64) -> f32 {
    (bits >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
}

/// A stream of random numbers from a seed.
#[derive(Debug, Clone)]
pub(super) struct Stream(u64);

impl Stream {
    #[inline]
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in [0, 1).
    #[inline]
    pub(super) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        unit(mix(self.0))
    }

    #[inline]
    pub(super) fn next2(&mut self) -> Vec2 {
        Vec2::new(self.next(), self.next())
    }

    /// Uniform in [low, high).
    #[inline]
    pub(super) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next()
    }
}

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
