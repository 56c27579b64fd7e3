//! Tables of numbers in CSV files: directions and samples of BRDFs.

use std::fmt::Write;
use std::path::Path;

use glam::Vec3;

use crate::direction::{self, from_angles};
use crate::material::BrdfSample;
use crate::output::write_file;
use crate::{Error, Result};

/// Reads samples of a BRDF, one a line: theta_i, phi_i, theta_o, phi_o in degrees, r, g, b in 1/sr. A heading is
/// allowed.
///
/// # Errors
/// [`Error::Invalid`] naming the line that is not seven numbers; [`Error::Io`].
pub fn read_samples(path: &Path) -> Result<Vec<BrdfSample>> {
    let sample = |row: Vec<f64>| {
        let direction = |t: f64, p: f64| from_angles(t.to_radians() as f32, p.to_radians() as f32);
        let value = Vec3::new(row[4] as f32, row[5] as f32, row[6] as f32);
        BrdfSample { wi: direction(row[0], row[1]), wo: direction(row[2], row[3]), value }
    };
    Ok(read_rows(path, 7)?.into_iter().map(sample).collect())
}

/// Writes what [`read_samples`] reads.
///
/// # Errors
/// [`Error::Io`].
pub fn write_samples(path: &Path, samples: &[BrdfSample]) -> Result<()> {
    let mut text = String::from("theta_i,phi_i,theta_o,phi_o,r,g,b\n");
    for s in samples {
        let [i, o] = [s.wi, s.wo].map(|w| [direction::theta(w).to_degrees(), direction::phi(w).to_degrees()]);
        // writing to a string cannot fail
        let _ = writeln!(text, "{},{},{},{},{},{},{}", i[0], i[1], o[0], o[1], s.value.x, s.value.y, s.value.z);
    }
    write_file(path, |out| out.write_all(text.as_bytes()))
}

/// Rows of `columns` finite numbers; a heading is skipped.
pub(super) fn read_rows(path: &Path, columns: usize) -> Result<Vec<Vec<f64>>> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let mut rows = Vec::new();
    for (line, row) in text.lines().enumerate().filter(|(_, row)| !row.trim().is_empty()) {
        let numbers: Option<Vec<f64>> = row.split(',').map(|cell| cell.trim().parse().ok()).collect();
        match numbers {
            Some(numbers) if numbers.len() == columns && numbers.iter().all(|v| v.is_finite()) => rows.push(numbers),
            None if line == 0 => {}
            _ => {
                let problem = format!("found {row:?}, expected {columns} numbers with commas");
                return Err(Error::invalid(path, format!("line {}", line + 1), problem));
            }
        }
    }
    Ok(rows)
}
