//! k-means: clusters of texels with similar ABRDFs.
//!
//! # Model
//! Texels are compared in principal components of the whole BTF, estimated from scattered texels: with all components
//! distances are exact, with some dozen nearly so. Lloyd's iteration ([`crate::factor::kmeans`]) finds clusters
//! there. The stored block has the exact means of the texel values.
//!
//! # Limits
//! Finds a local minimum of the squared error, which depends on the initial centres.
//!
//! # References
//! lloyd1982, arthur2007

use std::path::Path;

use crate::Result;
use crate::btf::{BtfMeta, BtfSource, EveryView};
use crate::codec::form::quantised::{self, Block, CLUSTERS, DIMENSIONS, ITERATIONS, SEED};
use crate::codec::parts::{Curve, Recipe};
use crate::codec::{Codec, EncodeInStages, EncodeSummary};
use crate::factor::global::SKETCH_PASSES;
use crate::factor::kmeans::{Points, Start, kmeans};
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::stages::{Local, Stages};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KMeans;

crate::words! {
    /// Choice of the initial centres.
    enum First { Distant = "distant", Regular = "regular" }
}

crate::params! {
    struct Settings {
        clusters: usize => CLUSTERS,
        dimensions: usize => DIMENSIONS,
        /// Initial centres: random texels far from each other (k-means++), or regularly spaced ones.
        start: First = "distant",
        iterations: usize => ITERATIONS,
        seed: u64 => SEED,
        block: Block,
    }
}

impl Codec for KMeans {
    fn name(&self) -> &'static str {
        "kmeans"
    }

    fn doc(&self) -> &'static str {
        "Clusters of similar texels by k-means: an index image and the mean of each cluster."
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
        encode(&Local::new(source), params, path, progress)
    }

    fn in_stages(&self) -> Option<EncodeInStages> {
        Some(encode)
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("clusters", crate::codec::count(place, meta.texels().min(crate::codec::form::quantised::MAX_CLUSTERS)))]
    }

    fn limits(&self, meta: &BtfMeta, _params: &Values) -> Result<Vec<(&'static str, usize)>> {
        Ok(quantised::limits(meta))
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        let Settings { clusters, dimensions, .. } = Settings::from_values(params).ok()?;
        Some(quantised::memory(meta, clusters, threads, Some(dimensions), 0))
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Settings { clusters, block, .. } = Settings::from_values(params)?;
        Ok(quantised::recipe(clusters, 0, block.precision, Curve::Display))
    }
}

fn encode(stages: &dyn Stages, params: &Values, path: &Path, progress: &dyn Progress) -> Result<EncodeSummary> {
    encode_compared(stages, stages, params, path, progress)
}

impl KMeans {
    /// As [`Codec::encode`], but compares texels in every `step`-th view only. The means are over all views.
    ///
    /// # Errors
    /// As [`Codec::encode`].
    pub(crate) fn encode_by_views(
        self,
        step: usize,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        let compared = EveryView::new(source, step)?;
        encode_compared(&Local::new(&compared), &Local::new(source), params, path, progress)
    }
}

/// Clusters the texels as they are in the source of `compared`, and writes means of that of `stages`.
fn encode_compared(
    compared: &dyn Stages,
    stages: &dyn Stages,
    params: &Values,
    path: &Path,
    progress: &dyn Progress,
) -> Result<EncodeSummary> {
    let Settings { clusters, dimensions, start, iterations, seed, block } = Settings::from_values(params)?;
    let task = Task::new(progress, "reduce", (SKETCH_PASSES * compared.source().meta().views.len()) as u64);
    let (global, dimensions) = quantised::coordinates(compared, block.domain, dimensions, &task)?;
    let task = Task::new(progress, "cluster", (iterations + clusters) as u64);
    let points = Points::new(&global.coefficients, dimensions);
    let start = match start {
        First::Regular => Start::Regular,
        First::Distant => Start::Distant(seed),
    };
    let partition = kmeans(&points, clusters, start, iterations, &|| task.advance(1))?;
    drop(task);
    let partition = quantised::by_first_coordinate(partition, &global.coefficients, dimensions);
    let task = Task::new(progress, "compress", stages.source().meta().views.len() as u64);
    quantised::write(&KMeans, stages, params, &block, path, &partition, &task)
}
