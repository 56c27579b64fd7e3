//! Random numbers that depend only on their purpose, not on the order of the calls.

use glam::Vec2;

/// One round of mixing: a bijection of 64-bit numbers.
///
/// # References
/// steele2014
#[inline]
pub(crate) fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// Hashes several numbers into one, for use as a seed.
#[inline]
pub(crate) fn hash(parts: &[u64]) -> u64 {
    parts.iter().fold(0, |state, &part| mix(state ^ part))
}

/// The upper 24 bits as a number in [0, 1).
#[inline]
pub(crate) fn unit(bits: u64) -> f32 {
    (bits >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
}

/// A stream of random numbers from a seed.
#[derive(Debug, Clone)]
pub(crate) struct Stream(u64);

impl Stream {
    #[inline]
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in [0, 1).
    #[inline]
    pub(crate) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        unit(mix(self.0))
    }

    #[inline]
    pub(crate) fn next2(&mut self) -> Vec2 {
        Vec2::new(self.next(), self.next())
    }

    /// A whole number below `n`, which is at most 2^24.
    #[inline]
    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.next() as f64 * n as f64) as usize
    }

    /// Uniform in [low, high).
    #[inline]
    pub(crate) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next()
    }
}
