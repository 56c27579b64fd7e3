//! Computes the mean ABRDF of each cluster in one pass over the source and writes it.

use std::borrow::Cow;
use std::path::Path;

use rayon::prelude::*;

use super::{Block, recipe};
use crate::btf::{BtfMeta, BtfSource, FloatType, SampleType, Texels};
use crate::codec::container::Writer;
use crate::codec::parts::Curve;
use crate::codec::parts::recipe::index_bytes;
use crate::codec::values::{halves, view_texels};
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::Domain;
use crate::factor::kmeans::Partition;
use crate::params::Values;
use crate::progress::Task;
use crate::simd::wide;
use crate::{Error, Result};

/// Bytes of the block collected before they are written.
pub(super) const PART_BYTES: usize = 32 << 20;

/// Writes to `path` the means of the clusters, in the domain of the parameters, and the index image. Reads each view
/// once and advances `task` for it.
///
/// # Errors
/// Errors of the source; [`Error::Parameter`] if a number exceeds the precision; [`Error::Io`]; [`Error::Cancelled`].
pub fn write(
    codec: &dyn Codec,
    source: &dyn BtfSource,
    params: &Values,
    block: &Block,
    path: &Path,
    partition: &Partition,
    task: &Task,
) -> Result<EncodeSummary> {
    let (meta, clusters) = (source.meta(), partition.clusters);
    let (precision, domain) = (block.precision, block.domain);
    let recipe = recipe(clusters, 0, precision, Curve::Display);
    let writer = Writer::create(path, codec, params, source, &recipe)?;
    let row = 3 * meta.lights.len();
    let bytes = row * precision.bytes();
    let mut warnings = Vec::new();
    let views: Vec<usize> = (0..meta.views.len()).collect();
    for part in views.chunks((PART_BYTES / (clusters * bytes)).max(1)) {
        let mut view_bytes = Vec::new();
        for &view in part {
            let means = view_means(source, view, domain, partition)?;
            source.release(view);
            task.advance(1)?;
            let (bytes, range) = stored(&means, precision, view)?;
            view_bytes.push(bytes);
            if let Some(range) = range {
                writer.write("block_range", (view * size_of_val(&range)) as u64, bytemuck::cast_slice(&range))?;
                if warnings.is_empty() {
                    warnings.extend(coarse(range, view));
                }
            }
        }
        for cluster in 0..clusters {
            let piece: Vec<u8> =
                view_bytes.iter().flat_map(|view| &view[cluster * bytes..(cluster + 1) * bytes]).copied().collect();
            writer.write("block", ((cluster * views.len() + part[0]) * bytes) as u64, &piece)?;
        }
    }
    writer.write("index", 0, &index_image(partition))?;
    Ok(EncodeSummary { bytes: writer.commit()?, warnings })
}

/// Writes to `path` the means of the clusters, the components that reproduce the texels with the least squared error
/// for the given `coefficients` (texel, component), and these coefficients, all in the domain of the parameters. The
/// coefficients of a cluster must have mean 0 and be uncorrelated. Reads each view once and advances `task` for it.
///
/// # Errors
/// As [`write()`].
#[expect(clippy::too_many_arguments, reason = "what is written, and how")]
pub fn write_with_components(
    codec: &dyn Codec,
    source: &dyn BtfSource,
    params: &Values,
    precision: FloatType,
    domain: Domain,
    path: &Path,
    partition: &Partition,
    coefficients: &[f32],
    task: &Task,
) -> Result<EncodeSummary> {
    let (meta, precision) = (source.meta(), SampleType::from(precision));
    let c = coefficients.len() / meta.texels();
    let recipe = recipe(partition.clusters, c, precision, domain.into());
    let writer = Writer::create(path, codec, params, source, &recipe)?;
    let fit = Fit::new(partition, coefficients, c);
    let row = 3 * meta.lights.len();
    for view in 0..meta.views.len() {
        let rows = fit.view(source, view, domain)?;
        source.release(view);
        task.advance(1)?;
        let (bytes, _) = stored(&rows, precision, view)?;
        let len = row * precision.bytes();
        for (i, piece) in bytes.chunks_exact(len).enumerate() {
            let (cluster, k) = (i / (1 + c), i % (1 + c));
            let (tensor, place) = if k == 0 { ("block", cluster) } else { ("components", cluster * c + k - 1) };
            writer.write(tensor, ((place * meta.views.len() + view) * len) as u64, piece)?;
        }
    }
    writer.write("coefficients", 0, &stored(coefficients, precision, 0)?.0)?;
    writer.write("index", 0, &index_image(partition))?;
    Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
}

/// Texels by cluster, with the factors of the least-squares fit.
struct Fit {
    members: Vec<Vec<u32>>,
    /// Factors of each member: groups of [`LANES`], a 1 followed by the coefficients.
    factors: Vec<Vec<[f32; LANES]>>,
    /// (cluster, 1 + component): factor of a sum of products.
    scale: Vec<Vec<f64>>,
    rows: usize,
}

