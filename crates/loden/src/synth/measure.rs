//! How good a synthesis is, without knowing what it should be.
//!
//! No number says that a texture looks right; each of these says where it looks wrong. Compare methods by all of them, and
//! with what random blocks and plain tiling reach.
//!
//! # Model
//! - Seam energy: over boundaries between copied regions, the mean squared difference between neighbours and the texels
//!   that they had beside them in the exemplar, relative to that between neighbours in the exemplar.
//! - Verbatim copies: the side of a square with the area of the region that a texel was copied with, the mean over all
//!   texels. Large regions repeat what was seen; tiling copies the whole exemplar.
//! - Evenness: the entropy of how often parts of the exemplar are used, as a share of the largest possible.
//! - Patch distance: at each scale, the sliced Wasserstein distance between the patches of result and exemplar: sorted
//!   projections onto random directions are compared, as root mean squares relative to the contrast of the exemplar.
//! - Spectrum error: the difference between the logarithms of the power of result and exemplar, averaged over rings and
//!   sectors of frequencies.
//!
//! # Limits
//! Numbers depend on the channels that an exemplar has, and are comparable only between results of the same exemplar. A
//! result that repeats the exemplar has the patches of the exemplar, so patch distances alone do not show repetition.
//!
//! # References
//! rabin2011

use super::fft::{self, Complex};
use super::{Exemplar, Source, SourceMap};
use crate::random::{Stream, hash};

/// Scales at which patches are compared, each half as fine as the one before.
pub const SCALES: usize = 3;

/// What the measures say of one result. Smaller is better, except for evenness.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Measures {
    /// Mean squared difference at boundaries between copied regions, relative to that between neighbours in the exemplar.
    pub seam_energy: f64,
    /// Mean side of the regions that texels were copied with, in texels.
    pub copy_length: f64,
    /// Entropy of the use of the exemplar, as a share of the largest possible.
    pub evenness: f64,
    /// Distance of patches at each scale, the finest first, relative to the contrast of the exemplar.
    pub patch_distance: [f64; SCALES],
    /// Error of the power spectrum, in nepers.
    pub spectrum_error: f64,
}

impl Measures {
    /// Measures a result.
    pub fn new(exemplar: &Exemplar, map: &SourceMap) -> Self {
        let (original, result) = (Planes::of(exemplar), Planes::copied(exemplar, map));
        Self {
            seam_energy: seam_energy(exemplar, map),
            copy_length: copy_length(exemplar, map),
            evenness: evenness(exemplar, map),
            patch_distance: patch_distance(&original, &result),
            spectrum_error: spectrum_error(&original, &result),
        }
    }
}

/// A result of one half of an exemplar, compared with the other half.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct HeldOut {
    /// Distance of patches between the result and the half that it was not made from, at each scale.
    pub result: [f64; SCALES],
    /// The same between the two halves: what cannot be expected to be smaller.
    pub floor: [f64; SCALES],
}

impl HeldOut {
    /// Compares `map`, a synthesis from the left half of the exemplar, with the right half.
    pub fn new(exemplar: &Exemplar, map: &SourceMap) -> Self {
        let [left, right] = halves(exemplar);
        let [made, known, other] = [Planes::copied(&left, map), Planes::of(&left), Planes::of(&right)];
        Self { result: patch_distance(&other, &made), floor: patch_distance(&other, &known) }
    }
}

/// The left and the right half of an exemplar, which are not periodic.
pub fn halves(exemplar: &Exemplar) -> [Exemplar; 2] {
    let middle = exemplar.width.div_ceil(2);
    [0..middle, exemplar.width / 2..exemplar.width].map(|columns| {
        let rows = || (0..exemplar.height).map(|y| y * exemplar.width);
        let values = |row: usize| {
            let from = (row + columns.start) * exemplar.channels;
            &exemplar.values[from..from + columns.len() * exemplar.channels]
        };
        let mask = exemplar
            .mask
            .as_ref()
            .map(|mask| rows().flat_map(|row| mask[row + columns.start..row + columns.end].iter().copied()).collect());
        Exemplar {
            width: columns.len(),
            values: rows().flat_map(values).copied().collect(),
            periodic: false,
            mask,
            ..exemplar.clone()
        }
    })
}

/// The source beside another one; none outside the exemplar.
fn beside(exemplar: &Exemplar, source: Source, (dx, dy): (usize, usize)) -> Option<Source> {
    let (mut x, mut y) = (usize::from(source.x) + dx, usize::from(source.y) + dy);
    if exemplar.periodic {
        (x, y) = (x % exemplar.width, y % exemplar.height);
    }
    (x < exemplar.width && y < exemplar.height).then(|| Source::new(x, y))
}

/// The texel before another one in the exemplar.
fn before(exemplar: &Exemplar, source: Source, (dx, dy): (usize, usize)) -> Option<Source> {
    let back = |v: u16, d: usize, n: usize| match usize::from(v).checked_sub(d) {
        Some(v) => Some(v),
        None => exemplar.periodic.then(|| n - d),
    };
    Some(Source::new(back(source.x, dx, exemplar.width)?, back(source.y, dy, exemplar.height)?))
}

