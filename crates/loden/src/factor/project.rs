//! Projection of texels on components.

use super::tile::Tile;

/// A number a tile holds.
pub trait Number: bytemuck::Pod {
    /// The number in single precision.
    fn to_f32(self) -> f32;
}

impl Number for f32 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
}

impl Number for i16 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }
}

/// Texels projected at once: two vectors of AVX2.
const LANES: usize = 16;

/// Projects the first `count` texels of a tile on the `c` rows of `basis` (c x rows) and adds `bias`:
/// `out[texel * c + k] = bias[k] + sum over rows of value * basis[k]`.
pub fn project<T: Number>(tile: &Tile<T>, count: usize, basis: &[f32], bias: &[f32], out: &mut [f32]) {
    let c = bias.len();
    let shape = Shape { stride: tile.stride(), rows: tile.rows(), count, c };
    for first in (0..c).step_by(4) {
        let args = (tile.data(), &basis[first * shape.rows..], &bias[first..], &mut out[first..]);
        match c - first {
            1 => dispatch::<T, 1>(shape, args.0, args.1, args.2, args.3),
            2 => dispatch::<T, 2>(shape, args.0, args.1, args.2, args.3),
            3 => dispatch::<T, 3>(shape, args.0, args.1, args.2, args.3),
            _ => dispatch::<T, 4>(shape, args.0, args.1, args.2, args.3),
        }
    }
}

#[derive(Clone, Copy)]
struct Shape {
    stride: usize,
    rows: usize,
    count: usize,
    c: usize,
}

fn dispatch<T: Number, const K: usize>(shape: Shape, data: &[T], basis: &[f32], bias: &[f32], out: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn avx2<T: Number, const K: usize>(shape: Shape, data: &[T], basis: &[f32], bias: &[f32], out: &mut [f32]) {
            kernel::<T, K>(shape, data, basis, bias, out);
        }
        if super::simd::has_avx2() {
            // SAFETY: the processor has AVX2.
            return unsafe { avx2::<T, K>(shape, data, basis, bias, out) };
        }
    }
    kernel::<T, K>(shape, data, basis, bias, out);
}

/// K components at a time. Products and sums are rounded separately, so that all processors give the same bits.
#[inline(always)]
fn kernel<T: Number, const K: usize>(shape: Shape, data: &[T], basis: &[f32], bias: &[f32], out: &mut [f32]) {
    let Shape { stride, rows, count, c } = shape;
    let basis: [&[f32]; K] = std::array::from_fn(|k| &basis[k * rows..(k + 1) * rows]);
    for first in (0..count).step_by(LANES) {
        let mut sums: [[f32; LANES]; K] = std::array::from_fn(|k| [bias[k]; LANES]);
        for (d, row) in data.chunks_exact(stride).take(rows).enumerate() {
            let Some(values) = row[first..].first_chunk::<LANES>() else { continue };
            let values = values.map(T::to_f32);
            for k in 0..K {
                let factor = basis[k][d];
                for lane in 0..LANES {
                    sums[k][lane] += values[lane] * factor;
                }
            }
        }
        for (lane, texel) in out[first * c..].chunks_mut(c).take(LANES.min(count - first)).enumerate() {
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

    #[test]
    fn projects_like_the_definition_on_any_processor() {
        let rows = 9;
        let mut tile = Tile::<i16>::new(rows);
        let stride = tile.stride();
        tile.data_mut().iter_mut().enumerate().for_each(|(i, v)| *v = (i * 7919 % 256) as i16 - 128);
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
                    (0..rows).map(|d| f64::from(tile.data()[d * stride + t]) * f64::from(basis[k * rows + d]));
                let expected = k as f64 + products.sum::<f64>();
                assert!((f64::from(value) - expected).abs() < 1e-3, "{c}: {value} {expected}");
            }
            assert_eq!(portable(run), out);
        }
    }
}