/// Factors multiplied together.
const LANES: usize = 8;

/// Length of the single-precision sums that are added up in double precision.
const RUN: usize = 256;

impl Fit {
    fn new(partition: &Partition, coefficients: &[f32], c: usize) -> Self {
        let members = partition.members();
        let groups = (1 + c).div_ceil(LANES);
        let row = |p: u32, k: usize| match k {
            0 => 1.0,
            _ => coefficients.get(p as usize * c + k - 1).copied().filter(|_| k <= c).unwrap_or(0.0),
        };
        let of_member = |p: u32| (0..groups).map(move |g| std::array::from_fn(|i| row(p, g * LANES + i)));
        let factors = members.iter().map(|m| m.iter().flat_map(|&p| of_member(p)).collect()).collect();
        let scale = |m: &Vec<u32>, k: usize| {
            let squares: f64 = m.iter().map(|&p| f64::from(row(p, k)).powi(2)).sum();
            if squares > 0.0 { 1.0 / squares } else { 0.0 }
        };
        let scale = members.iter().map(|m| (0..=c).map(|k| scale(m, k)).collect()).collect();
        Self { members, factors, scale, rows: 1 + c }
    }

    /// Means and components of a view, shape (cluster, 1 + component, light, rgb).
    fn view(&self, source: &dyn BtfSource, view: usize, domain: Domain) -> Result<Vec<f32>> {
        let meta = source.meta();
        let texels = view_texels(source, view)?;
        let lights = meta.lights.len();
        let of_light = |light: usize| {
            let image = texels.part(light * meta.image_len()..(light + 1) * meta.image_len());
            let image = in_domain(&image, meta, domain);
            let of_cluster = |k: usize| self.rows_of(k, &image);
            (0..self.members.len()).flat_map(of_cluster).collect::<Vec<[f32; 3]>>()
        };
        let images: Vec<Vec<[f32; 3]>> = (0..lights).into_par_iter().map(of_light).collect();
        let rows = 0..self.members.len() * self.rows;
        Ok(rows.flat_map(|row| images.iter().flat_map(move |image| image[row])).collect())
    }

    /// Mean and components of a cluster in one image.
    fn rows_of(&self, cluster: usize, image: &[f32]) -> Vec<[f32; 3]> {
        let groups = self.rows.div_ceil(LANES);
        let mut sums = vec![[[0.0f64; LANES]; 3]; groups];
        let members = self.members[cluster].chunks(RUN);
        for (members, factors) in members.zip(self.factors[cluster].chunks(RUN * groups)) {
            let mut part = vec![[[0.0f32; LANES]; 3]; groups];
            add_products(image, members, factors, &mut part);
            for (sum, part) in sums.iter_mut().flatten().flatten().zip(part.iter().flatten().flatten()) {
                *sum += f64::from(*part);
            }
        }
        let scale = |k: usize| self.scale[cluster][k];
        let value = |k: usize, channel: usize| (sums[k / LANES][channel][k % LANES] * scale(k)) as f32;
        (0..self.rows).map(|k| std::array::from_fn(|channel| value(k, channel))).collect()
    }
}

wide! {
    /// Adds the products of texels and their factors.
    fn add_products(image: &[f32], texels: &[u32], factors: &[[f32; LANES]], sums: &mut [[[f32; LANES]; 3]]) {
        for (&texel, factors) in texels.iter().zip(factors.chunks_exact(sums.len())) {
            let Some(rgb) = image.get(3 * texel as usize..3 * texel as usize + 3) else { continue };
            for (sums, factors) in sums.iter_mut().zip(factors) {
                for channel in 0..3 {
                    for i in 0..LANES {
                        sums[channel][i] += rgb[channel] * factors[i];
                    }
                }
            }
        }
    }
}

/// The values of an image in the domain.
fn in_domain<'a>(image: &'a Texels, meta: &BtfMeta, domain: Domain) -> Cow<'a, [f32]> {
    let curve = |value: f32| domain.from_stored(meta.encoding, value);
    match image {
        Texels::U8(values) => {
            let of_byte: [f32; 256] = std::array::from_fn(|i| curve(i as f32 / 255.0));
            values.iter().map(|&v| of_byte[usize::from(v)]).collect()
        }
        Texels::F16(values) => values.iter().map(|v| curve(v.to_f32())).collect(),
        Texels::F32(values) if domain.is_stored(meta.encoding) => Cow::Borrowed(values),
        Texels::F32(values) => values.iter().map(|&v| curve(v)).collect(),
    }
}

/// The bytes of the tensor of indices.
pub fn index_image(partition: &Partition) -> Vec<u8> {
    let bytes = index_bytes(partition.clusters);
    partition.index.iter().flat_map(|k| k.to_le_bytes().into_iter().take(bytes)).collect()
}

