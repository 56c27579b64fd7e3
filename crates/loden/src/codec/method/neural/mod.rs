//! Neural: a small network over features of texels, seen through the parallax of a height.
//!
//! # Model
//! Each texel has a few numbers, the features, and a height. A viewer's ray meets the surface at a place that the height shifts;
//! there the features are interpolated between texels. A network of three hidden layers turns them and the two directions
//! into a colour. Features, heights and weights are trained together on random texels and pairs of directions (Adam). The network
//! sees features and heights rounded to whole steps, as they are stored; gradients move what is rounded. An error counts by its size, or by its square
//! where `loss` says so; `rate` weighs the bits of the features against it.
//!
//! A network is a function of the directions themselves: it does not interpolate between sampled views and lights.
//!
//! # Limits
//! Training takes as long as `samples` says, minutes for a large BTF, and needs as many values in memory as fit into half a
//! gigabyte. A steep surface that hides parts of itself is followed only as far as two steps of a fixed-point iteration go.
//! The file does not depend on the processor or on the number of threads. There is no quality dial: `features`, `width` and `rate` set
//! size and error. Shaders and other renderers do not evaluate it yet.
//!
//! # References
//! kuznetsov2021, kingma2015

mod coding;
mod planes;
mod pool;
mod step;
mod train;

use std::path::Path;
use std::sync::Arc;

use half::f16;
use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, SampleType, Texels};
use crate::codec::container::{Container, TensorSpec, Writer};
use crate::codec::entropy::Decoder;
use crate::codec::network::lanes::LANES;
use crate::codec::network::layers::{Lowest, Shape};
use crate::codec::packed::{block, blocks};
use crate::codec::parts::{Axis, Expr, MemoryParts, Numbers, PlaneKind, PlaneSpec, Recipe, TableSpec, Views, opened};
use crate::codec::values::{halves, image, view_texels};
use crate::codec::{Codec, Decoded, EncodeSummary, OpenParts, budget};
use crate::color::domain::{DOMAIN, Domain};
use crate::params::{Param, Params as _, Values, YesNo};
use crate::progress::{Progress, Task};
use crate::{Error, Result};
use pool::Pool;
use step::{Errors, Pair};
use train::{Plan, Training};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Neural;

crate::words! {
    /// The error that training makes small.
    enum Loss {
        /// The mean absolute error.
        Mean = "mean",
        /// The mean squared error.
        Squared = "squared",
    }
}

crate::params! {
    struct Settings {
        /// Numbers per texel.
        features: usize [1..=64] = 8,
        /// Numbers in each hidden layer of the network.
        width: usize [4..=256] = 48,
        /// Samples to train on, in millions; less for a small BTF.
        samples: f64 [0.01..=100000.0, "millions"] = 100,
        /// How much error smaller features are worth: larger values give smaller files.
        rate: f64 [0.0..=1.0] = 0.0003,
        /// The error that training makes small.
        loss: Loss = "mean",
        /// Leaves the height out: every view sees the features of the texel itself.
        flat: YesNo = "no",
        domain: Domain => DOMAIN,
    }
}

/// Hidden layers of the network.
const HIDDEN: usize = 3;

/// Texels per step of a stored height.
const UNIT: f32 = 0.125;

/// Bytes of the values to train on.
const POOL: usize = 512 << 20;

/// What a stored 8-bit number of zero means.
const OFFSET: f32 = 128.0;

/// Maximum number of texels of a plane per byte: no decision takes less than 0.0007 bits.
const TEXELS_PER_BYTE: usize = 1 << 16;

impl Settings {
    fn shape(&self) -> Shape {
        Shape { features: self.features, width: self.width, hidden: HIDDEN }
    }

