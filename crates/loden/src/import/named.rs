//! What the name of a material stands for: a file or folder, an entry of a library, or a model with its parameters.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use super::raw::read_toml;
use super::{Measured, open_as, recognise};
use crate::model::{self, Analytic};
use crate::params::{Given, Values};
use crate::{Error, Result};

/// The description in the folder of an entry.
const ENTRY: &str = "material.toml";

/// What of the description matters here.
#[derive(Deserialize)]
struct Entry {
    original: PathBuf,
}

/// The measurement that a path stands for: of an entry of a library, such as `library/wool`, the original.
///
/// # Errors
/// [`Error::Invalid`] naming the line of a damaged description.
pub fn locate(path: &Path) -> Result<Cow<'_, Path>> {
    let description = path.join(ENTRY);
    if !description.is_file() {
        return Ok(Cow::Borrowed(path));
    }
    let Entry { original } = read_toml(&description)?;
    Ok(Cow::Owned(path.join(original)))
}

/// Whether a name that is no file is that of a model, with or without parameters.
pub fn is_model(name: &Path) -> bool {
    specification(name).is_some()
}

/// The name of a material of a scene, which stands for the file `resolved` unless it is that of a model.
pub fn in_scene(name: &Path, resolved: PathBuf) -> PathBuf {
    if resolved.exists() || !is_model(name) { resolved } else { name.into() }
}

/// Opens a file or folder of any known format, an entry of a library, or a model such as `ward` or
/// `ward:alpha-x=0.1:kd=0.2,0.1,0`. A file comes before a model of the same name. Also returns the name of the format or
/// of the model.
///
/// # Errors
/// As [`super::open_named`]; [`Error::Parameter`] for parameters that the model refuses.
pub fn open_material(name: impl AsRef<Path>, options: &Given) -> Result<(&'static str, Measured)> {
    let name = name.as_ref();
    if let Some(brdf) = analytic(name)? {
        return Ok((brdf.model().name(), Measured::Brdf(Arc::new(brdf))));
    }
    let path = locate(name)?;
    let importer = recognise(&path)?;
    Ok((importer.name(), open_as(importer, &path, options)?))
}

/// The model that a name such as `ward:alpha-x=0.1` stands for; `None` for a name of something else.
///
/// # Errors
/// [`Error::Parameter`] for parameters that the model refuses.
pub fn analytic(name: &Path) -> Result<Option<Analytic>> {
    let Some((model, settings)) = specification(name) else { return Ok(None) };
    let model = model::by_name(model)?;
    let pair = |text: &'_ str| match text.split_once('=') {
        Some((name, value)) => Ok((name.trim().to_owned(), value.trim().to_owned())),
        None => Err(Error::parameter(text, "expected name=value")),
    };
    let pairs = settings.map(pair).collect::<Result<Vec<_>>>()?;
    let given = pairs.iter().map(|(name, value)| (name.as_str(), value.as_str()));
    Analytic::new(model, Values::new(model.params(), given)?).map(Some)
}

/// The model that a name starts with, and the settings after it; none if there is such a file.
fn specification(name: &Path) -> Option<(&str, impl Iterator<Item = &str>)> {
    let mut parts = name.to_str()?.split(':');
    let model = parts.next().filter(|model| model::by_name(model).is_ok() && !name.exists())?;
    Some((model, parts))
}
