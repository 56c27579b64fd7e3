//! Discrete Fourier transforms of pictures whose sides are powers of two.

/// A complex number.
pub(super) type Complex = [f64; 2];

/// The product of two numbers.
#[inline]
pub(super) fn product([a, b]: Complex, [c, d]: Complex) -> Complex {
    [a * c - b * d, a * d + b * c]
}

/// Roots of unity for transforms of one length.
struct Roots(Vec<Complex>);

impl Roots {
    fn new(n: usize) -> Self {
        let root = |k: usize| {
            let angle = -std::f64::consts::TAU * k as f64 / n as f64;
            [libm::cos(angle), libm::sin(angle)]
        };
        Self((0..n / 2).map(root).collect())
    }

    /// Transforms in place; the length is that of the roots.
    fn transform(&self, values: &mut [Complex]) {
        let n = values.len();
        let bits = n.trailing_zeros();
        for i in 1..n {
            let j = i.reverse_bits() >> (usize::BITS - bits);
            if i < j {
                values.swap(i, j);
            }
        }
        let mut half = 1;
        while half < n {
            let stride = n / (2 * half);
            for block in values.chunks_exact_mut(2 * half) {
                let (low, high) = block.split_at_mut(half);
                for (k, (a, b)) in low.iter_mut().zip(high).enumerate() {
                    let turned = product(*b, self.0[k * stride]);
                    *b = [a[0] - turned[0], a[1] - turned[1]];
                    *a = [a[0] + turned[0], a[1] + turned[1]];
                }
            }
            half *= 2;
        }
    }
}

/// Transforms a picture of `width` columns in place, without scaling. Both sides are powers of two.
pub(super) fn transform(values: &mut [Complex], width: usize) {
    let height = values.len() / width;
    let (rows, columns) = (Roots::new(width), Roots::new(height));
    if width > 1 {
        values.chunks_exact_mut(width).for_each(|row| rows.transform(row));
    }
    if height > 1 {
        let mut column = vec![[0.0; 2]; height];
        for x in 0..width {
            column.iter_mut().enumerate().for_each(|(y, v)| *v = values[y * width + x]);
            columns.transform(&mut column);
            column.iter().enumerate().for_each(|(y, v)| values[y * width + x] = *v);
        }
    }
}

/// The inverse of [`transform`], with its scaling.
pub(super) fn inverse(values: &mut [Complex], width: usize) {
    let scale = 1.0 / values.len() as f64;
    values.iter_mut().for_each(|v| v[1] = -v[1]);
    transform(values, width);
    values.iter_mut().for_each(|v| *v = [v[0] * scale, -v[1] * scale]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_equals_its_definition_and_can_be_undone() {
        let (w, h) = (8, 4);
        let picture: Vec<Complex> = (0..w * h).map(|i| [((i * i) % 7) as f64, (i % 3) as f64]).collect();
        let mut found = picture.clone();
        transform(&mut found, w);
        for (i, value) in found.iter().enumerate() {
            let (u, v) = (i % w, i / w);
            let mut sum = [0.0; 2];
            for (j, number) in picture.iter().enumerate() {
                let turns = (u * (j % w)) as f64 / w as f64 + (v * (j / w)) as f64 / h as f64;
                let angle = -std::f64::consts::TAU * turns;
                let term = product(*number, [angle.cos(), angle.sin()]);
                sum = [sum[0] + term[0], sum[1] + term[1]];
            }
            assert!((sum[0] - value[0]).abs() + (sum[1] - value[1]).abs() < 1e-10, "{i}: {sum:?} {value:?}");
        }
        inverse(&mut found, w);
        assert!(found.iter().zip(&picture).all(|(a, b)| (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-12));
    }
}
