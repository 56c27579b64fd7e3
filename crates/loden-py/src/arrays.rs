//! Arrays from NumPy, or from anything that speaks DLPack, and back.

use glam::{Vec2, Vec3};
use loden::direction::from_angles;
use loden::material::{Material, Point};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyTuple};
use rayon::prelude::*;

use crate::errors::wrong;
use crate::work::{How, run};

/// Points that a thread evaluates together.
const CHUNK: usize = 4096;

/// Arrays of single precision that are broadcast against each other, all but their last axis.
pub(crate) struct Queries<'py> {
    /// Shape without the last axis.
    pub shape: Vec<usize>,
    arrays: Vec<PyReadonlyArrayDyn<'py, f32>>,
}

impl<'py> Queries<'py> {
    /// Of arguments with their name and the length of their last axis.
    ///
    /// # Errors
    /// `loden.ParameterError` naming an argument of another shape, `TypeError` for what is no array of numbers.
    pub(crate) fn new(py: Python<'py>, arguments: &[(&str, &Bound<'py, PyAny>, usize)]) -> PyResult<Self> {
        let numpy = py.import("numpy")?;
        let mut found = Vec::new();
        for (name, argument, last) in arguments {
            let array = single(py, name, argument)?;
            if array.shape().last() != Some(last) {
                let problem = format!("found the shape {:?}, expected (..., {last})", array.shape());
                return Err(wrong(py, name, problem));
            }
            found.push(array);
        }
        let shapes = found.iter().map(|array| PyTuple::new(py, &array.shape()[..array.ndim() - 1]));
        let shapes = shapes.collect::<PyResult<Vec<_>>>()?;
        let common = numpy.call_method1("broadcast_shapes", PyTuple::new(py, &shapes)?).map_err(|_| {
            let shapes = arguments.iter().zip(&found).map(|((name, ..), array)| format!("{name} {:?}", array.shape()));
            let shapes = shapes.collect::<Vec<_>>().join(", ");
            wrong(py, arguments[0].0, format!("the arrays do not broadcast: {shapes}"))
        })?;
        let shape: Vec<usize> = common.extract()?;
        let mut arrays = Vec::new();
        for (array, (_, _, last)) in found.iter().zip(arguments) {
            let whole = PyTuple::new(py, [&shape[..], &[*last]].concat())?;
            let array = numpy.call_method1("broadcast_to", (array, whole))?;
            let array = numpy.call_method1("ascontiguousarray", (array,))?;
            arrays.push(array.cast_into::<PyArrayDyn<f32>>()?.readonly());
        }
        Ok(Self { shape, arrays })
    }

    /// Number of queries.
    pub(crate) fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// The numbers of an argument as vectors.
    pub(crate) fn vectors<T: bytemuck::Pod>(&self, argument: usize) -> PyResult<&[T]> {
        let numbers = self.arrays[argument].as_slice().map_err(|error| PyTypeError::new_err(error.to_string()))?;
        Ok(bytemuck::cast_slice(numbers))
    }
}

/// An argument as an array of single precision.
fn single<'py>(py: Python<'py>, name: &str, argument: &Bound<'py, PyAny>) -> PyResult<Floats<'py>> {
    let numpy = py.import("numpy")?;
    let array = if !argument.hasattr("__array__")? && argument.hasattr("__dlpack__")? {
        numpy.call_method1("from_dlpack", (argument,))?
    } else {
        numpy.call_method1("asarray", (argument,))?
    };
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if !["f", "i", "u"].contains(&kind.as_str()) {
        let dtype = array.getattr("dtype")?;
        return Err(PyTypeError::new_err(format!("{name}: found an array of {dtype}, expected numbers")));
    }
    let array = numpy.call_method1("asarray", (array, numpy.getattr("float32")?))?;
    Ok(array.cast_into::<PyArrayDyn<f32>>()?)
}

/// An array of the shape of the queries and a last axis.
pub(crate) fn shaped<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray1::from_vec(py, values).reshape(shape.to_vec())
}

/// Room for `len` numbers.
///
/// # Errors
/// `MemoryError`.
pub(crate) fn room(len: usize) -> PyResult<Vec<f32>> {
    let mut values = Vec::new();
    let message = || format!("an array of {len} numbers does not fit into memory");
    values.try_reserve_exact(len).map_err(|_| pyo3::exceptions::PyMemoryError::new_err(message()))?;
    values.resize(len, 0.0);
    Ok(values)
}

