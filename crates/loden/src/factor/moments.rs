//! Mean and scatter of texels over images: the exact integer form for 8-bit images, and the floating-point form.
//!
//! # Model
//! The matrix M has a row per texel and a column per image and channel. The scatter is
//! S = (M - 1 mu^T)^T (M - 1 mu^T) = M^T M - n mu mu^T. For 8-bit values x the integers x - 128 are used, whose
//! products and sums are exact: pairs of products are added in 32 bits, tiles in 64 bits.
//!
//! # Limits
//! Texel values in floating point are centred first; sums over one tile are of single precision, sums over tiles of
//! double precision.

use super::linalg;
use super::tile::{Tile, centre};

/// Mean and scatter of the columns of a matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    /// Mean of each column.
    pub mean: Vec<f64>,
    /// The scatter matrix, row by row, symmetric.
    pub scatter: Vec<f64>,
}

/// Tiles whose sums fit in 32 bits: |x - 128| squared is at most 2^14, a tile's row is at most 512 texels.
const FLUSH: usize = (1 << 31) / (1 << 14) / 512 - 1;

/// Moments of 8-bit RGB `images` of `image_len` bytes each, in units where 255 is 1.
pub fn moments_u8(images: &[u8], image_len: usize, tile: &mut Tile<i16>) -> Moments {
    let (n, rows, stride) = (tile.rows(), tile.rows_padded(), tile.stride());
    let texels = image_len / 3;
    let mut sums = vec![0i64; rows * rows];
    let mut block = vec![0i32; rows * rows];
    // products with a row of ones are the sums of the rows; unused places are zero in all others
    tile.data_mut()[n * stride..(n + 1) * stride].fill(1);
    for (i, first) in (0..texels).step_by(stride).enumerate() {
        tile.load(images, image_len, first, stride.min(texels - first));
        products(tile.data(), stride, rows, &mut block);
        if i % FLUSH == FLUSH - 1 {
            flush(&mut block, &mut sums);
        }
    }
    flush(&mut block, &mut sums);
    let sum = |i: usize| sums[n * rows + i] as f64;
    let count = texels as f64;
    let mut scatter = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let centred = sums[i * rows + j] as f64 - sum(i) * sum(j) / count;
            scatter[i * n + j] = centred / (255.0 * 255.0);
            scatter[j * n + i] = scatter[i * n + j];
        }
    }
    Moments { mean: (0..n).map(|i| (sum(i) / count + 128.0) / 255.0).collect(), scatter }
}

/// Fills the tile with `count` texels from `first` (all used rows, places behind zero).
pub type Fill<'a> = dyn Fn(&mut Tile<f32>, usize, usize) + 'a;

/// Moments of `texels` texels that `fill` loads tile by tile.
pub fn moments_f32(texels: usize, tile: &mut Tile<f32>, fill: &Fill) -> Moments {
    let (n, stride) = (tile.rows(), tile.stride());
    let tiles = || (0..texels).step_by(stride).map(|first| (first, stride.min(texels - first)));
    let mut mean = vec![0.0; n];
    for (first, count) in tiles() {
        fill(tile, first, count);
        for (sum, row) in mean.iter_mut().zip(tile.data().chunks_exact(stride)) {
            *sum += row[..count].iter().map(|&v| f64::from(v)).sum::<f64>();
        }
    }
    mean.iter_mut().for_each(|sum| *sum /= texels as f64);
    let mut scatter = vec![0.0; n * n];
    let mut scratch = vec![0.0; n * n];
    for (first, count) in tiles() {
        fill(tile, first, count);
        centre(tile.data_mut(), stride, count, &mean);
        linalg::add_row_products(&tile.data()[..n * stride], stride, &mut scratch, &mut scatter);
    }
    for i in 0..n {
        for j in 0..i {
            scatter[j * n + i] = scatter[i * n + j];
        }
    }
    Moments { mean, scatter }
}

fn flush(block: &mut [i32], sums: &mut [i64]) {
    for (sum, part) in sums.iter_mut().zip(block) {
        *sum += i64::from(*part);
        *part = 0;
    }
}

/// Adds the products of all pairs of rows i >= j to `out[i * rows + j]` (and of some pairs i < j).
fn products(data: &[i16], stride: usize, rows: usize, out: &mut [i32]) {
    #[cfg(target_arch = "x86_64")]
    if super::simd::has_avx2() {
        // SAFETY: the processor has AVX2.
        return unsafe { products_avx2(data, stride, rows, out) };
    }
    for (i, a) in data.chunks_exact(stride).enumerate() {
        for (j, b) in data.chunks_exact(stride).take(i + 1).enumerate() {
            out[i * rows + j] += a.iter().zip(b).map(|(&a, &b)| i32::from(a) * i32::from(b)).sum::<i32>();
        }
    }
}

