//! Spectra to linear RGB: CIE 1931 2 degree observer, illuminant D65.

use crate::{Error, Result};

/// The relative power of CIE standard illuminant D65 from 380 to 780 nm in steps of 10 nm.
const D65: [f64; 41] = [
    49.9755, 54.6482, 82.7549, 91.486, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354,
    107.802, 104.79, 107.689, 104.405, 104.046, 100.0, 96.3342, 95.788, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886,
    83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.349, 61.604, 69.8856, 75.087, 63.5927, 46.4182,
    66.8054, 63.3828,
];

/// XYZ to linear sRGB, IEC 61966-2-1.
const RGB_FROM_XYZ: [[f64; 3]; 3] = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]];

/// How each wavelength of a spectrum of reflectance counts in linear sRGB/Rec. 709.
///
/// # Model
/// The reflectance is linear between the given wavelengths, the outermost values are held down to 380 and up to 780 nm.
/// It is lit by D65 and seen by the CIE 1931 2 degree observer, whose colour matching functions are the sums of
/// Gaussians of the reference (within about one per cent of their maximum). Each channel is then scaled so that a
/// perfectly white reflector is exactly (1, 1, 1).
///
/// # References
/// wyman2013 (equation 4)
#[derive(Debug, Clone, PartialEq)]
pub struct RgbWeights(Vec<[f32; 3]>);

impl RgbWeights {
    /// For `wavelengths` in nm, ascending.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is none, or they do not ascend or are not in 100..=10000 nm.
    pub fn new(wavelengths: &[f32]) -> Result<Self> {
        let possible = wavelengths.iter().all(|w| (100.0..=10_000.0).contains(w));
        if wavelengths.is_empty() || !possible || !wavelengths.is_sorted_by(|a, b| a < b) {
            return Err(Error::parameter("wavelengths", "not ascending numbers of nanometres"));
        }
        let mut weights = vec![[0.0f64; 3]; wavelengths.len()];
        let mut white = [0.0f64; 3];
        for nm in 380..=780 {
            let nm = f64::from(nm);
            let rgb = rgb(nm).map(|v| v * power(nm));
            let above = wavelengths.partition_point(|&w| f64::from(w) <= nm);
            let (low, high) = (above.saturating_sub(1), above.min(wavelengths.len() - 1));
            let span = f64::from(wavelengths[high] - wavelengths[low]);
            let t = if span > 0.0 { ((nm - f64::from(wavelengths[low])) / span).clamp(0.0, 1.0) } else { 0.0 };
            for channel in 0..3 {
                weights[low][channel] += (1.0 - t) * rgb[channel];
                weights[high][channel] += t * rgb[channel];
                white[channel] += rgb[channel];
            }
        }
        let scaled = |w: &[f64; 3]| [0, 1, 2].map(|channel| (w[channel] / white[channel]) as f32);
        Ok(Self(weights.iter().map(scaled).collect()))
    }

    /// Linear RGB of a spectrum given at the wavelengths.
    pub fn rgb(&self, spectrum: impl IntoIterator<Item = f32>) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (value, weight) in spectrum.into_iter().zip(&self.0) {
            (0..3).for_each(|channel| sum[channel] += value * weight[channel]);
        }
        sum
    }
}

fn power(nm: f64) -> f64 {
    let x = (nm - 380.0) / 10.0;
    let i = (x as usize).min(D65.len() - 2);
    D65[i] + (x - i as f64) * (D65[i + 1] - D65[i])
}

/// A Gaussian with different widths below and above its centre.
fn lobe(nm: f64, height: f64, centre: f64, below: f64, above: f64) -> f64 {
    let width = if nm < centre { below } else { above };
    height * (-0.5 * ((nm - centre) / width).powi(2)).exp()
}

fn xyz(nm: f64) -> [f64; 3] {
    [
        lobe(nm, 1.056, 599.8, 37.9, 31.0) + lobe(nm, 0.362, 442.0, 16.0, 26.7) + lobe(nm, -0.065, 501.1, 20.4, 26.2),
        lobe(nm, 0.821, 568.8, 46.9, 40.5) + lobe(nm, 0.286, 530.9, 16.3, 31.1),
        lobe(nm, 1.217, 437.0, 11.8, 36.0) + lobe(nm, 0.681, 459.0, 26.0, 13.8),
    ]
}

fn rgb(nm: f64) -> [f64; 3] {
    let xyz = xyz(nm);
    RGB_FROM_XYZ.map(|row| row.iter().zip(xyz).map(|(m, v)| m * v).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_white_point_is_that_of_d65() {
        let mut sum = [0.0; 3];
        for nm in 380..=780 {
            let nm = f64::from(nm);
            xyz(nm).iter().zip(&mut sum).for_each(|(v, sum)| *sum += v * power(nm));
        }
        let total: f64 = sum.iter().sum();
        // the CIE's chromaticity; the difference is that of the fitted functions
        assert!((sum[0] / total - 0.3127).abs() < 1e-3, "{}", sum[0] / total);
        assert!((sum[1] / total - 0.3290).abs() < 1e-3, "{}", sum[1] / total);
    }

    #[test]
    fn white_is_white_and_hues_are_theirs() {
        let wavelengths: Vec<f32> = (0..31).map(|i| 400.0 + 10.0 * i as f32).collect();
        let weights = RgbWeights::new(&wavelengths).unwrap();
        let white = weights.rgb(vec![0.7; 31]);
        assert!(white.iter().all(|v| (v - 0.7).abs() < 1e-5), "{white:?}");
        let band =
            |low: f32, high: f32| weights.rgb(wavelengths.iter().map(|w| f32::from(u8::from(*w >= low && *w <= high))));
        let [red, green, blue] = [band(600.0, 700.0), band(500.0, 570.0), band(400.0, 480.0)];
        assert!(red[0] > 0.5 && red[0] > 3.0 * red[1].abs(), "{red:?}");
        assert!(green[1] > 0.5 && green[1] > 2.0 * green[0].abs(), "{green:?}");
        assert!(blue[2] > 0.5 && blue[2] > 3.0 * blue[1].abs(), "{blue:?}");
    }

    #[test]
    fn bad_wavelengths_are_refused() {
        for bad in [vec![], vec![500.0, 400.0], vec![f32::NAN], vec![0.5, 0.6]] {
            assert!(RgbWeights::new(&bad).is_err(), "{bad:?}");
        }
    }
}
