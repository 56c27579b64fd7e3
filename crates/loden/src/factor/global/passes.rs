//! The passes over a matrix, each a pure function of a range of units.
//!
//! # Model
//! Texels are in blocks, of as many as a tile holds, and blocks in [`Parts`]. Sums over texels are in single precision
//! within a block or part and in double precision beyond; the order of parts is fixed. A unit of [`Pass::Image`] is a part
//! of one shard, numbered part by part; a unit of the other passes is a part.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::start::{Subsample, pick};
use super::{Shards, for_each_shard};
use crate::factor::linalg::{Rows, add_product, add_product_transposed};
use crate::factor::products::{Factors, add_sums_over_texels};
use crate::factor::tile::FloatTile;
use crate::simd::wide;
use crate::stages::Piece;
use crate::{Error, Result};

/// Blocks of products whose inner products are held at once.
pub const BLOCKS_AT_ONCE: usize = 32;

/// Least number of parts, as far as there are blocks.
const PARTS: usize = 16;

/// Largest number of blocks in a part.
const BLOCKS: usize = 1024;

/// A pass over the matrix.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pass {
    /// The values of scattered texels: (texel, column).
    Pick {
        /// Number of texels in all.
        count: usize,
    },
    /// The products T with a basis, which are kept; their sums, and with `gather` the sum of squares and the sum of each column of the
    /// matrix, minus an offset. Arrays: offset, basis.
    Project {
        /// Texels of the subsample that the pass reads; all if none.
        few: Option<usize>,
        /// Whether sums of columns are computed.
        gather: bool,
    },
    /// The transposed matrix times the products: (component, column). Arrays: offset, means of the products.
    Image {
        /// As in [`Pass::Project`].
        few: Option<usize>,
        /// The stage that computed the products, and their number.
        products: (usize, usize),
    },
    /// Inner products of all pairs of products. Array: their means.
    Inner {
        /// Stages with their numbers of products.
        products: Vec<(usize, usize)>,
    },
    /// Products times the rows of a rotation: (texel, component). Arrays: their means, the rotation.
    Rotate {
        /// Stages with their numbers of products.
        products: Vec<(usize, usize)>,
    },
}

impl Pass {
    /// Whether the matrix is read, rather than products of it.
    pub fn reads(&self) -> bool {
        matches!(self, Self::Pick { .. } | Self::Project { .. } | Self::Image { .. })
    }

    /// Number of units for a matrix of so many shards, texels, and columns of each shard.
    pub fn units(&self, shards: usize, columns: usize, texels: usize) -> usize {
        let parts = |few: Option<usize>| Parts::new(columns, few.map_or(texels, Subsample::<()>::size)).count();
        match *self {
            Self::Image { few, .. } => shards * parts(few),
            Self::Project { few, .. } => parts(few),
            _ => parts(None),
        }
    }
}

/// Blocks of texels, and parts of several blocks.
#[derive(Debug, Clone, Copy)]
pub struct Parts {
    texels: usize,
    /// Texels of a block.
    size: usize,
    /// Blocks of a part.
    blocks: usize,
}

impl Parts {
    /// The parts of a matrix with so many columns in each shard.
    pub fn new(columns: usize, texels: usize) -> Self {
        let size = FloatTile::size(columns);
        Self { texels, size, blocks: texels.div_ceil(size).div_ceil(PARTS).clamp(1, BLOCKS) }
    }

    /// Number of parts.
    pub fn count(&self) -> usize {
        self.texels.div_ceil(self.size * self.blocks)
    }

    /// The texels of some parts.
    pub fn texels_of(&self, parts: Range<usize>) -> Range<usize> {
        let place = |part: usize| (part * self.blocks * self.size).min(self.texels);
        place(parts.start)..place(parts.end)
    }

    /// Numbers in the products of a part, blocks padded to their full size.
    pub fn padded(&self, part: usize, width: usize) -> usize {
        self.texels_of(part..part + 1).len().div_ceil(self.size) * self.size * width
    }
}

/// Finds what a unit of an earlier stage has kept.
pub type Kept<'a> = &'a (dyn Fn(usize, usize) -> Result<Arc<Vec<f32>>> + Sync);

/// Runs the units `units` of a pass. For each shard, and without one, `each` is called in ascending order of parts.
///
/// # Errors
/// Errors of the shards and of `each`; [`Error::Parameter`] if an array is missing.
pub fn run<S: Shards>(
    shards: &S,
    pass: &Pass,
    arrays: &[&[f64]],
    kept: Kept,
    units: Range<usize>,
    each: &mut dyn FnMut(usize, Piece) -> Result<()>,
) -> Result<()> {
    let array = |i: usize| {
        arrays.get(i).copied().ok_or_else(|| Error::parameter("stage", format!("array {i} of {pass:?} is missing")))
    };
    match pass {
        Pass::Pick { count } => pick(shards, *count, units, each),
        Pass::Project { few: None, gather } => project(shards, array(0)?, array(1)?, *gather, units, each),
        Pass::Project { few: Some(texels), gather } => {
            project(&Subsample::new(shards, *texels), array(0)?, array(1)?, *gather, units, each)
        }
        Pass::Image { few, products } => {
            let products = Centred { stages: &[*products], means: array(1)?, kept };
            match few {
                None => image(shards, array(0)?, &products, units, each),
                Some(texels) => image(&Subsample::new(shards, *texels), array(0)?, &products, units, each),
            }
        }
        Pass::Inner { products } => {
            inner(parts_of(shards), &Centred { stages: products, means: array(0)?, kept }, units, each)
        }
        Pass::Rotate { products } => {
            let rotation: Vec<f32> = array(1)?.iter().map(|&v| v as f32).collect();
            rotate(parts_of(shards), &Centred { stages: products, means: array(0)?, kept }, &rotation, units, each)
        }
    }
}

