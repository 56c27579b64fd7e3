//! The matrix (texel; view, light, channel) of a BTF, read by passes that run as stages.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::budget;
use super::values::ViewValues;
use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::color::domain::Domain;
use crate::factor::global::passes::{self, Parts};
use crate::factor::global::{Pass, Passes, Receive, Shards};
use crate::factor::tile::FloatTile;
use crate::progress::Task;
use crate::stages::{Each, Kernel, Known, Site, Stage, Stages, settings};

/// The matrix of a BTF in a domain.
pub struct Matrix<'a> {
    /// Runs the passes.
    pub stages: &'a dyn Stages,
    /// The domain of the values.
    pub domain: Domain,
    /// Advanced by one for each view used.
    pub task: &'a Task<'a>,
}

#[derive(Serialize, Deserialize)]
struct Settings {
    pass: Pass,
    domain: Domain,
}

impl Passes for Matrix<'_> {
    fn shards(&self) -> usize {
        self.stages.source().meta().views.len()
    }

    fn columns(&self) -> usize {
        3 * self.stages.source().meta().pairs()
    }

    fn texels(&self) -> usize {
        self.stages.source().meta().texels()
    }

    fn run(&self, pass: &Pass, arrays: &[&[f64]], each: Receive) -> Result<usize> {
        let settings = settings(&Settings { pass: pass.clone(), domain: self.domain })?;
        let doubles = arrays.iter().map(|&array| array.into()).collect();
        let stage = Stage {
            kernel: &MatrixPass,
            known: Known { settings, doubles, ..Known::default() },
            units: units(self.stages.source().meta(), pass),
            steps: if pass.reads() { self.shards() as u64 } else { 0 },
        };
        let each = Mutex::new(each);
        self.stages
            .run(&stage, self.task, &|unit, piece| each.lock().unwrap_or_else(PoisonError::into_inner)(unit, piece))
    }

    fn forget(&self, pass: usize) {
        self.stages.forget(pass);
    }
}

fn units(meta: &BtfMeta, pass: &Pass) -> usize {
    pass.units(meta.views.len(), 3 * meta.lights.len(), meta.texels())
}

/// A pass over the matrix. For each view, pieces come in ascending order.
pub struct MatrixPass;

impl Kernel for MatrixPass {
    fn name(&self) -> &'static str {
        "matrix"
    }

    fn memory(&self, meta: &BtfMeta, known: &Known, units: Range<usize>, threads: usize) -> u64 {
        let Ok(Settings { pass, .. }) = known.settings() else { return u64::MAX };
        let (columns, all) = (3 * meta.lights.len(), 3 * meta.pairs());
        let read = match pass {
            Pass::Project { few, .. } | Pass::Image { few, .. } => few.unwrap_or(meta.texels()),
            _ => meta.texels(),
        };
        let parts = Parts::new(columns, read);
        let width = match &pass {
            Pass::Pick { .. } => 0,
            Pass::Project { .. } => known.doubles.get(1).map_or(0, |basis| basis.len() / all),
            Pass::Image { products, .. } => products.1,
            Pass::Inner { products } | Pass::Rotate { products } => products.iter().map(|(_, width)| width).sum(),
        };
        let count = match &pass {
            Pass::Image { .. } => units.end.div_ceil(meta.views.len()) - units.start / meta.views.len(),
            _ => units.len(),
        };
        // those of a subsample are scattered over the rows that are read
        let texels = parts.texels_of(0..count).len() * meta.texels().div_ceil(read);
        // rows of a view for each thread, and one whole image while they are read
        let rows = if pass.reads() { threads * (texels + meta.width) * columns * meta.sample_type.bytes() } else { 0 };
        let image = if pass.reads() { threads * meta.image_len() * meta.sample_type.bytes() } else { 0 };
        // products as kept and centred, tiles, pieces
        let padded: usize = parts.padded(0, width) * count;
        let pieces = match &pass {
            Pass::Pick { count } => 2 * all * count * texels / meta.texels() + 2 * all,
            Pass::Project { .. } => 2 * (all + width) * count,
            Pass::Image { .. } => units.len() * width * columns,
            Pass::Inner { .. } => (2 * units.len() + threads) * width * width,
            Pass::Rotate { .. } => padded,
        };
        let tiles = threads * FloatTile::size(columns) * (columns + width);
        budget::singles(2 * padded + 2 * pieces + tiles + width * columns) + (rows + image) as u64
    }

    fn run(&self, site: &Site, known: &Known, units: Range<usize>, each: Each) -> Result<()> {
        let Settings { pass, domain } = known.settings()?;
        let shards = ViewShards { source: site.source, domain, task: site.task };
        let arrays: Vec<&[f64]> = known.doubles.iter().map(AsRef::as_ref).collect();
        passes::run(&shards, &pass, &arrays, site.kept, units, &mut |unit, piece| each(unit, piece))
    }
}

/// The views of a source as shards of its matrix.
struct ViewShards<'a> {
    source: &'a dyn BtfSource,
    domain: Domain,
    /// Advanced by one for each view used.
    task: &'a Task<'a>,
}

impl Shards for ViewShards<'_> {
    type Shard<'a>
        = ViewValues<'a>
    where
        Self: 'a;

    fn count(&self) -> usize {
        self.source.meta().views.len()
    }

    fn columns(&self) -> usize {
        3 * self.source.meta().lights.len()
    }

    fn texels(&self) -> usize {
        self.source.meta().texels()
    }

    fn read(&self, shard: usize, texels: Range<usize>) -> Result<ViewValues<'_>> {
        ViewValues::read_some(self.source, shard, self.domain, texels)
    }

    fn load(&self, shard: &ViewValues<'_>, tile: &mut FloatTile, first: usize, count: usize, mean: &[f64]) {
        shard.load_centred(tile, first, count, mean);
    }

    fn done(&self, shard: usize) -> Result<()> {
        self.source.release(shard);
        self.task.advance(1)
    }
}
