//! An open file.

use std::path::Path;
use std::sync::Arc;

use super::container::Container;
use super::decoder::Decoded;
use super::lossless::Stage;
use super::parts::{FileParts, Parts, Provenance, opened};
use super::{CODECS, Codec, method_names};
use crate::btf::{BtfMeta, BtfSource, Origin, Texels};
use crate::direction::Scheme;
use crate::material::Material;
use crate::metric::Report;
use crate::params::{Given, Values};
use crate::{Error, Result};

/// A compressed BTF in a file: an image source whose texels are decoded, single precision in the source's encoding,
/// unclamped.
pub struct CompressedBtf {
    container: Container,
    params: Values,
    decoded: Decoded,
}

/// Opens a compressed BTF of any method: of a codec of this program, or one whose file holds its recipe.
///
/// # Errors
/// [`Error::Invalid`], [`Error::Limit`] or [`Error::Unsupported`] naming the file and the field; [`Error::Io`].
pub fn open(path: impl AsRef<Path>) -> Result<Arc<CompressedBtf>> {
    open_with(path, CODECS)
}

/// As [`open`], with codecs of one's own.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: impl AsRef<Path>, codecs: &[&dyn Codec]) -> Result<Arc<CompressedBtf>> {
    let container = Container::open(path.as_ref())?;
    let codec = codecs.iter().find(|codec| codec.name() == container.method());
    let (params, decoded) = match (codec, container.recipe()?) {
        (Some(codec), _) => {
            let params = container.params(codec.params())?;
            let decoded = match codec.decoder() {
                Some(decode) => decode(&container, &params)?,
                None => {
                    let recipe = opened(&container, "params", codec.recipe(container.meta(), &params))?;
                    Decoded::new(Arc::new(FileParts::new(&container, recipe)?))?
                }
            };
            (params, decoded)
        }
        (None, Some(recipe)) => (Values::defaults(&[]), Decoded::new(Arc::new(FileParts::new(&container, recipe)?))?),
        (None, None) => {
            let names = method_names(codecs);
            let what = format!("unknown method {:?}, and no recipe; methods: {names}", container.method());
            return Err(Error::unsupported(path, what));
        }
    };
    Ok(Arc::new(CompressedBtf { container, params, decoded }))
}

impl CompressedBtf {
    /// Size, directions and conventions of the decoded images.
    pub fn meta(&self) -> &BtfMeta {
        self.decoded.meta()
    }

    /// The name of its codec, or what else wrote the file.
    pub fn method(&self) -> &str {
        self.container.method()
    }

    /// The parameters it was made with; none if its codec is not known.
    pub fn params(&self) -> &Values {
        &self.params
    }

    /// How far its images were from the source when it was made, if that was measured.
    pub fn error(&self) -> Option<&Report> {
        self.container.error()
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        self.container.path()
    }

    /// The exact size of its file.
    pub fn bytes(&self) -> u64 {
        self.container.bytes()
    }

    /// The lossless stage that its file is packed by.
    pub fn lossless(&self) -> Option<&'static Stage> {
        self.container.lossless()
    }

    /// Its planes, its tables, and the recipe that makes values of them.
    pub fn parts(&self) -> &Arc<dyn Parts> {
        self.decoded.parts()
    }

    /// Where its parts are from: what [`super::parts::store`] writes beside them.
    ///
    /// # Errors
    /// What reading the parts gives.
    pub fn provenance(&self) -> Result<Provenance> {
        Provenance::new(&self.container, &**self.parts())
    }

    /// Its parts as decoder and image source.
    pub fn decoded(&self) -> &Decoded {
        &self.decoded
    }

    /// Bytes of the tables in memory that its material is evaluated from.
    pub fn resident_bytes(&self) -> u64 {
        self.decoded.resident_bytes()
    }

    /// Decodes all images of a view, shape (light, y, x, rgb), into `out` of [`BtfMeta::view_len`] numbers.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `view` or the length of `out` is wrong.
    pub fn decode_view(&self, view: usize, out: &mut [f32]) -> Result<()> {
        self.decoded.decode(view, 0..self.meta().lights.len(), out)
    }

    /// Decodes one image, shape (y, x, rgb), into `out` of [`BtfMeta::image_len`] numbers.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `view`, `light` or the length of `out` is wrong.
    pub fn decode_image(&self, view: usize, light: usize, out: &mut [f32]) -> Result<()> {
        self.decoded.decode(view, light..light.saturating_add(1), out)
    }

    /// A material that is evaluated from the compressed form.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the directions do not suit the interpolation `scheme`.
    pub fn material(&self, scheme: Scheme) -> Result<Arc<dyn Material>> {
        self.decoded.material(scheme)
    }
}

impl BtfSource for CompressedBtf {
    fn meta(&self) -> &BtfMeta {
        self.decoded.meta()
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.decoded.view(view)
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.decoded.image(view, light)
    }

    fn origin(&self) -> Option<Origin> {
        let path = std::path::absolute(self.container.path()).ok()?;
        Some(Origin { path, importer: "loden".into(), options: Given::default() })
    }

    fn release(&self, _view: usize) {
        self.container.release();
    }

    fn source_bytes(&self) -> u64 {
        self.bytes()
    }

    fn missing(&self) -> &[(usize, usize)] {
        &self.container.source().missing
    }
}
