//! The first principal components of a matrix that is too large for memory, read in shards of columns.
//!
//! # Model
//! A row of the matrix M is a texel, a column a light and channel of a view; a shard holds the columns of one view. Some
//! hundred scattered texels, in all shards, give a first basis of some more columns than are wanted. Then subspace
//! iteration: a pass multiplies M by the basis (the sum over shards), another M^T by the result (shard by shard); the
//! Ritz pairs tell what a further round could still gain. A last pass takes the products with all columns of the basis,
//! whose own components are the result. Shards are visited in order and sums are taken over fixed parts, so that the
//! number of threads changes nothing.
//!
//! # Limits
//! Memory: the products (texels x columns of the basis) in single precision, the scattered texels, and as many shards
//! as there are threads. Products are summed in single precision. After three rounds the basis is taken as it
//! is: components within a flat spectrum, as of noise, then miss some per cent of what is left out.
//!
//! # References
//! halko2011

#[cfg(test)]
mod tests;

use rayon::prelude::*;

use super::linalg::{
    Rows, add_product, add_product_transposed, combine_rows, largest_eigenpairs, orthonormal_rows, turn_upright,
};
use super::principal::{Ritz, TOLERANCE};
use super::simd::wide;
use super::tile::{FloatTile, Tile};
use crate::Result;

/// A matrix in shards of columns.
pub trait Shards: Sync {
    /// A shard that has been read.
    type Shard<'a>: Sync + Send
    where
        Self: 'a;

    /// How many there are.
    fn count(&self) -> usize;

    /// Columns of each shard.
    fn columns(&self) -> usize;

    /// Rows of the matrix.
    fn texels(&self) -> usize;

    /// Reads a shard; called once a pass for each, from several threads.
    ///
    /// # Errors
    /// What reading returns.
    fn read(&self, shard: usize) -> Result<Self::Shard<'_>>;

    /// Loads `count` rows from `first` into a tile, a row for each column of the matrix.
    fn load(&self, shard: &Self::Shard<'_>, tile: &mut FloatTile, first: usize, count: usize);

    /// A shard is not needed for now.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    fn done(&self, shard: usize) -> Result<()>;
}

/// Mean, basis and coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct Global {
    /// (column of the matrix)
    pub mean: Vec<f64>,
    /// (component, column of the matrix): unit vectors, largest variance first, in each the entry of largest magnitude
    /// positive.
    pub basis: Vec<f64>,
    /// (texel, component)
    pub coefficients: Vec<f32>,
    /// Sum of squares of the matrix less the mean.
    pub energy: f64,
}

/// Rounds of two passes each.
const ROUNDS: usize = 3;

/// Passes over the matrix that one call makes at most.
pub const PASSES: usize = 2 * ROUNDS + 2;

/// Blocks of products whose inner products are held at once.
const TOGETHER: usize = 32;

/// Fixed parts of the texels whose sums are taken separately.
const PARTS: usize = 16;

/// The first `count` principal components; `None` if the numbers are not finite.
///
/// # Errors
/// What the shards return.
pub fn principal_components<S: Shards>(shards: &S, count: usize) -> Result<Option<Global>> {
    components(shards, count, true)
}

/// The first `count` singular vectors: as [`principal_components`] of the matrix as it is, its mean left in and said to
/// be 0.
///
/// # Errors
/// What the shards return.
pub fn singular_components<S: Shards>(shards: &S, count: usize) -> Result<Option<Global>> {
    components(shards, count, false)
}

/// Rows of the basis and scattered texels for `count` components of at most `limit`.
fn sizes(count: usize, limit: usize) -> (usize, usize) {
    let width = (count + (count / 4).max(8)).min(limit);
    (width, (8 * width).max(1024).min(limit))
}

/// A bound of the memory, bytes, that [`principal_components`] and its result take beside the shards.
pub fn memory(columns: usize, texels: usize, count: usize) -> u64 {
    let (width, sampled) = sizes(count, columns.min(texels));
    // twice the sample, its inner products and their eigenvectors; or products, their inner ones, and the result
    let first = 8 * sampled * columns + 40 * sampled * sampled;
    let rounds = 4 * (texels * (width + count) + TOGETHER * width * width);
    // the basis, its image and what they are turned to
    (first.max(rounds) + 40 * width * columns) as u64
}

