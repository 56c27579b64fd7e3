//! Projection of texels onto components.

use super::tile::{ImageStrip, STEP, Tile};
use crate::simd::wide;

/// Projects the first `count` texels of a tile onto the `c` rows of `basis` (c x rows) and adds `bias`:
/// `out[texel * c + k] = bias[k] + sum over rows of value * basis[k]`.
pub fn project(tile: &impl Tile, count: usize, basis: &[f32], bias: &[f32], out: &mut [f32]) {
    let c = bias.len();
    for first in (0..c).step_by(4) {
        let (basis, bias, out) = (&basis[first * tile.rows()..], &bias[first..], &mut out[first..]);
        match c - first {
            1 => dispatch::<1>(tile, count, c, basis, bias, out),
            2 => dispatch::<2>(tile, count, c, basis, bias, out),
            3 => dispatch::<3>(tile, count, c, basis, bias, out),
            _ => dispatch::<4>(tile, count, c, basis, bias, out),
        }
    }
}

fn dispatch<const K: usize>(tile: &impl Tile, count: usize, c: usize, basis: &[f32], bias: &[f32], out: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn avx2<const K: usize>(t: &impl Tile, count: usize, c: usize, basis: &[f32], bias: &[f32], out: &mut [f32]) {
            kernel::<K>(t, count, c, basis, bias, out);
        }
        if crate::simd::has_avx2() {
            // SAFETY: the processor has AVX2.
            return unsafe { avx2::<K>(tile, count, c, basis, bias, out) };
        }
    }
    kernel::<K>(tile, count, c, basis, bias, out);
}

/// Projects onto K components at a time. Products and sums are rounded separately, so all processors give the same
/// bits.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "one index runs over several arrays")]
fn kernel<const K: usize>(tile: &impl Tile, count: usize, c: usize, basis: &[f32], bias: &[f32], out: &mut [f32]) {
    let rows = tile.rows();
    let basis: [&[f32]; K] = std::array::from_fn(|k| &basis[k * rows..(k + 1) * rows]);
    for (step, first) in (0..count).step_by(STEP).enumerate() {
        let mut sums: [[f32; STEP]; K] = std::array::from_fn(|k| [bias[k]; STEP]);
        for row in 0..rows {
            let values = tile.block(row, step);
            for k in 0..K {
                let factor = basis[k][row];
                for lane in 0..STEP {
                    sums[k][lane] += values[lane] * factor;
                }
            }
        }
        for (lane, texel) in out[first * c..].chunks_mut(c).take(STEP.min(count - first)).enumerate() {
            for k in 0..K {
                texel[k] = sums[k][lane];
            }
        }
    }
}

/// Texels per strip: four components of them fill a quarter of a first-level cache.
const STRIP: usize = 512;

/// Projects all texels of the 8-bit RGB `images` (`image_len` bytes each), minus 128, onto the rows of `basis`, as
/// [`project`] does.
pub fn project_bytes(images: &[u8], image_len: usize, basis: &[f32], bias: &[f32], out: &mut [f32]) {
    let (c, rows, texels) = (bias.len(), images.len() / image_len * 3, image_len / 3);
    let mut strip = ImageStrip::new(STRIP / STEP);
    // (step, component, texel of the step); components are padded to whole blocks of four
    let blocks = c.div_ceil(COMPONENTS);
    let mut sums = vec![[[0.0f32; STEP]; COMPONENTS]; STRIP / STEP * blocks];
    for first in (0..texels).step_by(strip.texels()) {
        let count = strip.texels().min(texels - first);
        sums.iter_mut().for_each(|block| *block = [[0.0; STEP]; COMPONENTS]);
        for image in 0..rows / 3 {
            let factor = |k: usize, channel: usize| match k < c {
                true => basis[k * rows + 3 * image + channel],
                false => 0.0,
            };
            let factors: Vec<Factors> = (0..blocks)
                .map(|block| std::array::from_fn(|k| std::array::from_fn(|i| factor(COMPONENTS * block + k, i))))
                .collect();
            for (rgb, sums) in strip.load(images, image_len, image, first, count).zip(sums.chunks_exact_mut(blocks)) {
                add_texels(rgb, &factors, sums);
            }
        }
        for (t, out) in out[first * c..].chunks_exact_mut(c).take(count).enumerate() {
            for (k, out) in out.iter_mut().enumerate() {
                *out = bias[k] + sums[t / STEP * blocks + k / COMPONENTS][k % COMPONENTS][t % STEP];
            }
        }
    }
}

/// Components per kernel call, whose sums stay in registers.
const COMPONENTS: usize = 4;

/// (component, channel)
type Factors = [[f32; 3]; COMPONENTS];

wide! {
    /// Adds the products of 16 texels of an image.
    fn add_texels(rgb: [&[i16; STEP]; 3], factors: &[Factors], sums: &mut [[[f32; STEP]; COMPONENTS]]) {
        for (factors, sums) in factors.iter().zip(sums) {
            for channel in 0..3 {
                for k in 0..COMPONENTS {
                    for lane in 0..STEP {
                        sums[k][lane] += f32::from(rgb[channel][lane]) * factors[k][channel];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::tile::ByteTile;
    use crate::simd::portable;

    #[test]
    fn projects_like_the_definition_on_any_processor() {
        let (images, texels) = (3, 40);
        let rows = 3 * images;
        let data: Vec<u8> = (0..images * texels * 3).map(|i| (i * 7919 % 256) as u8).collect();
        let mut tile = ByteTile::new(rows);
        tile.load(&data, 3 * texels, 0, texels);
        for c in 1..=9 {
            let basis: Vec<f32> = (0..c * rows).map(|i| (i as f32).sin()).collect();
            let bias: Vec<f32> = (0..c).map(|k| k as f32).collect();
            let count = 37;
            let run = || {
                let mut out = vec![0.0; count * c];
                project(&tile, count, &basis, &bias, &mut out);
                out
            };
            let out = run();
            for (i, &value) in out.iter().enumerate() {
                let (t, k) = (i / c, i % c);
                let products =
                    (0..rows).map(|d| f64::from(tile.integers(d, t / STEP)[t % STEP]) * f64::from(basis[k * rows + d]));
                let expected = k as f64 + products.sum::<f64>();
                assert!((f64::from(value) - expected).abs() < 1e-3, "{c}: {value} {expected}");
            }
            assert_eq!(portable(run), out);
            let run = || {
                let mut out = vec![0.0; texels * c];
                project_bytes(&data, 3 * texels, &basis, &bias, &mut out);
                out
            };
            let bytes = run();
            assert!(bytes.iter().zip(&out).all(|(a, b)| (a - b).abs() < 1e-3));
            assert_eq!(portable(run), bytes);
        }
    }
}
