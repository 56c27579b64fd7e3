//! Measurements of samples with the virtual goniometer, written to files.

use std::borrow::Cow;
use std::path::Path;

use crate::acquire::{self, HeightField, SAMPLES};
use crate::btf::{BtfMeta, Cosine, SampleType, Texels};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::params::{Given, Values};
use crate::progress::Progress;
use crate::{Error, Result, export};

/// Points per side of the height field of a built-in sample.
const GRID: usize = 512;

/// Measures a built-in sample with its default parameters on the Bonn directions.
///
/// # Errors
/// [`Error::Parameter`] for an unknown sample; else as [`measure`].
pub fn built_in(name: &str, options: &acquire::Options, output: &Path, progress: &dyn Progress) -> Result<()> {
    let sample = acquire::named(name).ok_or_else(|| {
        let names = SAMPLES.iter().map(|sample| sample.name()).collect::<Vec<_>>().join(", ");
        Error::parameter("SAMPLE", format!("found {name:?}, expected one of {names}"))
    })?;
    let field = sample.build(&Values::defaults(sample.params()), GRID, options.seed)?;
    measure(&field, &DirectionSet::bonn81(), options, output, &Given::default(), progress)
}

/// Measures a sample for all pairs of the `directions` and writes the BTF in the format given by the extension of `output`.
///
/// # Errors
/// As [`acquire::acquire`] and [`export::create`].
pub fn measure(
    field: &HeightField,
    directions: &DirectionSet,
    options: &acquire::Options,
    output: &Path,
    pictures: &Given,
    progress: &dyn Progress,
) -> Result<()> {
    let meta = BtfMeta {
        width: options.size,
        height: options.size,
        views: directions.clone(),
        lights: directions.clone(),
        encoding: Encoding::Linear,
        cosine: Cosine::Included,
        sample_type: SampleType::F32,
    };
    let mut writer = export::create(output, &meta, pictures)?;
    acquire::acquire(field, directions, directions, options, progress, &mut |_, texels| {
        writer.view(&Texels::F32(Cow::Owned(texels)))
    })?;
    writer.finish()
}
