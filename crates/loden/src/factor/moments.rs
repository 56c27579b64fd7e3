//! Mean and scatter matrix of images: exact integer arithmetic for 8-bit images, and a floating-point version.
//!
//! # Model
//! The matrix M has a row per texel and a column per image and channel. The scatter matrix is S = (M - 1 mu^T)^T (M - 1
//! mu^T) = M^T M - n mu mu^T. 8-bit values x enter as the integers x - 128, whose products and sums are exact: products
//! are summed in 32 bits within tiles and in 64 bits over tiles.
//!
//! # Limits
//! Floating-point values are centred first; sums within a tile are in single precision, sums over tiles in double
//! precision.

use super::linalg;
use super::tile::{ByteTile, FloatTile, GROUP, STEP, Tile};

/// Mean and scatter of the columns of a matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    /// Mean of each column.
    pub mean: Vec<f64>,
    /// The scatter matrix, row by row; symmetric.
    pub scatter: Vec<f64>,
}

/// Tiles whose sums fit in 32 bits: |x - 128| squared is at most 2^14, and a row of a tile has at most 512 texels.
const FLUSH: usize = (1 << 31) / (1 << 14) / 512 - 1;

/// Moments of 8-bit RGB `images` of `image_len` bytes each, scaled so that 255 is 1.
pub fn moments_u8(images: &[u8], image_len: usize, tile: &mut ByteTile) -> Moments {
    sampled_moments_u8(images, image_len, tile, 1)
}

/// Moments of the texels of every `every`-th tile.
pub fn sampled_moments_u8(images: &[u8], image_len: usize, tile: &mut ByteTile, every: usize) -> Moments {
    let (n, rows, step) = (tile.rows(), tile.rows_padded(), tile.texels());
    let texels = image_len / 3;
    let mut sums = vec![0i64; rows * rows];
    let mut block = vec![0i32; rows * rows];
    let mut count = 0;
    for (i, first) in (0..texels).step_by(step * every).enumerate() {
        let part = step.min(texels - first);
        tile.load(images, image_len, first, part);
        products(tile, &mut block);
        count += part;
        if i % FLUSH == FLUSH - 1 {
            flush(&mut block, &mut sums);
        }
    }
    // the row of ones of a tile gives the sums of the rows
    flush(&mut block, &mut sums);
    let sum = |i: usize| sums[n * rows + i] as f64;
    let count = count as f64;
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

/// Fills a tile with `count` texels from `first`, and with zeros after them.
pub type Fill<'a> = dyn Fn(&mut FloatTile, usize, usize) + 'a;

/// Moments of `texels` texels, which `fill` loads tile by tile.
pub fn moments_f32(texels: usize, tile: &mut FloatTile, fill: &Fill) -> Moments {
    let (n, stride) = (tile.rows(), tile.texels());
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
        tile.centre(count, &mean);
        linalg::add_row_products(tile.data(), stride, &mut scratch, &mut scatter);
    }
    for i in 0..n {
        for j in 0..i {
            scatter[j * n + i] = scatter[i * n + j];
        }
    }
    Moments { mean, scatter }
}

pub(super) fn flush(block: &mut [i32], sums: &mut [i64]) {
    for (sum, part) in sums.iter_mut().zip(block) {
        *sum += i64::from(*part);
        *part = 0;
    }
}

/// Adds the products of all pairs of rows i >= j, and of some pairs i < j, to `out[i * rows + j]`.
fn products(tile: &ByteTile, out: &mut [i32]) {
    let rows = tile.rows_padded();
    #[cfg(target_arch = "x86_64")]
    if crate::simd::has_avx2() {
        // SAFETY: the processor has AVX2.
        return unsafe { products_avx2(tile.data(), tile.texels() / STEP, rows, out) };
    }
    for step in 0..tile.texels() / STEP {
        for i in 0..rows {
            for j in 0..=i {
                let pairs = tile.integers(i, step).iter().zip(tile.integers(j, step));
                out[i * rows + j] += pairs.map(|(&a, &b)| i32::from(a) * i32::from(b)).sum::<i32>();
            }
        }
    }
}

