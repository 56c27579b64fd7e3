//! How far two pictures are apart as they are displayed.

use serde::Serialize;

use super::flip::flip;
use super::ssim::{Buffers, of_images};
use crate::color::Encoding;
use crate::picture::Picture;
use crate::{Error, Result};

/// Differences of two pictures in sRGB-encoded values, clamped to 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PictureReport {
    /// Mean of the absolute differences over pixels and channels.
    pub mean_abs_error: f64,
    /// Peak signal-to-noise ratio for peak 1, dB; infinite (null in JSON) for equal pictures.
    pub psnr_db: f64,
    /// Structural similarity of their luma, see [`super::ssim()`].
    pub ssim: f64,
    /// How different they look to who flips between them, see [`super::flip()`].
    pub flip: f64,
}

/// Compares two pictures of the same size.
///
/// # Errors
/// [`Error::Parameter`] if the sizes differ or there are no pixels.
pub fn pictures(reference: &Picture, test: &Picture) -> Result<PictureReport> {
    check(reference, test)?;
    let (width, height) = (reference.width, reference.height);
    let (a, b) = (displayed(reference), displayed(test));
    let differences = || a.iter().zip(&b).map(|(a, b)| f64::from(a - b));
    let count = a.len() as f64;
    Ok(PictureReport {
        mean_abs_error: differences().map(f64::abs).sum::<f64>() / count,
        psnr_db: -10.0 * (differences().map(|d| d * d).sum::<f64>() / count).log10(),
        ssim: of_images(&a, &b, width, height, &mut Buffers::default()),
        flip: flip(&reference.rgb, &test.rgb, width),
    })
}

fn check(reference: &Picture, test: &Picture) -> Result<()> {
    let (width, height) = (reference.width, reference.height);
    if (test.width, test.height) == (width, height) && width * height > 0 {
        return Ok(());
    }
    let problem = format!("found {width} x {height} and {} x {} pixels", test.width, test.height);
    Err(Error::parameter("pictures", problem))
}

/// The absolute differences of displayed values, times `gain`, as a picture to be displayed.
///
/// # Errors
/// As [`pictures`].
pub fn difference(reference: &Picture, test: &Picture, gain: f32) -> Result<Picture> {
    check(reference, test)?;
    let values: Vec<f32> = displayed(reference)
        .iter()
        .zip(displayed(test))
        .map(|(a, b)| Encoding::Srgb.decode(((a - b).abs() * gain).min(1.0)))
        .collect();
    let rgb = values.chunks_exact(3).map(glam::Vec3::from_slice).collect();
    Ok(Picture { rgb, ..*reference })
}

fn displayed(picture: &Picture) -> Vec<f32> {
    let value = |v: f32| Encoding::Srgb.encode(v.clamp(0.0, 1.0));
    picture.rgb.iter().flat_map(|c| c.to_array().map(value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn known_differences() {
        let grey = |v: f32| Picture::filled(16, 12, Vec3::splat(Encoding::Srgb.decode(v)));
        let report = pictures(&grey(0.5), &grey(0.6)).unwrap();
        assert!((report.mean_abs_error - 0.1).abs() < 1e-4 && (report.psnr_db - 20.0).abs() < 0.01, "{report:?}");
        // flat pictures differ in luminance alone: (2 a b + C1) / (a^2 + b^2 + C1); their variances in single precision are
        // zero but for some 1e-7, beside C2 = 9e-4
        assert!((report.ssim - (0.6 + 1e-4) / (0.61 + 1e-4)).abs() < 3e-4, "{report:?}");
        let seen = difference(&grey(0.5), &grey(0.6), 4.0).unwrap().at(3, 3).x;
        assert!((Encoding::Srgb.encode(seen) - 0.4).abs() < 1e-4, "{seen}");
        let same = pictures(&grey(0.5), &grey(0.5)).unwrap();
        assert!(same.psnr_db.is_infinite() && same.flip == 0.0 && (same.ssim - 1.0).abs() < 1e-6);
        assert!(pictures(&grey(0.5), &Picture::filled(12, 16, Vec3::ZERO)).is_err());
    }
}
