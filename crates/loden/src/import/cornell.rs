//! `cornell`: the `.brdf` tables of the Cornell gonioreflectometer.
//!
//! # Format
//! Text; `#` begins a comment. The number n of wavelengths, the wavelengths in nm, then rows of
//! `theta_i phi_i theta_r phi_r` in radians and n values of the BRDF in 1/sr. phi_r = 180 degrees is the mirror side.
//!
//! # Limits
//! Data are assumed isotropic and reciprocal, and interpolated between the nearest samples; negative values become 0.
//!
//! # References
//! foo1997

use std::path::Path;

use super::rows::{MAX_TEXT, directions, number, spectral};
use super::{Importer, Measured, head};
use crate::input::text;
use crate::material::Notes;
use crate::params::Values;
use crate::{Error, Result};

pub(super) struct Cornell;

impl Importer for Cornell {
    fn name(&self) -> &'static str {
        "cornell"
    }

    fn doc(&self) -> &'static str {
        "`.brdf` text tables of the Cornell gonioreflectometer: scattered directions, spectra."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 1 << 16)?;
        if bytes.contains(&0) {
            return Ok(false);
        }
        let text = String::from_utf8_lossy(&bytes);
        let mut numbers = words(&text).map(|(_, word)| word.parse::<f32>().ok());
        let Some(Some(count)) = numbers.next().filter(|n| n.is_some_and(|n| (1.0..=4096.0).contains(&n))) else {
            return Ok(false);
        };
        let wavelengths: Option<Vec<f32>> = numbers.take(count as usize).collect();
        let plausible = |w: &[f32]| w.iter().all(|w| (100.0..=10_000.0).contains(w)) && w.is_sorted_by(|a, b| a < b);
        Ok(count.fract() == 0.0 && wavelengths.is_some_and(|w| w.len() == count as usize && plausible(&w)))
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let text = text(path, MAX_TEXT)?;
        let mut words = words(&text);
        let mut next = |field: &str| {
            let (line, word) = words.next().ok_or_else(|| Error::invalid(path, field, "the file ends before it"))?;
            number(path, line, word).map(|number| (line, number))
        };
        let count = next("number of wavelengths")?.1 as usize;
        let wavelengths: Vec<f32> = (0..count).map(|_| next("wavelengths").map(|n| n.1)).collect::<Result<_>>()?;
        let (mut pairs, mut spectra) = (Vec::new(), Vec::new());
        while let Ok((line, theta_i)) = next("row") {
            let angles = [theta_i, next("phi_i")?.1, next("theta_r")?.1, next("phi_r")?.1];
            pairs.push(directions(path, line, angles)?);
            for _ in 0..count {
                spectra.push(next("value")?.1);
            }
        }
        // the loop also ends at a word that is not a number
        if let Some((line, word)) = self::words(&text).nth(1 + count + pairs.len() * (4 + count)) {
            number(path, line, word)?;
        }
        spectral(path, wavelengths, &pairs, spectra, Notes::default())
    }
}

/// The words outside comments, with their line numbers.
fn words(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().zip(1..).map(|(line, number)| (number, line.split('#').next().unwrap_or("")));
    lines.flat_map(|(number, line)| line.split_whitespace().map(move |word| (number, word)))
}
