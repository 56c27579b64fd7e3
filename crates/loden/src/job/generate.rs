//! New materials from files: exchanged and edited.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::Vec3;
use serde::Serialize;
use serde_json::{Value, json};

use super::open;
use super::synthesize::read_sized;
use crate::codec::container::SourceInfo;
use crate::codec::parts::{MemoryParts, Provenance, store};
use crate::codec::{self, Codec as _, KMeans};
use crate::color::luminance;
use crate::generate::{self, Edit, Keep, Match, Matching, Rows, Selection, transport};
use crate::import::Measured;
use crate::memory::Memory;
use crate::metric::compare_views;
use crate::params::{Given, Values};
use crate::progress::{Progress, Shares};
use crate::{Error, Result};

/// A mask chooses texels where its picture is brighter than this part of white.
const CHOSEN: f32 = 0.25;

/// About as many views compare the texels of a material that is clustered.
const COMPARED_VIEWS: usize = 27;

/// About as many views measure the error of the clustering.
const MEASURED_VIEWS: usize = 5;

/// Parameters of the clustering, as good as the defaults and faster.
const QUICK: [(&str, &str); 2] = [("dimensions", "16"), ("iterations", "15")];

/// A material opened as rows.
pub(super) struct Opened {
    pub rows: Rows,
    provenance: Provenance,
    /// The mean error of clustering in some of the views, if the material has no rows of its own.
    pub loss: Option<f64>,
    /// Holds the file of the rows that were made.
    _folder: Option<tempfile::TempDir>,
}

/// Opens a material as rows. One without rows is clustered first, and a warning says what that costs.
pub(super) fn opened(path: &Path, options: &Given, clusters: usize, progress: &dyn Progress) -> Result<Opened> {
    let opened = rows_of(path, options, clusters, progress)?;
    opened.tell(path, progress);
    Ok(opened)
}

/// Opens two materials at once, as [`opened`].
fn both(paths: [&Path; 2], options: &Given, clusters: usize, progress: &dyn Progress) -> Result<(Opened, Opened)> {
    let shares = Shares::new(progress, "cluster", 2);
    let one = |path| rows_of(path, options, clusters, &shares.share());
    let (first, second) = rayon::join(|| one(paths[0]), || one(paths[1]));
    drop(shares);
    let (first, second) = (first?, second?);
    first.tell(paths[0], progress);
    second.tell(paths[1], progress);
    Ok((first, second))
}

impl Opened {
    /// Warns if the material was clustered.
    fn tell(&self, path: &Path, progress: &dyn Progress) {
        if let Some(loss) = self.loss {
            let (path, count) = (path.display(), self.rows.count());
            progress.warn(&format!(
                "{path} has no rows: its texels were clustered into {count}, with a mean error of {loss:.4}"
            ));
        }
    }
}

fn rows_of(path: &Path, options: &Given, clusters: usize, progress: &dyn Progress) -> Result<Opened> {
    let measured = open(path, options, progress)?.measured;
    if let Measured::Compressed(compressed) = &measured
        && let Some(rows) = Rows::new(compressed.parts().clone())?
    {
        return Ok(Opened { rows, provenance: compressed.provenance()?, loss: None, _folder: None });
    }
    let source = measured.images().map_err(|_| Error::unsupported(path, "holds a BRDF, a BTF is needed here"))?;
    let folder = tempfile::tempdir().map_err(Error::io(std::env::temp_dir()))?;
    let file = folder.path().join("rows.loden");
    let count = clusters.to_string();
    let given = [("clusters", count.as_str()), ("precision", "f16")].into_iter().chain(QUICK);
    let params = Values::new(KMeans.params(), given)?;
    let every = |views: usize| source.meta().views.len().div_ceil(views);
    KMeans.encode_by_views(every(COMPARED_VIEWS), &*source, &params, &file, progress)?;
    let compressed = codec::open(&file)?;
    let loss = compare_views(&*source, &*compressed, every(MEASURED_VIEWS), progress)?.mean_abs_error;
    let missing = || Error::unsupported(path, "cannot be clustered");
    let rows = Rows::new(compressed.parts().clone())?.ok_or_else(missing)?;
    Ok(Opened { rows, provenance: compressed.provenance()?, loss: Some(loss), _folder: Some(folder) })
}

/// Settings of an exchange.
#[derive(Debug, Clone)]
pub struct ExchangeRequest {
    /// The material whose pattern is taken, named as for [`open()`].
    pub structure: PathBuf,
    /// The material whose reflectance is taken.
    pub reflectance: PathBuf,
    /// Options of the importers.
    pub options: Given,
    /// How rows are matched.
    pub by: Match,
    /// Regularises the transport by this much, if at all.
    pub epsilon: Option<f64>,
    /// Splits rows over all that the transport matches them with; else they go to one.
    pub split: bool,
    /// What the pattern keeps.
    pub keep: Keep,
    /// Clusters of materials that have no rows.
    pub clusters: usize,
    /// The file to write.
    pub output: PathBuf,
}

