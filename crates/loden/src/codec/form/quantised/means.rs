//! Computes the mean ABRDF of each cluster in one pass over the source and writes it.

use std::ops::Range;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::fit::Components;
use super::{Block, recipe};
use crate::btf::{BtfMeta, BtfSource, FloatType, SampleType, Texels};
use crate::codec::container::Writer;
use crate::codec::parts::Curve;
use crate::codec::parts::recipe::index_bytes;
use crate::codec::values::{halves, view_texels};
use crate::codec::{Codec, EncodeSummary, budget};
use crate::color::domain::Domain;
use crate::factor::kmeans::Partition;
use crate::params::Values;
use crate::progress::Task;
use crate::simd::wide;
use crate::stages::{Each, Kernel, Known, Piece, Site, Stage, Stages, settings};
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
    stages: &dyn Stages,
    params: &Values,
    block: &Block,
    path: &Path,
    partition: &Partition,
    task: &Task,
) -> Result<EncodeSummary> {
    let (source, clusters) = (stages.source(), partition.clusters);
    let (precision, domain) = (block.precision, block.domain);
    let recipe = recipe(clusters, 0, precision, Curve::Display);
    let writer = Writer::create(path, codec, params, source, &recipe)?;
    let row = 3 * source.meta().lights.len() * precision.bytes();
    let rows = Mutex::new(Rows::new(&writer, [clusters, source.meta().views.len()], row));
    let warnings = Mutex::new(Vec::new());
    let known = Known {
        settings: settings(&Settings { clusters, domain })?,
        indices: vec![partition.index.as_slice().into()],
        ..Known::default()
    };
    let views = source.meta().views.len();
    stages.run(&Stage { kernel: &Means, known, units: views, steps: views as u64 }, task, &|view, means| {
        let (bytes, range) = stored(&means.floats, precision, view)?;
        if let Some(range) = range {
            writer.write("block_range", (view * size_of_val(&range)) as u64, bytemuck::cast_slice(&range))?;
            let mut warnings = warnings.lock().unwrap_or_else(PoisonError::into_inner);
            if warnings.is_empty() {
                warnings.extend(coarse(range, view));
            }
        }
        rows.lock().unwrap_or_else(PoisonError::into_inner).push(view, bytes)
    })?;
    rows.into_inner().unwrap_or_else(PoisonError::into_inner).flush()?;
    writer.write("index", 0, &index_image(partition))?;
    let warnings = warnings.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(EncodeSummary { bytes: writer.commit()?, warnings })
}

/// The rows of some views, collected so that each cluster is written once for several views.
struct Rows<'a> {
    writer: &'a Writer,
    /// Number of clusters and of views.
    shape: [usize; 2],
    /// Bytes of one cluster in a view.
    row: usize,
    first: usize,
    views: Vec<Vec<u8>>,
}

impl<'a> Rows<'a> {
    fn new(writer: &'a Writer, shape: [usize; 2], row: usize) -> Self {
        Self { writer, shape, row, first: 0, views: Vec::new() }
    }

    /// Adds a view, shape (cluster, row).
    fn push(&mut self, view: usize, bytes: Vec<u8>) -> Result<()> {
        let next = self.first + self.views.len();
        if view != next || (self.views.len() + 1) * bytes.len() > PART_BYTES {
            self.flush()?;
            self.first = view;
        }
        self.views.push(bytes);
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        let [clusters, views] = self.shape;
        for cluster in (0..clusters).filter(|_| !self.views.is_empty()) {
            let of_cluster = |view: &Vec<u8>| view[cluster * self.row..(cluster + 1) * self.row].to_vec();
            let piece: Vec<u8> = self.views.iter().flat_map(of_cluster).collect();
            self.writer.write("block", ((cluster * views + self.first) * self.row) as u64, &piece)?;
        }
        self.views.clear();
        Ok(())
    }
}

/// Means of clusters: a unit is a view. Pieces come in ascending order.
pub struct Means;

#[derive(Serialize, Deserialize)]
struct Settings {
    clusters: usize,
    domain: Domain,
}

impl Kernel for Means {
    fn name(&self) -> &'static str {
        "means"
    }

    fn memory(&self, meta: &BtfMeta, known: &Known, _units: Range<usize>, threads: usize) -> u64 {
        let Ok(Settings { clusters, .. }) = known.settings() else { return u64::MAX };
        let indices: usize = known.indices.iter().map(|index| index.len()).sum();
        // sums in double precision, and means
        budget::source(meta, threads) + budget::singles(indices + 12 * clusters * meta.lights.len())
    }

    fn run(&self, site: &Site, known: &Known, units: Range<usize>, each: Each) -> Result<()> {
        let Settings { clusters, domain } = known.settings()?;
        let partition = Partition { index: known.index(0)?.to_vec(), clusters };
        for view in units {
            let floats = view_means(site.source, view, domain, &partition)?;
            site.source.release(view);
            each(view, Piece { floats, ..Piece::default() })?;
            site.task.advance(1)?;
        }
        Ok(())
    }
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
    stages: &dyn Stages,
    params: &Values,
    precision: FloatType,
    domain: Domain,
    path: &Path,
    partition: &Partition,
    coefficients: &[f32],
    task: &Task,
) -> Result<EncodeSummary> {
    let (source, precision) = (stages.source(), SampleType::from(precision));
    let (views, texels) = (source.meta().views.len(), source.meta().texels());
    let c = coefficients.len() / texels;
    let recipe = recipe(partition.clusters, c, precision, domain.into());
    let writer = Writer::create(path, codec, params, source, &recipe)?;
    let row = 3 * source.meta().lights.len() * precision.bytes();
    stages.run(&Components::stage(partition, coefficients, c, domain, views)?, task, &|view, piece| {
        let (bytes, _) = stored(&piece.floats, precision, view)?;
        for (i, piece) in bytes.chunks_exact(row).enumerate() {
            let (cluster, k) = (i / (1 + c), i % (1 + c));
            let (tensor, place) = if k == 0 { ("block", cluster) } else { ("components", cluster * c + k - 1) };
            writer.write(tensor, ((place * views + view) * row) as u64, piece)?;
        }
        Ok(())
    })?;
    writer.write("coefficients", 0, &stored(coefficients, precision, 0)?.0)?;
    writer.write("index", 0, &index_image(partition))?;
    Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
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
