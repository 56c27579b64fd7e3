//! FLIP: the perceived difference of two images when flipping between them, 0 to 1.
//!
//! # Model
//! Images are filtered by the contrast sensitivity of the eye at [`PIXELS_PER_DEGREE`], separately for lightness,
//! red-green and blue-yellow (YCxCz). The colour difference is the HyAB distance in Hunt-adjusted Lab to the power 0.7,
//! mapped to 0..1 with large differences compressed. The feature difference compares edges and points of the lightness,
//! detected by first and second derivatives of Gaussians. FLIP is the colour difference to the power of one minus the
//! feature difference, averaged over pixels.
//!
//! # Limits
//! Images are compared as displayed: values are clamped to 0..1. Border pixels are repeated beyond the borders.
//!
//! # References
//! andersson2020, section 4

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::ciede2000::{WHITE_XYZ, lab};

/// Resolution of a display 0.7 m and 3840 pixels wide, viewed from 0.7 m.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// Contrast sensitivity for lightness, red-green and blue-yellow: sums of Gaussians a sqrt(pi / b) exp(-pi^2 x^2 / b),
/// x in degrees.
const SENSITIVITY: [&[(f64, f64)]; 3] = [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
/// The largest b above; it determines the filter radius.
const WIDEST: f64 = 0.04;
/// Width of the detected features, degrees.
const FEATURE: f64 = 0.082;
/// Exponent of the colour difference.
const POWER: f64 = 0.7;
/// The colour difference, as a fraction of the largest one, at which compression begins, and its value there.
const KNEE: (f64, f64) = (0.4, 0.95);

/// FLIP of two images in linear RGB, row by row, averaged over pixels.
///
/// # Panics
/// If a length is not a multiple of `width`, or the sizes differ.
pub fn flip(reference: &[Vec3], test: &[Vec3], width: usize) -> f64 {
    assert!(reference.len() == test.len() && width > 0 && test.len().is_multiple_of(width), "sizes differ");
    let [a, b] = [reference, test].map(|rgb| FilteredImage::new(rgb, width));
    // Compute colour differences relative to the largest one, green against blue
    let (green, blue) = (hunt(DVec3::Y), hunt(DVec3::Z));
    let most = hyab(green, blue).powf(POWER);
    let colours = a.colours.iter().zip(&b.colours).map(|(&a, &b)| redistribute(hyab(a, b).powf(POWER), most));
    // Compute feature differences
    let features = a.features.iter().zip(&b.features).map(|(a, b)| {
        let [edge, point] = [0, 1].map(|k| (a[k] - b[k]).abs());
        (FRAC_1_SQRT_2 * edge.max(point)).sqrt()
    });
    colours.zip(features).map(|(colour, feature)| colour.powf(1.0 - feature)).sum::<f64>() / test.len().max(1) as f64
}

/// A filtered image with its features.
struct FilteredImage {
    /// Hunt-adjusted Lab of the filtered image.
    colours: Vec<DVec3>,
    /// Strength of edges and points.
    features: Vec<[f64; 2]>,
}

impl FilteredImage {
    fn new(rgb: &[Vec3], width: usize) -> Self {
        let to_opponent = opponent();
        let planes: Vec<DVec3> = rgb.iter().map(|c| to_opponent * c.clamp(Vec3::ZERO, Vec3::ONE).as_dvec3()).collect();
        let plane = |k: usize| -> Vec<f64> { planes.iter().map(|c| c[k]).collect() };
        let blurred: Vec<Vec<f64>> = (0..3).into_par_iter().map(|k| blur(&plane(k), width, SENSITIVITY[k])).collect();
        let to_rgb = to_opponent.inverse();
        let colour = |i: usize| {
            hunt((to_rgb * DVec3::from_array([0, 1, 2].map(|k| blurred[k][i]))).clamp(DVec3::ZERO, DVec3::ONE))
        };
        Self { colours: (0..rgb.len()).map(colour).collect(), features: features(&plane(0), width) }
    }
}

/// Linear RGB to (Y, X - Y, Y - Z) relative to white: YCxCz without its constant factors, which commute with filtering.
fn opponent() -> DMat3 {
    let [x, y, z] = WHITE_XYZ.map(DVec3::from_array);
    DMat3::from_cols(y, x - y, y - z).transpose()
}

/// Hunt-adjusted Lab of linear RGB: dark colours are less saturated.
fn hunt(rgb: DVec3) -> DVec3 {
    let [l, a, b] = lab(rgb.to_array());
    DVec3::new(l, 0.01 * l * a, 0.01 * l * b)
}

fn hyab(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

fn redistribute(difference: f64, most: f64) -> f64 {
    let (knee, value) = (KNEE.0 * most, KNEE.1);
    if difference < knee {
        difference * value / knee
    } else {
        value + (difference - knee) / (most - knee) * (1.0 - value)
    }
}

/// Filters with a sum of separable Gaussians, normalized to preserve flat images.
fn blur(plane: &[f64], width: usize, gaussians: &[(f64, f64)]) -> Vec<f64> {
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let taps = |b: f64| kernel(radius, |x| (-(PI * x / PIXELS_PER_DEGREE).powi(2) / b).exp());
    let volume = |&(a, b): &(f64, f64)| a * (PI / b).sqrt() * taps(b).iter().sum::<f64>().powi(2);
    let total: f64 = gaussians.iter().map(volume).sum();
    let mut sum = vec![0.0; plane.len()];
    for gaussian in gaussians {
        let taps = normalized(taps(gaussian.1));
        let share = volume(gaussian) / total;
        let filtered = filter(plane, width, &taps, &taps);
        sum.iter_mut().zip(filtered).for_each(|(sum, value)| *sum += share * value);
    }
    sum
}

/// Strength of edges and points in the first plane of [`opponent`], which is (Y + 16) / 116 of YCxCz.
fn features(lightness: &[f64], width: usize) -> Vec<[f64; 2]> {
    let sigma = 0.5 * FEATURE * PIXELS_PER_DEGREE;
    let radius = (3.0 * sigma).ceil() as i32;
    let gaussian = |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
    let across = normalized(kernel(radius, gaussian));
    let strength = |along: &[f64]| -> Vec<f64> {
        let (x, y) = (filter(lightness, width, along, &across), filter(lightness, width, &across, along));
        x.iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
    };
    let edges = strength(&normalized(kernel(radius, |x| -x * gaussian(x))));
    let points = strength(&normalized(kernel(radius, |x| (x * x / (sigma * sigma) - 1.0) * gaussian(x))));
    edges.into_iter().zip(points).map(|(edge, point)| [edge, point]).collect()
}

fn kernel(radius: i32, value: impl Fn(f64) -> f64) -> Vec<f64> {
    (-radius..=radius).map(|x| value(f64::from(x))).collect()
}

/// Normalizes positive numbers to the sum 1 and negative ones to the sum -1.
fn normalized(mut taps: Vec<f64>) -> Vec<f64> {
    for sign in [1.0, -1.0] {
        let of_sign = |v: f64| v * sign > 0.0;
        let sum: f64 = taps.iter().copied().filter(|&v| of_sign(v)).map(f64::abs).sum();
        taps.iter_mut().filter(|v| of_sign(**v)).for_each(|v| *v /= sum);
    }
    taps
}

/// Filters the rows of a plane with `along_x`, then its columns with `along_y`.
fn filter(plane: &[f64], width: usize, along_x: &[f64], along_y: &[f64]) -> Vec<f64> {
    let radius = along_x.len() / 2;
    let mut rows = Vec::with_capacity(plane.len());
    for row in plane.chunks_exact(width) {
        let at = |x: usize| row[x.saturating_sub(radius).min(width - 1)];
        let padded: Vec<f64> = (0..width + 2 * radius).map(at).collect();
        rows.extend(
            padded.windows(along_x.len()).map(|window| window.iter().zip(along_x).map(|(v, t)| v * t).sum::<f64>()),
        );
    }
    let (height, radius) = (plane.len() / width, along_y.len() / 2);
    let mut out = vec![0.0; plane.len()];
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        for (tap, weight) in along_y.iter().enumerate() {
            let from = (y + tap).saturating_sub(radius).min(height - 1) * width;
            out.iter_mut().zip(&rows[from..from + width]).for_each(|(sum, value)| *sum += weight * value);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 40;

    fn flat(rgb: Vec3) -> Vec<Vec3> {
        vec![rgb; WIDTH * 30]
    }

    fn noise(amount: f32) -> Vec<Vec3> {
        let wave = |i: usize, k: f32| 0.5 + amount * (i as f32 * k).sin();
        (0..WIDTH * 30).map(|i| Vec3::new(wave(i, 1.7), wave(i, 2.3), wave(i, 3.1))).collect()
    }

    #[test]
    fn flat_images_differ_by_their_colour_only() {
        assert!((flip(&flat(Vec3::Y), &flat(Vec3::Z), WIDTH) - 1.0).abs() < 1e-9, "the largest difference");
        let (dark, light) = (flat(Vec3::splat(0.2)), flat(Vec3::splat(0.25)));
        // L = 116 cbrt(Y) - 16 for greys, which have no chroma; green and blue by lab().
        let difference = (116.0 * (0.25f64.cbrt() - 0.2f64.cbrt())).powf(POWER);
        let [[l1, a1, b1], [l2, a2, b2]] = [lab([0.0, 1.0, 0.0]), lab([0.0, 0.0, 1.0])];
        let chroma = (0.01 * (l1 * a1 - l2 * a2)).hypot(0.01 * (l1 * b1 - l2 * b2));
        let expected = difference * 0.95 / (0.4 * (l1 - l2 + chroma).powf(POWER));
        assert!((flip(&dark, &light, WIDTH) - expected).abs() < 1e-6, "{} {expected}", flip(&dark, &light, WIDTH));
    }

    #[test]
    fn larger_differences_give_larger_values_and_flip_is_symmetric() {
        let errors = [0.0, 0.05, 0.1, 0.3].map(|amount| flip(&noise(0.0), &noise(amount), WIDTH));
        assert!(errors[0] == 0.0 && errors.is_sorted_by(|a, b| a < b), "{errors:?}");
        let swapped = flip(&noise(0.3), &noise(0.0), WIDTH);
        assert!((swapped - errors[3]).abs() < 1e-12, "{errors:?} {swapped}");
        assert!(errors[3] < flip(&noise(0.0), &flat(Vec3::ONE), WIDTH));
    }

    /// Transposing both images does not change the result.
    #[test]
    fn axes_are_alike() {
        let dot = |at: usize| {
            let mut picture = flat(Vec3::splat(0.4));
            (0..8).for_each(|i| picture[at + i] = Vec3::new(1.0, 0.2, 0.1));
            picture
        };
        let upright = |picture: &[Vec3]| -> Vec<Vec3> {
            let height = picture.len() / WIDTH;
            (0..picture.len()).map(|i| picture[i % height * WIDTH + i / height]).collect()
        };
        let (a, b) = (dot(15 * WIDTH + 16), flat(Vec3::splat(0.4)));
        let (lying, standing) = (flip(&a, &b, WIDTH), flip(&upright(&a), &upright(&b), a.len() / WIDTH));
        assert!((lying - standing).abs() < 1e-12 && lying > 0.0, "{lying} {standing}");
    }
}
