//! The stored form of a factored BRDF: all that its evaluation needs, in one file.
//!
//! # Format
//! A safetensors file. The metadata entry `loden_brdf` is a JSON object: `version` (1), `source`, `method`, `params`,
//! `mean_rel_error` and `rmse` of the factorisation, and `form`. The form `product` lists steps, each with the
//! `projections` (light, view, half, difference) of the two tables of its products and the number of its `terms`; the form
//! `exponential` has `scale`, `floor` and `factors`, pairs of a projection and the index of its table. The tensors `table-1`,
//! `table-2` ... are the tables in that order, single precision, of shape (texels per side, texels per side, 3).

use std::collections::HashMap;
use std::path::Path;

use glam::Vec3;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::pairs;
use super::tables::{Factored, Grid, ProductSum, Projection};
use crate::input;
use crate::material::{BrdfSample, Material, Promises, Table};
use crate::output::write_file;
use crate::{Error, Result};

/// The metadata entry that describes a factored BRDF.
const KEY: &str = "loden_brdf";

/// What the header of a factored BRDF has: the name of its metadata entry, in quotes.
pub const MARK: &str = "\"loden_brdf\"";

/// The version of the format that is written.
const VERSION: u32 = 1;

/// Largest number of texels per side of a stored table.
const LARGEST: usize = 1024;

/// Largest number of tables in a file.
const MOST_TABLES: usize = 4096;

/// Number of samples that stand for a factored BRDF.
const SAMPLES: usize = 20_000;

/// How a factored BRDF was made.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Making {
    /// The BRDF that was factored, as the user named it.
    pub source: String,
    /// The factorisation.
    pub method: String,
    /// Its parameters: `name=value`, with spaces between.
    pub params: String,
    /// [`super::Report::mean_rel_error`].
    pub mean_rel_error: f64,
    /// [`super::Report::rmse`].
    pub rmse: f64,
}

#[derive(Serialize, Deserialize)]
struct Description {
    version: u32,
    #[serde(flatten)]
    making: Making,
    form: Form,
}

/// A [`Factored`] without its tables.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Form {
    Product(Vec<Step>),
    Exponential { scale: [f32; 3], floor: f32, factors: Vec<(Projection, usize)> },
}

#[derive(Serialize, Deserialize)]
struct Step {
    projections: [Projection; 2],
    terms: usize,
}

/// Writes a factored BRDF into the file `path`.
///
/// # Errors
/// [`Error::Io`]; no partial file is left.
pub fn write(factored: &Factored, making: &Making, path: &Path) -> Result<()> {
    let form = match factored {
        Factored::Product(steps) => {
            let step = |step: &ProductSum| Step { projections: step.projections, terms: step.terms.len() };
            Form::Product(steps.iter().map(step).collect())
        }
        Factored::Exponential { scale, floor, factors, .. } => {
            Form::Exponential { scale: scale.to_array(), floor: *floor, factors: factors.clone() }
        }
    };
    let wrong = |problem: String| Error::invalid(path, KEY, problem);
    let description = Description { version: VERSION, making: making.clone(), form };
    let text = serde_json::to_string(&description).map_err(|e| wrong(e.to_string()))?;
    let tables: Vec<(usize, Vec<u8>)> = factored
        .tables()
        .iter()
        .map(|grid| (grid.size, grid.texels.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect()))
        .collect();
    let views = tables.iter().enumerate().map(|(k, (size, bytes))| {
        let view = TensorView::new(Dtype::F32, vec![*size, *size, 3], bytes);
        view.map(|view| (name(k), view)).map_err(|e| wrong(e.to_string()))
    });
    let views: Vec<_> = views.collect::<Result<_>>()?;
    let metadata = HashMap::from([(KEY.to_owned(), text)]);
    let bytes = safetensors::serialize(views, Some(metadata)).map_err(|e| wrong(e.to_string()))?;
    write_file(path, |file| file.write_all(&bytes))
}

/// Reads what [`write()`] wrote.
///
/// # Errors
/// [`Error::Invalid`] naming the entry or table that is wrong; [`Error::Unsupported`] for a later version; [`Error::Io`].
pub fn read(path: &Path) -> Result<(Factored, Making)> {
    let map = input::map(path)?;
    let header = |e: safetensors::SafeTensorError| Error::invalid(path, "header", e.to_string());
    let (_, metadata) = SafeTensors::read_metadata(&map).map_err(header)?;
    let text = metadata.metadata().as_ref().and_then(|entries| entries.get(KEY));
    let text = text.ok_or_else(|| Error::invalid(path, KEY, "this metadata entry is missing"))?;
    let wrong = |problem: String| Error::invalid(path, KEY, problem);
    let Description { version, making, form } = serde_json::from_str(text).map_err(|e| wrong(e.to_string()))?;
    if version != VERSION {
        let what = format!("version {version} of factored BRDFs; this program reads version {VERSION}");
        return Err(Error::unsupported(path, what));
    }
    let tensors = SafeTensors::deserialize(&map).map_err(header)?;
    let reader = Reader { path, tensors };
    Ok((reader.factored(form)?, making))
}

/// The name of the tensor of a table, counted from 1.
fn name(table: usize) -> String {
    format!("table-{}", table + 1)
}

struct Reader<'a> {
    path: &'a Path,
    tensors: SafeTensors<'a>,
}

