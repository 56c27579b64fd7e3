//! Parts with rearranged texels.

use std::sync::Arc;

use super::SourceMap;
use crate::Result;
use crate::btf::{BtfMeta, Rect};
use crate::codec::parts::{Numbers, Parts, Recipe, check_plane};

/// Parts whose planes are those of other parts, rearranged by a map; nothing is decoded or computed before it is asked for.
pub struct Rearranged {
    meta: BtfMeta,
    sample: Arc<dyn Parts>,
    map: Arc<SourceMap>,
}

impl Rearranged {
    /// Rearranges the texels of `sample`.
    ///
    /// # Errors
    /// As [`SourceMap::check`].
    pub fn new(sample: Arc<dyn Parts>, map: Arc<SourceMap>) -> Result<Self> {
        map.check(sample.meta().width, sample.meta().height)?;
        Ok(Self { meta: map.meta(sample.meta()), sample, map })
    }
}

impl Parts for Rearranged {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn recipe(&self) -> &Recipe {
        self.sample.recipe()
    }

    fn plane(&self, plane: usize, view: usize, texels: Rect) -> Result<Numbers> {
        let count = check_plane(self, plane, view, texels)?.count();
        let meta = self.sample.meta();
        let all = self.sample.plane(plane, view, Rect::whole(meta))?;
        let row = |y: usize| &self.map.sources[y * self.map.width + texels.x..][..texels.width];
        let sources = (texels.y..texels.y + texels.height).flat_map(row);
        Ok(all.gathered(count, sources.map(|source| source.texel(meta.width))))
    }

    fn table(&self, table: usize) -> Result<Numbers> {
        self.sample.table(table)
    }
}