    /// How to train for a BTF.
    fn plan(&self, meta: &BtfMeta) -> Plan {
        let values = (meta.texels() * meta.pairs()) as f64;
        let samples = (self.samples * 1e6).min((PER_VALUE * values).max(FEWEST)) as u64;
        let groups = meta.texels().div_ceil(LANES);
        let step = (samples as usize / LANES / STEPS).clamp(32, 256);
        let rates = [3e-3, 0.3, if self.flat == YesNo::No { 0.1 } else { 0.0 }];
        // beyond the knee an error counts by its size; a bit is worth as much as with a typical error below it
        let (knee, bits) = match self.loss {
            Loss::Mean => (0.01, self.rate),
            Loss::Squared => (1e3, self.rate * TYPICAL / 1e3),
        };
        Plan {
            size: [meta.width, meta.height],
            shape: self.shape(),
            samples,
            step,
            steps: (groups / step / 8).clamp(1, 8),
            rates,
            bits: bits as f32,
            knee,
            unit: UNIT,
        }
    }
}

/// An error of a display value.
const TYPICAL: f64 = 0.03;

/// Samples for each value of a small BTF, and how many it takes at least; fewest steps of the network.
const PER_VALUE: f64 = 4.0;
const FEWEST: f64 = 4e5;
const STEPS: usize = 1500;

impl Codec for Neural {
    fn name(&self) -> &'static str {
        "neural"
    }

    fn doc(&self) -> &'static str {
        "A small network over features of texels, shifted by the parallax of a height: minutes of training."
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
        let meta = source.meta();
        let pool = filled(source, settings.domain, progress)?;
        let plan = settings.plan(meta);
        let mirror = settings.flat == YesNo::No && is_mirrored(meta, &pool, plan, progress)?;
        let pairs = pairs(meta, mirror);
        let mut training = Training::new(plan, &pairs, &pool);
        train(&mut training, &pool, progress, "train")?;
        store(params, source, &settings, &training, (mirror, pool.largest()), path)
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        Ok(recipe(&Settings::from_values(params)?, (false, 1.0)))
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        let settings = Settings::from_values(params).ok()?;
        let (plan, texels) = (settings.plan(meta), meta.texels() as u64);
        let pool = (6 * texels * meta.pairs() as u64).min(POOL as u64);
        // values and moments of the planes, what is looked up, and what is decoded when the error is measured
        let planes = texels * 4 * (5 * (settings.features as u64 + 1) + 8);
        let records = (plan.step * plan.steps * LANES) as u64 * 4 * (settings.features as u64 + 8);
        let unit = step::scratch_bytes(plan.shape) + 8 * plan.shape.places().last()?.end as u64;
        Some(pool + planes + records + threads as u64 * unit + (32 << 20) + budget::source(meta, threads))
    }

    fn decoder(&self) -> Option<OpenParts> {
        Some(|container, params| Decoded::new(Arc::new(read(container, params)?)))
    }
}

/// The values to train on, in `domain`.
fn filled(source: &dyn BtfSource, domain: Domain, progress: &dyn Progress) -> Result<Pool> {
    let meta = source.meta();
    let as_stored = meta.sample_type == SampleType::U8 && domain.is_stored(meta.encoding);
    let mut pool = Pool::new(meta.texels(), meta.pairs(), POOL, as_stored, SEED);
    let (task, lights) = (Task::new(progress, "read", meta.views.len() as u64), meta.lights.len());
    for view in 0..meta.views.len() {
        let texels = view_texels(source, view)?;
        match &texels {
            Texels::U8(values) if as_stored => pool.fill_u8(view * lights..(view + 1) * lights, values),
            _ => {
                for light in 0..lights {
                    let values = image(&texels, light, meta, domain);
                    if values.iter().any(|v| !v.is_finite()) {
                        return Err(Error::non_finite("the source, in this domain,"));
                    }
                    let most = f16::MAX.to_f32();
                    let halves: Vec<f16> = values.iter().map(|v| f16::from_f32(v.clamp(-most, most))).collect();
                    let pair = view * lights + light;
                    pool.fill_f16(pair..pair + 1, &halves);
                }
            }
        }
        drop(texels);
        source.release(view);
        task.advance(1)?;
    }
    Ok(pool)
}

const SEED: u64 = 0x6e65_7572_616c;

