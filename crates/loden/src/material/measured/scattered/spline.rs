//! A smooth function through scattered points.

use super::place::Place;
use crate::factor::linalg;
use crate::simd::wide;

/// Points per block.
const LANES: usize = 16;

/// Radial basis functions r^(3/2) around every point, plus a constant: continuous slopes, and a unique solution for any
/// distinct points.
///
/// # References
/// duchon1977
#[derive(Debug, Clone)]
pub struct Spline {
    /// (block, axis, point of the block)
    centres: Vec<[f32; LANES]>,
    axes: usize,
    /// (function, block, point of the block)
    weights: Vec<[f32; LANES]>,
    constants: Vec<f32>,
}

impl Spline {
    /// The most points whose weights are solved for.
    pub const MOST: usize = 3000;

    /// Through the values (point, function) at distinct points; `None` if two of them are too close to each other.
    pub fn new(points: &[Place], axes: usize, values: &[f32]) -> Option<Self> {
        let (n, functions) = (points.len(), values.len() / points.len());
        let blocks = n.div_ceil(LANES);
        let mut centres = vec![[0.0; LANES]; blocks * axes];
        for (i, point) in points.iter().enumerate() {
            (0..axes).for_each(|axis| centres[i / LANES * axes + axis][i % LANES] = point[axis]);
        }
        // Solve for the weights and the constants, with weights of sum 0
        let size = n + 1;
        let mut matrix = vec![0.0; size * size];
        let mut row = vec![[0.0; LANES]; blocks];
        for (i, point) in points.iter().enumerate() {
            radial(&centres, axes, point, &mut row);
            for j in 0..n {
                matrix[i * size + j] = f64::from(row[j / LANES][j % LANES]);
            }
            matrix[i * size + n] = 1.0;
            matrix[n * size + i] = 1.0;
        }
        let mut right: Vec<f64> = values.iter().map(|v| f64::from(*v)).collect();
        right.resize(size * functions, 0.0);
        let solution = linalg::solve(&matrix, size, &right)?;
        let mut weights = vec![[0.0; LANES]; functions * blocks];
        for (i, of_point) in solution.chunks_exact(functions).take(n).enumerate() {
            for (k, weight) in of_point.iter().enumerate() {
                weights[k * blocks + i / LANES][i % LANES] = *weight as f32;
            }
        }
        let constants = solution[n * functions..].iter().map(|v| *v as f32).collect();
        Some(Self { centres, axes, weights, constants })
    }

    /// The values at a point of the functions from `first`.
    pub fn at<const N: usize>(&self, place: &Place, first: usize) -> [f32; N] {
        let mut values = [(0.0, 0); N];
        self.each(place, first as u32.., &mut values);
        values.map(|(value, _)| value)
    }

    /// The values of some functions at a point, each with its function.
    pub fn each(&self, place: &Place, functions: impl Iterator<Item = u32>, values: &mut [(f32, u32)]) {
        let blocks = self.centres.len() / self.axes;
        let mut row = [[0.0; LANES]; Self::MOST.div_ceil(LANES)];
        let row = &mut row[..blocks];
        radial(&self.centres, self.axes, place, row);
        for (value, k) in values.iter_mut().zip(functions) {
            let weights = &self.weights[k as usize * blocks..][..blocks];
            *value = (self.constants[k as usize] + dot(row, weights), k);
        }
    }
}

wide! {
    /// The radial function of every point.
    fn radial(centres: &[[f32; LANES]], axes: usize, at: &Place, out: &mut [[f32; LANES]]) {
        for (block, out) in centres.chunks_exact(axes).zip(out) {
            let mut square = [0.0f32; LANES];
            for (centres, at) in block.iter().zip(at) {
                for i in 0..LANES {
                    square[i] += (centres[i] - at) * (centres[i] - at);
                }
            }
            for i in 0..LANES {
                let distance = square[i].sqrt();
                out[i] = distance * distance.sqrt();
            }
        }
    }
}

wide! {
    /// The inner product.
    fn dot(a: &[[f32; LANES]], b: &[[f32; LANES]]) -> f32 {
        let mut sum = [0.0f32; LANES];
        for (a, b) in a.iter().zip(b) {
            for i in 0..LANES {
                sum[i] += a[i] * b[i];
            }
        }
        sum.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_met_and_a_smooth_function_is_followed() {
        let at = |k: f32, i: usize| (k * (i as f32 + 0.5)).fract();
        let point = |i: usize| [at(0.754_877_7, i), at(0.569_840_3, i), at(0.438_579, i), 0.0, 0.0, 0.0];
        let f = |p: &Place| (2.0 * p[0]).sin() + p[1] * p[2];
        let points: Vec<Place> = (0..400).map(point).collect();
        let values: Vec<f32> = points.iter().flat_map(|p| [f(p), 3.0]).collect();
        let spline = Spline::new(&points, 3, &values).unwrap();
        for (i, p) in points.iter().enumerate() {
            let [a, b] = spline.at::<2>(p, 0);
            assert!((a - f(p)).abs() < 1e-3 && (b - 3.0).abs() < 1e-3, "{i}: {a} {} {b}", f(p));
        }
        let nearest = |p: &Place| {
            let distance = |q: &&Place| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f32>();
            points.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map_or(0.0, f)
        };
        let error = |value: &dyn Fn(&Place) -> f32| {
            (400..800).map(point).map(|p| (value(&p) - f(&p)).abs()).sum::<f32>() / 400.0
        };
        let [smooth, stepped] = [error(&|p| spline.at::<1>(p, 0)[0]), error(&nearest)];
        assert!(smooth < 0.1 * stepped, "{smooth} {stepped}");
    }
}
