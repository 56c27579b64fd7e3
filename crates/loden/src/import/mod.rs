//! Readers of measured data, one file per format, recognised by content.

#[cfg(feature = "import-brdf")]
mod alta;
#[cfg(feature = "import-brdf")]
mod astm;
#[cfg(feature = "import-brdf")]
mod carrier;
#[cfg(feature = "import-brdf")]
mod cornell;
#[cfg(feature = "import-brdf")]
mod curet;
#[cfg(feature = "import-images")]
mod curet_images;
mod factored;
#[cfg(feature = "import-images")]
mod image_set;
#[cfg(feature = "import-images")]
mod images;
#[cfg(feature = "import-brdf")]
mod kaist;
mod loden;
#[cfg(feature = "import-brdf")]
pub(crate) mod merl;
#[cfg(feature = "import-brdf")]
mod mit;
mod named;
mod opened;
#[cfg(feature = "import-images")]
pub(crate) mod pattern;
pub(crate) mod raw;
#[cfg(feature = "import-brdf")]
mod rgl;
#[cfg(feature = "import-brdf")]
mod rows;
#[cfg(feature = "import-images")]
mod rti;
#[cfg(feature = "import-brdf")]
pub(crate) mod tensor;
#[cfg(feature = "import-images")]
mod turned;
#[cfg(feature = "import-images")]
mod ubo2003;
#[cfg(feature = "import-bonn")]
pub(crate) mod ubo2014;
#[cfg(feature = "import-brdf")]
mod utia;

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use opened::Opened;

pub use named::{analytic, in_scene, is_model, locate, open_material};

use crate::btf::{BtfMeta, BtfSource, Cosine, Origin};
use crate::codec::CompressedBtf;
use crate::color::Encoding;
use crate::material::{Brdf, Interpolation, Material, PagedBtf, RawBtf};
use crate::memory::Memory;
use crate::params::{Given, Param, Values};
use crate::progress::Progress;
use crate::{Error, Result};

/// Every importer; the first that recognises a file reads it.
pub const IMPORTERS: &[&dyn Importer] = &[
    // before other files of that ending
    &factored::Factored,
    &loden::Loden,
    #[cfg(feature = "import-brdf")]
    &carrier::Carrier,
    &raw::Raw,
    #[cfg(feature = "import-bonn")]
    &ubo2014::Ubo2014,
    #[cfg(feature = "import-images")]
    &images::Images,
    #[cfg(feature = "import-brdf")]
    &rgl::Rgl,
    #[cfg(feature = "import-brdf")]
    &kaist::Kaist,
    #[cfg(feature = "import-brdf")]
    &merl::Merl,
    #[cfg(feature = "import-brdf")]
    &mit::Mit,
    #[cfg(feature = "import-brdf")]
    &utia::Utia,
    #[cfg(feature = "import-brdf")]
    &astm::Astm,
    #[cfg(feature = "import-brdf")]
    &alta::Alta,
    #[cfg(feature = "import-brdf")]
    &curet::Curet,
    #[cfg(feature = "import-images")]
    &rti::Rti,
    #[cfg(feature = "import-brdf")]
    &cornell::Cornell,
    #[cfg(feature = "import-images")]
    &curet_images::CuretImages,
    // any zip or folder
    #[cfg(feature = "import-images")]
    &ubo2003::Ubo2003,
];

/// Reads one format.
pub trait Importer: Sync {
    /// The user's word for the format.
    fn name(&self) -> &'static str;

    /// One sentence for the reference page.
    fn doc(&self) -> &'static str;

    /// Whether the file or folder `path` is of this format, judged by its content.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read.
    fn recognises(&self, path: &Path) -> Result<bool>;

