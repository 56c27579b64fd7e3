//! The parts of a compressed material as arrays, and back.

use std::path::PathBuf;

use loden::btf::{BtfMeta, SampleType};
use loden::codec::CompressedBtf;
use loden::codec::container::SourceInfo;
use loden::codec::parts::{self, MemoryParts, Numbers, PlaneKind, PlaneSpec, Provenance, Recipe, TableSpec};
use loden::{Error, Result};
use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};
use serde::de::DeserializeOwned;

use crate::arrays::shaped;
use crate::errors::{raise, wrong};
use crate::jobs::{check_output, to_python};
use crate::work::{How, run};

/// The parts of a material: dictionaries "btf", "recipe" and "provenance", and of arrays "planes" and "tables".
pub(crate) fn of_material<'py>(py: Python<'py>, material: &CompressedBtf) -> PyResult<Bound<'py, PyDict>> {
    let (parts, failed) = (material.parts(), |error: Error| raise(py, &error));
    let (meta, recipe) = (parts.meta(), parts.recipe());
    let (planes, tables) = (PyDict::new(py), PyDict::new(py));
    for (plane, spec) in recipe.planes.iter().enumerate() {
        let numbers = py.detach(|| parts::whole_plane(parts.as_ref(), plane)).map_err(failed)?;
        planes.set_item(&spec.name, array(py, numbers, &plane_shape(spec, meta))?)?;
    }
    for (table, spec) in recipe.tables.iter().enumerate() {
        let numbers = py.detach(|| parts.table(table)).map_err(failed)?;
        tables.set_item(&spec.name, array(py, numbers, &table_shape(spec, meta))?)?;
    }
    let all = PyDict::new(py);
    all.set_item("btf", to_python(py, meta)?)?;
    all.set_item("recipe", to_python(py, recipe)?)?;
    all.set_item("planes", planes)?;
    all.set_item("tables", tables)?;
    all.set_item("provenance", to_python(py, &material.provenance().map_err(failed)?)?)?;
    Ok(all)
}

/// Stores parts as a `.loden` file, and returns its size in bytes.
///
/// `parts` is what `Btf.parts` returns, or a dictionary made alike: "btf" (size, directions, conventions), "recipe" (planes,
/// tables and the formula; docs/format.md), "planes" and "tables" (arrays by name, of the types and shapes that the recipe
/// states). "provenance" may be left out; it should be if the material is a new one.
///
/// Raises `loden.ParameterError` naming the part that does not fit the recipe.
#[pyfunction]
#[pyo3(signature = (parts, output, *, overwrite = false))]
pub(crate) fn store_parts(
    py: Python<'_>,
    parts: &Bound<'_, PyDict>,
    output: PathBuf,
    overwrite: bool,
) -> PyResult<u64> {
    check_output(py, &output, overwrite)?;
    let meta: BtfMeta = field(parts, "btf")?;
    let recipe: Recipe = field(parts, "recipe")?;
    recipe.check(&meta).map_err(|error| raise(py, &error))?;
    let provenance = match parts.get_item("provenance")? {
        Some(_) => field(parts, "provenance")?,
        None => {
            let (bytes, sample_type) = (meta.raw8_bytes(), meta.sample_type);
            Provenance::unknown(SourceInfo { bytes, sample_type, missing: Vec::new(), identity: None })
        }
    };
    let (planes, tables) = (arrays(parts, "planes")?, arrays(parts, "tables")?);
    let plane = |spec: &PlaneSpec| numbers(&planes, &spec.name, spec.sample_type(), &plane_shape(spec, &meta));
    let table = |spec: &TableSpec| numbers(&tables, &spec.name, Some(spec.sample_type), &table_shape(spec, &meta));
    let planes = recipe.planes.iter().map(plane).collect::<PyResult<Vec<_>>>()?;
    let tables = recipe.tables.iter().map(table).collect::<PyResult<Vec<_>>>()?;
    run(py, &How::default(), |_| -> Result<u64> {
        let parts = MemoryParts::new(meta, recipe, planes, tables)?;
        parts::store(&parts, &provenance, &output)
    })
}

