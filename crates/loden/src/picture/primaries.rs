//! Primaries of colours, and their conversion to those of Rec. 709.

use glam::{DMat3, DVec2, DVec3, Mat3, Vec3};

/// Chromaticities x, y of the primaries and of white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Primaries {
    pub red: DVec2,
    pub green: DVec2,
    pub blue: DVec2,
    pub white: DVec2,
}

const D65: [f64; 2] = [0.3127, 0.3290];

impl Primaries {
    pub(super) const REC_709: Self = Self::new([0.64, 0.33, 0.30, 0.60, 0.15, 0.06], D65);
    /// CIE XYZ.
    pub(super) const XYZ: Self = Self::new([1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [1.0 / 3.0, 1.0 / 3.0]);

    /// From x and y of red, green and blue, and those of white.
    pub(super) const fn new(rgb: [f64; 6], white: [f64; 2]) -> Self {
        let [rx, ry, gx, gy, bx, by] = rgb;
        Self {
            red: DVec2::new(rx, ry),
            green: DVec2::new(gx, gy),
            blue: DVec2::new(bx, by),
            white: DVec2::new(white[0], white[1]),
        }
    }

    /// By the number that video standards give them (ITU-T H.273).
    pub(super) fn of_video(code: u8) -> Option<Self> {
        Some(match code {
            1 => Self::REC_709,
            4 => Self::new([0.67, 0.33, 0.21, 0.71, 0.14, 0.08], [0.310, 0.316]),
            5 => Self::new([0.64, 0.33, 0.29, 0.60, 0.15, 0.06], D65),
            6 | 7 => Self::new([0.630, 0.340, 0.310, 0.595, 0.155, 0.070], D65),
            8 => Self::new([0.681, 0.319, 0.243, 0.692, 0.145, 0.049], [0.310, 0.316]),
            9 => Self::new([0.708, 0.292, 0.170, 0.797, 0.131, 0.046], D65),
            10 => Self::XYZ,
            11 => Self::new([0.680, 0.320, 0.265, 0.690, 0.150, 0.060], [0.314, 0.351]),
            12 => Self::new([0.680, 0.320, 0.265, 0.690, 0.150, 0.060], D65),
            22 => Self::new([0.630, 0.340, 0.295, 0.605, 0.155, 0.077], D65),
            _ => return None,
        })
    }

    /// The matrix from linear colours of these primaries to those of Rec. 709, without adaptation to another white;
    /// `None` if the primaries are those of Rec. 709 up to the digits that files have.
    ///
    /// # Errors
    /// If the primaries lie on a line.
    pub(super) fn to_rec709(self) -> Result<Option<Mat3>, String> {
        let reference = Self::REC_709;
        let pairs = [
            (self.red, reference.red),
            (self.green, reference.green),
            (self.blue, reference.blue),
            (self.white, reference.white),
        ];
        if pairs.iter().all(|(a, b)| a.abs_diff_eq(*b, 5e-4)) {
            return Ok(None);
        }
        let problem = || format!("the primaries {self} do not span a space of colours");
        let to_xyz = self.to_xyz().ok_or_else(problem)?;
        let from_xyz = reference.to_xyz().ok_or_else(problem)?.inverse();
        let matrix = (from_xyz * to_xyz).as_mat3();
        if matrix.is_finite() { Ok(Some(matrix)) } else { Err(problem()) }
    }

    /// The luminance of each primary; that of white is 1.
    ///
    /// # Errors
    /// If the primaries lie on a line.
    pub(super) fn luminance(self) -> Result<Vec3, String> {
        let to_xyz = self.to_xyz().ok_or_else(|| format!("the primaries {self} do not span a space of colours"))?;
        Ok(to_xyz.row(1).as_vec3())
    }

    /// The matrix from linear colours to CIE XYZ; white has luminance 1.
    fn to_xyz(self) -> Option<DMat3> {
        // y of the blue primary of XYZ itself is 0, so columns are not scaled to luminance 1
        let column = |c: DVec2| DVec3::new(c.x, c.y, 1.0 - c.x - c.y);
        let columns = DMat3::from_cols(column(self.red), column(self.green), column(self.blue));
        if columns.determinant().abs() < 1e-9 || self.white.y.abs() < 1e-9 {
            return None;
        }
        let scale = columns.inverse() * (column(self.white) / self.white.y);
        Some(columns * DMat3::from_diagonal(scale))
    }
}

impl std::fmt::Display for Primaries {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { red, green, blue, white } = self;
        write!(
            f,
            "{} {}, {} {}, {} {} with white {} {}",
            red.x, red.y, green.x, green.y, blue.x, blue.y, white.x, white.y
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_converted_without_adaptation() {
        assert_eq!(Primaries::REC_709.to_rec709(), Ok(None));
        // ITU-R BT.2087, the inverse of table 2
        let from_2020 = Primaries::of_video(9).unwrap().to_rec709().unwrap().unwrap();
        let expected = Vec3::new(1.6605, -0.1246, -0.0182);
        assert!((from_2020 * Vec3::X).abs_diff_eq(expected, 1e-4), "{}", from_2020 * Vec3::X);
        assert!((from_2020 * Vec3::ONE).abs_diff_eq(Vec3::ONE, 1e-4));
        // IEC 61966-2-1
        let from_xyz = Primaries::XYZ.to_rec709().unwrap().unwrap();
        assert!((from_xyz * Vec3::X).abs_diff_eq(Vec3::new(3.2406, -0.9689, 0.0557), 2e-3), "{}", from_xyz * Vec3::X);
        let line = Primaries::new([0.1, 0.1, 0.2, 0.2, 0.3, 0.3], D65);
        assert!(line.to_rec709().is_err());
    }
}
