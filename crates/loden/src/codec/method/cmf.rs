//! CMF: chained factorisation of every texel, its factors clustered and indexed.
//!
//! # Model
//! A texel's ABRDF is a product P(light) Q(half vector) R(view) for each channel, with a factor for each sampled light and
//! view and a square table over half vectors. Q is the mean of the values over all pairs of a half vector; P and R
//! come closest to the quotient, weighted by Q squared ([`crate::separable`]). P and R are scaled to a mean of 1, so that
//! Q alone says how bright a texel is. Then the factors of all texels are put into clusters by k-means, each kind for
//! itself, and replaced by the means: a texel is three indices.
//!
//! # Limits
//! Factors are positive. What depends on light and view otherwise than as a product, such as parallax and cast shadows, is
//! lost. The source is read once for every 256 MiB of its values in single precision.
//!
//! # References
//! suykens2003 (section 5)

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, SampleType};
use crate::codec::container::{Container, TensorSpec, Writer};
use crate::codec::decoder::{Decoder, Opened};
use crate::codec::quantised::{CLUSTERS, ITERATIONS, SEED, index_bytes, index_image, read_index, stored_clusters};
use crate::codec::values::{self, ViewValues, numbers, stored};
use crate::codec::{Codec, CompressedBtf, EncodeSummary};
use crate::color::domain::{Domain, Linearizer};
use crate::direction::{Scheme, half};
use crate::factor::kmeans::{Points, Start, kmeans};
use crate::factor::tile::{FloatTile, Tile};
use crate::material::Material;
use crate::material::angles::{Angles, AngularStencil, Footprint};
use crate::material::sampled::Sampled;
use crate::params::{Kind, Param, Values};
use crate::progress::{Progress, Task};
use crate::separable::Grid;
use crate::separable::cmf::weighted_terms;
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cmf;

const PARAMS: &[Param] = &[
    Param { doc: "Clusters of the factors of each kind; fewer if there are not as many different ones.", ..CLUSTERS },
    Param {
        name: "resolution",
        unit: "",
        kind: Kind::Integer { min: 2, max: 64 },
        default: "12",
        doc: "Texels along each side of the tables over half vectors.",
    },
    Param { default: "20", ..ITERATIONS },
    SEED,
    values::PRECISION,
    Param {
        name: "domain",
        unit: "",
        kind: Kind::Choice(&["display", "linear"]),
        default: "display",
        doc: "Values that are factored: as displayed (the stored values of photographs), or linear light.",
    },
];

/// Bytes of the values that are factored at once.
const BLOCK_BYTES: usize = 256 << 20;

/// Rounds of the updates of P and R.
const ROUNDS: usize = 8;

/// Block and index of each kind of factor.
const NAMES: [(&str, &str); 3] = [("light", "light_index"), ("half", "half_index"), ("view", "view_index")];

/// Numbers of each kind of factor, of one channel.
fn sizes(meta: &BtfMeta, resolution: usize) -> [usize; 3] {
    [meta.lights.len(), resolution * resolution, meta.views.len()]
}

fn block(kind: usize, clusters: usize, meta: &BtfMeta, params: &Values) -> TensorSpec {
    let size = sizes(meta, params.integer("resolution") as usize)[kind];
    TensorSpec { name: NAMES[kind].0.into(), sample_type: values::precision(params), shape: vec![clusters, size, 3] }
}

fn index(kind: usize, clusters: usize, meta: &BtfMeta) -> TensorSpec {
    let shape = vec![meta.height, meta.width, index_bytes(clusters)];
    TensorSpec { name: NAMES[kind].1.into(), sample_type: SampleType::U8, shape }
}

