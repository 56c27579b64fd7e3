//! `curet`: the BRDF tables of the CUReT database.
//!
//! # Format
//! `abrdf.dat` (mean of the channels), or `rbrdf.dat`, `gbrdf.dat` and `bbrdf.dat`: one line per material with its number
//! and 205 values in 1/sr. `table.txt` in the same folder lists the directions: number, theta_v, phi_v, theta_i, phi_i in radians.
//!
//! # Limits
//! Reads one material at a time, chosen by its number; the first by default. A file with one channel is read together
//! with the other two if they are in the same folder. A material is isotropic and reciprocal if its samples bear that out;
//! negative values become 0.
//!
//! # References
//! dana1999

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;

use super::rows::{MAX_TEXT, directions, number, scattered_facts};
use super::{Importer, Measured, head, located};
use crate::input::text;
use crate::material::{BrdfSample, Notes, Scattered, Tabulated};
use crate::params::{Param, Params, Values};
use crate::{Error, Result};

/// Number of pairs of directions of each sample.
pub(super) const PAIRS: usize = 205;
const CHANNELS: [&str; 3] = ["rbrdf.dat", "gbrdf.dat", "bbrdf.dat"];

pub(super) struct Curet;

crate::params! {
    struct Options {
        /// Material of a file that holds several, by its number in the file; the first by default.
        index: Option<usize> [1..=1_000_000],
    }
}

impl Importer for Curet {
    fn name(&self) -> &'static str {
        "curet"
    }

    fn doc(&self) -> &'static str {
        "`abrdf.dat` (or `rbrdf.dat`, `gbrdf.dat`, `bbrdf.dat`) of the CUReT database with `table.txt` beside it."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 1 << 14)?;
        let text = String::from_utf8_lossy(&bytes);
        let mut words = text.lines().next().unwrap_or("").split_whitespace();
        let numbered = words.next().is_some_and(|word| word.parse::<u32>().is_ok());
        Ok(numbered && words.clone().count() == PAIRS && words.all(|word| word.parse::<f32>().is_ok()))
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn open(&self, path: &Path, options: &Values) -> Result<Measured> {
        let options = Options::from_values(options)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let pairs = read_table(&folder.join("table.txt"))?;
        let mut notes = Notes::default();
        let named = path.file_name().and_then(|name| name.to_str()).unwrap_or("");
        let coloured = CHANNELS.contains(&named) && CHANNELS.iter().all(|name| folder.join(name).is_file());
        let files = if coloured { CHANNELS.map(|name| folder.join(name)) } else { [0; 3].map(|_| path.to_path_buf()) };
        let mut values = vec![0.0; 3 * PAIRS];
        let mut materials = 0;
        for (channel, file) in files.iter().enumerate() {
            let row = read_material(file, options.index, &mut materials)?;
            row.iter().enumerate().for_each(|(pair, &value)| values[3 * pair + channel] = value);
        }
        notes.fact("channels", if coloured { "rgb" } else { "one (grey)" });
        notes.fact("materials", materials);
        if options.index.is_none() && materials > 1 {
            notes
                .warnings
                .push(format!("the file holds {materials} materials and this is the first; --index chooses another"));
        }
        notes.clamp_negative(&mut values);
        let sample = |(&(wi, wo), v): (&(Vec3, Vec3), &[f32])| BrdfSample { wi, wo, value: Vec3::from_slice(v) };
        let samples = pairs.iter().zip(values.chunks_exact(3)).map(sample).collect();
        let table = Scattered::new(samples).map_err(located(path))?;
        scattered_facts(&mut notes, &table);
        Ok(Measured::Brdf(Arc::new(Tabulated::new(table, notes))))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>> {
        let beside = CHANNELS.iter().chain(&["table.txt"]).map(|name| path.with_file_name(name));
        let beside = beside.filter(|file| file != path && file.is_file());
        Ok([path.to_path_buf()].into_iter().chain(beside).collect())
    }
}

/// The 205 pairs of directions, light first.
pub(super) fn read_table(path: &Path) -> Result<Vec<(Vec3, Vec3)>> {
    let text = text(path, MAX_TEXT)?;
    let mut pairs = Vec::with_capacity(PAIRS);
    for (content, line) in text.lines().zip(1..).filter(|(content, _)| !content.trim().is_empty()) {
        let row: Vec<f32> = content.split_whitespace().map(|word| number(path, line, word)).collect::<Result<_>>()?;
        let [index, theta_v, phi_v, theta_i, phi_i] = row[..] else {
            return Err(Error::invalid(
                path,
                format!("line {line}"),
                format!("found {} numbers, expected 5", row.len()),
            ));
        };
        if index != (pairs.len() + 1) as f32 {
            return Err(Error::invalid(path, format!("line {line}"), format!("number {index} is out of sequence")));
        }
        pairs.push(directions(path, line, [theta_i, phi_i, theta_v, phi_v])?);
    }
    if pairs.len() == PAIRS {
        return Ok(pairs);
    }
    Err(Error::invalid(path, "lines", format!("found {}, expected {PAIRS}", pairs.len())))
}

/// The values of the material numbered `index`, the first by default; sets `materials` to the number of materials.
fn read_material(path: &Path, index: Option<usize>, materials: &mut usize) -> Result<Vec<f32>> {
    let text = text(path, MAX_TEXT)?;
    let lines: Vec<(&str, usize)> = text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty()).collect();
    *materials = lines.len();
    let numbered = |line: &str| line.split_whitespace().next().and_then(|word| word.parse().ok());
    let found = match index {
        Some(index) => lines.iter().find(|(line, _)| numbered(line) == Some(index)),
        None => lines.first(),
    };
    let Some(&(content, line)) = found else {
        let problem = format!("no material {} among the {}", index.unwrap_or(1), lines.len());
        return Err(Error::parameter("index", problem));
    };
    let row: Vec<f32> =
        content.split_whitespace().skip(1).map(|word| number(path, line, word)).collect::<Result<_>>()?;
    if row.len() == PAIRS {
        return Ok(row);
    }
    Err(Error::invalid(path, format!("line {line}"), format!("found {} values, expected {PAIRS}", row.len())))
}
