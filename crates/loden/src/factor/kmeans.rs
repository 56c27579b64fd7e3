//! k-means: clusters of points with small squared distances to the cluster means.
//!
//! Choose it where the error matters; [`super::tree`] is faster.
//!
//! # Model
//! Lloyd's iteration: each point joins the nearest of k centres, then each centre moves to the mean of its points,
//! until no point changes its cluster. The initial centres are points drawn in turn with probability proportional to
//! the squared distance from those drawn before (k-means++), or points at regular intervals. A centre that loses all
//! its points moves to the point farthest from its own centre.
//!
//! # Limits
//! Finds a local minimum. Distances are in single precision; sums over clusters are in double precision and in the
//! order of the points, so results do not depend on the number of threads.
//!
//! # References
//! lloyd1982, arthur2007

use rayon::prelude::*;

use crate::Result;
use crate::simd::wide;

/// Points per block: two vectors of AVX2.
const LANES: usize = 16;

/// Centres per kernel call, whose products stay in registers.
const CENTRES: usize = 4;

/// Blocks per task.
const BLOCKS: usize = 16;

/// Points in blocks of 16, dimension by dimension within a block.
#[derive(Debug, Clone)]
pub struct Points {
    /// (block, dimension, point of the block)
    lanes: Vec<[f32; LANES]>,
    count: usize,
    dimensions: usize,
}

impl Points {
    /// From (point, dimension).
    pub fn new(values: &[f32], dimensions: usize) -> Self {
        let count = values.len() / dimensions;
        let mut lanes = vec![[0.0; LANES]; count.div_ceil(LANES) * dimensions];
        for (block, points) in lanes.chunks_exact_mut(dimensions).zip(values.chunks(LANES * dimensions)) {
            for (lane, point) in points.chunks_exact(dimensions).enumerate() {
                block.iter_mut().zip(point).for_each(|(out, &v)| out[lane] = v);
            }
        }
        Self { lanes, count, dimensions }
    }

    /// The coordinates of a point.
    pub fn point(&self, i: usize) -> impl Iterator<Item = f32> {
        self.lanes[i / LANES * self.dimensions..][..self.dimensions].iter().map(move |lanes| lanes[i % LANES])
    }

    fn blocks(&self) -> impl IndexedParallelIterator<Item = &[[f32; LANES]]> {
        self.lanes.par_chunks(BLOCKS * self.dimensions)
    }
}

/// Initial centres of k-means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// Points drawn far from each other (k-means++) with this seed.
    Distant(u64),
    /// Points at regular intervals: the points numbered floor((i + 1/2) n / k) of n.
    Regular,
}

/// The cluster of each point. No cluster is empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Partition {
    /// (point)
    pub index: Vec<u32>,
    /// Number of clusters.
    pub clusters: usize,
}

impl Partition {
    /// The points of each cluster, in ascending order.
    pub fn members(&self) -> Vec<Vec<u32>> {
        let mut members = vec![Vec::new(); self.clusters];
        for (point, &cluster) in self.index.iter().enumerate() {
            members[cluster as usize].push(point as u32);
        }
        members
    }