/// (rows, columns) of an index plane, (rows, columns, count) of numbers, with a dimension for views before them if each
/// view has its own.
fn plane_shape(spec: &PlaneSpec, meta: &BtfMeta) -> Vec<usize> {
    let views = spec.per_view().then_some(meta.views.len());
    let count = (!matches!(spec.kind, PlaneKind::Index { .. })).then_some(spec.count());
    views.into_iter().chain([meta.height, meta.width]).chain(count).collect()
}

fn table_shape(spec: &TableSpec, meta: &BtfMeta) -> Vec<usize> {
    spec.axes.iter().map(|axis| axis.len(meta)).collect()
}

fn array<'py>(py: Python<'py>, numbers: Numbers, shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
    Ok(match numbers {
        Numbers::U8(values) => shaped(py, values.to_vec(), shape)?.into_any(),
        Numbers::Index(values) => shaped(py, values.to_vec(), shape)?.into_any(),
        Numbers::F16(values) => shaped(py, values.to_vec(), shape)?.into_any(),
        Numbers::F32(values) => shaped(py, values.to_vec(), shape)?.into_any(),
    })
}

/// A dictionary as a value of the library.
fn field<T: DeserializeOwned>(parts: &Bound<'_, PyDict>, name: &str) -> PyResult<T> {
    let py = parts.py();
    let found = parts.get_item(name)?.ok_or_else(|| wrong(py, name, "is missing"))?;
    let text: String = py.import("json")?.call_method1("dumps", (found,))?.extract()?;
    serde_json::from_str(&text).map_err(|error| wrong(py, name, error.to_string()))
}

fn arrays<'py>(parts: &Bound<'py, PyDict>, name: &str) -> PyResult<Bound<'py, PyDict>> {
    let py = parts.py();
    let found = parts.get_item(name)?.ok_or_else(|| wrong(py, name, "is missing"))?;
    found.cast_into().map_err(|_| wrong(py, name, "expected a dictionary of arrays"))
}

/// The array `name` in its stored type; `None` is that of indices.
fn numbers(
    arrays: &Bound<'_, PyDict>,
    name: &str,
    sample_type: Option<SampleType>,
    shape: &[usize],
) -> PyResult<Numbers> {
    let py = arrays.py();
    let found = arrays.get_item(name)?.ok_or_else(|| wrong(py, name, "is missing"))?;
    let numpy = py.import("numpy")?;
    let array = numpy.call_method1("ascontiguousarray", (found,))?;
    let found: Vec<usize> = array.getattr("shape")?.extract()?;
    if found != shape {
        return Err(wrong(py, name, format!("found the shape {found:?}, expected {shape:?}")));
    }
    let dtype = match sample_type {
        None => "uint16",
        Some(SampleType::U8) => "uint8",
        Some(SampleType::F16) => "float16",
        Some(SampleType::F32) => "float32",
    };
    // widening is exact; anything else would lose digits in silence
    let from = array.getattr("dtype")?;
    if !numpy.call_method1("can_cast", (&from, dtype, "safe"))?.extract::<bool>()? {
        return Err(wrong(py, name, format!("found an array of {from}, expected {dtype}")));
    }
    let named = [("copy", PyBool::new(py, false))];
    let named = pyo3::types::IntoPyDict::into_py_dict(named, py)?;
    let array = array.call_method("astype", (dtype,), Some(&named))?;
    Ok(match sample_type {
        None => Numbers::Index(list::<u16>(&array)?.into()),
        Some(SampleType::U8) => Numbers::U8(list::<u8>(&array)?.into()),
        Some(SampleType::F16) => Numbers::F16(list::<half::f16>(&array)?.into()),
        Some(SampleType::F32) => Numbers::F32(list::<f32>(&array)?.into()),
    })
}

fn list<T: numpy::Element + Copy>(array: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
    let array = array.cast::<PyArrayDyn<T>>()?.readonly();
    debug_assert!(array.is_c_contiguous());
    Ok(array.as_slice()?.to_vec())
}