    /// Parameter table of its options: conventions that files of the format may leave unstated.
    fn params(&self) -> &'static [Param] {
        &[]
    }

    /// Opens the file or folder `path` with options of the table [`Importer::params`]. Images may be
    /// decoded later, on demand.
    ///
    /// # Errors
    /// If the file contradicts its format.
    fn open(&self, path: &Path, options: &Values) -> Result<Measured>;

    /// All files of the measurement `path`: the file itself or those in the folder, and others that belong to it.
    ///
    /// # Errors
    /// If they cannot be listed.
    fn files(&self, path: &Path) -> Result<Vec<PathBuf>> {
        crate::input::files_of(path)
    }
}

/// The measured material in a file.
#[derive(Clone)]
pub enum Measured {
    /// Images for pairs of directions.
    Btf(Arc<dyn BtfSource>),
    /// A compressed BTF, evaluated from its compressed form.
    Compressed(Arc<CompressedBtf>),
    /// Reflectance without texture.
    Brdf(Arc<dyn Brdf>),
}

impl Measured {
    /// Its images, decoded from compressed ones.
    ///
    /// # Errors
    /// The BRDF if it is one: it has no images.
    pub fn images(self) -> std::result::Result<Arc<dyn BtfSource>, Arc<dyn Brdf>> {
        match self {
            Self::Btf(source) => Ok(source),
            Self::Compressed(compressed) => Ok(compressed),
            Self::Brdf(brdf) => Err(brdf),
        }
    }

    /// The material for rendering. A compressed BTF is evaluated by its decoder.
    ///
    /// # Errors
    /// Errors of reading the images; [`Error::Parameter`] if the directions do not suit the scheme of the interpolation.
    pub fn material(self, interpolation: impl Into<Interpolation>) -> Result<Arc<dyn Material>> {
        match self {
            Self::Brdf(brdf) => Ok(brdf),
            Self::Compressed(compressed) => compressed.material(interpolation),
            Self::Btf(source) => Ok(Arc::new(RawBtf::new(source, interpolation)?)),
        }
    }

    /// The material for rendering within an amount of memory: as [`Measured::material`] unless the decoded images of a BTF
    /// are more than that, then a [`PagedBtf`] with its file in `folder`, which is also returned by itself.
    ///
    /// # Errors
    /// As [`Measured::material`] and [`PagedBtf::new`].
    pub fn material_within(
        self,
        interpolation: Interpolation,
        place: Option<(Memory, &Path)>,
        progress: &dyn Progress,
    ) -> Result<BoundedMaterial> {
        match (self, place) {
            (Self::Btf(source), Some((memory, folder))) if decoded_bytes(source.meta()) > memory.0 => {
                let paged = Arc::new(PagedBtf::new(source.as_ref(), interpolation, memory, folder, progress)?);
                Ok(BoundedMaterial { material: paged.clone(), paged: Some(paged) })
            }
            (measured, _) => Ok(BoundedMaterial { material: measured.material(interpolation)?, paged: None }),
        }
    }

    /// What was assumed on reading it, a sentence each.
    pub fn warnings(&self) -> Vec<String> {
        match self {
            Self::Btf(source) => source.warnings().to_vec(),
            Self::Compressed(compressed) => compressed.warnings().to_vec(),
            Self::Brdf(brdf) => brdf.notes().warnings.to_vec(),
        }
    }
}

/// A material that stays within an amount of memory: [`Measured::material_within`].
pub struct BoundedMaterial {
    /// The material.
    pub material: Arc<dyn Material>,
    /// The same material, if its images are paged from a temporary file.
    pub paged: Option<Arc<PagedBtf>>,
}

/// Bytes of all images in memory.
fn decoded_bytes(meta: &BtfMeta) -> u64 {
    (meta.pairs() * meta.image_len() * meta.sample_type.bytes()) as u64
}

crate::params! {
    /// Conventions of stored values that the files of a BTF may leave unstated; `None` takes the format's default.
    #[derive(Copy)]
    struct Conventions {
        /// Encoding of the stored values; by default what the files state, else sRGB for 8-bit pictures and linear light
        /// for the rest.
        encoding: Option<Encoding>,
        /// Whether the light's cosine is in the stored values; by default what the files state, else included.
        cosine: Option<Cosine>,
    }
}

