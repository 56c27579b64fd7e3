//! Analytic: a BRDF model fitted to every texel.
//!
//! # Model
//! Each texel's apparent BRDF is a sum of terms of a model of [`crate::model`], fitted by [`crate::fit`] to pairs of view
//! and light that are spread evenly. The mean of all texels is fitted from many starts; a texel's search begins at that, or at
//! what its left neighbour gave, whichever is closer. Stored are the parameters that vary: some dozen numbers per texel.
//!
//! # Limits
//! What a BRDF cannot be is lost: parallax, shadows that other texels cast, light from below. While the texels are fitted
//! `samples` values of each are held in half precision.
//!
//! # References
//! lafortune1997, golub1973, ngan2005

use std::f64::consts::PI;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use half::f16;
use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, Cosine};
use crate::codec::container::{Container, TensorSpec, Writer};
use crate::codec::decoder::{Decoder, Opened};
use crate::codec::values::{self, image, numbers, stored, view_texels};
use crate::codec::{Codec, CompressedBtf, EncodeSummary};
use crate::color::domain::Domain;
use crate::direction::Scheme;
use crate::fit::{Data, Free, Metric, Options, fit, refit};
use crate::material::angles::Footprint;
use crate::material::sampled::Sampled;
use crate::material::{BrdfSample, Material};
use crate::model::{MAX_TERMS, Model, Shape, by_name};
use crate::params::{Kind, Param, Values};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Analytic;

const NAMES: &[&str] = &[
    "lambert",
    "oren-nayar",
    "phong",
    "blinn-phong",
    "lafortune",
    "ward",
    "ashikhmin-shirley",
    "schlick",
    "cook-torrance",
    "beckmann",
    "ggx",
    "he-torrance",
];

const PARAMS: &[Param] = &[
    Param { name: "model", unit: "", kind: Kind::Choice(NAMES), default: "lafortune", doc: "The BRDF model." },
    Param {
        name: "lobes",
        unit: "",
        kind: Kind::Integer { min: 1, max: 3 },
        default: "1",
        doc: "Lobes of lafortune; the other models have one.",
    },
    Param {
        name: "grain",
        unit: "",
        kind: Kind::Choice(&["yes", "no"]),
        default: "yes",
        doc: "Whether texels may reflect differently along and across.",
    },
    Param {
        name: "metric",
        unit: "",
        kind: Kind::Choice(&["cosine", "log", "cube-root"]),
        default: "cosine",
        doc: "What fits make small: the squared difference of reflected light, of its logarithm, or of its cube root.",
    },
    Param {
        name: "samples",
        unit: "",
        kind: Kind::Integer { min: 8, max: 20_000 },
        default: "500",
        doc: "Pairs of view and light that a texel is fitted to.",
    },
    values::PRECISION,
];

/// The model and how it is fitted.
fn options(params: &Values) -> Result<(&'static dyn Model, Options)> {
    let metric = Metric::ALL.into_iter().find(|m| m.name() == params.text("metric")).unwrap_or(Metric::Cosine);
    let lobes = params.integer("lobes") as usize;
    let model = by_name(params.text("model"))?;
    if lobes > 1 && model.params().iter().all(|param| param.name != "lobes") {
        return Err(Error::parameter("lobes", format!("found {lobes}, but {} has one", model.name())));
    }
    Ok((model, Options { metric, lobes, anisotropic: params.text("grain") == "yes", ..Options::default() }))
}

fn layout(meta: &BtfMeta, free: &Free, params: &Values) -> TensorSpec {
    let shape = vec![meta.height, meta.width, free.count()];
    TensorSpec { name: "parameters".into(), sample_type: values::precision(params), shape }
}

impl Codec for Analytic {
    fn name(&self) -> &'static str {
        "analytic"
    }

    fn doc(&self) -> &'static str {
        "An analytic BRDF model fitted to every texel: a dozen numbers each, no parallax."
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
        let (meta, (model, options)) = (source.meta(), options(params)?);
        let free = Free::new(model, &options)?;
        let writer = Writer::create(path, self.name(), params, source, &[layout(meta, &free, params)])?;
        let samples = Samples::read(source, params.integer("samples") as usize, progress)?;
        let mean = Data::new(&samples.mean())?;
        let mean = fit(model, &Values::defaults(model.params()), &mean, &options, progress)?.brdf;
        let task = Task::new(progress, "fit", meta.height as u64);
        let rows: Result<Vec<Vec<f32>>> = (0..meta.height)
            .into_par_iter()
            .map(|y| {
                let (mut row, mut left) = (Vec::new(), mean.values().clone());
                for x in 0..meta.width {
                    task.check()?;
                    let data = Data::new(&samples.texel(y * meta.width + x))?;
                    let brdf = refit(model, &data, &options, &[mean.values(), &left])?;
                    left = brdf.values().clone();
                    // an exponent that half precision does not hold is a mirror's, as is the largest it does
                    row.extend(free.numbers(&left)?.iter().map(|v| v.min(f16::MAX.to_f32())));
                }
                task.advance(1)?;
                Ok(row)
            })
            .collect();
        writer.write(0, 0, &stored(&rows?.concat(), params)?)?;
        Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
    }

    fn open(&self, container: Container) -> Result<Arc<dyn CompressedBtf>> {
        let opened = Opened::new(container, self)?;
        let invalid = |e: Error| Error::invalid(opened.container.path(), "params", e.to_string());
        let (model, options) = options(&opened.params).map_err(invalid)?;
        let free = Free::new(model, &options).map_err(invalid)?;
        let numbers = numbers(&opened.container, &layout(&opened.meta, &free, &opened.params))?;
        let texels = numbers.par_chunks_exact(free.count()).map(|numbers| Texel::new(model, &free.values(numbers)?));
        let texels = texels.collect::<Result<_>>().map_err(invalid)?;
        Ok(Arc::new(AnalyticBtf { texels, opened }))
    }
}

