//! Which pieces of the sample lie around a point.

use glam::Vec2;

use crate::random::{hash, unit};

/// The side of triangles, as a share of the sample's smaller side.
const SIDE: f32 = 0.25;

/// Exponent of the weights: larger ones make blends narrower.
const SHARPNESS: i32 = 3;

/// sqrt(3) / 2: the height of a triangle with sides of 1.
const HEIGHT: f32 = 0.866_025_4;

/// Triangles that cover the plane, with a piece of the sample around each corner.
pub(super) struct Pieces {
    /// Texels of the sample along u and v.
    size: [usize; 2],
    /// Side of the triangles, in texels.
    side: f32,
    periodic: bool,
    seed: u64,
}

/// A piece that a point lies in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    /// The texture coordinate of the sample.
    pub uv: Vec2,
    /// Weights of the pieces around a point sum to one.
    pub weight: f32,
}

impl Pieces {
    pub(super) fn new(size: [usize; 2], periodic: bool, seed: u64) -> Self {
        let smaller = size[0].min(size[1]) as f32;
        Self { size, side: (smaller * SIDE).max(1.0), periodic, seed }
    }

    /// The corners around a point, in multiples of the sides, with their weights, which sum to one.
    fn corners(&self, point: Vec2) -> [([i64; 2], f32); 3] {
        let b = point.y / (self.side * HEIGHT);
        let a = point.x / self.side - 0.5 * b;
        let (i, j) = (a.floor(), b.floor());
        let (fa, fb) = (a - i, b - j);
        let (i, j) = (i as i64, j as i64);
        let corners = if fa + fb < 1.0 {
            [([i, j], 1.0 - fa - fb), ([i + 1, j], fa), ([i, j + 1], fb)]
        } else {
            [([i + 1, j + 1], fa + fb - 1.0), ([i, j + 1], 1.0 - fa), ([i + 1, j], 1.0 - fb)]
        };
        let sharp = corners.map(|(corner, weight)| (corner, weight.max(0.0).powi(SHARPNESS)));
        let sum: f32 = sharp.iter().map(|(_, weight)| weight).sum();
        sharp.map(|(corner, weight)| (corner, weight / sum))
    }

    /// Where the middles of pieces may be along an axis: pieces do not reach beyond the edges of a sample that ends there.
    fn range(&self, axis: usize) -> [f32; 2] {
        let size = self.size[axis] as f32;
        if self.periodic {
            return [0.0, size];
        }
        let reach = self.side * if axis == 0 { 1.0 } else { HEIGHT } + 1.0;
        if 2.0 * reach < size { [reach, size - reach] } else { [0.5 * size; 2] }
    }

    /// The pieces around a texture coordinate. They are shifted by whole texels, so the coordinate has the same place between
    /// texels in all of them.
    pub(super) fn around(&self, uv: Vec2) -> [Piece; 3] {
        let size = Vec2::new(self.size[0] as f32, self.size[1] as f32);
        // rows go down
        let point = Vec2::new(uv.x, 1.0 - uv.y) * size;
        let ranges = [0, 1].map(|axis| self.range(axis));
        self.corners(point).map(|([i, j], weight)| {
            let corner = Vec2::new(i as f32 + 0.5 * j as f32, j as f32 * HEIGHT) * self.side;
            let random = |axis: usize| unit(hash(&[self.seed, i as u64, j as u64, axis as u64]));
            let middle = |axis: usize| ranges[axis][0] + random(axis) * (ranges[axis][1] - ranges[axis][0]);
            let at = (Vec2::new(middle(0), middle(1)) - corner).round() + point;
            Piece { uv: Vec2::new(at.x / size.x, 1.0 - at.y / size.y), weight }
        })
    }

