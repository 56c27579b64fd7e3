//! The first principal components of 8-bit images in memory.
//!
//! Use it for the images of one view; [`super::global`] reads matrices that are larger than memory.
//!
//! # Model
//! For a few components of many images the scatter matrix S is never formed. An estimate of S from every eighth tile of
//! texels gives a first basis V with some more columns than components are wanted. A pass over all texels multiplies it
//! by S: with the matrix M of texels and images, S V = M^T (M V) minus the contribution of the means. The Ritz pairs of
//! V order the columns, and S V becomes the next basis (subspace iteration). Passes end when another one would gain
//! less than a ten-thousandth of the energy left out, as estimated from the residuals of the Ritz pairs.
//!
//! M V is rounded to 14 bits and its products with M are exact integers, so results do not depend on the processor.
//!
//! # Limits
//! The estimate of the gain assumes a spectrum that decays. If it stays large for four passes, or for many components,
//! few texels or images of low rank, the exact scatter matrix is computed.
//!
//! # References
//! halko2011

use super::linalg::{Eigen, combine_rows, fix_sign, largest_eigenpairs, orthonormal_rows, product_with_transposed};
use super::moments::{cross_products, flush, moments_u8, sampled_moments_u8};
use super::tile::{ByteTile, GROUP, STEP, Tile};

/// Mean and principal components.
#[derive(Debug, Clone, PartialEq)]
pub struct Principal {
    /// Mean of each column of the matrix of texels and (image, channel).
    pub mean: Vec<f64>,
    /// Unit vectors, one after the other, largest variance first. The entry of largest magnitude of each is positive.
    pub vectors: Vec<f64>,
}

/// The first basis uses one in this many tiles.
const EVERY: usize = 8;

/// Passes over all texels before the exact matrix is computed.
const PASSES: usize = 4;

/// Energy that another pass may gain, as a fraction of the energy left out.
const TOLERANCE: f64 = 1e-4;

/// Bits to which the products of texels with a basis are rounded.
const BITS: u32 = 14;

/// The first `count` principal components of 8-bit RGB `images` of `image_len` bytes each, scaled so that 255 is 1.
/// `None` if the decomposition fails.
pub fn principal_u8(images: &[u8], image_len: usize, tile: &mut ByteTile, count: usize) -> Option<Principal> {
    let width = (count + 2).next_multiple_of(GROUP);
    let worth = 10 * width <= tile.rows() && image_len / 3 >= 2 * EVERY * tile.texels();
    worth.then(|| iterate(images, image_len, tile, count, width)).flatten().or_else(|| {
        let moments = moments_u8(images, image_len, tile);
        let eigen = largest_eigenpairs(&moments.scatter, tile.rows(), count)?;
        Some(Principal { mean: moments.mean, vectors: eigen.vectors })
    })
}

fn iterate(images: &[u8], image_len: usize, tile: &mut ByteTile, count: usize, width: usize) -> Option<Principal> {
    let n = tile.rows();
    let sample = sampled_moments_u8(images, image_len, tile, EVERY);
    let share = texels_seen(image_len / 3, tile.texels()) / (image_len / 3) as f64;
    let energy = (0..n).map(|i| sample.scatter[i * n + i]).sum::<f64>() / share;
    let mut basis = largest_eigenpairs(&sample.scatter, n, width)?.vectors;
    for _ in 0..PASSES {
        let (mean, image) = image_of(&basis, width, images, image_len, tile);
        let ritz = Ritz::new(&basis, &image, n)?;
        let left = energy - ritz.values[..count].iter().sum::<f64>();
        basis = orthonormal_rows(&ritz.images, n)?;
        if ritz.gain(count, n, 2) <= TOLERANCE * left.max(1e-5 * energy) {
            basis.truncate(count * n);
            basis.chunks_exact_mut(n).for_each(|vector| {
                fix_sign(vector);
            });
            return Some(Principal { mean, vectors: basis });
        }
    }
    None
}

/// Number of texels in every [`EVERY`]-th tile.
fn texels_seen(texels: usize, tile: usize) -> f64 {
    (0..texels).step_by(tile * EVERY).map(|first| tile.min(texels - first)).sum::<usize>() as f64
}

/// Ritz pairs of a basis, with the images of the vectors under the scatter matrix S.
pub(super) struct Ritz {
    /// Largest first.
    pub values: Vec<f64>,
    vectors: Vec<f64>,
    /// Row by row.
    pub images: Vec<f64>,
}

