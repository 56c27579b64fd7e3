//! Images and a material with rearranged texels.

use std::ops::Range;
use std::sync::Arc;

use super::SourceMap;
use super::material::Mapped;
use crate::Result;
use crate::btf::BtfMeta;
use crate::codec::decoder::Decoder;
use crate::material::{Interpolation, Material};

/// The decoder of a sample, whose images are rearranged.
pub struct MappedImages {
    /// That of the sample.
    pub meta: BtfMeta,
    pub sample: Arc<dyn Decoder>,
    pub map: Arc<SourceMap>,
}

impl Decoder for MappedImages {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let mut images = vec![0.0; lights.len() * self.meta.image_len()];
        self.sample.decode(view, lights, &mut images)?;
        let outs = out.as_chunks_mut::<3>().0.chunks_exact_mut(self.map.sources.len());
        for (image, out) in images.as_chunks::<3>().0.chunks_exact(self.meta.texels()).zip(outs) {
            let sources = self.map.sources.iter().map(|source| image[source.texel(self.meta.width)]);
            out.iter_mut().zip(sources).for_each(|(out, texel)| *out = texel);
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        self.sample.table_bytes() + size_of_val(&self.map.sources[..]) as u64
    }

    fn material(self: Arc<Self>, interpolation: Interpolation) -> Result<Arc<dyn Material>> {
        let sample = self.sample.clone().material(interpolation)?;
        Ok(Arc::new(Mapped { sample, size: [self.meta.width, self.meta.height], map: self.map.clone() }))
    }
}
