//! CMF: chained factorisation of every texel, its factors clustered and indexed.
//!
//! # Model
//! For each channel, a texel's ABRDF is a product P(light) Q(half vector) R(view): one factor per sampled light, one
//! per sampled view, and a square table over half vectors; with `factors` 4 also S(difference vector), a table like Q; or a
//! sum of several such products. Beginning with the mean of the
//! values over all pairs with a given half vector, the factors are improved in turn by least squares until the error
//! settles. All but Q are scaled to a mean square of 1, so that only Q carries the brightness of a texel.
//!
//! The factors of all texels are then clustered by k-means, each kind separately, and replaced by the cluster means: a
//! texel is an index for each kind. That start knows nothing of how the errors of factors multiply, so the clusters are refined by
//! the error of the product (a product quantiser): each texel takes the factors with which its product is closest to
//! its values, and each factor moves to the least-squares solution of the texels that use it, given their other factors.
//!
//! # Limits
//! Negative values become 0. Any dependence on light and view that is not a sum of products, such as parallax and cast shadows, is lost. While the
//! factors of texels are found, they take as much memory as a few per cent of the values. The source is read once if
//! its values in single precision take at most 1 GiB, otherwise once more for every kind of factor in every round.
//!
//! # References
//! suykens2003 (section 5), jegou2011 (the quantiser)

mod factors;
mod quantiser;

use std::path::Path;

use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, FloatType};
use crate::codec::container::Writer;
use crate::codec::form::quantised::{CLUSTERS, ITERATIONS, SEED, index_image};
use crate::codec::parts::{Axis, Expr, PlaneSpec, Recipe, TableSpec};
use crate::codec::values::{self, ViewValues, stored};
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::Domain;
use crate::factor::kmeans::{Partition, Points, Start, kmeans};
use crate::factor::tile::{FloatTile, Tile};
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::{Error, Result};
use factors::{Kind, SCALED, factor, kinds};
use quantiser::{Codebook, Quantiser, Sums};

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
        /// Factors of a product: of light, half vector and view; 4 also of the difference vector.
        factors: usize [3..=4] = 3,
        /// Products in the sum.
        terms: usize [1..=8] = 1,
        iterations: usize = 20 => ITERATIONS,
        /// Rounds in which the clusters are refined by the error of the product.
        rounds: usize [0..=100] = 4,
        seed: u64 => SEED,
        precision: FloatType => values::FLOAT_PRECISION,
        /// Values that are factored: display values (as stored in photographs), or linear light.
        domain: Factored = "display",
    }
}

/// Bytes of values in memory at a time.
const BLOCK_BYTES: usize = 1 << 30;

/// Name of the table of a term.
fn table_name(kind: &str, term: usize) -> String {
    if term == 0 { kind.into() } else { format!("{kind}_{}", term + 1) }
}

fn plane_name(kind: &str) -> String {
    format!("{kind}_index")
}

/// The names and axes of the kinds of factors.
fn axes(settings: &Settings) -> Vec<(&'static str, Axis)> {
    let Settings { resolution, factors, .. } = *settings;
    let all = [
        ("light", Axis::Light),
        ("half", Axis::Half(resolution)),
        ("view", Axis::View),
        ("difference", Axis::Difference(resolution)),
    ];
    all[..factors].to_vec()
}

