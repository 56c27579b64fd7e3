//! Products of a tile with a few rows of numbers. For few rows this is faster than a general matrix product, because
//! nothing is packed.
//!
//! # Limits
//! With FMA, a product and its sum are rounded once; without it, the library is used. The last digits depend on the
//! processor.

use super::linalg::{Rows, add_product, add_product_transposed};
use super::tile::{FloatTile, STEP, Tile};

/// Rows per kernel call: two vectors of sums per row fit the registers, with some left for the operands.
const GROUP: usize = 6;

/// Maximum number of rows for these kernels; beyond it the library is as fast.
const FEW: usize = 48;

/// Numbers per vector.
#[cfg(target_arch = "x86_64")]
const LANES: usize = 8;

/// Rows of factors, one factor for each row of a tile, in the order in which they are read.
pub struct Factors {
    rows: Vec<f32>,
    /// (group, row of the tile, row of the group); empty where the library is used
    packed: Vec<f32>,
    len: usize,
}

impl Factors {
    /// Packs rows of `len` numbers.
    pub fn new(rows: Vec<f32>, len: usize) -> Self {
        let mut packed = Vec::new();
        if few(rows.len() / len) {
            for group in rows.chunks(GROUP * len) {
                packed.extend((0..len * GROUP).map(|i| group.get(i % GROUP * len + i / GROUP).copied().unwrap_or(0.0)));
            }
        }
        Self { rows, packed, len }
    }

    /// Adds the products with a tile to `out`: (row, texel of the tile).
    pub fn add_products(&self, tile: &FloatTile, out: &mut [f32]) {
        #[cfg(target_arch = "x86_64")]
        if !self.packed.is_empty() {
            for (group, out) in self.packed.chunks_exact(self.len * GROUP).zip(out.chunks_mut(GROUP * tile.texels())) {
                // SAFETY: the processor has AVX2 and FMA, or nothing would be packed.
                unsafe { add_products_fma(group, tile, out) };
            }
            return;
        }
        add_product(Rows::new(&self.rows, self.len), Rows::new(tile.data(), tile.texels()), out);
    }
}

/// Multiplies `rows` (row, texel of the tile) by the rows of a tile, sums over all texels, and adds the result to
/// `out`: (row, row of the tile).
pub fn add_sums_over_texels(rows: &[f32], tile: &FloatTile, out: &mut [f32]) {
    let texels = tile.texels();
    #[cfg(target_arch = "x86_64")]
    if few(rows.len() / texels) {
        // SAFETY: the processor has AVX2 and FMA.
        return unsafe { add_sums_fma(rows, tile, out) };
    }
    add_product_transposed(Rows::new(rows, texels), Rows::new(tile.data(), texels), out);
}

