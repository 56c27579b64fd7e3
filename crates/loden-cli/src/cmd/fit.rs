//! `loden fit`: analytic models fitted to a measured BRDF, ranked.

use std::path::{Path, PathBuf};

use clap::Args;
use glam::Vec2;
use loden::fit::{self, Data, Metric, Options};
use loden::material::{Brdf, BrdfSample, Material};
use loden::model::{self, MODELS, Model};
use loden::params::Values;
use loden::separable;
use loden::{Error, plot};
use serde_json::{Map, Value, json};

use super::brdf::write_text;
use crate::flags::Assumptions;
use crate::reflectance::{self, Setting};
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Fit {
    /// A BRDF file, a BTF (averaged), a model such as `ward:alpha-x=0.1`, or samples in a .csv file: theta_i, phi_i,
    /// theta_o, phi_o in degrees, r, g, b in 1/sr.
    source: String,
    /// A model's name, or `all`; `loden brdf models` lists them.
    #[arg(long, default_value = "all")]
    model: String,
    /// Where the BRDF is compared: at the nodes of its table, or at pairs of directions spread evenly up to 80 degrees.
    #[arg(long, value_enum, default_value = "nodes")]
    at: At,
    /// Lobes of the models that have several.
    #[arg(long, default_value_t = 1)]
    lobes: usize,
    /// What is made small: root mean square of f cos, of ln(1 + f cos), or of the cube root of f cos.
    #[arg(long, value_enum, default_value = "cosine")]
    metric: MetricFlag,
    /// Places from which the search starts, at least.
    #[arg(long, default_value_t = 12)]
    starts: usize,
    /// Another seed tries other places.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Whether the surface has a grain [default: what the source says of itself].
    #[arg(long)]
    anisotropic: Option<bool>,
    /// A parameter of the model that is a word and so does not vary; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<Setting>,
    /// A row of spheres, the original first, then the fits by rank: .png or .exr.
    #[arg(long, value_name = "FILE")]
    spheres: Option<PathBuf>,
    /// Polar slices of the original and the best fits, .svg.
    #[arg(long, value_name = "FILE")]
    polar: Option<PathBuf>,
    /// Writes the samples that are used in the form of a .csv source.
    #[arg(long, value_name = "FILE")]
    dump: Option<PathBuf>,
    #[command(flatten)]
    assumptions: Assumptions,
}

/// Which samples a model is fitted to.
#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
enum At {
    Nodes,
    Even,
}

/// See [`Metric`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum MetricFlag {
    Cosine,
    Log,
    CubeRoot,
}

impl Fit {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let (samples, source) = if self.source.ends_with(".csv") {
            (reflectance::read_samples(Path::new(&self.source))?, None)
        } else {
            let source = reflectance::open(&self.source, &self.assumptions, terminal)?;
            let samples = if self.at == At::Even { even_samples(source.as_ref()) } else { source.samples() };
            (samples, Some(source))
        };
        let data = Data::new(&samples)?;
        if let Some(path) = &self.dump {
            write_text(path, &reflectance::samples_as_csv(&data.samples()))?;
        }
        let options = self.options(source.as_ref().is_some_and(|source| source.promises().isotropic));
        let mut fits = Vec::new();
        for model in self.models()? {
            let given = self.set.iter().map(|s| (s.name.as_str(), s.value.as_str()));
            let fixed = Values::new(model.params(), given)?;
            let lobes = if self.model == "all" && !has_lobes(model) { 1 } else { options.lobes };
            fits.push(fit::fit(model, &fixed, &data, &Options { lobes, ..options.clone() }, terminal)?);
        }
        fits.sort_by(|a, b| a.error.total_cmp(&b.error));
        self.draw(source.as_deref(), &fits, terminal)?;
        let value = json!({
            "source": self.source,
            "samples": samples.len(),
            "used_samples": data.len(),
            "metric": options.metric.name(),
            "anisotropic": options.anisotropic,
            "fits": fits.iter().map(row).collect::<Vec<_>>(),
        });
        terminal.result(&value, || table(&fits))
    }

    fn options(&self, isotropic: bool) -> Options {
        let metric = match self.metric {
            MetricFlag::Cosine => Metric::Cosine,
            MetricFlag::Log => Metric::Logarithmic,
            MetricFlag::CubeRoot => Metric::CubeRoot,
        };
        let anisotropic = self.anisotropic.unwrap_or(!isotropic);
        Options { metric, starts: self.starts, seed: self.seed, lobes: self.lobes, anisotropic }
    }

    fn models(&self) -> loden::Result<Vec<&'static dyn Model>> {
        if self.model != "all" {
            return Ok(vec![model::by_name(&self.model)?]);
        }
        if let Some(setting) = self.set.first() {
            return Err(Error::parameter(&setting.name, "can be set for one model only, not for all"));
        }
        Ok(MODELS.to_vec())
    }

    fn draw(&self, source: Option<&dyn Brdf>, fits: &[fit::Fit], terminal: &Terminal) -> anyhow::Result<()> {
        let original = source.map(|source| (reflectance::label(&self.source), source as &dyn Material));
        let fitted = fits.iter().map(|fit| (fit.brdf.model().name().to_owned(), &fit.brdf as &dyn Material));
        let all: Vec<(String, &dyn Material)> = original.into_iter().chain(fitted).collect();
        if let Some(path) = &self.spheres {
            let materials: Vec<&dyn Material> = all.iter().map(|(_, material)| *material).collect();
            plot::spheres(&materials, 160, materials.len(), terminal)?.write(path)?;
        }
        if let Some(path) = &self.polar {
            // more than a handful of curves cannot be told apart
            let named: Vec<plot::Named> = all.iter().take(5).map(|(name, m)| (name.as_str(), *m)).collect();
            write_text(path, &plot::polar(&named, &[20.0, 45.0, 70.0]))?;
        }
        Ok(())
    }
}

fn even_samples(source: &dyn Material) -> Vec<BrdfSample> {
    let value = |wi, wo| source.eval(Vec2::ZERO, wi, wo);
    separable::pairs(fit::MAX_SAMPLES).map(|(wi, wo)| BrdfSample { wi, wo, value: value(wi, wo) }).collect()
}

fn has_lobes(model: &dyn Model) -> bool {
    model.params().iter().any(|param| param.name == "lobes")
}

fn row(fit: &fit::Fit) -> Value {
    let params: Map<String, Value> = fit.brdf.values().iter().map(|(name, text)| (name.into(), json!(text))).collect();
    json!({
        "model": fit.brdf.model().name(),
        "error": fit.error,
        "relative_error": fit.relative_error,
        "evaluations": fit.evaluations,
        "seconds": fit.seconds,
        "params": params,
    })
}

fn table(fits: &[fit::Fit]) -> String {
    let cells = |fit: &fit::Fit| {
        vec![
            fit.brdf.model().name().to_owned(),
            format!("{:.5}", fit.error),
            format!("{:.4}", fit.relative_error),
            format!("{:.2}", fit.seconds),
        ]
    };
    let mut text = report::table(&["model", "error", "relative", "s"], &fits.iter().map(cells).collect::<Vec<_>>());
    if let [fit] = fits {
        let values: Vec<_> = fit.brdf.values().iter().map(|(name, text)| format!("{name}={text}")).collect();
        text.push_str(&values.join("\n"));
    }
    text
}
