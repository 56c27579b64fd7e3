//! Principal components of a matrix that is too large for memory, read in shards of columns.
//!
//! Use it for components of all views together; [`super::principal`] is faster for the images of one view.
//!
//! # Model
//! A row of the matrix M is a texel, a column is one channel of one image; a shard holds the columns of one view. A few
//! hundred scattered texels give the first basis V, which has some more rows than components are wanted. A round takes
//! two passes over the shards: the products T = M V^T, and their image M^T T, which is the basis multiplied by the
//! scatter matrix. The Ritz pairs of a basis and its image estimate what further rounds can still gain. The first rounds
//! see a quarter of the texels. The rest depends on how many texels that is:
//!
//! - With at least 1024 texels per component, the quarter represents the whole. Rounds over it end when another one would
//!   gain less than 1/200 of the energy that is left out. One pass over all texels then gives T, whose singular vectors
//!   are those of M within the span of V.
//! - With fewer, rounds over all texels follow. With the orthonormal Q that spans the columns of T, the image gives
//!   Q^T M, whose singular vectors are the result. [`principal_components`] and [`singular_components`] add the image of
//!   every round to the basis (a block Krylov space) until the singular values are exact to 5e-4 and the squared error to
//!   1e-3. [`rough_components`] keeps the last image only (subspace iteration) and stops after three rounds; it serves
//!   codecs that quantise the result anyway.
//!
//! # Limits
//! A quarter of the texels misses what only the other texels show: for 16 components of 256 x 256 texels, the squared
//! error was 0.18 % above the least possible. For independent texels the expected excess is the number of components
//! divided by the number of texels in the quarter. Rounds also end after six, or when the images add nothing to the
//! basis. Products are summed in single precision.
//!
//! Memory: the products of all rounds (texels x rows of the basis) in single precision, the scattered texels, and one
//! shard per thread.
//!
//! The algorithm only asks for [`passes`] and combines their small results ([`Passes`]): it does not know whether this process
//! or others read the matrix.
//!
//! # References
//! halko2011, musco2015

pub mod passes;
mod products;
mod rounds;
mod start;
#[cfg(test)]
mod tests;

use std::ops::Range;

use rayon::prelude::*;

pub use passes::Pass;
use passes::{BLOCKS_AT_ONCE, Parts};
use products::Scope;
use start::Start;

use super::linalg::{Eigen, combine_rows, largest_eigenpairs};
use super::tile::{FloatTile, STEP};
use crate::Result;
use crate::stages::Piece;

/// A matrix in shards of columns.
pub trait Shards: Sync {
    /// A shard in memory.
    type Shard<'a>: Sync + Send
    where
        Self: 'a;

    /// Number of shards.
    fn count(&self) -> usize;

    /// Columns of each shard.
    fn columns(&self) -> usize;

    /// Rows of the matrix.
    fn texels(&self) -> usize;

    /// Reads some texels of a shard; called once per pass and shard, from several threads.
    ///
    /// # Errors
    /// Errors of the source.
    fn read(&self, shard: usize, texels: Range<usize>) -> Result<Self::Shard<'_>>;

    /// Loads `count` texels from `first`, which were read, into a tile with a row per column of the shard, and subtracts `offset` from
    /// each row as far as it goes.
    fn load(&self, shard: &Self::Shard<'_>, tile: &mut FloatTile, first: usize, count: usize, offset: &[f64]);

    /// Tells the source that the caller is done with a shard for now.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    fn done(&self, shard: usize) -> Result<()>;
}

/// Runs passes over a matrix, wherever its texels are read.
pub trait Passes {
    /// Number of shards.
    fn shards(&self) -> usize;

    /// Columns of all shards together.
    fn columns(&self) -> usize;

    /// Rows of the matrix.
    fn texels(&self) -> usize;

    /// Runs all units of a pass and calls `each` with their pieces, for each shard in ascending order of parts. Returns a
    /// number by which later passes find what was kept.
    ///
    /// # Errors
    /// Errors of the source and of `each`.
    fn run(&self, pass: &Pass, arrays: &[&[f64]], each: Receive) -> Result<usize>;