/// The recipe with this many clusters of each kind; each texel is the product of one factor of each kind.
fn recipe(clusters: &[usize], settings: &Settings) -> Recipe {
    let kinds = || axes(settings).into_iter().zip(clusters.iter().copied());
    let table = |term: usize, ((name, axis), clusters): ((&str, Axis), usize)| {
        let axes = [Axis::Row(clusters), axis, Axis::Channel];
        TableSpec::new(&table_name(name, term), &axes, settings.precision.into())
    };
    let count = settings.factors;
    let factor = |term: usize, kind: usize| Expr::Table { table: count * term + kind, row: Some(kind) };
    let product = |term: usize| Expr::Product((0..count).map(|kind| factor(term, kind)).collect());
    Recipe {
        planes: kinds().map(|((name, _), clusters)| PlaneSpec::index(&plane_name(name), clusters)).collect(),
        tables: (0..settings.terms).flat_map(|term| kinds().map(move |kind| table(term, kind))).collect(),
        value: if settings.terms == 1 { product(0) } else { Expr::Sum((0..settings.terms).map(product).collect()) },
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
        source.meta().check_grid("cmf")?;
        let settings = Settings::from_values(params)?;
        let kinds = kinds(source.meta(), settings.resolution, settings.factors);
        let mut rows = Rows::new(source, Domain::from(settings.domain));
        let (factors, scale) = factor_all(&mut rows, &kinds, settings.terms, progress)?;
        let (books, mut indices) = clusters(factors, &kinds, &settings, progress)?;
        let mut quantiser = Quantiser { kinds: &kinds, terms: settings.terms, books };
        refine(&mut rows, &mut quantiser, &mut indices, scale, settings.rounds, progress)?;
        let used: Vec<Vec<u32>> =
            indices.iter_mut().zip(&quantiser.books).map(|(index, book)| renumber(index, book)).collect();
        let counts: Vec<usize> = used.iter().map(Vec::len).collect();
        let recipe = recipe(&counts, &settings);
        let writer = Writer::create(path, self, params, source, &recipe)?;
        for (k, (kind, used)) in kinds.iter().zip(&used).enumerate() {
            let scale = if k == SCALED { scale } else { 1.0 };
            for term in 0..settings.terms {
                let numbers = quantiser.numbers(k, term, used, scale);
                writer.write(&table_name(kind.name, term), 0, &stored(&numbers, settings.precision)?)?;
            }
            let partition = Partition { index: std::mem::take(&mut indices[k]), clusters: used.len() };
            writer.write(&plane_name(kind.name), 0, &index_image(&partition))?;
        }
        Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("clusters", crate::codec::count(place, meta.texels().min(crate::codec::form::quantised::MAX_CLUSTERS)))]
    }

    fn limits(&self, meta: &BtfMeta, _params: &Values) -> Result<Vec<(&'static str, usize)>> {
        Ok(vec![("clusters", meta.texels())])
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let settings = Settings::from_values(params)?;
        Ok(recipe(&[settings.clusters; 4], &settings))
    }
}

/// Rows of values, one per texel: (texel, rgb, pair).
struct Rows<'a> {
    source: &'a dyn BtfSource,
    domain: Domain,
    /// The values of the block that was read last, and its first texel.
    values: Vec<f32>,
    first: Option<usize>,
}

impl<'a> Rows<'a> {
    fn new(source: &'a dyn BtfSource, domain: Domain) -> Self {
        Self { source, domain, values: Vec::new(), first: None }
    }

    fn columns(&self) -> usize {
        3 * self.source.meta().pairs()
    }

    /// The first texel of each block, and the number of texels in one.
    fn blocks(&self) -> (impl Iterator<Item = usize> + use<>, usize) {
        let texels = self.source.meta().texels();
        let block = (BLOCK_BYTES / 4 / self.columns()).clamp(1, texels);
        ((0..texels).step_by(block), block)
    }

    /// The values of the block that begins with texel `first`.
    fn read(&mut self, first: usize, block: usize) -> Result<&[f32]> {
        if self.first == Some(first) {
            return Ok(&self.values);
        }
        let meta = self.source.meta();
        self.values.resize(block.min(meta.texels() - first) * self.columns(), 0.0);
        for view in 0..meta.views.len() {
            let values = ViewValues::read(self.source, view, self.domain)?;
            transpose(&values, meta, view, first, &mut self.values);
            self.source.release(view);
        }
        if self.values.iter().any(|v| !v.is_finite()) {
            return Err(Error::non_finite("the source, in this domain,"));
        }
        self.values.iter_mut().for_each(|v| *v = v.max(0.0));
        self.first = Some(first);
        Ok(&self.values)
    }
}

/// Puts the values of a view into the rows of texels from `first`.
fn transpose(values: &ViewValues, meta: &BtfMeta, view: usize, first: usize, rows: &mut [f32]) {
    let (pairs, lights) = (meta.pairs(), meta.lights.len());
    let size = FloatTile::new(3 * lights).texels();
    rows.par_chunks_mut(size * 3 * pairs).enumerate().for_each_init(
        || FloatTile::new(3 * lights),
        |tile, (i, rows)| {
            values.load(tile, first + i * size, rows.len() / (3 * pairs));
            for (texel, row) in rows.chunks_exact_mut(3 * pairs).enumerate() {
                for (column, texels) in tile.data().chunks_exact(size).enumerate() {
                    row[column % 3 * pairs + view * lights + column / 3] = texels[texel];
                }
            }
        },
    );
}

