//! CMF: chained factorisation of every texel, its factors clustered and indexed.
//!
//! # Model
//! For each channel, a texel's ABRDF is a product P(light) Q(half vector) R(view): one factor per sampled light, one
//! per sampled view, and a square table over half vectors. Q is the mean of the values over all pairs with a given
//! half vector; P and R approximate the quotient, weighted by Q squared ([`crate::separable`]). P and R are scaled to
//! a mean of 1, so that only Q carries the brightness of a texel. The factors of all texels are then clustered by
//! k-means, each kind separately, and replaced by the cluster means: a texel is three indices.
//!
//! # Limits
//! Factors are positive. Any dependence on light and view that is not a product, such as parallax and cast shadows,
//! is lost. The source is read once per 256 MiB of its values in single precision.
//!
//! # References
//! suykens2003 (section 5)

use std::path::Path;

use glam::Vec3;
use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, FloatType};
use crate::codec::container::Writer;
use crate::codec::form::quantised::{CLUSTERS, ITERATIONS, SEED, index_image};
use crate::codec::parts::{Axis, Expr, PlaneSpec, Recipe, TableSpec};
use crate::codec::values::{self, ViewValues, stored};
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::Domain;
use crate::direction::half;
use crate::factor::kmeans::{Points, Start, kmeans};
use crate::factor::tile::{FloatTile, Tile};
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::separable::Grid;
use crate::separable::cmf::weighted_terms;
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cmf;

crate::words! {
    /// Values that are factored.
    enum Factored { Display = "display", Linear = "linear" }
}

impl From<Factored> for Domain {
    fn from(values: Factored) -> Self {
        match values {
            Factored::Display => Self::Display,
            Factored::Linear => Self::Linear,
        }
    }
}

crate::params! {
    struct Settings {
        /// Number of clusters for each kind of factor; fewer if there are fewer distinct factors.
        clusters: usize => CLUSTERS,
        /// Nodes per side of the tables over half vectors.
        resolution: usize [2..=64] = 12,
        iterations: usize = 20 => ITERATIONS,
        seed: u64 => SEED,
        precision: FloatType => values::FLOAT_PRECISION,
        /// Values that are factored: display values (as stored in photographs), or linear light.
        domain: Factored = "display",
    }
}

/// Bytes of values factored together.
const BLOCK_BYTES: usize = 256 << 20;

/// Rounds of updates of P and R.
const ROUNDS: usize = 8;

/// Name of the table and the index plane of each kind of factor.
const NAMES: [(&str, &str); 3] = [("light", "light_index"), ("half", "half_index"), ("view", "view_index")];

/// Numbers in each kind of factor, per channel.
fn sizes(meta: &BtfMeta, resolution: usize) -> [usize; 3] {
    [meta.lights.len(), resolution * resolution, meta.views.len()]
}

/// The recipe with this many clusters of each kind; each texel is the product of one factor of each kind.
fn recipe(clusters: [usize; 3], settings: &Settings) -> Recipe {
    let axes = [Axis::Light, Axis::Half(settings.resolution), Axis::View];
    let kinds = || NAMES.into_iter().zip(clusters);
    let table = |(((name, _), clusters), axis)| {
        TableSpec::new(name, &[Axis::Row(clusters), axis, Axis::Channel], settings.precision.into())
    };
    Recipe {
        planes: kinds().map(|((_, name), clusters)| PlaneSpec::index(name, clusters)).collect(),
        tables: kinds().zip(axes).map(table).collect(),
        value: Expr::Product((0..3).map(|kind| Expr::Table { table: kind, row: Some(kind) }).collect()),
        curve: Domain::from(settings.domain).into(),
    }
}

