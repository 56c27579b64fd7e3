//! TSVQ: tree-structured vector quantisation; clusters of texels are split in two repeatedly.
//!
//! # Model
//! Texels are compared in principal components, as in [`super::kmeans`]. The next cluster to split is the one whose
//! split reduces the squared error most ([`crate::factor::tree`]). The stored block has the exact means of the texel
//! values.
//!
//! # Limits
//! The error is slightly larger than that of k-means, the time a fraction of it.
//!
//! # References
//! linde1980, riskin1991

use std::path::Path;

use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::codec::form::quantised::{self, Block, CLUSTERS, DIMENSIONS};
use crate::codec::parts::{Curve, Recipe};
use crate::codec::{Codec, EncodeInStages, EncodeSummary};
use crate::factor::global::SKETCH_PASSES;
use crate::factor::tree::tree_clusters;
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::stages::{Local, Stages};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tsvq;

crate::params! {
    struct Settings {
        clusters: usize => CLUSTERS,
        dimensions: usize => DIMENSIONS,
        block: Block,
    }
}

impl Codec for Tsvq {
    fn name(&self) -> &'static str {
        "tsvq"
    }

    fn doc(&self) -> &'static str {
        "Clusters of similar texels by a binary tree: an index image and the mean of each leaf."
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
    let Settings { clusters, dimensions, block } = Settings::from_values(params)?;
    let views = stages.source().meta().views.len() as u64;
    let task = Task::new(progress, "reduce", SKETCH_PASSES as u64 * views);
    let (global, dimensions) = quantised::coordinates(stages, block.domain, dimensions, &task)?;
    let task = Task::new(progress, "cluster", clusters as u64);
    let partition = tree_clusters(&global.coefficients, dimensions, clusters, &|| task.advance(1))?;
    drop(task);
    let task = Task::new(progress, "compress", views);
    quantised::write(&Tsvq, stages, params, &block, path, &partition, &task)
}