/// Whether these kernels are used for `rows` rows.
fn few(rows: usize) -> bool {
    #[cfg(target_arch = "x86_64")]
    return rows <= FEW && crate::simd::has_avx2() && is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn add_products_fma(group: &[f32], tile: &FloatTile, out: &mut [f32]) {
    use std::arch::x86_64::*;
    let (data, texels, rows) = (tile.data(), tile.texels(), group.len() / GROUP);
    assert!(data.len() >= rows * texels && texels.is_multiple_of(STEP), "a tile of as many rows");
    for first in (0..texels).step_by(STEP) {
        let mut sums = [[_mm256_setzero_ps(); 2]; GROUP];
        for row in 0..rows {
            // SAFETY: STEP numbers follow `first` in each row of the tile, GROUP factors belong to each.
            unsafe {
                let values = data.as_ptr().add(row * texels + first);
                let (a, b) = (_mm256_loadu_ps(values), _mm256_loadu_ps(values.add(LANES)));
                let factors = group.as_ptr().add(row * GROUP);
                for (k, sums) in sums.iter_mut().enumerate() {
                    let factor = _mm256_broadcast_ss(&*factors.add(k));
                    sums[0] = _mm256_fmadd_ps(a, factor, sums[0]);
                    sums[1] = _mm256_fmadd_ps(b, factor, sums[1]);
                }
            }
        }
        for (row, sums) in out.chunks_exact_mut(texels).zip(sums) {
            for (out, sum) in row[first..first + STEP].as_chunks_mut::<LANES>().0.iter_mut().zip(sums) {
                // SAFETY: a vector of numbers.
                unsafe { _mm256_storeu_ps(out.as_mut_ptr(), _mm256_add_ps(_mm256_loadu_ps(out.as_ptr()), sum)) };
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn add_sums_fma(rows: &[f32], tile: &FloatTile, out: &mut [f32]) {
    let (texels, of_tile) = (tile.texels(), tile.rows());
    for row in (0..of_tile).step_by(2) {
        let last = row + 1 == of_tile;
        let pair = [row, if last { row } else { row + 1 }].map(|row| &tile.data()[row * texels..(row + 1) * texels]);
        for (group, out) in rows.chunks(GROUP * texels).zip(out.chunks_mut(GROUP * of_tile)) {
            let sums = sums_of_pair(group, pair);
            for (out, sums) in out.chunks_exact_mut(of_tile).zip(sums) {
                out[row] += sums[0];
                if !last {
                    out[row + 1] += sums[1];
                }
            }
        }
    }
}

/// The sums over texels of up to [`GROUP`] rows times each row of a pair.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn sums_of_pair(group: &[f32], pair: [&[f32]; 2]) -> [[f32; 2]; GROUP] {
    use std::arch::x86_64::*;
    let texels = pair[0].len();
    assert!(pair[1].len() == texels && texels.is_multiple_of(LANES), "rows of a tile");
    let count = group.len() / texels;
    // repeat the last row for missing ones; the caller drops their sums
    let starts: [&[f32]; GROUP] = std::array::from_fn(|k| &group[k.min(count - 1) * texels..][..texels]);
    let mut sums = [[_mm256_setzero_ps(); 2]; GROUP];
    for place in (0..texels).step_by(LANES) {
        // SAFETY: all rows have as many numbers as the tile has texels.
        unsafe {
            let a = _mm256_loadu_ps(pair[0].as_ptr().add(place));
            let b = _mm256_loadu_ps(pair[1].as_ptr().add(place));
            for (sums, start) in sums.iter_mut().zip(&starts) {
                let value = _mm256_loadu_ps(start.as_ptr().add(place));
                sums[0] = _mm256_fmadd_ps(a, value, sums[0]);
                sums[1] = _mm256_fmadd_ps(b, value, sums[1]);
            }
        }
    }
    sums.map(|[a, b]| {
        // add neighbouring lanes of a and of b, then quarters, then halves
        let pairs = _mm256_hadd_ps(_mm256_hadd_ps(a, b), _mm256_setzero_ps());
        let both = _mm_add_ps(_mm256_castps256_ps128(pairs), _mm256_extractf128_ps::<1>(pairs));
        [_mm_cvtss_f32(both), _mm_cvtss_f32(_mm_shuffle_ps::<1>(both, both))]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::portable;

    #[test]
    fn products_are_those_of_the_definition_on_any_processor() {
        let (images, texels) = (3, 150);
        let of_tile = 3 * images;
        let data: Vec<u8> = (0..images * texels * 3).map(|i| (i * 7919 % 256) as u8).collect();
        let mut tile = FloatTile::new(of_tile);
        tile.load(&data, 3 * texels, 0, texels, &[0.25; 9]);
        let (size, close) = (tile.texels(), |a: f32, b: f64| (f64::from(a) - b).abs() < 1e-4);
        let value = |row: usize, t: usize| f64::from(tile.data()[row * size + t]);
        for count in [1, 5, 6, 13, 24, FEW + 1] {
            let rows: Vec<f32> = (0..count * of_tile).map(|i| (i as f32).sin()).collect();
            let weights: Vec<f32> = (0..count * size).map(|i| (i as f32 * 0.7).cos()).collect();
            let run = || {
                let (mut products, mut sums) = (vec![1.0; count * size], vec![1.0; count * of_tile]);
                Factors::new(rows.clone(), of_tile).add_products(&tile, &mut products);
                add_sums_over_texels(&weights, &tile, &mut sums);
                (products, sums)
            };
            for (products, sums) in [run(), portable(run)] {
                for (i, &found) in products.iter().enumerate() {
                    let row = &rows[i / size * of_tile..][..of_tile];
                    let expected: f64 = row.iter().enumerate().map(|(r, f)| f64::from(*f) * value(r, i % size)).sum();
                    assert!(close(found, 1.0 + expected), "{count} {i}: {found} {expected}");
                }
                for (i, &found) in sums.iter().enumerate() {
                    let row = &weights[i / of_tile * size..][..size];
                    let expected: f64 =
                        row.iter().enumerate().map(|(t, f)| f64::from(*f) * value(i % of_tile, t)).sum();
                    assert!(close(found, 1.0 + expected), "{count} {i}: {found} {expected}");
                }
            }
        }
    }
}
