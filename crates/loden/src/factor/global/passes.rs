//! The two passes of a round: the products of a matrix with a basis, and the image of the products.

use std::ops::Range;

use rayon::prelude::*;

use super::{Shards, for_each_shard};
use crate::Result;
use crate::factor::linalg::{
    Eigen, Rows, add_product, add_product_transposed, combine_rows, fix_sign, largest_eigenpairs,
    product_with_transposed,
};
use crate::factor::products::{Factors, add_sums_over_texels};
use crate::factor::tile::{FloatTile, Tile};
use crate::simd::wide;

/// Blocks of products whose inner products are held at once.
pub const BLOCKS_AT_ONCE: usize = 32;

/// Parts of the texels that are summed separately; a fixed number, so that threads do not change the result.
const PARTS: usize = 16;

/// Eigenvalue, relative to the largest, below which a direction counts as dependent on the others: single precision.
const DEPENDENT: f64 = 1e-6;

/// The sum of each column minus its offset, and the sum of all their squares.
pub struct Moments {
    sums: Vec<f64>,
    squares: f64,
}

impl Moments {
    /// The mean of each column and the sum of squared deviations from it; a mean of 0 unless `centred`.
    pub fn mean_and_energy(&self, offset: &[f64], texels: usize, centred: bool) -> (Vec<f64>, f64) {
        if !centred {
            return (vec![0.0; offset.len()], self.squares);
        }
        let off: Vec<f64> = self.sums.iter().map(|sum| sum / texels as f64).collect();
        let energy = self.squares - texels as f64 * off.iter().map(|v| v * v).sum::<f64>();
        (off.iter().zip(offset).map(|(off, offset)| offset + off).collect(), energy)
    }
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

/// The products T of the matrix with the rows of a basis, in blocks of (component, texel of the block).
pub struct Products {
    blocks: Vec<Vec<f32>>,
    size: usize,
    width: usize,
}

/// Multiplies the matrix, minus `offset`, by the rows of `basis`, and subtracts the mean of each product if `centred`.
/// Computes the moments if `gather`.
pub fn project<S: Shards>(
    shards: &S,
    offset: &[f64],
    basis: &[f64],
    gather: bool,
    centred: bool,
) -> Result<(Products, Moments)> {
    let (columns, texels) = (shards.columns(), shards.texels());
    let width = basis.len() / offset.len();
    let size = FloatTile::new(columns).texels();
    let mut blocks = vec![vec![0.0f32; width * size]; texels.div_ceil(size)];
    let mut moments = Moments { sums: vec![0.0; if gather { offset.len() } else { 0 }], squares: 0.0 };
    for_each_shard(shards, |shard, data| {
        let range = shard * columns..(shard + 1) * columns;
        let factors = Factors::new(columns_of(basis, offset.len(), range.clone()), columns);
        let offset = &offset[range.clone()];
        // Multiply tile by tile
        let each = blocks.par_iter_mut().enumerate().map_init(
            || FloatTile::new(columns),
            |tile, (i, block)| {
                let count = size.min(texels - i * size);
                shards.load(data, tile, i * size, count, offset);
                factors.add_products(tile, block);
                if gather { tile.data().chunks_exact(size).map(sums_of_row).collect() } else { Vec::new() }
            },
        );
        // Accumulate the moments in order, independent of the threads
        for rows in each.collect::<Vec<Vec<[f32; 2]>>>() {
            for (sum, row) in moments.sums[if gather { range.clone() } else { 0..0 }].iter_mut().zip(rows) {
                *sum += f64::from(row[0]);
                moments.squares += f64::from(row[1]);
            }
        }
        Ok(())
    })?;
    let mut products = Products { blocks, size, width };
    if centred {
        products.centre(texels);
    }
    Ok((products, moments))
}

/// A range of columns of rows of length `len`, in single precision.
fn columns_of(rows: &[f64], len: usize, range: Range<usize>) -> Vec<f32> {
    rows.chunks_exact(len).flat_map(|row| row[range.clone()].iter().map(|&v| v as f32)).collect()
}

/// The transposed matrix times the products: (component, column). If the products have a mean of zero, the mean of the
/// matrix does not matter.
pub fn image<S: Shards>(shards: &S, offset: &[f64], products: &Products, width: usize) -> Result<Vec<f64>> {
    let (columns, texels, size) = (shards.columns(), shards.texels(), products.size);
    let mut image = vec![0.0; width * offset.len()];
    let per_part = products.blocks.len().div_ceil(PARTS);
    for_each_shard(shards, |shard, data| {
        let range = shard * columns..(shard + 1) * columns;
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
                        shards.load(data, tile, first, size.min(texels - first), &offset[range.clone()]);
                        add_sums_over_texels(block, tile, &mut sums);
                    }
                    sums
                },
            )
            .collect();
        for sums in sums {
            for (row, sums) in image.chunks_exact_mut(offset.len()).zip(sums.chunks_exact(columns)) {
                row[range.clone()].iter_mut().zip(sums).for_each(|(out, &sum)| *out += f64::from(sum));
            }
        }
        Ok(())
    })?;
    Ok(image)
}

