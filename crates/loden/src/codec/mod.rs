//! Compression: one file per method, behind one interface; the stored form.

mod budget;
mod compress;
pub mod container;
pub mod decoder;
pub mod factored;
pub mod lossless;
mod method;
mod packed;
pub mod parts;
pub mod quantised;
mod values;

use std::path::Path;
use std::sync::Arc;

pub use budget::within;
pub use compress::{Finish, Goal, Outcome, compress};
pub use method::{Analytic, CODECS, Cmf, Dfmf, KMeans, Klt, MedianCut, Pca, Pcmf, Pvmf, Svd, Tsvq};

use crate::btf::{BtfMeta, BtfSource};
use crate::direction::Scheme;
use crate::material::Material;
use crate::metric::Report;
use crate::params::{Param, Values};
use crate::progress::Progress;
use crate::{Error, Result};

use container::Container;
use lossless::Stage;
use quantised::QuantisedBtf;

/// A compression method.
pub trait Codec: Sync {
    /// The user's word for it.
    fn name(&self) -> &'static str;

    /// One sentence.
    fn doc(&self) -> &'static str;

    /// Its parameters.
    fn params(&self) -> &'static [Param];

    /// Compresses `source` into the file `path`. The same source and parameters give the same bytes, for any number
    /// of threads.
    ///
    /// # Errors
    /// [`Error::Parameter`] for values that do not suit the source; what the source returns; [`Error::Io`];
    /// [`Error::Cancelled`]. Then nothing is left of the file.
    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary>;

    /// Parameters `place` of 0..1 of the way from small files to small errors, for a BTF such as `meta`; none if the method
    /// has no such way.
    fn dial(&self, _meta: &BtfMeta, _place: f64) -> Vec<(&'static str, String)> {
        Vec::new()
    }

    /// A bound of the memory, bytes, that compressing a BTF such as `meta` and measuring the error takes on so many threads,
    /// the program itself not counted; none if the method keeps no budget.
    fn memory(&self, _meta: &BtfMeta, _params: &Values, _threads: usize) -> Option<u64> {
        None
    }

    /// Encodes one source several times, if that saves work.
    fn session<'a>(&'a self, _source: &'a dyn BtfSource) -> Option<Box<dyn Session + 'a>> {
        None
    }

    /// Opens what [`Codec::encode`] wrote.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the file and the tensor or field.
    fn open(&self, container: Container) -> Result<Arc<dyn CompressedBtf>>;
}

/// Encodes one source with several parameters, and keeps what they have in common.
pub trait Session {
    /// As [`Codec::encode`], the same bytes.
    ///
    /// # Errors
    /// As [`Codec::encode`].
    fn encode(&mut self, params: &Values, path: &Path, progress: &dyn Progress) -> Result<EncodeSummary>;
}

/// A whole number `place` of the way from 1 to `most`, by equal factors.
fn count(place: f64, most: usize) -> String {
    (most as f64).powf(place).round().max(1.0).to_string()
}

/// What an encoder can say of its work.
#[derive(Debug, Clone, PartialEq)]
pub struct EncodeSummary {
    /// Bytes of the file written.
    pub bytes: u64,
    /// Sentences for the user to see.
    pub warnings: Vec<String>,
}

/// A compressed BTF: an image source whose texels are decoded, single precision in the source's encoding, unclamped.
pub trait CompressedBtf: BtfSource {
    /// The name of its codec.
    fn method(&self) -> &'static str;

    /// The parameters it was made with.
    fn params(&self) -> &Values;

    /// How far its images were from the source when it was made, if that was measured.
    fn error(&self) -> Option<&Report>;

    /// Its file.
    fn path(&self) -> &Path;

    /// The exact size of its file.
    fn bytes(&self) -> u64;

    /// The lossless stage that its file is packed by.
    fn lossless(&self) -> Option<&'static Stage>;

    /// Bytes of the tables in memory that its material is evaluated from.
    fn resident_bytes(&self) -> u64;

    /// Decodes all images of a view, shape (light, y, x, rgb), into `out` of [`crate::btf::BtfMeta::view_len`] numbers.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `view` or the length of `out` is wrong.
    fn decode_view(&self, view: usize, out: &mut [f32]) -> Result<()>;

    /// Decodes one image, shape (y, x, rgb), into `out` of [`crate::btf::BtfMeta::image_len`] numbers.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `view`, `light` or the length of `out` is wrong.
    fn decode_image(&self, view: usize, light: usize, out: &mut [f32]) -> Result<()>;

    /// A material that is evaluated from the compressed form.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the directions do not suit the interpolation `scheme`.
    fn material(self: Arc<Self>, scheme: Scheme) -> Result<Arc<dyn Material>>;

    /// Itself with its index image and block of ABRDFs, if that is what it is stored as.
    fn quantised(&self) -> Option<&QuantisedBtf> {
        None
    }
}

/// The codec of this name.
///
/// # Errors
/// [`Error::Parameter`] listing the known names.
pub fn by_name(name: &str) -> Result<&'static dyn Codec> {
    CODECS
        .iter()
        .copied()
        .find(|codec| codec.name() == name)
        .ok_or_else(|| Error::parameter("method", format!("found {name:?}, expected one of {}", names())))
}

/// Opens a compressed BTF of any method.
///
/// # Errors
/// [`Error::Invalid`], [`Error::Limit`] or [`Error::Unsupported`] naming the file and the field; [`Error::Io`].
pub fn open(path: impl AsRef<Path>) -> Result<Arc<dyn CompressedBtf>> {
    let container = Container::open(path.as_ref())?;
    match CODECS.iter().find(|codec| codec.name() == container.method()) {
        Some(codec) => codec.open(container),
        None => {
            let what = format!("unknown method {:?}; there are: {}", container.method(), names());
            Err(Error::unsupported(path, what))
        }
    }
}

fn names() -> String {
    CODECS.iter().map(|codec| codec.name()).collect::<Vec<_>>().join(", ")
}
