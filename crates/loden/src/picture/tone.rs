//! From scene light to the light of a display.

use glam::{Mat3, Vec3};

use super::Picture;

crate::words! {
    /// How light beyond a display's range is shown.
    #[derive(Default)]
    pub enum ToneMap {
        /// As it is: values above 1 are cut off.
        #[default]
        Linear = "linear",
        /// Along a curve as of film: contrast in the middle, soft highlights that keep their hue until they are white.
        Filmic = "filmic",
        /// As AgX does: less contrast, and bright colours fade to white.
        Agx = "agx",
    }
}

impl Picture {
    /// The picture for a display, in linear light: each pixel times `exposure`, then mapped.
    ///
    /// # Model
    /// `filmic` is a rational approximation of the ACES curve in each channel. `agx` turns the primaries inwards, takes
    /// logarithms over 16.5 stops, applies a sigmoid in each channel and turns the primaries back.
    ///
    /// # References
    /// narkowicz2015 (filmic), sobotka2022 (AgX, in the version without looks)
    #[must_use]
    pub fn toned(mut self, exposure: f32, tone: ToneMap) -> Self {
        let map = match tone {
            ToneMap::Linear => |c: Vec3| c,
            ToneMap::Filmic => filmic,
            ToneMap::Agx => agx,
        };
        self.rgb.iter_mut().for_each(|c| *c = map(*c * exposure));
        self
    }
}

fn filmic(c: Vec3) -> Vec3 {
    let c = c.max(Vec3::ZERO);
    let curve = |x: f32| x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
    Vec3::new(curve(c.x), curve(c.y), curve(c.z)).clamp(Vec3::ZERO, Vec3::ONE)
}

/// The stops that are distinguished, relative to 1.
const STOPS: [f32; 2] = [-12.473_93, 4.026_069];

fn agx(c: Vec3) -> Vec3 {
    let inwards = Mat3::from_cols_array(&[
        0.842_479_1,
        0.042_328_24,
        0.042_375_65,
        0.078_433_6,
        0.878_468_6,
        0.078_433_6,
        0.079_223_75,
        0.079_166_13,
        0.879_143,
    ]);
    let [lowest, highest] = STOPS;
    let stops = |v: f32| (v.max(1e-10).log2().clamp(lowest, highest) - lowest) / (highest - lowest);
    let c = inwards * c.max(Vec3::ZERO);
    let curve = |v: f32| {
        let x = stops(v);
        let (x2, x4) = (x * x, x * x * x * x);
        15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.002_32
    };
    let c = inwards.inverse() * Vec3::new(curve(c.x), curve(c.y), curve(c.z));
    c.clamp(Vec3::ZERO, Vec3::ONE).powf(2.2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_from_black_to_white() {
        for tone in [ToneMap::Linear, ToneMap::Filmic, ToneMap::Agx] {
            let greys = [0.0, 0.001, 0.01, 0.05, 0.18, 0.5, 0.9, 1.0, 3.0, 12.0].map(Vec3::splat).to_vec();
            let picture = Picture { width: 10, height: 1, rgb: greys }.toned(1.0, tone);
            assert!(picture.rgb.is_sorted_by(|a, b| a.y < b.y || a.y >= 0.98), "{tone:?} {:?}", picture.rgb);
            assert!(picture.rgb[0].y < 1e-4 && picture.rgb[9].y > 0.9, "{tone:?} {:?}", picture.rgb);
            // greys stay grey
            assert!(picture.rgb.iter().all(|c| (c.max_element() - c.min_element()).abs() < 2e-3), "{tone:?}");
        }
        // middle grey of AgX as its authors publish it: 0.18 is shown as about 0.5 of the signal
        let grey = agx(Vec3::splat(0.18)).y.powf(1.0 / 2.2);
        assert!((grey - 0.5).abs() < 0.05, "{grey}");
        // bright saturated light fades to white, and does not only clip
        let red = Vec3::new(12.0, 0.4, 0.2);
        assert!(agx(red).y > 0.3, "{}", agx(red));
    }

    #[test]
    fn exposure_is_a_factor() {
        let picture = Picture::filled(1, 1, Vec3::new(0.1, 0.2, 0.4)).toned(2.0, ToneMap::Linear);
        assert_eq!(picture.rgb[0], Vec3::new(0.2, 0.4, 0.8));
    }
}
