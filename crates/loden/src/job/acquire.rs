//! Measurements of samples with the virtual goniometer, written to files.

use std::borrow::Cow;
use std::path::Path;

use crate::acquire::{self, SAMPLES, Specimen};
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