/// Offset and scale of 8-bit numbers of 0..1.
const PLAIN: [f32; 2] = [0.0, 1.0 / 255.0];

/// A warning if 8-bit numbers span a wide range.
fn coarse(range: [f32; 2], view: usize) -> Option<String> {
    let [low, high] = [range[0], range[0] + 255.0 * range[1]];
    let problem = "8 bits are coarse for this range; f16 is more precise";
    (range != PLAIN).then(|| format!("precision: view {view} has values from {low} to {high}; {problem}"))
}

/// Numbers in the file's precision; with offset and scale for 8 bits.
fn stored(means: &[f32], precision: SampleType, view: usize) -> Result<(Vec<u8>, Option<[f32; 2]>)> {
    let (low, high) = means.iter().fold((0.0f32, 1.0f32), |(low, high), &v| (low.min(v), high.max(v)));
    if !(low.is_finite() && high.is_finite()) || means.iter().any(|v| v.is_nan()) {
        return Err(Error::non_finite(format!("view {view} of the source, in this domain,")));
    }
    match precision {
        SampleType::F32 => Ok((bytemuck::cast_slice(means).to_vec(), None)),
        SampleType::F16 => Ok((bytemuck::cast_slice(&halves(means, &format!("view {view}"))?).to_vec(), None)),
        SampleType::U8 => {
            let scale = (high - low) / 255.0;
            let range = if (low, high) == (0.0, 1.0) { PLAIN } else { [low, scale] };
            Ok((means.iter().map(|v| ((v - range[0]) / range[1] + 0.5) as u8).collect(), Some(range)))
        }
    }
}

/// The mean of each cluster in a view, averaged in `domain`, as display values: (cluster, light, rgb).
fn view_means(source: &dyn BtfSource, view: usize, domain: Domain, partition: &Partition) -> Result<Vec<f32>> {
    let meta = source.meta();
    let mut counts = vec![0u32; partition.clusters];
    partition.index.iter().for_each(|&k| counts[k as usize] += 1);
    let texels = view_texels(source, view)?;
    let lights = meta.lights.len();
    let images: Vec<Vec<[f64; 3]>> = (0..lights)
        .into_par_iter()
        .map(|light| {
            let image = texels.part(light * meta.image_len()..(light + 1) * meta.image_len());
            image_sums(&image, meta, domain, partition)
        })
        .collect();
    let mut means = vec![0.0; partition.clusters * lights * 3];
    means.par_chunks_exact_mut(3 * lights).enumerate().for_each(|(k, row)| {
        for (out, sums) in row.chunks_exact_mut(3).zip(&images) {
            for (out, sum) in out.iter_mut().zip(sums[k]) {
                let mean = (sum / f64::from(counts[k])) as f32;
                *out = Domain::Display.from_stored(meta.encoding, domain.to_stored(meta.encoding, mean));
            }
        }
    });
    Ok(means)
}

/// Sums of an image over the texels of each cluster, in the domain.
fn image_sums(image: &Texels, meta: &BtfMeta, domain: Domain, partition: &Partition) -> Vec<[f64; 3]> {
    let (index, clusters) = (&partition.index[..], partition.clusters);
    let curve = |value: f32| domain.from_stored(meta.encoding, value);
    match image {
        Texels::U8(values) if domain.is_stored(meta.encoding) => {
            let mut sums = vec![[0.0; 3]; clusters];
            // sums of 2^24 bytes fit 32 bits
            for (texels, index) in values.chunks(3 << 24).zip(index.chunks(1 << 24)) {
                let mut part = vec![[0u32; 4]; clusters];
                add_bytes(texels, index, &mut part);
                for (sum, part) in sums.iter_mut().zip(part) {
                    (0..3).for_each(|c| sum[c] += f64::from(part[c]) / 255.0);
                }
            }
            sums
        }
        Texels::U8(values) => {
            let of_byte: [f32; 256] = std::array::from_fn(|i| curve(i as f32 / 255.0));
            add(values, index, clusters, |v| of_byte[usize::from(v)])
        }
        Texels::F16(values) => add(values, index, clusters, |v| curve(v.to_f32())),
        Texels::F32(values) => add(values, index, clusters, curve),
    }
}

fn add<T: Copy>(values: &[T], index: &[u32], clusters: usize, number: impl Fn(T) -> f32) -> Vec<[f64; 3]> {
    let mut sums = vec![[0.0; 3]; clusters];
    for (texel, &k) in values.chunks_exact(3).zip(index) {
        for (sum, &value) in sums[k as usize].iter_mut().zip(texel) {
            *sum += f64::from(number(value));
        }
    }
    sums
}

wide! {
    fn add_bytes(texels: &[u8], index: &[u32], sums: &mut [[u32; 4]]) {
        for (texel, &k) in texels.chunks_exact(3).zip(index) {
            let sum = &mut sums[k as usize];
            for c in 0..3 {
                sum[c] += u32::from(texel[c]);
            }
        }
    }
}
