//! Scattered measurements as rows of text.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::rgl::spectral_fact;
use super::{Measured, located};
use crate::color::spectrum::RgbWeights;
use crate::direction::from_angles;
use crate::material::{Asymmetry, BrdfSample, Notes, Scattered, Tabulated};
use crate::{Error, Result};

/// Maximum size of text files in bytes.
pub(super) const MAX_TEXT: u64 = 1 << 28;

/// Parses a number in a text file.
pub(super) fn number(path: &Path, line: usize, word: &str) -> Result<f32> {
    let value: Option<f32> = word.parse().ok().filter(|v: &f32| v.is_finite());
    value.ok_or_else(|| Error::invalid(path, format!("line {line}"), format!("found {word:?}, expected a number")))
}

/// Parses the directions of a row: theta_i, phi_i, theta_r, phi_r in radians.
pub(super) fn directions(path: &Path, line: usize, angles: [f32; 4]) -> Result<(Vec3, Vec3)> {
    // rounding may put grazing directions just below the horizon
    let quarter = std::f32::consts::FRAC_PI_2 + 1e-3;
    let [ti, pi, to, po] = angles;
    if !(-quarter..=quarter).contains(&ti) || !(-quarter..=quarter).contains(&to) {
        let problem = format!("found polar angles {ti} and {to}, expected 0 to pi/2 radians");
        return Err(Error::invalid(path, format!("line {line}"), problem));
    }
    Ok((from_angles(ti, pi), from_angles(to, po)))
}

/// Scattered samples, each with a spectrum: `[row][wavelength]`.
pub(super) fn spectral(
    path: &Path,
    wavelengths: Vec<f32>,
    pairs: &[(Vec3, Vec3)],
    mut spectra: Vec<f32>,
    mut notes: Notes,
) -> Result<Measured> {
    let weights = RgbWeights::new(&wavelengths).map_err(located(path))?;
    spectral_fact(&mut notes, &wavelengths);
    notes.clamp_negative(&mut spectra);
    let sample = |(&(wi, wo), spectrum): (&(Vec3, Vec3), &[f32])| {
        // colours outside the gamut have negative components
        let value = Vec3::from(weights.rgb(spectrum.iter().copied())).max(Vec3::ZERO);
        BrdfSample { wi, wo, value }
    };
    let samples = pairs.iter().zip(spectra.chunks_exact(wavelengths.len())).map(sample).collect();
    let table = Scattered::spectral(samples, wavelengths, spectra).map_err(located(path))?;
    scattered_facts(&mut notes, &table);
    Ok(Measured::Brdf(Arc::new(Tabulated::new(table, notes))))
}

/// What is assumed of scattered samples, and what they say of it.
pub(super) fn scattered_facts(notes: &mut Notes, table: &Scattered) {
    let Asymmetry { samples, deviation } = table.asymmetry();
    let percent = 100.0 * deviation;
    let surface = match (samples, table.is_symmetric()) {
        (0, _) => "assumed isotropic and reciprocal; no samples tell".to_owned(),
        (_, true) => {
            format!("isotropic and reciprocal: {samples} samples that should be equal differ by {percent:.0} % (rms)")
        }
        (_, false) => {
            format!(
                "anisotropic or not reciprocal: {samples} samples that would be equal differ by {percent:.0} % (rms)"
            )
        }
    };
    notes.fact("kind_of_surface", surface);
    notes.fact("units", "1/sr, without a cosine");
    notes.fact(
        "interpolation",
        "a smooth surface through the logarithms of all samples over half and difference angles",
    );
}
