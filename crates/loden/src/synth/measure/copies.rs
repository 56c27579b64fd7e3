//! What the map of a result says: its seams, and how it uses the exemplar.

use super::super::{Exemplar, Source, SourceMap};

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

/// The mean squared difference between neighbours at boundaries between copied regions and the texels that they had beside them
/// in the exemplar, relative to that between neighbours in the exemplar; 0 without boundaries.
pub fn seam_energy(exemplar: &Exemplar, map: &SourceMap) -> f64 {
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

pub(super) fn copy_length(exemplar: &Exemplar, map: &SourceMap) -> f64 {
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

pub(super) fn evenness(exemplar: &Exemplar, map: &SourceMap) -> f64 {
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

/// Texels whose copies are looked for; pairs of them.
const REFERENCES: usize = 1 << 16;
const PAIRS: usize = 1 << 22;

pub(super) fn repetition(exemplar: &Exemplar, map: &SourceMap) -> f64 {
    let (w, h) = (map.width, map.height);
    let mut places: Vec<Vec<u32>> = vec![Vec::new(); exemplar.width * exemplar.height];
    let texel = |i: usize| map.sources[i].texel(exemplar.width);
    (0..w * h).for_each(|i| places[texel(i)].push(i as u32));
    let pairs = places.iter().map(|places| places.len() * places.len()).sum::<usize>();
    let step = (w * h).div_ceil(REFERENCES).max(pairs.div_ceil(PAIRS));
    // Count how often each displacement leads to another copy; opposite ones are counted as one
    let (mut counts, mut references) = (vec![0u32; (2 * w - 1) * h], 0u32);
    let mut inside = vec![0u32; w * h];
    for at in (0..w * h).step_by(step) {
        references += 1;
        inside[at] = 1;
        let (x, y) = (at % w, at / w);
        for other in places[texel(at)].iter().map(|other| *other as usize).filter(|other| *other > at) {
            counts[(other / w - y) * (2 * w - 1) + other % w + w - 1 - x] += 1;
        }
    }
    // Count the references that have a texel at a displacement
    let sums = Sums::new(&inside, w);
    let share = |(k, count): (usize, &u32)| {
        let (dx, dy) = ((k % (2 * w - 1)) as i64 - (w as i64 - 1), k / (2 * w - 1));
        let (left, right) = ((-dx).max(0) as usize, (w as i64 - dx.max(0)) as usize);
        let able = sums.within([left, 0], [right, h - dy]);
        if able * 4 < references || able < 16 { 0.0 } else { f64::from(*count) / f64::from(able) }
    };
    counts.iter().enumerate().filter(|(_, count)| **count > 0).map(share).fold(0.0, f64::max)
}

/// Sums over rectangles.
struct Sums {
    sums: Vec<u32>,
    stride: usize,
}

impl Sums {
    fn new(values: &[u32], width: usize) -> Self {
        let stride = width + 1;
        let mut sums = vec![0; stride * (values.len() / width + 1)];
        for (y, row) in values.chunks_exact(width).enumerate() {
            let mut sum = 0;
            for (x, value) in row.iter().enumerate() {
                sum += value;
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + sum;
            }
        }
        Self { sums, stride }
    }

    /// From one corner up to another, which is outside.
    fn within(&self, [left, top]: [usize; 2], [right, bottom]: [usize; 2]) -> u32 {
        let at = |x: usize, y: usize| self.sums[y * self.stride + x];
        at(right, bottom) + at(left, top) - at(left, bottom) - at(right, top)
    }
}
