//! KLT: Karhunen-Loeve transform coding of the whole BTF.
//!
//! # Model
//! The principal components of the matrix (texel; view, light, channel), as in [`super::Pca`]. The coefficients of
//! each component form an image, which is transformed by cosines in blocks of 32 x 32. The components, scaled by the
//! norm of their coefficients, and the mean are rotated to the principal directions of views and lights. All
//! transforms are orthonormal, so one quantisation step for all numbers is optimal: numbers are rounded to multiples
//! of it, small ones towards zero, and entropy coded with probabilities that adapt to neighbours.
//!
//! An open file holds components in 8 bits per number, and coefficients in 8 bits, or in 4 where that is as precise
//! as the step. Images are decoded and texels evaluated from these.
//!
//! # Limits
//! The 8 bits limit the precision to about 0.3 % of a component's range. Opening decodes the whole file.
//!
//! # References
//! koudelka2003, delathauwer2000, ballester2020

mod angles;
mod cosine;
mod planes;

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::pca;
use crate::btf::{BtfMeta, BtfSource, Rect, SampleType};
use crate::codec::container::{Container, TensorSpec, Writer};
use crate::codec::entropy::{Decoder, Encoder};
use crate::codec::form::factored::{self, Compact, FactoredBtf, Sharing};
use crate::codec::matrix::Matrix;
use crate::codec::packed::{block, blocks};
use crate::codec::parts::{Axis, Expr, Numbers, Parts, PlaneSpec, Recipe, TableSpec, check_plane};
use crate::codec::{Codec, Decoded, EncodeInStages, EncodeSummary, OpenParts, Session, budget};
use crate::color::domain::{DOMAIN, Domain};
use crate::factor::global::{Global, ROUGH_PASSES, rough_components, rough_memory};
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::stages::{Local, Stages};
use crate::{Error, Result};
use angles::{Turns, channels_first, channels_last};
use cosine::Cosine;

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Klt;

crate::params! {
    struct Settings {
        /// Maximum number of components of the whole BTF; components that quantise to zero are dropped.
        components: usize [1..=4096] = 48,
        /// Quantisation step: root mean square change of a texel over all pairs.
        step: f64 [0.001..=1000.0, "1/255"] = 2,
        domain: Domain => DOMAIN,
    }
}

/// Rounding offset, as a fraction of a step: values under 0.65 of a step become zero (dead zone).
const ROUNDING: f32 = 0.35;

/// Step of the core, in steps of the planes.
const CORE_STEP: f32 = 1.5;

/// Step of the coefficients in memory, in steps of the planes: its error is smaller than that of the stored numbers.
const HELD_STEP: f32 = 1.0;

impl Codec for Klt {
    fn name(&self) -> &'static str {
        "klt"
    }

    fn doc(&self) -> &'static str {
        "Transform coding of the components of the whole BTF, with one quantisation step and entropy coding."
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
        Factored { source, factors: None }.encode(params, path, progress)
    }

    fn in_stages(&self) -> Option<EncodeInStages> {
        Some(|stages, params, path, progress| encode(stages.source(), params, &factor(stages, params, progress)?, path))
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        let step = COARSEST * (FINEST / COARSEST).powf(place);
        // finer steps pay for more components; between these thresholds the factorisation is reused
        let components = DIALLED.iter().find(|(from, _)| step >= *from).map_or(256, |(_, components)| *components);
        let components = components.min(Sharing::AllViews.rank(meta));
        vec![("components", components.to_string()), ("step", format!("{step:.4}"))]
    }

    fn limits(&self, meta: &BtfMeta, _params: &Values) -> Result<Vec<(&'static str, usize)>> {
        Ok(vec![("components", Sharing::AllViews.rank(meta))])
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        let components = Settings::from_values(params).ok()?.components.min(Sharing::AllViews.rank(meta));
        // per thread a plane in three forms; the core in several; for all planes the stream and the decoded numbers
        let planes = threads * meta.texels() * 3 + meta.texels() * components / 2;
        let core = 3 * meta.pairs() * (components + 1) * 4;
        Some(pca::memory(meta, components, threads, rough_memory) + budget::singles(planes + core))
    }

    fn session<'a>(&'a self, source: &'a dyn BtfSource) -> Option<Box<dyn Session + 'a>> {
        Some(Box::new(Factored { source, factors: None }))
    }

    fn recipe(&self, meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Settings { components, domain, .. } = Settings::from_values(params)?;
        Ok(recipe(components.min(Sharing::AllViews.rank(meta)), domain))
    }

    fn decoder(&self) -> Option<OpenParts> {
        Some(|container, params| {
            let parts = Held::new(container, params)?;
            let factors = Arc::new(parts.factors());
            Ok(Decoded::with(Arc::new(parts), factors))
        })
    }
}