    /// Renumbers the clusters in ascending order of `key`, and drops empty ones.
    #[must_use]
    pub fn ordered(self, key: impl Fn(&[u32]) -> f64) -> Self {
        let members = self.members();
        let mut order: Vec<(f64, usize)> =
            members.iter().enumerate().filter(|(_, m)| !m.is_empty()).map(|(k, m)| (key(m), k)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut number = vec![0; self.clusters];
        for (new, &(_, old)) in order.iter().enumerate() {
            number[old] = new as u32;
        }
        Self { index: self.index.iter().map(|&k| number[k as usize]).collect(), clusters: order.len() }
    }
}

/// Divides `points` into at most `clusters` clusters by at most `iterations` of Lloyd's iterations. Calls `step`
/// after each.
///
/// # Errors
/// Errors of `step`.
pub fn kmeans(
    points: &Points,
    clusters: usize,
    start: Start,
    iterations: usize,
    step: &dyn Fn() -> Result<()>,
) -> Result<Partition> {
    let chosen = match start {
        Start::Distant(seed) => distant(points, clusters, seed, step)?,
        Start::Regular => {
            let (n, k) = (points.count, clusters.min(points.count));
            (0..k).map(|i| (2 * i + 1) * n / (2 * k)).collect()
        }
    };
    let mut centres = Centres::new(chosen.iter().flat_map(|&i| points.point(i)).collect(), points.dimensions);
    let mut nearest = vec![(0, 0.0); points.count];
    centres.nearest(points, &mut nearest);
    for _ in 0..iterations {
        centres = centres.means(points, &nearest);
        let moved = centres.nearest(points, &mut nearest);
        step()?;
        if !moved {
            break;
        }
    }
    let index = nearest.into_iter().map(|(cluster, _)| cluster).collect();
    Ok(Partition { index, clusters: centres.count() }.ordered(|members| f64::from(members[0])))
}

/// Random numbers in 0..1 from a seed: SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// The indices of points drawn far from each other; fewer than `clusters` if there are fewer distinct points.
fn distant(points: &Points, clusters: usize, seed: u64, step: &dyn Fn() -> Result<()>) -> Result<Vec<usize>> {
    let mut random = Random(seed);
    let place = |share: f64, n: usize| ((share * n as f64) as usize).min(n - 1);
    let mut chosen = vec![place(random.next(), points.count)];
    let mut distance = vec![[f32::INFINITY; LANES]; points.count.div_ceil(LANES)];
    if let Some(last) = distance.last_mut() {
        last[(points.count - 1) % LANES + 1..].fill(0.0);
    }
    while chosen.len() < clusters.min(points.count) {
        let last: Vec<f32> = chosen.last().into_iter().flat_map(|&i| points.point(i)).collect();
        let parts: Vec<f64> = points
            .blocks()
            .zip(distance.par_chunks_mut(BLOCKS))
            .map(|(blocks, distance)| {
                closer(blocks, &last, distance);
                distance.iter().flatten().map(|&d| f64::from(d)).sum()
            })
            .collect();
        let mut left = random.next() * parts.iter().sum::<f64>();
        let mut part = 0;
        while part + 1 < parts.len() && left >= parts[part] {
            left -= parts[part];
            part += 1;
        }
        let inside = distance[part * BLOCKS..].iter().take(BLOCKS).flatten().enumerate();
        let mut found = None;
        for (i, &d) in inside.filter(|(_, d)| **d > 0.0) {
            found = Some(part * BLOCKS * LANES + i);
            left -= f64::from(d);
            if left < 0.0 {
                break;
            }
        }
        // all remaining points equal one that was drawn
        let Some(found) = found else { break };
        chosen.push(found);
        step()?;
    }
    Ok(chosen)
}

wide! {
    /// Lowers the squared distance of each point to its distance from `centre`, where this is smaller.
    fn closer(blocks: &[[f32; LANES]], centre: &[f32], distance: &mut [[f32; LANES]]) {
        for (block, distance) in blocks.chunks_exact(centre.len()).zip(distance) {
            let mut sum = [0.0f32; LANES];
            for (values, &centre) in block.iter().zip(centre) {
                for i in 0..LANES {
                    sum[i] += (values[i] - centre) * (values[i] - centre);
                }
            }
            for i in 0..LANES {
                distance[i] = if sum[i] < distance[i] { sum[i] } else { distance[i] };
            }
        }
    }
}

/// Centres in groups of [`CENTRES`]; the last group is padded with centres that are never the nearest.
struct Centres {
    /// (group, dimension, centre of the group)
    values: Vec<[f32; CENTRES]>,
    /// Half the squared norm of each centre.
    half_norm: Vec<[f32; CENTRES]>,
    count: usize,
    dimensions: usize,
}

impl Centres {
    /// From (centre, dimension).
    fn new(centres: Vec<f32>, dimensions: usize) -> Self {
        let count = centres.len() / dimensions;
        let groups = count.div_ceil(CENTRES);
        let mut values = vec![[0.0; CENTRES]; groups * dimensions];
        let mut half_norm = vec![[f32::MAX; CENTRES]; groups];
        for (k, centre) in centres.chunks_exact(dimensions).enumerate() {
            let (group, lane) = (k / CENTRES, k % CENTRES);
            half_norm[group][lane] = 0.5 * centre.iter().map(|v| v * v).sum::<f32>();
            for (out, &v) in values[group * dimensions..].iter_mut().zip(centre) {
                out[lane] = v;
            }
        }
        Self { values, half_norm, count, dimensions }
    }

