//! The class `Btf`, and how files are opened.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use glam::Vec3;
use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, Rect, SampleType, Texels};
use loden::codec::CompressedBtf;
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme};
use loden::import::Measured;
use loden::job;
use loden::material::Interpolation;
use loden::material::Material;
use loden::memory::Memory;
use loden::params::Given;
use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::arrays::{Floats, Queries, density, evaluate, keywords, room, sample, shaped};
use crate::batches::Batches;
use crate::brdf::Brdf;
use crate::errors::{raise, wrong};
use crate::jobs::{given, pictured, to_python};
use crate::work::{How, run};

/// Decoded images up to this size are kept in memory for evaluation; more are paged from a temporary file.
const KEEP: u64 = 2 << 30;

/// A material with texture: images of one sample for pairs of view and light directions, measured or compressed.
///
/// Opened by `loden.open` or made by `loden.from_numpy`. Images are decoded when they are asked for. Directions are unit
/// vectors away from the surface in its local frame: x is the tangent, y the bitangent, z the normal. Texture coordinates
/// have the period 1: u runs to the right and v upwards, so the first row of an image is at v = 1.
#[pyclass(module = "loden", frozen)]
pub(crate) struct Btf {
    /// The file and its options; none for a BTF made of an array.
    file: Option<(PathBuf, Given)>,
    kind: &'static str,
    pub(crate) source: Arc<dyn BtfSource>,
    compressed: Option<Arc<CompressedBtf>>,
    interpolation: Interpolation,
    material: OnceLock<Arc<dyn Material>>,
}

/// Opens a material: a file or folder of any format that `loden info` recognises, or an analytic model such as
/// "ward:alpha-x=0.1:kd=0.2,0.1,0".
///
/// Returns a `Btf`, or a `Brdf` for a material without texture. `interpolation` between measured directions is
/// "triangles" or "rings"; `blending` says what is averaged there and between texels: "linear" light, "stored" values, or
/// "auto", which is linear light where that is as fast. Options state what the files leave open, for example `encoding="linear"` or
/// `cosine="excluded"`; `loden info --help` lists them. What is assumed on reading is a Python warning.
///
/// Raises `loden.MissingFileError`, `loden.InvalidFileError`, `loden.UnsupportedError` or another `loden.Error`.
#[pyfunction]
#[pyo3(signature = (path, /, *, interpolation = "triangles", blending = "auto", **options))]
pub(crate) fn open<'py>(
    py: Python<'py>,
    path: PathBuf,
    interpolation: &str,
    blending: &str,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let (interpolation, given) = (between(py, interpolation, blending)?, given(options)?);
    let opened = run(py, &How::default(), |progress| job::open(&path, &given, progress))?;
    let file = (path, given);
    let (source, compressed): (Arc<dyn BtfSource>, _) = match opened.measured {
        Measured::Brdf(brdf) => return Ok(Bound::new(py, Brdf::new(file, opened.kind, brdf))?.into_any()),
        Measured::Compressed(compressed) => (compressed.clone(), Some(compressed)),
        Measured::Btf(source) => (source, None),
    };
    let btf = Btf { file: Some(file), kind: opened.kind, source, compressed, interpolation, material: OnceLock::new() };
    Ok(Bound::new(py, btf)?.into_any())
}

/// A BTF of an array of the shape (views, lights, rows, columns, 3), of uint8, float16 or float32.
///
/// `views` and `lights` are polar and azimuth angles in degrees, of the shape (n, 2). `encoding` says how values encode
/// light: "linear", "srgb" or "gamma2.2"; the default is "srgb" for uint8 and "linear" for the rest. `cosine` says whether
/// values include the cosine of the light's polar angle, as photographs do: "included" or "excluded".
#[pyfunction]
#[pyo3(signature = (values, views, lights, *, encoding = None, cosine = "included", interpolation = "triangles",
    blending = "auto"))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
