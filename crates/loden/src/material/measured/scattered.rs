//! Measured directions in no regular order.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};

use super::{BrdfSample, Table, possible};
use crate::direction::{HalfDifference, theta};
use crate::material::Promises;
use crate::{Error, Result};

/// Number of neighbouring samples used for interpolation.
const NEIGHBOURS: usize = 12;

/// Ridge term of the least-squares plane, relative to the spread of the neighbours.
const RIDGE: f32 = 0.002;

/// An isotropic, reciprocal BRDF given at scattered pairs of directions.
///
/// # Model
/// A pair is mapped to three dimensions: (sqrt(2 theta_h / pi), 2 theta_d / pi, 2 |cos theta_i - cos theta_o|) with
/// half and difference angles. These determine a BRDF that is isotropic, reciprocal and symmetric under mirroring, so
/// one sample stands for all pairs that these symmetries give. The square root spreads the lobe; the factor 2 did
/// best among several in leave-one-out tests on Cornell's samples. The twelve nearest samples have the weights ((R -
/// d) / (R d))^2, where R is the distance of the thirteenth (modified Shepard). A plane is fitted to the cube
/// roots of their values with these weights; its value is clamped to the range of the neighbours and cubed. The result is
/// continuous and exact at samples. A weighted mean instead of the plane would be level at every sample, which shows as
/// terraces. A plane through the values themselves is led by the brightest neighbours, which draws streaks out of
/// highlights.
///
/// Relative root mean square errors of the cube root of value times cosine, for Cornell's samples left out by tenths (and
/// all of a light's at once):
///
/// | | acryl blue | Cayman | Mystique |
/// |---|---|---|---|
/// | plane through the values | 0.235 (0.291) | 0.592 (0.678) | 0.667 (0.751) |
/// | plane through their cube roots, kept | 0.148 (0.234) | 0.483 (0.503) | 0.558 (0.569) |
/// | the same with 40 neighbours and Gaussian weights | 0.155 (0.228) | 0.492 (0.516) | 0.563 (0.582) |
/// | radial functions of 32 neighbours on cube roots | 0.176 (0.249) | 0.500 (0.522) | 0.579 (0.595) |
///
/// # Limits
/// Outside the measured directions the nearest samples extend. Samples that the symmetries map to one point, such as
/// a measurement and its reciprocal, are averaged. Towards the horizon, measurements that are 0 (clamped negative
/// ones) lie beside larger ones, which makes shadow lines ragged.
///
/// # References
/// rusinkiewicz1998, shepard1968; the least-squares plane is our addition
#[derive(Debug, Clone)]
pub struct Scattered {
    samples: Vec<BrdfSample>,
    places: Vec<Vec3>,
    /// The cube roots of the samples' values.
    roots: Vec<Vec3>,
    wavelengths: Vec<f32>,
    /// Cube roots: `[sample][wavelength]`.
    spectra: Vec<f32>,
    tree: Tree,
}

impl Scattered {
    /// Creates a BRDF from one or more samples.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there are no samples.
    pub fn new(samples: Vec<BrdfSample>) -> Result<Self> {
        Self::spectral(samples, Vec::new(), Vec::new())
    }

    /// Creates a BRDF from one or more samples, with the spectrum of each: `[sample][wavelength]`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there are no samples, or the number of spectra differs.
    pub fn spectral(samples: Vec<BrdfSample>, wavelengths: Vec<f32>, spectra: Vec<f32>) -> Result<Self> {
        if samples.is_empty() {
            return Err(Error::parameter("samples", "there are no samples"));
        }
        if spectra.len() != samples.len() * wavelengths.len() {
            let problem = format!("found {} numbers for {} samples", spectra.len(), samples.len());
            return Err(Error::parameter("spectra", problem));
        }
        possible("samples", samples.iter().flat_map(|s| s.value.to_array()))?;
        let places: Vec<Vec3> = samples.iter().map(|s| place(s.wi, s.wo)).collect();
        let tree = Tree::new(&places);
        let roots = samples.iter().map(|s| Vec3::from(s.value.to_array().map(f32::cbrt))).collect();
        let spectra = spectra.into_iter().map(f32::cbrt).collect();
        Ok(Self { samples, places, roots, wavelengths, spectra, tree })
    }