/// All pairs in the order of the BTF.
fn pairs(meta: &BtfMeta, mirror: bool) -> Vec<Pair> {
    let (lowest, lights) = (Lowest::new(meta), meta.lights.len());
    let pair = |pair: usize| {
        let (wi, wo) = meta.pair(pair / lights, pair % lights);
        let (wi, wo) = lowest.raised(wi, wo);
        Pair::new(wi, wo, mirror)
    };
    (0..meta.pairs()).map(pair).collect()
}

/// Whether a mirrored parallax fits better, by a short training of both kinds.
fn is_mirrored(meta: &BtfMeta, pool: &Pool, plan: Plan, progress: &dyn Progress) -> Result<bool> {
    let error = |mirror: bool| {
        let pairs = pairs(meta, mirror);
        let plan = Plan { samples: (plan.samples as f64 * TRIED) as u64, ..plan };
        let mut training = Training::new(plan, &pairs, pool);
        train(&mut training, pool, progress, "try the parallax").map(|errors| errors.mean())
    };
    Ok(error(true)? < error(false)?)
}

/// The part of a training that shows which parallax fits.
const TRIED: f64 = 0.05;

/// Trains to the end, and returns the errors of the last round.
fn train(training: &mut Training, pool: &Pool, progress: &dyn Progress, name: &str) -> Result<Errors> {
    const TICKS: u64 = 1000;
    let task = Task::new(progress, name, TICKS);
    let (mut shown, mut errors) = (0, Errors::default());
    while training.progress() < 1.0 {
        errors = training.round(pool);
        let done = (f64::from(training.progress()) * TICKS as f64) as u64;
        if done / 10 > shown / 10 {
            progress.step(&format!("error {:.4}", errors.mean()));
        }
        task.advance(done - shown)?;
        shown = done;
    }
    Ok(errors)
}

/// Planes, tables and formula of a file with this largest value, whose slopes are mirrored or not.
fn recipe(settings: &Settings, (mirror, most): (bool, f32)) -> Recipe {
    let (shape, parallax) = (settings.shape(), settings.flat == YesNo::No);
    let layer = |layer: usize| {
        let [rows, columns] = shape.layer(layer);
        let outputs = if layer == shape.hidden { Axis::Channel } else { Axis::Output(rows) };
        TableSpec::new(&format!("layer_{}", layer + 1), &[outputs, Axis::Input(columns)], SampleType::F16)
    };
    let mut tables: Vec<TableSpec> = (0..shape.layers()).map(layer).collect();
    let mut planes = Vec::new();
    let mut add = |name: &str, count: usize| {
        let axes = [Axis::Component(count), Axis::Range];
        tables.push(TableSpec::new(&format!("{name}_range"), &axes, SampleType::F32));
        let range = Some(tables.len() - 1);
        let kind = PlaneKind::Numbers { count, views: Views::None, sample_type: SampleType::U8, range };
        planes.push(PlaneSpec { name: name.into(), kind });
    };
    add("features", shape.features);
    if parallax {
        add("height", 1);
    }
    let network = Expr::Network { plane: 0, layers: (0..shape.layers()).collect(), most };
    let value = if parallax { Expr::Shift { height: 1, mirror, value: Box::new(network) } } else { network };
    Recipe { planes, tables, value, curve: settings.domain.into() }
}

/// The tensors of a file: weights of the layers, then the entropy-coded planes.
fn layout(shape: Shape, stream: usize) -> Vec<TensorSpec> {
    let layer = |layer: usize| TensorSpec {
        name: format!("layer_{}", layer + 1),
        sample_type: SampleType::F16,
        shape: shape.layer(layer).to_vec(),
    };
    let stream = TensorSpec { name: "stream".into(), sample_type: SampleType::U8, shape: vec![stream] };
    (0..shape.layers()).map(layer).chain([stream]).collect()
}

