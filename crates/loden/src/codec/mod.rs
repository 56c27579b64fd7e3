//! Compression: one file per method behind one interface, the stored form, its parts, and their decoders.
//!
//! A [`Codec`] writes a file of planes and tables, and a [`Recipe`] defines their meaning. Nothing after that depends
//! on the codec: an opened file ([`open`]) gives its [`parts`], and the form of the recipe selects a fast decoder, or
//! the slow interpreter ([`Decoded::interpreted`]). Parts can be changed and stored again.

mod budget;
mod compress;
mod compressed;
pub mod container;
pub mod decoder;
mod entropy;
mod form;
pub(crate) mod interpret;
pub mod lossless;
mod mapped;
mod matrix;
mod method;
mod network;
mod packed;
pub mod parts;
mod values;

use std::path::Path;

pub use budget::within;
pub use compress::{Finish, Goal, Outcome, check_stages, compress, compress_in_stages};
pub use compressed::{CompressedBtf, open, open_with};
pub use decoder::{Decoded, Decoder};
pub use mapped::{Rearranged, Source, SourceMap, check_mapped, store_mapped};
pub use method::{Analytic, CODECS, Cmf, Dfmf, KMeans, Klt, MedianCut, Neural, Pca, Pcmf, Pvmf, Svd, Tsvq};

use crate::btf::{BtfMeta, BtfSource};
use crate::params::{Param, Values};
use crate::progress::Progress;
use crate::stages::{Kernel, Stages};
use crate::{Error, Result};

use container::Container;
use parts::Recipe;

/// The method that is used where none is named: within seconds it makes small files at any error, and texels are evaluated
/// from them about as fast as by the others.
pub const DEFAULT: &str = "klt";

/// A compression method.
pub trait Codec: Sync {
    /// Name of the method, as users write it.
    fn name(&self) -> &'static str;

    /// Description in one sentence.
    fn doc(&self) -> &'static str;

    /// Its parameters.
    fn params(&self) -> &'static [Param];

    /// Compresses `source` into the file `path`. The same source and parameters give the same bytes, for any number
    /// of threads.
    ///
    /// # Errors
    /// [`Error::Parameter`] for values that do not suit the source; errors of the source; [`Error::Io`];
    /// [`Error::Cancelled`]. No file is left behind on failure.
    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary>;

    /// Compresses in stages that other processes can run; `None` if the method has none.
    fn in_stages(&self) -> Option<EncodeInStages> {
        None
    }

    /// Parameters for quality 0..1 for a BTF with the description `meta`: `place` 0 gives the smallest file, 1 the
    /// smallest error. Empty if the codec has no quality dial.
    fn dial(&self, _meta: &BtfMeta, _place: f64) -> Vec<(&'static str, String)> {
        Vec::new()
    }

    /// The largest values of parameters that a BTF with the description `meta` can use, such as the rank for a number of
    /// components; [`suited`] lowers larger ones to them.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `params` are not those of [`Codec::params`].
    fn limits(&self, _meta: &BtfMeta, _params: &Values) -> Result<Vec<(&'static str, usize)>> {
        Ok(Vec::new())
    }

    /// Upper bound on the memory in bytes, apart from the program itself, for compressing a BTF with the description
    /// `meta` and measuring its error on this many threads. `None` if the method does not support a memory limit.
    fn memory(&self, _meta: &BtfMeta, _params: &Values, _threads: usize) -> Option<u64> {
        None
    }

    /// An encoder that reuses work between several encodings of one source, if the method has one.
    fn session<'a>(&'a self, _source: &'a dyn BtfSource) -> Option<Box<dyn Session + 'a>> {
        None
    }

    /// The recipe of the files of [`Codec::encode`] for these parameters: its planes and tables are the tensors of
    /// the file, and its formula defines their meaning. Where encoding may give fewer rows of a table, this states
    /// the maximum.
    ///
    /// # Errors
    /// [`Error::Parameter`] for values that do not suit the BTF.
    fn recipe(&self, meta: &BtfMeta, params: &Values) -> Result<Recipe>;

    /// Opens files whose tensors are not the planes and tables of the recipe, but a smaller or faster form of these;
    /// `None` if the tensors are the planes and tables.
    fn decoder(&self) -> Option<OpenParts> {
        None
    }
}

/// As [`Codec::encode`], with the same bytes, but what reads the source are [`Stages`]; see [`Codec::in_stages`].
pub type EncodeInStages = fn(&dyn Stages, &Values, &Path, &dyn Progress) -> Result<EncodeSummary>;

/// Makes parts from the tensors of an open file, and a decoder for them; see [`Codec::decoder`].
pub type OpenParts = fn(&Container, &Values) -> Result<Decoded>;

/// Encodes one source with several sets of parameters and reuses what they have in common.
pub trait Session {
    /// As [`Codec::encode`], with the same bytes.
    ///
    /// # Errors
    /// As [`Codec::encode`].
    fn encode(&mut self, params: &Values, path: &Path, progress: &dyn Progress) -> Result<EncodeSummary>;
}

/// `params` with those lowered that exceed their [limits](Codec::limits), given or default, and a note for each.
///
/// # Errors
/// As [`Codec::limits`].
pub fn suited(codec: &dyn Codec, meta: &BtfMeta, params: &Values) -> Result<(Values, Vec<String>)> {
    let (mut suited, mut notes) = (params.clone(), Vec::new());
    for (name, most) in codec.limits(meta, params)? {
        let found: usize = params.get(name)?;
        if found > most {
            suited.set(name, &most.to_string())?;
            notes.push(format!("{name}: lowered from {found} to {most}, the most that this BTF has a use for"));
        }
    }
    Ok((suited, notes))
}

/// An integer at `place` 0..1 between 1 and `most` on a logarithmic scale.
fn count(place: f64, most: usize) -> String {
    (most as f64).powf(place).round().max(1.0).to_string()
}

/// Result of an encoding.
#[derive(Debug, Clone, PartialEq)]
pub struct EncodeSummary {
    /// Size of the file in bytes.
    pub bytes: u64,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// The codec named `name`.
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

/// The names of a list of codecs, for messages.
fn method_names(codecs: &[&dyn Codec]) -> String {
    codecs.iter().map(|codec| codec.name()).collect::<Vec<_>>().join(", ")
}

/// The kernels of all stages.
const KERNELS: &[&dyn Kernel] =
    &[&method::Views, &method::ReadPages, &matrix::MatrixPass, &form::Means, &form::Components, &compress::Differences];

/// The kernel named `name`.
///
/// # Errors
/// [`Error::Parameter`] if there is none.
pub fn kernel(name: &str) -> Result<&'static dyn Kernel> {
    let found = KERNELS.iter().copied().find(|kernel| kernel.name() == name);
    found.ok_or_else(|| Error::parameter("kernel", format!("found {name:?}, which this version does not know")))
}