    /// What this pass has kept is not needed any more.
    fn forget(&self, pass: usize);
}

/// Receives the piece of a unit.
pub type Receive<'a> = &'a mut (dyn FnMut(usize, Piece) -> Result<()> + Send);

/// Mean, basis and coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct Global {
    /// (column of the matrix)
    pub mean: Vec<f64>,
    /// (component, column of the matrix): unit vectors, largest variance first. The entry of largest magnitude of each is
    /// positive.
    pub basis: Vec<f64>,
    /// (texel, component)
    pub coefficients: Vec<f32>,
    /// Sum of squares of the matrix after the mean is subtracted.
    pub energy: f64,
}

/// A quarter of the texels is used first if that is at least [`MIN_SUBSAMPLE`] texels.
const SUBSAMPLE: usize = 4;
const MIN_SUBSAMPLE: usize = 4096;

/// Number of texels per component above which a subsample represents all texels.
const TEXELS_PER_COMPONENT: usize = 1024;

/// Maximum number of rounds over a subsample.
const SUBSAMPLE_ROUNDS: usize = 3;

/// Maximum number of passes over the matrix in [`principal_components`] and [`singular_components`]: the scattered
/// texels, a round over the subsample, the rounds over all texels, and one more if the rank is below the number of
/// components.
pub const PASSES: usize = 2 * rounds::KRYLOV_ROUNDS + 4;

/// Maximum number of passes over the matrix in [`rough_components`].
pub const ROUGH_PASSES: usize = 2 * rounds::SUBSPACE_ROUNDS + 4;

/// The first `count` principal components; `None` if a number is not finite.
///
/// # Errors
/// Errors of the passes.
pub fn principal_components<P: Passes>(passes: &P, count: usize) -> Result<Option<Global>> {
    components(passes, count, true, rounds::krylov)
}

/// The first `count` singular vectors: [`principal_components`] without subtracting the mean, which is returned as 0.
///
/// # Errors
/// Errors of the passes.
pub fn singular_components<P: Passes>(passes: &P, count: usize) -> Result<Option<Global>> {
    components(passes, count, false, rounds::krylov)
}

/// Principal components for results that are quantised: three rounds at most, so the last components of a flat spectrum,
/// such as noise, can miss a few per cent of what is left out.
///
/// # Errors
/// Errors of the passes.
pub fn rough_components<P: Passes>(passes: &P, count: usize) -> Result<Option<Global>> {
    components(passes, count, true, rounds::subspace)
}

/// Rows of the basis, and scattered texels, for `count` components of a matrix of rank `limit` at most.
fn sizes(count: usize, limit: usize) -> (usize, usize) {
    let width = (count + (count / 4).max(8)).min(limit);
    (width, (8 * width).max(512).min(limit))
}

/// Texels of the subsample, if there is one, and whether it represents all texels.
fn subsample(texels: usize, count: usize) -> (Option<usize>, bool) {
    let few = texels / SUBSAMPLE;
    let texels = (texels >= SUBSAMPLE * MIN_SUBSAMPLE).then_some(few);
    (texels, texels.is_some() && few / STEP * STEP >= TEXELS_PER_COMPONENT * count)
}

/// Upper bound of the memory, in bytes, of [`principal_components`] and its result, shards excluded.
pub fn memory(columns: usize, texels: usize, count: usize) -> u64 {
    let blocks = if subsample(texels, count).1 { 1 } else { rounds::KRYLOV_ROUNDS };
    bytes(columns, texels, count, blocks)
}

/// Upper bound of the memory, in bytes, of [`rough_components`] or [`sketched_components`] and the result, shards
/// excluded.
pub fn rough_memory(columns: usize, texels: usize, count: usize) -> u64 {
    bytes(columns, texels, count, 1)
}

