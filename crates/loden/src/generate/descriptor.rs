//! What rows of different materials are compared by.

use glam::Vec3;
use rayon::prelude::*;

use super::Rows;
use super::reflectance::{Geometry, Separated};
use super::select::mean_color;

/// Bins of the lightness of neighbours.
const BINS: usize = 8;

/// Numbers of a descriptor.
const NUMBERS: usize = 3 + 2 + 2 + BINS;

/// Differences that count as 1: of CIE Lab, of the logarithm of the highlight's strength and of its width, of anisotropy,
/// and of the fraction of neighbours in a bin.
const SCALES: [f64; 5] = [10.0, 1.0, 0.7, 0.5, 0.5];

/// What is known of a row, whatever directions it was measured for.
///
/// # Model
/// Mean colour in CIE Lab (D65); logarithms of the strength and the width of the highlight; anisotropy, as the two second
/// moments of the highlight over half vectors; and the histogram of how bright its neighbours are, as ranks among all texels.
/// Each is divided by a difference that is as visible as one of 10 in Lab, so squared distances are costs.
///
/// # Limits
/// The scales are chosen, not measured. The width counts only as far as there is a highlight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Descriptor {
    /// Mean colour in CIE Lab.
    pub lab: [f64; 3],
    numbers: [f64; NUMBERS],
}

impl Descriptor {
    /// The squared distance to another; 1 is a difference of 10 in CIE Lab, or one as visible.
    pub fn distance(&self, other: &Self) -> f64 {
        self.numbers.iter().zip(&other.numbers).map(|(a, b)| (a - b).powi(2)).sum()
    }
}

/// The descriptors of all rows.
pub fn descriptors(rows: &Rows) -> Vec<Descriptor> {
    let geometry = Geometry::new(rows.meta());
    let colors: Vec<[f64; 3]> = (0..rows.count()).into_par_iter().map(|row| mean_color(rows, row)).collect();
    let around = neighbours(rows, &colors);
    let describe = |row: usize| {
        let parts = Separated::new(&geometry, &rows.values(row));
        let (strength, alpha) = (f64::from(parts.fit.strength), f64::from(parts.fit.alpha));
        let seen = strength / (strength + 0.2);
        let shape = anisotropy(&geometry, &parts.specular);
        let [c, s, w, a, n] = SCALES;
        let mut numbers = [0.0; NUMBERS];
        (0..3).for_each(|k| numbers[k] = colors[row][k] / c);
        (numbers[3], numbers[4]) = ((strength + 0.1).ln() / s, seen * alpha.ln() / w);
        (0..2).for_each(|k| numbers[5 + k] = seen * shape[k] / a);
        (0..BINS).for_each(|k| numbers[7 + k] = around[row][k] / n);
        Descriptor { lab: colors[row], numbers }
    };
    (0..rows.count()).into_par_iter().map(describe).collect()
}

/// How much longer the highlight is along the tangent than across, and the same at 45 degrees: 0 if it is round.
fn anisotropy(geometry: &Geometry, specular: &[f32]) -> [f64; 2] {
    let (mut mass, mut shape) = (1e-9, [0.0; 2]);
    for (pair, s) in specular.iter().enumerate() {
        let Vec3 { x, y, .. } = geometry.half(pair);
        let (s, x, y) = (f64::from(*s), f64::from(x), f64::from(y));
        mass += s * (x * x + y * y);
        shape = [shape[0] + s * (x * x - y * y), shape[1] + s * 2.0 * x * y];
    }
    shape.map(|moment| moment / mass)
}

/// For each row, the fractions of the neighbours of its texels by rank of lightness; texels beyond an edge are those of the
/// opposite one.
fn neighbours(rows: &Rows, colors: &[[f64; 3]]) -> Vec<[f64; BINS]> {
    let (width, height) = (rows.meta().width, rows.meta().height);
    let populations = rows.populations();
    // The rank of each row, as the fraction of texels that are darker
    let mut order: Vec<usize> = (0..rows.count()).collect();
    order.sort_by(|a, b| colors[*a][0].total_cmp(&colors[*b][0]));
    let (mut bin, mut below) = (vec![0; rows.count()], 0.0);
    for row in order {
        let middle = (below + 0.5 * populations[row]) / (width * height) as f64;
        bin[row] = ((middle * BINS as f64) as usize).min(BINS - 1);
        below += populations[row];
    }
    let mut histograms = vec![[0.0; BINS]; rows.count()];
    let index = rows.index();
    for y in 0..height {
        for x in 0..width {
            let own = &mut histograms[usize::from(index[y * width + x])];
            for (dx, dy) in [(0, 1), (0, height - 1), (1, 0), (width - 1, 0), (1, 1), (width - 1, height - 1)] {
                let texel = (y + dy) % height * width + (x + dx) % width;
                own[bin[usize::from(index[texel])]] += 1.0;
            }
        }
    }
    for histogram in &mut histograms {
        let sum: f64 = histogram.iter().sum();
        histogram.iter_mut().for_each(|v| *v /= sum.max(1.0));
    }
    histograms
}