impl Ritz {
    /// All Ritz pairs of the orthonormal rows of `basis`, which have the images `image`; rows have length `n`.
    pub fn new(basis: &[f64], image: &[f64], n: usize) -> Option<Self> {
        let width = basis.len() / n;
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let pairs = |i: usize, j: usize| dot(&basis[i * n..(i + 1) * n], &image[j * n..(j + 1) * n]);
        let inner: Vec<f64> = (0..width * width).map(|i| pairs(i / width, i % width)).collect();
        Self::of_products(&inner, basis, image, n, width)
    }

    /// The `count` largest Ritz pairs, as [`Ritz::new`]; faster for a large basis, but rounded differently.
    pub fn largest(basis: &[f64], image: &[f64], n: usize, count: usize) -> Option<Self> {
        Self::of_products(&product_with_transposed(basis, image, n), basis, image, n, count)
    }

    /// The `count` largest Ritz pairs, from the products of all rows of the basis with all images.
    fn of_products(inner: &[f64], basis: &[f64], image: &[f64], n: usize, count: usize) -> Option<Self> {
        let width = basis.len() / n;
        let symmetric: Vec<f64> =
            (0..width * width).map(|i| 0.5 * (inner[i] + inner[i % width * width + i / width])).collect();
        let Eigen { values, vectors: rotation } = largest_eigenpairs(&symmetric, width, count)?;
        Some(Self { vectors: combine_rows(&rotation, basis, n), images: combine_rows(&rotation, image, n), values })
    }

    /// An orthonormal basis of the span of the images; the Ritz vectors if that has fewer dimensions.
    pub fn next_basis(self, n: usize) -> Vec<f64> {
        orthonormal_rows(&self.images, n).unwrap_or(self.vectors)
    }

    /// The Ritz vectors, row by row.
    pub fn into_vectors(self) -> Vec<f64> {
        self.vectors
    }

    /// Energy of all but the first `count` components, at least a ten-millionth of `energy`, which is that of all.
    fn left_out(&self, count: usize, energy: f64) -> f64 {
        (energy - self.values[..count].iter().sum::<f64>()).max(1e-7 * energy)
    }

    /// Whether [`Self::gain`] is at most `tolerance` of the energy that the first `count` components leave out.
    pub fn converged(&self, tolerance: f64, count: usize, n: usize, steps: i32, energy: f64) -> bool {
        self.gain(count, n, steps) <= tolerance * self.left_out(count, energy)
    }

    /// Whether the first `count` components miss at most `tolerance` of the energy they leave out, and each of them at
    /// most `component_tolerance` of its own energy.
    pub fn components_converged(
        &self,
        [tolerance, component_tolerance]: [f64; 2],
        count: usize,
        n: usize,
        energy: f64,
    ) -> bool {
        // what a Krylov space lacks is no larger than the first component that is not wanted
        let outside = self.values[count.min(self.values.len() - 1)].max(0.0);
        let missed: Vec<f64> = (0..count).map(|k| self.missed(k, n, 1, outside)).collect();
        let small = |(missed, value): (&f64, &f64)| *missed <= component_tolerance * value.max(1e-7 * energy);
        missed.iter().sum::<f64>() <= tolerance * self.left_out(count, energy)
            && missed.iter().zip(&self.values).all(small)
    }

    /// An estimate of the energy that the first `count` vectors of a span still miss. The span is `steps` steps of the power
    /// method ahead of the basis: 1 for the span of the products, 2 for that of the images.
    pub fn gain(&self, count: usize, n: usize, steps: i32) -> f64 {
        let last = self.values[self.values.len() - 1].max(0.0);
        (0..count).map(|k| self.missed(k, n, steps, last)).sum()
    }

    /// An estimate of the energy that pair `k` misses after `steps` steps of the power method: the share of its residual
    /// outside of the basis, where eigenvalues are at most `outside`.
    fn missed(&self, k: usize, n: usize, steps: i32, outside: f64) -> f64 {
        let (value, range) = (self.values[k].max(f64::MIN_POSITIVE), k * n..(k + 1) * n);
        let pairs = self.images[range.clone()].iter().zip(&self.vectors[range]);
        let residual: f64 = pairs.map(|(image, v)| (image - value * v).powi(2)).sum();
        residual / (value - outside).max(value / 8.0) * (outside / value).powi(steps)
    }
}

