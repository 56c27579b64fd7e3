//! Measured directions in no regular order.

pub(in crate::material) mod place;
pub(in crate::material) mod spline;
pub(in crate::material) mod tree;

use glam::{Mat3, Vec3};

use super::{BrdfSample, Table, possible};
use crate::material::Promises;
use crate::{Error, Result};
use place::{Place, Symmetry};
use spline::Spline;
use tree::{NEIGHBOURS, Nearest, Tree};

/// A BRDF given at scattered pairs of directions.
///
/// # Model
/// A pair is mapped to three dimensions: (sqrt(2 theta_h / pi), 2 theta_d / pi, 2 |cos theta_i - cos theta_o|) with
/// half and difference angles. These determine a BRDF that is isotropic, reciprocal and symmetric under mirroring, so
/// one sample stands for all pairs that these symmetries give. The square root spreads the lobe. Where samples that should be
/// equal by these symmetries differ, the difference of the cosines keeps its sign, and the azimuth of the half vector
/// and the side that the light is on add three dimensions ([`Scattered::asymmetry`]).
///
/// What is interpolated is ln(f cos theta_i cos theta_o + e) or ln(f + e), whichever predicts samples better that
/// are left out by fifths: the cosines take away most of the rise of a gloss towards the horizon, which a matt surface does not have. e, a
/// fiftieth of the median, keeps the logarithm of noise around 0 from ruling its neighbours. Radial functions r^(3/2) around
/// all samples, plus a constant, give a smooth surface through them. The result is limited to the range of the twelve
/// nearest samples, since smooth functions overshoot beside steps and beyond the last samples; towards the thirteenth, samples lose
/// their say in it, so that the limits are continuous. It is exact at
/// samples and never negative. Of more than 3000 samples the surface is a plane through the twelve nearest, with the
/// weights ((R - d) / (R d))^2, where R is the distance of the thirteenth (modified Shepard).
///
/// Errors at samples left out by fifths (`benches/programs/scattered_error.rs`): the mean difference over the mean value, the
/// root mean square difference of the cube roots of f cos over that of black, and the mean relative difference.
///
/// | | acryl blue | Cayman | Mystique | CUReT, 61 materials |
/// |---|---|---|---|---|
/// | nearest sample | 0.431 0.232 0.130 | 0.947 0.440 0.184 | 0.939 0.520 0.628 | 0.181 0.089 0.175 |
/// | plane through the cube roots of twelve | 0.399 0.167 0.116 | 1.088 0.470 0.482 | 1.128 0.577 0.442 | 0.103 0.056 0.110 |
/// | this surface | 0.221 0.145 0.068 | 0.922 0.394 0.079 | 0.999 0.522 0.359 | 0.077 0.035 0.059 |
///
/// # Limits
/// Outside the measured directions the surface is as far as its nearest samples. Samples that coincide, such as a
/// measurement and its reciprocal, are averaged.
///
/// # References
/// rusinkiewicz1998, duchon1977, shepard1968
#[derive(Debug, Clone)]
pub struct Scattered {
    samples: Vec<BrdfSample>,
    wavelengths: Vec<f32>,
    symmetry: Symmetry,
    asymmetry: Asymmetry,
    /// Distinct points.
    places: Vec<Place>,
    tree: Tree,
    rgb: Surface,
    spectra: Option<Surface>,
}

/// How samples differ that the symmetries make equal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asymmetry {
    /// Number of samples that coincide with others.
    pub samples: usize,
    /// Root mean square of their deviation from their mean, relative to the mean.
    pub deviation: f32,
}