/// Quantisation steps at the ends of the dial.
const COARSEST: f64 = 40.0;
const FINEST: f64 = 0.1;

/// Number of components by step.
const DIALLED: [(f64, usize); 3] = [(10.0, 32), (3.0, 96), (1.0, 192)];

/// A source with factors that several steps share.
struct Factored<'a> {
    source: &'a dyn BtfSource,
    /// Components and domain, with the factors computed for them.
    factors: Option<(usize, Domain, Global)>,
}

fn not_finite() -> Error {
    Error::non_finite("the source, in this domain,")
}

impl Factored<'_> {
    fn factor(&mut self, params: &Values, progress: &dyn Progress) -> Result<&Global> {
        let Settings { components, domain, .. } = Settings::from_values(params)?;
        let components = components.min(Sharing::AllViews.rank(self.source.meta()));
        let global = match self.factors.take() {
            Some((c, d, global)) if (c, d) == (components, domain) => global,
            _ => factor(&Local::new(self.source), params, progress)?,
        };
        Ok(&self.factors.insert((components, domain, global)).2)
    }
}

impl Session for Factored<'_> {
    fn encode(&mut self, params: &Values, path: &Path, progress: &dyn Progress) -> Result<EncodeSummary> {
        let source = self.source;
        encode(source, params, self.factor(params, progress)?, path)
    }
}

/// The components of a BTF.
fn factor(stages: &dyn Stages, params: &Values, progress: &dyn Progress) -> Result<Global> {
    let Settings { components, domain, .. } = Settings::from_values(params)?;
    let meta = stages.source().meta();
    let task = Task::new(progress, "compress", (meta.views.len() * ROUGH_PASSES) as u64);
    let components = components.min(Sharing::AllViews.rank(meta));
    rough_components(&Matrix { stages, domain, task: &task }, components)?.ok_or_else(not_finite)
}

/// Codes components into a file.
fn encode(source: &dyn BtfSource, params: &Values, global: &Global, path: &Path) -> Result<EncodeSummary> {
    let (settings, meta) = (Settings::from_values(params)?, source.meta());
    let components = settings.components.min(Sharing::AllViews.rank(meta));
    let (step, texels) = (step(&settings, meta), meta.texels());
    let cosine = Cosine::new(meta.width, meta.height);
    let planes: Vec<Plane> = (0..components)
        .into_par_iter()
        .filter_map(|k| {
            let values = global.coefficients.iter().skip(k).step_by(components);
            Plane::encode(values.copied().collect(), k, meta, &cosine, step)
        })
        .collect();
    // treat the mean as a component whose coefficients are all 1
    let columns = global.mean.len();
    let mut slices: Vec<f32> = global.mean.iter().map(|&m| (m * (texels as f64).sqrt()) as f32).collect();
    for plane in &planes {
        let row = &global.basis[plane.component * columns..][..columns];
        slices.extend(row.iter().map(|&v| (v * plane.norm) as f32));
    }
    let core = Core::encode(&slices, meta, step).ok_or_else(not_finite)?;
    let stream: Vec<u8> =
        std::iter::once(&core.bytes).chain(planes.iter().map(|p| &p.bytes)).flat_map(|b| block(b)).collect();
    let kept = [core.turns.views.len() / meta.views.len(), core.turns.lights.len() / meta.lights.len()];
    let writer = Writer::of_tensors(path, &Klt, params, source, &layout(meta, kept, stream.len()))?;
    writer.write("view_turn", 0, bytemuck::cast_slice(&core.turns.views))?;
    writer.write("light_turn", 0, bytemuck::cast_slice(&core.turns.lights))?;
    writer.write("stream", 0, &stream)?;
    Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
}