/// Pairs of neighbours in a picture of this size, and the direction from the first to the second.
fn pairs(width: usize, height: usize) -> impl Iterator<Item = ((usize, usize), (usize, usize))> {
    let texels = (0..width * height).map(move |i| (i % width, i / width));
    texels
        .flat_map(|texel| [(texel, (1, 0)), (texel, (0, 1))])
        .filter(move |((x, y), (dx, dy))| x + dx < width && y + dy < height)
}

fn seam_energy(exemplar: &Exemplar, map: &SourceMap) -> f64 {
    let (mut natural, mut count) = (0.0, 0.0);
    for ((x, y), (dx, dy)) in pairs(exemplar.width, exemplar.height) {
        if exemplar.is_usable(x, y) && exemplar.is_usable(x + dx, y + dy) {
            natural += f64::from(exemplar.distance(Source::new(x, y), Source::new(x + dx, y + dy)));
            count += 1.0;
        }
    }
    let natural = natural / f64::max(count, 1.0);
    let (mut seams, mut count) = (0.0, 0.0);
    for ((x, y), side) in pairs(map.width, map.height) {
        let (a, b) = (map.at(x, y), map.at(x + side.0, y + side.1));
        let (after, ahead) = (beside(exemplar, a, side), before(exemplar, b, side));
        if after == Some(b) {
            continue;
        }
        count += 1.0;
        // a region that ends at the edge of the exemplar has no texel to compare with on that side
        let terms = [after.map(|after| exemplar.distance(after, b)), ahead.map(|ahead| exemplar.distance(a, ahead))];
        let known: Vec<f32> = terms.into_iter().flatten().collect();
        let unknown = known.is_empty().then(|| exemplar.distance(a, b));
        let sum: f32 = known.iter().copied().chain(unknown).sum();
        seams += f64::from(sum) / known.len().max(1) as f64;
    }
    if natural > 0.0 && count > 0.0 { seams / count / natural } else { 0.0 }
}

fn copy_length(exemplar: &Exemplar, map: &SourceMap) -> f64 {
    let mut regions = Regions((0..map.sources.len()).collect());
    for ((x, y), side) in pairs(map.width, map.height) {
        let (a, b) = (y * map.width + x, (y + side.1) * map.width + x + side.0);
        if beside(exemplar, map.sources[a], side) == Some(map.sources[b]) {
            regions.unite(a, b);
        }
    }
    let mut areas = vec![0u32; map.sources.len()];
    let roots: Vec<usize> = (0..areas.len()).map(|i| regions.root(i)).collect();
    roots.iter().for_each(|root| areas[*root] += 1);
    roots.iter().map(|root| f64::from(areas[*root]).sqrt()).sum::<f64>() / areas.len() as f64
}

/// Texels united to regions; each points towards the first texel of its region.
struct Regions(Vec<usize>);

impl Regions {
    fn root(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    fn unite(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
    }
}

fn evenness(exemplar: &Exemplar, map: &SourceMap) -> f64 {
    const PARTS: usize = 16;
    let (columns, rows) = (exemplar.width.min(PARTS), exemplar.height.min(PARTS));
    let part = |x: usize, y: usize| y * rows / exemplar.height * columns + x * columns / exemplar.width;
    let (mut counts, mut sizes) = (vec![0.0f64; columns * rows], vec![0.0f64; columns * rows]);
    for i in 0..exemplar.width * exemplar.height {
        let (x, y) = (i % exemplar.width, i / exemplar.width);
        sizes[part(x, y)] += f64::from(u8::from(exemplar.is_usable(x, y)));
    }
    map.sources.iter().for_each(|source| counts[part(source.x.into(), source.y.into())] += 1.0);
    let (texels, usable) = (map.sources.len() as f64, sizes.iter().sum::<f64>());
    let entropy: f64 = counts
        .iter()
        .zip(&sizes)
        .filter(|(count, _)| **count > 0.0)
        .map(|(count, size)| -count / texels * libm::log(count / texels * usable / size))
        .sum();
    let largest = libm::log(sizes.iter().filter(|size| **size > 0.0).count() as f64);
    if largest > 0.0 { 1.0 + entropy / largest } else { 1.0 }
}

/// A picture of several channels, and which of its texels count.
struct Planes {
    width: usize,
    height: usize,
    channels: usize,
    values: Vec<f32>,
    usable: Vec<bool>,
}

impl Planes {
    fn of(exemplar: &Exemplar) -> Self {
        let (width, height, channels) = (exemplar.width, exemplar.height, exemplar.channels);
        let usable = exemplar.mask.clone().unwrap_or_else(|| vec![true; width * height]);
        Self { width, height, channels, values: exemplar.values.clone(), usable }
    }

    fn copied(exemplar: &Exemplar, map: &SourceMap) -> Self {
        let texel = |source: &Source| exemplar.texel(source.x.into(), source.y.into()).iter().copied();
        let values = map.sources.iter().flat_map(texel).collect();
        let usable = vec![true; map.sources.len()];
        Self { width: map.width, height: map.height, channels: exemplar.channels, values, usable }
    }