/// Deviation above which a surface counts as anisotropic or not reciprocal; noise is below.
const ASYMMETRIC: f32 = 0.1;
/// Points closer than this are one.
const SAME: f32 = 1e-3;
/// Added before the logarithm, relative to the median of positive values.
const NOISE: f32 = 0.02;
/// Least cosine of a direction: beyond 84 degrees f no longer grows.
const GRAZING: f32 = 0.1;
/// Parts in which samples are left out, and the most samples of them.
const FOLDS: usize = 5;
const MOST_HELD_OUT: usize = 800;
/// A point counts in full for the range of values up to 1 - 1 / this of the distance of the thirteenth.
const REACH: f32 = 4.0;
/// Ridge term of the least-squares plane, relative to the spread of the neighbours.
const RIDGE: f32 = 0.002;

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
        let bands = wavelengths.len();
        if spectra.len() != samples.len() * bands {
            let problem = format!("found {} numbers for {} samples", spectra.len(), samples.len());
            return Err(Error::parameter("spectra", problem));
        }
        possible("samples", samples.iter().flat_map(|s| s.value.to_array()))?;
        let asymmetry = Asymmetry::of(&samples);
        let symmetry = if asymmetry.deviation > ASYMMETRIC { Symmetry::None } else { Symmetry::Isotropic };
        let of_sample: Vec<Place> = samples.iter().map(|s| symmetry.place(s.wi, s.wo)).collect();
        let groups = groups(&of_sample, symmetry);
        let places: Vec<Place> = groups.iter().map(|group| of_sample[group[0] as usize]).collect();
        let tree = Tree::new(&places, symmetry.axes());
        let rgb: Vec<f32> = samples.iter().flat_map(|s| s.value.to_array()).collect();
        let levels = |values: &[f32], glossy: bool| Levels::new(&samples, values, &groups, glossy);
        let [matt, glossy] = [false, true].map(|glossy| levels(&rgb, glossy).held_out_error(&places, symmetry));
        let surface = |values: &[f32]| Surface::new(levels(values, glossy < matt), &places, symmetry);
        let (rgb, spectra) = (surface(&rgb), (bands > 0).then(|| surface(&spectra)));
        Ok(Self { samples, wavelengths, symmetry, asymmetry, places, tree, rgb, spectra })
    }

    /// How far the samples bear out isotropy and reciprocity, which are imposed on them if [`Asymmetry::deviation`] is at
    /// most a tenth.
    pub fn asymmetry(&self) -> Asymmetry {
        self.asymmetry
    }

    /// Whether isotropy and reciprocity are imposed.
    pub fn is_symmetric(&self) -> bool {
        self.symmetry == Symmetry::Isotropic
    }
}

impl Asymmetry {
    fn of(samples: &[BrdfSample]) -> Self {
        let places: Vec<Place> = samples.iter().map(|s| Symmetry::Isotropic.place(s.wi, s.wo)).collect();
        let value = |i: u32| f64::from(samples[i as usize].value.element_sum());
        let mut values: Vec<f64> = (0..samples.len() as u32).map(value).collect();
        values.sort_by(f64::total_cmp);
        // what is far below the median is noise
        let noise = 0.1 * values[values.len() / 2];
        let (mut count, mut squares, mut freedoms) = (0, 0.0f64, 0usize);
        for group in groups(&places, Symmetry::Isotropic).iter().filter(|group| group.len() > 1) {
            let mean = group.iter().map(|&i| value(i)).sum::<f64>() / group.len() as f64;
            let unit = (mean + noise).max(f64::MIN_POSITIVE);
            squares += group.iter().map(|&i| ((value(i) - mean) / unit).powi(2)).sum::<f64>();
            (count, freedoms) = (count + group.len(), freedoms + group.len() - 1);
        }
        Self { samples: count, deviation: (squares / freedoms.max(1) as f64).sqrt() as f32 }
    }
}

/// The samples at each distinct point.
fn groups(places: &[Place], symmetry: Symmetry) -> Vec<Vec<u32>> {
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    order.sort_by(|a, b| places[*a as usize][0].total_cmp(&places[*b as usize][0]).then(a.cmp(b)));
    let mut groups: Vec<Vec<u32>> = Vec::new();
    for sample in order {
        let at = &places[sample as usize];
        let close = |i: &u32| (0..symmetry.axes()).all(|k| (places[*i as usize][k] - at[k]).abs() < SAME);
        // points are in order of their first coordinate
        let near = |group: &&mut Vec<u32>| at[0] - places[group[0] as usize][0] < SAME;
        match groups.iter_mut().rev().take_while(near).find(|group| close(&group[0])) {
            Some(group) => group.push(sample),
            None => groups.push(vec![sample]),
        }
    }
    groups
}

/// Several functions at distinct points, and their logarithms.
#[derive(Debug, Clone)]
struct Levels {
    /// (point, function)
    means: Vec<f32>,
    /// Their logarithms.
    numbers: Vec<f32>,
    /// What is added before the logarithm.
    floors: Vec<f32>,
    /// The cosine of the light and the product of both cosines at each point.
    cosines: Vec<[f32; 2]>,
    /// Whether the functions are multiplied by both cosines before that.
    glossy: bool,
}