/// The factors of all texels, for each kind (texel, term, rgb, node), and the mean absolute value.
fn factor_all(rows: &mut Rows, kinds: &[Kind], terms: usize, progress: &dyn Progress) -> Result<(Vec<Vec<f32>>, f32)> {
    let (blocks, block) = rows.blocks();
    let texels = rows.source.meta().texels();
    let (columns, mut sum) = (rows.columns(), 0.0f64);
    let task = Task::new(progress, "factor", texels as u64);
    let mut factors = vec![Vec::new(); kinds.len()];
    for first in blocks {
        let of_texel = |row: &[f32]| {
            task.advance(1)?;
            let channels: Vec<_> = row.chunks_exact(columns / 3).map(|f| factor(kinds, terms, f)).collect();
            Ok((channels, row.iter().map(|v| f64::from(v.abs())).sum::<f64>()))
        };
        let found: Vec<_> = rows.read(first, block)?.par_chunks_exact(columns).map(of_texel).collect::<Result<_>>()?;
        for (channels, absolute) in found {
            sum += absolute;
            for (k, (all, kind)) in factors.iter_mut().zip(kinds).enumerate() {
                for term in 0..terms {
                    let range = term * kind.nodes..(term + 1) * kind.nodes;
                    channels.iter().for_each(|tables| all.extend(&tables[k][range.clone()]));
                }
            }
        }
    }
    let scale = (sum / (texels * columns) as f64) as f32;
    Ok((factors, if scale.is_normal() { scale } else { 1.0 }))
}

/// A codebook for each kind by k-means, and the index of each texel.
fn clusters(
    factors: Vec<Vec<f32>>,
    kinds: &[Kind],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(Vec<Codebook>, Vec<Vec<u32>>)> {
    let Settings { clusters, iterations, seed, terms, .. } = *settings;
    let task = Task::new(progress, "cluster", (kinds.len() * (iterations + clusters)) as u64);
    let (mut books, mut indices) = (Vec::new(), Vec::new());
    for (factors, kind) in factors.into_iter().zip(kinds) {
        let size = 3 * terms * kind.nodes;
        let points = Points::new(&factors, size);
        let partition = kmeans(&points, clusters, Start::Distant(seed), iterations, &|| task.advance(1))?;
        let words = partition.members().iter().flat_map(|texels| mean(&factors, size, texels)).collect();
        books.push(Codebook { words, size });
        indices.push(partition.index);
    }
    Ok((books, indices))
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

/// Lowers the error of the products. Values are divided by `scale`, and so are the half vector's codewords afterwards.
fn refine(
    rows: &mut Rows,
    quantiser: &mut Quantiser,
    indices: &mut [Vec<u32>],
    scale: f32,
    rounds: usize,
    progress: &dyn Progress,
) -> Result<()> {
    let (texels, columns) = (rows.source.meta().texels(), rows.columns());
    quantiser.books[SCALED].words.iter_mut().for_each(|v| *v /= scale);
    let task = Task::new(progress, "refine", (rounds * quantiser.kinds.len() * texels) as u64);
    for kind in (0..rounds).flat_map(|_| 0..quantiser.kinds.len()) {
        let mut sums = Sums::of(&quantiser.books[kind]);
        let (blocks, block) = rows.blocks();
        for first in blocks {
            let scaled: Vec<f32> = rows.read(first, block)?.iter().map(|v| v / scale).collect();
            // Assign texels to codewords
            let assigned = |(i, texel): (usize, &[f32])| {
                task.advance(1)?;
                let mut index: Vec<u32> = indices.iter().map(|index| index[first + i]).collect();
                quantiser.assign(texel, &mut index);
                Ok(index)
            };
            let found: Vec<Vec<u32>> =
                scaled.par_chunks_exact(columns).enumerate().map(assigned).collect::<Result<_>>()?;
            for (i, found) in found.into_iter().enumerate() {
                indices.iter_mut().zip(found).for_each(|(index, found)| index[first + i] = found);
            }
            // Gather what the codewords need
            let mut members = vec![Vec::new(); quantiser.books[kind].count()];
            for texel in first..first + scaled.len() / columns {
                members[indices[kind][texel] as usize].push(texel as u32);
            }
            quantiser.gather(kind, &scaled, first, &members, indices, &mut sums);
        }
        quantiser.update(kind, &sums);
    }
    Ok(())
}

/// Numbers the codewords in use from dark to bright, if brightness is what differs; returns them in this order.
fn renumber(index: &mut [u32], book: &Codebook) -> Vec<u32> {
    let mut used = index.to_vec();
    used.sort_unstable();
    used.dedup();
    let key = |word: u32| book.word(word).iter().map(|v| f64::from(*v)).sum::<f64>();
    used.sort_by(|a, b| key(*a).total_cmp(&key(*b)));
    let mut number = vec![0; book.count()];
    used.iter().enumerate().for_each(|(new, old)| number[*old as usize] = new as u32);
    index.iter_mut().for_each(|word| *word = number[*word as usize]);
    used
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
