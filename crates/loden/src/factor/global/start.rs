//! The first basis, from scattered texels, and a subsample of texels for the first rounds.

use std::ops::Range;

use rayon::prelude::*;

use super::passes::parts_of;
use super::{Pass, Passes, Shards, for_each_shard};
use crate::Result;
use crate::factor::linalg::{Rows, add_product, add_product_transposed, largest_eigenpairs, orthonormal_rows};
use crate::factor::tile::{FloatTile, STEP, Tile};
use crate::stages::Piece;

/// Rows of the matrix of inner products that one task computes.
const STRIP: usize = 32;

/// Offset and first basis, from scattered texels.
pub struct Start {
    /// Mean of each column in single precision, or zeros. It is subtracted from all texels, so that products lose no
    /// digits to it.
    pub offset: Vec<f64>,
    /// Right singular vectors of the scattered texels, row by row, then fixed noise up to the full number of rows.
    pub basis: Vec<f64>,
}

impl Start {
    pub fn new<P: Passes>(passes: &P, count: usize, width: usize, centred: bool) -> Result<Option<Self>> {
        let columns = passes.columns();
        let mut sample = Vec::with_capacity(count * columns);
        passes.run(&Pass::Pick { count }, &[], &mut |_, piece| {
            sample.extend(piece.floats);
            Ok(())
        })?;
        let mut offset = vec![0.0; columns];
        if centred {
            let mut sums = vec![0.0; columns];
            for row in sample.chunks_exact(columns) {
                sums.iter_mut().zip(row).for_each(|(sum, &v)| *sum += f64::from(v));
            }
            offset.iter_mut().zip(&sums).for_each(|(mean, sum)| *mean = f64::from((sum / count as f64) as f32));
        }
        for row in sample.chunks_exact_mut(columns) {
            row.iter_mut().zip(&offset).for_each(|(v, &offset)| *v -= offset as f32);
        }
        Ok(first_basis(&sample, columns, width).map(|basis| Self { offset, basis }))
    }
}

/// A pseudo-random texel in the `i`-th of `count` equal parts.
fn scattered(i: usize, count: usize, texels: usize) -> usize {
    let (begin, end) = (i * texels / count, (i + 1) * texels / count);
    begin + (i.wrapping_mul(0x9E37_79B9) >> 7) % (end - begin).max(1)
}

/// [`Pass::Pick`]: a piece has the scattered texels of a part.
pub fn pick<S: Shards>(
    shards: &S,
    count: usize,
    units: Range<usize>,
    each: &mut dyn FnMut(usize, Piece) -> Result<()>,
) -> Result<()> {
    let (columns, parts) = (shards.columns(), parts_of(shards));
    let all = columns * shards.count();
    let texels = parts.texels_of(units.clone());
    let places: Vec<usize> = (0..count).map(|i| scattered(i, count, shards.texels())).collect();
    let within = |texels: Range<usize>| places.iter().copied().filter(move |place| texels.contains(place));
    let wanted: Vec<usize> = within(texels.clone()).collect();
    let mut sample = vec![0.0f32; wanted.len() * all];
    for_each_shard(shards, 0..shards.count(), &|_| texels.clone(), |shard, data| {
        sample.par_chunks_mut(all).zip(&wanted).for_each_init(
            || FloatTile::narrow(columns),
            |tile, (out, &place)| {
                shards.load(data, tile, place, 1, &[]);
                let firsts = tile.data().iter().step_by(tile.texels());
                out[shard * columns..(shard + 1) * columns].iter_mut().zip(firsts).for_each(|(out, &v)| *out = v);
            },
        );
        Ok(())
    })?;
    let mut rest = &sample[..];
    for unit in units {
        let (floats, after) = rest.split_at(within(parts.texels_of(unit..unit + 1)).count() * all);
        each(unit, Piece { floats: floats.to_vec(), ..Piece::default() })?;
        rest = after;
    }
    Ok(())
}