impl Levels {
    /// Of values (sample, function), averaged over the samples of each point.
    fn new(samples: &[BrdfSample], values: &[f32], groups: &[Vec<u32>], glossy: bool) -> Self {
        let functions = values.len() / samples.len();
        let weighted = |sample: u32, k: usize| {
            let BrdfSample { wi, wo, .. } = samples[sample as usize];
            values[sample as usize * functions + k].max(0.0) * if glossy { cosines(wi, wo) } else { 1.0 }
        };
        let floors: Vec<f32> = (0..functions)
            .map(|k| {
                let mut positive: Vec<f32> =
                    (0..samples.len() as u32).map(|i| weighted(i, k)).filter(|v| *v > 0.0).collect();
                positive.sort_by(f32::total_cmp);
                NOISE * positive.get(positive.len() / 2).copied().unwrap_or(1.0)
            })
            .collect();
        let mean = |group: &[u32], k: usize| group.iter().map(|&i| weighted(i, k)).sum::<f32>() / group.len() as f32;
        let means: Vec<f32> =
            (0..groups.len() * functions).map(|i| mean(&groups[i / functions], i % functions)).collect();
        let numbers = means.iter().enumerate().map(|(i, mean)| (mean + floors[i % functions]).ln()).collect();
        let pair = |group: &Vec<u32>| {
            let BrdfSample { wi, wo, .. } = samples[group[0] as usize];
            [wi.z.max(GRAZING), cosines(wi, wo)]
        };
        Self { means, numbers, floors, cosines: groups.iter().map(pair).collect(), glossy }
    }

    fn functions(&self) -> usize {
        self.floors.len()
    }

    fn at(&self, point: u32, function: usize) -> f32 {
        self.numbers[point as usize * self.functions() + function]
    }

    /// Some of the points.
    fn some(&self, points: &[usize]) -> Self {
        let of_points = |all: &[f32]| -> Vec<f32> {
            points.iter().flat_map(|i| all[i * self.functions()..][..self.functions()].to_vec()).collect()
        };
        Self {
            means: of_points(&self.means),
            numbers: of_points(&self.numbers),
            floors: self.floors.clone(),
            cosines: points.iter().map(|i| self.cosines[*i]).collect(),
            ..*self
        }
    }

    /// The value of a function at a point, with the cosine of the light.
    fn lit(&self, level: f32, function: usize, [light, both]: [f32; 2]) -> f32 {
        (level.exp() - self.floors[function]).max(0.0) * light / if self.glossy { both } else { 1.0 }
    }

    /// The squared error of the cube roots of f cos at points that are left out by fifths.
    fn held_out_error(&self, places: &[Place], symmetry: Symmetry) -> f64 {
        let step = places.len().div_ceil(MOST_HELD_OUT);
        let points: Vec<usize> = (0..places.len()).step_by(step).collect();
        (0..FOLDS).map(|fold| self.fold_error(places, &points, fold, symmetry)).sum()
    }

    fn fold_error(&self, places: &[Place], points: &[usize], fold: usize, symmetry: Symmetry) -> f64 {
        // parts without a pattern
        let part = |i: usize| ((i as f64 * 0.618_033_988_749_895).fract() * FOLDS as f64) as usize;
        let (out, kept): (Vec<usize>, Vec<usize>) = points.iter().partition(|i| part(**i) == fold);
        if kept.is_empty() {
            return 0.0;
        }
        let others: Vec<Place> = kept.iter().map(|i| places[*i]).collect();
        let (tree, surface) = (Tree::new(&others, symmetry.axes()), Surface::new(self.some(&kept), &others, symmetry));
        let error = |i: usize| {
            let nearest = tree.search(&places[i]);
            let [light, both] = self.cosines[i];
            let of_function = |k: usize| {
                let [found] = surface.at::<1>(&places[i], k, &others, &nearest, both);
                let truth = self.lit(self.at(i as u32, k), k, self.cosines[i]);
                f64::from((found * light).cbrt() - truth.cbrt()).powi(2)
            };
            (0..self.functions()).map(of_function).sum::<f64>()
        };
        out.into_iter().map(error).sum()
    }
}

/// Several functions of the place.
#[derive(Debug, Clone)]
struct Surface {
    levels: Levels,
    spline: Option<Spline>,
}

impl Surface {
    fn new(levels: Levels, places: &[Place], symmetry: Symmetry) -> Self {
        let few = places.len() <= Spline::MOST;
        let spline = few.then(|| Spline::new(places, symmetry.axes(), &levels.numbers)).flatten();
        Self { levels, spline }
    }