fn components<S: Shards>(shards: &S, count: usize, centred: bool) -> Result<Option<Global>> {
    let columns = shards.columns() * shards.count();
    let limit = columns.min(shards.texels());
    let (width, sampled) = sizes(count, limit);
    let (mut mean, mut energy, sample) = survey(shards, sampled)?;
    if !centred {
        energy += shards.texels() as f64 * mean.iter().map(|m| m * m).sum::<f64>();
        mean.fill(0.0);
    }
    let Some(mut basis) = first_basis(&sample, &mean, width) else { return Ok(None) };
    drop(sample);
    for round in 0..ROUNDS {
        let products = project(shards, &mean, &basis)?;
        let image = image(shards, &mean, &products, width)?;
        let Some(ritz) = Ritz::new(&basis, &image, columns) else { return Ok(None) };
        let left = energy - ritz.values[..count].iter().sum::<f64>();
        // a basis of all dimensions cannot be improved, only turned
        let complete = width == limit;
        let next = if complete { None } else { orthonormal_rows(&ritz.images, columns) };
        let settled = ritz.gain(count, columns) <= TOLERANCE * left.max(1e-7 * energy);
        basis = next.unwrap_or_else(|| ritz.into_vectors());
        if settled || complete || round + 1 == ROUNDS {
            break;
        }
    }
    finish(shards, mean, energy, &basis, count)
}

/// Passes over the matrix that [`sketched_components`] makes.
pub const SKETCH_PASSES: usize = 2;

/// As [`principal_components`], but within the span of some hundred scattered texels only: orthonormal directions that
/// take up nearly as much, in two passes. `count` may be the rank at most.
///
/// # Errors
/// What the shards return.
pub fn sketched_components<S: Shards>(shards: &S, count: usize) -> Result<Option<Global>> {
    let limit = (shards.columns() * shards.count()).min(shards.texels());
    let count = count.min(limit);
    let width = (count + 8).min(limit);
    let (mean, energy, sample) = survey(shards, (8 * width).max(512).min(limit))?;
    let Some(basis) = first_basis(&sample, &mean, width) else { return Ok(None) };
    drop(sample);
    finish(shards, mean, energy, &basis, count)
}

/// The components within the span of `basis`, and their coefficients.
fn finish<S: Shards>(shards: &S, mean: Vec<f64>, energy: f64, basis: &[f64], count: usize) -> Result<Option<Global>> {
    let columns = mean.len();
    let width = basis.len() / columns;
    let products = project(shards, &mean, basis)?;
    let Some(eigen) = largest_eigenpairs(&products.inner(width), width, count) else { return Ok(None) };
    let mut turn = eigen.vectors;
    let mut turned = combine_rows(&turn, basis, columns);
    for (vector, turn) in turned.chunks_exact_mut(columns).zip(turn.chunks_exact_mut(width)) {
        // coefficients follow the sign of their component
        if turn_upright(vector) {
            turn.iter_mut().for_each(|v| *v = -*v);
        }
    }
    let turn: Vec<f32> = turn.iter().map(|&v| v as f32).collect();
    Ok(Some(Global { coefficients: products.by_texel(&turn, width, shards.texels()), mean, basis: turned, energy }))
}

