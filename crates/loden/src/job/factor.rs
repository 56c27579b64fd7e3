//! Factorisation of a BRDF into a material of tables, and pictures of these.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::open_brdf;
use crate::Result;
use crate::material::Material;
use crate::output::create_folder;
use crate::params::{Given, Values};
use crate::picture::Picture;
use crate::progress::Progress;
use crate::separable::{self, Factored, Factorisation, Making};

/// Pixels per side of the pictures of a panel.
const PANEL: usize = 256;

/// A factored BRDF.
#[derive(Debug, Clone, Serialize)]
pub struct Factoring {
    /// The BRDF as the user named it.
    pub source: String,
    /// The factorisation.
    pub method: &'static str,
    /// Its parameters.
    pub params: Values,
    /// Sum of |difference| cos divided by the sum of f cos.
    pub mean_rel_error: f64,
    /// Root mean square of the difference times cos, 1/sr.
    pub rmse: f64,
    /// Bytes of the tables.
    pub bytes: usize,
    /// Ratio of the size of a full table of pairs to this size.
    pub ratio: f64,
    /// Seconds to factor.
    pub seconds: f64,
    /// The file that is the factored material.
    pub material: PathBuf,
    /// The folder with it and its pictures.
    pub output: PathBuf,
}

/// The name of the material in its folder.
const MATERIAL: &str = "factored.loden";

/// Factors a BRDF, named as for [`open_brdf`], and writes into `folder` the material `factored.loden`, its tables as
/// pictures `table-N.exr`, and `panel.png` (original, factors, reconstruction, difference).
///
/// # Errors
/// Errors of opening, factoring and writing.
pub fn factor(
    source: &Path,
    method: &dyn Factorisation,
    params: &Values,
    folder: &Path,
    options: &Given,
    progress: &dyn Progress,
) -> Result<Factoring> {
    let (_, brdf) = open_brdf(source, options, progress)?;
    let start = Instant::now();
    let factored = method.factor(brdf.as_ref(), params, progress)?;
    let seconds = start.elapsed().as_secs_f64();
    let found = separable::compare(brdf.as_ref(), &factored);
    let making = Making {
        source: source.display().to_string(),
        method: method.name().into(),
        params: params.iter().map(|(name, text)| format!("{name}={text}")).collect::<Vec<_>>().join(" "),
        mean_rel_error: found.mean_rel_error,
        rmse: found.rmse,
    };
    create_folder(folder)?;
    let material = folder.join(MATERIAL);
    separable::write(&factored, &making, &material)?;
    pictures(folder, brdf.as_ref(), &factored, progress.command())?;
    Ok(Factoring {
        source: making.source,
        method: method.name(),
        params: params.clone(),
        mean_rel_error: found.mean_rel_error,
        rmse: found.rmse,
        bytes: factored.bytes(),
        ratio: factored.ratio(),
        seconds,
        material,
        output: folder.into(),
    })
}

fn pictures(folder: &Path, original: &dyn Material, factored: &Factored, command: Option<&str>) -> Result<()> {
    separable::panel(original, factored, PANEL).write_noted(folder.join("panel.png"), command)?;
    for (k, grid) in factored.tables().into_iter().enumerate() {
        let picture = Picture { width: grid.size, height: grid.size, rgb: grid.texels.clone() };
        picture.write_noted(folder.join(format!("table-{}.exr", k + 1)), command)?;
    }
    Ok(())
}