    /// The values of the functions from `first` at a place, where the cosines have this product.
    fn at<const N: usize>(
        &self,
        place: &Place,
        first: usize,
        places: &[Place],
        nearest: &Nearest,
        cosines: f32,
    ) -> [f32; N] {
        let level = |i: u32, k: usize| self.levels.at(i, first + k);
        let divisor = if self.levels.glossy { cosines } else { 1.0 };
        let count = nearest.count.min(NEIGHBOURS);
        let list = &nearest.list[..count];
        let (square, closest) = list[0];
        // the square root moves pairs near the mirror direction by up to 0.0005 when their directions are rounded
        if square < SAME * SAME {
            let means = &self.levels.means[closest as usize * self.levels.functions() + first..];
            return std::array::from_fn(|k| means[k] / divisor);
        }
        let smooth: [f32; N] = match &self.spline {
            Some(spline) => spline.at(place, first),
            None => {
                let stencil = plane(place, places, nearest);
                std::array::from_fn(|k| list.iter().zip(stencil).map(|((_, i), w)| w * level(*i, k)).sum())
            }
        };
        // Limit the values to a range without edges: no point leaves it suddenly
        let (weights, left) = (weights(nearest), left(nearest));
        std::array::from_fn(|k| {
            let mean: f32 = list.iter().zip(weights).map(|((_, i), weight)| weight * level(*i, k)).sum();
            let range = list.iter().zip(left).map(|((_, i), left)| (REACH * left).min(1.0) * (level(*i, k) - mean));
            let (low, high) = range.fold((0.0f32, 0.0f32), |(a, b), v| (a.min(v), b.max(v)));
            (smooth[k].clamp(mean + low, mean + high).exp() - self.levels.floors[first + k]).max(0.0) / divisor
        })
    }
}

/// The part of the way to the thirteenth point that is left behind each of the nearest points; 1 if there are no more.
fn left(nearest: &Nearest) -> [f32; NEIGHBOURS] {
    let mut left = [1.0; NEIGHBOURS];
    if nearest.count > NEIGHBOURS {
        let end = nearest.list[NEIGHBOURS].0.sqrt().max(1e-6);
        left.iter_mut()
            .zip(&nearest.list)
            .for_each(|(left, (square, _))| *left = (1.0 - square.sqrt() / end).max(1e-9));
    }
    left
}