/// The principal components that the file decodes to, in single precision.
fn recipe(count: usize, domain: Domain) -> Recipe {
    Recipe {
        planes: vec![PlaneSpec::numbers("coefficients", count, SampleType::F32)],
        tables: vec![
            TableSpec::new("mean", &[Axis::View, Axis::Light, Axis::Channel], SampleType::F32),
            TableSpec::new("basis", &[Axis::View, Axis::Component(count), Axis::Light, Axis::Channel], SampleType::F32),
        ],
        value: Expr::Sum(vec![Expr::table(0), Expr::dot(0, 1)]),
        curve: domain.into(),
    }
}

/// The parts of a file, held in 8 or 4 bits per number and returned in single precision.
pub struct Held {
    meta: BtfMeta,
    recipe: Recipe,
    domain: Domain,
    factors: Arc<Compact>,
}

impl Held {
    /// Decodes the file.
    ///
    /// # Errors
    /// [`Error::Invalid`] or [`Error::Limit`] naming the file and the tensor.
    pub fn new(container: &Container, params: &Values) -> Result<Self> {
        let settings = Settings::from_values(params)?;
        let (count, factors) = decode(container, &settings)?;
        let domain = settings.domain;
        let meta = BtfMeta { sample_type: SampleType::F32, ..container.meta().clone() };
        // keep one component of zeros if none is left
        Ok(Self { meta, recipe: recipe(count.max(1), domain), domain, factors: Arc::new(factors) })
    }

    /// The fast decoder.
    pub fn factors(&self) -> FactoredBtf {
        FactoredBtf::held(&self.meta, self.domain, self.factors.clone())
    }
}

impl Parts for Held {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    fn plane(&self, plane: usize, view: usize, texels: Rect) -> Result<Numbers> {
        let count = check_plane(self, plane, view, texels)?.count();
        let (width, all) = (self.meta.width, self.factors.components());
        let row = |y: usize| self.factors.coefficients(y * width + texels.x, texels.width);
        let rows: Vec<f32> = (texels.y..texels.y + texels.height).flat_map(row).collect();
        let numbers: Vec<f32> = rows.chunks_exact(all).flat_map(|texel| &texel[..count]).copied().collect();
        Ok(Numbers::F32(numbers.into()))
    }

    fn table(&self, table: usize) -> Result<Numbers> {
        let (views, lights) = (self.meta.views.len(), self.meta.lights.len());
        let count = self.recipe.planes[0].count();
        let numbers: Vec<f32> = match table {
            0 => (0..views).flat_map(|view| self.factors.mean_of(view, lights)).collect(),
            1 => (0..views).flat_map(|view| self.factors.basis_of(view, lights, count)).collect(),
            _ => return Err(Error::parameter("table", format!("found {table}, expected less than 2"))),
        };
        Ok(Numbers::F32(numbers.into()))
    }
}

/// The quantisation step of the planes.
fn step(settings: &Settings, meta: &BtfMeta) -> f32 {
    settings.step as f32 / 255.0 * (3.0 * meta.pairs() as f32).sqrt()
}

fn layout(meta: &BtfMeta, kept: [usize; 2], stream: usize) -> [TensorSpec; 3] {
    [
        TensorSpec { name: "view_turn".into(), sample_type: SampleType::F16, shape: vec![kept[0], meta.views.len()] },
        TensorSpec { name: "light_turn".into(), sample_type: SampleType::F16, shape: vec![kept[1], meta.lights.len()] },
        TensorSpec { name: "stream".into(), sample_type: SampleType::U8, shape: vec![stream] },
    ]
}

