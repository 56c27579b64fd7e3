//! Low-discrepancy random numbers that depend only on seed, pixel, sample and dimension.

use bytemuck::{Pod, Zeroable};
use glam::Vec2;

/// Owen-scrambled Sobol points, padded pair by pair of dimensions.
///
/// # Model
/// Each pair of dimensions is the two-dimensional (0, 2)-sequence of Sobol, its index shuffled and its values
/// scrambled by a hash that approximates Owen's random permutation trees. Any 2^k samples of a pixel are well
/// stratified in each pair; pairs and pixels are independent of each other. There is no state beyond a
/// counter, so tiles and threads cannot change the result.
///
/// # Limits
/// Pairs are stratified only within themselves, not with each other; 2^24 values per dimension.
///
/// # References
/// burley2020 sections 3 and 4
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Sampler {
    pixel: u32,
    /// Bit-reversed sample index.
    reversed_index: u32,
    dimension: u32,
}

impl Sampler {
    /// The numbers of sample `index` of a pixel.
    #[inline(always)]
    pub fn new(seed: u64, x: u32, y: u32, index: u32) -> Self {
        let pixel = hash(hash(seed as u32 ^ hash((seed >> 32) as u32)).wrapping_add(x)) ^ y.wrapping_mul(0x9e37_79b9);
        Self { pixel: hash(pixel), reversed_index: index.reverse_bits(), dimension: 0 }
    }

    /// The next two numbers in [0, 1).
    #[inline(always)]
    pub fn next_2d(&mut self) -> Vec2 {
        let (shuffle, scramble) = self.seeds();
        let index = owen_reversed(self.reversed_index, shuffle).reverse_bits();
        let x = owen_reversed(index, scramble).reverse_bits();
        let y = owen_reversed(sobol_1_reversed(index), scramble.rotate_left(16) ^ shuffle).reverse_bits();
        Vec2::new(unit(x), unit(y))
    }

    /// The next number in [0, 1).
    #[inline(always)]
    pub fn next_1d(&mut self) -> f32 {
        let (shuffle, scramble) = self.seeds();
        let index = owen_reversed(self.reversed_index, shuffle).reverse_bits();
        unit(owen_reversed(index, scramble).reverse_bits())
    }

    /// Two independent seeds for the next dimension.
    #[inline(always)]
    fn seeds(&mut self) -> (u32, u32) {
        self.dimension += 1;
        let shuffle = hash(self.pixel ^ self.dimension.wrapping_mul(0x9e37_79b9));
        (shuffle, hash(shuffle ^ 0x85eb_ca6b))
    }
}

#[inline(always)]
fn unit(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// Sobol's second dimension before the bit reversal: the Pascal matrix mod 2 times the index. Binomials are odd
/// where the bits of k lie within those of n, so the product is a sum over supersets of bit positions.
#[inline(always)]
fn sobol_1_reversed(mut x: u32) -> u32 {
    x ^= (x >> 1) & 0x5555_5555;
    x ^= (x >> 2) & 0x3333_3333;
    x ^= (x >> 4) & 0x0f0f_0f0f;
    x ^= (x >> 8) & 0x00ff_00ff;
    x ^ (x >> 16)
}

/// Owen scrambling of a bit-reversed value by the Laine-Karras hash.
#[inline(always)]
fn owen_reversed(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// A bijective integer hash with good avalanche.
#[inline(always)]
fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x21f0_aaad);
    x = (x ^ (x >> 15)).wrapping_mul(0x735a_2d97);
    x ^ (x >> 15)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(x: u32, dimension: usize, n: u32) -> Vec<Vec2> {
        let point = |i| {
            let mut sampler = Sampler::new(7, x, 3, i);
            (0..=dimension).map(|_| sampler.next_2d()).last().unwrap()
        };
        (0..n).map(point).collect()
    }

    #[test]
    fn every_pair_of_dimensions_is_a_net_in_base_2() {
        for (pixel, dimension) in [(0, 0), (5, 1), (9, 6)] {
            let points = points(pixel, dimension, 64);
            for log_columns in 0..=6 {
                let (columns, rows) = (1 << log_columns, 64 >> log_columns);
                let mut count = vec![0; 64];
                for p in &points {
                    count[(p.y * rows as f32) as usize * columns + (p.x * columns as f32) as usize] += 1;
                }
                assert!(count.iter().all(|&c| c == 1), "{columns} x {rows}: {count:?}");
            }
        }
    }

    #[test]
    fn pixels_and_dimensions_are_uncorrelated() {
        let n = 4096;
        let correlation =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - 0.5) * (b - 0.5)).sum::<f32>() / n as f32 * 12.0;
        let first = |x, d| points(x, d, n).iter().map(|p| p.x).collect::<Vec<_>>();
        // the standard deviation of independent numbers is 1/64
        assert!(correlation(&first(0, 0), &first(1, 0)).abs() < 0.06);
        assert!(correlation(&first(0, 0), &first(0, 1)).abs() < 0.06);
        assert!(correlation(&first(2, 3), &points(2, 3, n).iter().map(|p| p.y).collect::<Vec<_>>()).abs() < 0.06);
    }
}