/// Values of a material at queries (uv, wi, wo): apparent values, of which `scale` makes what is asked for.
pub(crate) fn evaluate<'py>(
    py: Python<'py>,
    material: &dyn Material,
    queries: &Queries<'py>,
    threads: Option<usize>,
    scale: impl Fn(Vec3) -> f32 + Sync,
) -> PyResult<Floats<'py>> {
    let (uv, wi, wo) = (queries.vectors::<Vec2>(0)?, queries.vectors::<Vec3>(1)?, queries.vectors::<Vec3>(2)?);
    let mut values = room(3 * queries.len())?;
    let out: &mut [Vec3] = bytemuck::cast_slice_mut(&mut values);
    let part = |out: &mut [Vec3], first: usize| {
        let place = first..first + out.len();
        let wi = &wi[place.clone()];
        let points: Vec<Point> = uv[place.clone()].iter().zip(&wo[place]).map(|(&uv, &wo)| Point { uv, wo }).collect();
        material.apparent_many(&points, wi, out);
        out.iter_mut().zip(wi).for_each(|(value, wi)| *value *= scale(*wi));
    };
    if out.len() <= CHUNK {
        py.detach(|| part(out, 0));
    } else {
        run(py, &How::threads(threads), |_| {
            out.par_chunks_mut(CHUNK).enumerate().for_each(|(k, out)| part(out, k * CHUNK));
            Ok(())
        })?;
    }
    material.check().map_err(|error| crate::errors::raise(py, &error))?;
    shaped(py, values, &[&queries.shape[..], &[3]].concat())
}

/// An array of single precision.
pub(crate) type Floats<'py> = Bound<'py, PyArrayDyn<f32>>;

/// Light directions drawn for queries (uv, wo, random), and their densities.
pub(crate) fn sample<'py>(
    py: Python<'py>,
    material: &dyn Material,
    queries: &Queries<'py>,
    threads: Option<usize>,
) -> PyResult<(Floats<'py>, Floats<'py>)> {
    let (uv, wo, random) = (queries.vectors::<Vec2>(0)?, queries.vectors::<Vec3>(1)?, queries.vectors::<Vec2>(2)?);
    let (mut wi, mut pdf) = (room(3 * queries.len())?, room(queries.len())?);
    let drawn: &mut [Vec3] = bytemuck::cast_slice_mut(&mut wi);
    let densities = &mut pdf[..];
    run(py, &How::threads(threads), |_| {
        drawn.par_iter_mut().zip(densities).enumerate().for_each(|(k, (wi, pdf))| {
            if let Some(sample) = material.sample(uv[k], wo[k], random[k]) {
                (*wi, *pdf) = (sample.wi, sample.pdf);
            }
        });
        Ok(())
    })?;
    Ok((shaped(py, wi, &[&queries.shape[..], &[3]].concat())?, shaped(py, pdf, &queries.shape)?))
}

/// The densities of [`sample`] for queries (uv, wi, wo).
pub(crate) fn density<'py>(
    py: Python<'py>,
    material: &dyn Material,
    queries: &Queries<'py>,
    threads: Option<usize>,
) -> PyResult<Floats<'py>> {
    let (uv, wi, wo) = (queries.vectors::<Vec2>(0)?, queries.vectors::<Vec3>(1)?, queries.vectors::<Vec3>(2)?);
    let mut pdf = room(queries.len())?;
    let densities = &mut pdf[..];
    run(py, &How::threads(threads), |_| {
        densities.par_iter_mut().enumerate().for_each(|(k, pdf)| *pdf = material.pdf(uv[k], wi[k], wo[k]));
        Ok(())
    })?;
    shaped(py, pdf, &queries.shape)
}

/// Unit vectors (..., 3) of polar and azimuth angles (..., 2) in degrees, in the local frame of a surface: x is the
/// tangent, y the bitangent, z the normal.
#[pyfunction]
#[pyo3(signature = (degrees, /))]
pub(crate) fn directions<'py>(py: Python<'py>, degrees: &Bound<'py, PyAny>) -> PyResult<Floats<'py>> {
    let queries = Queries::new(py, &[("degrees", degrees, 2)])?;
    let vector = |d: &Vec2| from_angles(d.x.to_radians(), d.y.to_radians()).to_array();
    let values = queries.vectors::<Vec2>(0)?.iter().flat_map(vector).collect();
    shaped(py, values, &[&queries.shape[..], &[3]].concat())
}

/// Keyword arguments as a dictionary for `__reduce__`.
pub(crate) fn keywords<'py>(
    py: Python<'py>,
    options: &loden::params::Given,
) -> PyResult<Bound<'py, pyo3::types::PyDict>> {
    options.iter().map(|(name, text)| (name.replace('-', "_"), text.to_owned())).collect::<Vec<_>>().into_py_dict(py)
}
