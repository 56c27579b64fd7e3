//! Nearest neighbours of vectors: by a tree of clusters, or among all.

use rayon::prelude::*;

use crate::factor::tree::halve;
use crate::simd::wide;

/// Finds one of several vectors.
pub trait Search {
    /// The index of the vector nearest to `vector`, or of one that is near; the first of several.
    fn nearest(&self, vector: &[f32]) -> usize;
}

/// Vectors in a leaf that are not split further.
const LEAF: usize = 8;

/// Tree-structured vector quantisation: at each node, the nearer of two means.
pub struct Tree {
    vectors: Vec<f32>,
    dimensions: usize,
    /// Leaves that are searched.
    leaves: usize,
    /// The root is the last.
    nodes: Vec<Node>,
}

enum Node {
    Leaf(Vec<u32>),
    /// The plane between two means, normal . v > middle on the side of the second, and the nodes on both sides.
    Split {
        normal: Vec<f32>,
        middle: f32,
        sides: [u32; 2],
    },
}

impl Tree {
    /// A tree of vectors, one after the other.
    pub fn new(vectors: Vec<f32>, dimensions: usize, leaves: usize) -> Self {
        let all = (0..(vectors.len() / dimensions) as u32).collect();
        let mut tree = Self { vectors, dimensions, leaves, nodes: vec![] };
        tree.grow(all);
        tree
    }

    /// Adds the nodes of some vectors, and returns the number of the last.
    fn grow(&mut self, points: Vec<u32>) -> u32 {
        let halves = if points.len() > LEAF { halve(&self.vectors, self.dimensions, &points) } else { None };
        let node = match halves {
            None => Node::Leaf(points),
            Some((_, [low, high])) => {
                let means = [&low, &high].map(|points| self.mean(points));
                let normal: Vec<f32> = means[1].iter().zip(&means[0]).map(|(b, a)| (b - a) as f32).collect();
                let middle: f64 = means[1].iter().zip(&means[0]).map(|(b, a)| 0.5 * (b * b - a * a)).sum();
                let length = normal.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
                let normal = normal.iter().map(|v| v / length).collect();
                let sides = [low, high].map(|points| self.grow(points));
                Node::Split { normal, middle: middle as f32 / length, sides }
            }
        };
        self.nodes.push(node);
        (self.nodes.len() - 1) as u32
    }

    fn vector(&self, point: u32) -> &[f32] {
        &self.vectors[point as usize * self.dimensions..][..self.dimensions]
    }

    fn mean(&self, points: &[u32]) -> Vec<f64> {
        let mut mean = vec![0.0; self.dimensions];
        for &point in points {
            mean.iter_mut().zip(self.vector(point)).for_each(|(mean, &v)| *mean += f64::from(v));
        }
        mean.iter_mut().for_each(|mean| *mean /= points.len() as f64);
        mean
    }
}

impl Search for Tree {
    fn nearest(&self, vector: &[f32]) -> usize {
        let mut best = (f32::INFINITY, 0);
        // sides that were not taken, with the distance to the plane that they are beyond
        let mut open = vec![(0.0f32, (self.nodes.len() - 1) as u32)];
        for _ in 0..self.leaves {
            let Some(next) = (0..open.len()).min_by(|&a, &b| open[a].0.total_cmp(&open[b].0)) else { break };
            let (bound, mut at) = open.swap_remove(next);
            while let Node::Split { normal, middle, sides } = &self.nodes[at as usize] {
                let beyond = dot(normal, vector) - middle;
                let side = usize::from(beyond > 0.0);
                open.push((bound.max(beyond.abs()), sides[1 - side]));
                at = sides[side];
            }
            if let Node::Leaf(points) = &self.nodes[at as usize] {
                for &point in points {
                    let distance = distance(self.vector(point), vector);
                    if (distance, point) < best {
                        best = (distance, point);
                    }
                }
            }
        }
        best.1 as usize
    }
}

/// Vectors compared at a time.
const LANES: usize = 32;

/// Vectors in blocks, dimension by dimension.
pub struct Exhaustive {
    blocks: Vec<f32>,
    dimensions: usize,
    count: usize,
}

impl Exhaustive {
    /// Of vectors, one after the other.
    pub fn new(vectors: &[f32], dimensions: usize) -> Self {
        let count = vectors.len() / dimensions;
        let mut blocks = vec![0.0; count.div_ceil(LANES) * LANES * dimensions];
        for (place, vector) in vectors.chunks_exact(dimensions).enumerate() {
            let block = &mut blocks[place / LANES * LANES * dimensions..];
            vector.iter().enumerate().for_each(|(k, &v)| block[k * LANES + place % LANES] = v);
        }
        Self { blocks, dimensions, count }
    }
}

impl Search for Exhaustive {
    fn nearest(&self, vector: &[f32]) -> usize {
        let of_block = |(block, values): (usize, &[f32])| {
            let distances = distances(values, vector);
            let left = self.count - block * LANES;
            let each =
                distances.iter().take(left).enumerate().map(|(lane, &distance)| (distance, block * LANES + lane));
            each.fold((f32::INFINITY, usize::MAX), |best, found| if found < best { found } else { best })
        };
        let least = |a: (f32, usize), b: (f32, usize)| if b < a { b } else { a };
        let blocks = self.blocks.par_chunks_exact(LANES * self.dimensions).with_min_len(16).enumerate();
        let (_, found) = blocks.map(of_block).reduce(|| (f32::INFINITY, usize::MAX), least);
        if found == usize::MAX { 0 } else { found }
    }
}

wide! {
    /// The squared distances of the vectors of a block.
    fn distances(block: &[f32], vector: &[f32]) -> [f32; 32] {
        let mut sums = [0.0f32; LANES];
        for (values, v) in block.chunks_exact(LANES).zip(vector) {
            for (sum, value) in sums.iter_mut().zip(values) {
                let difference = value - v;
                *sum += difference * difference;
            }
        }
        sums
    }
}

wide! {
    fn dot(a: &[f32], b: &[f32]) -> f32 {
        let mut lanes = [0.0f32; 8];
        let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
        for (a, b) in a.iter().zip(b) {
            (0..8).for_each(|i| lanes[i] += a[i] * b[i]);
        }
        lanes.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
    }
}

/// The squared distance, summed in the order of the dimensions as an exhaustive search does.
fn distance(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).fold(0.0, |sum, (a, b)| {
        let difference = a - b;
        sum + difference * difference
    })
}
