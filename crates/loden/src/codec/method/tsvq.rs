//! TSVQ: tree-structured vector quantisation, the texels in clusters that are halved again and again.
//!
//! # Model
//! Texels are compared in principal components as in [`super::kmeans`]. The cluster whose halving lowers the squared
//! error most is halved next ([`crate::factor::tree`]); the stored block are the exact means of the texels' values.
//!
//! # Limits
//! The error is somewhat larger than that of k-means, the time a fraction.
//!
//! # References
//! linde1980, riskin1991

use std::path::Path;

use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::codec::parts::Recipe;
use crate::codec::quantised::{self, BLOCK_PRECISION, CLUSTERS, DIMENSIONS};
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::{DOMAIN, Domain};
use crate::factor::global::SKETCH_PASSES;
use crate::factor::tree::tree_clusters;
use crate::params::{Param, Values};
use crate::progress::{Progress, Task};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tsvq;

const PARAMS: &[Param] = &[CLUSTERS, DIMENSIONS, BLOCK_PRECISION, DOMAIN];

impl Codec for Tsvq {
    fn name(&self) -> &'static str {
        "tsvq"
    }

    fn doc(&self) -> &'static str {
        "Clusters of similar texels by a tree of halvings: an index image and the mean of each leaf."
    }

    fn params(&self) -> &'static [Param] {
        PARAMS
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        let (views, clusters) = (source.meta().views.len() as u64, params.integer("clusters") as usize);
        let task = Task::new(progress, "reduce", SKETCH_PASSES as u64 * views);
        let domain = Domain::from_name(params.text("domain"));
        let (global, dimensions) = quantised::coordinates(source, domain, params.integer("dimensions") as usize, task)?;
        let task = Task::new(progress, "cluster", clusters as u64);
        let partition = tree_clusters(&global.coefficients, dimensions, clusters, &|| task.advance(1))?;
        drop(task);
        let task = Task::new(progress, "compress", views);
        quantised::write(self, source, params, path, &partition, &task)
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("clusters", crate::codec::count(place, meta.texels().min(crate::codec::quantised::MAX_CLUSTERS)))]
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        Some(quantised::memory(meta, params, threads, Some(params.integer("dimensions") as usize), 0))
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        Ok(quantised::recipe_of(params))
    }
}
