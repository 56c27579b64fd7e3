//! What the methods share that put texels into clusters: the stored form, means, decoding, evaluation.
//!
//! # Model
//! Texels are put into clusters by their apparent BRDFs (ABRDF: the values of a texel for all pairs of view and light).
//! Stored are an index image, the cluster of each texel, and a block of ABRDFs, the mean of each cluster: a texel shows
//! row `index` of the block, to which components of its cluster times its coefficients may be added. An index image
//! shows its pattern with any other block of as many rows.
//!
//! # Limits
//! 65536 clusters. What the ABRDFs of a cluster differ in is lost.

mod decode;
mod material;
mod means;
#[cfg(test)]
mod tests;

pub use decode::QuantisedBtf;
pub(in crate::codec) use decode::form;
pub use material::QuantisedMaterial;
pub use means::{index_image, write, write_with_components};

use crate::btf::{BtfMeta, BtfSource, SampleType};
use crate::codec::budget::{self, singles};
use crate::codec::parts::{Axis, Curve, Expr, PlaneSpec, Recipe, TableSpec};
use crate::codec::values::ViewShards;
use crate::color::domain::{DOMAIN, Domain};
use crate::factor::global::{self, Global, sketched_components};
use crate::factor::kmeans::Partition;
use crate::params::{Kind, Param};
use crate::progress::Task;
use crate::{Error, Result};

/// The largest number of clusters: what 16 bits can tell apart.
pub const MAX_CLUSTERS: usize = 1 << 16;

/// The parameter of the number of clusters.
pub const CLUSTERS: Param = Param {
    name: "clusters",
    unit: "",
    kind: Kind::Integer { min: 1, max: MAX_CLUSTERS as i64 },
    default: "256",
    doc: "Clusters of texels; fewer if there are not as many different texels.",
};

/// The parameter of the dimensions that texels are compared in.
pub const DIMENSIONS: Param = Param {
    name: "dimensions",
    unit: "",
    kind: Kind::Integer { min: 1, max: 4096 },
    default: "32",
    doc: "Principal components that texels are compared in; at most the rank.",
};

/// The parameter of the iterations of clustering.
pub const ITERATIONS: Param = Param {
    name: "iterations",
    unit: "",
    kind: Kind::Integer { min: 0, max: 10_000 },
    default: "40",
    doc: "Iterations at most; fewer if no texel moves.",
};

/// The parameter of the seed of random texels.
pub const SEED: Param = Param {
    name: "seed",
    unit: "",
    kind: Kind::Integer { min: 0, max: i64::MAX },
    default: "0",
    doc: "Seed of the texels that are drawn.",
};

crate::params! {
    /// What the methods without components have in common.
    pub struct Block {
        /// Numbers of the block: single or half precision, or 8 bits of 0..1 (of a wider range per view where it is
        /// needed).
        pub precision: SampleType = "u8",
        /// Numbers that are factored: display values (as stored in photographs), linear light, or its logarithm.
        pub domain: Domain => DOMAIN,
    }
}

/// What the files of a method hold: `clusters` rows of a block, numbers in `curve`, and `c` components, 0 for none.
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

/// The texels in their first `dimensions` principal components, or nearly these: distances between texels are kept as
/// far as the components take up what differs.
///
/// # Errors
/// What the source returns; [`Error::NonFinite`]; [`Error::Cancelled`].
pub fn coordinates(source: &dyn BtfSource, domain: Domain, dimensions: usize, task: Task) -> Result<(Global, usize)> {
    let shards = ViewShards { source, domain, task };
    let global =
        sketched_components(&shards, dimensions)?.ok_or_else(|| Error::non_finite("the source, in this domain,"))?;
    let dimensions = global.coefficients.len() / source.meta().texels();
    Ok((global, dimensions))
}

/// What compressing by clusters takes, bytes; see [`crate::codec::Codec::memory`]. `dimensions` are those that texels
/// are compared in, if in components; `c` the components of each cluster, 0 for none.
pub fn memory(meta: &BtfMeta, clusters: usize, threads: usize, dimensions: Option<usize>, c: usize) -> u64 {
    let (texels, pairs, lights) = (meta.texels(), meta.pairs(), meta.lights.len());
    let clusters = clusters.min(texels);
    // where texels are compared as they are, bounds of boxes in each pair, an image of each thread, and texels in order
    let compared = match dimensions {
        Some(d) => global::rough_memory(3 * pairs, texels, d) + singles(2 * texels * d),
        None => singles(2 * clusters * pairs + threads * meta.image_len() + 4 * texels),
    };
    // the nearest cluster of each texel and how far it is, members in two orders, factors of a fit
    let partition = singles(texels * (8 + 3 * c) + clusters * c * 64 * threads);
    // sums of a view in double precision, means, those of some views as they are stored
    let means = 2 * means::PART_BYTES as u64 + singles(clusters * (1 + c) * lights * 3 * 5);
    // the file, which is mapped when the error is measured
    let file = singles(clusters * (1 + c) * pairs * 3 + texels * (1 + c));
    budget::source(meta, threads) + compared + partition + means + file
}

/// Numbers the clusters by the first coordinate of their means: from dark to bright, where that is what differs most.
pub fn by_first_coordinate(partition: Partition, coordinates: &[f32], dimensions: usize) -> Partition {
    partition.ordered(|members| {
        let sum: f64 = members.iter().map(|&texel| f64::from(coordinates[texel as usize * dimensions])).sum();
        sum / members.len() as f64
    })
}
