//! Power spectra.

use super::super::fft::{self, Complex};
use super::planes::Planes;

pub(super) fn spectrum_error(original: &Planes, result: &Planes) -> f64 {
    let smallest = [original.width, original.height, result.width, result.height].into_iter().min().unwrap_or(0);
    if smallest < 8 {
        return 0.0;
    }
    let side = 1 << smallest.min(256).ilog2();
    let (a, b) = (spectrum(original, side), spectrum(result, side));
    // what is less than this share of the mean power is noise
    let floor = 1e-4 * a.iter().sum::<f64>() / a.len() as f64;
    if floor <= 0.0 {
        return 0.0;
    }
    a.iter().zip(&b).map(|(a, b)| (0.5 * libm::log((b + floor) / (a + floor))).abs()).sum::<f64>() / a.len() as f64
}

/// Rings and sectors of a power spectrum.
const RINGS: usize = 12;
const SECTORS: usize = 8;

/// The mean power of all channels over rings and sectors, from overlapping squares of a picture with soft edges.
fn spectrum(planes: &Planes, side: usize) -> Vec<f64> {
    let window = |x: usize| {
        let s = libm::sin(std::f64::consts::PI * (x as f64 + 0.5) / side as f64);
        s * s
    };
    let windows: Vec<f64> = (0..side).map(window).collect();
    let starts = |n: usize| (0..=(n - side) / (side / 2).max(1)).map(|k| k * (side / 2)).take(4).collect::<Vec<_>>();
    let mut power = vec![0.0; RINGS * SECTORS];
    let mut count = 0.0;
    for y0 in starts(planes.height) {
        for x0 in starts(planes.width) {
            count += 1.0;
            for c in 0..planes.channels {
                let value = |i: usize| {
                    f64::from(planes.values[((y0 + i / side) * planes.width + x0 + i % side) * planes.channels + c])
                };
                let mean = (0..side * side).map(value).sum::<f64>() / (side * side) as f64;
                let soft = |i: usize| [(value(i) - mean) * windows[i / side] * windows[i % side], 0.0];
                let mut square: Vec<Complex> = (0..side * side).map(soft).collect();
                fft::transform(&mut square, side);
                collect(&square, side, &mut power);
            }
        }
    }
    power.iter_mut().for_each(|power| *power /= count);
    power
}

/// Adds the mean power of each ring and sector.
fn collect(spectrum: &[Complex], side: usize, power: &mut [f64]) {
    let (mut sums, mut counts) = (vec![0.0; power.len()], vec![0.0; power.len()]);
    let half = side as f64 / 2.0;
    for (i, value) in spectrum.iter().enumerate().skip(1) {
        let signed = |k: usize| if k > side / 2 { k as f64 - side as f64 } else { k as f64 };
        let (x, y) = (signed(i % side), signed(i / side));
        let frequency = libm::sqrt(x * x + y * y) / half;
        if frequency >= 1.0 {
            continue;
        }
        let turn = libm::atan2(y, x) / std::f64::consts::PI;
        let sector = ((turn + 1.0) * SECTORS as f64) as usize % SECTORS;
        let bin = (frequency * RINGS as f64) as usize * SECTORS + sector;
        sums[bin] += value[0] * value[0] + value[1] * value[1];
        counts[bin] += 1.0;
    }
    for ((power, sum), count) in power.iter_mut().zip(sums).zip(counts) {
        *power += sum / f64::max(count, 1.0);
    }
}
