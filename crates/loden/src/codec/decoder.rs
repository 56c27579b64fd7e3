//! Images and materials from parts: by a fast decoder if one knows the form of the recipe, else by the interpreter.

use std::ops::Range;
use std::sync::Arc;

use super::form::FORMS;
use super::interpret::Interpreter;
use super::mapped::{MappedImages, Rearranged, SourceMap};
use super::parts::Parts;
use crate::Result;
use crate::btf::{BtfMeta, BtfSource, SampleType, Texels};
use crate::material::{Interpolation, Material};

/// Decodes images from parts and makes a material of them.
pub trait Decoder: Send + Sync {
    /// Decodes the images `lights` of a view, shape (light, y, x, rgb), into `out`. The caller has checked the range
    /// and length.
    ///
    /// # Errors
    /// If the images cannot be decoded.
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()>;

    /// Memory that evaluation takes, in bytes.
    fn table_bytes(&self) -> u64;

    /// A material evaluated from the parts. The blending is one that [`Recipe::blending`](super::parts::Recipe::blending)
    /// gives.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the scheme of the interpolation.
    fn material(self: Arc<Self>, interpolation: Interpolation) -> Result<Arc<dyn Material>>;
}

/// Parts with a decoder. As an image source it gives single precision in the encoding of the meta, unclamped.
#[derive(Clone)]
pub struct Decoded {
    meta: BtfMeta,
    parts: Arc<dyn Parts>,
    decoder: Arc<dyn Decoder>,
}

impl Decoded {
    /// Chooses a decoder by the form of the recipe.
    ///
    /// # Errors
    /// Errors of reading the parts.
    pub fn new(parts: Arc<dyn Parts>) -> Result<Self> {
        for form in FORMS {
            if let Some(decoder) = form(&parts)? {
                return Ok(Self::with(parts, decoder));
            }
        }
        Self::interpreted(parts)
    }

    /// Decodes with the interpreter, which is slow but defines the meaning of the recipe.
    ///
    /// # Errors
    /// Errors of reading the parts.
    pub fn interpreted(parts: Arc<dyn Parts>) -> Result<Self> {
        let decoder = Arc::new(Interpreter::new(&*parts)?);
        Ok(Self::with(parts, decoder))
    }

    /// Uses a decoder made from these parts.
    pub fn with(parts: Arc<dyn Parts>, decoder: Arc<dyn Decoder>) -> Self {
        Self { meta: BtfMeta { sample_type: SampleType::F32, ..parts.meta().clone() }, parts, decoder }
    }

    /// The same with its texels rearranged.
    ///
    /// # Errors
    /// As [`SourceMap::check`].
    pub fn mapped(&self, map: Arc<SourceMap>) -> Result<Self> {
        let parts = Arc::new(Rearranged::new(self.parts.clone(), map.clone())?);
        let images = MappedImages { meta: self.meta.clone(), sample: self.decoder.clone(), map };
        Ok(Self::with(parts, Arc::new(images)))
    }

    /// The parts.
    pub fn parts(&self) -> &Arc<dyn Parts> {
        &self.parts
    }

    /// A material evaluated from the parts.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the scheme of the interpolation.
    pub fn material(&self, interpolation: impl Into<Interpolation>) -> Result<Arc<dyn Material>> {
        let Interpolation { scheme, blending } = interpolation.into();
        let blending = self.parts.recipe().blending(blending);
        self.decoder.clone().material(Interpolation { scheme, blending })
    }

    /// Memory that [`Decoded::material`] takes for its tables, in bytes.
    pub fn resident_bytes(&self) -> u64 {
        self.decoder.table_bytes()
    }

    /// Decodes the images `lights` of a view, shape (light, y, x, rgb).
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if an image does not exist or `out` has the wrong length.
    pub fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        self.meta.check_decode(view, lights.clone(), out)?;
        self.decoder.decode(view, lights, out)
    }

    fn texels(&self, view: usize, lights: Range<usize>) -> Result<Texels<'static>> {
        let mut out = vec![0.0; lights.len() * self.meta.image_len()];
        self.decode(view, lights, &mut out)?;
        Ok(Texels::F32(out.into()))
    }
}

impl BtfSource for Decoded {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.texels(view, 0..self.meta.lights.len())
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.texels(view, light..light.saturating_add(1))
    }

    fn source_bytes(&self) -> u64 {
        let recipe = self.parts.recipe();
        recipe.tensors(&self.meta).iter().map(super::container::TensorSpec::bytes).sum()
    }
}
