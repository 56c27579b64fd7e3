//! Measurements of samples with the virtual goniometer, written to files.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use crate::acquire::{self, HeightField, SAMPLES, Solid, Specimen, maps, mesh, yarn};
use crate::btf::{BtfMeta, Cosine, SampleType, Texels};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::params::{Given, Param, Params};
use crate::progress::Progress;
use crate::{Error, Result, export};

/// A kind of sample that the virtual goniometer measures.
#[derive(Debug, Clone, Copy)]
pub struct SampleKind {
    /// The word that users type.
    pub name: &'static str,
    /// One sentence without a full stop.
    pub doc: &'static str,
    /// Its parameters.
    pub params: &'static [Param],
}

/// All samples: the built-in height fields, then those made from files and from yarns.
pub fn sample_kinds() -> Vec<SampleKind> {
    let made = [
        ("maps", "A sample made from your own height map, see --height and --albedo", maps::Options::TABLE),
        (
            "mesh",
            "A sample from a mesh file, with overhangs and holes, see --object and --albedo",
            mesh::Options::TABLE,
        ),
        ("yarn", "Cloth woven of plied yarns, which are built as geometry", yarn::Options::TABLE),
    ];
    let built_in = SAMPLES.iter().map(|sample| (sample.name(), sample.doc(), sample.params()));
    built_in.chain(made).map(|(name, doc, params)| SampleKind { name, doc, params }).collect()
}

/// Which sample to build, and from what.
#[derive(Debug, Clone)]
pub struct SampleRequest {
    /// The name of a [`SampleKind`].
    pub name: String,
    /// Parameters of the sample.
    pub params: Given,
    /// Points per side of a height field, a power of two.
    pub grid: usize,
    /// Of what is random in the sample.
    pub seed: u64,
    /// Height map of the sample `maps`.
    pub height: Option<PathBuf>,
    /// Mesh of the sample `mesh`.
    pub object: Option<PathBuf>,
    /// Albedo map of the samples `maps` and `mesh`.
    pub albedo: Option<PathBuf>,
}

impl SampleRequest {
    /// A sample with default parameters.
    pub fn new(name: impl Into<String>, seed: u64) -> Self {
        let (params, name) = (Given::default(), name.into());
        Self { name, params, grid: GRID, seed, height: None, object: None, albedo: None }
    }

    /// The file of the sample, which it needs.
    fn needed<'a>(&self, name: &str, what: &str, file: &'a Option<PathBuf>) -> Result<&'a Path> {
        let missing = || Error::parameter(name, format!("the sample `{}` needs this {what}", self.name));
        file.as_deref().ok_or_else(missing)
    }

    fn read<P: Params>(&self) -> Result<P> {
        P::from_values(&self.params.values(P::TABLE)?)
    }

    /// Builds the sample. Warnings about its files go to `progress`.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown sample, a missing file or a parameter out of range; else as the sample's own
    /// builder.
    pub fn build(&self, progress: &dyn Progress) -> Result<BuiltSample> {
        let albedo = self.albedo.as_deref();
        match self.name.as_str() {
            "maps" => {
                let height = self.needed("height", "picture", &self.height)?;
                maps::build(height, albedo, &self.read()?, self.grid).map(BuiltSample::Field)
            }
            "mesh" => {
                let object = self.needed("object", "mesh", &self.object)?;
                let (solid, warnings) = mesh::build(object, albedo, &self.read()?)?;
                warnings.iter().for_each(|warning| progress.warn(warning));
                Ok(BuiltSample::Solid(solid))
            }
            "yarn" => yarn::build(&self.read()?, self.seed).map(BuiltSample::Solid),
            name => {
                let sample = acquire::named(name).ok_or_else(|| {
                    let names = sample_kinds().iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
                    Error::parameter("SAMPLE", format!("found {name:?}, expected one of {names}"))
                })?;
                sample.build(&self.params.values(sample.params())?, self.grid, self.seed).map(BuiltSample::Field)
            }
        }
    }
}

/// A sample as it was built.
#[derive(Debug)]
pub enum BuiltSample {
    /// A height field.
    Field(HeightField),
    /// Triangles.
    Solid(Solid),
}

impl<'a> From<&'a BuiltSample> for Specimen<'a> {
    fn from(built: &'a BuiltSample) -> Self {
        match built {
            BuiltSample::Field(field) => Self::Field(field),
            BuiltSample::Solid(solid) => Self::Solid(solid),
        }
    }
}

/// Points per side of the height field of a sample, unless another number is given.
pub const GRID: usize = 512;

/// Measures a built-in sample with its default parameters on the Bonn directions.
///
/// # Errors
/// [`Error::Parameter`] for an unknown sample; else as [`measure`].
pub fn built_in(name: &str, options: &acquire::Options, output: &Path, progress: &dyn Progress) -> Result<()> {
    let sample = SampleRequest::new(name, options.seed).build(progress)?;
    measure(&sample, &DirectionSet::bonn81(), options, output, &Given::default(), progress)
}

/// Measures a sample for all pairs of the `directions` and writes the BTF in the format given by the extension of `output`.
///
/// # Errors
/// As [`acquire::acquire`] and [`export::create`].
pub fn measure<'a>(
    sample: impl Into<Specimen<'a>>,
    directions: &DirectionSet,
    options: &acquire::Options,
    output: &Path,
    pictures: &Given,
    progress: &dyn Progress,
) -> Result<()> {
    let mut writer = export::create(output, &meta(directions, directions, options), pictures)?;
    acquire::acquire(sample, directions, directions, options, progress, &mut |_, texels| {
        writer.view(&Texels::F32(Cow::Owned(texels)))
    })?;
    writer.finish()
}

/// Measures how much of each texel the sample covers, and writes it as a BTF with one light, from above: 0 in holes, 1
/// elsewhere, for all views.
///
/// # Errors
/// As [`acquire::coverage`] and [`export::create`].
pub fn coverage<'a>(
    sample: impl Into<Specimen<'a>>,
    views: &DirectionSet,
    options: &acquire::Options,
    output: &Path,
    pictures: &Given,
    progress: &dyn Progress,
) -> Result<()> {
    let above = DirectionSet::from_degrees(vec![[0.0, 0.0]])?;
    let mut writer = export::create(output, &meta(views, &above, options), pictures)?;
    acquire::coverage(sample, views, options, progress, &mut |_, texels| {
        writer.view(&Texels::F32(Cow::Owned(texels)))
    })?;
    writer.finish()
}

fn meta(views: &DirectionSet, lights: &DirectionSet, options: &acquire::Options) -> BtfMeta {
    BtfMeta {
        width: options.size,
        height: options.size,
        views: views.clone(),
        lights: lights.clone(),
        encoding: Encoding::Linear,
        cosine: Cosine::Included,
        sample_type: SampleType::F32,
    }
}
