//! The class `Brdf`.

use std::f32::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;
use loden::material::Brdf as Measured;
use loden::params::Given;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rayon::prelude::*;

use crate::arrays::{Floats, Queries, density, evaluate, keywords, room, sample, shaped};
use crate::errors::wrong;
use crate::jobs::pictured;
use crate::work::{How, run};

/// A material without texture: a measured table, a factorisation or an analytic model.
///
/// Opened by `loden.open`. Directions are unit vectors away from the surface in its local frame: x is the tangent, y the
/// bitangent, z the normal.
#[pyclass(module = "loden", frozen)]
pub(crate) struct Brdf {
    file: (PathBuf, Given),
    kind: &'static str,
    pub(crate) brdf: Arc<dyn Measured>,
}

type Samples<'py> = (Floats<'py>, Floats<'py>, Floats<'py>);

impl Brdf {
    pub(crate) fn new(file: (PathBuf, Given), kind: &'static str, brdf: Arc<dyn Measured>) -> Self {
        Self { file, kind, brdf }
    }

    /// Queries (uv, first, second): the texture coordinate is 0 everywhere.
    fn queries<'py>(
        py: Python<'py>,
        first: (&str, &Bound<'py, PyAny>, usize),
        second: (&str, &Bound<'py, PyAny>, usize),
    ) -> PyResult<Queries<'py>> {
        let zeros = py.import("numpy")?.call_method1("zeros", (2, "float32"))?;
        Queries::new(py, &[("uv", &zeros, 2), first, second])
    }
}

#[pymethods]
impl Brdf {
    /// The file, or the model with its parameters.
    #[getter]
    fn path(&self) -> &Path {
        &self.file.0
    }

    /// The name of the format or model.
    #[getter]
    fn kind(&self) -> &'static str {
        self.kind
    }

    /// Measured wavelengths in nm, shape (bands,); empty for a file of RGB values.
    #[getter]
    fn wavelengths<'py>(&self, py: Python<'py>) -> PyResult<Floats<'py>> {
        shaped(py, self.brdf.wavelengths().to_vec(), &[self.brdf.wavelengths().len()])
    }

    /// Whether rotating both directions about the normal changes nothing.
    #[getter]
    fn isotropic(&self) -> bool {
        self.brdf.promises().isotropic
    }

    /// Whether exchanging the directions changes nothing.
    #[getter]
    fn reciprocal(&self) -> bool {
        self.brdf.promises().reciprocal
    }

    /// Facts from the file by name.
    #[getter]
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, value) in &self.brdf.notes().facts {
            dict.set_item(name, value)?;
        }
        Ok(dict)
    }

    /// The measured values, or the nodes of a table: directions to the light (n, 3) and to the viewer (n, 3), and values
    /// (n, 3) in 1/sr.
    fn samples<'py>(&self, py: Python<'py>) -> PyResult<Samples<'py>> {
        let samples = py.detach(|| self.brdf.samples());
        let column = |of: fn(&loden::material::BrdfSample) -> Vec3| {
            let numbers = samples.iter().flat_map(|s| of(s).to_array()).collect();
            shaped(py, numbers, &[samples.len(), 3])
        };
        Ok((column(|s| s.wi)?, column(|s| s.wo)?, column(|s| s.value)?))
    }

    /// Values of the BRDF in 1/sr of the shape (..., 3), linear sRGB, without the light's cosine.
    ///
    /// `wi` (..., 3) are unit vectors towards the light, `wo` (..., 3) towards the viewer; they broadcast against each other.
    #[pyo3(signature = (wi, wo, *, threads = None))]
    fn eval<'py>(
        &self,
        py: Python<'py>,
        wi: &Bound<'py, PyAny>,
        wo: &Bound<'py, PyAny>,
        threads: Option<usize>,
    ) -> PyResult<Floats<'py>> {
        let queries = Self::queries(py, ("wi", wi, 3), ("wo", wo, 3))?;
        // as the library: apparent values are divided by a cosine of at least 0.01
        evaluate(py, &*self.brdf, &queries, threads, |wi: Vec3| 1.0 / (PI * wi.z.max(0.01)))
    }

    /// Values of the BRDF in 1/sr at each of `wavelengths`, shape (..., bands).
    #[pyo3(signature = (wi, wo, *, threads = None))]
    fn spectrum<'py>(
        &self,
        py: Python<'py>,
        wi: &Bound<'py, PyAny>,
        wo: &Bound<'py, PyAny>,
        threads: Option<usize>,
    ) -> PyResult<Floats<'py>> {
        let bands = self.brdf.wavelengths().len();
        if bands == 0 {
            return Err(wrong(py, "spectrum", "the file holds RGB values, no spectra"));
        }
        let queries = Self::queries(py, ("wi", wi, 3), ("wo", wo, 3))?;
        let (wi, wo) = (queries.vectors::<Vec3>(1)?, queries.vectors::<Vec3>(2)?);
        let mut values = room(bands * queries.len())?;
        let (out, brdf) = (&mut values[..], &self.brdf);
        run(py, &How::threads(threads), |_| {
            out.par_chunks_mut(bands)
                .enumerate()
                .for_each(|(k, out)| out.copy_from_slice(&brdf.spectrum(wi[k], wo[k])));
            Ok(())
        })?;
        shaped(py, values, &[&queries.shape[..], &[bands]].concat())
    }

    /// Draws light directions for views `wo` (..., 3) from uniform numbers `random` (..., 2) in 0..1.
    ///
    /// Returns the directions (..., 3) and their densities (...) per solid angle in 1/sr, which are 0 where nothing was drawn.
    #[pyo3(name = "sample", signature = (wo, random, *, threads = None))]
    fn draw<'py>(
        &self,
        py: Python<'py>,
        wo: &Bound<'py, PyAny>,
        random: &Bound<'py, PyAny>,
        threads: Option<usize>,
    ) -> PyResult<(Floats<'py>, Floats<'py>)> {
        sample(py, &*self.brdf, &Self::queries(py, ("wo", wo, 3), ("random", random, 2))?, threads)
    }

    /// The density of `sample` per solid angle, 1/sr, shape (...).
    #[pyo3(signature = (wi, wo, *, threads = None))]
    fn pdf<'py>(
        &self,
        py: Python<'py>,
        wi: &Bound<'py, PyAny>,
        wo: &Bound<'py, PyAny>,
        threads: Option<usize>,
    ) -> PyResult<Floats<'py>> {
        density(py, &*self.brdf, &Self::queries(py, ("wi", wi, 3), ("wo", wo, 3))?, threads)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let module = py.import("loden")?;
        let path = if self.file.0.exists() { std::path::absolute(&self.file.0)? } else { self.file.0.clone() };
        let arguments = (module.getattr("open")?, (path,), keywords(py, &self.file.1)?).into_pyobject(py)?;
        Ok((module.getattr("_reopen")?, arguments))
    }

    fn __repr__(&self) -> String {
        format!("<loden.Brdf {:?}: {}>", self.file.0, self.kind)
    }

    /// The material on a sphere, as PNG: shown by notebooks.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyBytes>> {
        pictured(py, &*self.brdf)
    }
}
