//! Opening a compressed file.

use std::path::Path;
use std::sync::Arc;

use super::container::{Container, SourceInfo};
use super::decoder::Decoded;
use super::lossless::Stage;
use super::mapped::{self, SourceMap};
use super::parts::{FileParts, Parts, Provenance, history, opened};
use super::{CODECS, Codec, method_names};
use crate::btf::{BtfMeta, BtfSource, Identity, Origin, Texels};
use crate::input;
use crate::material::{Interpolation, Material};
use crate::metric::Report;
use crate::params::{Given, Values};
use crate::{Error, Result};

/// A compressed BTF in a file. As an image source it gives decoded texels in single precision, in the source's
/// encoding, unclamped.
pub struct CompressedBtf {
    container: Container,
    params: Values,
    decoded: Decoded,
    map: Option<Arc<SourceMap>>,
}

/// Opens a compressed BTF of any built-in method, or any file that holds its recipe.
///
/// # Errors
/// [`Error::Invalid`], [`Error::Limit`] or [`Error::Unsupported`] naming the file and the field; [`Error::Io`].
pub fn open(path: impl AsRef<Path>) -> Result<Arc<CompressedBtf>> {
    open_with(path, CODECS)
}

/// As [`open`], with additional codecs.
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
            let what = format!(
                "unknown method {:?}, and the file holds no recipe; known methods: {names}",
                container.method()
            );
            return Err(Error::unsupported(path, what));
        }
    };
    let map = mapped::read(&container)?.map(Arc::new);
    let decoded = map.iter().try_fold(decoded, |decoded, map| decoded.mapped(map.clone()))?;
    Ok(Arc::new(CompressedBtf { container, params, decoded, map }))
}

impl CompressedBtf {
    /// Size, directions and conventions of the decoded images.
    pub fn meta(&self) -> &BtfMeta {
        self.decoded.meta()
    }

    /// The name of the codec, or of whatever else wrote the file.
    pub fn method(&self) -> &str {
        self.container.method()
    }

    /// The compression parameters; `None` if the codec is unknown.
    pub fn params(&self) -> &Values {
        &self.params
    }

    /// The error measured at compression, if any.
    pub fn error(&self) -> Option<&Report> {
        self.container.error()
    }

    /// What it was compressed from.
    pub fn source(&self) -> &SourceInfo {
        self.container.source()
    }

    /// Name and version of the program that wrote the file.
    pub fn program(&self) -> Option<&str> {
        self.container.metadata().get("program").map(String::as_str)
    }

    /// What was done to the material since it was compressed, oldest first: edits and exchanges as JSON.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the file does not say it in JSON.
    pub fn history(&self) -> Result<Vec<serde_json::Value>> {
        history(&self.container)
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        self.container.path()
    }

    /// The size of the file in bytes.
    pub fn bytes(&self) -> u64 {
        self.container.bytes()
    }

    /// The lossless stage the file is packed with.
    pub fn lossless(&self) -> Option<&'static Stage> {
        self.container.lossless()
    }

    /// The map that rearranges the texels of the stored planes, if there is one.
    pub fn source_map(&self) -> Option<&SourceMap> {
        self.map.as_deref()
    }

    pub(super) fn container(&self) -> &Container {
        &self.container
    }

    /// Its planes, tables and recipe.
    pub fn parts(&self) -> &Arc<dyn Parts> {
        self.decoded.parts()
    }

    /// The origin of the parts, which [`super::parts::store`] writes along with them.
    ///
    /// # Errors
    /// Errors of reading the parts.
    pub fn provenance(&self) -> Result<Provenance> {
        Provenance::new(&self.container, &**self.parts())
    }

    /// The parts with their decoder, as an image source.
    pub fn decoded(&self) -> &Decoded {
        &self.decoded
    }

    /// Memory that evaluation takes, in bytes.
    pub fn resident_bytes(&self) -> u64 {
        self.decoded.resident_bytes()
    }

    /// Decodes all images of a view, shape (light, y, x, rgb), into `out`, which has [`BtfMeta::view_len`] numbers.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a wrong `view` or length of `out`.
    pub fn decode_view(&self, view: usize, out: &mut [f32]) -> Result<()> {
        self.decoded.decode(view, 0..self.meta().lights.len(), out)
    }

    /// Decodes one image, shape (y, x, rgb), into `out`, which has [`BtfMeta::image_len`] numbers.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a wrong `view`, `light` or length of `out`.
    pub fn decode_image(&self, view: usize, light: usize, out: &mut [f32]) -> Result<()> {
        self.decoded.decode(view, light..light.saturating_add(1), out)
    }

    /// A material evaluated directly from the compressed form.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the directions do not allow the scheme of the interpolation.
    pub fn material(&self, interpolation: impl Into<Interpolation>) -> Result<Arc<dyn Material>> {
        self.decoded.material(interpolation)
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

    fn identity(&self) -> Result<Option<Identity>> {
        let path = self.container.path();
        input::identity(path, &[path.to_path_buf()]).map(Some)
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
