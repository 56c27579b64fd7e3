//! How materials of texels find values between their samples.

use std::str::FromStr;

use crate::direction::Scheme;
use crate::{Error, Result};

crate::words! {
    /// The numbers that are averaged between texels and between sampled directions.
    ///
    /// Light adds linearly, so linear light is right. An average of photographs' stored values is too dark wherever the
    /// samples differ.
    #[derive(Default)]
    pub enum Blending {
        /// Linear light where that is as fast: in images, and in compressed BTFs whose texels choose a row of a table over
        /// views and lights. Elsewhere stored values.
        #[default]
        Auto = "auto",
        /// Linear light. Where components are summed, every texel and pair around a point is evaluated by itself.
        Linear = "linear",
        /// Stored values: those of photographs, or the numbers that a codec factors.
        Stored = "stored",
    }
}

/// How values between samples are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Interpolation {
    /// The sampled directions around a direction, and their weights.
    pub scheme: Scheme,
    /// What is averaged with these weights.
    pub blending: Blending,
}

impl Interpolation {
    /// By the words that users write: `triangles` or `rings`, and those of [`Blending`].
    ///
    /// # Errors
    /// [`Error::Parameter`] naming an unknown word.
    pub fn of_words(scheme: &str, blending: &str) -> Result<Self> {
        let scheme = match scheme {
            "triangles" => Scheme::Triangles,
            "rings" => Scheme::Rings,
            other => {
                return Err(Error::parameter("interpolation", format!("found {other:?}, expected triangles or rings")));
            }
        };
        Ok(Self { scheme, blending: blending.parse()? })
    }
}

impl FromStr for Blending {
    type Err = Error;

    fn from_str(word: &str) -> Result<Self> {
        let unknown = || Error::parameter("blending", format!("found {word:?}, expected auto, linear or stored"));
        Self::ALL.iter().copied().find(|blending| blending.name() == word).ok_or_else(unknown)
    }
}

impl From<Scheme> for Interpolation {
    fn from(scheme: Scheme) -> Self {
        Self { scheme, ..Self::default() }
    }
}
