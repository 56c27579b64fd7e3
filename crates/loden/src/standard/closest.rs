//! The search for the parameters of every texel.

use glam::Vec3;
use rayon::prelude::*;

use super::evaluate::{Direction, Shapes, Shared};
use super::pairs::chosen;
use super::smooth::smooth;
use super::{BASE, COAT, COUNT, GRAIN, LOG_ALPHA, METALLIC, SHEEN, Standard, USUAL_F0, WEIGHT};
use crate::Result;
use crate::btf::BtfMeta;
use crate::fit::minimise;
use crate::material::angles::texel_centre;
use crate::material::{Material, Point};
use crate::progress::{Progress, Task};

/// Range of each parameter; roughness is bounded by [`least_alpha`] too.
const LOW: [f64; COUNT] = [0.0, 0.0, 0.0, 0.0, 0.0, -6.0, -2.0, -2.0, -0.7, -0.7, 0.0, 0.0, 0.0, 0.0];
const HIGH: [f64; COUNT] = [1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 2.0, 2.0, 0.7, 0.7, 1.0, 1.0, 1.0, 1.0];

/// Iterations for a texel, and for the mean of all.
const ITERATIONS: usize = 8;
const MEAN_ITERATIONS: usize = 60;

/// Difference of a parameter for derivatives.
const STEP: f64 = 1e-4;

/// Weight of the mean of all texels as a prior, relative to the squared weighted values of a texel, for a deviation by 1.
const PRIOR: f64 = 3e-4;

/// Values below this part of the mean are weighted like it.
const DARK: f64 = 0.1;

/// Texels along each side by which layers are chosen.
const TRIALS: usize = 8;

/// How much a layer must lower the squared error to be used.
const GAIN: f64 = 0.04;

/// Starting points: roughness, and share of metal.
const STARTS: [(f64, f64); 6] = [(0.08, 0.0), (0.2, 0.0), (0.5, 0.0), (0.08, 1.0), (0.2, 1.0), (0.5, 1.0)];

/// Finds the standard material that is closest to `material`, whose texels and directions `meta` describes.
///
/// # Model
/// Values at 320 pairs of directions, divided by the root of their mean over texels, are fitted by Levenberg-Marquardt within
/// the ranges of the parameters. Each texel starts from the fit of the mean of all texels, from its left neighbour, or from one
/// of six points, whichever is closest; the fit of the mean is a weak prior too. Refractive index, grain, sheen and clear coat
/// are chosen by what they gain at 64 texels. What texels leave open is then taken from their neighbours. The result does not
/// depend on the number of threads. Memory: 600 bytes a texel at most, beside the material.
///
/// # Limits
/// A local search. 8-bit textures: the parameters are rounded as these.
///
/// # References
/// marquardt1963
///
/// # Errors
/// Errors of the material; [`crate::Error::Cancelled`].
pub fn closest(material: &dyn Material, meta: &BtfMeta, progress: &dyn Progress) -> Result<Standard> {
    let samples = Samples::new(material, meta);
    let few = samples.trials();
    let weights = samples.weights(&few);
    let (shared, start) = layers(&samples, &few, &weights, progress)?;
    let search = Search::new(&samples, &weights, shared);
    let task = Task::new(progress, "fit", meta.height as u64);
    let row = |y: usize| {
        let mut left = start;
        let fit_one = |x: usize| {
            task.check()?;
            let values = samples.texel(y * meta.width + x);
            left = search.fit(&values, &[start, left], Some(&start), ITERATIONS);
            Ok((left, search.curvature(&left)))
        };
        let found = (0..meta.width).map(fit_one).collect::<Result<Vec<_>>>()?;
        task.advance(1)?;
        Ok(found)
    };
    let rows = (0..meta.height).into_par_iter().map(row).collect::<Result<Vec<_>>>()?;
    material.check()?;
    let (mut numbers, curvatures): (Vec<_>, Vec<_>) = rows.into_iter().flatten().unzip();
    smooth(&mut numbers, &curvatures, meta.width);
    Ok(Standard::new(meta.width, meta.height, shared, &numbers))
}