/// Calls `f` with each shard in order; as many as there are threads are read at once.
fn for_each_shard<S: Shards>(shards: &S, mut f: impl FnMut(usize, &S::Shard<'_>) -> Result<()>) -> Result<()> {
    let all: Vec<usize> = (0..shards.count()).collect();
    for some in all.chunks(rayon::current_num_threads()) {
        let read: Result<Vec<_>> = some.par_iter().map(|&shard| shards.read(shard)).collect();
        for (&shard, data) in some.iter().zip(&read?) {
            f(shard, data)?;
            shards.done(shard)?;
        }
    }
    Ok(())
}

/// Means, energy, and the values of `count` scattered texels, (texel, column).
fn survey<S: Shards>(shards: &S, count: usize) -> Result<(Vec<f64>, f64, Vec<f32>)> {
    let (columns, texels) = (shards.columns(), shards.texels());
    let all = columns * shards.count();
    // one texel of each of `count` equal parts, at a place in it that looks random
    let place = |i: usize| {
        let (begin, end) = (i * texels / count, (i + 1) * texels / count);
        begin + (i.wrapping_mul(0x9E37_79B9) >> 7) % (end - begin).max(1)
    };
    let places: Vec<usize> = (0..count).map(place).collect();
    let mut sample = vec![0.0f32; count * all];
    let (mut mean, mut energy) = (vec![0.0; all], 0.0);
    for_each_shard(shards, |shard, data| {
        let parts: Vec<(Vec<f64>, f64, Vec<f32>)> = parts(texels)
            .map(|(first, last)| {
                let mut tile = FloatTile::new(columns);
                let (mut sums, mut squares, mut picked) = (vec![0.0; columns], 0.0, Vec::new());
                for (begin, size) in tiles(first, last, tile.texels()) {
                    shards.load(data, &mut tile, begin, size);
                    for (sum, row) in sums.iter_mut().zip(tile.data().chunks_exact(tile.texels())) {
                        let part = sums_of_row(&row[..size]);
                        *sum += f64::from(part[0]);
                        squares += f64::from(part[1]);
                    }
                    let inside = |p: &&usize| (begin..begin + size).contains(*p);
                    for &p in places.iter().filter(inside) {
                        picked.extend(tile.data().chunks_exact(tile.texels()).map(|row| row[p - begin]));
                    }
                }
                (sums, squares, picked)
            })
            .collect();
        let mut texel = 0;
        let mean = &mut mean[shard * columns..(shard + 1) * columns];
        for (sums, squares, picked) in parts {
            mean.iter_mut().zip(sums).for_each(|(mean, sum)| *mean += sum / texels as f64);
            energy += squares;
            for values in picked.chunks_exact(columns) {
                sample[texel * all + shard * columns..][..columns].copy_from_slice(values);
                texel += 1;
            }
        }
        energy -= texels as f64 * mean.iter().map(|m| m * m).sum::<f64>();
        Ok(())
    })?;
    Ok((mean, energy, sample))
}

wide! {
    /// The sum of some numbers and that of their squares.
    fn sums_of_row(row: &[f32]) -> [f32; 2] {
        let mut lanes = [[0.0f32; 8]; 2];
        let (whole, rest) = row.as_chunks::<8>();
        for values in whole {
            for i in 0..8 {
                lanes[0][i] += values[i];
                lanes[1][i] += values[i] * values[i];
            }
        }
        let rest = [rest.iter().sum::<f32>(), rest.iter().map(|v| v * v).sum::<f32>()];
        [lanes[0].iter().sum::<f32>() + rest[0], lanes[1].iter().sum::<f32>() + rest[1]]
    }
}

/// Fixed parts of the texels, in parallel.
fn parts(texels: usize) -> impl IndexedParallelIterator<Item = (usize, usize)> {
    (0..PARTS).into_par_iter().map(move |i| (i * texels / PARTS, (i + 1) * texels / PARTS))
}

fn tiles(first: usize, last: usize, size: usize) -> impl Iterator<Item = (usize, usize)> {
    (first..last).step_by(size).map(move |begin| (begin, size.min(last - begin)))
}

/// The right singular vectors of the sampled rows without their mean, row by row, filled up with others.
fn first_basis(sample: &[f32], mean: &[f64], width: usize) -> Option<Vec<f64>> {
    let columns = mean.len();
    let count = sample.len() / columns;
    let mut centred = sample.to_vec();
    for row in centred.chunks_exact_mut(columns) {
        row.iter_mut().zip(mean).for_each(|(v, m)| *v = (f64::from(*v) - m) as f32);
    }
    // products of all pairs of rows, a strip at a time in parallel
    let mut inner = vec![0.0f32; count * count];
    let rows = Rows::new(&centred, columns);
    inner.par_chunks_mut(32 * count).zip(centred.par_chunks(32 * columns)).for_each(|(out, strip)| {
        add_product_transposed(Rows::new(strip, columns), rows, out);
    });
    let symmetric: Vec<f64> = (0..count * count)
        .map(|i| 0.5 * (f64::from(inner[i]) + f64::from(inner[i % count * count + i / count])))
        .collect();
    let eigen = largest_eigenpairs(&symmetric, count, width)?;
    let turn: Vec<f32> = eigen.vectors.iter().map(|&v| v as f32).collect();
    let mut basis = vec![0.0f32; width * columns];
    basis.par_chunks_mut(8 * columns).zip(turn.par_chunks(8 * count)).for_each(|(out, turn)| {
        add_product(Rows::new(turn, count), rows, out);
    });
    // directions that the sample lacks: fixed noise, far below what it has
    let scale = eigen.values[0].max(0.0).sqrt().max(1e-6) * 1e-6 / (columns as f64).sqrt();
    let mut state = 1u64;
    let noisy = basis.iter().map(|&v| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        f64::from(v) + scale * ((state >> 11) as f64 / (1u64 << 52) as f64 - 1.0)
    });
    orthonormal_rows(&noisy.collect::<Vec<f64>>(), columns)
}

