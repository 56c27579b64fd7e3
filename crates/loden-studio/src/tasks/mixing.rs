//! What could be made of some materials, as pictures: every pattern with every reflectance, and the way from one to another.

use std::path::{Path, PathBuf};

use glam::Vec3;
use loden::codec;
use loden::generate::Keep;
use loden::job::{self, BlendRequest};
use loden::params::Given;
use loden::picture::Picture;
use loden::progress::Progress;
use loden::{Error, Result};
use serde::Deserialize;
use serde_json::{Value, json};

use super::change::{CLUSTERS, exchange, keep};
use super::growth::frontal;
use super::words::Words;
use crate::Studio;
use crate::failure::Answer;
use crate::images::encoded;
use crate::jobs::{Job, Work};

/// Materials of a grid.
const GRID: std::ops::RangeInclusive<usize> = 2..=5;

/// Steps from one material to another, both of them included.
const STEPS: std::ops::RangeInclusive<usize> = 3..=17;

/// Pixels per side of a cell and between cells.
const CELL: usize = 144;
const FRAME: usize = 256;
const GAP: usize = 4;

/// What is not known yet: linear grey.
const UNKNOWN: Vec3 = Vec3::splat(0.0232);

/// The patterns of some materials with the reflectance of each: `loden generate exchange` of all pairs.
#[derive(Deserialize)]
pub(crate) struct Grid {
    materials: Vec<String>,
    /// Whether patterns keep their shading.
    shading: bool,
}

impl Grid {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        if !GRID.contains(&self.materials.len()) {
            let problem = format!("found {}, expected {} to {}", self.materials.len(), GRID.start(), GRID.end());
            return Err(Error::parameter("materials", problem).into());
        }
        let files = self.materials.iter().map(|id| studio.folders.find(id)).collect::<Answer<Vec<_>>>()?;
        let own = self.materials.iter().map(|id| Ok(frontal(&*studio.images(id)?)?)).collect::<Answer<Vec<_>>>()?;
        let keep = keep(self.shading);
        let lines = pairs(files.len()).map(|[row, column]| {
            let words = Words::new("generate exchange").file("structure", &files[row]);
            let words = words.file("reflectance", &files[column]).flag("keep", keep.name());
            words.output(Path::new(&format!("{}-{}.loden", stem(&files[row]), stem(&files[column]))))
        });
        let (command, title) = (lines.collect::<Vec<_>>().join("\n"), titled(&files, " × "));
        let run = move |job: &Job| drawn_grid(&files, &own, keep, job);
        Ok(Work { kind: "grid", title, command, output: None, run: Box::new(run) })
    }
}

/// All pairs of different numbers.
fn pairs(count: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..count * count).map(move |i| [i / count, i % count]).filter(|[row, column]| row != column)
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn titled(files: &[PathBuf], between: &str) -> String {
    files.iter().map(|file| stem(file)).collect::<Vec<_>>().join(between)
}

/// Shows the grid whenever a cell is done: a row for each pattern, a column for each reflectance.
fn drawn_grid(files: &[PathBuf], own: &[Picture], keep: Keep, job: &Job) -> Result<Value> {
    let count = files.len();
    let mut sheet = Sheet::new(count, count, CELL);
    (0..count).for_each(|k| sheet.put(k, k, &own[k]));
    job.show(sheet.png()?);
    let folder = tempfile::tempdir().map_err(Error::io(std::env::temp_dir()))?;
    for (done, [row, column]) in pairs(count).enumerate() {
        job.stage(&format!("{} of {}", done + 1, pairs(count).count()));
        let output = folder.path().join(format!("{row}-{column}.loden"));
        job::exchange(&exchange(files[row].clone(), files[column].clone(), keep, output.clone()), job)?;
        sheet.put(column, row, &frontal(&*codec::open(&output)?)?);
        job.show(sheet.png()?);
    }
    Ok(json!({ "columns": count, "rows": count, "cell": CELL, "gap": GAP }))
}