fn store(
    params: &Values,
    source: &dyn BtfSource,
    settings: &Settings,
    training: &Training,
    (mirror, most): (bool, f32),
    path: &Path,
) -> Result<EncodeSummary> {
    let (shape, width) = (settings.shape(), source.meta().width);
    let mut all: Vec<Vec<i32>> = (0..shape.features).map(|k| training.features.rounded(k)).collect();
    if settings.flat == YesNo::No {
        all.push(training.heights.rounded(0));
    }
    let coded: Vec<Vec<u8>> = all.par_iter().map(|values| coding::encode(values, width)).collect();
    let first = [&[u8::from(mirror)], &most.to_le_bytes()[..]].concat();
    let stream: Vec<u8> = std::iter::once(&first).chain(&coded).flat_map(|bytes| block(bytes)).collect();
    let layout = layout(shape, stream.len());
    let writer = Writer::of_tensors(path, &Neural, params, source, &layout)?;
    let places = shape.places();
    for (layer, place) in places.into_iter().enumerate() {
        let scale = if layer == shape.hidden { training.scale } else { 1.0 };
        let weights: Vec<f32> = training.weights[place].iter().map(|weight| weight * scale).collect();
        writer.write(&layout[layer].name, 0, bytemuck::cast_slice(&halves(&weights, "the network")?))?;
    }
    writer.write("stream", 0, &stream)?;
    Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
}

/// Reads the parts of a file.
///
/// # Errors
/// [`Error::Invalid`] naming the file and the tensor.
fn read(container: &Container, params: &Values) -> Result<MemoryParts> {
    let settings = Settings::from_values(params)?;
    let shape = settings.shape();
    let invalid = |problem: String| Error::invalid(container.path(), "tensor stream", problem);
    let length = container.shape("stream").and_then(|shape| shape.first().copied()).unwrap_or(0);
    let layout = layout(shape, length);
    let mut tables = layout[..shape.layers()].iter().map(|spec| container.numbers(spec)).collect::<Result<Vec<_>>>()?;
    let Numbers::U8(stream) = container.numbers(&layout[shape.layers()])? else {
        return Err(invalid("found another number type, expected bytes".into()));
    };
    let blocks = blocks(&stream).map_err(invalid)?;
    let parallax = settings.flat == YesNo::No;
    let expected = 1 + shape.features + usize::from(parallax);
    if blocks.len() != expected {
        return Err(invalid(format!("found {} blocks, expected {expected}", blocks.len())));
    }
    let (mirror, most) = match *blocks[0] {
        [mirror @ (0 | 1), a, b, c, d] => (mirror == 1, f32::from_le_bytes([a, b, c, d])),
        _ => return Err(invalid("its first block is not 0 or 1 and a number".into())),
    };
    let meta = BtfMeta { sample_type: SampleType::F32, ..container.meta().clone() };
    if let Some(few) = blocks[1..].iter().find(|b| (b.len() + 8).saturating_mul(TEXELS_PER_BYTE) < meta.texels()) {
        return Err(invalid(format!("{} bytes are too few for {} texels", few.len(), meta.texels())));
    }
    let decoded: Vec<Vec<u8>> = blocks[1..].par_iter().map(|bytes| plane(bytes, &meta)).collect();
    let (features, heights) = decoded.split_at(shape.features);
    let texels = (0..meta.texels()).flat_map(|texel| features.iter().map(move |plane| plane[texel]));
    let mut planes = vec![Numbers::U8(texels.collect::<Vec<u8>>().into())];
    planes.extend(heights.iter().map(|plane| Numbers::U8(plane.clone().into())));
    let range = |count: usize, unit: f32| Numbers::F32([-OFFSET * unit, unit].repeat(count).into());
    tables.push(range(shape.features, 1.0));
    if parallax {
        tables.push(range(1, UNIT));
    }
    opened(container, "stream", MemoryParts::new(meta, recipe(&settings, (mirror, most)), planes, tables))
}

/// Decodes a plane to bytes.
fn plane(bytes: &[u8], meta: &BtfMeta) -> Vec<u8> {
    let mut values = vec![0; meta.texels()];
    coding::decode(&mut Decoder::new(bytes), &mut values, meta.width);
    values.into_iter().map(|value| (value.clamp(-127, 127) + OFFSET as i32) as u8).collect()
}