/// The products of the centred matrix with the rows of `basis`: blocks of (component, texel of the block).
struct Products {
    blocks: Vec<Vec<f32>>,
    size: usize,
}

fn project<S: Shards>(shards: &S, mean: &[f64], basis: &[f64]) -> Result<Products> {
    let (columns, texels) = (shards.columns(), shards.texels());
    let width = basis.len() / mean.len();
    let size = FloatTile::new(columns).texels();
    let mut blocks = vec![vec![0.0f32; width * size]; texels.div_ceil(size)];
    for_each_shard(shards, |shard, data| {
        let (mean, part) = part_of(shard, columns, mean, basis);
        blocks.par_iter_mut().enumerate().for_each_init(
            || FloatTile::new(columns),
            |tile, (i, block)| {
                let count = size.min(texels - i * size);
                shards.load(data, tile, i * size, count);
                tile.centre(count, mean);
                add_product(Rows::new(&part, columns), Rows::new(tile.data(), size), block);
            },
        );
        Ok(())
    })?;
    Ok(Products { blocks, size })
}

/// The means and, in single precision, the basis of a shard's columns.
fn part_of<'a>(shard: usize, columns: usize, mean: &'a [f64], basis: &[f64]) -> (&'a [f64], Vec<f32>) {
    let range = shard * columns..(shard + 1) * columns;
    let part = basis.chunks_exact(mean.len()).flat_map(|row| row[range.clone()].iter().map(|&v| v as f32)).collect();
    (&mean[range], part)
}

/// The transposed centred matrix times the products: (component, column).
fn image<S: Shards>(shards: &S, mean: &[f64], products: &Products, width: usize) -> Result<Vec<f64>> {
    let (columns, texels, size) = (shards.columns(), shards.texels(), products.size);
    let mut image = vec![0.0; width * mean.len()];
    let per_part = products.blocks.len().div_ceil(PARTS);
    for_each_shard(shards, |shard, data| {
        let mean_part = &mean[shard * columns..(shard + 1) * columns];
        let sums: Vec<Vec<f32>> = products
            .blocks
            .par_chunks(per_part)
            .enumerate()
            .map_init(
                || FloatTile::new(columns),
                |tile, (part, blocks)| {
                    let mut sums = vec![0.0f32; width * columns];
                    for (i, block) in blocks.iter().enumerate() {
                        let first = (part * per_part + i) * size;
                        let count = size.min(texels - first);
                        shards.load(data, tile, first, count);
                        tile.centre(count, mean_part);
                        add_product_transposed(Rows::new(block, size), Rows::new(tile.data(), size), &mut sums);
                    }
                    sums
                },
            )
            .collect();
        for sums in sums {
            for (row, sums) in image.chunks_exact_mut(mean.len()).zip(sums.chunks_exact(columns)) {
                let out = &mut row[shard * columns..(shard + 1) * columns];
                out.iter_mut().zip(sums).for_each(|(out, &sum)| *out += f64::from(sum));
            }
        }
        Ok(())
    })?;
    Ok(image)
}

impl Products {
    /// Inner products of all pairs of rows.
    fn inner(&self, width: usize) -> Vec<f64> {
        let of_block = |block: &Vec<f32>| {
            let mut inner = vec![0.0f32; width * width];
            add_product_transposed(Rows::new(block, self.size), Rows::new(block, self.size), &mut inner);
            inner
        };
        let mut sum = vec![0.0; width * width];
        for some in self.blocks.chunks(TOGETHER) {
            let blocks: Vec<Vec<f32>> = some.par_iter().map(of_block).collect();
            for block in blocks {
                sum.iter_mut().zip(block).for_each(|(sum, v)| *sum += f64::from(v));
            }
        }
        sum
    }

    /// The turned products, (texel, component).
    fn by_texel(&self, turn: &[f32], width: usize, texels: usize) -> Vec<f32> {
        let count = turn.len() / width;
        let mut out = vec![0.0; texels * count];
        self.blocks.par_iter().zip(out.par_chunks_mut(self.size * count)).for_each(|(block, out)| {
            let mut turned = vec![0.0f32; count * self.size];
            add_product(Rows::new(turn, width), Rows::new(block, self.size), &mut turned);
            for (t, out) in out.chunks_exact_mut(count).enumerate() {
                out.iter_mut().enumerate().for_each(|(k, out)| *out = turned[k * self.size + t]);
            }
        });
        out
    }
}
