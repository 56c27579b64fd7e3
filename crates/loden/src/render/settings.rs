//! Size and quality of pictures.

use crate::picture::{MAX_PIXELS, MAX_SIDE};
use crate::{Error, Result};

/// Size and quality of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples per pixel; powers of two are best stratified.
    pub spp: u32,
    /// Maximum number of segments of a path, the camera ray included: 2 is direct light only.
    pub depth: u32,
    /// Seed of the random numbers; affects only the noise.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { width: 512, height: 512, spp: 64, depth: 6, seed: 0 }
    }
}

impl Settings {
    pub(super) fn check(&self) -> Result<()> {
        let range = |name: &str, found: u64, max: u64| {
            if (1..=max).contains(&found) {
                return Ok(());
            }
            Err(Error::parameter(name, format!("found {found}, expected 1 to {max}")))
        };
        range("width", self.width as u64, MAX_SIDE as u64)?;
        range("height", self.height as u64, MAX_SIDE as u64)?;
        range("pixels", (self.width * self.height) as u64, MAX_PIXELS as u64)?;
        range("spp", self.spp.into(), 1 << 24)?;
        range("depth", self.depth.into(), 1024)
    }
}
