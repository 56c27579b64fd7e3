//! BTFs whose images a Python object gives: importers and codecs that are written in Python.

use std::borrow::Cow;
use std::sync::Arc;

use loden::btf::{BtfMeta, BtfSource, Cosine, SampleType, Texels};
use loden::color::Encoding;
use loden::{Error, Result};
use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::btf::{Btf, set};
use crate::errors::{raise, wrong};

/// An object with `views` and `lights` (angles in degrees, shape (n, 2)) and `image(view, light)`, which returns (rows,
/// columns, 3) numbers. It may have `encoding` ("linear" by default), `cosine` ("included") and `nbytes`.
pub(crate) struct Foreign {
    object: Py<PyAny>,
    meta: BtfMeta,
    bytes: u64,
}

/// The BTF that an argument stands for: a `Btf`, or an object as of [`Foreign`]. None for a path.
pub(crate) fn source(argument: &Bound<'_, PyAny>) -> PyResult<Option<(String, Arc<dyn BtfSource>)>> {
    let name = || Ok::<_, PyErr>(argument.get_type().name()?.to_string());
    if let Ok(btf) = argument.cast::<Btf>() {
        return Ok(Some((name()?, btf.get().source.clone())));
    }
    if !argument.hasattr("image")? {
        return Ok(None);
    }
    Ok(Some((name()?, Arc::new(Foreign::new(argument)?))))
}

impl Foreign {
    fn new(object: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = object.py();
        let directions = |name: &str| {
            let degrees = object.getattr(name)?;
            let count = degrees.len()?;
            set(py, name, &degrees, count)
        };
        let (views, lights) = (directions("views")?, directions("lights")?);
        let (shape, _) = image(object, 0, 0)?;
        let text = |name: &str, default: &str| match object.getattr_opt(name)? {
            Some(found) => found.extract::<String>(),
            None => Ok(default.to_owned()),
        };
        let encoding: Encoding = text("encoding", "linear")?.parse().map_err(|error| raise(py, &error))?;
        let cosine = text("cosine", Cosine::Included.name())?;
        let cosine = [Cosine::Included, Cosine::Excluded].into_iter().find(|one| one.name() == cosine);
        let cosine = cosine.ok_or_else(|| wrong(py, "cosine", "expected included or excluded"))?;
        let meta = BtfMeta {
            width: shape[1],
            height: shape[0],
            views,
            lights,
            encoding,
            cosine,
            sample_type: SampleType::F32,
        };
        let bytes = match object.getattr_opt("nbytes")? {
            Some(found) => found.extract()?,
            None => (4 * meta.image_len() * meta.pairs()) as u64,
        };
        Ok(Self { object: object.clone().unbind(), meta, bytes })
    }

    fn numbers(&self, view: usize, light: usize) -> Result<Vec<f32>> {
        Python::attach(|py| {
            let failed = |error: PyErr| Error::parameter("image", format!("view {view}, light {light}: {error}"));
            let (shape, values) = image(self.object.bind(py), view, light).map_err(failed)?;
            if shape != [self.meta.height, self.meta.width, 3] {
                let [rows, columns] = [self.meta.height, self.meta.width];
                let problem =
                    format!("view {view}, light {light}: found the shape {shape:?}, expected [{rows}, {columns}, 3]");
                return Err(Error::parameter("image", problem));
            }
            match values.iter().position(|value| !value.is_finite()) {
                Some(_) => Err(Error::parameter("image", format!("view {view}, light {light}: not finite"))),
                None => Ok(values),
            }
        })
    }
}

/// Shape and numbers of an image.
fn image(object: &Bound<'_, PyAny>, view: usize, light: usize) -> PyResult<(Vec<usize>, Vec<f32>)> {
    let py = object.py();
    let found = object.call_method1("image", (view, light))?;
    let array = py.import("numpy")?.call_method1("ascontiguousarray", (found, "float32"))?;
    let array = array.cast::<PyArrayDyn<f32>>()?.readonly();
    let shape = array.shape().to_vec();
    if shape.len() != 3 || shape[2] != 3 {
        return Err(wrong(py, "image", format!("found the shape {shape:?}, expected (rows, columns, 3)")));
    }
    Ok((shape, array.as_slice()?.to_vec()))
}

impl BtfSource for Foreign {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        let mut all = Vec::with_capacity(self.meta.view_len());
        for light in 0..self.meta.lights.len() {
            all.extend(self.numbers(view, light)?);
        }
        Ok(Texels::F32(Cow::Owned(all)))
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        Ok(Texels::F32(Cow::Owned(self.numbers(view, light)?)))
    }

    fn source_bytes(&self) -> u64 {
        self.bytes
    }
}