/// The least roughness that sampled directions can tell: half vectors are half as far from each other as directions, and a narrower
/// highlight would hide between them. One texel is sampled between them too.
fn least_alpha(meta: &BtfMeta) -> f64 {
    if meta.texels() == 1 {
        return LOW[LOG_ALPHA].exp();
    }
    let directions = meta.lights.directions();
    let nearest = |a: &Vec3| {
        let angles = directions.iter().map(|b| a.dot(*b)).filter(|cosine| *cosine < 1.0 - 1e-5);
        f64::from(angles.fold(0.0, f32::max)).acos()
    };
    let mut nearest: Vec<f64> = directions.iter().map(nearest).collect();
    let middle = nearest.len() / 2;
    let spacing = *nearest.select_nth_unstable_by(middle, f64::total_cmp).1;
    (0.5 * spacing).tan().clamp(LOW[LOG_ALPHA].exp(), 0.5)
}

/// The values of texels at the chosen pairs.
struct Samples<'a> {
    material: &'a dyn Material,
    size: [usize; 2],
    /// (wi, wo)
    pairs: Vec<(Vec3, Vec3)>,
    wi: Vec<Vec3>,
    least_alpha: f64,
}

impl<'a> Samples<'a> {
    fn new(material: &'a dyn Material, meta: &BtfMeta) -> Self {
        let pairs = chosen(meta);
        let wi = pairs.iter().map(|pair| pair.0).collect();
        Self { material, size: [meta.width, meta.height], pairs, wi, least_alpha: least_alpha(meta) }
    }

    /// The values of a texel: (pair, channel). Negative ones, which compression leaves, count as 0.
    fn texel(&self, texel: usize) -> Vec<f64> {
        let uv = texel_centre(texel, self.size[0], self.size[1]);
        let points: Vec<Point> = self.pairs.iter().map(|&(_, wo)| Point { uv, wo }).collect();
        let mut values = vec![Vec3::ZERO; points.len()];
        self.material.apparent_many(&points, &self.wi, &mut values);
        values.iter().flat_map(|value| value.max(Vec3::ZERO).to_array().map(f64::from)).collect()
    }

    /// The values of a few texels, spread evenly.
    fn trials(&self) -> Vec<Vec<f64>> {
        let along = |count: usize| {
            let some = count.min(TRIALS);
            (0..some).map(move |k| (2 * k + 1) * count / (2 * some))
        };
        let [width, height] = self.size;
        let texels: Vec<usize> = along(height).flat_map(|y| along(width).map(move |x| y * width + x)).collect();
        texels.into_par_iter().map(|texel| self.texel(texel)).collect()
    }

    /// The weight of each pair.
    fn weights(&self, few: &[Vec<f64>]) -> Vec<f64> {
        let mean = mean(few);
        let level = mean.iter().sum::<f64>() / mean.len().max(1) as f64;
        let floor = (DARK * level).max(1e-6);
        let of_pair = |rgb: &[f64]| 1.0 / (rgb.iter().sum::<f64>() / 3.0 + floor).sqrt();
        mean.chunks_exact(3).map(of_pair).collect()
    }
}

fn mean(few: &[Vec<f64>]) -> Vec<f64> {
    let mut mean = vec![0.0; few.first().map_or(0, Vec::len)];
    for values in few {
        mean.iter_mut().zip(values).for_each(|(sum, value)| *sum += value / few.len() as f64);
    }
    mean
}

