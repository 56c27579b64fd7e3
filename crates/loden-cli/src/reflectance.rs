//! What commands about BRDFs take: a file, or a model with its parameters.

use std::path::Path;
use std::sync::Arc;

use loden::direction::Scheme;
use loden::import::{self, Measured};
use loden::material::{MeasuredBrdf, TabulatedBrdf};
use loden::model::{self, Analytic};
use loden::params::Values;

use crate::flags::Assumptions;
use crate::terminal::Terminal;

/// Opens a BRDF, the average of a BTF, or a model: `ward`, or `ward:alpha-x=0.1:kd=0.2,0.1,0`.
pub fn open(source: &str, assumptions: &Assumptions, terminal: &Terminal) -> anyhow::Result<Arc<dyn MeasuredBrdf>> {
    if !Path::new(source).exists() && model::by_name(model_name(source)).is_ok() {
        let mut parts = source.split(':');
        let name = parts.next().unwrap_or_default();
        let settings: Vec<Setting> = parts.map(str::parse).collect::<Result<_, _>>().map_err(anyhow::Error::msg)?;
        return Ok(Arc::new(analytic(name, &settings)?));
    }
    match import::open_named(source, &assumptions.options())?.1 {
        Measured::Brdf(brdf) => Ok(brdf),
        Measured::Btf(btf) => {
            terminal.warn(btf.warnings());
            Ok(Arc::new(TabulatedBrdf::average(btf.as_ref(), Scheme::Triangles, terminal)?))
        }
    }
}

fn model_name(source: &str) -> &str {
    source.split(':').next().unwrap_or_default()
}

/// What to call a source in a table or legend.
pub fn label(source: &str) -> String {
    let path = Path::new(source);
    let stem = path.file_stem().filter(|_| path.exists()).and_then(|stem| stem.to_str());
    stem.unwrap_or(source).to_owned()
}

/// A parameter given as `name=value`.
#[derive(Debug, Clone)]
pub struct Setting {
    pub name: String,
    pub value: String,
}

impl std::str::FromStr for Setting {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = text.split_once('=').ok_or_else(|| format!("found {text:?}, expected name=value"))?;
        Ok(Self { name: name.trim().into(), value: value.trim().into() })
    }
}

/// The model of this name with these parameters.
pub fn analytic(name: &str, settings: &[Setting]) -> loden::Result<Analytic> {
    let model = model::by_name(name)?;
    let given = settings.iter().map(|s| (s.name.as_str(), s.value.as_str()));
    Ok(Analytic::new(model, Values::new(model.params(), given)?))
}