/// The exact mean of the columns, and S times the rounded rows of `basis`, row by row.
fn image_of(basis: &[f64], width: usize, images: &[u8], image_len: usize, tile: &mut ByteTile) -> (Vec<f64>, Vec<f64>) {
    let (n, rows, texels) = (tile.rows(), tile.rows_padded(), image_len / 3);
    let rounded = Rounded::new(basis, n);
    let mut products = tile.beside(width);
    let mut sums = vec![0i64; rows * width];
    let mut block = vec![0i32; rows * width];
    let mut row_sums = vec![0i64; n];
    for first in (0..texels).step_by(tile.texels()) {
        tile.load(images, image_len, first, tile.texels().min(texels - first));
        rounded.project(tile, &mut products);
        cross_products(tile, &products, &mut block);
        flush(&mut block, &mut sums);
        tile.add_sums(&mut row_sums);
    }
    let mean: Vec<f64> = row_sums.iter().map(|&sum| (sum as f64 / texels as f64 + 128.0) / 255.0).collect();
    let mut image = vec![0.0; width * n];
    for (k, image) in image.chunks_exact_mut(n).enumerate() {
        let scale = rounded.scale[k] / (255.0 * 255.0);
        // the row of ones holds the sums of the products
        let mean_product = sums[n * width + k] as f64 / texels as f64;
        for (i, out) in image.iter_mut().enumerate() {
            *out = (sums[i * width + k] as f64 - row_sums[i] as f64 * mean_product) * scale;
        }
    }
    (mean, image)
}

/// A basis rounded to 16-bit integers.
struct Rounded {
    /// (pair of rows of the tile, column): two numbers
    pairs: Vec<[i16; 2]>,
    width: usize,
    /// Bits that are dropped from the products of each column.
    shift: Vec<u32>,
    /// Value of one unit of the products of each column.
    scale: Vec<f64>,
}

impl Rounded {
    /// Rounds a basis with rows of length `n`.
    fn new(basis: &[f64], n: usize) -> Self {
        let width = basis.len() / n;
        let mut all = Self { pairs: vec![[0; 2]; n.div_ceil(2) * width], width, shift: vec![], scale: vec![] };
        for (k, row) in basis.chunks_exact(n).enumerate() {
            let largest = row.iter().fold(f64::MIN_POSITIVE, |m, v| m.max(v.abs()));
            // 128 times the sum of magnitudes must stay below 2^31
            let sum: f64 = row.iter().map(|v| v.abs()).sum();
            let unit = (f64::from(i16::MAX) / largest).min(f64::from(1 << 23) / sum.max(f64::MIN_POSITIVE));
            let mut bound = 0u32;
            for (i, v) in row.iter().enumerate() {
                let rounded = (v * unit).round() as i16;
                all.pairs[i / 2 * width + k][i % 2] = rounded;
                bound += u32::from(rounded.unsigned_abs()) * 128;
            }
            let shift = (32 - bound.leading_zeros()).saturating_sub(BITS);
            all.shift.push(shift);
            all.scale.push(f64::from(1u32 << shift) / unit);
        }
        all
    }