/// What all texels have in common, and the fit of the mean: refractive index and layers are added one by one while they help.
fn layers(
    samples: &Samples,
    few: &[Vec<f64>],
    weights: &[f64],
    progress: &dyn Progress,
) -> Result<(Shared, [f64; COUNT])> {
    let mean = mean(few);
    let plain = Shared { f0: USUAL_F0, grain: false, sheen: None, coat: None };
    let attempt = |shared: Shared| {
        let search = Search::new(samples, weights, shared);
        let start = search.fit(&mean, &[], None, MEAN_ITERATIONS);
        let one = |values: &Vec<f64>| {
            let found = search.fit(values, &[start], Some(&start), ITERATIONS);
            search.cost(values, &found)
        };
        let costs: Vec<f64> = few.par_iter().map(one).collect();
        (costs.iter().sum::<f64>(), shared, start)
    };
    type Change = fn(&mut Shared);
    let changes: [&[Change]; 4] = [
        &[|shared| shared.f0 = 0.08, |shared| shared.f0 = 0.16],
        &[|shared| shared.grain = true],
        &[|shared| shared.sheen = Some(1), |shared| shared.sheen = Some(2)],
        &[|shared| shared.coat = Some(0.03), |shared| shared.coat = Some(0.12)],
    ];
    let task = Task::new(progress, "choose layers", changes.len() as u64);
    let mut best = attempt(plain);
    for alternatives in changes {
        let before = best.0;
        for change in alternatives {
            let mut shared = best.1;
            change(&mut shared);
            let tried = attempt(shared);
            if tried.0 < (1.0 - GAIN) * before && tried.0 < best.0 {
                best = tried;
            }
        }
        task.advance(1)?;
    }
    Ok((best.1, best.2))
}

/// The least-squares problem of a texel.
struct Search<'a> {
    pairs: Vec<Direction>,
    weights: &'a [f64],
    shared: Shared,
    /// The parameters that are searched.
    free: Vec<usize>,
    /// Their range.
    low: [f64; COUNT],
}

impl<'a> Search<'a> {
    fn new(samples: &Samples, weights: &'a [f64], shared: Shared) -> Self {
        let pairs =
            samples.pairs.iter().map(|(wi, wo)| Direction::new(wi.as_dvec3(), wo.as_dvec3(), &shared)).collect();
        let is_free = |i: &usize| match *i {
            i if i < GRAIN => true,
            i if i < SHEEN => shared.grain,
            i if i < COAT => shared.sheen.is_some(),
            _ => shared.coat.is_some(),
        };
        let mut low = LOW;
        low[LOG_ALPHA] = samples.least_alpha.ln();
        Self { pairs, weights, shared, free: (0..COUNT).filter(is_free).collect(), low }
    }

    /// The parameters closest to these values, from the best of `starts` and of [`STARTS`].
    fn fit(
        &self,
        values: &[f64],
        starts: &[[f64; COUNT]],
        prior: Option<&[f64; COUNT]>,
        iterations: usize,
    ) -> [f64; COUNT] {
        let known = starts.iter().map(|start| self.scaled(*start, values));
        let least = self.low[LOG_ALPHA].exp();
        let any = STARTS.iter().map(|&(alpha, metallic)| start(alpha.max(least), metallic));
        let all = known.chain(any.map(|start| self.scaled(start, values)));
        let cost = |numbers: [f64; COUNT]| (self.cost(values, &numbers), numbers);
        let mut all: Vec<(f64, [f64; COUNT])> = all.map(cost).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        // without a known fit, the best start need not lead to the deepest minimum
        let tried = if starts.is_empty() { all.len() } else { 1 };
        let improve = |(_, start): &(f64, [f64; COUNT])| cost(self.improve(values, start, prior, iterations));
        let best = all[..tried].iter().map(improve).min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or(all[0].1, |best| best.1)
    }

    /// A starting point with the base that suits these values best, which are linear in it.
    fn scaled(&self, mut numbers: [f64; COUNT], values: &[f64]) -> [f64; COUNT] {
        numbers[BASE..BASE + 3].fill(0.0);
        let shapes = self.shared.shapes(&self.pairs, &numbers);
        let without = self.shared.values(&shapes, &self.pairs, &numbers);
        numbers[BASE..BASE + 3].fill(1.0);
        let with = self.shared.values(&shapes, &self.pairs, &numbers);
        let mut sums = [[0.0; 2]; 3];
        for (k, ((value, without), with)) in values.iter().zip(&without).zip(&with).enumerate() {
            let (basis, weight) = (with - without, self.weights[k / 3].powi(2));
            sums[k % 3][0] += weight * basis * (value - without);
            sums[k % 3][1] += weight * basis * basis;
        }
        for (c, [product, square]) in sums.into_iter().enumerate() {
            numbers[BASE + c] = (product / square.max(1e-9)).clamp(0.0, 1.0);
        }
        numbers
    }