    /// The samples around a pair of directions and their weights, which have sum 1 and may be negative.
    fn stencil(&self, wi: Vec3, wo: Vec3) -> ([(usize, f32); NEIGHBOURS], usize) {
        let at = place(wi, wo);
        let mut nearest = Nearest::default();
        self.tree.search(at, &mut nearest);
        let radius = nearest.list[nearest.count - 1].0.sqrt();
        let inner = if nearest.count > NEIGHBOURS { NEIGHBOURS } else { nearest.count };
        let mut stencil = [(0, 0.0); NEIGHBOURS];
        let mut sum = 0.0;
        for (slot, &(square, sample)) in stencil.iter_mut().zip(&nearest.list[..inner]) {
            let distance = square.sqrt().max(1e-6);
            // with fewer samples no distance is available at which the last weight should vanish
            let fade = if nearest.count > NEIGHBOURS { (radius - distance).max(1e-9) / radius.max(1e-6) } else { 1.0 };
            let weight = (fade / distance).powi(2);
            *slot = (sample as usize, weight);
            sum += weight;
        }
        stencil.iter_mut().for_each(|s| s.1 /= sum);
        self.follow_slopes(at, radius, &mut stencil[..inner]);
        (stencil, inner)
    }

    /// Converts the weights of a mean to those of a plane fitted to the neighbours.
    fn follow_slopes(&self, at: Vec3, radius: f32, stencil: &mut [(usize, f32)]) {
        let away = |sample: usize| self.places[sample] - at;
        let mean: Vec3 = stencil.iter().map(|&(sample, weight)| away(sample) * weight).sum();
        let mut spread = Mat3::from_diagonal(Vec3::splat(RIDGE * radius * radius + 1e-12));
        for &(sample, weight) in stencil.iter() {
            let d = away(sample) - mean;
            spread += Mat3::from_cols(d * d.x, d * d.y, d * d.z) * weight;
        }
        let slope = spread.inverse() * mean;
        for (sample, weight) in stencil {
            *weight *= 1.0 - (away(*sample) - mean).dot(slope);
        }
    }

    /// The cube of the weighted sum of cube roots, clamped to their range.
    fn sum(stencil: &[(usize, f32)], root: impl Fn(usize) -> Vec3) -> Vec3 {
        let (mut sum, mut low, mut high) = (Vec3::ZERO, Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &(sample, weight) in stencil {
            let root = root(sample);
            sum += root * weight;
            (low, high) = (low.min(root), high.max(root));
        }
        let root = sum.clamp(low, high);
        root * root * root
    }
}

/// The point that represents a pair and all pairs equivalent to it by symmetry.
fn place(wi: Vec3, wo: Vec3) -> Vec3 {
    let HalfDifference { wh, wd } = HalfDifference::new(wi, wo);
    Vec3::new((theta(wh) * 2.0 / PI).sqrt(), theta(wd) * 2.0 / PI, 2.0 * (wi.z - wo.z).abs())
}

impl Table for Scattered {
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3 {
        let (stencil, count) = self.stencil(wi, wo);
        Self::sum(&stencil[..count], |sample| self.roots[sample])
    }

    fn samples(&self) -> Vec<BrdfSample> {
        self.samples.clone()
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: false, isotropic: true }
    }

    fn wavelengths(&self) -> &[f32] {
        &self.wavelengths
    }

    fn spectrum(&self, wi: Vec3, wo: Vec3) -> Vec<f32> {
        let (stencil, count) = self.stencil(wi, wo);
        let bands = self.wavelengths.len();
        let at = |band| Self::sum(&stencil[..count], |s| Vec3::splat(self.spectra[s * bands + band])).x;
        (0..bands).map(at).collect()
    }
}

/// The nearest points found so far, ascending: (square of the distance, point).
#[derive(Default)]
struct Nearest {
    list: [(f32, u32); NEIGHBOURS + 1],
    count: usize,
}