/// The way from one material to another: `loden generate blend` in even steps.
#[derive(Deserialize)]
pub(crate) struct Steps {
    first: String,
    second: String,
    count: usize,
}

impl Steps {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        if !STEPS.contains(&self.count) {
            let problem = format!("found {}, expected {} to {}", self.count, STEPS.start(), STEPS.end());
            return Err(Error::parameter("count", problem).into());
        }
        let files = [studio.folders.find(&self.first)?, studio.folders.find(&self.second)?];
        let own = frontal(&*studio.images(&self.first)?)?;
        studio.images(&self.second)?;
        let amounts: Vec<f32> = (1..self.count).map(|k| k as f32 / (self.count - 1) as f32).collect();
        let lines = amounts.iter().map(|amount| {
            let words = Words::new("generate blend").path(&files[0]).path(&files[1]).flag("amount", amount);
            words.output(Path::new(&format!("{}-{amount}.loden", stem(&files[0]))))
        });
        let (command, title) = (lines.collect::<Vec<_>>().join("\n"), titled(&files, " → "));
        let run = move |job: &Job| drawn_steps(&files, &own, &amounts, job);
        Ok(Work { kind: "steps", title, command, output: None, run: Box::new(run) })
    }
}

/// Shows the steps in a row whenever one is done.
fn drawn_steps([first, second]: &[PathBuf; 2], own: &Picture, amounts: &[f32], job: &Job) -> Result<Value> {
    let mut sheet = Sheet::new(amounts.len() + 1, 1, FRAME.min(own.width).min(own.height));
    sheet.put(0, 0, own);
    job.show(sheet.png()?);
    let folder = tempfile::tempdir().map_err(Error::io(std::env::temp_dir()))?;
    for (k, amount) in amounts.iter().enumerate() {
        job.stage(&format!("{} of {}", k + 1, amounts.len()));
        let output = folder.path().join(format!("{k}.loden"));
        let request = BlendRequest {
            first: first.clone(),
            second: second.clone(),
            options: Given::default(),
            amount: *amount,
            mask: None,
            clusters: CLUSTERS,
            output: output.clone(),
        };
        job::blend(&request, job)?;
        sheet.put(k + 1, 0, &frontal(&*codec::open(&output)?)?);
        job.show(sheet.png()?);
    }
    Ok(json!({ "columns": amounts.len() + 1, "rows": 1, "cell": sheet.side, "gap": GAP }))
}

/// Square cells in rows and columns.
struct Sheet {
    picture: Picture,
    side: usize,
}

impl Sheet {
    fn new(columns: usize, rows: usize, side: usize) -> Self {
        let size = |count: usize| count * (side + GAP) - GAP;
        Self { picture: Picture::filled(size(columns), size(rows), UNKNOWN), side }
    }

    /// Puts the top left corner of an image into a cell, repeated where it is smaller.
    fn put(&mut self, column: usize, row: usize, image: &Picture) {
        let (left, top) = (column * (self.side + GAP), row * (self.side + GAP));
        for (x, y) in (0..self.side * self.side).map(|i| (i % self.side, i / self.side)) {
            self.picture.rgb[(top + y) * self.picture.width + left + x] = image.at(x % image.width, y % image.height);
        }
    }

    fn png(&self) -> Result<Vec<u8>> {
        encoded(&self.picture).map_err(|failure| Error::parameter("picture", failure.message()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_where_the_page_cuts_them() {
        let mut sheet = Sheet::new(3, 2, 4);
        assert_eq!((sheet.picture.width, sheet.picture.height), (3 * 4 + 2 * GAP, 2 * 4 + GAP));
        sheet.put(2, 1, &Picture::filled(2, 2, Vec3::ONE));
        let at = |x: usize, y: usize| sheet.picture.at(2 * (4 + GAP) + x, 4 + GAP + y);
        assert!((0..16).all(|i| at(i % 4, i / 4) == Vec3::ONE));
        assert_eq!(sheet.picture.rgb.iter().filter(|c| **c == Vec3::ONE).count(), 16);
        assert_eq!(pairs(3).collect::<Vec<_>>(), [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]);
    }
}