impl Reader<'_> {
    fn factored(&self, form: Form) -> Result<Factored> {
        let wrong = |problem: String| Error::invalid(self.path, KEY, problem);
        match form {
            Form::Product(steps) => {
                let count = steps.iter().map(|step| step.terms.saturating_mul(2)).fold(0, usize::saturating_add);
                if steps.is_empty() || steps.iter().any(|step| step.terms == 0) || count > MOST_TABLES {
                    return Err(wrong(format!("found {} steps with {count} tables", steps.len())));
                }
                let mut next = 0..count;
                let mut table = || self.table(next.next().unwrap_or_default());
                let read = |step: Step| {
                    let terms = (0..step.terms).map(|_| Ok([table()?, table()?])).collect::<Result<_>>()?;
                    Ok(ProductSum { projections: step.projections, terms })
                };
                Ok(Factored::Product(steps.into_iter().map(read).collect::<Result<_>>()?))
            }
            Form::Exponential { scale, floor, factors } => {
                let count = factors.iter().map(|(_, table)| table.saturating_add(1)).max().unwrap_or(0);
                if !(1..=MOST_TABLES).contains(&count) {
                    return Err(wrong(format!("found factors with {count} tables, expected 1 to {MOST_TABLES}")));
                }
                let scale = Vec3::from(scale);
                if !(scale.is_finite() && floor.is_finite()) {
                    return Err(wrong(format!("found the scale {scale} and the floor {floor}")));
                }
                let tables = (0..count).map(|k| self.table(k)).collect::<Result<_>>()?;
                Ok(Factored::Exponential { scale, floor, factors, tables })
            }
        }
    }

    fn table(&self, k: usize) -> Result<Grid> {
        let wrong = |problem: String| Error::invalid(self.path, name(k), problem);
        let tensor = self.tensors.tensor(&name(k)).map_err(|_| wrong("this table is missing".into()))?;
        let (shape, dtype) = (tensor.shape(), tensor.dtype());
        let [size, other, 3] = *shape else { return Err(wrong(format!("found the shape {shape:?}"))) };
        if dtype != Dtype::F32 || size != other || !(2..=LARGEST).contains(&size) {
            return Err(wrong(format!("found {dtype:?} numbers of the shape {shape:?}, expected F32, a square, 3")));
        }
        let numbers: Vec<f32> = tensor.data().as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        // larger numbers, or their exponentials, would not stay finite in products
        match numbers.iter().find(|v| !v.is_finite() || v.abs() > 1e12) {
            Some(v) => Err(wrong(format!("found {v}, expected finite numbers up to 1e12"))),
            None => Ok(Grid { size, texels: numbers.as_chunks().0.iter().copied().map(Vec3::from_array).collect() }),
        }
    }
}

impl Table for Factored {
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3 {
        // exponentials of a damaged file may be infinite
        self.eval(glam::Vec2::ZERO, wi, wo).min(Vec3::splat(f32::MAX))
    }

    /// The values at evenly spread pairs of directions.
    fn samples(&self) -> Vec<BrdfSample> {
        pairs(SAMPLES).map(|(wi, wo)| BrdfSample { wi, wo, value: self.value(wi, wo) }).collect()
    }

    fn promises(&self) -> Promises {
        Promises::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Analytic, by_name};
    use crate::params::Values;
    use crate::progress::Silent;
    use crate::separable::FACTORISATIONS;
    use glam::Vec2;

    #[test]
    fn every_factorisation_is_the_same_material_when_read_again() {
        let model = by_name("ward").unwrap();
        let brdf = Analytic::new(model, Values::new(model.params(), [("alpha-x", "0.3")]).unwrap()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for method in FACTORISATIONS {
            let path = folder.path().join(method.name());
            let values = Values::new(method.params(), [("resolution", "6")]).unwrap();
            let factored = method.factor(&brdf, &values, &Silent).unwrap();
            let making = Making { method: method.name().into(), rmse: 0.25, ..Making::default() };
            write(&factored, &making, &path).unwrap();
            let (back, found) = read(&path).unwrap();
            assert_eq!((&back, &found), (&factored, &making));
            for (wi, wo) in pairs(100) {
                assert_eq!(back.eval(Vec2::ZERO, wi, wo), factored.eval(Vec2::ZERO, wi, wo));
            }
        }
    }

    #[test]
    fn wrong_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.loden");
        let grid = |value: f32| Grid::filled(2, Vec3::splat(value));
        let product = |value: f32| {
            let projections = [Projection::Light, Projection::View];
            Factored::Product(vec![ProductSum { projections, terms: vec![[grid(1.0), grid(value)]] }])
        };
        let error = |factored: &Factored| {
            write(factored, &Making::default(), &path).unwrap();
            read(&path).unwrap_err().to_string()
        };
        assert!(error(&product(f32::NAN)).contains("table-2: found NaN"));
        assert!(error(&Factored::Product(Vec::new())).contains("loden_brdf: found 0 steps"));
        let lacks = Factored::Exponential {
            scale: Vec3::ONE,
            floor: 0.0,
            factors: vec![(Projection::Half, 3)],
            tables: vec![grid(0.0)],
        };
        assert!(error(&lacks).contains("table-2: this table is missing"));
        write(&product(1.0), &Making::default(), &path).unwrap();
        let later = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).replace("version\\\":1", "version\\\":7");
        std::fs::write(&path, later.as_bytes()).unwrap();
        assert!(read(&path).is_err());
    }
}
