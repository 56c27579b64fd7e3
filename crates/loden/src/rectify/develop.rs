//! From raw numbers to linear light: dark and white frames, merging of exposures.

use std::path::{Path, PathBuf};

use glam::Vec3;
use rayon::prelude::*;

use super::manifest::Manifest;
use super::resample::Photograph;
use crate::color::Encoding;
use crate::picture::decode::{self, Numbers, Reading};
use crate::{Error, Result};

/// Fraction of full scale from which a number counts as saturated.
const SATURATED: f32 = 0.98;

/// The calibration that all photographs share.
pub(super) struct Developer {
    bits: Option<u32>,
    encoding: Encoding,
    dark: Option<RawImage>,
    /// Signal per unit of exposure and apparent value.
    gain: Option<RawImage>,
}

/// The content of an image file as fractions of full scale, linear, three per pixel.
struct RawImage {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Developer {
    /// Reads the dark and the white frame.
    pub(super) fn new(manifest: &Manifest, path: &Path) -> Result<Self> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut developer = Self { bits: manifest.bits, encoding: manifest.encoding, dark: None, gain: None };
        let image = |file: &Option<PathBuf>, developer: &Self| {
            file.as_ref().map(|file| developer.read(&folder.join(file)).map(|(image, _)| image)).transpose()
        };
        // Read the dark frame
        developer.dark = image(&manifest.dark, &developer)?;
        let Some(mut white) = image(&manifest.white, &developer)? else { return Ok(developer) };
        if let Some(dark) = &developer.dark {
            same_size(&white, dark, "white", path)?;
            white.values.iter_mut().zip(&dark.values).for_each(|(white, dark)| *white -= dark);
        }
        // Compute the gain of every value
        let scale = (manifest.white_exposure * manifest.white_value) as f32;
        white.values.iter_mut().for_each(|white| *white /= scale);
        if let Some(i) = white.values.iter().position(|gain| *gain <= 1e-5) {
            let problem =
                format!("pixel ({}, {}) is not brighter than the dark frame", i / 3 % white.width, i / 3 / white.width);
            return Err(Error::invalid(path, "white", problem));
        }
        developer.gain = Some(white);
        Ok(developer)
    }

    /// Reads an image, and for each number whether it is saturated.
    fn read(&self, file: &Path) -> Result<(RawImage, Vec<bool>)> {
        let bytes = std::fs::read(file).map_err(Error::io(file))?;
        let decoded = decode::decode(&bytes, Reading { strict: true, bonn: false })
            .map_err(|e| Error::invalid(file, "image", e.to_string()))?;
        let full = |most: f32| self.bits.map_or(most, |bits| ((1u32 << bits) - 1) as f32);
        let stored: Vec<f32> = match decoded.numbers {
            Numbers::U8(numbers) => numbers.par_iter().map(|&v| f32::from(v) / 255.0).collect(),
            Numbers::U16(numbers) => {
                let scale = 1.0 / full(65_535.0);
                numbers.iter().map(|&v| f32::from(v) * scale).collect()
            }
            Numbers::F32(numbers) => numbers,
        };
        if let Some(i) = stored.iter().position(|v| !v.is_finite()) {
            return Err(Error::invalid(file, "image", format!("value {i} is not finite")));
        }
        let saturated = stored.iter().map(|v| *v >= SATURATED).collect();
        let values = match self.encoding {
            Encoding::Linear => stored,
            encoding => stored.into_iter().map(|v| encoding.decode(v)).collect(),
        };
        Ok((RawImage { width: decoded.width, height: decoded.height, values }, saturated))
    }

    /// Merges the exposures of a photograph, shortest first. Returns the number of pixels that are saturated in all of
    /// them.
    ///
    /// # Model
    /// (sum of signals) / (sum of exposures x gain) over the exposures in which the number is not saturated. The signal
    /// is the number minus the dark frame. Photons count equally in all exposures, which minimizes the noise where
    /// photon noise dominates.
    ///
    /// # References
    /// debevec1997 (the idea), hanji2020 (the estimator for photon noise)
    pub(super) fn develop(&self, shot: &[(PathBuf, f64)]) -> Result<(Photograph, usize)> {
        let mut size = None;
        let (mut signal, mut exposed) = (Vec::new(), Vec::new());
        for (file, exposure) in shot {
            let (image, saturated) = self.read(file)?;
            for (name, other) in [("dark", &self.dark), ("white", &self.gain)] {
                other.as_ref().map_or(Ok(()), |other| same_size(&image, other, name, file))?;
            }
            if *size.get_or_insert((image.width, image.height)) != (image.width, image.height) {
                return Err(Error::invalid(
                    file,
                    "size",
                    format!("found {} x {} pixels, other exposures differ", image.width, image.height),
                ));
            }
            signal.resize(image.values.len(), 0.0f32);
            exposed.resize(image.values.len(), 0.0f32);
            let first = *exposure == shot[0].1;
            for (i, value) in image.values.iter().enumerate() {
                if first || (!saturated[i] && exposed[i] > 0.0) {
                    let dark = self.dark.as_ref().map_or(0.0, |dark| dark.values[i]);
                    let gain = self.gain.as_ref().map_or(1.0, |gain| gain.values[i]);
                    signal[i] += value - dark;
                    // Keep a saturated first exposure, but mark it by a negative sign.
                    exposed[i] += *exposure as f32 * gain * if saturated[i] { -1.0 } else { 1.0 };
                }
            }
        }
        let (width, height) = size.unwrap_or_default();
        let lost = exposed.chunks_exact(3).filter(|pixel| pixel.iter().any(|e| *e < 0.0)).count();
        let values: Vec<f32> = signal.iter().zip(&exposed).map(|(signal, exposed)| signal / exposed.abs()).collect();
        Ok((Photograph { width, height, rgb: values.chunks_exact(3).map(Vec3::from_slice).collect() }, lost))
    }
}

fn same_size(image: &RawImage, other: &RawImage, name: &str, file: &Path) -> Result<()> {
    if (image.width, image.height) == (other.width, other.height) {
        return Ok(());
    }
    let problem = format!(
        "found {} x {} pixels, but the {name} frame has {} x {}",
        image.width, image.height, other.width, other.height
    );
    Err(Error::invalid(file, "size", problem))
}
