//! Conversion of spectra to linear RGB: CIE 1931 2 degree observer, illuminant D65.

use crate::{Error, Result};

/// Relative power of CIE standard illuminant D65 from 380 to 780 nm in steps of 10 nm.
const D65: [f64; 41] = [
    49.9755, 54.6482, 82.7549, 91.486, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354,
    107.802, 104.79, 107.689, 104.405, 104.046, 100.0, 96.3342, 95.788, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886,
    83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.349, 61.604, 69.8856, 75.087, 63.5927, 46.4182,
    66.8054, 63.3828,
];

/// CIE 1931 colour matching functions x, y, z of the 2 degree observer from 380 to 780 nm in steps of 5 nm.
const OBSERVER: [[f64; 3]; 81] = [
    [0.001368, 0.000039, 0.00645],
    [0.002236, 0.000064, 0.01055],
    [0.004243, 0.00012, 0.02005],
    [0.00765, 0.000217, 0.03621],
    [0.01431, 0.000396, 0.06785],
    [0.02319, 0.00064, 0.1102],
    [0.04351, 0.00121, 0.2074],
    [0.07763, 0.00218, 0.3713],
    [0.13438, 0.004, 0.6456],
    [0.21477, 0.0073, 1.03905],
    [0.2839, 0.0116, 1.3856],
    [0.3285, 0.01684, 1.62296],
    [0.34828, 0.023, 1.74706],
    [0.34806, 0.0298, 1.7826],
    [0.3362, 0.038, 1.77211],
    [0.3187, 0.048, 1.7441],
    [0.2908, 0.06, 1.6692],
    [0.2511, 0.0739, 1.5281],
    [0.19536, 0.09098, 1.28764],
    [0.1421, 0.1126, 1.0419],
    [0.09564, 0.13902, 0.81295],
    [0.05795, 0.1693, 0.6162],
    [0.03201, 0.20802, 0.46518],
    [0.0147, 0.2586, 0.3533],
    [0.0049, 0.323, 0.272],
    [0.0024, 0.4073, 0.2123],
    [0.0093, 0.503, 0.1582],
    [0.0291, 0.6082, 0.1117],
    [0.06327, 0.71, 0.07825],
    [0.1096, 0.7932, 0.05725],
    [0.1655, 0.862, 0.04216],
    [0.22575, 0.91485, 0.02984],
    [0.2904, 0.954, 0.0203],
    [0.3597, 0.9803, 0.0134],
    [0.43345, 0.99495, 0.00875],
    [0.51205, 1.0, 0.00575],
    [0.5945, 0.995, 0.0039],
    [0.6784, 0.9786, 0.00275],
    [0.7621, 0.952, 0.0021],
    [0.8425, 0.9154, 0.0018],
    [0.9163, 0.87, 0.00165],
    [0.9786, 0.8163, 0.0014],
    [1.0263, 0.757, 0.0011],
    [1.0567, 0.6949, 0.001],
    [1.0622, 0.631, 0.0008],
    [1.0456, 0.5668, 0.0006],
    [1.0026, 0.503, 0.00034],
    [0.9384, 0.4412, 0.00024],
    [0.85445, 0.381, 0.00019],
    [0.7514, 0.321, 0.0001],
    [0.6424, 0.265, 0.00005],
    [0.5419, 0.217, 0.00003],
    [0.4479, 0.175, 0.00002],
    [0.3608, 0.1382, 0.00001],
    [0.2835, 0.107, 0.0],
    [0.2187, 0.0816, 0.0],
    [0.1649, 0.061, 0.0],
    [0.1212, 0.04458, 0.0],
    [0.0874, 0.032, 0.0],
    [0.0636, 0.0232, 0.0],
    [0.04677, 0.017, 0.0],
    [0.0329, 0.01192, 0.0],
    [0.0227, 0.00821, 0.0],
    [0.01584, 0.005723, 0.0],
    [0.011359, 0.004102, 0.0],
    [0.008111, 0.002929, 0.0],
    [0.00579, 0.002091, 0.0],
    [0.004109, 0.001484, 0.0],
    [0.002899, 0.001047, 0.0],
    [0.002049, 0.00074, 0.0],
    [0.00144, 0.00052, 0.0],
    [0.001, 0.000361, 0.0],
    [0.00069, 0.000249, 0.0],
    [0.000476, 0.000172, 0.0],
    [0.000332, 0.00012, 0.0],
    [0.000235, 0.000085, 0.0],
    [0.000166, 0.00006, 0.0],
    [0.000117, 0.000042, 0.0],
    [0.000083, 0.00003, 0.0],
    [0.000059, 0.000021, 0.0],
    [0.000042, 0.000015, 0.0],
];