    /// Means of 2 x 2 texels.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let four = |i: usize| {
            let corner = i / width * 2 * self.width + i % width * 2;
            [corner, corner + 1, corner + self.width, corner + self.width + 1]
        };
        let value =
            |i: usize, c: usize| four(i).map(|at| self.values[at * self.channels + c]).iter().sum::<f32>() / 4.0;
        let texels = 0..width * height;
        let values = texels.clone().flat_map(|i| (0..self.channels).map(move |c| (i, c))).map(|(i, c)| value(i, c));
        let usable = texels.map(|i| four(i).iter().all(|at| self.usable[*at])).collect();
        Self { width, height, channels: self.channels, values: values.collect(), usable }
    }

    /// Top left corners of the patches of `side` texels that count, at most `most` evenly spread ones.
    fn patches(&self, side: usize, most: usize) -> Vec<usize> {
        let columns = (self.width + 1).saturating_sub(side);
        let rows = (self.height + 1).saturating_sub(side);
        let is_usable =
            |corner: &usize| (0..side * side).all(|k| self.usable[corner + k / side * self.width + k % side]);
        let corners = (0..columns * rows).map(|i| i / columns * self.width + i % columns);
        let all: Vec<usize> = corners.filter(is_usable).collect();
        let count = all.len().min(most);
        let mut random = Stream::new(hash(&[count as u64]));
        (0..count).map(|k| all[(k * all.len() + random.below(all.len())) / count]).collect()
    }

    /// The sum of a patch's numbers times those of `direction`.
    fn projection(&self, corner: usize, side: usize, direction: &[f32]) -> f32 {
        let row = side * self.channels;
        direction
            .chunks_exact(row)
            .enumerate()
            .map(|(y, shares)| {
                let from = (corner + y * self.width) * self.channels;
                shares.iter().zip(&self.values[from..from + row]).map(|(a, b)| a * b).sum::<f32>()
            })
            .sum()
    }

    /// Standard deviation over all channels together.
    fn contrast(&self) -> f64 {
        let mut sum = 0.0;
        for c in 0..self.channels {
            let values =
                || self.values.iter().skip(c).step_by(self.channels).zip(&self.usable).filter(|(_, usable)| **usable);
            let count = values().count().max(1) as f64;
            let mean = values().map(|(v, _)| f64::from(*v)).sum::<f64>() / count;
            sum += values().map(|(v, _)| (f64::from(*v) - mean) * (f64::from(*v) - mean)).sum::<f64>() / count;
        }
        sum.sqrt()
    }
}

fn patch_distance(original: &Planes, result: &Planes) -> [f64; SCALES] {
    let contrast = original.contrast();
    let mut distances = [0.0; SCALES];
    let (mut a, mut b) = (original.halved(), result.halved());
    distances[0] = sliced(original, result, contrast);
    for distance in &mut distances[1..] {
        *distance = sliced(&a, &b, contrast);
        (a, b) = (a.halved(), b.halved());
    }
    distances
}

/// Sliced Wasserstein distance between the patches of two pictures.
fn sliced(a: &Planes, b: &Planes, contrast: f64) -> f64 {
    const SIDE: usize = 7;
    const PATCHES: usize = 4096;
    const DIRECTIONS: usize = 48;
    let smallest = [a.width, a.height, b.width, b.height].into_iter().min().unwrap_or(0);
    let side = SIDE.min(smallest);
    let (in_a, in_b) = (a.patches(side, PATCHES), b.patches(side, PATCHES));
    let count = in_a.len().min(in_b.len());
    if count == 0 || contrast <= 0.0 {
        return 0.0;
    }
    let numbers = side * side * a.channels;
    let mut sum = 0.0;
    for k in 0..DIRECTIONS {
        let mut random = Stream::new(hash(&[17, k as u64]));
        // sums of uniform numbers are nearly normal, so directions are nearly uniform
        let direction: Vec<f32> = (0..numbers).map(|_| (0..4).map(|_| random.next() - 0.5).sum()).collect();
        let length = direction.iter().map(|v| v * v).sum::<f32>().sqrt();
        let sorted = |planes: &Planes, corners: &[usize]| {
            let mut all: Vec<f32> = corners.iter().map(|corner| planes.projection(*corner, side, &direction)).collect();
            all.sort_by(f32::total_cmp);
            all
        };
        let (from_a, from_b) = (sorted(a, &in_a), sorted(b, &in_b));
        let quantile = |all: &[f32], i: usize| all[(i * all.len() + all.len() / 2) / count];
        let squares = (0..count).map(|i| f64::from((quantile(&from_a, i) - quantile(&from_b, i)) / length).powi(2));
        sum += squares.sum::<f64>() / count as f64;
    }
    (sum / DIRECTIONS as f64).sqrt() / contrast
}

fn spectrum_error(original: &Planes, result: &Planes) -> f64 {
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

#[cfg(test)]
mod tests;
