//! Exporting a compressed material to another renderer.

use std::path::Path;

use serde::Serialize;

use super::open::label;
use crate::output::OutputDir;
use crate::progress::Progress;
use crate::renderers::Renderer;
use crate::{Error, Result, codec};

/// A folder that was written for another renderer.
#[derive(Debug, Serialize)]
pub struct RendererExport {
    /// Name of the renderer.
    pub renderer: &'static str,
    /// Number of files.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
}

/// Writes the compressed material `input` as a folder for `renderer`; the folder must be empty or not exist.
///
/// # Errors
/// Errors of opening the file; [`Error::Unsupported`] if the renderer cannot show such a material; [`Error::Exists`];
/// [`Error::Io`]; [`Error::Cancelled`]. Nothing is left behind.
pub fn export_to(
    input: &Path,
    renderer: &dyn Renderer,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<RendererExport> {
    let material = codec::open(input)?;
    renderer.check(input, &material)?;
    let output = OutputDir::create(folder)?;
    renderer.write(&label(input), &material, output.folder(), progress)?;
    let written = std::fs::read_dir(output.folder()).map_err(Error::io(folder))?;
    let sizes = written.map(|entry| Ok(entry?.metadata()?.len())).collect::<std::io::Result<Vec<u64>>>();
    let sizes = sizes.map_err(Error::io(folder))?;
    output.commit()?;
    Ok(RendererExport { renderer: renderer.name(), files: sizes.len(), bytes: sizes.iter().sum() })
}
