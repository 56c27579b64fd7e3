//! Projection of texels on components.

use super::tile::{STEP, Tile};

/// Projects the first `count` texels of a tile on the `c` rows of `basis` (c x rows) and adds `bias`:
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
        if super::simd::has_avx2() {
            // SAFETY: the processor has AVX2.
            return unsafe { avx2::<K>(tile, count, c, basis, bias, out) };
        }
    }
    kernel::<K>(tile, count, c, basis, bias, out);
}

/// K components at a time. Products and sums are rounded separately, so that all processors give the same bits.
#[inline(always)]
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::simd::portable;
    use crate::factor::tile::ByteTile;

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
        }
    }
}
