//! Shared pieces of the integration tests.

pub mod chi_square;
pub mod tensor;

use std::borrow::Cow;
use std::path::PathBuf;

use loden::Result;
use loden::btf::{BtfMeta, BtfSource, Cosine, SampleType, Texels};
use loden::color::Encoding;
use loden::direction::DirectionSet;

/// A folder of the reference measurements named by `LODEN_DATA`. Tests that need it are ignored unless they are asked for.
pub fn data(folder: &str) -> PathBuf {
    let root = std::env::var_os("LODEN_DATA").expect("LODEN_DATA names the folder of reference measurements");
    let path = PathBuf::from(root).join(folder);
    assert!(path.is_dir(), "LODEN_DATA is set, but {} is no folder", path.display());
    path
}

/// A smooth closed-form BTF, computed when asked for.
pub struct Synthetic {
    pub meta: BtfMeta,
}

impl Synthetic {
    pub fn bonn81(width: usize, height: usize) -> Self {
        let meta = BtfMeta {
            width,
            height,
            views: DirectionSet::bonn81(),
            lights: DirectionSet::bonn81(),
            encoding: Encoding::Srgb,
            cosine: Cosine::Included,
            sample_type: SampleType::U8,
        };
        Self { meta }
    }

    pub fn pixels(&self, view: usize, light: usize) -> Vec<u8> {
        let (wo, wi) = (self.meta.views.directions()[view], self.meta.lights.directions()[light]);
        let h = (wi + wo).normalize();
        let value = |i: usize| {
            let (texel, channel) = (i / 3, i % 3);
            let (x, y) = ((texel % self.meta.width) as f32, (texel / self.meta.width) as f32);
            let diffuse = wi.z * (0.4 + 0.2 * (0.7 * x + channel as f32).sin() + 0.1 * (0.9 * y + wo.x).cos());
            let gloss = 0.3 * h.z.powf(20.0 + 5.0 * x.sin());
            ((diffuse + gloss) * 255.0).clamp(0.0, 255.0) as u8
        };
        (0..self.meta.image_len()).map(value).collect()
    }
}

impl BtfSource for Synthetic {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        let all: Vec<u8> = (0..self.meta.lights.len()).flat_map(|light| self.pixels(view, light)).collect();
        Ok(Texels::U8(Cow::Owned(all)))
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        Ok(Texels::U8(Cow::Owned(self.pixels(view, light))))
    }

    fn source_bytes(&self) -> u64 {
        self.meta.raw8_bytes()
    }
}
