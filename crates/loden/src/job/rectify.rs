//! Raw photographs made into a BTF file, with a report about each.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use crate::btf::Texels;
use crate::progress::Progress;
use crate::rectify::{Options, Outcome, Photographs};
use crate::{Result, export};

/// A BTF that was made of photographs.
#[derive(Debug, Clone, Serialize)]
pub struct Rectified {
    /// The BTF.
    pub output: PathBuf,
    /// Its images.
    pub images: usize,
    /// Texels per side.
    pub size: usize,
    /// Median over the photographs of the distance of the frame's edges from straight lines, pixels.
    pub median_error_px: Option<f64>,
    /// The largest such distance.
    pub largest_error_px: Option<f64>,
    /// Photographs with saturated pixels.
    pub saturated: usize,
    /// Photographs that were refused; in their place stands the nearest light of the same view.
    pub refused: usize,
    /// What became of each.
    pub photographs: Vec<Photograph>,
    /// Seconds it took.
    pub seconds: f64,
}

/// What became of one photograph.
#[derive(Debug, Clone, Serialize)]
pub struct Photograph {
    /// The file of its shortest exposure.
    pub file: PathBuf,
    /// Index of the view.
    pub view: usize,
    /// Index of the light.
    pub light: usize,
    /// Root mean square distance of the frame's edges from straight lines, pixels.
    pub error_px: Option<f64>,
    /// Saturated pixels.
    pub saturated: usize,
    /// Why it was refused, if it was.
    pub refused: Option<String>,
}

/// Rectifies the photographs of a manifest and writes a BTF as the ending of `output` asks for.
///
/// # Errors
/// As [`Photographs::open`], [`Photographs::rectify`] and [`export::create`].
pub fn rectify(
    manifest: &Path,
    output: &Path,
    options: &Options,
    pictures: &crate::params::Given,
    progress: &dyn Progress,
) -> Result<Rectified> {
    let start = Instant::now();
    let photographs = Photographs::open(manifest)?;
    let mut writer = export::create(output, &photographs.meta(options), pictures)?;
    let outcomes =
        photographs.rectify(options, progress, &mut |texels| writer.view(&Texels::F32(Cow::Owned(texels))))?;
    writer.finish()?;
    let photographs: Vec<Photograph> = outcomes.into_iter().map(row).collect();
    for Photograph { file, refused, .. } in &photographs {
        if let Some(reason) = refused {
            progress.warn(&format!("{} is refused: {reason}", file.display()));
        }
    }
    let mut errors: Vec<f64> = photographs.iter().filter_map(|photograph| photograph.error_px).collect();
    errors.sort_by(f64::total_cmp);
    Ok(Rectified {
        output: output.into(),
        images: photographs.len(),
        size: options.size,
        median_error_px: errors.get(errors.len() / 2).copied(),
        largest_error_px: errors.last().copied(),
        saturated: photographs.iter().filter(|photograph| photograph.saturated > 0).count(),
        refused: photographs.iter().filter(|photograph| photograph.refused.is_some()).count(),
        photographs,
        seconds: start.elapsed().as_secs_f64(),
    })
}

fn row(outcome: Outcome) -> Photograph {
    let Outcome { file, pair: [view, light], error, saturated, refused } = outcome;
    Photograph { file, view, light, error_px: error, saturated, refused }
}
