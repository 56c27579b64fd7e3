//! PCMF: local principal components; each cluster of texels has its own components.
//!
//! # Model
//! The clustering and the components of clusters are optimised alternately, in principal components of the whole BTF
//! ([`crate::factor::local`]). Means and components are then fitted to all values of the texels: for the given
//! coefficients they have the least squared error. A decoded texel is the mean of its cluster plus components times
//! coefficients.
//!
//! # Limits
//! Every cluster stores its own components, so few clusters with few components are best. Neighbouring texels may
//! belong to different clusters; interpolation blends their values.
//!
//! # References
//! kambhatla1997, mueller2003

use std::path::Path;

use crate::btf::{BtfMeta, BtfSource, FloatType};
use crate::codec::form::quantised;
use crate::codec::parts::Recipe;
use crate::codec::values::FLOAT_PRECISION;
use crate::codec::{Codec, EncodeInStages, EncodeSummary};
use crate::color::domain::{DOMAIN, Domain};
use crate::factor::global::SKETCH_PASSES;
use crate::factor::local::local_components;
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::stages::{Local, Stages};
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pcmf;

crate::params! {
    struct Settings {
        clusters: usize = 32 => quantised::CLUSTERS,
        /// Number of components per cluster; at most the dimensions.
        components: usize [1..=256] = 8,
        dimensions: usize = 64 => quantised::DIMENSIONS,
        iterations: usize => quantised::ITERATIONS,
        seed: u64 => quantised::SEED,
        precision: FloatType => FLOAT_PRECISION,
        domain: Domain => DOMAIN,
    }
}

impl Codec for Pcmf {
    fn name(&self) -> &'static str {
        "pcmf"
    }

    fn doc(&self) -> &'static str {
        "Clusters of texels, each with its own principal components: few coefficients per texel."
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
        let rank = meta.texels().min(3 * meta.pairs());
        vec![("components", crate::codec::count(place, rank.min(64)))]
    }

    fn limits(&self, meta: &BtfMeta, params: &Values) -> Result<Vec<(&'static str, usize)>> {
        let (limits, dimensions) = (quantised::limits(meta), Settings::from_values(params)?.dimensions);
        let most = limits.iter().map(|(_, most)| *most).fold(dimensions, usize::min);
        Ok(limits.into_iter().chain([("components", most)]).collect())
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        let Settings { clusters, components, dimensions, .. } = Settings::from_values(params).ok()?;
        Some(quantised::memory(meta, clusters, threads, Some(dimensions), components))
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Settings { clusters, components, precision, domain, .. } = Settings::from_values(params)?;
        Ok(quantised::recipe(clusters, components, precision.into(), domain.into()))
    }
}

fn encode(stages: &dyn Stages, params: &Values, path: &Path, progress: &dyn Progress) -> Result<EncodeSummary> {
    let Settings { clusters, components, dimensions, iterations, seed, precision, domain } =
        Settings::from_values(params)?;
    let views = stages.source().meta().views.len() as u64;
    let task = Task::new(progress, "reduce", SKETCH_PASSES as u64 * views);
    let (global, dimensions) = quantised::coordinates(stages, domain, dimensions, &task)?;
    if components > dimensions {
        let problem = format!("found {components}, expected at most {dimensions} (the dimensions)");
        return Err(Error::parameter("components", problem));
    }
    let task = Task::new(progress, "cluster", iterations as u64);
    let local = local_components(&global.coefficients, dimensions, clusters, components, iterations, seed, &|| {
        task.advance(1)
    })?;
    let local = local.ok_or_else(|| Error::non_finite("the square of the source, in this domain,"))?;
    drop((task, global));
    let task = Task::new(progress, "compress", views);
    let (partition, coefficients) = (&local.partition, &local.coefficients);
    quantised::write_with_components(&Pcmf, stages, params, precision, domain, path, partition, coefficients, &task)
}