    /// The weighted squared error.
    fn cost(&self, values: &[f64], numbers: &[f64; COUNT]) -> f64 {
        let found = self.shared.values(&self.shared.shapes(&self.pairs, numbers), &self.pairs, numbers);
        let square = |(k, (found, value)): (usize, (&f64, &f64))| (self.weights[k / 3] * (found - value)).powi(2);
        found.iter().zip(values).enumerate().map(square).sum()
    }

    fn improve(
        &self,
        values: &[f64],
        start: &[f64; COUNT],
        prior: Option<&[f64; COUNT]>,
        iterations: usize,
    ) -> [f64; COUNT] {
        let scale: f64 = values.iter().enumerate().map(|(k, value)| (self.weights[k / 3] * value).powi(2)).sum();
        let pull = (PRIOR * scale).sqrt();
        let whole = |x: &[f64]| {
            let mut numbers = *start;
            self.free.iter().zip(x).for_each(|(&i, value)| numbers[i] = *value);
            numbers
        };
        let part = |numbers: &[f64; COUNT]| -> Vec<f64> { self.free.iter().map(|&i| numbers[i]).collect() };
        let residuals = |x: &[f64]| {
            let numbers = whole(x);
            let found = self.shared.values(&self.shared.shapes(&self.pairs, &numbers), &self.pairs, &numbers);
            let mut residuals: Vec<f64> =
                found.iter().zip(values).enumerate().map(|(k, (a, b))| self.weights[k / 3] * (a - b)).collect();
            let pulled = prior.iter().flat_map(|prior| self.free.iter().map(|&i| pull * (numbers[i] - prior[i])));
            residuals.extend(pulled);
            residuals
        };
        let derivatives = |x: &[f64], _: &[f64]| {
            let mut columns = self.derivatives(&whole(x));
            if prior.is_some() {
                let own = |(k, column): (usize, &mut Vec<f64>)| {
                    column.extend((0..x.len()).map(|other| if other == k { pull } else { 0.0 }));
                };
                columns.iter_mut().enumerate().for_each(own);
            }
            columns
        };
        let (low, high) = (part(&self.low), part(&HIGH));
        whole(&minimise(part(start), (&low, &high), iterations, residuals, derivatives))
    }

    /// Weighted derivatives of the values with respect to each free parameter.
    fn derivatives(&self, numbers: &[f64; COUNT]) -> Vec<Vec<f64>> {
        let shapes = self.shared.shapes(&self.pairs, numbers);
        let here = self.shared.values(&shapes, &self.pairs, numbers);
        let column = |&i: &usize| {
            let mut other = *numbers;
            let step = if numbers[i] + STEP > HIGH[i] { -STEP } else { STEP };
            other[i] += step;
            let changed: Shapes;
            let shapes = if (LOG_ALPHA..SHEEN).contains(&i) {
                changed = self.shared.shapes(&self.pairs, &other);
                &changed
            } else {
                &shapes
            };
            let there = self.shared.values(shapes, &self.pairs, &other);
            there.iter().zip(&here).enumerate().map(|(k, (a, b))| self.weights[k / 3] * (a - b) / step).collect()
        };
        self.free.iter().map(column).collect()
    }

    /// The curvature of the error along each parameter; 0 for those that are not searched.
    fn curvature(&self, numbers: &[f64; COUNT]) -> [f64; COUNT] {
        let mut curvature = [0.0; COUNT];
        for (&i, column) in self.free.iter().zip(self.derivatives(numbers)) {
            curvature[i] = column.iter().map(|x| x * x).sum::<f64>();
        }
        curvature
    }
}

