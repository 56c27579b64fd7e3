//! The first principal components of a matrix that is too large for memory, read in shards of columns.
//!
//! # Model
//! A row of the matrix M is a texel, a column a light and channel of a view; a shard holds the columns of one view. Some
//! hundred scattered texels, in all shards, give a first basis V of some more columns than are wanted. A round of
//! subspace iteration is two passes: T = M V (the sum over shards) and the image M^T T (shard by shard). The Ritz pairs
//! of V tell what a further round, from the span of the image, could still gain. The first round is made over a quarter
//! of the texels. What follows depends on how many these are:
//!
//! - 1024 or more for each component: they stand for all. Rounds over them end when a further one would gain less than
//!   1/200 of the energy that is left out. One pass over all texels then tells T, whose singular triplets are those of M
//!   within the span of V.
//! - Fewer: rounds over all texels end at a thousandth of that energy. With the orthonormal Q that spans the columns of T,
//!   the image tells Q^T M, whose singular triplets are the result.
//!
//! # Limits
//! A quarter of the texels misses what the others do differently. For 16 components of 256 x 256 texels, what is left out
//! was 0.0018 of itself more than the least possible. The order to expect, if texels are independent, is the number of
//! components over that of these texels.
//! Memory: the products T (texels x columns of the basis) in single precision, the scattered texels, and as many shards
//! as there are threads. Products are summed in single precision. After three rounds the result is taken as it
//! is: components within a flat spectrum, as of noise, then miss some per cent of what is left out.
//!
//! # References
//! halko2011

mod passes;
mod start;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use passes::{TOGETHER, image, project};
use start::{Start, Thinned};

use super::linalg::{Eigen, combine_rows, largest_eigenpairs};
use super::principal::Ritz;
use super::tile::FloatTile;
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

    /// Loads `count` rows from `first` into a tile, a row for each column of the matrix, less a number for each column
    /// (nothing where `less` ends).
    fn load(&self, shard: &Self::Shard<'_>, tile: &mut FloatTile, first: usize, count: usize, less: &[f64]);

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

/// Rounds of two passes each, over all texels.
const ROUNDS: usize = 3;

/// What a further round may gain, as a fraction of the energy left out.
const TOLERANCE: f64 = 1e-3;

/// Before them comes a round over one in so many texels, if these are at least [`THINNED`].
const THIN: usize = 4;
const THINNED: usize = 4096;

/// For each component, so many of these texels tell what all do.
const SAMPLE: usize = 1024;

/// What a further round over them may gain then.
const SAMPLE_TOLERANCE: f64 = 5e-3;

/// Passes over the matrix that one call makes at most: the scattered texels, a round over some, those over all, and
/// another where Q^T M is of a lower rank than wanted.
pub const PASSES: usize = 2 * ROUNDS + 4;

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
    (width, (8 * width).max(512).min(limit))
}

/// A bound of the memory, bytes, that [`principal_components`] and its result take beside the shards.
pub fn memory(columns: usize, texels: usize, count: usize) -> u64 {
    let (width, sampled) = sizes(count, columns.min(texels));
    // the sample, its inner products and their eigenvectors; or products, their inner ones, and the result
    let first = 4 * sampled * columns + 40 * sampled * sampled;
    let rounds = 4 * (texels * (width + count) + TOGETHER * width * width);
    // the basis, its image and what they are turned to
    (first.max(rounds) + 56 * width * columns) as u64
}

fn components<S: Shards>(shards: &S, count: usize, centred: bool) -> Result<Option<Global>> {
    let columns = shards.columns() * shards.count();
    let limit = columns.min(shards.texels());
    let (width, sampled) = sizes(count, limit);
    let Some(start) = Start::new(shards, sampled, width, centred)? else { return Ok(None) };
    let Start { less, mut basis } = start;
    if shards.texels() >= THIN * THINNED {
        let thin = Thinned::new(shards, shards.texels() / THIN);
        let enough = thin.texels() >= SAMPLE * count;
        for _ in 0..if enough { ROUNDS } else { 1 } {
            let (products, moments) = project(&thin, &less, &basis, true, centred)?;
            let image = image(&thin, &less, &products, width)?;
            let Some(ritz) = Ritz::new(&basis, &image, columns) else { return Ok(None) };
            let (_, energy) = moments.mean_and_energy(&less, thin.texels(), centred);
            let settled = ritz.settled(SAMPLE_TOLERANCE, count, columns, 2, energy);
            basis = ritz.next_basis(columns);
            if settled {
                break;
            }
        }
        if enough {
            return turned(shards, &less, &basis, count, centred);
        }
    }
    let mut gathered = None;
    let mut rounds = ROUNDS;
    loop {
        let (products, moments) = project(shards, &less, &basis, gathered.is_none(), centred)?;
        let (mean, energy) = gathered.get_or_insert_with(|| moments.mean_and_energy(&less, shards.texels(), centred));
        let image = image(shards, &less, &products, width)?;
        let Some(ritz) = Ritz::new(&basis, &image, columns) else { return Ok(None) };
        // a basis of all dimensions cannot be improved
        let settled = width == limit || ritz.settled(TOLERANCE, count, columns, 1, *energy);
        rounds -= 1;
        if settled || rounds == 0 {
            let (mean, energy) = (std::mem::take(mean), *energy);
            return match products.triplets(&image, columns, count, shards.texels()) {
                Some((basis, coefficients)) => Ok(Some(Global { mean, basis, coefficients, energy })),
                None => turned(shards, &less, &ritz.into_vectors(), count, centred),
            };
        }
        basis = ritz.next_basis(columns);
    }
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
    let Some(start) = Start::new(shards, (8 * width).max(512).min(limit), width, true)? else { return Ok(None) };
    turned(shards, &start.less, &start.basis, count, true)
}

/// The components within the span of `basis`, and their coefficients, in one pass.
fn turned<S: Shards>(shards: &S, less: &[f64], basis: &[f64], count: usize, centred: bool) -> Result<Option<Global>> {
    let columns = less.len();
    let width = basis.len() / columns;
    let (products, moments) = project(shards, less, basis, true, centred)?;
    let (mean, energy) = moments.mean_and_energy(less, shards.texels(), centred);
    let Some(Eigen { vectors: turn, .. }) = largest_eigenpairs(&products.inner(), width, count) else {
        return Ok(None);
    };
    let turned = combine_rows(&turn, basis, columns);
    let (basis, coefficients) = products.upright(turned, turn, columns, shards.texels());
    Ok(Some(Global { coefficients, mean, basis, energy }))
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
