//! Writers, one file per format.

mod astm;
mod bdi;
mod bonn;
mod dfmf;
mod factored;
mod fmf;
mod merl;
mod raw;
mod rgl;
mod slice;
mod ubo2003;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::material::{BrdfSample, Material};
use crate::params::{Given, Param, Values};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// Every exporter of BTFs; the first that accepts a path writes it.
pub const EXPORTERS: &[&dyn Exporter] = &[&raw::Raw, &dfmf::Dfmf, &fmf::Fmf, &bdi::Bdi, &ubo2003::Ubo2003];

/// Every exporter of BRDFs.
pub const BRDF_EXPORTERS: &[&dyn BrdfExporter] = &[&rgl::Rgl, &merl::Merl, &astm::Astm, &slice::Slice];

/// Writes one format that holds a BRDF.
pub trait BrdfExporter: Sync {
    /// Name of the format, as users write it.
    fn name(&self) -> &'static str;

    /// One sentence for the reference page.
    fn doc(&self) -> &'static str;

    /// Its file extension.
    fn ending(&self) -> &'static str;

    /// Parameter table of its options.
    fn params(&self) -> &'static [Param] {
        &[]
    }

    /// Phrases that name what the format cannot hold of this material.
    fn losses(&self, material: &dyn Material) -> Vec<&'static str>;

    /// Writes a material, with options of the table [`BrdfExporter::params`]. Tables are evaluated from `material`; a
    /// list of samples holds `samples` if it is not empty.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; [`Error::Io`]; no partial file is left.
    fn write(&self, material: &dyn Material, samples: &[BrdfSample], path: &Path, options: &Values) -> Result<()>;
}

/// The exporter of BRDFs called `name`, or that of the extension of `path`.
///
/// # Errors
/// [`Error::Parameter`] or [`Error::Unsupported`] naming the formats if there is none.
pub fn brdf_exporter(path: &Path, name: Option<&str>) -> Result<&'static dyn BrdfExporter> {
    let known = || BRDF_EXPORTERS.iter().map(|e| e.name()).collect::<Vec<_>>().join(", ");
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    match name {
        Some(name) => BRDF_EXPORTERS
            .iter()
            .find(|e| e.name() == name)
            .copied()
            .ok_or_else(|| Error::parameter("to", format!("found {name:?}, expected one of {}", known()))),
        None => BRDF_EXPORTERS.iter().find(|e| e.ending() == ending).copied().ok_or_else(|| {
            let endings = BRDF_EXPORTERS.iter().map(|e| format!(".{}", e.ending())).collect::<Vec<_>>().join(", ");
            Error::unsupported(path, format!("no BRDF format has this extension; use one of {endings}"))
        }),
    }
}

/// Writes a BRDF to `path`, in the format given by its extension; see [`BrdfExporter::write`].
///
/// # Errors
/// As [`brdf_exporter`] and [`BrdfExporter::write`]; [`Error::Parameter`] for options that the format does not have.
pub fn export_brdf(material: &dyn Material, samples: &[BrdfSample], path: &Path, options: &Given) -> Result<()> {
    let exporter = brdf_exporter(path, None)?;
    exporter.write(material, samples, path, &options.values(exporter.params())?)
}

/// Writes one format that holds a BTF.
pub trait Exporter: Sync {
    /// Name of the format, as users write it.
    fn name(&self) -> &'static str;

    /// One sentence for the reference page.
    fn doc(&self) -> &'static str;

    /// Whether an output of this name is of this format.
    fn accepts(&self, path: &Path) -> bool;

    /// The ending of its files where they are single ones.
    fn ending(&self) -> Option<&'static str>;

    /// Files beside `path` that the output may replace.
    fn beside(&self, _path: &Path) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Parameter table of its options.
    fn params(&self) -> &'static [Param] {
        &[]
    }

    /// Phrases that name what the format cannot hold of this BTF.
    fn losses(&self, source: &dyn BtfSource) -> Vec<&'static str>;

    /// Begins an output for texels described by `meta`, with options of the table [`Exporter::params`]. It appears under
    /// its name when finished.
    ///
    /// # Errors
    /// If `path` cannot be written or the format cannot hold such texels.
    fn create(&self, path: &Path, meta: &BtfMeta, options: &Values) -> Result<Box<dyn BtfWriter>>;
}