/// The values of all texels for some pairs.
struct Samples {
    /// (light, view)
    directions: Vec<(Vec3, Vec3)>,
    /// (texel, pair): the BRDF
    values: Vec<[f16; 3]>,
}

impl Samples {
    fn read(source: &dyn BtfSource, count: usize, progress: &dyn Progress) -> Result<Self> {
        let (meta, pairs) = (source.meta(), source.meta().pairs());
        let (count, lights) = (count.min(pairs), meta.lights.len());
        // the golden ratio keeps the stride from falling in step with the lights
        let slot = |i: usize| (i as f64 + (i as f64 * 0.618_033_988_749_895).fract()) * pairs as f64 / count as f64;
        let chosen: Vec<usize> =
            (0..count).map(|i| if count == pairs { i } else { (slot(i) as usize).min(pairs - 1) }).collect();
        let direction =
            |&pair: &usize| (meta.lights.directions()[pair % lights], meta.views.directions()[pair / lights]);
        let directions: Vec<(Vec3, Vec3)> = chosen.iter().map(direction).collect();
        let mut values = vec![[f16::ZERO; 3]; meta.texels() * count];
        let task = Task::new(progress, "read", meta.views.len() as u64);
        for view in 0..meta.views.len() {
            let texels = view_texels(source, view)?;
            let of_view = chosen.iter().enumerate().filter(|(_, pair)| *pair / lights == view);
            for (i, pair) in of_view {
                let scale = 1.0 / (std::f32::consts::PI * cosine(meta, directions[i].0.z as f64) as f32);
                let image = image(&texels, pair % lights, meta, Domain::Linear);
                for (out, rgb) in values[i..].iter_mut().step_by(count).zip(image.chunks_exact(3)) {
                    *out = [0, 1, 2].map(|c| f16::from_f32((scale * rgb[c]).min(f16::MAX.to_f32())));
                }
            }
            source.release(view);
            task.advance(1)?;
        }
        Ok(Self { directions, values })
    }

    fn texel(&self, texel: usize) -> Vec<BrdfSample> {
        let values = &self.values[texel * self.directions.len()..][..self.directions.len()];
        let sample = |(&(wi, wo), value): (&(Vec3, Vec3), &[f16; 3])| BrdfSample {
            wi,
            wo,
            value: Vec3::from(value.map(f16::to_f32)),
        };
        self.directions.iter().zip(values).map(sample).collect()
    }

    fn mean(&self) -> Vec<BrdfSample> {
        let count = self.directions.len();
        let mut sums = vec![DVec3::ZERO; count];
        for texel in self.values.chunks_exact(count) {
            for (sum, value) in sums.iter_mut().zip(texel) {
                *sum += DVec3::from(value.map(|v| f64::from(v.to_f32())));
            }
        }
        let scale = count as f64 / self.values.len() as f64;
        let sample = |(&(wi, wo), sum): (&(Vec3, Vec3), &DVec3)| BrdfSample { wi, wo, value: (*sum * scale).as_vec3() };
        self.directions.iter().zip(&sums).map(sample).collect()
    }
}

/// What a stored value holds of the light's cosine, at least 0.01.
fn cosine(meta: &BtfMeta, z: f64) -> f64 {
    match meta.cosine {
        Cosine::Included => z.max(0.01),
        Cosine::Excluded => 1.0,
    }
}

/// A texel's BRDF.
struct Texel {
    shape: Box<dyn Shape>,
    factors: [Vec3; MAX_TERMS],
}

impl Texel {
    fn new(model: &'static dyn Model, values: &Values) -> Result<Self> {
        let factors = model.coefficients(&model.color_values(values)?).map(|factor| factor.as_vec3());
        Ok(Self { shape: model.shape(values)?, factors })
    }

    /// pi times the BRDF; zero below the surface.
    fn value(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return DVec3::ZERO;
        }
        let terms = self.shape.terms(wi, wo);
        let terms = terms.iter().zip(&self.factors).take(self.shape.count());
        let sum: DVec3 = terms.map(|(term, factor)| *term * factor.as_dvec3()).sum();
        // the bound keeps the mean of texels finite
        (PI * sum).clamp(DVec3::ZERO, DVec3::splat(1e9))
    }
}