/// The leading right singular vectors of the sampled rows, row by row.
fn first_basis(sample: &[f32], columns: usize, width: usize) -> Option<Vec<f64>> {
    let count = sample.len() / columns;
    let rows = Rows::new(sample, columns);
    // compute the lower triangle of the inner products, a strip of rows at a time
    let strips = sample.par_chunks(STRIP * columns).enumerate().map(|(i, strip)| {
        let before = &sample[..i * STRIP * columns + strip.len()];
        let mut inner = vec![0.0f32; strip.len() / columns * before.len() / columns];
        add_product_transposed(Rows::new(strip, columns), Rows::new(before, columns), &mut inner);
        inner
    });
    let strips: Vec<Vec<f32>> = strips.collect();
    let entry = |i: usize, j: usize| {
        let strip = &strips[i / STRIP];
        f64::from(strip[i % STRIP * count.min((i / STRIP + 1) * STRIP) + j])
    };
    let symmetric: Vec<f64> =
        (0..count * count).map(|k| entry((k / count).max(k % count), (k / count).min(k % count))).collect();
    let eigen = largest_eigenpairs(&symmetric, count, width)?;
    let rotation: Vec<f32> = eigen.vectors.iter().map(|&v| v as f32).collect();
    let mut basis = vec![0.0f32; width * columns];
    basis.par_chunks_mut(8 * columns).zip(rotation.par_chunks(8 * count)).for_each(|(out, rotation)| {
        add_product(Rows::new(rotation, count), rows, out);
    });
    // add fixed noise far below the sample: it fills the directions that the sample lacks
    let scale = eigen.values[0].max(0.0).sqrt().max(1e-6) * 1e-6 / (columns as f64).sqrt();
    let mut state = 1u64;
    let noisy = basis.iter().map(|&v| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        f64::from(v) + scale * ((state >> 11) as f64 / (1u64 << 52) as f64 - 1.0)
    });
    orthonormal_rows(&noisy.collect::<Vec<f64>>(), columns)
}

/// A subsample of the texels of a matrix: steps of [`STEP`] consecutive texels at scattered places.
pub struct Subsample<'a, S> {
    all: &'a S,
    steps: Vec<usize>,
}

impl<S> Subsample<'_, S> {
    /// Number of texels of a subsample of about `texels` texels.
    pub fn size(texels: usize) -> usize {
        texels / STEP * STEP
    }
}

impl<'a, S: Shards> Subsample<'a, S> {
    /// A subsample of about `texels` texels.
    pub fn new(all: &'a S, texels: usize) -> Self {
        let count = texels / STEP;
        Self { all, steps: (0..count).map(|i| scattered(i, count, all.texels() + 1 - STEP)).collect() }
    }
}

impl<S: Shards> Shards for Subsample<'_, S> {
    type Shard<'a>
        = S::Shard<'a>
    where
        Self: 'a;

    fn count(&self) -> usize {
        self.all.count()
    }

    fn columns(&self) -> usize {
        self.all.columns()
    }

    fn texels(&self) -> usize {
        self.steps.len() * STEP
    }

    fn read(&self, shard: usize, texels: Range<usize>) -> Result<S::Shard<'_>> {
        let (first, last) = (texels.start / STEP, texels.end.div_ceil(STEP) - 1);
        let end = self.steps[first..=last].iter().max().map_or(0, |step| step + STEP);
        let begin = self.steps[first..=last].iter().min().map_or(0, |step| *step);
        self.all.read(shard, begin..end)
    }

    fn load(&self, shard: &S::Shard<'_>, tile: &mut FloatTile, first: usize, count: usize, offset: &[f64]) {
        let mut narrow = FloatTile::narrow(self.columns());
        for step in 0..tile.texels() / STEP {
            if step * STEP < count {
                self.all.load(shard, &mut narrow, self.steps[first / STEP + step], STEP, offset);
                tile.set_step(step, Some(&narrow));
            } else {
                tile.set_step(step, None);
            }
        }
    }

    fn done(&self, shard: usize) -> Result<()> {
        self.all.done(shard)
    }
}