impl Codec for Cmf {
    fn name(&self) -> &'static str {
        "cmf"
    }

    fn doc(&self) -> &'static str {
        "A product of functions of light, half vector and view in every texel, clustered: three indices each."
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
        let factors = factor(source, params, progress)?;
        let sizes = sizes(meta, integer("resolution"));
        let task = Task::new(progress, "cluster", 3 * (integer("iterations") + integer("clusters")) as u64);
        let mut found = Vec::new();
        for (factors, size) in factors.iter().zip(sizes) {
            let (points, start) = (Points::new(factors, 3 * size), Start::Distant(params.integer("seed") as u64));
            let partition = kmeans(&points, integer("clusters"), start, integer("iterations"), &|| task.advance(1))?;
            // from dark to bright where that is what differs
            let key = |texels: &[u32]| mean(factors, 3 * size, texels).iter().map(|&v| f64::from(v)).sum();
            found.push(partition.ordered(key));
        }
        let blocks = found.iter().enumerate().map(|(kind, p)| block(kind, p.clusters, meta, params));
        let indices = found.iter().enumerate().map(|(kind, p)| index(kind, p.clusters, meta));
        let layout: Vec<TensorSpec> = blocks.chain(indices).collect();
        let writer = Writer::create(path, self.name(), params, source, &layout)?;
        for (kind, (partition, factors)) in found.iter().zip(&factors).enumerate() {
            let means = partition
                .members()
                .iter()
                .flat_map(|texels| mean(factors, 3 * sizes[kind], texels))
                .collect::<Vec<_>>();
            writer.write(kind, 0, &stored(&means, params)?)?;
            writer.write(3 + kind, 0, &index_image(partition))?;
        }
        Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("clusters", crate::codec::count(place, meta.texels().min(crate::codec::quantised::MAX_CLUSTERS)))]
    }

    fn open(&self, container: Container) -> Result<Arc<dyn CompressedBtf>> {
        let opened = Opened::new(container, self)?;
        let Opened { container, params, meta, .. } = &opened;
        let mut factors = Vec::new();
        for (kind, (name, index_name)) in NAMES.into_iter().enumerate() {
            let clusters = stored_clusters(container, name, params)?;
            let spec = index(kind, clusters, meta);
            let tensor = container.tensor(&spec.name, spec.sample_type, &spec.shape)?;
            let index = read_index(container, index_name, &tensor, clusters)?;
            let values = numbers(container, &block(kind, clusters, meta, params))?;
            let values: Vec<Vec3> = values.chunks_exact(3).map(Vec3::from_slice).collect();
            factors.push(Factors { size: values.len() / clusters, values, index });
        }
        let Ok([light, half, view]) = <[Factors; 3]>::try_from(factors) else {
            return Err(Error::invalid(container.path(), "header", "a tensor is missing"));
        };
        let domain = Domain::from_name(params.text("domain"));
        let resolution = params.integer("resolution") as usize;
        Ok(Arc::new(CmfBtf { domain, resolution, light, half, view, opened }))
    }
}

/// The mean of some rows of `len` numbers.
fn mean(rows: &[f32], len: usize, which: &[u32]) -> Vec<f32> {
    let mut sums = vec![0.0f64; len];
    for &row in which {
        let row = &rows[row as usize * len..][..len];
        sums.iter_mut().zip(row).for_each(|(sum, &v)| *sum += f64::from(v));
    }
    sums.iter().map(|sum| (sum / which.len().max(1) as f64) as f32).collect()
}

/// The factors of all texels: for each kind (texel, place, rgb).
fn factor(source: &dyn BtfSource, params: &Values, progress: &dyn Progress) -> Result<[Vec<f32>; 3]> {
    let (meta, domain) = (source.meta(), Domain::from_name(params.text("domain")));
    let resolution = params.integer("resolution") as usize;
    let pairs = Pairs::new(meta, resolution);
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
            return Err(Error::parameter("source", "it holds numbers that are not finite in this domain"));
        }
        let found: Vec<[Vec<f32>; 3]> = rows.par_chunks_exact(columns).map(|row| pairs.factor(row)).collect();
        for texel in found {
            factors.iter_mut().zip(texel).for_each(|(all, of_texel)| all.extend(of_texel));
        }
    }
    Ok(factors)
}

/// Puts the values of a view into rows (view, light, rgb) of texels from `first`.
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

/// Where the half vector of each pair is in its table.
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

    /// P, Q and R of a texel with values (view, light, rgb): each (place, rgb).
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

    /// The mean over the pairs of a half vector; that of all where there are none.
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

/// The clusters of one kind of factor.
#[derive(Debug)]
struct Factors {
    /// (cluster, place)
    values: Vec<Vec3>,
    size: usize,
    /// (texel)
    index: Vec<u16>,
}

impl Factors {
    /// What a texel has at some places.
    fn of_texel(&self, texel: usize, places: impl Iterator<Item = (usize, f32)>) -> Vec3 {
        self.of_cluster(usize::from(self.index[texel]), places)
    }

