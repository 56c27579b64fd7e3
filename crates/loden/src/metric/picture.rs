//! Differences of two images as displayed.

use serde::Serialize;

use super::flip::flip;
use super::ssim::{Buffers, luma_ssim};
use crate::color::Encoding;
use crate::picture::Picture;
use crate::{Error, Result};

/// Differences of two images in sRGB-encoded values, clamped to 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PictureReport {
    /// Mean absolute difference over pixels and channels.
    pub mean_abs_error: f64,
    /// Peak signal-to-noise ratio for peak 1, dB; infinite (null in JSON) for identical images.
    pub psnr_db: f64,
    /// Structural similarity of the luma; see [`super::ssim()`].
    pub ssim: f64,
    /// Perceived difference when flipping between the images; see [`super::flip()`].
    pub flip: f64,
}

/// Compares two images of the same size.
///
/// # Errors
/// [`Error::Parameter`] if the sizes differ or the images are empty.
pub fn pictures(reference: &Picture, test: &Picture) -> Result<PictureReport> {
    check(reference, test)?;
    let (width, height) = (reference.width, reference.height);
    let (a, b) = (displayed(reference), displayed(test));
    let differences = || a.iter().zip(&b).map(|(a, b)| f64::from(a - b));
    let count = a.len() as f64;
    Ok(PictureReport {
        mean_abs_error: differences().map(f64::abs).sum::<f64>() / count,
        psnr_db: -10.0 * (differences().map(|d| d * d).sum::<f64>() / count).log10(),
        ssim: luma_ssim(&a, &b, width, height, &mut Buffers::default()),
        flip: flip(&reference.rgb, &test.rgb, width),
    })
}

fn check(reference: &Picture, test: &Picture) -> Result<()> {
    let (width, height) = (reference.width, reference.height);
    if (test.width, test.height) == (width, height) && width * height > 0 {
        return Ok(());
    }
    let problem = format!("found {width} x {height} and {} x {} pixels, expected equal sizes", test.width, test.height);
    Err(Error::parameter("pictures", problem))
}

/// The absolute differences of displayed values, multiplied by `gain`, as an image.
///
/// # Errors
/// See [`pictures`].
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
        // Flat images differ in luminance only: (2 a b + C1) / (a^2 + b^2 + C1). In single precision their variances are
        // about 1e-7 instead of zero, small compared with C2 = 9e-4.
        assert!((report.ssim - (0.6 + 1e-4) / (0.61 + 1e-4)).abs() < 3e-4, "{report:?}");
        let seen = difference(&grey(0.5), &grey(0.6), 4.0).unwrap().at(3, 3).x;
        assert!((Encoding::Srgb.encode(seen) - 0.4).abs() < 1e-4, "{seen}");
        let same = pictures(&grey(0.5), &grey(0.5)).unwrap();
        assert!(same.psnr_db.is_infinite() && same.flip == 0.0 && (same.ssim - 1.0).abs() < 1e-6);
        assert!(pictures(&grey(0.5), &Picture::filled(12, 16, Vec3::ZERO)).is_err());
    }
}
