//! k-means: the texels in clusters of similar ABRDFs.
//!
//! # Model
//! Texels are compared in principal components of the whole BTF, found from scattered texels: with all of them distances are
//! exact, with some dozen nearly so. Clusters are found there by Lloyd's iteration
//! ([`crate::factor::kmeans`]); the stored block are the exact means of the texels' values.
//!
//! # Limits
//! A local minimum of the squared error, which the start decides.
//!
//! # References
//! lloyd1982, arthur2007

use std::path::Path;

use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::codec::parts::Recipe;
use crate::codec::quantised::{self, BLOCK_PRECISION, CLUSTERS, DIMENSIONS, ITERATIONS, SEED};
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::{DOMAIN, Domain};
use crate::factor::global::SKETCH_PASSES;
use crate::factor::kmeans::{Points, Start, kmeans};
use crate::params::{Kind, Param, Values};
use crate::progress::{Progress, Task};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KMeans;

const PARAMS: &[Param] = &[
    CLUSTERS,
    DIMENSIONS,
    Param {
        name: "start",
        unit: "",
        kind: Kind::Choice(&["distant", "regular"]),
        default: "distant",
        doc: "First centres: texels drawn far from each other (k-means++), or regularly spaced ones.",
    },
    ITERATIONS,
    SEED,
    BLOCK_PRECISION,
    DOMAIN,
];

impl Codec for KMeans {
    fn name(&self) -> &'static str {
        "kmeans"
    }

    fn doc(&self) -> &'static str {
        "Clusters of similar texels by k-means: an index image and the mean of each cluster."
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
        let (meta, integer) = (source.meta(), |name| params.integer(name) as usize);
        let task = Task::new(progress, "reduce", (SKETCH_PASSES * meta.views.len()) as u64);
        let domain = Domain::from_name(params.text("domain"));
        let (global, dimensions) = quantised::coordinates(source, domain, integer("dimensions"), task)?;
        let task = Task::new(progress, "cluster", (integer("iterations") + integer("clusters")) as u64);
        let points = Points::new(&global.coefficients, dimensions);
        let start = match params.text("start") {
            "regular" => Start::Regular,
            _ => Start::Distant(params.integer("seed") as u64),
        };
        let partition = kmeans(&points, integer("clusters"), start, integer("iterations"), &|| task.advance(1))?;
        drop(task);
        let partition = quantised::by_first_coordinate(partition, &global.coefficients, dimensions);
        let task = Task::new(progress, "compress", meta.views.len() as u64);
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
