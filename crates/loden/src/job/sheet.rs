//! Pictures of an object with a measurement and with compressed forms of it, side by side.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;
use serde::Serialize;

use super::{Look, open_among};
use crate::import::Measured;
use crate::material::{Interpolation, Material};
use crate::metric::{self, PictureReport};
use crate::params::Given;
use crate::picture::{CELL, Picture};
use crate::progress::Progress;
use crate::{Error, Result};

/// Pixels between the pictures of a sheet.
const GAP: usize = 6;

/// Height of the names above the pictures, in pixels.
const HEAD: usize = CELL[1] + 2;

/// A material of a sheet.
pub struct Worn {
    /// Its file.
    pub path: PathBuf,
    /// The material.
    pub material: Arc<dyn Material>,
    /// Size of its file or files in bytes.
    pub bytes: u64,
}

impl Worn {
    /// Opens a material, named as for [`open_among`].
    ///
    /// # Errors
    /// Errors of opening it.
    pub fn open(
        path: &Path,
        interpolation: impl Into<Interpolation>,
        options: &Given,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let measured = open_among(path, options, progress)?.measured;
        let bytes = match &measured {
            Measured::Btf(source) => source.source_bytes(),
            Measured::Compressed(btf) => btf.bytes(),
            // a model has no file
            Measured::Brdf(_) => std::fs::metadata(path).map_or(0, |found| found.len()),
        };
        Ok(Self { path: path.into(), material: measured.material(interpolation)?, bytes })
    }
}

/// Difference between the pictures of a compressed material and of the original.
#[derive(Debug, Clone, Serialize)]
pub struct SheetRow {
    /// The file of the material.
    pub file: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// The difference as displayed.
    #[serde(flatten)]
    pub report: PictureReport,
}

/// Pictures of the same object, and their differences.
pub struct Sheet {
    /// A row for each material but the first.
    pub rows: Vec<SheetRow>,
    /// The name of each material's file.
    pub names: Vec<String>,
    /// A picture for each material.
    pub pictures: Vec<Picture>,
    /// The absolute differences to the first, amplified; for each material but the first.
    pub differences: Vec<Picture>,
}

/// Draws an object with the original, then with each of the others; differences are multiplied by `gain`.
///
/// # Errors
/// As [`super::render::draw`].
pub fn sheet(look: &Look, original: &Worn, others: &[Worn], gain: f32, progress: &dyn Progress) -> Result<Sheet> {
    let object = look.object(progress)?;
    let drawn = |worn: &Worn| {
        let name = worn.path.display().to_string();
        progress.stage(&format!("rendering {name}"));
        look.draw(&object, worn.material.as_ref(), &name, progress)
    };
    let reference = drawn(original)?;
    let name = |worn: &Worn| worn.path.file_name().unwrap_or(worn.path.as_os_str()).to_string_lossy().into_owned();
    let names = std::iter::once(original).chain(others).map(name).collect();
    let mut sheet = Sheet { rows: Vec::new(), names, pictures: vec![reference.clone()], differences: Vec::new() };
    for worn in others {
        let picture = drawn(worn)?;
        let report = metric::pictures(&reference, &picture)?;
        sheet.differences.push(metric::difference(&reference, &picture, gain)?);
        sheet.pictures.push(picture);
        sheet.rows.push(SheetRow { file: worn.path.clone(), bytes: worn.bytes, report });
    }
    Ok(sheet)
}

impl Sheet {
    /// One picture: the materials in a row under their names, below each the difference to the first.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no picture.
    pub fn picture(&self) -> Result<Picture> {
        let first = self.pictures.first().ok_or_else(|| Error::parameter("sheet", "there are no pictures"))?;
        let (width, height) = (first.width, first.height);
        let size = |count: usize, side: usize| count * side + (count - 1) * GAP;
        let mut sheet = Picture::filled(size(self.pictures.len(), width), HEAD + size(2, height), Vec3::ONE);
        for (column, name) in self.names.iter().enumerate() {
            sheet.write_centred([column * (width + GAP), 0], width, name, Vec3::ZERO, 1);
        }
        let columns = self.pictures.iter().enumerate().map(|(column, picture)| (column, 0, picture));
        let below = self.differences.iter().enumerate().map(|(column, picture)| (column + 1, 1, picture));
        for (column, row, picture) in columns.chain(below) {
            for (y, line) in picture.rgb.chunks_exact(width).enumerate() {
                let at = (HEAD + row * (height + GAP) + y) * sheet.width + column * (width + GAP);
                sheet.rgb[at..][..width].copy_from_slice(line);
            }
        }
        Ok(sheet)
    }
}