    /// How often each texel of the sample is used, with the weights of blends.
    pub(super) fn use_of_texels(&self) -> Vec<f32> {
        let [width, height] = self.size;
        if self.periodic {
            return vec![1.0; width * height];
        }
        // Sum up the weights of a piece, texel by texel from its middle
        let reach = self.side.ceil() as i64 + 1;
        let side = (2 * reach + 1) as usize;
        let mut sums = vec![0.0f64; (side + 1) * (side + 1)];
        for y in 0..side {
            let mut row = 0.0;
            for x in 0..side {
                let at = Vec2::new((x as i64 - reach) as f32, (y as i64 - reach) as f32);
                row += f64::from(self.weight_at(at));
                sums[(y + 1) * (side + 1) + x + 1] = sums[y * (side + 1) + x + 1] + row;
            }
        }
        // A texel is used by the pieces whose middle is in range
        let ranges = [0, 1].map(|axis| self.range(axis));
        let span = |axis: usize, texel: usize| {
            let centre = texel as f32 + 0.5;
            // each number of the sums stands for half a texel to both sides
            [1, 0].map(|end| (centre - ranges[axis][end] + reach as f32 + 0.5).clamp(0.0, side as f32))
        };
        let sum = |x: f32, y: f32| {
            let (left, top) = ((x as usize).min(side - 1), (y as usize).min(side - 1));
            let (fx, fy) = (f64::from(x) - left as f64, f64::from(y) - top as f64);
            let row = |y: usize| sums[y * (side + 1) + left] * (1.0 - fx) + sums[y * (side + 1) + left + 1] * fx;
            row(top) * (1.0 - fy) + row(top + 1) * fy
        };
        let of = |texel: usize| {
            let ([left, right], [top, bottom]) = (span(0, texel % width), span(1, texel / width));
            ((sum(right, bottom) + sum(left, top) - sum(left, bottom) - sum(right, top)) as f32).max(1e-6)
        };
        (0..width * height).map(of).collect()
    }

    /// The weight of the piece around the corner at the origin, as a share of the norm of all weights there.
    fn weight_at(&self, point: Vec2) -> f32 {
        let corners = self.corners(point);
        let norm = corners.iter().map(|(_, weight)| weight * weight).sum::<f32>().sqrt();
        corners.iter().find(|(corner, _)| *corner == [0, 0]).map_or(0.0, |(_, weight)| weight / norm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_stay_inside_the_sample_and_weights_are_continuous() {
        let pieces = Pieces::new([64, 40], false, 7);
        let mut last = [0.0f32; 3];
        for k in 0..20_000 {
            let uv = Vec2::new(k as f32 * 1e-4 - 0.7, 0.3 + k as f32 * 3e-5);
            let around = pieces.around(uv);
            assert!((around.iter().map(|piece| piece.weight).sum::<f32>() - 1.0).abs() < 1e-5);
            for piece in around.iter().filter(|piece| piece.weight > 0.0) {
                let at = piece.uv * Vec2::new(64.0, 40.0);
                assert!(at.x > 0.49 && at.x < 63.51 && at.y > 0.49 && at.y < 39.51, "{at}");
            }
            let mut weights = around.map(|piece| piece.weight);
            weights.sort_by(f32::total_cmp);
            let step = weights.iter().zip(&last).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(k == 0 || step < 0.01, "{k}: {step}");
            last = weights;
        }
    }

    #[test]
    fn the_use_of_texels_is_what_is_used() {
        let pieces = Pieces::new([32, 32], false, 1);
        let expected = pieces.use_of_texels();
        let mut found = vec![0.0f32; 32 * 32];
        let mut random = crate::random::Stream::new(2);
        for _ in 0..1_600_000 {
            let around = pieces.around(random.next2() * 300.0);
            let norm = around.iter().map(|piece| piece.weight * piece.weight).sum::<f32>().sqrt();
            for piece in around {
                let (x, y) = ((piece.uv.x * 32.0) as usize, ((1.0 - piece.uv.y) * 32.0) as usize);
                found[y.min(31) * 32 + x.min(31)] += piece.weight / norm;
            }
        }
        let [sum, other] = [&expected, &found].map(|all| all.iter().sum::<f32>());
        let difference: f32 = expected.iter().zip(&found).map(|(a, b)| (a / sum - b / other).abs()).sum();
        assert!(difference < 0.08, "{difference}");
        // the middle is used more than the corners
        assert!(expected[16 * 32 + 16] > 5.0 * expected[0]);
    }
}
