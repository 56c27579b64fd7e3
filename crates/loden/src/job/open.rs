//! Opening whatever a user names: a file, a folder, or an analytic model with its parameters.

use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;

use crate::btf::BtfSource;
use crate::direction::Scheme;
use crate::import::{self, Measured};
use crate::material::{Brdf, TabulatedBrdf};
use crate::model::{self, Analytic};
use crate::params::{Given, Values};
use crate::progress::Progress;
use crate::{Error, Result};

/// What a name stands for.
pub struct Opened {
    /// A short name for tables and legends.
    pub label: String,
    /// The format of the file, or the name of the model.
    pub kind: &'static str,
    /// The content.
    pub measured: Measured,
}

/// Opens a material by its name as [`import::open_material`]. What was assumed on reading goes to [`Progress::warn`].
///
/// # Errors
/// As [`import::open_material`].
pub fn open(name: impl AsRef<Path>, options: &Given, progress: &dyn Progress) -> Result<Opened> {
    let path = name.as_ref();
    let (kind, measured) = import::open_material(path, options)?;
    measured.warnings().iter().for_each(|warning| progress.warn(warning));
    Ok(Opened { label: label(path), kind, measured })
}

/// A short name of a material: of a file without its folder and ending.
pub(super) fn label(name: &Path) -> String {
    let label = if import::is_model(name) { name.as_os_str() } else { name.file_stem().unwrap_or(name.as_os_str()) };
    label.to_string_lossy().into_owned()
}

/// Opens a BTF, compressed or not.
///
/// # Errors
/// As [`open()`]; [`Error::Unsupported`] if the name stands for a BRDF.
pub fn open_btf(name: impl AsRef<Path>, options: &Given, progress: &dyn Progress) -> Result<Arc<dyn BtfSource>> {
    let opened = open(&name, options, progress)?;
    opened.measured.images().map_err(|_| {
        let problem = format!("{} holds a BRDF, a BTF is needed here", opened.kind);
        Error::unsupported(name.as_ref(), problem)
    })
}

/// As [`open()`], of one of several sources: it takes the options that its format has and ignores the others.
///
/// # Errors
/// As [`open()`].
pub fn open_among(name: impl AsRef<Path>, options: &Given, progress: &dyn Progress) -> Result<Opened> {
    let path = name.as_ref();
    let known = if path.exists() { import::recognise(import::locate(path)?)?.params() } else { &[] };
    open(path, &options.split(known).0, progress)
}

/// Opens a BRDF, of a BTF the average over its texels, with the options that its format has.
///
/// # Errors
/// As [`open()`] and [`TabulatedBrdf::average`].
pub fn open_brdf(name: impl AsRef<Path>, options: &Given, progress: &dyn Progress) -> Result<(String, Arc<dyn Brdf>)> {
    let Opened { label, measured, .. } = open_among(name, options, progress)?;
    let brdf = match measured.images() {
        Err(brdf) => brdf,
        Ok(btf) => Arc::new(TabulatedBrdf::average(btf.as_ref(), Scheme::Triangles, progress)?),
    };
    Ok((label, brdf))
}

/// As [`open_brdf`]; of a file with several materials all of them, unless `options` choose one.
///
/// # Errors
/// As [`open_brdf`].
pub fn open_brdfs(name: impl AsRef<Path>, options: &Given, progress: &dyn Progress) -> Result<Vec<Arc<dyn Brdf>>> {
    let (_, first) = open_brdf(&name, options, progress)?;
    let fact = first.notes().facts.iter().find(|(name, _)| *name == "materials");
    match fact.and_then(|(_, count)| count.parse::<usize>().ok()) {
        Some(count) if options.text("index").is_none() => (1..=count)
            .map(|n| Ok(open_brdf(&name, &options.clone().with("index", n.to_string()), progress)?.1))
            .collect(),
        _ => Ok(vec![first]),
    }
}

/// A parameter given as `name=value`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assignment {
    /// The parameter.
    pub name: String,
    /// Its value as text.
    pub value: String,
}

impl FromStr for Assignment {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.split_once('=') {
            Some((name, value)) => Ok(Self { name: name.trim().into(), value: value.trim().into() }),
            None => Err(Error::parameter(text, "expected name=value")),
        }
    }
}

/// The analytic model of this name with these parameters.
///
/// # Errors
/// [`Error::Parameter`] for an unknown model or parameter, or a value out of range.
pub fn analytic(name: &str, settings: &[Assignment]) -> Result<Analytic> {
    let model = model::by_name(name)?;
    let given = settings.iter().map(|s| (s.name.as_str(), s.value.as_str()));
    Analytic::new(model, Values::new(model.params(), given)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    fn opened(name: &str) -> Result<Opened> {
        open(name, &Given::default(), &Silent)
    }

    #[test]
    fn a_model_is_opened_by_its_name_and_parameters() {
        let found = opened("ward:alpha-x=0.1:kd=0.2,0.1,0").unwrap();
        assert_eq!((found.kind, found.label.as_str()), ("ward", "ward:alpha-x=0.1:kd=0.2,0.1,0"));
        let Measured::Brdf(brdf) = found.measured else { panic!("a model is a BRDF") };
        assert!(!brdf.samples().is_empty());
    }

    #[test]
    fn wrong_names_are_explained() {
        let error = |name: &str| opened(name).err().unwrap().to_string();
        assert_eq!(error("ward:alpha-x"), "alpha-x: expected name=value");
        assert!(error("ward:alpha-x=9").starts_with("alpha-x: found \"9\""));
        assert!(error("wart:alpha-x=9").starts_with("wart:alpha-x=9: "));
        let error = open_btf("ward", &Given::default(), &Silent).err().unwrap().to_string();
        assert_eq!(error, "ward: ward holds a BRDF, a BTF is needed here");
    }
}
