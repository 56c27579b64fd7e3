//! `kaist`: the unpolarised part of the polarimetric `.pbsdf` files of KAIST.
//!
//! # Format
//! A tensor file with `wvls` (wavelengths in nm) and `M`, Mueller matrices over `[phi_d][theta_d][theta_h][wavelength][4][4]`;
//! the element 0, 0 is the BRDF in 1/sr for unpolarised light, without a cosine. Axes `phi_d`, `theta_d`, `theta_h` are in
//! radians; reduced files leave them empty, which stands for equal spacing of 0 to 360 and 0 to 90 degrees.
//!
//! # Limits
//! Polarisation is ignored. NaN marks missing measurements. Spectra are kept, and become linear RGB as for other spectral
//! files.
//!
//! # References
//! baek2020

use std::f32::consts::{FRAC_PI_2, TAU};
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::rgl::spectral_fact;
use super::tensor::{MAGIC, TensorFile};
use super::{Importer, Measured, head, located};
use crate::color::spectrum::RgbWeights;
use crate::material::{HalfTable, Notes, Period, Tabulated};
use crate::params::Values;
use crate::{Error, Result};

pub(super) struct Kaist;

impl Importer for Kaist {
    fn name(&self) -> &'static str {
        "kaist"
    }

    fn doc(&self) -> &'static str {
        "`.pbsdf` files of KAIST (Mueller matrices); the unpolarised BRDF is taken."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 4096)?;
        Ok(bytes.starts_with(MAGIC) && bytes.windows(4).any(|w| w == b"wvls"))
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let file = TensorFile::open(path)?;
        let [np, nd, nh, bands, rows, columns] = file.sizes::<6>("M")?;
        let wavelengths = file.numbers("wvls")?;
        if [rows, columns, bands] != [4, 4, wavelengths.len()] || np * nd * nh * bands == 0 {
            let problem = format!("shape {:?} for {} wavelengths", file.shape("M")?, wavelengths.len());
            return Err(Error::invalid(path, "M", problem));
        }
        let weights = RgbWeights::new(&wavelengths).map_err(located(path))?;
        let mut notes = Notes::default();
        spectral_fact(&mut notes, &wavelengths);
        notes.fact("kind_of_surface", "isotropic");
        notes.fact("units", "1/sr, without a cosine; element 0, 0 of the Mueller matrices");
        let (mut phi_d, theta_d, theta_h) = (
            axis(path, &file, "phi_d", np, TAU, &mut notes)?,
            axis(path, &file, "theta_d", nd, FRAC_PI_2, &mut notes)?,
            axis(path, &file, "theta_h", nh, FRAC_PI_2, &mut notes)?,
        );
        let matrices = file.numbers("M")?;
        let at = |h: usize, d: usize, p: usize, band: usize| matrices[(((p * nd + d) * nh + h) * bands + band) * 16];
        // the last azimuth repeats the first
        if np > 1 && phi_d[np - 1] - phi_d[0] > TAU - 1e-3 {
            phi_d.pop();
        }
        let (mut values, mut negative, mut missing) = (Vec::with_capacity(np * nd * nh), (0, 0.0f32), 0);
        let mut spectra = Vec::with_capacity(np * nd * nh * bands);
        for h in 0..nh {
            for d in 0..nd {
                for p in 0..phi_d.len() {
                    let spectrum = (0..bands).map(|band| at(h, d, p, band));
                    negative.0 += spectrum.clone().filter(|v| *v < 0.0).count();
                    negative.1 = spectrum.clone().fold(negative.1, f32::min);
                    let measured = spectrum.clone().all(f32::is_finite);
                    missing += usize::from(!measured);
                    spectra.extend(spectrum.clone().map(|v| v.max(0.0)));
                    let rgb = Vec3::from(weights.rgb(spectrum.map(|v| v.max(0.0)))).max(Vec3::ZERO);
                    values.push(if measured { rgb } else { Vec3::NAN });
                }
            }
        }
        notes.fact("missing", missing);
        notes.negative(negative.0, values.len() * bands, negative.1);
        let table = HalfTable::new([theta_h, theta_d, phi_d], Period::Full, values);
        let table = table.and_then(|table| table.with_spectra(wavelengths, spectra)).map_err(located(path))?;
        Ok(Measured::Brdf(Arc::new(Tabulated::new(table, notes))))
    }
}

fn axis(path: &Path, file: &TensorFile, name: &str, count: usize, end: f32, notes: &mut Notes) -> Result<Vec<f32>> {
    let stored = if file.has(name) { file.numbers(name)? } else { Vec::new() };
    if stored.is_empty() {
        notes
            .warnings
            .push(format!("{name} is empty; {count} equal steps from 0 to {} degrees are assumed", end.to_degrees()));
        return Ok((0..count).map(|i| i as f32 / (count - 1).max(1) as f32 * end).collect());
    }
    if stored.len() == count {
        return Ok(stored);
    }
    Err(Error::invalid(path, name, format!("found {} angles, expected {count} as in M", stored.len())))
}