/// The parts of a matrix.
pub fn parts_of<S: Shards>(shards: &S) -> Parts {
    Parts::new(shards.columns(), shards.texels())
}

wide! {
    /// The sum of a row, and the sum of its squares.
    fn sums_of_row(row: &[f32]) -> [f32; 2] {
        // enough independent sums to hide the latency of an addition
        let mut lanes = [[0.0f32; 32]; 2];
        let (whole, rest) = row.as_chunks::<32>();
        for values in whole {
            for i in 0..32 {
                lanes[0][i] += values[i];
                lanes[1][i] += values[i] * values[i];
            }
        }
        let rest = [rest.iter().sum::<f32>(), rest.iter().map(|v| v * v).sum::<f32>()];
        [lanes[0].iter().sum::<f32>() + rest[0], lanes[1].iter().sum::<f32>() + rest[1]]
    }
}

/// [`Pass::Project`]: pieces are the sums of the products, then the sum of squares and the sums of columns.
fn project<S: Shards>(
    shards: &S,
    offset: &[f64],
    basis: &[f64],
    gather: bool,
    units: Range<usize>,
    each: &mut dyn FnMut(usize, Piece) -> Result<()>,
) -> Result<()> {
    let (columns, parts) = (shards.columns(), parts_of(shards));
    let (width, size) = (basis.len() / offset.len(), parts.size);
    let texels = parts.texels_of(units.clone());
    let mut products: Vec<Vec<f32>> = units.clone().map(|part| vec![0.0; parts.padded(part, width)]).collect();
    let gathered = if gather { 1 + offset.len() } else { 0 };
    let mut moments = vec![vec![0.0; gathered]; units.len()];
    for_each_shard(shards, 0..shards.count(), &|_| texels.clone(), |shard, data| {
        let range = shard * columns..(shard + 1) * columns;
        let factors = Factors::new(columns_of(basis, offset.len(), range.clone()), columns);
        let offset = &offset[range.clone()];
        let mut blocks: Vec<&mut [f32]> =
            products.iter_mut().flat_map(|part| part.chunks_exact_mut(width * size)).collect();
        // Multiply tile by tile
        let rows = blocks.par_iter_mut().enumerate().map_init(
            || FloatTile::new(columns),
            |tile, (i, block)| {
                let first = texels.start + i * size;
                shards.load(data, tile, first, size.min(texels.end - first), offset);
                factors.add_products(tile, block);
                if gather { tile.data().chunks_exact(size).map(sums_of_row).collect() } else { Vec::new() }
            },
        );
        // Accumulate the moments of each part in order, independent of the threads
        for (i, rows) in rows.collect::<Vec<Vec<[f32; 2]>>>().into_iter().enumerate().filter(|_| gather) {
            let (squares, sums) = moments[i / parts.blocks].split_first_mut().expect("a sum of squares");
            for (sum, row) in sums[range.clone()].iter_mut().zip(rows) {
                *sum += f64::from(row[0]);
                *squares += f64::from(row[1]);
            }
        }
        Ok(())
    })?;
    for ((unit, kept), moments) in units.zip(products).zip(moments) {
        let blocks = || kept.chunks_exact(width * size);
        let sum = |k: usize| blocks().map(|block| f64::from(sums_of_row(&block[k * size..][..size])[0])).sum::<f64>();
        let doubles = (0..width).map(sum).chain(moments).collect();
        each(unit, Piece { doubles, kept, ..Piece::default() })?;
    }
    Ok(())
}

/// A range of columns of rows of length `len`, in single precision.
fn columns_of(rows: &[f64], len: usize, range: Range<usize>) -> Vec<f32> {
    rows.chunks_exact(len).flat_map(|row| row[range.clone()].iter().map(|&v| v as f32)).collect()
}

