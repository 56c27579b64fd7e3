//! Rearranged texels: a compressed BTF whose texels are copies of those of a smaller one, in another order.
//!
//! # Model
//! A [`SourceMap`] says for each texel of the result which texel of the sample it copies. A file stores the map beside
//! the planes of the sample, which stay as they are, whatever codec made them. Images are decoded for the sample and
//! rearranged. Between texels whose sources are neighbours too, the material of the sample is evaluated between those;
//! elsewhere, at seams, its values at four texels are blended in linear light.
//!
//! # Limits
//! Seams are not seen by the sampler of directions, which uses the nearest texel.

mod coding;
mod images;
mod material;
mod rearranged;
mod stored;

use crate::btf::BtfMeta;
use crate::{Error, Result};

pub(super) use images::MappedImages;
pub use rearranged::Rearranged;
pub(super) use stored::read;
pub use stored::{check_mapped, store_mapped};

/// A texel of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct Source {
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
}

impl Source {
    /// The texel in column `x` of row `y`, which are below 65536.
    #[inline]
    pub fn new(x: usize, y: usize) -> Self {
        Self { x: x as u16, y: y as u16 }
    }

    /// Its number, row by row, in a sample with rows of `width` texels.
    #[inline]
    pub fn texel(self, width: usize) -> usize {
        usize::from(self.y) * width + usize::from(self.x)
    }
}

impl From<Source> for [u16; 2] {
    /// Column and row.
    fn from(source: Source) -> Self {
        [source.x, source.y]
    }
}

/// For each texel of a result, the texel of a sample that it copies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceMap {
    /// Texels per row of the result.
    pub width: usize,
    /// Rows of the result.
    pub height: usize,
    /// The texels copied, shape (y, x).
    pub sources: Vec<Source>,
}

impl SourceMap {
    /// The map of `source(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut source: impl FnMut(usize, usize) -> Source) -> Self {
        let sources = (0..width * height).map(|texel| source(texel % width, texel / width)).collect();
        Self { width, height, sources }
    }

    /// The source of a texel of the result.
    ///
    /// # Panics
    /// If the texel is outside.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> Source {
        self.sources[y * self.width + x]
    }

    /// Checks that there is a source for every texel, and that it is a texel of a sample of this size.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first texel that has none.
    pub fn check(&self, width: usize, height: usize) -> Result<()> {
        let invalid = |problem: String| Err(Error::parameter("map", problem));
        if self.sources.is_empty() || self.width.checked_mul(self.height) != Some(self.sources.len()) {
            let found = self.sources.len();
            return invalid(format!("found {found} sources for {} x {} texels", self.width, self.height));
        }
        let outside = |source: &Source| usize::from(source.x) >= width || usize::from(source.y) >= height;
        match self.sources.iter().position(outside) {
            None => Ok(()),
            Some(texel) => {
                let (x, y, Source { x: column, y: row }) =
                    (texel % self.width, texel / self.width, self.sources[texel]);
                invalid(format!(
                    "texel ({x}, {y}) copies texel ({column}, {row}), but the sample has {width} x {height}"
                ))
            }
        }
    }

    /// The map that copies from the sample of `first` what this map copies from the result of `first`.
    ///
    /// # Errors
    /// As [`SourceMap::check`] for the size of `first`.
    pub fn after(&self, first: &Self) -> Result<Self> {
        self.check(first.width, first.height)?;
        let sources = self.sources.iter().map(|source| first.sources[source.texel(first.width)]).collect();
        Ok(Self { width: self.width, height: self.height, sources })
    }

    /// The description of a BTF whose texels are rearranged by this map.
    fn meta(&self, sample: &BtfMeta) -> BtfMeta {
        BtfMeta { width: self.width, height: self.height, ..sample.clone() }
    }
}

#[cfg(test)]
mod tests;
