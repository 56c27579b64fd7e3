//! BTFs whose texels are grouped into clusters: stored form, means, decoding and evaluation, shared by several
//! methods.
//!
//! # Model
//! Texels are clustered by their apparent BRDFs (ABRDF: the values of a texel for all pairs of view and light). The
//! file stores an index image with the cluster of each texel, and a block with the mean ABRDF of each cluster. A
//! texel has the values of row `index` of the block, optionally plus its coefficients times components of its
//! cluster. The index image works with any block of the same number of rows.
//!
//! # Limits
//! At most 65536 clusters. Differences between the ABRDFs of a cluster are lost.

mod decode;
mod fit;
mod material;
mod means;
#[cfg(test)]
mod tests;

pub use decode::QuantisedBtf;
pub(in crate::codec) use decode::form;
pub(in crate::codec) use fit::Components;
pub use material::QuantisedMaterial;
pub use means::{Means, index_image, write, write_with_components};

use crate::btf::{BtfMeta, SampleType};
use crate::codec::budget::{self, singles};
use crate::codec::matrix::Matrix;
use crate::codec::parts::{Axis, Curve, Expr, PlaneSpec, Recipe, TableSpec};
use crate::color::domain::{DOMAIN, Domain};
use crate::factor::global::{self, Global, sketched_components};
use crate::factor::kmeans::Partition;
use crate::params::{Kind, Param};
use crate::progress::Task;
use crate::stages::Stages;
use crate::{Error, Result};

/// The largest number of clusters that a 16-bit index can distinguish.
pub const MAX_CLUSTERS: usize = 1 << 16;

/// Parameter: number of clusters.
pub const CLUSTERS: Param = Param {
    name: "clusters",
    unit: "",
    kind: Kind::Integer { min: 1, max: MAX_CLUSTERS as i64 },
    default: "256",
    doc: "Number of clusters; fewer if the BTF has fewer distinct texels.",
};

/// Parameter: dimensions in which texels are compared.
pub const DIMENSIONS: Param = Param {
    name: "dimensions",
    unit: "",
    kind: Kind::Integer { min: 1, max: 4096 },
    default: "32",
    doc: "Number of principal components in which texels are compared; at most the rank.",
};

/// Parameter: iterations of the clustering.
pub const ITERATIONS: Param = Param {
    name: "iterations",
    unit: "",
    kind: Kind::Integer { min: 0, max: 10_000 },
    default: "40",
    doc: "Maximum number of iterations; stops early if no texel moves.",
};

/// Parameter: seed of the random texels.
pub const SEED: Param = Param {
    name: "seed",
    unit: "",
    kind: Kind::Integer { min: 0, max: i64::MAX },
    default: "0",
    doc: "Seed of the random choice of texels.",
};

crate::params! {
    /// Parameters that the methods without components share.
    pub struct Block {
        /// Number type of the block: single or half precision, or 8 bits over 0..1 (over a wider range per view if
        /// needed).
        pub precision: SampleType = "u8",
        /// Values that are averaged: display values (as stored in photographs), linear light, or its logarithm.
        pub domain: Domain => DOMAIN,
    }
}

/// See [`crate::codec::Codec::limits`]: a texel is in one cluster, and its coordinates are at most as many as the rank.
pub fn limits(meta: &BtfMeta) -> Vec<(&'static str, usize)> {
    vec![("clusters", meta.texels()), ("dimensions", meta.texels().min(3 * meta.pairs()))]
}

/// The recipe of a clustering method: `clusters` rows in the block, numbers in `curve`, and `c` components (0 for
/// none).
pub fn recipe(clusters: usize, c: usize, sample_type: SampleType, curve: Curve) -> Recipe {
    let pair = [Axis::View, Axis::Light, Axis::Channel];
    let axes = |first: &[Axis]| [first, &pair].concat();
    let mut tables = vec![TableSpec::new("block", &axes(&[Axis::Row(clusters)]), sample_type)];
    let mut planes = vec![PlaneSpec::index("index", clusters)];
    let block = Expr::Table { table: 0, row: Some(0) };
    let value = if c > 0 {
        tables.push(TableSpec::new("components", &axes(&[Axis::Row(clusters), Axis::Component(c)]), sample_type));
        planes.push(PlaneSpec::numbers("coefficients", c, sample_type));
        Expr::Sum(vec![block, Expr::Dot { plane: 1, table: 1, row: Some(0) }])
    } else {
        block
    };
    if sample_type == SampleType::U8 {
        tables[0].range = Some(tables.len());
        tables.push(TableSpec::new("block_range", &[Axis::View, Axis::Range], SampleType::F32));
    }
    Recipe { planes, tables, value, curve }
}

/// The texels in their first `dimensions` principal components, approximately. Distances between texels are preserved
/// as far as these components capture the differences. The files of the source are read for their checksum meanwhile, which the
/// compressed file states.
///
/// # Errors
/// Errors of the source; [`Error::NonFinite`]; [`Error::Cancelled`].
pub fn coordinates(stages: &dyn Stages, domain: Domain, dimensions: usize, task: &Task) -> Result<(Global, usize)> {
    let (source, matrix) = (stages.source(), Matrix { stages, domain, task });
    let (global, _) = rayon::join(|| sketched_components(&matrix, dimensions), || source.identity());
    let global = global?.ok_or_else(|| Error::non_finite("the source, in this domain,"))?;
    let dimensions = global.coefficients.len() / source.meta().texels();
    Ok((global, dimensions))
}

/// Memory of a clustering method in bytes, see [`crate::codec::Codec::memory`]. `dimensions` is the number of
/// principal components in which texels are compared, if any; `c` the number of components per cluster, 0 for none.
pub fn memory(meta: &BtfMeta, clusters: usize, threads: usize, dimensions: Option<usize>, c: usize) -> u64 {
    let (texels, pairs, lights) = (meta.texels(), meta.pairs(), meta.lights.len());
    let clusters = clusters.min(texels);
    // if texels are compared as they are: bounds of boxes per pair, one image per thread, and texels in order
    let compared = match dimensions {
        Some(d) => global::rough_memory(3 * pairs, texels, d) + singles(2 * texels * d),
        None => singles(2 * clusters * pairs + threads * meta.image_len() + 4 * texels),
    };
    // nearest cluster and distance of each texel, members in two orders, factors of the fit
    let partition = singles(texels * (8 + 3 * c) + clusters * c * 64 * threads);
    // sums of a view in double precision, means, and those of some views in stored form
    let means = 2 * means::PART_BYTES as u64 + singles(clusters * (1 + c) * lights * 3 * 5);
    // the file, which is mapped while the error is measured
    let file = singles(clusters * (1 + c) * pairs * 3 + texels * (1 + c));
    budget::source(meta, threads) + compared + partition + means + file
}

/// Orders the clusters by the first coordinate of their means: from dark to bright, if brightness is what differs
/// most.
pub fn by_first_coordinate(partition: Partition, coordinates: &[f32], dimensions: usize) -> Partition {
    partition.ordered(|members| {
        let sum: f64 = members.iter().map(|&texel| f64::from(coordinates[texel as usize * dimensions])).sum();
        sum / members.len() as f64
    })
}