/// Memory of a basis with this many blocks.
fn bytes(columns: usize, texels: usize, count: usize, blocks: usize) -> u64 {
    let limit = columns.min(texels);
    let (width, sampled) = sizes(count, limit);
    let all = (blocks * width).min(limit);
    // the sample, its inner products and their eigenvectors; later the products, those of one block or of the result
    // centred, and their inner products
    let start = 4 * sampled * columns + 40 * sampled * sampled;
    let rounds = 4 * (texels * (all + width.max(count)) + BLOCKS_AT_ONCE * all * all);
    // sums of columns in each part
    let rounds = rounds + 8 * Parts::new(columns, texels).count() * columns;
    // the basis, its image and their rotations
    (start.max(rounds) + (16 * all + 40 * width) * columns) as u64
}

/// Runs the rounds over all texels, given the first basis and the number of components.
type Rounds<P> = fn(&Scope<P>, Vec<f64>, usize) -> Result<Option<Global>>;

fn components<P: Passes>(passes: &P, count: usize, centred: bool, rounds: Rounds<P>) -> Result<Option<Global>> {
    let limit = passes.columns().min(passes.texels());
    let (width, sampled) = sizes(count, limit);
    let Some(Start { offset, mut basis }) = Start::new(passes, sampled, width, centred)? else { return Ok(None) };
    let all = Scope { passes, offset: &offset, centred, few: None };
    if let (Some(texels), represents) = subsample(passes.texels(), count) {
        let few = Scope { few: Some(texels), ..all };
        let rounds = if represents { SUBSAMPLE_ROUNDS } else { 1 };
        let Some(improved) = rounds::improve(&few, basis, count, rounds)? else { return Ok(None) };
        if represents {
            return within_span(&all, &improved, count);
        }
        basis = improved;
    }
    rounds(&all, basis, count)
}

/// Passes over the matrix that [`sketched_components`] makes.
pub const SKETCH_PASSES: usize = 2;

/// Orthonormal directions within the span of a few hundred scattered texels: they capture nearly as much energy as
/// [`principal_components`], in two passes. At most as many as the rank.
///
/// # Errors
/// Errors of the passes.
pub fn sketched_components<P: Passes>(passes: &P, count: usize) -> Result<Option<Global>> {
    let limit = passes.columns().min(passes.texels());
    let count = count.min(limit);
    let width = (count + 8).min(limit);
    let Some(start) = Start::new(passes, (8 * width).max(512).min(limit), width, true)? else { return Ok(None) };
    within_span(&Scope { passes, offset: &start.offset, centred: true, few: None }, &start.basis, count)
}

/// The principal components within the span of `basis`, and their coefficients, in one pass.
fn within_span<P: Passes>(all: &Scope<P>, basis: &[f64], count: usize) -> Result<Option<Global>> {
    let columns = all.offset.len();
    let width = basis.len() / columns;
    let (products, moments) = all.project(basis, true)?;
    let moments = moments.mean_and_energy(all.offset, all.texels(), all.centred);
    let inner = products.inner(all.passes)?;
    let Some(Eigen { vectors: rotation, .. }) = largest_eigenpairs(&inner, width, count) else { return Ok(None) };
    let rotated = combine_rows(&rotation, basis, columns);
    products.finish(all.passes, rotated, rotation, moments).map(Some)
}

/// Calls `f` with each of the shards that has `texels`, in order. Reads as many shards at once as there are threads.
fn for_each_shard<S: Shards>(
    shards: &S,
    which: Range<usize>,
    texels: &(dyn Fn(usize) -> Range<usize> + Sync),
    mut f: impl FnMut(usize, &S::Shard<'_>) -> Result<()>,
) -> Result<()> {
    let all: Vec<usize> = which.filter(|&shard| !texels(shard).is_empty()).collect();
    for batch in all.chunks(rayon::current_num_threads()) {
        let read: Result<Vec<_>> = batch.par_iter().map(|&shard| shards.read(shard, texels(shard))).collect();
        for (&shard, data) in batch.iter().zip(&read?) {
            f(shard, data)?;
            shards.done(shard)?;
        }
    }
    Ok(())
}