/// An output being written. It leaves nothing if dropped before [`BtfWriter::finish`].
pub trait BtfWriter {
    /// Appends the images of the next view, shape (light, y, x, rgb), in the encoding of the declared meta.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a view of another size or one too many; [`Error::NonFinite`]; errors of writing.
    fn view(&mut self, texels: &Texels<'_>) -> Result<()>;

    /// Completes the output and renames it into place.
    ///
    /// # Errors
    /// [`Error::Parameter`] if views are missing; errors of writing.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Checks the values of a BRDF.
fn check_finite(mut values: impl Iterator<Item = f32>) -> Result<()> {
    if values.all(f32::is_finite) { Ok(()) } else { Err(Error::non_finite("the BRDF")) }
}

/// Checks that a [`BtfWriter`] that has written `written` views can take `texels` as the next one.
fn check_view(meta: &BtfMeta, written: usize, texels: &Texels<'_>) -> Result<()> {
    let (found, expected) = (texels.len(), meta.view_len());
    if found != expected {
        return Err(Error::parameter("texels", format!("found {found} numbers, expected {expected}")));
    }
    if written == meta.views.len() {
        return Err(Error::parameter("views", format!("found {}, expected {written}", written + 1)));
    }
    Ok(())
}

/// Checks that a [`BtfWriter`] that has written `written` views is complete.
fn check_complete(meta: &BtfMeta, written: usize) -> Result<()> {
    let expected = meta.views.len();
    if written == expected {
        return Ok(());
    }
    Err(Error::parameter("views", format!("found {written}, expected {expected}")))
}

/// Begins an output in the format given by the extension of `path`.
///
/// # Errors
/// [`Error::Unsupported`] naming the formats if none fits; errors of [`Exporter::create`].
pub fn create(path: impl AsRef<Path>, meta: &BtfMeta, options: &Given) -> Result<Box<dyn BtfWriter>> {
    let exporter = by_name(path.as_ref(), None)?;
    exporter.create(path.as_ref(), meta, &options.values(exporter.params())?)
}

/// The loss common to all BTF formats: none marks substituted images.
fn substitutes(source: &dyn BtfSource) -> Option<&'static str> {
    (!source.missing().is_empty()).then_some("which pairs were not measured, since substitutes are stored for them")
}

/// The exporter of BTFs called `name`, or that of the extension of `path`.
///
/// # Errors
/// [`Error::Parameter`] or [`Error::Unsupported`] naming the formats if there is none.
pub fn by_name(path: &Path, name: Option<&str>) -> Result<&'static dyn Exporter> {
    match name {
        Some(name) => EXPORTERS.iter().find(|e| e.name() == name).copied().ok_or_else(|| {
            let known = EXPORTERS.iter().map(|e| e.name()).collect::<Vec<_>>().join(", ");
            Error::parameter("to", format!("found {name:?}, expected one of {known}"))
        }),
        None => EXPORTERS.iter().find(|e| e.accepts(path)).copied().ok_or_else(|| {
            Error::unsupported(path, "no BTF format has this extension; use a folder, .zip, .btf or .toml")
        }),
    }
}

/// Writes all of `source` to `path`, in the format given by its extension.
///
/// # Errors
/// As [`create`]; errors of reading and writing. No partial output is left.
pub fn export(source: &dyn BtfSource, path: impl AsRef<Path>, options: &Given, progress: &dyn Progress) -> Result<()> {
    export_as(by_name(path.as_ref(), None)?, source, path, options, progress)
}

/// Writes all of `source` to `path` in the format of `exporter`.
///
/// # Errors
/// As [`export`].
pub fn export_as(
    exporter: &dyn Exporter,
    source: &dyn BtfSource,
    path: impl AsRef<Path>,
    options: &Given,
    progress: &dyn Progress,
) -> Result<()> {
    let meta = source.meta();
    let mut writer = exporter.create(path.as_ref(), meta, &options.values(exporter.params())?)?;
    let task = Task::new(progress, "export", meta.views.len() as u64);
    let views: Vec<usize> = (0..meta.views.len()).collect();
    // one view per thread at a time bounds the memory
    for chunk in views.chunks(rayon::current_num_threads()) {
        let texels: Vec<Texels> = chunk.par_iter().map(|&v| source.view(v)).collect::<Result<_>>()?;
        for (&view, texels) in chunk.iter().zip(&texels) {
            writer.view(texels)?;
            source.release(view);
            task.advance(1)?;
        }
    }
    writer.finish()
}