/// Opened: a BRDF for each texel.
struct AnalyticBtf {
    opened: Opened,
    texels: Vec<Texel>,
}

impl Decoder for AnalyticBtf {
    fn opened(&self) -> &Opened {
        &self.opened
    }

    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let meta = &self.opened.meta;
        let wo = unit(meta.views.directions()[view]);
        for (light, out) in lights.zip(out.chunks_exact_mut(meta.image_len())) {
            let wi = unit(meta.lights.directions()[light]);
            let scale = cosine(meta, wi.z);
            for (out, texel) in out.chunks_exact_mut(3).zip(&self.texels) {
                let linear = (texel.value(wi, wo) * scale).as_vec3().to_array();
                out.copy_from_slice(&linear.map(|v| meta.encoding.encode(v)));
            }
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        let bytes = |texel: &Texel| size_of::<Texel>() + size_of_val(&*texel.shape);
        self.texels.iter().map(bytes).sum::<usize>() as u64
    }

    fn evaluable(self: Arc<Self>, scheme: Scheme) -> Result<Arc<dyn Material>> {
        Ok(Arc::new(Sampled::new(AnalyticMaterial(self.clone()), &self.opened.meta, scheme)?))
    }
}

fn unit(w: Vec3) -> DVec3 {
    w.as_dvec3().normalize()
}

/// Texels are interpolated in linear light; directions need not be.
struct AnalyticMaterial(Arc<AnalyticBtf>);

impl Material for AnalyticMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        // written so that NaN is refused, too
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return Vec3::ZERO;
        }
        let (wi, wo, meta) = (unit(wi), unit(wo), &self.0.opened.meta);
        let footprint = Footprint::new(uv, meta.width, meta.height);
        let texels = footprint.texel.into_iter().zip(footprint.weight).filter(|(_, weight)| *weight > 0.0);
        let sum: DVec3 = texels.map(|(texel, weight)| self.0.texels[texel].value(wi, wo) * f64::from(weight)).sum();
        (sum * wi.z).as_vec3()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{MemoryBtf, SampleType, Texels};
    use crate::codec::open;
    use crate::color::Encoding;
    use crate::direction::DirectionSet;
    use crate::model::{self, MODELS};
    use crate::progress::Silent;

    #[test]
    fn every_model_can_be_chosen() {
        assert!(MODELS.iter().map(|model| model.name()).eq(NAMES.iter().copied()));
    }

    /// Two by three texels of which each is another GGX.
    fn source(cosine: Cosine) -> MemoryBtf {
        let set =
            || DirectionSet::from_degrees((0..12).map(|i| [13.0 * f64::from(i % 6), 73.0 * f64::from(i)]).collect());
        let (views, lights) = (set().unwrap(), set().unwrap());
        let meta = BtfMeta {
            width: 3,
            height: 2,
            views,
            lights,
            encoding: Encoding::Srgb,
            cosine,
            sample_type: SampleType::F32,
        };
        let model = model::by_name("ggx").unwrap();
        let brdf = |texel: usize| {
            let (roughness, kd) = (format!("{}", 0.2 + 0.05 * texel as f64), format!("{},0.2,0.3", 0.1 * texel as f64));
            let given = [("alpha-x", &roughness[..]), ("alpha-y", &roughness), ("kd", &kd), ("ks", "0.9")];
            model::Analytic::new(model, Values::new(model.params(), given).unwrap()).unwrap()
        };
        let brdfs: Vec<_> = (0..6).map(brdf).collect();
        let mut values = Vec::new();
        for (wo, wi) in
            meta.views.directions().iter().flat_map(|v| meta.lights.directions().iter().map(move |l| (v, l)))
        {
            for brdf in &brdfs {
                let scale = if cosine == Cosine::Included { wi.z } else { 1.0 };
                let linear = brdf.eval(Vec2::ZERO, *wi, *wo) * (scale * std::f32::consts::PI);
                values.extend(linear.to_array().map(|v| meta.encoding.encode(v)));
            }
        }
        MemoryBtf::new(meta, Texels::F32(values.into())).unwrap()
    }

    #[test]
    fn texels_that_follow_the_model_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.loden");
        for cosine in [Cosine::Included, Cosine::Excluded] {
            let source = source(cosine);
            for (grain, tolerance) in [("no", 1e-3), ("yes", 3e-3)] {
                let params = Values::new(PARAMS, [("model", "ggx"), ("grain", grain), ("precision", "f32")]).unwrap();
                Analytic.encode(&source, &params, &path, &Silent).unwrap();
                let report = crate::metric::compare(&source, &*open(&path).unwrap(), &Silent).unwrap();
                assert!(report.mean_abs_error < tolerance, "{cosine:?} {grain}: {report:?}");
            }
        }
    }
}