    fn count(&self) -> usize {
        self.count
    }

    /// Finds the nearest centre of each point, with a score that is higher the nearer it is. Returns whether any
    /// changed.
    fn nearest(&self, points: &Points, nearest: &mut [(u32, f32)]) -> bool {
        let moved: Vec<bool> = points
            .blocks()
            .zip(nearest.par_chunks_mut(BLOCKS * LANES))
            .map(|(blocks, nearest)| {
                let mut moved = false;
                for (block, out) in blocks.chunks_exact(points.dimensions).zip(nearest.chunks_mut(LANES)) {
                    let (mut index, mut score) = ([0; LANES], [f32::NEG_INFINITY; LANES]);
                    best(block, &self.values, &self.half_norm, &mut index, &mut score);
                    for (out, new) in out.iter_mut().zip(index.into_iter().zip(score)) {
                        moved |= out.0 != new.0;
                        *out = new;
                    }
                }
                moved
            })
            .collect();
        moved.contains(&true)
    }

    /// Moves each centre to the mean of its points.
    fn means(&self, points: &Points, nearest: &[(u32, f32)]) -> Self {
        let mut index: Vec<u32> = nearest.iter().map(|n| n.0).collect();
        let mut members = Partition { index: index.clone(), clusters: self.count }.members();
        if members.iter().any(Vec::is_empty) {
            self.fill(points, nearest, &mut index, &mut members);
        }
        let mut means = vec![0.0; self.count * self.dimensions];
        means.par_chunks_exact_mut(self.dimensions).zip(&members).for_each(|(mean, members)| {
            let mut sums = vec![0.0f64; self.dimensions];
            for &point in members {
                sums.iter_mut().zip(points.point(point as usize)).for_each(|(sum, v)| *sum += f64::from(v));
            }
            mean.iter_mut().zip(sums).for_each(|(mean, sum)| *mean = (sum / members.len().max(1) as f64) as f32);
        });
        Self::new(means, self.dimensions)
    }

