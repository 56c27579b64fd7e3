//! Compression: one file per method, behind one interface; the stored form, its parts, and what is made of them.
//!
//! A [`Codec`] writes a file of planes and tables and says by a [`Recipe`] what they mean. From there on no one asks which
//! codec it was: opened ([`open`]), the file gives its [`parts`]; the form of the recipe chooses a fast decoder, or the
//! [`interpret::Interpreter`] does it slowly; and whoever has the parts may change and store them.

mod budget;
mod compress;
mod compressed;
pub mod container;
pub mod decoder;
pub mod form;
pub mod interpret;
pub mod lossless;
mod method;
mod packed;
pub mod parts;
mod values;

use std::path::Path;

pub use budget::within;
pub use compress::{Finish, Goal, Outcome, compress};
pub use compressed::{CompressedBtf, open, open_with};
pub use decoder::{Decoded, Decoder};
pub use method::{Analytic, CODECS, Cmf, Dfmf, KMeans, Klt, MedianCut, Pca, Pcmf, Pvmf, Svd, Tsvq};

use crate::btf::{BtfMeta, BtfSource};
use crate::params::{Param, Values};
use crate::progress::Progress;
use crate::{Error, Result};

use container::Container;
use parts::Recipe;

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

    /// What the files of [`Codec::encode`] hold for these parameters: their planes and tables are the file's tensors, the
    /// formula says what they mean. Where encoding may give fewer rows of a table, this is the largest number.
    ///
    /// # Errors
    /// [`Error::Parameter`] for values that do not suit the BTF.
    fn recipe(&self, meta: &BtfMeta, params: &Values) -> Result<Recipe>;

    /// How to open a file whose tensors are not the planes and tables of the recipe, but these in a form that is smaller or
    /// faster; `None` if they are.
    fn decoder(&self) -> Option<OpenParts> {
        None
    }
}

/// Makes parts of the tensors of an open file, and a decoder of these; see [`Codec::decoder`].
pub type OpenParts = fn(&Container, &Values) -> Result<Decoded>;

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

/// The codec of this name.
///
/// # Errors
/// [`Error::Parameter`] listing the known names.
pub fn by_name(name: &str) -> Result<&'static dyn Codec> {
    CODECS
        .iter()
        .copied()
        .find(|codec| codec.name() == name)
        .ok_or_else(|| Error::parameter("method", format!("found {name:?}, expected one of {}", method_names(CODECS))))
}

/// The names of some codecs, for people.
fn method_names(codecs: &[&dyn Codec]) -> String {
    codecs.iter().map(|codec| codec.name()).collect::<Vec<_>>().join(", ")
}