    fn of_cluster(&self, cluster: usize, places: impl Iterator<Item = (usize, f32)>) -> Vec3 {
        let row = &self.values[cluster * self.size..][..self.size];
        places.map(|(place, weight)| row[place] * weight).sum()
    }

    /// What all clusters have at some places.
    fn palette(&self, places: impl Iterator<Item = (usize, f32)> + Clone) -> Vec<Vec3> {
        (0..self.values.len() / self.size).map(|cluster| self.of_cluster(cluster, places.clone())).collect()
    }
}

/// Opened: factors in single precision.
#[derive(Debug)]
struct CmfBtf {
    opened: Opened,
    domain: Domain,
    resolution: usize,
    light: Factors,
    half: Factors,
    view: Factors,
}

impl Decoder for CmfBtf {
    fn opened(&self) -> &Opened {
        &self.opened
    }

    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let meta = &self.opened.meta;
        for (light, out) in lights.zip(out.chunks_exact_mut(meta.image_len())) {
            let wh = half(meta.lights.directions()[light], meta.views.directions()[view]);
            let p = self.light.palette([(light, 1.0)].into_iter());
            let q = self.half.palette(Grid::stencil(self.resolution, wh).into_iter());
            let r = self.view.palette([(view, 1.0)].into_iter());
            let indices = self.light.index.iter().zip(&self.half.index).zip(&self.view.index);
            for (out, ((&i, &j), &k)) in out.chunks_exact_mut(3).zip(indices) {
                let value = p[usize::from(i)] * q[usize::from(j)] * r[usize::from(k)];
                out.copy_from_slice(&value.to_array().map(|v| self.domain.to_stored(meta.encoding, v)));
            }
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        let bytes = |f: &Factors| size_of_val(&f.values[..]) + size_of_val(&f.index[..]);
        [&self.light, &self.half, &self.view].map(bytes).iter().sum::<usize>() as u64
    }

    fn evaluable(self: Arc<Self>, scheme: Scheme) -> Result<Arc<dyn Material>> {
        let angles = Angles::new(&self.opened.meta, scheme)?;
        let linearizer = Linearizer::new(self.domain, self.opened.meta.encoding);
        let material = CmfMaterial { btf: self.clone(), angles, linearizer };
        Ok(Arc::new(Sampled::new(material, &self.opened.meta, scheme)?))
    }
}

/// Factors are interpolated between directions, their products between texels.
struct CmfMaterial {
    btf: Arc<CmfBtf>,
    angles: Angles,
    linearizer: Linearizer,
}

impl CmfMaterial {
    fn value(&self, texel: usize, stencil: &AngularStencil, wh: &[(usize, f32); 4]) -> Vec3 {
        let CmfBtf { light, half, view, .. } = &*self.btf;
        light.of_texel(texel, stencil.light.iter())
            * half.of_texel(texel, wh.iter().copied())
            * view.of_texel(texel, stencil.view.iter())
    }
}

impl Material for CmfMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let Some(stencil) = self.angles.stencil(wi, wo) else { return Vec3::ZERO };
        let wh = Grid::stencil(self.btf.resolution, half(wi, wo));
        let footprint = Footprint::new(uv, self.btf.opened.meta.width, self.btf.opened.meta.height);
        let texels = footprint.texel.into_iter().zip(footprint.weight);
        let sum: Vec3 = texels.map(|(texel, weight)| self.value(texel, &stencil, &wh) * weight).sum();
        Vec3::from(sum.to_array().map(|v| self.linearizer.linear(v))) * stencil.factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, MemoryBtf, Texels};
    use crate::codec::open;
    use crate::color::Encoding;
    use crate::direction::DirectionSet;
    use crate::progress::Silent;

    /// Two by two texels of which each is a product of functions of light and view.
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
        // one half vector's table is nearly constant over so few texels
        let given = [("clusters", clusters), ("resolution", "2"), ("precision", "f32")];
        Cmf.encode(source, &Values::new(PARAMS, given).unwrap(), &path, &Silent).unwrap();
        crate::metric::compare(source, &*open(&path).unwrap(), &Silent).unwrap().mean_abs_error
    }

    #[test]
    fn products_are_found_and_clusters_lose_what_differs() {
        let source = products();
        let (all, one) = (error(&source, "4"), error(&source, "1"));
        assert!(all < 0.02 && one > 3.0 * all, "{all} {one}");
    }
}
