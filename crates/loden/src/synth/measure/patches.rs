//! Patches of a result compared with those of the exemplar.

use rayon::prelude::*;

use super::super::SourceMap;
use super::SCALES;
use super::planes::Planes;
use crate::random::{Stream, hash};

pub(super) fn patch_distance(original: &Planes, result: &Planes) -> [f64; SCALES] {
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

/// Texels per side of the patches that are looked for, and how many of them.
const SIDE: usize = 7;
const SOUGHT: usize = 1024;

/// Patches of the exemplar among which they are looked for, beside those that they were copied from.
const AMONG: usize = 4096;

/// The share of patches that may be less like the exemplar than is said.
const WORST: f64 = 0.05;

/// For patches whose texels are 1, 2 and 4 texels apart, the root mean square difference to the nearest patch of the
/// exemplar, which one in twenty patches exceeds, relative to the contrast of the exemplar.
pub(super) fn patch_error(map: &SourceMap, original: &Planes, result: &Planes) -> [f64; SCALES] {
    let contrast = original.contrast();
    std::array::from_fn(|scale| {
        let step = 1 << scale;
        let [from, to] = [original, result].map(|planes| planes.blurred(step));
        if contrast > 0.0 { unlike(map, [&from, &to], step) / contrast } else { 0.0 }
    })
}

/// The difference for patches whose texels are `step` texels apart.
fn unlike(map: &SourceMap, [from, to]: [&Planes; 2], step: usize) -> f64 {
    let smallest = [from.width, from.height, to.width, to.height].into_iter().min().unwrap_or(0);
    let side = SIDE.min(smallest.div_ceil(step));
    if side == 0 {
        return 0.0;
    }
    let span = (side - 1) * step + 1;
    let sought = to.patches(span, (SOUGHT * 3 / to.channels.max(3)).max(64));
    let among = from.patches(span, AMONG);
    let offsets: Vec<(usize, usize)> = (0..side * side).map(|k| (k % side * step, k / side * step)).collect();
    let nearest = |corner: &usize| {
        let (x, y) = (corner % to.width, corner / to.width);
        let copied = offsets.iter().filter_map(|(dx, dy)| {
            let source = map.at(x + dx, y + dy);
            let left = usize::from(source.x).checked_sub(*dx)?;
            let top = usize::from(source.y).checked_sub(*dy)?;
            (left + span <= from.width && top + span <= from.height).then_some(top * from.width + left)
        });
        // periodic exemplars continue at their edges, where nothing is looked for
        let mut least = f32::INFINITY;
        for other in copied.chain(among.iter().copied()) {
            least = least.min(difference([from, to], [other, *corner], &offsets, least));
            if least == 0.0 {
                break;
            }
        }
        f64::from(least)
    };
    let mut all: Vec<f64> = sought.par_iter().map(nearest).filter(|least| least.is_finite()).collect();
    all.sort_by(f64::total_cmp);
    let worst = all.get(((1.0 - WORST) * all.len() as f64) as usize);
    worst.map_or(0.0, |sum| (sum / (side * side) as f64).sqrt())
}

/// The squared difference of two patches, or any larger number than `limit` if it is larger.
fn difference(planes: [&Planes; 2], corners: [usize; 2], offsets: &[(usize, usize)], limit: f32) -> f32 {
    let c = planes[0].channels;
    let mut sum = 0.0;
    for (dx, dy) in offsets {
        let [a, b] = [0, 1].map(|k| &planes[k].values[(corners[k] + dy * planes[k].width + dx) * c..][..c]);
        sum += a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        if sum > limit {
            break;
        }
    }
    sum
}