fn quantise(values: &[f32], step: f32) -> Vec<i32> {
    // larger numbers for the coder would need a step below a ten-millionth of the coefficient
    let limit = (1 << 22) as f32;
    values.iter().map(|v| (v.abs() / step + ROUNDING).floor().min(limit).copysign(*v) as i32).collect()
}

/// Coefficients of one component.
struct Plane {
    component: usize,
    bytes: Vec<u8>,
    /// Norm of the decoded coefficients.
    norm: f64,
}

impl Plane {
    /// Quantises and codes the coefficients; `None` if nothing is left.
    fn encode(mut values: Vec<f32>, component: usize, meta: &BtfMeta, cosine: &Cosine, step: f32) -> Option<Self> {
        cosine.forward(&mut values);
        let mut quantised = quantise(&values, step);
        let norm = norm(&quantised, step);
        if norm == 0.0 {
            return None;
        }
        let mut encoder = Encoder::default();
        planes::plane(&mut encoder, &mut quantised, meta.width, meta.height);
        Some(Self { component, bytes: encoder.finish(), norm })
    }

    /// Decodes the coefficients and their norm.
    fn decode(bytes: &[u8], meta: &BtfMeta, cosine: &Cosine, step: f32) -> (Vec<f32>, f32) {
        let mut quantised = vec![0; meta.texels()];
        planes::plane(&mut Decoder::new(bytes), &mut quantised, meta.width, meta.height);
        let mut plane: Vec<f32> = quantised.iter().map(|&q| q as f32 * step).collect();
        cosine.inverse(&mut plane);
        (plane, norm(&quantised, step) as f32)
    }
}

/// Euclidean norm.
fn norm(quantised: &[i32], step: f32) -> f64 {
    quantised.iter().map(|&q| f64::from(q).powi(2)).sum::<f64>().sqrt() * f64::from(step)
}

/// Mean and components, quantised over the angles.
struct Core {
    turns: Turns,
    bytes: Vec<u8>,
}

impl Core {
    fn encode(slices: &[f32], meta: &BtfMeta, step: f32) -> Option<Self> {
        let (views, lights) = (meta.views.len(), meta.lights.len());
        let matrices = channels_first(slices, views * lights);
        let mut turns = Turns::new(&matrices, views, lights)?;
        let all = quantise(&turns.forward(&matrices, views, lights), step * CORE_STEP);
        // drop the directions beyond the last one in use
        let used =
            |place: &dyn Fn(usize) -> usize| (0..all.len()).filter(|&i| all[i] != 0).map(place).max().unwrap_or(0) + 1;
        let kept = [used(&|i| i / lights % views), used(&|i| i % lights)];
        turns.views.truncate(kept[0] * views);
        turns.lights.truncate(kept[1] * lights);
        let mut quantised: Vec<i32> = all
            .chunks_exact(views * lights)
            .flat_map(|matrix| matrix.chunks_exact(lights).take(kept[0]).flat_map(|row| &row[..kept[1]]))
            .copied()
            .collect();
        let mut encoder = Encoder::default();
        planes::core(&mut encoder, &mut quantised, kept[0], kept[1]);
        Some(Self { turns, bytes: encoder.finish() })
    }

    /// Decodes the slices (view, light, rgb).
    fn decode(&self, slices: usize, meta: &BtfMeta, step: f32) -> Vec<f32> {
        let (views, lights) = (meta.views.len(), meta.lights.len());
        let kept = [self.turns.views.len() / views, self.turns.lights.len() / lights];
        let mut quantised = vec![0; slices * 3 * kept[0] * kept[1]];
        planes::core(&mut Decoder::new(&self.bytes), &mut quantised, kept[0], kept[1]);
        let core: Vec<f32> = quantised.iter().map(|&q| q as f32 * step * CORE_STEP).collect();
        channels_last(&self.turns.inverse(&core, views, lights), views * lights)
    }
}