/// XYZ to linear sRGB, IEC 61966-2-1.
const RGB_FROM_XYZ: [[f64; 3]; 3] = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]];

/// Weights of the wavelengths of a reflectance spectrum in linear sRGB (Rec. 709).
///
/// # Model
/// The reflectance is linear between the given wavelengths; the outermost values extend down to 380 and up to 780 nm.
/// It is lit by D65 and seen by the CIE 1931 2 degree observer, both linear between the entries of their tables. Each
/// channel is scaled so that a perfect white reflector is exactly (1, 1, 1).
///
/// # References
/// cie2018 (tables of D65 and of the 2 degree observer)
#[derive(Debug, Clone, PartialEq)]
pub struct RgbWeights(Vec<[f32; 3]>);

impl RgbWeights {
    /// Weights for ascending `wavelengths` in nm.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there are none, if they do not ascend, or if one is outside 100..=10000 nm.
    pub fn new(wavelengths: &[f32]) -> Result<Self> {
        let possible = wavelengths.iter().all(|w| (100.0..=10_000.0).contains(w));
        if wavelengths.is_empty() || !possible || !wavelengths.is_sorted_by(|a, b| a < b) {
            return Err(Error::parameter("wavelengths", "expected ascending wavelengths in 100..=10000 nm"));
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

    /// Linear RGB of a spectrum with a value per wavelength.
    pub fn rgb(&self, spectrum: impl IntoIterator<Item = f32>) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (value, weight) in spectrum.into_iter().zip(&self.0) {
            (0..3).for_each(|channel| sum[channel] += value * weight[channel]);
        }
        sum
    }
}

/// Position of a wavelength in a table that starts at 380 nm: the entry below, and the fraction of the way to the next.
fn between(nm: f64, step: f64, entries: usize) -> (usize, f64) {
    let x = (nm - 380.0) / step;
    let i = (x as usize).min(entries - 2);
    (i, x - i as f64)
}

fn power(nm: f64) -> f64 {
    let (i, t) = between(nm, 10.0, D65.len());
    D65[i] + t * (D65[i + 1] - D65[i])
}

fn xyz(nm: f64) -> [f64; 3] {
    let (i, t) = between(nm, 5.0, OBSERVER.len());
    std::array::from_fn(|k| OBSERVER[i][k] + t * (OBSERVER[i + 1][k] - OBSERVER[i][k]))
}

fn rgb(nm: f64) -> [f64; 3] {
    let xyz = xyz(nm);
    RGB_FROM_XYZ.map(|row| row.iter().zip(xyz).map(|(m, v)| m * v).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_white_point_is_d65() {
        let mut sum = [0.0; 3];
        for nm in 380..=780 {
            let nm = f64::from(nm);
            xyz(nm).iter().zip(&mut sum).for_each(|(v, sum)| *sum += v * power(nm));
        }
        let total: f64 = sum.iter().sum();
        // chromaticity by the CIE
        assert!((sum[0] / total - 0.312_72).abs() < 5e-5, "{}", sum[0] / total);
        assert!((sum[1] / total - 0.329_03).abs() < 5e-5, "{}", sum[1] / total);
    }

    #[test]
    fn white_is_white_and_bands_have_their_hues() {
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
