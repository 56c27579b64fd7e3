//! Variants of a material, and a sheet that shows them.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;
use serde_json::json;

use super::generate::{name, opened, stored};
use super::{Look, Worn, side_by_side};
use crate::Result;
use crate::direction::Scheme;
use crate::generate::{self, Edit, Selection};
use crate::output::create_folder;
use crate::params::Given;
use crate::picture::Picture;
use crate::progress::{Progress, Task};

/// Pictures beside each other on the sheet.
const COLUMNS: usize = 4;

/// Settings of a family.
#[derive(Debug, Clone)]
pub struct FamilyRequest {
    /// The material, named as for [`super::open()`].
    pub input: PathBuf,
    /// Options of the importer.
    pub options: Given,
    /// Number of variants.
    pub count: usize,
    /// Chooses one of many families.
    pub seed: u64,
    /// How different the variants are, 0 to 2.
    pub spread: f32,
    /// How the sheet shows them.
    pub look: Look,
    /// Clusters of a material that has no rows.
    pub clusters: usize,
    /// The folder to write into.
    pub output: PathBuf,
}

/// A family that was made.
#[derive(Debug, Clone, Serialize)]
pub struct Family {
    /// The folder.
    pub output: PathBuf,
    /// The material.
    pub source: PathBuf,
    /// The seed.
    pub seed: u64,
    /// The variants.
    pub variants: Vec<Variant>,
    /// Mean error of clustering, if the material had no rows.
    pub clustering_error: Option<f64>,
    /// Seconds in all.
    pub seconds: f64,
    /// The material and its variants.
    #[serde(skip)]
    pub sheet: Picture,
}

/// A variant, which is what [`super::edit`] makes of the material by the same edit.
#[derive(Debug, Clone, Serialize)]
pub struct Variant {
    /// Its file.
    pub file: PathBuf,
    /// How it differs from the material.
    pub edit: Edit,
    /// Size of the file.
    pub bytes: u64,
}

/// Writes variants of a material, `NAME-01.loden` and so on, and draws all of them.
///
/// # Errors
/// Errors of opening and clustering; those of [`generate::family()`] and [`generate::edit()`]; errors of writing and
/// rendering; [`crate::Error::Cancelled`].
pub fn family(request: &FamilyRequest, progress: &dyn Progress) -> Result<Family> {
    let start = Instant::now();
    let FamilyRequest { input, options, count, seed, spread, look, clusters, output } = request;
    let edits = generate::family(*count, *seed, *spread)?;
    let from = opened(input, options, *clusters, progress)?;
    create_folder(output)?;
    let stem = input.file_stem().unwrap_or(input.as_os_str()).to_string_lossy().into_owned();
    let digits = count.to_string().len().max(2);
    let write = |number: usize, edit: Edit| {
        let file = output.join(format!("{stem}-{number:0digits$}.loden"));
        let parts = generate::edit(&from.rows, &Selection::All, &edit)?;
        let step = json!({ "edit": edit, "on": format!("{:?}", Selection::All) });
        Ok(Variant { bytes: stored(&parts, &from, &from, step, &file)?, file, edit })
    };
    let task = Task::new(progress, "variants", *count as u64);
    let numbered = edits.into_iter().enumerate().map(|(k, edit)| {
        task.advance(u64::from(k > 0))?;
        write(k + 1, edit)
    });
    let variants: Vec<Variant> = numbered.collect::<Result<_>>()?;
    drop(task);
    let sheet = drawn(look, input, options, &variants, progress)?;
    Ok(Family {
        output: output.clone(),
        source: input.clone(),
        seed: *seed,
        variants,
        clustering_error: from.loss,
        seconds: start.elapsed().as_secs_f64(),
        sheet,
    })
}

/// The material and its variants on one object, under their names.
fn drawn(look: &Look, input: &Path, options: &Given, variants: &[Variant], progress: &dyn Progress) -> Result<Picture> {
    let object = look.object(progress)?;
    let none = Given::default();
    let files = variants.iter().map(|variant| (variant.file.as_path(), &none));
    let picture = |(path, options): (&Path, &Given)| {
        let worn = Worn::open(path, Scheme::Triangles, options, progress)?;
        let name = name(path);
        progress.stage(&format!("render {name}"));
        let picture = look.draw(&object, worn.material.as_ref(), &name, progress)?;
        Ok((name, picture))
    };
    let pictures: Vec<(String, Picture)> =
        std::iter::once((input, options)).chain(files).map(picture).collect::<Result<_>>()?;
    Ok(side_by_side(&pictures, COLUMNS))
}