impl Conventions {
    /// What to say about conventions that files of a format do not state.
    fn reasons(&self, encoding: &str, cosine: &str) -> Vec<(&'static str, String)> {
        let reason = |given: bool, default: &str| if given { "as asked for".to_owned() } else { default.to_owned() };
        vec![
            ("why_encoding", reason(self.encoding.is_some(), encoding)),
            ("why_cosine", reason(self.cosine.is_some(), cosine)),
        ]
    }
}

/// Opens a BTF of any known format.
///
/// # Errors
/// As [`open_named`]; [`Error::Unsupported`] if the file holds a BRDF.
pub fn open(path: impl AsRef<Path>, options: &Given) -> Result<Arc<dyn BtfSource>> {
    let (importer, measured) = open_named(&path, options)?;
    measured.images().map_err(|_| {
        let problem = format!("{} holds a BRDF, a BTF is needed here", importer.name());
        Error::unsupported(path.as_ref(), problem)
    })
}

/// Opens a file or folder of any known format, or an entry of a library; also returns the importer that recognised it.
///
/// # Errors
/// As [`recognise`]; [`Error::Parameter`] for an option that the importer does not have; errors of the importer.
pub fn open_named(path: impl AsRef<Path>, options: &Given) -> Result<(&'static dyn Importer, Measured)> {
    let path = locate(path.as_ref())?;
    let importer = recognise(&path)?;
    Ok((importer, open_as(importer, &path, options)?))
}

/// Opens what [`BtfSource::origin`] describes.
///
/// # Errors
/// [`Error::Parameter`] if there is no importer of that name, or it lacks one of the options; errors of the importer.
pub fn reopen(origin: &Origin) -> Result<Measured> {
    let unknown = || Error::parameter("importer", format!("found {:?}, expected one of {}", origin.importer, names()));
    let importer = IMPORTERS.iter().find(|importer| importer.name() == origin.importer).ok_or_else(unknown)?;
    open_as(*importer, &origin.path, &origin.options)
}

/// The importer of a file or folder.
///
/// # Errors
/// [`Error::Unsupported`] naming the known formats if none recognises it; [`Error::Io`].
pub fn recognise(path: impl AsRef<Path>) -> Result<&'static dyn Importer> {
    let path = path.as_ref();
    std::fs::metadata(path).map_err(Error::io(path))?;
    for importer in IMPORTERS {
        if importer.recognises(path)? {
            return Ok(*importer);
        }
    }
    Err(Error::unsupported(path, format!("not recognised as any of: {}", names())))
}

fn names() -> String {
    IMPORTERS.iter().map(|importer| importer.name()).collect::<Vec<_>>().join(", ")
}

/// Opens a measurement by this importer; its images keep their origin.
fn open_as(importer: &dyn Importer, path: &Path, options: &Given) -> Result<Measured> {
    let measured = importer.open(path, &options.values(importer.params())?)?;
    let Measured::Btf(source) = measured else { return Ok(measured) };
    let path = std::path::absolute(path).map_err(Error::io(path))?;
    let origin = Origin { path, importer: importer.name().into(), options: options.clone() };
    let files = importer.files(&origin.path)?;
    Ok(Measured::Btf(Arc::new(Opened { source, origin, files, identity: OnceLock::new() })))
}

/// A closure for `map_err` that attaches the file to a wrong parameter.
fn located(path: &Path) -> impl FnOnce(Error) -> Error {
    move |error| match error {
        Error::Parameter { name, problem } => Error::invalid(path, name, problem),
        other => other,
    }
}

/// The first bytes of a file, at most `count`; empty for a folder.
fn head(path: &Path, count: u64) -> Result<Vec<u8>> {
    use std::io::Read;
    let mut bytes = Vec::new();
    if !path.is_dir() {
        let file = std::fs::File::open(path).map_err(Error::io(path))?;
        file.take(count).read_to_end(&mut bytes).map_err(Error::io(path))?;
    }
    Ok(bytes)
}
