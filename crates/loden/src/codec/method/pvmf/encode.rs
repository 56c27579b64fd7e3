//! Compression, with one view per thread at a time.

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Pvmf;
use crate::btf::BtfMeta;
use crate::codec::form::factored::FactorWriter;
use crate::codec::values::ViewValues;
use crate::codec::{EncodeSummary, budget};
use crate::color::domain::Domain;
use crate::factor::linalg::largest_eigenpairs;
use crate::factor::moments::moments_f32;
use crate::factor::principal::{Principal, principal_u8};
use crate::factor::project::{project, project_bytes};
use crate::factor::tile::{ByteTile, FloatTile, Tile};
use crate::params::Values;
use crate::progress::{Progress, Task};
use crate::stages::{Each, Kernel, Known, Piece, Site, Stage, Stages, settings};
use crate::{Error, Result};

pub(super) fn encode(
    stages: &dyn Stages,
    params: &Values,
    path: &Path,
    progress: &dyn Progress,
) -> Result<EncodeSummary> {
    let (source, views) = (stages.source(), stages.source().meta().views.len());
    let writer = FactorWriter::create(path, &Pvmf, params, source)?;
    let task = Task::new(progress, "compress", views as u64);
    let settings = settings(&Settings { components: writer.components(), domain: writer.domain() })?;
    let known = Known { settings, ..Known::default() };
    stages.run(&Stage { kernel: &Views, known, units: views, steps: views as u64 }, &task, &|view, piece| {
        let numbers = single(&piece.doubles);
        let (mean, basis) = numbers.split_at(3 * source.meta().lights.len());
        writer.basis(view, mean, basis)?;
        writer.coefficients(view, &piece.floats)
    })?;
    writer.commit()
}

/// Principal components of views: a unit is a view. A piece has its mean, its basis and its coefficients.
pub struct Views;

#[derive(Serialize, Deserialize)]
struct Settings {
    components: usize,
    domain: Domain,
}

impl Kernel for Views {
    fn name(&self) -> &'static str {
        "views"
    }

    fn memory(&self, meta: &BtfMeta, known: &Known, units: Range<usize>, threads: usize) -> u64 {
        let Ok(Settings { components, .. }) = known.settings() else { return u64::MAX };
        let pieces = units.len() * (meta.texels() * components + 6 * meta.lights.len() * (1 + components));
        budget::source(meta, threads) + memory(meta, components, threads) + budget::singles(2 * pieces)
    }

    fn run(&self, site: &Site, known: &Known, units: Range<usize>, each: Each) -> Result<()> {
        let Settings { components, domain } = known.settings()?;
        let (source, meta) = (site.source, site.source.meta());
        units.into_par_iter().try_for_each_init(Buffers::default, |buffers, view| {
            site.task.check()?;
            let values = ViewValues::read(source, view, domain)?;
            let (mean, basis) = buffers.factor(&values, meta, components, view)?;
            drop(values);
            source.release(view);
            let doubles = mean.iter().chain(&basis).map(|&v| f64::from(v)).collect();
            each(view, Piece { doubles, floats: std::mem::take(&mut buffers.coefficients), ..Piece::default() })?;
            site.task.advance(1)
        })
    }
}

/// Memory of this many threads, apart from the views.
pub(super) fn memory(meta: &BtfMeta, components: usize, threads: usize) -> u64 {
    let (row, numbers) = (3 * meta.lights.len(), meta.texels() * components);
    // coefficients, and their stored form; the scatter matrix and its eigenvectors
    threads as u64 * (budget::singles(2 * numbers) + budget::singles(16 * row * row))
}

/// Buffers that a thread reuses for all its views.
#[derive(Default)]
struct Buffers {
    integers: Option<ByteTile>,
    floats: Option<FloatTile>,
    coefficients: Vec<f32>,
}

impl Buffers {
    /// Computes mean and basis; leaves the coefficients in the buffers.
    fn factor(&mut self, values: &ViewValues, meta: &BtfMeta, c: usize, view: usize) -> Result<(Vec<f32>, Vec<f32>)> {
        self.coefficients.resize(meta.texels() * c, 0.0);
        let factors = match values.bytes() {
            Some(bytes) => self.integers(bytes, meta, c),
            None => self.floats(values, meta, c),
        };
        factors.ok_or_else(|| Error::non_finite(format!("view {view} of the source, in this domain,")))
    }

    /// 8-bit values that need no conversion: exact integer sums.
    fn integers(&mut self, values: &[u8], meta: &BtfMeta, c: usize) -> Option<(Vec<f32>, Vec<f32>)> {
        let tile = self.integers.get_or_insert_with(|| ByteTile::new(3 * meta.lights.len()));
        let Principal { mean, vectors } = principal_u8(values, meta.image_len(), tile, c)?;
        let offset = 128.0 / 255.0;
        let bias: Vec<f32> = vectors
            .chunks_exact(tile.rows())
            .map(|v| -v.iter().zip(&mean).map(|(v, m)| v * (m - offset)).sum::<f64>() as f32)
            .collect();
        let basis: Vec<f32> = vectors.iter().map(|v| (v / 255.0) as f32).collect();
        project_bytes(values, meta.image_len(), &basis, &bias, &mut self.coefficients);
        Some((single(&mean), single(&vectors)))
    }

    /// Values of any type in any domain.
    fn floats(&mut self, values: &ViewValues, meta: &BtfMeta, c: usize) -> Option<(Vec<f32>, Vec<f32>)> {
        let tile = self.floats.get_or_insert_with(|| FloatTile::new(3 * meta.lights.len()));
        let moments = moments_f32(meta.texels(), tile, &|tile, first, count| values.load(tile, first, count));
        let eigen = largest_eigenpairs(&moments.scatter, moments.mean.len(), c)?;
        let (mean, basis) = (single(&moments.mean), single(&eigen.vectors));
        let bias = vec![0.0; c];
        for first in (0..meta.texels()).step_by(tile.texels()) {
            let count = tile.texels().min(meta.texels() - first);
            values.load(tile, first, count);
            tile.centre(count, &moments.mean);
            project(tile, count, &basis, &bias, &mut self.coefficients[first * c..]);
        }
        Some((mean, basis))
    }
}

fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&v| v as f32).collect()
}
