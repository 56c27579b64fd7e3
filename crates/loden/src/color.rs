//! Colour: encodings of stored numbers, and spectra. RGB has the primaries of linear sRGB (Rec. 709).

pub mod domain;
pub(crate) mod model;
pub mod spectrum;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::params::{Field, Form, Type, Values};

/// The encoding that relates a stored value in 0..1 to linear light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Encoding {
    /// The value is linear light; it may exceed 1.
    Linear,
    /// The piecewise curve of IEC 61966-2-1.
    Srgb,
    /// A pure power: linear = value ^ gamma.
    Gamma(f32),
}

impl Encoding {
    /// Converts a stored value to linear light.
    #[inline]
    pub fn decode(self, value: f32) -> f32 {
        match self {
            Self::Linear => value,
            Self::Srgb if value <= 0.04045 => value / 12.92,
            Self::Srgb => ((value + 0.055) / 1.055).powf(2.4),
            Self::Gamma(gamma) => value.max(0.0).powf(gamma),
        }
    }

    /// Converts linear light to a stored value; the inverse of [`Encoding::decode`].
    #[inline]
    pub fn encode(self, linear: f32) -> f32 {
        match self {
            Self::Linear => linear,
            Self::Srgb if linear <= 0.003_130_8 => linear * 12.92,
            Self::Srgb => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
            Self::Gamma(gamma) => linear.max(0.0).powf(1.0 / gamma),
        }
    }

    /// The encoding for display: sRGB for linear values, otherwise unchanged.
    pub fn display(self) -> Self {
        match self {
            Self::Linear => Self::Srgb,
            other => other,
        }
    }
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Linear => f.write_str("linear"),
            Self::Srgb => f.write_str("srgb"),
            Self::Gamma(gamma) => write!(f, "gamma{gamma}"),
        }
    }
}

impl From<Encoding> for String {
    fn from(encoding: Encoding) -> Self {
        encoding.to_string()
    }
}

impl TryFrom<String> for Encoding {
    type Error = Error;
    fn try_from(text: String) -> Result<Self, Error> {
        text.parse()
    }
}

impl FromStr for Encoding {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self, Error> {
        let gamma = || text.strip_prefix("gamma")?.parse().ok().filter(|g| (0.1..=10.0).contains(g));
        match text {
            "linear" => Ok(Self::Linear),
            "srgb" => Ok(Self::Srgb),
            _ => gamma().map(Self::Gamma).ok_or_else(|| {
                Error::parameter(
                    "encoding",
                    format!("found {text:?}, expected linear, srgb or gamma followed by a number"),
                )
            }),
        }
    }
}

impl Field for Encoding {
    const TYPE: Type = Type::Text(Form {
        expected: "linear, srgb or gamma followed by a number, such as gamma2.2",
        examples: &["linear", "srgb", "gamma2.2"],
        accepts: |text| text.parse::<Encoding>().is_ok(),
    });

    fn read(values: &Values, name: &str) -> Result<Self, Error> {
        values.written(name)?.parse()
    }

    fn write(&self, name: &str, values: &mut Values) -> Result<(), Error> {
        values.set(name, &self.to_string())
    }
}

/// Rec. 709 luminance of a linear colour, or luma of an encoded one.
#[inline]
pub fn luminance(rgb: [f32; 3]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_inverts_and_round_trips_as_text() {
        for encoding in [Encoding::Linear, Encoding::Srgb, Encoding::Gamma(2.2)] {
            for i in 0..=255 {
                let value = i as f32 / 255.0;
                assert!((encoding.encode(encoding.decode(value)) - value).abs() < 1e-5);
            }
            assert_eq!(encoding.to_string().parse::<Encoding>().unwrap(), encoding);
        }
        assert!("gamma".parse::<Encoding>().is_err());
    }
}