pub(crate) fn from_numpy(
    py: Python<'_>,
    values: &Bound<'_, PyAny>,
    views: &Bound<'_, PyAny>,
    lights: &Bound<'_, PyAny>,
    encoding: Option<&str>,
    cosine: &str,
    interpolation: &str,
    blending: &str,
) -> PyResult<Btf> {
    let interpolation = between(py, interpolation, blending)?;
    let array = py.import("numpy")?.call_method1("ascontiguousarray", (values,))?;
    let (texels, sample_type, shape) = texels(py, &array)?;
    let [view_count, light_count, height, width, 3] = shape[..] else {
        let problem = format!("found the shape {shape:?}, expected (views, lights, rows, columns, 3)");
        return Err(wrong(py, "values", problem));
    };
    let default = if sample_type == SampleType::U8 { Encoding::Srgb } else { Encoding::Linear };
    let encoding = match encoding {
        Some(text) => text.parse().map_err(|error| raise(py, &error))?,
        None => default,
    };
    let cosine = match cosine {
        "included" => Cosine::Included,
        "excluded" => Cosine::Excluded,
        _ => return Err(wrong(py, "cosine", format!("found {cosine:?}, expected included or excluded"))),
    };
    let (views, lights) = (set(py, "views", views, view_count)?, set(py, "lights", lights, light_count)?);
    let meta = BtfMeta { width, height, views, lights, encoding, cosine, sample_type };
    let source = MemoryBtf::new(meta, texels).map_err(|error| raise(py, &error))?;
    let source: Arc<dyn BtfSource> = Arc::new(source);
    Ok(Btf { file: None, kind: "numpy", source, compressed: None, interpolation, material: OnceLock::new() })
}

pub(crate) fn between(py: Python<'_>, interpolation: &str, blending: &str) -> PyResult<Interpolation> {
    Interpolation::of_words(interpolation, blending).map_err(|error| raise(py, &error))
}

/// The numbers of a contiguous array, their type and the shape.
fn texels(py: Python<'_>, array: &Bound<'_, PyAny>) -> PyResult<(Texels<'static>, SampleType, Vec<usize>)> {
    fn numbers<T: numpy::Element + Copy>(array: PyReadonlyArrayDyn<'_, T>) -> PyResult<(Vec<T>, Vec<usize>)> {
        Ok((array.as_slice()?.to_vec(), array.shape().to_vec()))
    }
    if let Ok(array) = array.cast::<PyArrayDyn<u8>>() {
        let (values, shape) = numbers(array.readonly())?;
        Ok((Texels::U8(values.into()), SampleType::U8, shape))
    } else if let Ok(array) = array.cast::<PyArrayDyn<half::f16>>() {
        let (values, shape) = numbers(array.readonly())?;
        Ok((Texels::F16(values.into()), SampleType::F16, shape))
    } else if let Ok(array) = array.cast::<PyArrayDyn<f32>>() {
        let (values, shape) = numbers(array.readonly())?;
        Ok((Texels::F32(values.into()), SampleType::F32, shape))
    } else {
        let dtype = array.getattr("dtype")?;
        Err(wrong(py, "values", format!("found an array of {dtype}, expected uint8, float16 or float32")))
    }
}

/// Directions from angles in degrees.
pub(crate) fn set(py: Python<'_>, name: &str, degrees: &Bound<'_, PyAny>, count: usize) -> PyResult<DirectionSet> {
    let array = py.import("numpy")?.call_method1("asarray", (degrees, "float64"))?;
    let array = array.call_method1("tolist", ())?;
    let problem = || wrong(py, name, format!("expected angles in degrees of the shape ({count}, 2)"));
    let degrees: Vec<[f64; 2]> = array.extract().map_err(|_| problem())?;
    if degrees.len() != count {
        return Err(problem());
    }
    DirectionSet::from_degrees(degrees).map_err(|error| raise(py, &error))
}

impl Btf {
    fn meta(&self) -> &BtfMeta {
        self.source.meta()
    }

    /// The material, which is prepared by the first call.
    pub(crate) fn material(&self, py: Python<'_>) -> PyResult<&Arc<dyn Material>> {
        if let Some(material) = self.material.get() {
            return Ok(material);
        }
        let measured = match &self.compressed {
            Some(compressed) => Measured::Compressed(compressed.clone()),
            None => Measured::Btf(self.source.clone()),
        };
        let folder = std::env::temp_dir();
        let made = run(py, &How::default(), |progress| {
            measured.material_within(self.interpolation, Some((Memory(KEEP), &folder)), progress)
        })?;
        Ok(self.material.get_or_init(|| made.material))
    }

    fn check(&self, py: Python<'_>, view: usize, light: usize) -> PyResult<()> {
        for (name, found, count) in
            [("view", view, self.meta().views.len()), ("light", light, self.meta().lights.len())]
        {
            if found >= count {
                return Err(wrong(py, name, format!("found {found}, expected less than {count}")));
            }
        }
        Ok(())
    }