/// [`Pass::Image`]: a piece has the sums over a part for the columns of one shard. If the products have a mean of zero, the
/// mean of the matrix does not matter.
fn image<S: Shards>(
    shards: &S,
    offset: &[f64],
    products: &Centred,
    units: Range<usize>,
    each: &mut dyn FnMut(usize, Piece) -> Result<()>,
) -> Result<()> {
    let (columns, count, parts) = (shards.columns(), shards.count(), parts_of(shards));
    let (width, size) = (products.width(), parts.size);
    // the parts of a shard within the units
    let parts_of = |shard: usize| {
        let place = |unit: usize| (unit + count - 1).saturating_sub(shard) / count;
        place(units.start)..place(units.end)
    };
    let all = units.start / count..units.end.div_ceil(count);
    let centred: Vec<Vec<f32>> =
        all.clone().into_par_iter().map(|part| products.part(parts, part)).collect::<Result<_>>()?;
    for_each_shard(shards, 0..count, &|shard| parts.texels_of(parts_of(shard)), |shard, data| {
        let offset = &offset[shard * columns..(shard + 1) * columns];
        let of_part = |tile: &mut FloatTile, part: usize| {
            let texels = parts.texels_of(part..part + 1);
            let mut sums = vec![0.0f32; width * columns];
            for (i, block) in centred[part - all.start].chunks_exact(width * size).enumerate() {
                let first = texels.start + i * size;
                shards.load(data, tile, first, size.min(texels.end - first), offset);
                add_sums_over_texels(block, tile, &mut sums);
            }
            sums
        };
        let sums: Vec<Vec<f32>> =
            parts_of(shard).into_par_iter().map_init(|| FloatTile::new(columns), of_part).collect();
        for (part, floats) in parts_of(shard).zip(sums) {
            each(part * count + shard, Piece { floats, ..Piece::default() })?;
        }
        Ok(())
    })
}

/// Products of several stages, from which their means are subtracted.
struct Centred<'a> {
    stages: &'a [(usize, usize)],
    means: &'a [f64],
    kept: Kept<'a>,
}

impl Centred<'_> {
    fn width(&self) -> usize {
        self.stages.iter().map(|(_, width)| width).sum()
    }

    /// The products of a part, in blocks of (component, texel of the block).
    fn part(&self, parts: Parts, part: usize) -> Result<Vec<f32>> {
        let (width, size, texels) = (self.width(), parts.size, parts.texels_of(part..part + 1).len());
        let mut out = vec![0.0; parts.padded(part, width)];
        let mut begin = 0;
        for &(stage, count) in self.stages {
            let kept = (self.kept)(stage, part)?;
            if kept.len() != parts.padded(part, count) {
                return Err(Error::parameter("stage", format!("stage {stage} has kept another number of products")));
            }
            for (i, (out, block)) in out.chunks_exact_mut(width * size).zip(kept.chunks_exact(count * size)).enumerate()
            {
                let valid = size.min(texels - i * size);
                for (k, row) in block.chunks_exact(size).enumerate() {
                    let mean = self.means[begin + k] as f32;
                    let out = &mut out[(begin + k) * size..][..size];
                    out.copy_from_slice(row);
                    out[..valid].iter_mut().for_each(|v| *v -= mean);
                }
            }
            begin += count;
        }
        Ok(out)
    }
}

/// [`Pass::Inner`].
fn inner(
    parts: Parts,
    products: &Centred,
    units: Range<usize>,
    each: &mut dyn FnMut(usize, Piece) -> Result<()>,
) -> Result<()> {
    let (width, size) = (products.width(), parts.size);
    let of_block = |block: &&[f32]| {
        let mut inner = vec![0.0f32; width * width];
        add_product_transposed(Rows::new(block, size), Rows::new(block, size), &mut inner);
        inner
    };
    for unit in units {
        let part = products.part(parts, unit)?;
        let blocks: Vec<&[f32]> = part.chunks_exact(width * size).collect();
        let mut doubles = vec![0.0; width * width];
        for batch in blocks.chunks(BLOCKS_AT_ONCE) {
            for block in batch.par_iter().map(of_block).collect::<Vec<Vec<f32>>>() {
                doubles.iter_mut().zip(block).for_each(|(sum, v)| *sum += f64::from(v));
            }
        }
        each(unit, Piece { doubles, ..Piece::default() })?;
    }
    Ok(())
}

/// [`Pass::Rotate`].
fn rotate(
    parts: Parts,
    products: &Centred,
    rotation: &[f32],
    units: Range<usize>,
    each: &mut dyn FnMut(usize, Piece) -> Result<()>,
) -> Result<()> {
    let (width, size) = (products.width(), parts.size);
    let count = rotation.len() / width;
    for unit in units {
        let part = products.part(parts, unit)?;
        let mut floats = vec![0.0; parts.texels_of(unit..unit + 1).len() * count];
        part.par_chunks_exact(width * size).zip(floats.par_chunks_mut(size * count)).for_each(|(block, out)| {
            let mut rotated = vec![0.0f32; count * size];
            add_product(Rows::new(rotation, width), Rows::new(block, size), &mut rotated);
            for (t, out) in out.chunks_exact_mut(count).enumerate() {
                out.iter_mut().enumerate().for_each(|(k, out)| *out = rotated[k * size + t]);
            }
        });
        each(unit, Piece { floats, ..Piece::default() })?;
    }
    Ok(())
}
