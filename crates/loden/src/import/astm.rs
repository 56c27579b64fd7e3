//! `astm`: text tables with named columns, in the manner of ASTM E1392.
//!
//! # Format
//! Lines `KEY value`, of which the last is `VARS theta_i,phi_i,theta_s,phi_s,400nm,...`. Then rows of numbers separated
//! by commas: angles in radians, values of the BRDF in 1/sr. Columns `R,G,B` may replace the wavelengths, as may one column
//! of any name, which is taken as grey. `phi_i` may be left out and is 0 then.
//!
//! # Limits
//! Data are taken as isotropic and reciprocal, and interpolated between the nearest samples; negative values become 0.
//!
//! # References
//! astm1990

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::rows::{MAX_TEXT, directions, number, scattered_facts, spectral};
use super::{Importer, Measured, head, located};
use crate::input::text;
use crate::material::{BrdfSample, Notes, Scattered, Tabulated};
use crate::params::Values;
use crate::{Error, Result};

pub(super) struct Astm;

impl Importer for Astm {
    fn name(&self) -> &'static str {
        "astm"
    }

    fn doc(&self) -> &'static str {
        "Text tables with a `VARS` line (ASTM E1392 style): scattered directions, spectra or RGB."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 1 << 16)?;
        let text = String::from_utf8_lossy(&bytes);
        Ok(text.lines().any(|line| line.starts_with("VARS ")) && !bytes.contains(&0))
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let text = text(path, MAX_TEXT)?;
        let mut notes = Notes::default();
        let header = Header::read(path, &text, &mut notes)?;
        let (mut pairs, mut values) = (Vec::new(), Vec::new());
        for (line, content) in text.lines().zip(1..).map(|(content, line)| (line, content)).skip(header.lines) {
            if content.trim().is_empty() {
                continue;
            }
            let row: Vec<f32> =
                content.split(',').map(|word| number(path, line, word.trim())).collect::<Result<_>>()?;
            if row.len() != header.columns {
                let problem = format!("{} numbers, VARS names {}", row.len(), header.columns);
                return Err(Error::invalid(path, format!("line {line}"), problem));
            }
            pairs.push(directions(path, line, header.angles.map(|column| column.map_or(0.0, |column| row[column])))?);
            values.extend(header.values.iter().map(|&column| row[column]));
        }
        if header.points.is_some_and(|points| points != pairs.len()) {
            let problem = format!("{} rows, NUM_POINTS says {}", pairs.len(), header.points.unwrap_or(0));
            return Err(Error::invalid(path, "NUM_POINTS", problem));
        }
        if !header.wavelengths.is_empty() {
            return spectral(path, header.wavelengths, &pairs, values, notes);
        }
        notes.fact("channels", "rgb");
        notes.clamp_negative(&mut values);
        let sample = |(&(wi, wo), v): (&(Vec3, Vec3), &[f32])| BrdfSample { wi, wo, value: Vec3::from_slice(v) };
        let samples = pairs.iter().zip(values.chunks_exact(3)).map(sample).collect();
        let table = Scattered::new(samples).map_err(located(path))?;
        scattered_facts(&mut notes, &table);
        Ok(Measured::Brdf(Arc::new(Tabulated::new(table, notes))))
    }
}

struct Header {
    /// Number of lines.
    lines: usize,
    columns: usize,
    /// Columns of theta_i, phi_i, theta_s, phi_s; an angle without column is 0.
    angles: [Option<usize>; 4],
    /// Columns of the values: one per wavelength, or R, G, B, or the same column three times.
    values: Vec<usize>,
    wavelengths: Vec<f32>,
    points: Option<usize>,
}

impl Header {
    fn read(path: &Path, text: &str, notes: &mut Notes) -> Result<Self> {
        let mut points = None;
        for (line, lines) in text.lines().zip(1..) {
            let (key, value) = line.split_once(' ').unwrap_or((line, ""));
            match key {
                "NUM_POINTS" => points = value.trim().parse().ok(),
                "SAMPLE_NAME" => notes.fact("description", value.trim()),
                "VARS" => return Self::vars(path, value, lines, points, notes),
                _ => {}
            }
        }
        Err(Error::invalid(path, "VARS", "the file has no such line"))
    }

    fn vars(path: &Path, value: &str, lines: usize, points: Option<usize>, notes: &mut Notes) -> Result<Self> {
        let names: Vec<&str> = value.split(',').map(str::trim).collect();
        let place = |alternatives: &[&str]| {
            names.iter().position(|name| alternatives.iter().any(|a| name.eq_ignore_ascii_case(a)))
        };
        let find = |alternatives: &[&str]| {
            let missing = || Error::invalid(path, "VARS", format!("no column {}", alternatives[0]));
            place(alternatives).ok_or_else(missing)
        };
        let phi_i = place(&["phi_i"]);
        if phi_i.is_none() {
            notes.warnings.push("there is no column phi_i; it is taken as 0".into());
        }
        let angles = [
            Some(find(&["theta_i"])?),
            phi_i,
            Some(find(&["theta_s", "theta_r", "theta_o"])?),
            Some(find(&["phi_s", "phi_r", "phi_o"])?),
        ];
        let nanometres = |name: &&str| name.strip_suffix("nm")?.trim().parse::<f32>().ok();
        let mut bands: Vec<(f32, usize)> =
            names.iter().enumerate().filter_map(|(i, name)| Some((nanometres(name)?, i))).collect();
        bands.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (wavelengths, mut values): (Vec<f32>, Vec<usize>) = bands.into_iter().unzip();
        let others: Vec<usize> = (0..names.len()).filter(|&column| !angles.contains(&Some(column))).collect();
        match others[..] {
            _ if !values.is_empty() => {}
            [column] => {
                notes.warnings.push(format!("the only column {} is taken as grey", names[column]));
                values = vec![column; 3];
            }
            _ => values = vec![find(&["r", "red"])?, find(&["g", "green"])?, find(&["b", "blue"])?],
        }
        Ok(Self { lines, columns: names.len(), angles, values, wavelengths, points })
    }
}
