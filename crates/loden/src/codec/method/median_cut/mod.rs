//! Median cut: boxes of texels, each cut into two halves with equal numbers of texels.
//!
//! # Model
//! A texel is a point whose coordinates are its ABRDF: three values per pair of view and light. The box around all
//! texels is cut at the median of its longest edge, then one of the two boxes is cut, and so on until there are
//! enough boxes ([`crate::factor::median_cut`]). Each box is represented by the mean of its texels. Alternatively the
//! coordinates are principal components; boxes are then oblique to the values and follow the correlations of the
//! texels.
//!
//! # Limits
//! A cut considers one coordinate only, and an outlier makes a box long.
//!
//! # References
//! heckbert1982

mod pages;

use std::path::Path;

use pages::Images;
pub(in crate::codec) use pages::ReadPages;

use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::codec::form::quantised::{self, Block, CLUSTERS, DIMENSIONS};
use crate::codec::parts::{Curve, Recipe};
use crate::codec::{Codec, EncodeInStages, EncodeSummary};
use crate::factor::global::SKETCH_PASSES;
use crate::factor::median_cut::{Columns, Rule, median_cut};
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::stages::{Local, Stages};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MedianCut;

crate::words! {
    /// Choice of the next box to cut.
    enum Split { Balanced = "balanced", LongestEdge = "longest-edge", Population = "population", Variance = "variance" }
}

crate::words! {
    /// Coordinates of the boxes.
    enum Space { Abrdf = "abrdf", Pca = "pca" }
}

crate::params! {
    struct Settings {
        clusters: usize => CLUSTERS,
        /// Next box to cut: the topmost in the tree, the one with the longest edge, or that with the largest product
        /// of number of texels and longest edge, or of number of texels and variance in one dimension.
        split: Split = "population",
        /// Coordinates of the points: all values of a texel, or its principal components.
        space: Space = "abrdf",
        dimensions: usize => DIMENSIONS,
        block: Block,
    }
}

impl Codec for MedianCut {
    fn name(&self) -> &'static str {
        "median-cut"
    }

    fn doc(&self) -> &'static str {
        "Clusters of similar texels by median cut: an index image and the mean of each box."
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

    fn limits(&self, meta: &BtfMeta, params: &Values) -> Result<Vec<(&'static str, usize)>> {
        let space = Settings::from_values(params)?.space;
        let used = |name: &str| name != "dimensions" || space == Space::Pca;
        Ok(quantised::limits(meta).into_iter().filter(|(name, _)| used(name)).collect())
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        let Settings { clusters, space, dimensions, .. } = Settings::from_values(params).ok()?;
        Some(quantised::memory(meta, clusters, threads, (space == Space::Pca).then_some(dimensions), 0))
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Settings { clusters, block, .. } = Settings::from_values(params)?;
        Ok(quantised::recipe(clusters, 0, block.precision, Curve::Display))
    }
}

fn encode(stages: &dyn Stages, params: &Values, path: &Path, progress: &dyn Progress) -> Result<EncodeSummary> {
    let Settings { clusters: count, split, space, dimensions, block } = Settings::from_values(params)?;
    let (meta, domain) = (stages.source().meta(), block.domain);
    let rule = match split {
        Split::Balanced => Rule::Balanced,
        Split::LongestEdge => Rule::LongestEdge,
        Split::Population => Rule::Population,
        Split::Variance => Rule::Variance,
    };
    let views = meta.views.len() as u64;
    let partition = if space == Space::Pca {
        let task = Task::new(progress, "reduce", SKETCH_PASSES as u64 * views);
        let (global, dimensions) = quantised::coordinates(stages, domain, dimensions, &task)?;
        median_cut(&Columns::new(&global.coefficients, dimensions), count, rule)?
    } else {
        // at most two views for each level
        let levels = u64::from(usize::BITS - meta.texels().leading_zeros());
        let task = Task::new(progress, "cut", 2 * levels * views);
        median_cut(&Images { stages, domain, task }, count, rule)?
    };
    let task = Task::new(progress, "compress", views);
    quantised::write(&MedianCut, stages, params, &block, path, &partition, &task)
}
