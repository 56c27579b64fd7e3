//! Conversion to another format, with its losses.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::open;
use crate::btf::BtfSource;
use crate::direction::Scheme;
use crate::import::{self, Measured};
use crate::material::{Brdf, TabulatedBrdf};
use crate::params::Given;
use crate::progress::Progress;
use crate::{Error, Result, export, metric};

/// Settings of a conversion.
#[derive(Debug, Clone, Default)]
pub struct ConvertRequest {
    /// A BTF or BRDF, named as for [`open()`].
    pub source: PathBuf,
    /// The file or folder to write.
    pub output: PathBuf,
    /// The name of the format; by default that of the output's extension.
    pub format: Option<String>,
    /// Options of the exporter.
    pub export: Given,
    /// Options of the importer.
    pub import: Given,
    /// Read the output again to measure its error.
    pub check: bool,
}

/// A file in another format.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Conversion {
    /// A converted BTF.
    Btf(BtfConversion),
    /// A converted BRDF.
    Brdf(BrdfConversion),
}

/// A BTF in another format.
#[derive(Debug, Clone, Serialize)]
pub struct BtfConversion {
    /// The file or folder.
    pub output: PathBuf,
    /// The format.
    pub format: &'static str,
    /// Number of images written.
    pub images: usize,
    /// What the format cannot hold, a phrase each.
    pub lost: Vec<&'static str>,
    /// Mean error of display values, if it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_error: Option<f64>,
    /// Largest error of display values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_error: Option<f64>,
}

/// A BRDF in another format.
#[derive(Debug, Clone, Serialize)]
pub struct BrdfConversion {
    /// The file.
    pub output: PathBuf,
    /// The format.
    pub format: &'static str,
    /// Number of samples of the source.
    pub samples: usize,
    /// What the format cannot hold, a phrase each.
    pub lost: Vec<&'static str>,
    /// Cosine-weighted error relative to the values, if the output could be read again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative_error: Option<f64>,
    /// Largest error relative to the largest value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_error: Option<f64>,
}

/// Converts a BTF or a BRDF. A format of BRDFs takes the average of a BTF over its texels.
///
/// # Errors
/// Errors of opening, of [`export::export_as`] and of reading the output again; [`Error::Parameter`] for options that the
/// format does not have.
pub fn convert(request: &ConvertRequest, progress: &dyn Progress) -> Result<Conversion> {
    let averaged = export::brdf_exporter(&request.output, request.format.as_deref()).is_ok();
    match open(&request.source, &request.import, progress)?.measured.images() {
        Ok(source) if averaged => {
            let brdf = TabulatedBrdf::average(source.as_ref(), Scheme::Triangles, progress)?;
            request.brdf(&brdf).map(Conversion::Brdf)
        }
        Ok(source) => request.btf(source.as_ref(), progress).map(Conversion::Btf),
        Err(brdf) => request.brdf(brdf.as_ref()).map(Conversion::Brdf),
    }
}

impl ConvertRequest {
    fn btf(&self, source: &dyn BtfSource, progress: &dyn Progress) -> Result<BtfConversion> {
        let exporter = export::by_name(&self.output, self.format.as_deref())?;
        export::export_as(exporter, source, &self.output, &self.export, progress)?;
        let errors = if self.check { errors(source, &self.output, progress)? } else { None };
        Ok(BtfConversion {
            output: self.output.clone(),
            format: exporter.name(),
            images: source.meta().pairs(),
            lost: exporter.losses(source),
            mean_error: errors.map(|report| report.mean_abs_error),
            largest_error: errors.map(|report| report.max_abs_error),
        })
    }

    fn brdf(&self, brdf: &dyn Brdf) -> Result<BrdfConversion> {
        let exporter = export::brdf_exporter(&self.output, self.format.as_deref())?;
        let options = self.export.values(exporter.params())?;
        let samples = brdf.samples();
        exporter.write(brdf, &samples, &self.output, &options)?;
        // a slice is a picture, which cannot be read as a BRDF
        let back = if self.check { import::open_named(&self.output, &Given::default()).ok() } else { None };
        let found = match back {
            Some((_, Measured::Brdf(back))) => Some(metric::round_trip(&samples, back.as_ref())),
            _ => None,
        };
        Ok(BrdfConversion {
            output: self.output.clone(),
            format: exporter.name(),
            samples: samples.len(),
            lost: exporter.losses(brdf),
            relative_error: found.map(|found| found.relative_error),
            largest_error: found.map(|found| found.largest_error),
        })
    }
}

/// The error of a written BTF against its source; `None`, with a warning, if they cannot be compared.
fn errors(source: &dyn BtfSource, output: &Path, progress: &dyn Progress) -> Result<Option<metric::Report>> {
    let back = import::open(output, &Given::default())?;
    match metric::compare(source, back.as_ref(), progress) {
        Ok(report) => Ok(Some(report)),
        // pictures contain the cosine whether or not the source does
        Err(Error::Parameter { problem, .. }) => {
            progress.warn(&format!("not compared: {problem}"));
            Ok(None)
        }
        Err(other) => Err(other),
    }
}