    fn angles<'py>(py: Python<'py>, set: &DirectionSet) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        shaped(py, set.degrees().concat(), &[set.len(), 2])
    }

    /// Indices from an argument: all of them, one or a list.
    fn indices(py: Python<'_>, name: &str, wanted: Option<&Bound<'_, PyAny>>, count: usize) -> PyResult<Vec<usize>> {
        let Some(wanted) = wanted else { return Ok((0..count).collect()) };
        let found: Vec<usize> = match wanted.extract::<isize>() {
            // a negative index counts from the end, as in NumPy
            Ok(one) if one < 0 => vec![one.saturating_add_unsigned(count) as usize],
            Ok(one) => vec![one as usize],
            Err(_) => {
                let list = py.import("numpy")?.call_method1("arange", (count,))?.get_item(wanted);
                let problem = |error: PyErr| wrong(py, name, error.value(py).to_string());
                list.map_err(problem)?.call_method0("tolist")?.extract()?
            }
        };
        match found.iter().find(|index| **index >= count) {
            Some(index) => Err(wrong(py, name, format!("found {index}, expected less than {count}"))),
            None => Ok(found),
        }
    }
}

#[pymethods]
impl Btf {
    /// The file, or None for a BTF made of an array.
    #[getter]
    fn path(&self) -> Option<&Path> {
        self.file.as_ref().map(|(path, _)| path.as_path())
    }

