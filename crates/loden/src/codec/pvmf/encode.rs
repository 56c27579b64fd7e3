//! Compression, one view at a time per thread.

use std::path::Path;

use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use super::{layout, precision, rank};
use crate::btf::{BtfMeta, BtfSource, SampleType, Texels};
use crate::codec::EncodeSummary;
use crate::codec::container::Writer;
use crate::codec::domain::Domain;
use crate::factor::linalg::{Eigen, largest_eigenpairs};
use crate::factor::moments::{Moments, moments_f32};
use crate::factor::principal::{Principal, principal_u8};
use crate::factor::project::{project, project_bytes};
use crate::factor::tile::{ByteTile, FloatTile, Tile};
use crate::params::Values;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

pub(super) fn encode(
    source: &dyn BtfSource,
    params: &Values,
    path: &Path,
    progress: &dyn Progress,
) -> Result<EncodeSummary> {
    let meta = source.meta();
    let c = params.integer("components") as usize;
    if c > rank(meta) {
        let problem = format!(
            "found {c}, expected at most {} (the rank: {} lights x 3 channels, {} texels)",
            rank(meta),
            meta.lights.len(),
            meta.texels()
        );
        return Err(Error::parameter("components", problem));
    }
    let job = Job {
        source,
        c,
        domain: Domain::from_name(params.text("domain")),
        precision: precision(params),
        writer: Writer::create(path, "pvmf", params, source, &layout(meta, c, precision(params)))?,
    };
    let task = Task::new(progress, "compress", meta.views.len() as u64);
    (0..meta.views.len()).into_par_iter().try_for_each_init(Buffers::default, |buffers, view| {
        task.check()?;
        job.view(view, buffers)?;
        source.release(view);
        task.advance(1)
    })?;
    Ok(EncodeSummary { bytes: job.writer.commit()?, warnings: Vec::new() })
}

struct Job<'a> {
    source: &'a dyn BtfSource,
    c: usize,
    domain: Domain,
    precision: SampleType,
    writer: Writer,
}

/// Memory a thread keeps between views.
#[derive(Default)]
struct Buffers {
    integers: Option<ByteTile>,
    floats: Option<FloatTile>,
    coefficients: Vec<f32>,
    bytes: Vec<u8>,
}

impl Job<'_> {
    fn view(&self, view: usize, buffers: &mut Buffers) -> Result<()> {
        let meta = self.source.meta();
        let texels = self.source.view(view)?;
        if texels.len() != meta.view_len() {
            let problem = format!("view {view} has {} numbers, expected {}", texels.len(), meta.view_len());
            return Err(Error::parameter("source", problem));
        }
        buffers.coefficients.resize(meta.texels() * self.c, 0.0);
        let (mean, basis) = match &texels {
            Texels::U8(values) if self.domain.is_stored(meta.encoding) => self.integers(values, view, buffers)?,
            _ => self.floats(&texels, view, buffers)?,
        };
        self.write(view, &mean, &basis, buffers)
    }

    /// 8-bit values that are factored as they are: exact integer sums.
    fn integers(&self, values: &[u8], view: usize, buffers: &mut Buffers) -> Result<(Vec<f32>, Vec<f32>)> {
        let meta = self.source.meta();
        let tile = buffers.integers.get_or_insert_with(|| ByteTile::new(3 * meta.lights.len()));
        let Principal { mean, vectors } = principal_u8(values, meta.image_len(), tile, self.c)
            .ok_or_else(|| Error::parameter("source", format!("view {view} has no principal components")))?;
        let offset = 128.0 / 255.0;
        let bias: Vec<f32> = vectors
            .chunks_exact(tile.rows())
            .map(|v| -v.iter().zip(&mean).map(|(v, m)| v * (m - offset)).sum::<f64>() as f32)
            .collect();
        let basis: Vec<f32> = vectors.iter().map(|v| (v / 255.0) as f32).collect();
        project_bytes(values, meta.image_len(), &basis, &bias, &mut buffers.coefficients);
        Ok((single(&mean), single(&vectors)))
    }

    /// Any values in any domain.
    fn floats(&self, texels: &Texels, view: usize, buffers: &mut Buffers) -> Result<(Vec<f32>, Vec<f32>)> {
        let meta = self.source.meta();
        let tile = buffers.floats.get_or_insert_with(|| FloatTile::new(3 * meta.lights.len()));
        let curve = |value: f32| self.domain.from_stored(meta.encoding, value);
        let of_byte: [f32; 256] = std::array::from_fn(|i| curve(i as f32 / 255.0));
        let fill = |tile: &mut FloatTile, first: usize, count: usize| match texels {
            Texels::U8(values) => load(tile, values, meta, first, count, |v| of_byte[usize::from(v)]),
            Texels::F16(values) => load(tile, values, meta, first, count, |v: f16| curve(v.to_f32())),
            Texels::F32(values) => load(tile, values, meta, first, count, curve),
        };
        let moments = moments_f32(meta.texels(), tile, &fill);
        let eigen = self.eigen(&moments, view)?;
        let (mean, basis) = (single(&moments.mean), single(&eigen.vectors));
        let bias = vec![0.0; self.c];
        for first in (0..meta.texels()).step_by(tile.texels()) {
            let count = tile.texels().min(meta.texels() - first);
            fill(tile, first, count);
            tile.centre(count, &moments.mean);
            project(tile, count, &basis, &bias, &mut buffers.coefficients[first * self.c..]);
        }
        Ok((mean, basis))
    }

    fn eigen(&self, moments: &Moments, view: usize) -> Result<Eigen> {
        largest_eigenpairs(&moments.scatter, moments.mean.len(), self.c).ok_or_else(|| {
            Error::parameter("source", format!("view {view} holds numbers that are not finite in this domain"))
        })
    }

    fn write(&self, view: usize, mean: &[f32], basis: &[f32], buffers: &mut Buffers) -> Result<()> {
        let Buffers { coefficients, bytes, .. } = buffers;
        let mut tensor = 0;
        let mut put = |data: &[u8]| {
            tensor += 1;
            self.writer.write(tensor - 1, (view * data.len()) as u64, data)
        };
        put(bytemuck::cast_slice(mean))?;
        match self.precision {
            SampleType::F32 => {
                put(bytemuck::cast_slice(basis))?;
                put(bytemuck::cast_slice(coefficients))
            }
            SampleType::F16 => {
                put(halves(basis, bytes, view)?)?;
                put(halves(coefficients, bytes, view)?)
            }
            SampleType::U8 => {
                let ranges = quantise(coefficients, self.c, bytes);
                put(bytemuck::cast_slice(&ranges))?;
                put(halves(basis, &mut Vec::new(), view)?)?;
                put(bytes)
            }
        }
    }
}

fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&v| v as f32).collect()
}

fn load<T: Copy>(
    tile: &mut FloatTile,
    values: &[T],
    meta: &BtfMeta,
    first: usize,
    count: usize,
    curve: impl Fn(T) -> f32,
) {
    for (light, image) in values.chunks_exact(meta.image_len()).enumerate() {
        let [r, g, b] = tile.rgb_mut(light);
        for (t, texel) in image[3 * first..3 * (first + count)].chunks_exact(3).enumerate() {
            (r[t], g[t], b[t]) = (curve(texel[0]), curve(texel[1]), curve(texel[2]));
        }
        [r, g, b].into_iter().for_each(|row| row[count..].fill(0.0));
    }
}

fn halves<'a>(values: &[f32], bytes: &'a mut Vec<u8>, view: usize) -> Result<&'a [u8]> {
    let largest = values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    if largest > f16::MAX.to_f32() {
        let problem = format!("f16 holds up to {}, view {view} needs {largest}: use f32 or u8", f16::MAX);
        return Err(Error::parameter("precision", problem));
    }
    let mut halves = vec![f16::ZERO; values.len()];
    halves.convert_from_f32_slice(values);
    bytes.clear();
    bytes.extend_from_slice(bytemuck::cast_slice(&halves));
    Ok(bytes)
}

/// Quantises each of the `c` interleaved components over its range to 8 bits; returns (offset, scale) pairs.
fn quantise(values: &[f32], c: usize, bytes: &mut Vec<u8>) -> Vec<[f32; 2]> {
    let mut bounds = vec![(f32::INFINITY, f32::NEG_INFINITY); c];
    for texel in values.chunks_exact(c) {
        for (bound, &v) in bounds.iter_mut().zip(texel) {
            *bound = (bound.0.min(v), bound.1.max(v));
        }
    }
    let ranges: Vec<[f32; 2]> = bounds.iter().map(|(low, high)| [*low, (high - low) / 255.0]).collect();
    let inverse: Vec<f32> = ranges.iter().map(|[_, scale]| if *scale > 0.0 { 1.0 / scale } else { 0.0 }).collect();
    bytes.clear();
    bytes.reserve(values.len());
    for texel in values.chunks_exact(c) {
        let quantised =
            texel.iter().zip(&ranges).zip(&inverse).map(|((v, r), inverse)| ((v - r[0]) * inverse + 0.5) as u8);
        bytes.extend(quantised);
    }
    ranges
}