/// Weights of the nearest points, of sum 1, which vanish before another point takes the place of the twelfth (modified Shepard).
fn weights(nearest: &Nearest) -> [f32; NEIGHBOURS] {
    let (mut weights, left) = ([0.0; NEIGHBOURS], left(nearest));
    let count = nearest.count.min(NEIGHBOURS);
    for (k, weight) in weights[..count].iter_mut().enumerate() {
        *weight = (left[k] / nearest.list[k].0.sqrt().max(1e-6)).powi(2);
    }
    let sum: f32 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// The product of both cosines.
fn cosines(wi: Vec3, wo: Vec3) -> f32 {
    wi.z.max(GRAZING) * wo.z.max(GRAZING)
}

/// Weights of the nearest points, of sum 1, that give the value of a plane fitted to them.
fn plane(at: &Place, places: &[Place], nearest: &Nearest) -> [f32; NEIGHBOURS] {
    let count = nearest.count.min(NEIGHBOURS);
    let radius = nearest.list[nearest.count - 1].0.sqrt();
    let mut weights = weights(nearest);
    // Convert the weights of a mean to those of a plane
    let away = |i: usize| {
        let place = &places[nearest.list[i].1 as usize];
        Vec3::new(place[0] - at[0], place[1] - at[1], place[2] - at[2])
    };
    let mean: Vec3 = (0..count).map(|i| away(i) * weights[i]).sum();
    let mut spread = Mat3::from_diagonal(Vec3::splat(RIDGE * radius * radius + 1e-12));
    for (i, weight) in weights.iter().enumerate().take(count) {
        let d = away(i) - mean;
        spread += Mat3::from_cols(d * d.x, d * d.y, d * d.z) * *weight;
    }
    let slope = spread.inverse() * mean;
    for (i, weight) in weights.iter_mut().enumerate().take(count) {
        *weight *= 1.0 - (away(i) - mean).dot(slope);
    }
    weights
}

impl Table for Scattered {
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3 {
        let place = self.symmetry.place(wi, wo);
        let nearest = self.tree.search(&place);
        Vec3::from(self.rgb.at::<3>(&place, 0, &self.places, &nearest, cosines(wi, wo)))
    }

    fn samples(&self) -> Vec<BrdfSample> {
        self.samples.clone()
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: self.is_symmetric(), energy_conserving: false, isotropic: self.is_symmetric() }
    }

    fn wavelengths(&self) -> &[f32] {
        &self.wavelengths
    }

    fn spectrum(&self, wi: Vec3, wo: Vec3) -> Vec<f32> {
        let Some(spectra) = &self.spectra else { return Vec::new() };
        let place = self.symmetry.place(wi, wo);
        let nearest = self.tree.search(&place);
        let band = |k| spectra.at::<1>(&place, k, &self.places, &nearest, cosines(wi, wo))[0];
        (0..spectra.levels.functions()).map(band).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

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
        assert!(table.is_symmetric());
    }

    #[test]
    fn symmetries_are_imposed_only_on_samples_that_have_them() {
        // light and view from several azimuths, and each pair the other way round
        let pairs = (0..40).flat_map(|i| {
            let (wi, wo) = (from_angles(0.2 + 0.02 * i as f32, 0.0), from_angles(1.2 - 0.02 * i as f32, 2.0));
            let turned = |w: Vec3, by: f32| glam::Quat::from_rotation_z(by) * w;
            [(wi, wo), (wo, wi), (turned(wi, 1.0), turned(wo, 1.0))]
        });
        let samples = |value: &dyn Fn(Vec3, Vec3) -> f32| -> Vec<BrdfSample> {
            pairs.clone().map(|(wi, wo)| BrdfSample { wi, wo, value: Vec3::splat(value(wi, wo)) }).collect()
        };
        let isotropic = Scattered::new(samples(&|wi, wo| glossy(wi, wo).x)).unwrap();
        assert!(isotropic.is_symmetric() && isotropic.asymmetry().samples == 120, "{:?}", isotropic.asymmetry());
        let brushed = samples(&|wi, wo| 0.2 + (wi + wo).normalize().x.powi(2));
        let table = Scattered::new(brushed.clone()).unwrap();
        assert!(!table.is_symmetric() && !table.promises().isotropic, "{:?}", table.asymmetry());
        for s in &brushed {
            let found = table.value(s.wi, s.wo).x;
            assert!((found / s.value.x - 1.0).abs() < 1e-3, "{found} {}", s.value.x);
        }
    }

    #[test]
    fn values_have_no_edges_where_samples_are_few_and_differ() {
        let at = |i: usize, step: f32| (i as f32 * step).fract();
        let sample = |i: usize| {
            let direction = |k: usize| {
                from_angles(1.3 * at(i, [0.618_034, 0.754_878][k]).sqrt(), 6.3 * at(i, [0.569_84, 0.438_579][k]))
            };
            // two materials as of a brushed surface, without order
            BrdfSample {
                wi: direction(0),
                wo: direction(1),
                value: Vec3::splat(if i.is_multiple_of(3) { 0.1 } else { 1.0 }),
            }
        };
        let mut samples: Vec<BrdfSample> = (1..150).map(sample).collect();
        let turned = |s: &BrdfSample| BrdfSample { wi: s.wo, wo: s.wi, value: 1.1 - s.value };
        samples.extend(samples.clone().iter().map(turned));
        let table = Scattered::new(samples).unwrap();
        assert!(!table.is_symmetric());
        let steps = 20_000;
        let value = |i: usize| {
            let t = i as f32 / steps as f32;
            table.value(from_angles(0.2 + t, 0.5 + 3.0 * t), from_angles(1.2 - t, 4.0 * t)).x
        };
        let values: Vec<f32> = (0..steps).map(value).collect();
        let most = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f32::max);
        let range = values.iter().fold(0.0f32, |a, v| a.max(*v)) - values.iter().fold(f32::INFINITY, |a, v| a.min(*v));
        assert!(range > 0.3 && most < 0.005 * range, "{most} of {range}");
    }

    #[test]
    fn a_few_samples_are_enough_and_the_horizon_is_finite() {
        let one = BrdfSample { wi: from_angles(0.5, 0.0), wo: from_angles(0.7, 3.0), value: Vec3::new(0.5, 0.2, 0.0) };
        for count in [1, 2, 3] {
            let table = Scattered::new(vec![one; count]).unwrap();
            assert!((table.value(one.wi, one.wo) - one.value).abs().max_element() < 1e-4);
            let grazing = table.value(from_angles(1.570, 0.0), from_angles(1.569, 1.0));
            assert!(grazing.is_finite() && grazing.min_element() >= 0.0, "{grazing}");
        }
    }
}
