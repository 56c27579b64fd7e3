//! Fits of analytic models to a BRDF or to samples, ranked.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec2;
use serde::Serialize;

use super::{Assignment, open_brdf, read_samples};
use crate::fit::{self, Data};
use crate::material::{Brdf, BrdfSample, Material};
use crate::model::{self, Analytic, MODELS, Model};
use crate::output::write_file;
use crate::params::{Given, Values};
use crate::progress::Progress;
use crate::{Error, Result, plot, separable};

/// Pixels per side of a sphere.
const SPHERE: usize = 160;

/// Maximum number of curves that can be told apart.
const CURVES: usize = 5;

/// Polar angles of the light in polar plots, degrees.
const LIGHTS: [f32; 3] = [20.0, 45.0, 70.0];

/// The directions of the samples taken from a BRDF.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FitAt {
    /// At the nodes of its table.
    Nodes,
    /// At pairs of directions spread evenly up to 80 degrees.
    #[default]
    Even,
}

/// Settings of a fit.
#[derive(Debug, Clone, Default)]
pub struct FitRequest {
    /// A BRDF as for [`open_brdf`], or samples in a `.csv` file as for [`read_samples`].
    pub source: PathBuf,
    /// A model, or all of them.
    pub model: Option<String>,
    /// Parameters of the model that are words; these do not vary.
    pub fixed: Vec<Assignment>,
    /// The directions of the samples.
    pub at: FitAt,
    /// How to search; `anisotropic` is replaced.
    pub options: fit::Options,
    /// Whether the surface may be anisotropic; by default, as the source states.
    pub anisotropic: Option<bool>,
    /// Options of the importer.
    pub import: Given,
}

/// Models ranked by their error, the best first.
#[derive(Debug, Serialize)]
pub struct Ranking {
    /// The source as the user named it.
    pub source: String,
    /// Number of samples found.
    pub samples: usize,
    /// Number of samples used.
    pub used_samples: usize,
    /// The minimised metric.
    pub metric: &'static str,
    /// Whether the surface may be anisotropic.
    pub anisotropic: bool,
    /// The fits.
    pub fits: Vec<Ranked>,
    /// The opened BRDF and its label; `None` for samples.
    #[serde(skip)]
    pub original: Option<(String, Arc<dyn Brdf>)>,
    /// The samples used.
    #[serde(skip)]
    pub data: Data,
}

/// A fitted model.
#[derive(Debug, Serialize)]
pub struct Ranked {
    /// The model.
    pub model: &'static str,
    /// Value of the metric, in its own unit.
    pub error: f64,
    /// Value of the metric, relative to that of a black material.
    pub relative_error: f64,
    /// Number of evaluations of the model at all samples.
    pub evaluations: usize,
    /// Duration in seconds.
    pub seconds: f64,
    /// The parameters found.
    pub params: Values,
    /// The fitted material.
    #[serde(skip)]
    pub brdf: Analytic,
}

/// Fits one model or all to a BRDF.
///
/// # Errors
/// Errors of opening the source; as [`fit::fit`].
pub fn rank(request: &FitRequest, progress: &dyn Progress) -> Result<Ranking> {
    let (samples, original) = samples(request, progress)?;
    let data = Data::new(&samples)?;
    let isotropic = original.as_ref().is_some_and(|(_, brdf)| brdf.promises().isotropic);
    let anisotropic = request.anisotropic.unwrap_or(!isotropic);
    let mut fits = Vec::new();
    for model in models(request)? {
        let given = request.fixed.iter().map(|s| (s.name.as_str(), s.value.as_str()));
        let fixed = Values::new(model.params(), given)?;
        let has_lobes = model.params().iter().any(|param| param.name == "lobes");
        let lobes = if request.model.is_none() && !has_lobes { 1 } else { request.options.lobes };
        let options = fit::Options { lobes, anisotropic, ..request.options.clone() };
        fits.push(ranked(fit::fit(model, &fixed, &data, &options, progress)?));
    }
    fits.sort_by(|a, b| a.error.total_cmp(&b.error));
    Ok(Ranking {
        source: request.source.display().to_string(),
        samples: samples.len(),
        used_samples: data.len(),
        metric: request.options.metric.name(),
        anisotropic,
        fits,
        original,
        data,
    })
}

type Original = Option<(String, Arc<dyn Brdf>)>;

fn samples(request: &FitRequest, progress: &dyn Progress) -> Result<(Vec<BrdfSample>, Original)> {
    if request.source.extension().is_some_and(|e| e == "csv") {
        return Ok((read_samples(&request.source)?, None));
    }
    let (label, brdf) = open_brdf(&request.source, &request.import, progress)?;
    let samples = match request.at {
        FitAt::Nodes => brdf.samples(),
        FitAt::Even => {
            let sample = |(wi, wo)| BrdfSample { wi, wo, value: brdf.eval(Vec2::ZERO, wi, wo) };
            separable::pairs(fit::MAX_SAMPLES).map(sample).collect()
        }
    };
    Ok((samples, Some((label, brdf))))
}

fn models(request: &FitRequest) -> Result<Vec<&'static dyn Model>> {
    match (&request.model, request.fixed.first()) {
        (Some(name), _) => Ok(vec![model::by_name(name)?]),
        (None, Some(setting)) => Err(Error::parameter(&setting.name, "can be set for one model only, not for all")),
        (None, None) => Ok(MODELS.to_vec()),
    }
}

fn ranked(fit: fit::Fit) -> Ranked {
    let fit::Fit { brdf, error, relative_error, evaluations, seconds } = fit;
    let (model, params) = (brdf.model().name(), brdf.values().clone());
    Ranked { model, error, relative_error, evaluations, seconds, params, brdf }
}

impl Ranking {
    /// The original, if there is one, and the fits by rank.
    fn materials(&self) -> Vec<(&str, &dyn Material)> {
        let original = self.original.iter().map(|(label, brdf)| (label.as_str(), brdf.as_ref() as &dyn Material));
        original.chain(self.fits.iter().map(|fit| (fit.model, &fit.brdf as &dyn Material))).collect()
    }

    /// Draws a row of spheres with their names, the original first, then the fits by rank.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; [`Error::Io`].
    pub fn write_spheres(&self, path: &Path, progress: &dyn Progress) -> Result<()> {
        let materials = self.materials();
        plot::named_spheres(&materials, SPHERE, materials.len(), progress)?.write_noted(path, progress.command())
    }

    /// Draws polar slices of the original and the best fits, `.svg`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_polar(&self, path: &Path) -> Result<()> {
        let named: Vec<plot::NamedMaterial> = self.materials().into_iter().take(CURVES).collect();
        let svg = plot::polar(&named, &LIGHTS);
        write_file(path, |out| out.write_all(svg.as_bytes()))
    }
}