    /// The name of the format.
    #[getter]
    fn kind(&self) -> &'static str {
        self.kind
    }

    /// (views, lights, rows, columns, 3)
    #[getter]
    fn shape(&self) -> (usize, usize, usize, usize, usize) {
        let meta = self.meta();
        (meta.views.len(), meta.lights.len(), meta.height, meta.width, 3)
    }

    /// Polar and azimuth angles of the views in degrees, shape (views, 2).
    #[getter]
    fn views<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        Self::angles(py, &self.meta().views)
    }

    /// Polar and azimuth angles of the lights in degrees, shape (lights, 2).
    #[getter]
    fn lights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        Self::angles(py, &self.meta().lights)
    }

    /// How stored values encode light: "linear", "srgb" or "gamma" with a number.
    #[getter]
    fn encoding(&self) -> String {
        self.meta().encoding.to_string()
    }

    /// Whether stored values include the cosine of the light's polar angle: "included" or "excluded".
    #[getter]
    fn cosine(&self) -> &'static str {
        self.meta().cosine.name()
    }

    /// The type of stored numbers: "uint8", "float16" or "float32".
    #[getter]
    fn dtype(&self) -> &'static str {
        match self.meta().sample_type {
            SampleType::U8 => "uint8",
            SampleType::F16 => "float16",
            SampleType::F32 => "float32",
        }
    }

    /// The compression method, or None for a BTF that is not compressed.
    #[getter]
    fn method(&self) -> Option<&str> {
        self.compressed.as_ref().map(|compressed| compressed.method())
    }

    /// Parameters of the compression by name; empty for a BTF that is not compressed.
    #[getter]
    fn params<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        match &self.compressed {
            Some(compressed) => Ok(to_python(py, compressed.params())?.cast_into()?),
            None => Ok(PyDict::new(py)),
        }
    }

    /// Size of the file or files in bytes.
    #[getter]
    fn nbytes(&self) -> u64 {
        self.compressed.as_ref().map_or_else(|| self.source.source_bytes(), |compressed| compressed.bytes())
    }

    /// Pairs (view, light) that were not measured; their images repeat the nearest measured light of the view.
    #[getter]
    fn missing(&self) -> Vec<(usize, usize)> {
        self.source.missing().to_vec()
    }

    /// Facts from the files by name.
    #[getter]
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, value) in self.source.facts() {
            dict.set_item(name, value)?;
        }
        Ok(dict)
    }

    /// One image as float32 of the shape (rows, columns, 3): linear light, or the values as they are encoded (0..1 for 8 bits) with
    /// `linear=False`. Values include the light's cosine or not as `cosine` says.
    #[pyo3(signature = (view, light, *, linear = true))]
    fn image<'py>(&self, py: Python<'py>, view: usize, light: usize, linear: bool) -> PyResult<Floats<'py>> {
        self.check(py, view, light)?;
        let meta = self.meta();
        let (source, encoding) = (&self.source, meta.encoding);
        let values = py.detach(|| {
            let mut values = source.image(view, light)?.to_f32().into_owned();
            if linear {
                values.iter_mut().for_each(|v| *v = encoding.decode(*v));
            }
            Ok(values)
        });
        shaped(py, values.map_err(|error| raise(py, &error))?, &[meta.height, meta.width, 3])
    }

    /// One image as it is stored, of the type `dtype`, shape (rows, columns, 3).
    fn stored<'py>(&self, py: Python<'py>, view: usize, light: usize) -> PyResult<Bound<'py, PyAny>> {
        self.check(py, view, light)?;
        let shape = [self.meta().height, self.meta().width, 3];
        let texels = py.detach(|| self.source.image(view, light)).map_err(|error| raise(py, &error))?;
        Ok(match texels {
            Texels::U8(values) => shaped(py, values.into_owned(), &shape)?.into_any(),
            Texels::F16(values) => shaped(py, values.into_owned(), &shape)?.into_any(),
            Texels::F32(values) => shaped(py, values.into_owned(), &shape)?.into_any(),
        })
    }

    /// Images as float32 of the shape (views, lights, rows, columns, 3), of all directions or of some.
    ///
    /// `views` and `lights` are an index, a list of indices or a slice; `region` is (column, row, width, height). Raises
    /// `MemoryError` if the array does not fit: take a region.
    #[pyo3(signature = (*, views = None, lights = None, region = None, linear = true, threads = None))]
    fn to_numpy<'py>(
        &self,
        py: Python<'py>,
        views: Option<&Bound<'py, PyAny>>,
        lights: Option<&Bound<'py, PyAny>>,
        region: Option<[usize; 4]>,
        linear: bool,
        threads: Option<usize>,
    ) -> PyResult<Floats<'py>> {
        use rayon::prelude::*;

        let meta = self.meta();
        let views = Self::indices(py, "views", views, meta.views.len())?;
        let lights = Self::indices(py, "lights", lights, meta.lights.len())?;
        let rect = region.map_or_else(|| Rect::whole(meta), |[x, y, width, height]| Rect { x, y, width, height });
        rect.check(meta).map_err(|error| raise(py, &error))?;
        let per_image = 3 * rect.texels();
        let mut values = room(views.len() * lights.len() * per_image)?;
        let (source, encoding) = (&self.source, meta.encoding);
        let pairs: Vec<(usize, usize)> = views.iter().flat_map(|&v| lights.iter().map(move |&l| (v, l))).collect();
        let out = &mut values[..];
        run(py, &How::threads(threads), |progress| {
            out.par_chunks_mut(per_image.max(1)).zip(&pairs).try_for_each(|(out, &(view, light))| {
                if progress.is_cancelled() {
                    return Err(loden::Error::Cancelled);
                }
                source.read(&[view], &[light], rect, out)?;
                if linear {
                    out.iter_mut().for_each(|v| *v = encoding.decode(*v));
                }
                Ok(())
            })
        })?;
        shaped(py, values, &[views.len(), lights.len(), rect.height, rect.width, 3])
    }

    /// Apparent values pi L / E of the shape (..., 3) in linear light: the BRDF times pi times the light's cosine, interpolated
    /// between texels and directions.
    ///
    /// `uv` are texture coordinates (..., 2), `wi` unit vectors towards the light (..., 3), `wo` towards the viewer
    /// (..., 3). The arrays broadcast against each other; NumPy arrays and anything that speaks DLPack are taken. Values are
    /// zero where a direction is below the surface.
    #[pyo3(signature = (uv, wi, wo, *, threads = None))]
    fn eval<'py>(
        &self,
        py: Python<'py>,
        uv: &Bound<'py, PyAny>,
        wi: &Bound<'py, PyAny>,
        wo: &Bound<'py, PyAny>,
        threads: Option<usize>,
    ) -> PyResult<Floats<'py>> {
        let queries = Queries::new(py, &[("uv", uv, 2), ("wi", wi, 3), ("wo", wo, 3)])?;
        evaluate(py, self.material(py)?.as_ref(), &queries, threads, |_: Vec3| 1.0)
    }

    /// Draws light directions for views `wo` (..., 3) at `uv` (..., 2) from uniform numbers `random` (..., 2) in 0..1.
    ///
    /// Returns the directions (..., 3) and their densities (...) per solid angle in 1/sr, which are 0 where nothing was drawn.
    #[pyo3(signature = (uv, wo, random, *, threads = None))]
    fn sample<'py>(
        &self,
        py: Python<'py>,
        uv: &Bound<'py, PyAny>,
        wo: &Bound<'py, PyAny>,
        random: &Bound<'py, PyAny>,
        threads: Option<usize>,
    ) -> PyResult<(Floats<'py>, Floats<'py>)> {
        let queries = Queries::new(py, &[("uv", uv, 2), ("wo", wo, 3), ("random", random, 2)])?;
        sample(py, self.material(py)?.as_ref(), &queries, threads)
    }

    /// The density of `sample` per solid angle, 1/sr, shape (...).
    #[pyo3(signature = (uv, wi, wo, *, threads = None))]
    fn pdf<'py>(
        &self,
        py: Python<'py>,
        uv: &Bound<'py, PyAny>,
        wi: &Bound<'py, PyAny>,
        wo: &Bound<'py, PyAny>,
        threads: Option<usize>,
    ) -> PyResult<Floats<'py>> {
        let queries = Queries::new(py, &[("uv", uv, 2), ("wi", wi, 3), ("wo", wo, 3)])?;
        density(py, self.material(py)?.as_ref(), &queries, threads)
    }

    /// Endless batches of `n` measured values at random texels and pairs of directions, for training.
    ///
    /// Each is a tuple of float32 arrays: `uv` (n, 2), `wi` (n, 3), `wo` (n, 3), `values` (n, 3) in linear light. Of each
    /// decoded image `reuse` texels are drawn: more is faster, fewer are more independent. The same seed gives the same
    /// batches, for any number of threads.
    #[pyo3(signature = (n, seed = 0, *, reuse = 128, threads = None))]
    fn batches(&self, py: Python<'_>, n: usize, seed: u64, reuse: usize, threads: Option<usize>) -> PyResult<Batches> {
        Batches::new(py, self.source.clone(), n, seed, reuse, threads)
    }

    /// The parts of a compressed material: a dictionary with "btf" (size, directions, conventions), "recipe" (which planes and
    /// tables there are, and the formula that makes values of them), "planes" and "tables" (arrays by name, as they are
    /// stored) and "provenance". `loden.store_parts` makes a file of them again.
    ///
    /// Raises `loden.UnsupportedError` for a BTF that is not compressed.
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        match &self.compressed {
            Some(compressed) => crate::parts::of_material(py, compressed),
            None => {
                let path = self.path().unwrap_or(Path::new("an array"));
                Err(raise(py, &loden::Error::unsupported(path, "has no parts: it is not compressed")))
            }
        }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let module = py.import("loden")?;
        let interpolation = if self.interpolation.scheme == Scheme::Rings { "rings" } else { "triangles" };
        let (function, positional, named) = match &self.file {
            Some((path, options)) => {
                let named = keywords(py, options)?;
                (module.getattr("open")?, PyTuple::new(py, [std::path::absolute(path).unwrap_or(path.clone())])?, named)
            }
            None => {
                let named = PyDict::new(py);
                named.set_item("encoding", self.encoding())?;
                named.set_item("cosine", self.cosine())?;
                let values = py.import("numpy")?.call_method1("stack", (self.all_stored(py)?,))?;
                let positional = (values, self.views(py)?, self.lights(py)?).into_pyobject(py)?;
                (module.getattr("from_numpy")?, positional, named)
            }
        };
        named.set_item("interpolation", interpolation)?;
        named.set_item("blending", self.interpolation.blending.name())?;
        let call = module.getattr("_reopen")?;
        let arguments = (function, positional, named).into_pyobject(py)?;
        Ok((call, arguments))
    }

    fn __repr__(&self) -> String {
        let (views, lights, rows, columns, _) = self.shape();
        let name = self.path().map_or("of an array".into(), |path| format!("{path:?}"));
        format!("<loden.Btf {name}: {}, {columns} x {rows} texels, {views} views, {lights} lights>", self.kind)
    }

    /// The material on a sphere, as PNG: shown by notebooks.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyBytes>> {
        pictured(py, self.material(py)?.as_ref())
    }
}

impl Btf {
    /// Stored images as (views, (lights, rows, columns, 3)).
    fn all_stored<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let numpy = py.import("numpy")?;
        let view = |view: usize| {
            let images = (0..self.meta().lights.len()).map(|light| self.stored(py, view, light));
            numpy.call_method1("stack", (images.collect::<PyResult<Vec<_>>>()?,))
        };
        (0..self.meta().views.len()).map(view).collect()
    }
}
