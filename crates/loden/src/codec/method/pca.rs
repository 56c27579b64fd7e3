//! PCA: principal components of the whole BTF, with one set of coefficients per texel.
//!
//! # Model
//! The matrix M has a row per texel and a column per view, light and channel. The file stores its mean over texels
//! mu, the c principal components B and the coefficients A = (M - 1 mu^T) B; the decoded matrix is 1 mu^T + A B^T.
//! All views share the coefficients, so at equal size c may be much larger than with separate components for each
//! view.
//!
//! # Limits
//! Parallax moves neighbouring texels into a texel's column from view to view, which a shared basis expresses only
//! with many components. The source is read up to sixteen times.
//!
//! With fewer than 4096 texels per component, singular values are exact to 0.05 %, and the squared error is within
//! 0.1 % of the minimum. With more (and at least 16384), the components are computed from a quarter of the texels;
//! for 16 components of 256 x 256 texels the squared error was 0.18 % above the minimum.
//!
//! # References
//! koudelka2003

use std::path::Path;

use crate::btf::{BtfMeta, BtfSource};
use crate::codec::form::factored::{self, FactorWriter, Sharing, Stored};
use crate::codec::matrix::Matrix;
use crate::codec::parts::Recipe;
use crate::codec::{Codec, EncodeInStages, EncodeSummary, budget};
use crate::factor::global::{self, PASSES, principal_components, singular_components};
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::stages::{Local, Stages};
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pca;

crate::params! {
    struct Settings {
        /// Number of components of the whole BTF; at most the rank, the smaller of 3 x pairs and texels - 1.
        components: usize [1..=65535] = 16,
        stored: Stored,
    }
}

impl Codec for Pca {
    fn name(&self) -> &'static str {
        "pca"
    }

    fn doc(&self) -> &'static str {
        "Principal components of the whole BTF; all views share a texel's coefficients."
    }

    fn params(&self) -> &'static [Param] {
        Settings::TABLE
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        encode(self, &Local::new(source), params, path, progress, Sharing::AllViews)
    }

    fn in_stages(&self) -> Option<EncodeInStages> {
        Some(|stages, params, path, progress| encode(&Pca, stages, params, path, progress, Sharing::AllViews))
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("components", crate::codec::count(place, Sharing::AllViews.rank(meta).min(1024)))]
    }

    fn limits(&self, meta: &BtfMeta, _params: &Values) -> Result<Vec<(&'static str, usize)>> {
        Ok(vec![("components", Sharing::AllViews.rank(meta))])
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        Some(memory(meta, Settings::from_values(params).ok()?.components, threads, global::memory))
    }

    fn recipe(&self, meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Settings { components, stored } = Settings::from_values(params)?;
        factored::recipe(meta, components, &stored, Sharing::AllViews)
    }
}

/// See [`Codec::memory`]. `factors` is the memory of the factorisation, [`global::memory`] or
/// [`global::rough_memory`].
pub(in crate::codec) fn memory(
    meta: &BtfMeta,
    components: usize,
    threads: usize,
    factors: fn(usize, usize, usize) -> u64,
) -> u64 {
    let columns = 3 * meta.pairs();
    // coefficients are converted before they are written
    budget::source(meta, threads)
        + factors(columns, meta.texels(), components)
        + budget::singles(meta.texels() * components)
}

/// Compresses by components of the whole BTF, with or without a mean depending on `sharing`.
pub(in crate::codec) fn encode(
    codec: &dyn Codec,
    stages: &dyn Stages,
    params: &Values,
    path: &Path,
    progress: &dyn Progress,
    sharing: Sharing,
) -> Result<EncodeSummary> {
    let (source, meta) = (stages.source(), stages.source().meta());
    let writer = FactorWriter::create(path, codec, params, source)?;
    let task = Task::new(progress, "compress", (meta.views.len() * PASSES) as u64);
    let matrix = Matrix { stages, domain: writer.domain(), task: &task };
    let global = match sharing {
        Sharing::AllViewsNoMean => singular_components(&matrix, writer.components())?,
        _ => principal_components(&matrix, writer.components())?,
    };
    let global = global.ok_or_else(|| Error::non_finite("the source, in this domain,"))?;
    let columns = 3 * meta.lights.len();
    let single = |values: &[f64]| values.iter().map(|&v| v as f32).collect::<Vec<f32>>();
    for view in 0..meta.views.len() {
        let range = view * columns..(view + 1) * columns;
        let rows = global.basis.chunks_exact(global.mean.len()).flat_map(|row| single(&row[range.clone()]));
        writer.basis(view, &single(&global.mean[range.clone()]), &rows.collect::<Vec<f32>>())?;
    }
    writer.coefficients(0, &global.coefficients)?;
    writer.commit()
}