/// A starting point.
fn start(alpha: f64, metallic: f64) -> [f64; COUNT] {
    let mut numbers = [0.0; COUNT];
    (numbers[METALLIC], numbers[WEIGHT], numbers[LOG_ALPHA]) = (metallic, 0.5, alpha.ln());
    numbers
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::btf::{Cosine, SampleType};
    use crate::color::Encoding;
    use crate::direction::DirectionSet;
    use crate::progress::Silent;
    use crate::random::Stream;
    use crate::standard::SLOPE;

    const SIDE: usize = 5;

    fn meta() -> BtfMeta {
        BtfMeta {
            width: SIDE,
            height: SIDE,
            views: DirectionSet::bonn81(),
            lights: DirectionSet::bonn81(),
            encoding: Encoding::Linear,
            cosine: Cosine::Included,
            sample_type: SampleType::F32,
        }
    }

    /// Texels with random parameters and these layers.
    fn random(shared: Shared) -> Standard {
        let mut random = Stream::new(5);
        let texel = |_| {
            let mut numbers = [0.0; COUNT];
            let mut put = |i: usize, low: f32, high: f32| numbers[i] = f64::from(random.range(low, high));
            (BASE..BASE + 3).for_each(|i| put(i, 0.1, 0.7));
            put(METALLIC, 0.0, 0.4);
            put(WEIGHT, 0.4, 1.0);
            put(LOG_ALPHA, -1.6, -1.0);
            (SLOPE..SLOPE + 2).for_each(|i| put(i, -0.3, 0.3));
            if shared.grain {
                (GRAIN..GRAIN + 2).for_each(|i| put(i, -0.5, 0.5));
            }
            if shared.sheen.is_some() {
                (SHEEN..SHEEN + 3).for_each(|i| put(i, 0.2, 0.8));
            }
            if shared.coat.is_some() {
                put(COAT, 0.5, 1.0);
            }
            numbers
        };
        let numbers: Vec<_> = (0..SIDE * SIDE).map(texel).collect();
        Standard::new(SIDE, SIDE, shared, &numbers)
    }

    /// The mean difference of values, relative to their mean.
    fn difference(a: &dyn Material, b: &dyn Material) -> f64 {
        let (mut random, mut sum, mut whole) = (Stream::new(9), 0.0, 0.0);
        for _ in 0..2000 {
            let [wi, wo] = [(); 2].map(|()| crate::direction::cosine_hemisphere(random.next2()));
            let uv: Vec2 = random.next2();
            let [a, b] = [a, b].map(|material| material.apparent(uv, wi, wo));
            sum += f64::from((a - b).abs().element_sum());
            whole += f64::from(a.element_sum());
        }
        sum / whole
    }

    #[test]
    fn a_standard_material_is_found_again_with_its_layers() {
        let plain = Shared { f0: USUAL_F0, grain: false, sheen: None, coat: None };
        let cases = [
            plain,
            Shared { f0: 0.16, ..plain },
            Shared { grain: true, ..plain },
            Shared { sheen: Some(1), ..plain },
            Shared { coat: Some(0.03), ..plain },
        ];
        for shared in cases {
            let original = random(shared);
            let found = closest(&original, &meta(), &Silent).unwrap();
            let error = difference(&original, &found);
            assert!(error < 0.02, "{shared:?}, found {:?}: {error}", found.shared);
            assert!(!shared.grain || found.shared.grain, "{:?}", found.shared);
        }
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let original = random(Shared { f0: USUAL_F0, grain: true, sheen: None, coat: None });
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| closest(&original, &meta(), &Silent).unwrap())
        };
        assert_eq!(with(1).rows(), with(2).rows());
    }

    /// Nothing reflected, and everything.
    #[test]
    fn constant_materials_stay_what_they_are() {
        struct Constant(f32);
        impl Material for Constant {
            fn apparent(&self, _uv: Vec2, wi: Vec3, _wo: Vec3) -> Vec3 {
                Vec3::splat(self.0 * wi.z)
            }
        }
        for albedo in [0.0, 0.5, 1.0] {
            let found = closest(&Constant(albedo), &meta(), &Silent).unwrap();
            let value = found.apparent(Vec2::splat(0.5), Vec3::new(0.0, 0.6, 0.8), Vec3::Z);
            assert!((value - 0.8 * albedo).abs().max_element() < 0.02, "{albedo}: {value}");
        }
    }
}