impl Codec for Cmf {
    fn name(&self) -> &'static str {
        "cmf"
    }

    fn doc(&self) -> &'static str {
        "Product of functions of light, half vector and view, clustered: three indices per texel."
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
        let settings = Settings::from_values(params)?;
        let Settings { clusters, resolution, iterations, seed, precision, .. } = settings;
        let factors = factor(source, &settings, progress)?;
        let sizes = sizes(source.meta(), resolution);
        let task = Task::new(progress, "cluster", 3 * (iterations + clusters) as u64);
        let mut found = Vec::new();
        for (factors, size) in factors.iter().zip(sizes) {
            let (points, start) = (Points::new(factors, 3 * size), Start::Distant(seed));
            let partition = kmeans(&points, clusters, start, iterations, &|| task.advance(1))?;
            // order from dark to bright, if brightness is what differs
            let key = |texels: &[u32]| mean(factors, 3 * size, texels).iter().map(|&v| f64::from(v)).sum();
            found.push(partition.ordered(key));
        }
        let recipe = recipe([0, 1, 2].map(|kind| found[kind].clusters), &settings);
        let writer = Writer::create(path, self, params, source, &recipe)?;
        for (kind, (partition, factors)) in found.iter().zip(&factors).enumerate() {
            let means = partition
                .members()
                .iter()
                .flat_map(|texels| mean(factors, 3 * sizes[kind], texels))
                .collect::<Vec<_>>();
            writer.write(NAMES[kind].0, 0, &stored(&means, precision)?)?;
            writer.write(NAMES[kind].1, 0, &index_image(partition))?;
        }
        Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("clusters", crate::codec::count(place, meta.texels().min(crate::codec::form::quantised::MAX_CLUSTERS)))]
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let settings = Settings::from_values(params)?;
        Ok(recipe([settings.clusters; 3], &settings))
    }
}

/// The mean of selected rows of `len` numbers.
fn mean(rows: &[f32], len: usize, which: &[u32]) -> Vec<f32> {
    let mut sums = vec![0.0f64; len];
    for &row in which {
        let row = &rows[row as usize * len..][..len];
        sums.iter_mut().zip(row).for_each(|(sum, &v)| *sum += f64::from(v));
    }
    sums.iter().map(|sum| (sum / which.len().max(1) as f64) as f32).collect()
}

/// The factors of all texels: (texel, place, rgb) for each kind.
fn factor(source: &dyn BtfSource, settings: &Settings, progress: &dyn Progress) -> Result<[Vec<f32>; 3]> {
    let (meta, domain) = (source.meta(), settings.domain.into());
    let pairs = Pairs::new(meta, settings.resolution);
    let columns = 3 * meta.pairs();
    let block = (BLOCK_BYTES / 4 / columns).clamp(1, meta.texels());
    let task = Task::new(progress, "factor", (meta.texels().div_ceil(block) * meta.views.len()) as u64);
    let mut factors = [const { Vec::new() }; 3];
    let mut rows = vec![0.0; block * columns];
    for first in (0..meta.texels()).step_by(block) {
        let count = block.min(meta.texels() - first);
        let rows = &mut rows[..count * columns];
        for view in 0..meta.views.len() {
            let values = ViewValues::read(source, view, domain)?;
            transpose(&values, meta, view, first, rows);
            source.release(view);
            task.advance(1)?;
        }
        if rows.iter().any(|v| !v.is_finite()) {
            return Err(Error::non_finite("the source, in this domain,"));
        }
        let found: Vec<[Vec<f32>; 3]> = rows.par_chunks_exact(columns).map(|row| pairs.factor(row)).collect();
        for texel in found {
            factors.iter_mut().zip(texel).for_each(|(all, of_texel)| all.extend(of_texel));
        }
    }
    Ok(factors)
}

/// Puts the values of a view into the rows (view, light, rgb) of texels from `first`.
fn transpose(values: &ViewValues, meta: &BtfMeta, view: usize, first: usize, rows: &mut [f32]) {
    let (columns, of_view) = (3 * meta.pairs(), 3 * meta.lights.len());
    let size = FloatTile::new(of_view).texels();
    rows.par_chunks_mut(size * columns).enumerate().for_each_init(
        || FloatTile::new(of_view),
        |tile, (i, rows)| {
            values.load(tile, first + i * size, rows.len() / columns);
            for (texel, row) in rows.chunks_exact_mut(columns).enumerate() {
                let row = &mut row[view * of_view..][..of_view];
                let texels = tile.data().chunks_exact(size);
                row.iter_mut().zip(texels).for_each(|(out, of_column)| *out = of_column[texel]);
            }
        },
    );
}

/// The position of each pair's half vector in the table.
struct Pairs {
    /// (view, light)
    stencils: Vec<[(usize, f32); 4]>,
    lights: usize,
    half_texels: usize,
}

impl Pairs {
    fn new(meta: &BtfMeta, resolution: usize) -> Self {
        let of_view =
            |&wo: &Vec3| meta.lights.directions().iter().map(move |&wi| Grid::stencil(resolution, half(wi, wo)));
        let stencils = meta.views.directions().iter().flat_map(of_view).collect();
        Self { stencils, lights: meta.lights.len(), half_texels: resolution * resolution }
    }