/// Rows i of one pass, which stay in the first-level cache while all rows j stream past.
const PANEL: usize = 12;

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn products_avx2(data: &[i16], stride: usize, rows: usize, out: &mut [i32]) {
    assert!(rows % 4 == 0 && stride % 16 == 0 && data.len() >= rows * stride && out.len() >= rows * rows);
    for panel in (0..rows).step_by(PANEL) {
        let end = (panel + PANEL).min(rows);
        for j in (0..end).step_by(4) {
            for i in (panel.max(j / 3 * 3)..end).step_by(3) {
                // SAFETY: the rows lie in data; a block of 3 x 4 in out begins at row i, column j.
                unsafe { block_avx2(data.as_ptr(), stride, rows, i, j, out) };
            }
        }
    }
}

/// Products of rows i..i+3 with rows j..j+4.
///
/// # Safety
/// Rows up to `rows` must lie in `data`; j + 4 <= rows.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn block_avx2(data: *const i16, stride: usize, rows: usize, i: usize, j: usize, out: &mut [i32]) {
    use std::arch::x86_64::*;
    let mut sums = [[_mm256_setzero_si256(); 4]; 3];
    // the last rows are repeated where three do not fit; their sums are not stored
    let row = |k: usize| k.min(rows - 1) * stride;
    let a = [row(i), row(i + 1), row(i + 2)];
    for t in (0..stride).step_by(16) {
        // SAFETY: rows have `stride` numbers, a multiple of 16.
        let load = |offset: usize| unsafe { _mm256_load_si256(data.add(offset + t).cast()) };
        let a = [load(a[0]), load(a[1]), load(a[2])];
        for (column, k) in (j..j + 4).enumerate() {
            let b = load(k * stride);
            for (sums, a) in sums.iter_mut().zip(a) {
                sums[column] = _mm256_add_epi32(sums[column], _mm256_madd_epi16(a, b));
            }
        }
    }
    for (k, sums) in sums.iter().enumerate().take(rows - i) {
        let [a, b, c, d] = *sums;
        let four = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
        let four = _mm_add_epi32(_mm256_castsi256_si128(four), _mm256_extracti128_si256::<1>(four));
        let place = out[(i + k) * rows + j..][..4].as_mut_ptr().cast::<__m128i>();
        // SAFETY: four numbers of out.
        unsafe { _mm_storeu_si128(place, _mm_add_epi32(_mm_loadu_si128(place), four)) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::simd::portable;

    fn images(lights: usize, texels: usize) -> Vec<u8> {
        let mut state = 1u32;
        let noise = (0..lights * texels * 3).map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        });
        noise.collect()
    }

    fn brute_force(images: &[u8], lights: usize, texels: usize) -> Moments {
        let n = 3 * lights;
        let value = |i: usize, t: usize| f64::from(images[(i / 3 * texels + t) * 3 + i % 3]) / 255.0;
        let mean: Vec<f64> = (0..n).map(|i| (0..texels).map(|t| value(i, t)).sum::<f64>() / texels as f64).collect();
        let scatter =
            |i: usize, j: usize| (0..texels).map(|t| (value(i, t) - mean[i]) * (value(j, t) - mean[j])).sum::<f64>();
        let scatter = (0..n * n).map(|k| scatter(k / n, k % n)).collect();
        Moments { mean, scatter }
    }

    fn close(a: &Moments, b: &Moments, tolerance: f64) {
        let scale = b.scatter.iter().fold(1e-12f64, |m, v| m.max(v.abs()));
        for (a, b, scale) in [(&a.mean, &b.mean, 1.0), (&a.scatter, &b.scatter, scale)] {
            assert_eq!(a.len(), b.len());
            let error = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error <= tolerance * scale, "{error} of {scale}");
        }
    }

    #[test]
    fn all_forms_agree_with_the_definition() {
        for (lights, texels) in [(1, 1), (2, 700), (5, 97), (7, 1100), (81, 30)] {
            let data = images(lights, texels);
            let expected = brute_force(&data, lights, texels);
            let exact = || moments_u8(&data, 3 * texels, &mut Tile::new(3 * lights));
            let fast = exact();
            close(&fast, &expected, 1e-12);
            assert_eq!(portable(exact), fast, "{lights} {texels}");
            let fill = |tile: &mut Tile<f32>, first: usize, count: usize| {
                for l in 0..lights {
                    for (c, row) in tile.rgb_mut(l).into_iter().enumerate() {
                        row.fill(0.0);
                        for t in 0..count {
                            row[t] = f32::from(data[(l * texels + first + t) * 3 + c]) / 255.0;
                        }
                    }
                }
            };
            close(&moments_f32(texels, &mut Tile::new(3 * lights), &fill), &expected, 1e-5);
        }
    }

    #[test]
    fn constant_images_scatter_nothing_and_extremes_do_not_overflow() {
        let texels = 300_000;
        for value in [0u8, 255] {
            let moments = moments_u8(&vec![value; 3 * texels], 3 * texels, &mut Tile::new(3));
            assert_eq!(moments.scatter, vec![0.0; 9]);
            assert_eq!(moments.mean, vec![f64::from(value) / 255.0; 3]);
        }
        let half: Vec<u8> = (0..3 * texels).map(|i| if i < 3 * texels / 2 { 0 } else { 255 }).collect();
        let moments = moments_u8(&half, 3 * texels, &mut Tile::new(3));
        assert!(moments.scatter.iter().all(|v| (v - texels as f64 / 4.0).abs() < 1e-9), "{moments:?}");
    }
}