impl Nearest {
    fn worst(&self) -> f32 {
        if self.count <= NEIGHBOURS { f32::INFINITY } else { self.list[NEIGHBOURS].0 }
    }

    fn insert(&mut self, square: f32, point: u32) {
        if square >= self.worst() {
            return;
        }
        let at = self.list[..self.count].partition_point(|p| p.0 <= square);
        self.count = (self.count + 1).min(NEIGHBOURS + 1);
        self.list[at..self.count].rotate_right(1);
        self.list[at] = (square, point);
    }
}

/// A k-d tree without pointers: the median splits each part, along alternating axes.
#[derive(Debug, Clone)]
struct Tree {
    points: Vec<(Vec3, u32)>,
}

impl Tree {
    fn new(points: &[Vec3]) -> Self {
        let mut points: Vec<_> = points.iter().copied().zip(0..).collect();
        build(&mut points, 0);
        Self { points }
    }

    fn search(&self, at: Vec3, nearest: &mut Nearest) {
        descend(&self.points, 0, at, nearest);
    }
}

fn build(points: &mut [(Vec3, u32)], axis: usize) {
    if points.len() < 2 {
        return;
    }
    let middle = points.len() / 2;
    // Break ties by index, so that the tree depends only on the samples
    points.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    let (low, high) = points.split_at_mut(middle);
    build(low, (axis + 1) % 3);
    build(&mut high[1..], (axis + 1) % 3);
}

fn descend(points: &[(Vec3, u32)], axis: usize, at: Vec3, nearest: &mut Nearest) {
    let middle = points.len() / 2;
    let Some(&(point, number)) = points.get(middle) else { return };
    nearest.insert(point.distance_squared(at), number);
    let (low, high) = (&points[..middle], &points[middle + 1..]);
    let side = at[axis] - point[axis];
    let (near, far) = if side < 0.0 { (low, high) } else { (high, low) };
    descend(near, (axis + 1) % 3, at, nearest);
    if side * side < nearest.worst() {
        descend(far, (axis + 1) % 3, at, nearest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::from_angles;

    /// A diffuse part and a narrow lobe.
    fn glossy(wi: Vec3, wo: Vec3) -> Vec3 {
        let half = (wi + wo).normalize();
        Vec3::splat(0.05 + 20.0 * half.z.powi(400))
    }

    #[test]
    fn samples_left_out_of_a_highlight_are_found_again() {
        let pairs = (0..1500).map(|i| {
            let at = |k: f32| (k * (i as f32 + 0.5)).fract();
            let theta = |u: f32| u.sqrt() * 80f32.to_radians();
            let wi = from_angles(theta(at(0.754_877_7)), 0.0);
            // most of them around the mirror direction, as gonioreflectometers measure
            let near = 0.6 * (at(0.569_840_3) - 0.5);
            let wo = from_angles((theta(at(0.754_877_7)) + near).abs().min(1.4), PI + 0.8 * (at(0.438_579) - 0.5));
            (wi, wo)
        });
        let samples: Vec<BrdfSample> = pairs.map(|(wi, wo)| BrdfSample { wi, wo, value: glossy(wi, wo) }).collect();
        let (mut errors, mut values) = (0.0, 0.0);
        for part in 0..5 {
            let kept = samples.iter().enumerate().filter(|(i, _)| i % 5 != part).map(|(_, s)| *s).collect();
            let table = Scattered::new(kept).unwrap();
            for s in samples.iter().skip(part).step_by(5) {
                let (found, right) = (table.value(s.wi, s.wo).x.cbrt(), s.value.x.cbrt());
                errors += (found - right).powi(2);
                values += right * right;
            }
        }
        let error = (errors / values).sqrt();
        println!("relative error of cube roots {error:.4}");
        assert!(error < 0.03, "{error}");
        let table = Scattered::new(samples.clone()).unwrap();
        let exact = |s: &BrdfSample| (table.value(s.wi, s.wo) - s.value).abs().max_element() < 1e-4 * s.value.x;
        assert!(samples.iter().filter(|s| !exact(s)).count() < 15);
    }
}