    /// P, Q and R, each (place, rgb), of a texel with values (view, light, rgb).
    fn factor(&self, row: &[f32]) -> [Vec<f32>; 3] {
        let views = self.stencils.len() / self.lights;
        let mut all = [self.lights, self.half_texels, views].map(|size| vec![0.0; 3 * size]);
        for channel in 0..3 {
            let f: Vec<f32> = row.iter().skip(channel).step_by(3).map(|v| v.max(0.0)).collect();
            let mut q = self.mean(&f);
            let known: Vec<f32> = self.stencils.iter().map(|s| at(s, |texel| q[texel])).collect();
            let [mut r, mut p] = weighted_terms(&f, &known, self.lights, 1, ROUNDS).pop().unwrap_or_default();
            let scale = [&mut p, &mut r].map(|factor| {
                let mean = (factor.iter().sum::<f32>() / factor.len() as f32).max(f32::MIN_POSITIVE);
                factor.iter_mut().for_each(|v| *v /= mean);
                mean
            });
            q.iter_mut().for_each(|v| *v *= scale[0] * scale[1]);
            for (out, factor) in all.iter_mut().zip([p, q, r]) {
                out.iter_mut().skip(channel).step_by(3).zip(factor).for_each(|(out, v)| *out = v);
            }
        }
        all
    }

    /// The mean over the pairs of each half vector; the overall mean where there are no pairs.
    fn mean(&self, f: &[f32]) -> Vec<f32> {
        let (mut sums, mut weights) = (vec![0.0f32; self.half_texels], vec![0.0f32; self.half_texels]);
        for (stencil, value) in self.stencils.iter().zip(f) {
            for &(texel, weight) in stencil {
                sums[texel] += weight * value;
                weights[texel] += weight;
            }
        }
        let all = sums.iter().sum::<f32>() / weights.iter().sum::<f32>();
        sums.iter().zip(&weights).map(|(sum, &weight)| if weight > 1e-6 { sum / weight } else { all }).collect()
    }
}

fn at(stencil: &[(usize, f32); 4], value: impl Fn(usize) -> f32) -> f32 {
    stencil.iter().map(|&(texel, weight)| weight * value(texel)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, MemoryBtf, SampleType, Texels};
    use crate::codec::open;
    use crate::color::Encoding;
    use crate::direction::DirectionSet;
    use crate::progress::Silent;

    /// Two by two texels, each a product of functions of light and view.
    fn products() -> MemoryBtf {
        let degrees = (0..9).map(|i| [8.0 * f64::from(i), 77.0 * f64::from(i)]).collect();
        let set = DirectionSet::from_degrees(degrees).unwrap();
        let (views, lights) = (set.clone(), set);
        let (encoding, cosine, sample_type) = (Encoding::Srgb, Cosine::Included, SampleType::F32);
        let meta = BtfMeta { width: 2, height: 2, views, lights, encoding, cosine, sample_type };
        let wave = |i: usize, k: usize| 0.6 + 0.3 * ((i * (k + 2)) as f32).sin();
        let value = |i: usize| {
            let (channel, texel, light, view) = (i % 3, i / 3 % 4, i / 12 % 9, i / 108);
            wave(channel, texel) * wave(light, texel) * wave(view, texel + 1)
        };
        let values: Vec<f32> = (0..9 * meta.view_len()).map(value).collect();
        MemoryBtf::new(meta, Texels::F32(values.into())).unwrap()
    }

    fn error(source: &MemoryBtf, clusters: &str) -> f64 {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.loden");
        // with so few texels the table of half vectors is nearly constant
        let given = [("clusters", clusters), ("resolution", "2"), ("precision", "f32")];
        Cmf.encode(source, &Values::new(Settings::TABLE, given).unwrap(), &path, &Silent).unwrap();
        crate::metric::compare(source, &*open(&path).unwrap(), &Silent).unwrap().mean_abs_error
    }

    #[test]
    fn products_are_found_and_clusters_lose_what_differs() {
        let source = products();
        let (all, one) = (error(&source, "4"), error(&source, "1"));
        assert!(all < 0.02 && one > 3.0 * all, "{all} {one}");
    }
}