impl Products {
    /// Appends the rows of `other`, which has the same texels.
    pub fn append(&mut self, other: Self) {
        self.width += other.width;
        self.blocks.iter_mut().zip(other.blocks).for_each(|(block, other)| block.extend(other));
    }

    /// Subtracts the mean of each row.
    fn centre(&mut self, texels: usize) {
        let size = self.size;
        for k in 0..self.width {
            let row = k * size..(k + 1) * size;
            let sum: f64 = self.blocks.iter().map(|block| f64::from(sums_of_row(&block[row.clone()])[0])).sum();
            let mean = (sum / texels as f64) as f32;
            for (i, block) in self.blocks.iter_mut().enumerate() {
                block[row.clone()].iter_mut().take(texels - i * size).for_each(|v| *v -= mean);
            }
        }
    }

    /// Inner products of all pairs of rows.
    pub fn inner(&self) -> Vec<f64> {
        let width = self.width;
        let of_block = |block: &Vec<f32>| {
            let mut inner = vec![0.0f32; width * width];
            add_product_transposed(Rows::new(block, self.size), Rows::new(block, self.size), &mut inner);
            inner
        };
        let mut sum = vec![0.0; width * width];
        for batch in self.blocks.chunks(BLOCKS_AT_ONCE) {
            let blocks: Vec<Vec<f32>> = batch.par_iter().map(of_block).collect();
            for block in blocks {
                sum.iter_mut().zip(block).for_each(|(sum, v)| *sum += f64::from(v));
            }
        }
        sum
    }

    /// The first `count` singular vectors of Q^T M, where the orthonormal Q spans the columns of the products T,
    /// computed from T^T M: right singular vectors, and coefficients (texel, component). `None` if the rank is lower.
    pub fn triplets(&self, image: &[f64], columns: usize, count: usize, texels: usize) -> Option<(Vec<f64>, Vec<f32>)> {
        let (width, inner) = (self.width, self.inner());
        // normalise first: the columns of T differ in length by orders of magnitude
        let scale: Vec<f64> = (0..width).map(|k| inner[k * width + k].max(f64::MIN_POSITIVE).sqrt().recip()).collect();
        let directions: Vec<f64> =
            inner.iter().enumerate().map(|(i, v)| v * scale[i / width] * scale[i % width]).collect();
        let Eigen { values, mut vectors } = largest_eigenpairs(&directions, width, width)?;
        for (vector, value) in vectors.chunks_exact_mut(width).zip(&values) {
            // leave out directions that depend on others
            let factor = if *value > DEPENDENT * values[0] { value.sqrt().recip() } else { 0.0 };
            vector.iter_mut().zip(&scale).for_each(|(v, scale)| *v *= factor * scale);
        }
        let projected = combine_rows(&vectors, image, columns);
        let Eigen { values, vectors: rotation } =
            largest_eigenpairs(&product_with_transposed(&projected, &projected, columns), width, count)?;
        if values[count - 1] <= DEPENDENT * DEPENDENT * values[0] || values[0] <= f64::MIN_POSITIVE {
            return None;
        }
        let scaled = |power: f64| -> Vec<f64> {
            rotation.iter().enumerate().map(|(i, v)| v * values[i / width].powf(power)).collect()
        };
        let basis = combine_rows(&scaled(-0.5), &projected, columns);
        let rotation = combine_rows(&scaled(0.5), &vectors, width);
        Some(self.with_signs_fixed(basis, rotation, columns, texels))
    }

    /// Fixes the signs of the rows of `basis`, and applies `rotation` to the products with the same signs.
    pub fn with_signs_fixed(
        &self,
        mut basis: Vec<f64>,
        mut rotation: Vec<f64>,
        columns: usize,
        texels: usize,
    ) -> (Vec<f64>, Vec<f32>) {
        for (row, rotation) in basis.chunks_exact_mut(columns).zip(rotation.chunks_exact_mut(self.width)) {
            if fix_sign(row) {
                rotation.iter_mut().for_each(|v| *v = -*v);
            }
        }
        let rotation: Vec<f32> = rotation.iter().map(|&v| v as f32).collect();
        (basis, self.rotated(&rotation, texels))
    }

    /// The products times the rows of `rotation`: (texel, component).
    fn rotated(&self, rotation: &[f32], texels: usize) -> Vec<f32> {
        let count = rotation.len() / self.width;
        let mut out = vec![0.0; texels * count];
        self.blocks.par_iter().zip(out.par_chunks_mut(self.size * count)).for_each(|(block, out)| {
            let mut rotated = vec![0.0f32; count * self.size];
            add_product(Rows::new(rotation, self.width), Rows::new(block, self.size), &mut rotated);
            for (t, out) in out.chunks_exact_mut(count).enumerate() {
                out.iter_mut().enumerate().for_each(|(k, out)| *out = rotated[k * self.size + t]);
            }
        });
        out
    }
}