/// Adds the products of the rows of `a`, including its row of ones, and the rows of `b` to `out[i * rows of b + j]`.
pub(super) fn cross_products(a: &ByteTile, b: &ByteTile, out: &mut [i32]) {
    let (rows, columns, steps) = (a.rows_padded(), b.rows(), a.texels() / STEP);
    assert!(b.texels() == a.texels() && out.len() == rows * columns);
    #[cfg(target_arch = "x86_64")]
    if crate::simd::has_avx2() {
        // SAFETY: the processor has AVX2.
        return unsafe { cross_products_avx2(a.data(), b.data(), steps, rows, columns, out) };
    }
    for step in 0..steps {
        for i in 0..rows {
            for j in 0..columns {
                let pairs = a.integers(i, step).iter().zip(b.integers(j, step));
                out[i * columns + j] += pairs.map(|(&a, &b)| i32::from(a) * i32::from(b)).sum::<i32>();
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn cross_products_avx2(a: &[i16], b: &[i16], steps: usize, rows: usize, columns: usize, out: &mut [i32]) {
    assert!(a.len() == rows * steps * STEP && b.len() == columns * steps * STEP && out.len() == rows * columns);
    for i in (0..rows).step_by(2) {
        for j in (0..columns).step_by(GROUP) {
            let row = &a[i / GROUP * GROUP * steps * STEP + i % GROUP * STEP..];
            let group = &b[j * steps * STEP..];
            let out = &mut out[i * columns + j..];
            // SAFETY: i is even, so that i and i + 1 are in one group; both groups lie in their tiles.
            unsafe { block_avx2(row.as_ptr(), group.as_ptr(), steps, columns, out) };
        }
    }
}

/// Rows i per pass; they stay in the first-level cache while all rows j stream past.
#[cfg(target_arch = "x86_64")]
const PANEL: usize = 2 * GROUP;

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn products_avx2(data: &[i16], steps: usize, rows: usize, out: &mut [i32]) {
    assert!(rows.is_multiple_of(GROUP) && data.len() == rows * steps * STEP && out.len() == rows * rows);
    let group = |row: usize| data[row / GROUP * GROUP * steps * STEP..].as_ptr();
    for panel in (0..rows).step_by(PANEL) {
        let end = (panel + PANEL).min(rows);
        for j in (0..end).step_by(GROUP) {
            for i in (panel.max(j)..end).step_by(2) {
                let out = &mut out[i * rows + j..];
                // SAFETY: i is even, so that i and i + 1 are in one group; both groups lie in data.
                unsafe { block_avx2(group(i).add(i % GROUP * STEP), group(j), steps, rows, out) };
            }
        }
    }
}

/// Products of the 2 rows at `a` with the 6 rows of the group `b`: the most sums that leave the operands room in 16
/// registers.
///
/// # Safety
/// `steps` vectors must follow `a` and `b` at distances of [`GROUP`] vectors, aligned to 32 bytes.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn block_avx2(a: *const i16, b: *const i16, steps: usize, rows: usize, out: &mut [i32]) {
    use std::arch::x86_64::*;
    let mut sums = [[_mm256_setzero_si256(); 2]; GROUP];
    for step in 0..steps {
        let load = |rows: *const i16, row: usize| {
            // SAFETY: guaranteed by the caller.
            unsafe { _mm256_load_si256(rows.add(step * GROUP * STEP + row * STEP).cast()) }
        };
        let (a0, a1) = (load(a, 0), load(a, 1));
        for (column, sums) in sums.iter_mut().enumerate() {
            let b = load(b, column);
            sums[0] = _mm256_add_epi32(sums[0], _mm256_madd_epi16(a0, b));
            sums[1] = _mm256_add_epi32(sums[1], _mm256_madd_epi16(a1, b));
        }
    }
    let four = |a, b, c, d| {
        let lanes = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
        _mm_add_epi32(_mm256_castsi256_si128(lanes), _mm256_extracti128_si256::<1>(lanes))
    };
    let [[r0, s0], [r1, s1], [r2, s2], [r3, s3], [r4, s4], [r5, s5]] = sums;
    let (left, next_left) = (four(r0, r1, r2, r3), four(s0, s1, s2, s3));
    let right = four(r4, r5, s4, s5);
    let (out, next) = out.split_at_mut(rows);
    for (row, left, right) in [(out, left, right), (next, next_left, _mm_unpackhi_epi64(right, right))] {
        let (left_out, right_out) = row[..GROUP].split_at_mut(4);
        let (left_out, right_out) = (left_out.as_mut_ptr().cast(), right_out.as_mut_ptr().cast());
        // SAFETY: four numbers and two numbers of a row.
        unsafe {
            _mm_storeu_si128(left_out, _mm_add_epi32(_mm_loadu_si128(left_out), left));
            _mm_storel_epi64(right_out, _mm_add_epi32(_mm_loadl_epi64(right_out), right));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::portable;

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
    fn integer_and_float_moments_agree_with_the_definition() {
        for (lights, texels) in [(1, 1), (2, 700), (5, 97), (7, 1100), (81, 30)] {
            let data = images(lights, texels);
            let expected = brute_force(&data, lights, texels);
            let exact = || moments_u8(&data, 3 * texels, &mut ByteTile::new(3 * lights));
            let fast = exact();
            close(&fast, &expected, 1e-12);
            assert_eq!(portable(exact), fast, "{lights} {texels}");
            let fill = |tile: &mut FloatTile, first: usize, count: usize| {
                for l in 0..lights {
                    for (c, row) in tile.rgb_mut(l).into_iter().enumerate() {
                        row.fill(0.0);
                        for t in 0..count {
                            row[t] = f32::from(data[(l * texels + first + t) * 3 + c]) / 255.0;
                        }
                    }
                }
            };
            close(&moments_f32(texels, &mut FloatTile::new(3 * lights), &fill), &expected, 1e-5);
        }
    }

    #[test]
    fn constant_images_scatter_nothing_and_extremes_do_not_overflow() {
        let texels = 300_000;
        for value in [0u8, 255] {
            let moments = moments_u8(&vec![value; 3 * texels], 3 * texels, &mut ByteTile::new(3));
            assert_eq!(moments.scatter, vec![0.0; 9]);
            assert_eq!(moments.mean, vec![f64::from(value) / 255.0; 3]);
        }
        let half: Vec<u8> = (0..3 * texels).map(|i| if i < 3 * texels / 2 { 0 } else { 255 }).collect();
        let moments = moments_u8(&half, 3 * texels, &mut ByteTile::new(3));
        assert!(moments.scatter.iter().all(|v| (v - texels as f64 / 4.0).abs() < 1e-9), "{moments:?}");
    }
}
