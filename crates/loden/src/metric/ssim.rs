//! Structural similarity of two images.

use crate::color::luminance;
use crate::simd::wide;

/// Radius of the window.
const RADIUS: usize = 5;
const TAPS: usize = 2 * RADIUS + 1;
const SIGMA: f64 = 1.5;
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

/// Scratch memory, reused between images.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    luma: [Vec<f32>; 2],
    /// One row of the vertically filtered x, y, x^2 + y^2 and xy.
    rows: [Vec<f32>; 4],
}

/// Mean structural similarity of two grey images with values of 0..1, row by row.
///
/// # Model
/// SSIM = (2 mu_x mu_y + C1)(2 s_xy + C2) / ((mu_x^2 + mu_y^2 + C1)(s_x^2 + s_y^2 + C2)) with C1 = 0.01^2 and
/// C2 = 0.03^2. Moments are weighted with a Gaussian window of 11 x 11 texels and sigma 1.5, and SSIM is averaged over all
/// positions where the window lies within the image.
///
/// # Limits
/// An image less than 11 texels wide or high is one window with equal weights.
///
/// # References
/// wang2004, section III.B
///
/// # Panics
/// If an image does not have `width` x `height` values.
pub fn ssim(x: &[f32], y: &[f32], width: usize, height: usize) -> f64 {
    assert!(x.len() == width * height && y.len() == x.len(), "sizes differ");
    mean(x, y, width, height, &mut Default::default())
}

/// [`ssim`] of the luma of two RGB images.
pub(super) fn luma_ssim(x: &[f32], y: &[f32], width: usize, height: usize, buffers: &mut Buffers) -> f64 {
    let Buffers { luma: [luma_x, luma_y], rows } = buffers;
    for (luma, image) in [(&mut *luma_x, x), (&mut *luma_y, y)] {
        luma.clear();
        luma.extend(image.as_chunks::<3>().0.iter().map(|rgb| luminance(*rgb)));
    }
    mean(luma_x, luma_y, width, height, rows)
}

fn mean(x: &[f32], y: &[f32], width: usize, height: usize, rows: &mut [Vec<f32>; 4]) -> f64 {
    if width < TAPS || height < TAPS {
        return single_window(x, y);
    }
    let window = window();
    rows.iter_mut().for_each(|row| row.resize(width, 0.0));
    let sum = (0..=height - TAPS)
        .map(|first| {
            filter_columns(&x[first * width..], &y[first * width..], width, &window, rows);
            filter_row(rows, &window)
        })
        .sum::<f64>();
    sum / ((width - TAPS + 1) * (height - TAPS + 1)) as f64
}

fn window() -> [f32; TAPS] {
    let tap = |i: usize| (-(i as f64 - RADIUS as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
    let sum: f64 = (0..TAPS).map(tap).sum();
    std::array::from_fn(|i| (tap(i) / sum) as f32)
}

const LANES: usize = 16;

wide! {
    /// Filters the four products of 11 rows vertically.
    fn filter_columns(x: &[f32], y: &[f32], width: usize, window: &[f32; TAPS], rows: &mut [Vec<f32>; 4]) {
        let [mx, my, squares, products] = rows;
        let filter = |column: usize| {
            let mut sums = [0.0f32; 4];
            for (tap, weight) in window.iter().enumerate() {
                let (a, b) = (x[tap * width + column], y[tap * width + column]);
                for (sum, value) in sums.iter_mut().zip([a, b, a * a + b * b, a * b]) {
                    *sum += weight * value;
                }
            }
            sums
        };
        // Filter whole vectors of columns
        let mut first = 0;
        while first + LANES <= width {
            let mut sums = [[0.0f32; LANES]; 4];
            for (tap, weight) in window.iter().enumerate() {
                let (Some(a), Some(b)) = (
                    x[tap * width + first..].first_chunk::<LANES>(),
                    y[tap * width + first..].first_chunk::<LANES>(),
                ) else { continue };
                for i in 0..LANES {
                    sums[0][i] += weight * a[i];
                    sums[1][i] += weight * b[i];
                    sums[2][i] += weight * (a[i] * a[i] + b[i] * b[i]);
                    sums[3][i] += weight * (a[i] * b[i]);
                }
            }
            mx[first..first + LANES].copy_from_slice(&sums[0]);
            my[first..first + LANES].copy_from_slice(&sums[1]);
            squares[first..first + LANES].copy_from_slice(&sums[2]);
            products[first..first + LANES].copy_from_slice(&sums[3]);
            first += LANES;
        }
        // Filter the remaining columns
        for column in first..width {
            [mx[column], my[column], squares[column], products[column]] = filter(column);
        }
    }
}

wide! {
    /// The sum of SSIM over one row of window positions.
    fn filter_row(rows: &[Vec<f32>; 4], window: &[f32; TAPS]) -> f64 {
        let [mx, my, squares, products] = rows;
        let places = mx.len() - TAPS + 1;
        let mut total = 0.0;
        let mut first = 0;
        while first < places {
            // The last block overlaps the previous one; skip what has been counted.
            let start = if first + LANES <= places { first } else { places.saturating_sub(LANES) };
            let lanes = LANES.min(places);
            let mut values = [0.0f32; LANES];
            if lanes == LANES {
                let mut sums = [[0.0f32; LANES]; 4];
                for (tap, weight) in window.iter().enumerate() {
                    for (sum, row) in sums.iter_mut().zip([mx, my, squares, products]) {
                        let Some(row) = row[start + tap..].first_chunk::<LANES>() else { continue };
                        for i in 0..LANES {
                            sum[i] += weight * row[i];
                        }
                    }
                }
                for i in 0..LANES {
                    values[i] = similarity(sums[0][i], sums[1][i], sums[2][i], sums[3][i]);
                }
            } else {
                for (i, value) in values.iter_mut().enumerate().take(lanes) {
                    let sum = |row: &[f32]| window.iter().zip(&row[i..]).map(|(w, v)| w * v).sum::<f32>();
                    *value = similarity(sum(mx), sum(my), sum(squares), sum(products));
                }
            }
            total += values[first - start..lanes].iter().map(|&v| f64::from(v)).sum::<f64>();
            first = start + lanes;
        }
        total
    }
}

/// SSIM from the means of x, y, x^2 + y^2 and xy.
#[inline(always)]
fn similarity(mx: f32, my: f32, squares: f32, products: f32) -> f32 {
    let (mean_squares, mean_product) = (mx * mx + my * my, mx * my);
    let (variances, covariance) = (squares - mean_squares, products - mean_product);
    (2.0 * mean_product + C1) * (2.0 * covariance + C2) / ((mean_squares + C1) * (variances + C2))
}

fn single_window(x: &[f32], y: &[f32]) -> f64 {
    let count = x.len().max(1) as f64;
    let mean = |value: &dyn Fn(f64, f64) -> f64| {
        x.iter().zip(y).map(|(&x, &y)| value(f64::from(x), f64::from(y))).sum::<f64>() / count
    };
    let (mx, my) = (mean(&|x, _| x), mean(&|_, y| y));
    let variances = mean(&|x, y| (x - mx).powi(2) + (y - my).powi(2));
    let covariance = mean(&|x, y| (x - mx) * (y - my));
    let (c1, c2) = (f64::from(C1), f64::from(C2));
    (2.0 * mx * my + c1) * (2.0 * covariance + c2) / ((mx * mx + my * my + c1) * (variances + c2))
}
