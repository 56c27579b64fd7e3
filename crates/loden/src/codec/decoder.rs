//! What all decoders share: they are image sources and compressed BTFs for what they can decode.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use super::container::Container;
use super::lossless::Stage;
use super::quantised::QuantisedBtf;
use super::{Codec, CompressedBtf};
use crate::Result;
use crate::btf::{BtfMeta, BtfSource, SampleType, Texels};
use crate::direction::Scheme;
use crate::material::Material;
use crate::metric::Report;
use crate::params::Values;

/// An open file and what its header says.
#[derive(Debug)]
pub struct Opened {
    /// The file.
    pub container: Container,
    /// The name of its codec.
    pub method: &'static str,
    /// The parameters it was made with.
    pub params: Values,
    /// Of the decoded images.
    pub meta: BtfMeta,
}

impl Opened {
    /// Checks the parameters of a container.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] naming the file and the parameter.
    pub fn new(container: Container, codec: &dyn Codec) -> Result<Self> {
        let params = container.params(codec.params())?;
        let meta = BtfMeta { sample_type: SampleType::F32, ..container.meta().clone() };
        Ok(Self { container, method: codec.name(), params, meta })
    }
}

/// Decodes images of an open file: all that a [`CompressedBtf`] is made from.
pub trait Decoder: Send + Sync + 'static {
    /// The file.
    fn opened(&self) -> &Opened;

    /// Decodes the images `lights` of a view, shape (light, y, x, rgb), into `out`; all of them exist and fill `out`.
    ///
    /// # Errors
    /// If the images cannot be decoded.
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()>;

    /// See [`CompressedBtf::resident_bytes`].
    fn table_bytes(&self) -> u64;

    /// See [`CompressedBtf::material`].
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not suit the interpolation `scheme`.
    fn evaluable(self: Arc<Self>, scheme: Scheme) -> Result<Arc<dyn Material>>;

    /// See [`CompressedBtf::quantised`].
    fn clusters(&self) -> Option<&QuantisedBtf> {
        None
    }

    /// As [`Decoder::decode`], of images and an `out` that may not suit.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] for these; what decoding returns.
    fn checked(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        self.opened().meta.check_decode(view, lights.clone(), out)?;
        self.decode(view, lights, out)
    }

    /// The images `lights` of a view as texels.
    ///
    /// # Errors
    /// As [`Decoder::checked`].
    fn texels(&self, view: usize, lights: Range<usize>) -> Result<Texels<'static>> {
        let mut out = vec![0.0; lights.len() * self.opened().meta.image_len()];
        self.checked(view, lights, &mut out)?;
        Ok(Texels::F32(Cow::Owned(out)))
    }
}

impl<D: Decoder> BtfSource for D {
    fn meta(&self) -> &BtfMeta {
        &self.opened().meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.texels(view, 0..self.opened().meta.lights.len())
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.texels(view, light..light + 1)
    }

    fn release(&self, _view: usize) {
        self.opened().container.release();
    }

    fn source_bytes(&self) -> u64 {
        self.opened().container.bytes()
    }

    fn missing(&self) -> &[(usize, usize)] {
        &self.opened().container.source().missing
    }
}

impl<D: Decoder> CompressedBtf for D {
    fn method(&self) -> &'static str {
        self.opened().method
    }

    fn params(&self) -> &Values {
        &self.opened().params
    }

    fn error(&self) -> Option<&Report> {
        self.opened().container.error()
    }

    fn path(&self) -> &Path {
        self.opened().container.path()
    }

    fn bytes(&self) -> u64 {
        self.opened().container.bytes()
    }

    fn lossless(&self) -> Option<&'static Stage> {
        self.opened().container.lossless()
    }

    fn resident_bytes(&self) -> u64 {
        self.table_bytes()
    }

    fn decode_view(&self, view: usize, out: &mut [f32]) -> Result<()> {
        self.checked(view, 0..self.opened().meta.lights.len(), out)
    }

    fn decode_image(&self, view: usize, light: usize, out: &mut [f32]) -> Result<()> {
        self.checked(view, light..light.saturating_add(1), out)
    }

    fn material(self: Arc<Self>, scheme: Scheme) -> Result<Arc<dyn Material>> {
        self.evaluable(scheme)
    }

    fn quantised(&self) -> Option<&QuantisedBtf> {
        self.clusters()
    }
}