/// An exchange that was made.
#[derive(Debug, Clone, Serialize)]
pub struct Exchanged {
    /// The file.
    pub output: PathBuf,
    /// The material whose pattern was taken.
    pub structure: PathBuf,
    /// The material whose reflectance was taken.
    pub reflectance: PathBuf,
    /// How rows were matched.
    #[serde(rename = "match")]
    pub by: &'static str,
    /// What the pattern kept.
    pub keep: &'static str,
    /// Rows of both materials.
    pub rows: [usize; 2],
    /// Rows of the second that are used.
    pub used: usize,
    /// The mean squared difference of matched rows, if they were compared.
    pub cost: Option<f64>,
    /// Mean errors of clustering, where a material had no rows.
    pub clustering_error: [Option<f64>; 2],
    /// Size of the file.
    pub bytes: u64,
    /// Seconds in all.
    pub seconds: f64,
}

/// Puts the reflectance of one material on the pattern of another.
///
/// # Errors
/// Errors of opening and clustering; those of [`Matching::new`] and [`generate::exchange()`]; errors of writing.
pub fn exchange(request: &ExchangeRequest, progress: &dyn Progress) -> Result<Exchanged> {
    let start = Instant::now();
    let ExchangeRequest { structure, reflectance, options, by, epsilon, split, keep, clusters, output } = request;
    if *split && *by != Match::Transport {
        return Err(Error::parameter("split", format!("rows are split by transport, not by {by}")));
    }
    let (a, b) = both([structure, reflectance], options, *clusters, progress)?;
    let (n, m) = (a.rows.count(), b.rows.count());
    progress.stage(&format!("match {n} rows with {m}: {}", Memory(transport::memory(n, m))));
    let matching = match split {
        true => Matching::split(&a.rows, &b.rows, *epsilon)?,
        false => Matching::new(&a.rows, &b.rows, *by, *epsilon)?,
    };
    let parts = generate::exchange(&a.rows, &b.rows, &matching, *keep)?;
    let step = json!({ "exchange": {
        "structure": name(structure), "reflectance": name(reflectance), "match": by.name(), "keep": keep.name(),
        "regularisation": epsilon, "split": split,
    }});
    let directions = if *keep == Keep::Shading { &a } else { &b };
    let bytes = stored(&parts, &a, directions, step, output)?;
    Ok(Exchanged {
        output: output.clone(),
        structure: structure.clone(),
        reflectance: reflectance.clone(),
        by: by.name(),
        keep: keep.name(),
        rows: [n, m],
        used: matching.used().len(),
        cost: matching.cost,
        clustering_error: [a.loss, b.loss],
        bytes,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// Settings of a mixture.
#[derive(Debug, Clone)]
pub struct BlendRequest {
    /// The material whose pattern is taken, named as for [`open()`].
    pub first: PathBuf,
    /// The material that is mixed in.
    pub second: PathBuf,
    /// Options of the importers.
    pub options: Given,
    /// How much of the second, 0 to 1.
    pub amount: f32,
    /// A picture of the size of the first, whose brightness multiplies the amount.
    pub mask: Option<PathBuf>,
    /// Clusters of materials that have no rows.
    pub clusters: usize,
    /// The file to write.
    pub output: PathBuf,
}

/// A mixture that was made.
#[derive(Debug, Clone, Serialize)]
pub struct Blended {
    /// The file.
    pub output: PathBuf,
    /// The material whose pattern was taken.
    pub first: PathBuf,
    /// The material that was mixed in.
    pub second: PathBuf,
    /// How much of it.
    pub amount: f32,
    /// Rows of both materials.
    pub rows: [usize; 2],
    /// The mean squared difference of matched rows.
    pub cost: Option<f64>,
    /// Mean errors of clustering, where a material had no rows.
    pub clustering_error: [Option<f64>; 2],
    /// Mean error of interpolating the second material at the directions of the first, there and back.
    pub resampling_error: f64,
    /// Size of the file.
    pub bytes: u64,
    /// Seconds in all.
    pub seconds: f64,
}

/// Mixes two materials, whose rows are matched by optimal transport.
///
/// # Errors
/// Errors of opening and clustering; [`Error::Invalid`] for a mask of another size; those of [`Matching::new`] and
/// [`generate::blend()`]; errors of writing.
pub fn blend(request: &BlendRequest, progress: &dyn Progress) -> Result<Blended> {
    let start = Instant::now();
    let BlendRequest { first, second, options, amount, mask, clusters, output } = request;
    let (a, b) = both([first, second], options, *clusters, progress)?;
    let mask_values = mask.as_ref().map(|path| luminances(path, &a.rows)).transpose()?;
    let (n, m) = (a.rows.count(), b.rows.count());
    let resampling_error = generate::resampling_error(&b.rows, a.rows.meta())?;
    if resampling_error > 0.0 {
        let path = second.display();
        progress.warn(&format!(
            "{path} has other directions and is interpolated at those of the first material: mean error {resampling_error:.4}"
        ));
    }
    progress.stage(&format!("match {n} rows with {m}: {}", Memory(transport::memory(n, m))));
    let matching = Matching::new(&a.rows, &b.rows, Match::Transport, None)?;
    let parts = generate::blend(&a.rows, &b.rows, &matching, *amount, mask_values.as_deref())?;
    let step = json!({ "blend": {
        "first": name(first), "second": name(second), "amount": amount, "mask": mask.as_deref().map(name),
    }});
    let directions = if *amount == 1.0 && mask.is_none() { &b } else { &a };
    let bytes = stored(&parts, &a, directions, step, output)?;
    Ok(Blended {
        output: output.clone(),
        first: first.clone(),
        second: second.clone(),
        amount: *amount,
        rows: [n, m],
        cost: matching.cost,
        clustering_error: [a.loss, b.loss],
        resampling_error,
        bytes,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// Stores parts that were made of `from`; what was measured are the values of `directions`. Parts that did not change make the
/// same file again.
pub(super) fn stored(
    parts: &MemoryParts,
    from: &Opened,
    directions: &Opened,
    step: Value,
    output: &Path,
) -> Result<u64> {
    if *parts == MemoryParts::copy(&**from.rows.parts())? {
        return store(parts, &from.provenance, output);
    }
    let one = std::ptr::eq(from, directions);
    let source = &directions.provenance.source;
    let identity = if one { source.identity.clone() } else { None };
    let mut provenance = Provenance::unknown(SourceInfo { identity, ..source.clone() });
    provenance.history = from.provenance.history.iter().cloned().chain([step]).collect();
    provenance.lossless.clone_from(&from.provenance.lossless);
    store(parts, &provenance, output)
}

pub(super) fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// What an edit changes, in the words of a user.
#[derive(Debug, Clone, PartialEq)]
pub enum On {
    /// Every row, chosen ones, or texels around one.
    Selection(Selection),
    /// The texels where a picture of the size of the material is bright.
    Mask(PathBuf),
}

/// Settings of an edit.
#[derive(Debug, Clone)]
pub struct EditRequest {
    /// The material, named as for [`open()`].
    pub input: PathBuf,
    /// Options of the importer.
    pub options: Given,
    /// What is changed.
    pub on: On,
    /// The changes.
    pub edit: Edit,
    /// Clusters of a material that has no rows.
    pub clusters: usize,
    /// The file to write.
    pub output: PathBuf,
}

/// An edit that was made.
#[derive(Debug, Clone, Serialize)]
pub struct Edited {
    /// The file.
    pub output: PathBuf,
    /// The material.
    pub source: PathBuf,
    /// The changes.
    pub edit: Edit,
    /// Rows before and after: a mask can make more.
    pub rows: [usize; 2],
    /// Mean error of clustering, if the material had no rows.
    pub clustering_error: Option<f64>,
    /// Size of the file.
    pub bytes: u64,
    /// Seconds in all.
    pub seconds: f64,
}

/// Edits a material.
///
/// # Errors
/// Errors of opening and clustering; [`Error::Invalid`] for a mask of another size; those of [`generate::edit()`]; errors of
/// writing.
pub fn edit(request: &EditRequest, progress: &dyn Progress) -> Result<Edited> {
    let start = Instant::now();
    let EditRequest { input, options, on, edit, clusters, output } = request;
    let from = opened(input, options, *clusters, progress)?;
    let (selection, words) = match on {
        On::Selection(selection) => (selection.clone(), format!("{selection:?}")),
        On::Mask(path) => (Selection::Mask(mask(path, &from.rows)?), format!("Mask({:?})", name(path))),
    };
    progress.stage("edit");
    let parts = generate::edit(&from.rows, &selection, edit)?;
    let after = Rows::new(std::sync::Arc::new(parts.clone()))?.map_or(0, |rows| rows.count());
    let step = json!({ "edit": edit, "on": words });
    Ok(Edited {
        output: output.clone(),
        source: input.clone(),
        edit: *edit,
        rows: [from.rows.count(), after],
        clustering_error: from.loss,
        bytes: stored(&parts, &from, &from, step, output)?,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// The texels where a picture is bright.
fn mask(path: &Path, rows: &Rows) -> Result<Vec<bool>> {
    Ok(luminances(path, rows)?.iter().map(|v| *v > CHOSEN).collect())
}

/// The luminance of the pixels of a picture that has the size of a material, 0 to 1.
fn luminances(path: &Path, rows: &Rows) -> Result<Vec<f32>> {
    let meta = rows.meta();
    let picture = read_sized(path, [meta.width, meta.height], "material")?;
    Ok(picture.rgb.iter().map(|c: &Vec3| luminance(c.to_array()).clamp(0.0, 1.0)).collect())
}