    /// Products of the texels of a tile with the columns, rounded down to [`BITS`] bits and a sign.
    fn project(&self, tile: &ByteTile, out: &mut ByteTile) {
        for first in (0..self.width).step_by(GROUP) {
            #[cfg(target_arch = "x86_64")]
            if crate::simd::has_avx2() {
                // SAFETY: the processor has AVX2.
                unsafe { self.project_avx2(tile, first, out) };
                continue;
            }
            for step in 0..tile.texels() / STEP {
                for k in first..first + GROUP {
                    let mut sums = [0i32; STEP];
                    for row in 0..tile.rows() {
                        let factor = i32::from(self.pairs[row / 2 * self.width + k][row % 2]);
                        let values = tile.integers(row, step);
                        sums.iter_mut().zip(values).for_each(|(sum, &v)| *sum += i32::from(v) * factor);
                    }
                    *out.integers_mut(k, step) = sums.map(|sum| (sum >> self.shift[k]) as i16);
                }
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn project_avx2(&self, tile: &ByteTile, first: usize, out: &mut ByteTile) {
        use std::arch::x86_64::*;
        let (data, steps, pairs) = (tile.data(), tile.texels() / STEP, tile.rows().div_ceil(2));
        assert!(data.len() == tile.rows_padded() * steps * STEP && self.pairs.len() == pairs * self.width);
        assert!(first + GROUP <= self.width && 2 * pairs <= tile.rows_padded());
        for step in 0..steps {
            let mut sums = [[_mm256_setzero_si256(); 2]; GROUP];
            for pair in 0..pairs {
                let row = 2 * pair;
                // SAFETY: rows 2 pair and 2 pair + 1 are in one group, vectors of 16 numbers that follow each other, at
                // multiples of 32 bytes; GROUP pairs of numbers follow `first`.
                let (a, b, factors) = unsafe {
                    let place = ((row / GROUP * steps + step) * GROUP + row % GROUP) * STEP;
                    let a = data.as_ptr().add(place).cast();
                    let factors = self.pairs.as_ptr().add(pair * self.width + first).cast::<i32>();
                    (_mm256_load_si256(a), _mm256_load_si256(a.add(1)), factors)
                };
                let (low, high) = (_mm256_unpacklo_epi16(a, b), _mm256_unpackhi_epi16(a, b));
                for (k, sums) in sums.iter_mut().enumerate() {
                    // SAFETY: as above.
                    let factor = _mm256_set1_epi32(unsafe { factors.add(k).read_unaligned() });
                    sums[0] = _mm256_add_epi32(sums[0], _mm256_madd_epi16(low, factor));
                    sums[1] = _mm256_add_epi32(sums[1], _mm256_madd_epi16(high, factor));
                }
            }
            for (k, [low, high]) in sums.into_iter().enumerate() {
                let shift = _mm_cvtsi32_si128(self.shift[first + k] as i32);
                let cut = _mm256_packs_epi32(_mm256_sra_epi32(low, shift), _mm256_sra_epi32(high, shift));
                // SAFETY: 16 numbers.
                unsafe { _mm256_storeu_si256(out.integers_mut(first + k, step).as_mut_ptr().cast(), cut) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::portable;

    /// Images of noise plus components of a decaying spectrum.
    fn images(count: usize, texels: usize, rank: usize) -> Vec<u8> {
        let mut state = 7u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1u32 << 24) - 0.5
        };
        let modes: Vec<f64> = (0..rank * 3 * count).map(|_| noise()).collect();
        let mut out = vec![0; 3 * count * texels];
        for t in 0..texels {
            let amounts: Vec<f64> = (0..rank).map(|k| 300.0 * noise() * 0.7f64.powi(k as i32)).collect();
            for i in 0..3 * count {
                let sum: f64 = amounts.iter().enumerate().map(|(k, a)| a * modes[k * 3 * count + i]).sum();
                out[(i / 3 * texels + t) * 3 + i % 3] = (90.0 + sum + 8.0 * noise()).round().clamp(0.0, 255.0) as u8;
            }
        }
        out
    }

    /// The energy that a basis captures.
    fn captured(vectors: &[f64], scatter: &[f64], n: usize) -> f64 {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        vectors.chunks_exact(n).map(|v| (0..n).map(|i| v[i] * dot(&scatter[i * n..(i + 1) * n], v)).sum::<f64>()).sum()
    }

    #[test]
    fn the_iteration_finds_what_the_exact_matrix_finds() {
        let (count, texels) = (60, 20_000);
        let n = 3 * count;
        for (rank, wanted) in [(40, 4), (40, 9), (3, 4)] {
            let data = images(count, texels, rank);
            let mut tile = ByteTile::new(n);
            let exact = moments_u8(&data, 3 * texels, &mut tile);
            let eigen = largest_eigenpairs(&exact.scatter, n, wanted).unwrap();
            let trace: f64 = (0..n).map(|i| exact.scatter[i * n + i]).sum();
            let found = principal_u8(&data, 3 * texels, &mut tile, wanted).unwrap();
            let width = (wanted + 2).next_multiple_of(GROUP);
            let iterated = iterate(&data, 3 * texels, &mut tile, wanted, width);
            // noise after three components has a flat spectrum: there the exact matrix is needed
            assert_eq!(iterated.is_some_and(|i| i == found), rank > wanted, "{rank} {wanted}");
            let best = captured(&eigen.vectors, &exact.scatter, n);
            let got = captured(&found.vectors, &exact.scatter, n);
            assert!(best - got <= 2e-4 * (trace - best), "{rank} {wanted}: {best} {got} of {trace}");
            for (k, (a, b)) in found.mean.iter().zip(&exact.mean).enumerate() {
                assert!((a - b).abs() < 1e-12, "{k}: {a} {b}");
            }
            for i in 0..wanted * wanted {
                let (a, b) = (&found.vectors[i / wanted * n..][..n], &found.vectors[i % wanted * n..][..n]);
                let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                assert!((dot - f64::from(u8::from(i / wanted == i % wanted))).abs() < 1e-12);
            }
            let same = portable(|| principal_u8(&data, 3 * texels, &mut tile, wanted)).is_some_and(|p| p == found);
            assert!(same, "{rank} {wanted}: the portable form gives the same");
        }
    }

    #[test]
    fn constant_images_fall_back_to_the_exact_matrix() {
        let (count, texels) = (30, 20_000);
        let data = vec![200; 3 * count * texels];
        let found = principal_u8(&data, 3 * texels, &mut ByteTile::new(3 * count), 4).unwrap();
        assert!(found.mean.iter().all(|m| (m - 200.0 / 255.0).abs() < 1e-12));
        assert_eq!(found.vectors.len(), 4 * 3 * count);
    }
}
