//! `rgl`: the `.bsdf` files of the EPFL goniometer.
//!
//! # Format
//! A tensor file (signature `tensor_file`, then named arrays) with `phi_i`, `theta_i`, `ndf`, `sigma`, `vndf`,
//! `luminance` and either `rgb`, or `spectra` with `wavelengths`. Isotropic materials have one or two `phi_i`.
//!
//! # Limits
//! The values contain the cosine of the outgoing direction, which is divided out. Spectra are converted to linear RGB
//! for the CIE 1931 2 degree observer under D65, and remain available. `jacobian` and `valid` describe how the tables
//! were made and are ignored.
//!
//! # References
//! dupuy2018

use std::path::Path;
use std::sync::Arc;

use super::tensor::{MAGIC, TensorFile};
use super::{Importer, Measured, head, located};
use crate::color::spectrum::RgbWeights;
use crate::material::{Notes, RglBrdf, RglData};
use crate::params::Values;
use crate::{Error, Result};

pub(super) struct Rgl;

impl Importer for Rgl {
    fn name(&self) -> &'static str {
        "rgl"
    }

    fn doc(&self) -> &'static str {
        "`.bsdf` files of the EPFL goniometer, isotropic or anisotropic, RGB or spectral."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 4096)?;
        Ok(bytes.starts_with(MAGIC) && !bytes.windows(4).any(|w| w == b"wvls"))
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let file = TensorFile::open(path)?;
        let mut notes = Notes::default();
        let description = file.text("description");
        if !description.is_empty() {
            notes.fact("description", description);
        }
        let data = read(path, &file, &mut notes)?;
        Ok(Measured::Brdf(Arc::new(RglBrdf::new(data, notes).map_err(located(path))?)))
    }
}

fn read(path: &Path, file: &TensorFile, notes: &mut Notes) -> Result<RglData> {
    let (phi_i, theta_i) = (file.numbers("phi_i")?, file.numbers("theta_i")?);
    notes.fact("kind_of_surface", if phi_i.len() <= 2 { "isotropic" } else { "anisotropic" });
    notes.fact("incident_directions", format!("{} azimuths x {} polar angles", phi_i.len(), theta_i.len()));
    notes.fact("units", "1/sr; the file's values contain the outgoing cosine, which is divided out");
    // Read the tables of microfacets and directions
    let flat = |name: &str| Ok::<_, Error>((file.sizes::<2>(name)?, file.numbers(name)?));
    let four = |name: &str| {
        let [phis, thetas, rows, columns] = file.sizes::<4>(name)?;
        if [phis, thetas] != [phi_i.len(), theta_i.len()] {
            let problem =
                format!("found {phis} x {thetas} tables, but {} phi_i and {} theta_i", phi_i.len(), theta_i.len());
            return Err(Error::invalid(path, name, problem));
        }
        Ok(([rows, columns], file.numbers(name)?))
    };
    let (vndf, luminance) = (four("vndf")?, four("luminance")?);
    let mut data = RglData { ndf: flat("ndf")?, sigma: flat("sigma")?, vndf, luminance, ..RglData::default() };
    // Check the shape of the reflectance
    let values = if file.has("rgb") { "rgb" } else { "spectra" };
    let [.., bands, rows, columns] = file.sizes::<5>(values)?;
    let expected = [phi_i.len(), theta_i.len(), bands, data.luminance.0[0], data.luminance.0[1]];
    if file.shape(values)? != expected || bands == 0 || rows < 2 || columns < 2 {
        return Err(Error::invalid(
            path,
            values,
            format!("found shape {:?}, expected {expected:?}", file.shape(values)?),
        ));
    }
    (data.phi_i, data.theta_i) = (phi_i, theta_i);
    let mut numbers = file.numbers(values)?;
    let lowest = numbers.iter().copied().fold(0.0, f32::min);
    notes.negative(numbers.iter().filter(|v| **v < 0.0).count(), numbers.len(), lowest);
    // Convert the reflectance to RGB
    if values == "rgb" {
        if bands != 3 {
            return Err(Error::invalid(path, "rgb", format!("found {bands} channels, expected 3")));
        }
        notes.fact("channels", "rgb");
        data.rgb = numbers;
    } else {
        data.wavelengths = file.numbers("wavelengths")?;
        if data.wavelengths.len() != bands {
            let problem = format!("found {}, expected {bands} as in spectra", data.wavelengths.len());
            return Err(Error::invalid(path, "wavelengths", problem));
        }
        let weights = RgbWeights::new(&data.wavelengths).map_err(located(path))?;
        spectral_fact(notes, &data.wavelengths);
        numbers.iter_mut().for_each(|v| *v = v.max(0.0));
        data.rgb = to_rgb(&numbers, bands, rows * columns, &weights);
        data.spectra = numbers;
    }
    Ok(data)
}

pub(super) fn spectral_fact(notes: &mut Notes, wavelengths: &[f32]) {
    let (first, last) = (wavelengths[0], wavelengths[wavelengths.len() - 1]);
    notes.fact("channels", format!("{} wavelengths, {first} to {last} nm", wavelengths.len()));
    notes.fact("rgb", "linear sRGB primaries, CIE 1931 2 degree observer, illuminant D65");
}

/// `[node][band][texel]` to `[node][3][texel]`.
fn to_rgb(spectra: &[f32], bands: usize, texels: usize, weights: &RgbWeights) -> Vec<f32> {
    let mut rgb = Vec::with_capacity(spectra.len() / bands * 3);
    for node in spectra.chunks_exact(bands * texels) {
        let texel = |i: usize| weights.rgb((0..bands).map(|band| node[band * texels + i]));
        let colours: Vec<[f32; 3]> = (0..texels).map(texel).collect();
        (0..3).for_each(|channel| rgb.extend(colours.iter().map(|c| c[channel])));
    }
    rgb
}
