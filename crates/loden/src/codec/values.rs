//! The values of a view in the domain that is compressed.

use half::f16;

use super::domain::Domain;
use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::factor::global::Shards;
use crate::factor::tile::FloatTile;
use crate::progress::Task;
use crate::{Error, Result};

/// A view whose texels are loaded into tiles, a row per light and channel.
pub struct ViewValues<'a> {
    texels: Texels<'a>,
    meta: &'a BtfMeta,
    domain: Domain,
    /// 8-bit values in the domain.
    of_byte: [f32; 256],
}

impl<'a> ViewValues<'a> {
    /// Reads a view.
    ///
    /// # Errors
    /// What the source returns; [`Error::Parameter`] if it does not have as many numbers as it should.
    pub fn read(source: &'a dyn BtfSource, view: usize, domain: Domain) -> Result<Self> {
        let meta = source.meta();
        let texels = source.view(view)?;
        if texels.len() != meta.view_len() {
            let problem = format!("view {view} has {} numbers, expected {}", texels.len(), meta.view_len());
            return Err(Error::parameter("source", problem));
        }
        let of_byte = std::array::from_fn(|i| domain.from_stored(meta.encoding, i as f32 / 255.0));
        Ok(Self { texels, meta, domain, of_byte })
    }

    /// 8-bit values that are compressed as they are.
    pub fn bytes(&self) -> Option<&[u8]> {
        match &self.texels {
            Texels::U8(values) if self.domain.is_stored(self.meta.encoding) => Some(values),
            _ => None,
        }
    }

    /// Loads `count` texels from `first`; places behind them become zero.
    pub fn load(&self, tile: &mut FloatTile, first: usize, count: usize) {
        let curve = |value: f32| self.domain.from_stored(self.meta.encoding, value);
        match &self.texels {
            Texels::U8(values) if self.domain.is_stored(self.meta.encoding) => {
                tile.load(values, self.meta.image_len(), first, count);
            }
            Texels::U8(values) => self.convert(tile, values, first, count, |v| self.of_byte[usize::from(v)]),
            Texels::F16(values) => self.convert(tile, values, first, count, |v: f16| curve(v.to_f32())),
            Texels::F32(values) => self.convert(tile, values, first, count, curve),
        }
    }

    fn convert<T: Copy>(
        &self,
        tile: &mut FloatTile,
        values: &[T],
        first: usize,
        count: usize,
        curve: impl Fn(T) -> f32,
    ) {
        for (light, image) in values.chunks_exact(self.meta.image_len()).enumerate() {
            let [r, g, b] = tile.rgb_mut(light);
            for (t, texel) in image[3 * first..3 * (first + count)].chunks_exact(3).enumerate() {
                (r[t], g[t], b[t]) = (curve(texel[0]), curve(texel[1]), curve(texel[2]));
            }
            [r, g, b].into_iter().for_each(|row| row[count..].fill(0.0));
        }
    }
}

/// The views of a source as shards of its matrix.
pub struct ViewShards<'a> {
    /// What is compressed.
    pub source: &'a dyn BtfSource,
    /// Where.
    pub domain: Domain,
    /// Advanced by one for each view that has been used.
    pub task: Task<'a>,
}

impl Shards for ViewShards<'_> {
    type Shard<'a>
        = ViewValues<'a>
    where
        Self: 'a;

    fn count(&self) -> usize {
        self.source.meta().views.len()
    }

    fn columns(&self) -> usize {
        3 * self.source.meta().lights.len()
    }

    fn texels(&self) -> usize {
        self.source.meta().texels()
    }

    fn read(&self, shard: usize) -> Result<ViewValues<'_>> {
        ViewValues::read(self.source, shard, self.domain)
    }

    fn load(&self, shard: &ViewValues<'_>, tile: &mut FloatTile, first: usize, count: usize) {
        shard.load(tile, first, count);
    }

    fn done(&self, shard: usize) -> Result<()> {
        self.source.release(shard);
        self.task.advance(1)
    }
}