/// Maximum number of plane texels per byte: no decision takes less than 0.0007 bits.
const TEXELS_PER_BYTE: usize = 1 << 16;

/// Limit on the numbers of all components: 1 GiB in single precision.
const MAX_NUMBERS: u64 = 1 << 28;

/// Decodes a file to its factors, with the number of components before padding.
fn decode(container: &Container, settings: &Settings) -> Result<(usize, Compact)> {
    let meta = container.meta();
    let invalid = |tensor: &str, problem: String| Error::invalid(container.path(), format!("tensor {tensor}"), problem);
    let first = |tensor: &str| container.shape(tensor).and_then(|shape| shape.first().copied()).unwrap_or(0);
    // Read the rotations
    let kept = [first("view_turn"), first("light_turn")];
    for (tensor, kept, all) in [("view_turn", kept[0], meta.views.len()), ("light_turn", kept[1], meta.lights.len())] {
        if !(1..=all).contains(&kept) {
            return Err(invalid(tensor, format!("found {kept} directions, expected 1 to {all}")));
        }
    }
    let [views, lights, stream] = layout(meta, kept, first("stream"));
    let halves = |spec: &TensorSpec| match container.numbers(spec)? {
        Numbers::F16(numbers) => Ok(numbers.to_vec()),
        _ => Err(invalid(&spec.name, "found another number type, expected half precision".into())),
    };
    let turns = Turns { views: halves(&views)?, lights: halves(&lights)? };
    if turns.views.iter().chain(&turns.lights).any(|v| v.to_f32().abs() > 1.01) {
        return Err(invalid("view_turn, light_turn", "a component of a unit vector exceeds 1".into()));
    }
    // Split the stream and check its sizes
    let Numbers::U8(stream) = container.numbers(&stream)? else {
        return Err(invalid("stream", "found another number type, expected bytes".into()));
    };
    let blocks = blocks(&stream).map_err(|problem| invalid("stream", problem))?;
    let (core, planes) = blocks.split_first().ok_or_else(|| invalid("stream", "it is empty".into()))?;
    let most = settings.components;
    if planes.len() > most {
        return Err(invalid("stream", format!("found {} components, expected at most {most}", planes.len())));
    }
    if let Some(plane) = planes.iter().find(|p| (p.len() + 8).saturating_mul(TEXELS_PER_BYTE) < meta.texels()) {
        return Err(invalid("stream", format!("{} bytes are too few for {} texels", plane.len(), meta.texels())));
    }
    let numbers = (planes.len() as u64 + 1) * 3 * meta.pairs() as u64;
    if numbers > MAX_NUMBERS {
        let (path, field) = (container.path().into(), "numbers of the components".into());
        return Err(Error::Limit { path, field, found: numbers, limit: MAX_NUMBERS });
    }
    // Decode mean and components
    let step = step(settings, meta);
    let slices = Core { turns, bytes: core.to_vec() }.decode(planes.len() + 1, meta, step);
    let (mean, components) = slices.split_at(3 * meta.pairs());
    let scale = 1.0 / (meta.texels() as f32).sqrt();
    let mean: Vec<f32> = mean.iter().map(|v| v * scale).collect();
    // Decode the coefficients
    let cosine = Cosine::new(meta.width, meta.height);
    let held: Vec<factored::Plane> = planes
        .par_iter()
        .map(|bytes| {
            let (plane, norm) = Plane::decode(bytes, meta, &cosine, step);
            factored::Plane::new(&plane, norm, HELD_STEP * step)
        })
        .collect();
    // Quantise the components, now that their coefficients are known
    let mut compact = Compact::new(&mean, &held, meta.texels())?;
    for (k, component) in components.chunks_exact(3 * meta.pairs()).enumerate() {
        compact.set_component(k, component);
    }
    Ok((planes.len(), compact))
}
