//! Analytic: a BRDF model fitted to every texel.
//!
//! # Model
//! Each texel's apparent BRDF is a sum of terms of a model of [`crate::model`], which [`crate::fit`] fits to pairs of
//! view and light that are spread evenly. The mean of all texels is fitted from many starting points. The search for
//! a texel begins at that fit or at the result of its left neighbour, whichever is closer. The file stores the free
//! parameters: about a dozen numbers per texel.
//!
//! # Limits
//! Effects that no BRDF can express are lost: parallax, shadows cast by other texels, light from below. During the
//! fit, `samples` values per texel are held in half precision.
//!
//! # References
//! lafortune1997, golub1973, ngan2005

use std::path::Path;
use std::sync::LazyLock;

use glam::{DVec3, Vec3};
use half::f16;
use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, FloatType};
use crate::codec::container::Writer;
use crate::codec::interpret::stored_cosine;
use crate::codec::parts::{Curve, Expr, PlaneSpec, Recipe};
use crate::codec::values::{FLOAT_PRECISION, image, stored, view_texels};
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::Domain;
use crate::fit::{Data, Free, Metric, Options, fit, refit};
use crate::material::BrdfSample;
use crate::model::{MODELS, Model, by_name};
use crate::params::{Field, Form, Kind, Param, Params as _, Type, Values, YesNo};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Analytic;

/// Error of the fit to the mean, relative to that of black, above which a model says nothing about a material: values
/// above 1, which no surface reflects, or none above the horizon.
const USELESS: f64 = 0.9;

/// The names of all models.
static NAMES: LazyLock<Vec<&str>> = LazyLock::new(|| MODELS.iter().map(|model| model.name()).collect());

/// The name of a model.
#[derive(Debug, Clone, PartialEq)]
struct ModelName(String);

impl Field for ModelName {
    const TYPE: Type =
        Type::Text(Form { expected: "the name of a model", examples: &[], accepts: |name| by_name(name).is_ok() });

    fn read(values: &Values, name: &str) -> Result<Self> {
        Ok(Self(values.written(name)?.into()))
    }

    fn write(&self, name: &str, values: &mut Values) -> Result<()> {
        values.set(name, &self.0)
    }
}

crate::params! {
    struct Settings {
        /// The BRDF model.
        model: ModelName = "lafortune",
        /// Number of lobes of the lafortune model; the other models have one.
        lobes: usize [1..=3] = 1,
        /// Whether texels may be anisotropic.
        grain: YesNo = "yes",
        /// Error that the fit minimises: the squared difference of reflected light, of its logarithm, or of its cube
        /// root.
        metric: Metric = "cosine",
        /// Number of pairs of view and light that each texel is fitted to.
        samples: usize [8..=20_000] = 500,
        precision: FloatType => FLOAT_PRECISION,
    }
}

/// The parameter table with the names of all models, which a constant cannot list.
static PARAMS: LazyLock<Vec<Param>> = LazyLock::new(|| {
    let choice = |param: &Param| match param.name {
        "model" => Param { kind: Kind::Choice(&NAMES), ..*param },
        _ => *param,
    };
    Settings::TABLE.iter().map(choice).collect()
});

/// The model and how to fit it.
fn options(settings: &Settings) -> Result<(&'static dyn Model, Options)> {
    let (model, lobes) = (by_name(&settings.model.0)?, settings.lobes);
    if lobes > 1 && model.params().iter().all(|param| param.name != "lobes") {
        return Err(Error::parameter("lobes", format!("found {lobes}, but {} has one", model.name())));
    }
    let (metric, anisotropic) = (settings.metric, settings.grain == YesNo::Yes);
    Ok((model, Options { metric, lobes, anisotropic, ..Options::default() }))
}

impl Codec for Analytic {
    fn name(&self) -> &'static str {
        "analytic"
    }

    fn doc(&self) -> &'static str {
        "An analytic BRDF model fitted to every texel: a dozen numbers each, no parallax."
    }

    fn params(&self) -> &'static [Param] {
        &PARAMS
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        let settings = Settings::from_values(params)?;
        let (meta, (model, options)) = (source.meta(), options(&settings)?);
        let free = Free::new(model, &options)?;
        let writer = Writer::create(path, self, params, source, &self.recipe(meta, params)?)?;
        let samples = Samples::read(source, settings.samples, progress)?;
        let mean = Data::new(&samples.mean())?;
        let found = fit(model, &Values::defaults(model.params()), &mean, &options, progress)?;
        if found.relative_error > USELESS && mean.scale(options.metric) > 0.0 {
            let problem = format!(
                "{} cannot represent this BTF: its best fit to the mean of all texels has {:.0} % of the error of a black material",
                model.name(),
                100.0 * found.relative_error
            );
            return Err(Error::parameter("model", problem));
        }
        let mean = found.brdf;
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
                    // an exponent beyond half precision is a mirror, and so is the largest one within it
                    row.extend(free.numbers(&left)?.iter().map(|v| v.min(f16::MAX.to_f32())));
                }
                task.advance(1)?;
                Ok(row)
            })
            .collect();
        writer.write("parameters", 0, &stored(&rows?.concat(), settings.precision)?)?;
        Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let settings = Settings::from_values(params)?;
        let (model, options) = options(&settings)?;
        let count = Free::new(model, &options)?.count();
        let (name, lobes, grain) = (model.name().into(), options.lobes, options.anisotropic);
        Ok(Recipe {
            planes: vec![PlaneSpec::numbers("parameters", count, settings.precision.into())],
            tables: Vec::new(),
            value: Expr::Model { name, lobes, grain, plane: 0 },
            curve: Curve::Brdf,
        })
    }
}

/// The values of all texels for selected pairs.
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
        // a stride by the golden ratio keeps the views out of step with the lights
        let slot = |i: usize| (i as f64 + (i as f64 * 0.618_033_988_749_895).fract()) * pairs as f64 / count as f64;
        let chosen: Vec<usize> =
            (0..count).map(|i| if count == pairs { i } else { (slot(i) as usize).min(pairs - 1) }).collect();
        let direction = |&pair: &usize| meta.pair(pair / lights, pair % lights);
        let directions: Vec<(Vec3, Vec3)> = chosen.iter().map(direction).collect();
        let mut values = vec![[f16::ZERO; 3]; meta.texels() * count];
        let task = Task::new(progress, "read", meta.views.len() as u64);
        for view in 0..meta.views.len() {
            let texels = view_texels(source, view)?;
            let of_view = chosen.iter().enumerate().filter(|(_, pair)| *pair / lights == view);
            for (i, pair) in of_view {
                let scale = 1.0 / (std::f32::consts::PI * stored_cosine(meta, directions[i].0));
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

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::btf::{Cosine, MemoryBtf, SampleType, Texels};
    use crate::codec::open;
    use crate::color::Encoding;
    use crate::direction::DirectionSet;
    use crate::material::Material;
    use crate::model;
    use crate::progress::Silent;

    /// Two by three texels, each a different GGX.
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
                let params = Values::new(&PARAMS, [("model", "ggx"), ("grain", grain), ("precision", "f32")]).unwrap();
                Analytic.encode(&source, &params, &path, &Silent).unwrap();
                let report = crate::metric::compare(&source, &*open(&path).unwrap(), &Silent).unwrap();
                assert!(report.mean_abs_error < tolerance, "{cosine:?} {grain}: {report:?}");
            }
        }
    }
}