    /// Gives each empty cluster the point that is farthest from its own centre.
    fn fill(&self, points: &Points, nearest: &[(u32, f32)], index: &mut [u32], members: &mut [Vec<u32>]) {
        let distance = |i: usize| points.point(i).map(|v| v * v).sum::<f32>() - 2.0 * nearest[i].1;
        let mut far: Vec<(f32, u32)> = (0..points.count).map(|i| (distance(i), i as u32)).collect();
        far.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut far = far.into_iter();
        for k in 0..members.len() {
            while members[k].is_empty() {
                let Some((_, point)) = far.next() else { return };
                let from = &mut members[index[point as usize] as usize];
                if from.len() > 1 {
                    from.retain(|&p| p != point);
                    index[point as usize] = k as u32;
                    members[k].push(point);
                }
            }
        }
    }
}

wide! {
    /// For each point of a block, the centre with the highest product minus half its squared norm; the first of equals.
    fn best(
        block: &[[f32; LANES]],
        centres: &[[f32; CENTRES]],
        half_norm: &[[f32; CENTRES]],
        index: &mut [u32; LANES],
        score: &mut [f32; LANES],
    ) {
        for (group, (centres, half_norm)) in centres.chunks_exact(block.len()).zip(half_norm).enumerate() {
            let mut sums = [[0.0f32; LANES]; CENTRES];
            for (values, centre) in block.iter().zip(centres) {
                for k in 0..CENTRES {
                    for i in 0..LANES {
                        sums[k][i] += values[i] * centre[k];
                    }
                }
            }
            for k in 0..CENTRES {
                let number = (group * CENTRES + k) as u32;
                for i in 0..LANES {
                    let value = sums[k][i] - half_norm[k];
                    let better = value > score[i];
                    score[i] = if better { value } else { score[i] };
                    index[i] = if better { number } else { index[i] };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::portable;

    fn cloud(count: usize, dimensions: usize) -> Vec<f32> {
        let mut random = Random(5);
        (0..count * dimensions).map(|i| (i / dimensions % 5) as f32 * 0.3 + random.next() as f32 * 0.5).collect()
    }

    /// The sum of squared distances to the cluster means.
    fn objective(values: &[f32], dimensions: usize, partition: &Partition) -> f64 {
        let of_cluster = |members: &Vec<u32>| -> f64 {
            let value = |p: u32, d: usize| f64::from(values[p as usize * dimensions + d]);
            let spread = |d: usize| {
                let mean = members.iter().map(|&p| value(p, d)).sum::<f64>() / members.len() as f64;
                members.iter().map(|&p| (value(p, d) - mean).powi(2)).sum::<f64>()
            };
            (0..dimensions).map(spread).sum()
        };
        partition.members().iter().map(of_cluster).sum()
    }

    /// Lloyd's iteration by its definition, in double precision.
    fn plain(values: &[f32], dimensions: usize, k: usize, iterations: usize) -> Vec<u32> {
        let points: Vec<Vec<f64>> =
            values.chunks_exact(dimensions).map(|p| p.iter().map(|&v| f64::from(v)).collect()).collect();
        let n = points.len();
        let mut centres: Vec<Vec<f64>> = (0..k).map(|i| points[(2 * i + 1) * n / (2 * k)].clone()).collect();
        let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let mut index = Vec::new();
        for _ in 0..=iterations {
            let nearest =
                |p: &Vec<f64>| (0..k).min_by(|&a, &b| distance(p, &centres[a]).total_cmp(&distance(p, &centres[b])));
            index = points.iter().map(|p| nearest(p).unwrap() as u32).collect();
            for (c, centre) in centres.iter_mut().enumerate() {
                let mine: Vec<&Vec<f64>> =
                    points.iter().zip(&index).filter(|(_, i)| **i == c as u32).map(|(p, _)| p).collect();
                *centre = (0..dimensions).map(|d| mine.iter().map(|p| p[d]).sum::<f64>() / mine.len() as f64).collect();
            }
        }
        index
    }

    #[test]
    fn kmeans_is_lloyds_iteration_on_any_processor() {
        let (count, dimensions, k) = (997, 7, 13);
        let values = cloud(count, dimensions);
        let points = Points::new(&values, dimensions);
        for iterations in [0, 1, 100] {
            let run = || kmeans(&points, k, Start::Regular, iterations, &|| Ok(())).unwrap();
            let found = run();
            let expected = Partition { index: plain(&values, dimensions, k, iterations), clusters: k };
            assert_eq!(found, expected.ordered(|m| f64::from(m[0])), "{iterations}");
            assert_eq!(portable(run), found);
        }
    }

    #[test]
    fn a_distant_start_is_better_than_chance_and_follows_the_seed() {
        let values = cloud(2000, 3);
        let points = Points::new(&values, 3);
        let run = |start, iterations| kmeans(&points, 40, start, iterations, &|| Ok(())).unwrap();
        let [few, many] = [0, 50].map(|i| objective(&values, 3, &run(Start::Distant(1), i)));
        assert!(many < 0.9 * few, "{many} {few}");
        assert!(run(Start::Distant(1), 3) == run(Start::Distant(1), 3));
        assert!(run(Start::Distant(1), 3) != run(Start::Distant(2), 3));
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(one.install(|| run(Start::Distant(1), 50)) == run(Start::Distant(1), 50));
    }

    #[test]
    fn equal_points_share_a_cluster_and_none_is_empty() {
        let values: Vec<f32> = (0..60).map(|i| (i / 2 % 3) as f32).flat_map(|v| [v, -v]).collect();
        let points = Points::new(&values, 2);
        for start in [Start::Distant(3), Start::Regular] {
            let found = kmeans(&points, 10, start, 20, &|| Ok(())).unwrap();
            assert!(objective(&values, 2, &found) == 0.0 && found.members().iter().all(|m| !m.is_empty()), "{found:?}");
        }
        assert_eq!(kmeans(&points, 10, Start::Distant(3), 20, &|| Ok(())).unwrap().clusters, 3);
        let single = kmeans(&Points::new(&[1.0, 2.0], 2), 4, Start::Regular, 5, &|| Ok(())).unwrap();
        assert_eq!((single.index, single.clusters), (vec![0], 1));
    }
}
