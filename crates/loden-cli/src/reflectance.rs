//! What commands about BRDFs take: a file, or a model with its parameters.

use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use loden::Error;
use loden::direction::{self, Scheme, from_angles};
use loden::import;
use loden::material::{Brdf, BrdfSample, TabulatedBrdf};
use loden::model::{self, Analytic};
use loden::params::Values;

use crate::flags::Assumptions;
use crate::terminal::Terminal;

/// Opens a BRDF, the average of a BTF, or a model: `ward`, or `ward:alpha-x=0.1:kd=0.2,0.1,0`.
pub fn open(source: &str, assumptions: &Assumptions, terminal: &Terminal) -> anyhow::Result<Arc<dyn Brdf>> {
    if !Path::new(source).exists() && model::by_name(model_name(source)).is_ok() {
        let mut parts = source.split(':');
        let name = parts.next().unwrap_or_default();
        let settings: Vec<Setting> = parts.map(str::parse).collect::<Result<_, _>>().map_err(anyhow::Error::msg)?;
        return Ok(Arc::new(analytic(name, &settings)?));
    }
    match import::open_named(source, &assumptions.options())?.1.images() {
        Err(brdf) => Ok(brdf),
        Ok(btf) => {
            terminal.warn(btf.warnings());
            Ok(Arc::new(TabulatedBrdf::average(btf.as_ref(), Scheme::Triangles, terminal)?))
        }
    }
}

/// As [`open`]; of a file of several materials all of them, unless one is asked for.
pub fn open_all(source: &str, given: &Assumptions, terminal: &Terminal) -> anyhow::Result<Vec<Arc<dyn Brdf>>> {
    let first = open(source, given, terminal)?;
    let fact = first.notes().facts.iter().find(|(name, _)| *name == "materials");
    match fact.and_then(|(_, count)| count.parse().ok()) {
        Some(count) if given.index.is_none() => {
            (1..=count).map(|n| open(source, &Assumptions { index: Some(n), ..*given }, terminal)).collect()
        }
        _ => Ok(vec![first]),
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
    Analytic::new(model, Values::new(model.params(), given)?)
}

/// Samples of a .csv file: theta_i, phi_i, theta_o, phi_o in degrees, r, g, b in 1/sr.
pub fn read_samples(path: &Path) -> loden::Result<Vec<BrdfSample>> {
    let sample = |row: Vec<f64>| {
        let direction = |t: f64, p: f64| from_angles(t.to_radians() as f32, p.to_radians() as f32);
        let value = Vec3::new(row[4] as f32, row[5] as f32, row[6] as f32);
        BrdfSample { wi: direction(row[0], row[1]), wo: direction(row[2], row[3]), value }
    };
    Ok(read_csv(path, 7)?.into_iter().map(sample).collect())
}

/// What [`read_samples`] reads.
pub fn samples_as_csv(samples: &[BrdfSample]) -> String {
    let mut text = String::from("theta_i,phi_i,theta_o,phi_o,r,g,b\n");
    for s in samples {
        let [i, o] = [s.wi, s.wo].map(|w| [direction::theta(w).to_degrees(), direction::phi(w).to_degrees()]);
        // writing to a string cannot fail
        let _ = writeln!(text, "{},{},{},{},{},{},{}", i[0], i[1], o[0], o[1], s.value.x, s.value.y, s.value.z);
    }
    text
}

/// Rows of `columns` numbers; a first row of names is passed over.
pub fn read_csv(path: &Path, columns: usize) -> loden::Result<Vec<Vec<f64>>> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let mut rows = Vec::new();
    for (line, row) in text.lines().enumerate().filter(|(_, row)| !row.trim().is_empty()) {
        let numbers: Option<Vec<f64>> = row.split(',').map(|cell| cell.trim().parse().ok()).collect();
        match numbers {
            Some(numbers) if numbers.len() == columns && numbers.iter().all(|v| v.is_finite()) => rows.push(numbers),
            None if line == 0 => {}
            _ => {
                let problem = format!("found {row:?}, expected {columns} numbers with commas");
                return Err(Error::invalid(path, format!("line {}", line + 1), problem));
            }
        }
    }
    Ok(rows)
}
