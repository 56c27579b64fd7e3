//! Writers, one file per format.

mod raw;
mod ubo2003;

use std::path::Path;

use rayon::prelude::*;

use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// Every exporter, in the order in which they are asked.
pub const EXPORTERS: &[&dyn Exporter] = &[&raw::Raw, &ubo2003::Ubo2003];

/// Writes one format.
pub trait Exporter: Sync {
    /// The user's word for the format.
    fn name(&self) -> &'static str;

    /// One sentence for the reference page.
    fn doc(&self) -> &'static str;

    /// Whether an output of this name is of this format.
    fn accepts(&self, path: &Path) -> bool;

    /// Begins an output for texels described by `meta`. It appears under its name when finished.
    ///
    /// # Errors
    /// If the place cannot be written or the format cannot hold such texels.
    fn create(&self, path: &Path, meta: &BtfMeta, options: &Options) -> Result<Box<dyn BtfWriter>>;
}

/// An output being written. Dropped before [`BtfWriter::finish`], it leaves nothing.
pub trait BtfWriter {
    /// Appends the images of the next view, shape (light, y, x, rgb), in the encoding of the declared meta.
    ///
    /// # Errors
    /// If writing fails.
    fn view(&mut self, texels: &Texels<'_>) -> Result<()>;

    /// Completes the output and puts it under its name.
    ///
    /// # Errors
    /// If writing fails or views are missing.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// How pictures are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    /// JPEG of this quality (1..=100), colour not subsampled.
    Jpeg(u8),
    /// PNG, 8 bits, lossless.
    Png,
}

/// Choices a format may take into account.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// For formats made of pictures.
    pub image: ImageFormat,
}

impl Default for Options {
    fn default() -> Self {
        Self { image: ImageFormat::Jpeg(95) }
    }
}

/// Begins an output in the format that the name of `path` asks for.
///
/// # Errors
/// [`Error::Unsupported`] naming the formats if none fits; else what the exporter says.
pub fn create(path: impl AsRef<Path>, meta: &BtfMeta, options: &Options) -> Result<Box<dyn BtfWriter>> {
    let path = path.as_ref();
    match EXPORTERS.iter().find(|exporter| exporter.accepts(path)) {
        Some(exporter) => exporter.create(path, meta, options),
        None => Err(Error::unsupported(path, "no format has this ending; use a folder, .zip or .toml")),
    }
}

/// Writes all of `source` to `path`, in the format that the name asks for.
///
/// # Errors
/// As [`create`], or if reading or writing fails; then nothing is left under the name.
pub fn export(
    source: &dyn BtfSource,
    path: impl AsRef<Path>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<()> {
    let meta = source.meta();
    let mut writer = create(path, meta, options)?;
    let task = Task::new(progress, "export", meta.views.len() as u64);
    let views: Vec<usize> = (0..meta.views.len()).collect();
    // as many views at once as there are threads bounds the memory
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
