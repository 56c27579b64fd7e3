//! Whole jobs as functions: from names of files to files, dictionaries and pictures.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;
use loden::btf::BtfSource;
use loden::codec::{self, Finish, Goal, lossless};
use loden::job::{self, CompressRequest, ConvertRequest, Dressed, FitRequest, Limits, Look, Render, Subject};
use loden::material::Material;
use loden::memory::Memory;
use loden::params::{Given, Values};
use loden::render::TextureMap;
use loden::renderers;
use loden::{Error, Result, separable};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use serde::Serialize;

use crate::arrays::{Floats, shaped};
use crate::errors::{raise, wrong};
use crate::foreign;
use crate::work::{How, run};

/// Adds the functions to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(info, module)?)?;
    module.add_function(wrap_pyfunction!(compress, module)?)?;
    module.add_function(wrap_pyfunction!(compare, module)?)?;
    module.add_function(wrap_pyfunction!(sweep, module)?)?;
    module.add_function(wrap_pyfunction!(convert, module)?)?;
    module.add_function(wrap_pyfunction!(fit, module)?)?;
    module.add_function(wrap_pyfunction!(factor, module)?)?;
    module.add_function(wrap_pyfunction!(render, module)?)?;
    module.add_function(wrap_pyfunction!(export, module)?)
}

/// Keyword arguments as parameters: `alpha_x=0.1` is `alpha-x`, a tuple is written with commas.
pub(crate) fn given(options: Option<&Bound<'_, PyDict>>) -> PyResult<Given> {
    let mut given = Given::default();
    for (name, value) in options.into_iter().flatten() {
        let text = if let Ok(on) = value.cast::<pyo3::types::PyBool>() {
            if on.is_true() { "yes".to_owned() } else { "no".to_owned() }
        } else if let Ok(text) = value.extract::<String>() {
            text
        } else if let Ok(numbers) = value.extract::<Vec<f64>>() {
            numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(",")
        } else {
            value.str()?.to_string()
        };
        given = given.with(name.extract::<String>()?.replace('_', "-"), text);
    }
    Ok(given)
}

/// A serialisable value as dictionaries, lists and numbers.
pub(crate) fn to_python<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text =
        serde_json::to_string(value).map_err(|error| pyo3::exceptions::PyValueError::new_err(error.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}

/// Refuses to replace an output unless asked to.
pub(crate) fn check_output(py: Python<'_>, output: &Path, overwrite: bool) -> PyResult<()> {
    if !overwrite && output.exists() {
        return Err(raise(py, &Error::Exists { path: output.into() }));
    }
    Ok(())
}

/// An amount of memory: bytes, or text such as "512M".
pub(crate) fn memory(py: Python<'_>, amount: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Memory>> {
    let Some(amount) = amount else { return Ok(None) };
    if let Ok(bytes) = amount.extract::<u64>() {
        return Ok(Some(Memory(bytes)));
    }
    let text: String = amount.extract()?;
    text.parse().map(Some).map_err(|problem: String| wrong(py, "memory", problem))
}

/// The goal of a compression; at most one may be given.
pub(crate) fn goal(
    py: Python<'_>,
    quality: Option<u8>,
    max_error: Option<f64>,
    max_bytes: Option<u64>,
) -> PyResult<Goal> {
    match (quality, max_error, max_bytes) {
        (None, None, None) => Ok(Goal::Params),
        (Some(quality @ 1..=100), None, None) => Ok(Goal::of_quality(quality)),
        (Some(quality), None, None) => Err(wrong(py, "quality", format!("found {quality}, expected 1 to 100"))),
        (None, Some(error), None) => Ok(Goal::MaxError(error)),
        (None, None, Some(bytes)) => Ok(Goal::Bytes(bytes)),
        _ => Err(wrong(py, "quality", "give one of quality, max_error and max_bytes")),
    }
}

/// Describes a file: format, size, directions, conventions, statistics. Returns what `loden info --json` prints.
#[pyfunction]
#[pyo3(signature = (path, /, **options))]
fn info<'py>(py: Python<'py>, path: PathBuf, options: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
    let given = given(options)?;
    let found = run(py, &How::default(), |progress| {
        let opened = job::open(&path, &given, progress)?;
        job::describe(&opened, true, progress)
    })?;
    to_python(py, &found)
}

/// Compresses a BTF into a `.loden` file.
///
/// `source` is a file or folder that `loden.open` reads. `method` is one of `loden.methods()`; its parameters are keyword arguments, such as `components=64`. At most one goal: `quality` (1 to 100), `max_error` (mean
/// error of display values, 0..1) or `max_bytes`. `lossless` packs the file ("zstd", "deflate" or "lzw"); `memory` is a
/// limit such as "512M". `progress` is called as `progress(name, done, total)`; Ctrl-C cancels and leaves no file.
///
/// Returns a dictionary as `loden compress --json` prints it: bytes, params, error, encode_s and more.
#[pyfunction]
// the default is codec::DEFAULT, written out so that Python's help shows it
#[pyo3(signature = (source, output, *, method = "klt", quality = None, max_error = None, max_bytes = None,
    lossless = None, measure = true, memory = None, overwrite = false, progress = None, threads = None, **params))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn compress<'py>(
    py: Python<'py>,
    source: PathBuf,
    output: PathBuf,
    method: &str,
    quality: Option<u8>,
    max_error: Option<f64>,
    max_bytes: Option<u64>,
    lossless: Option<&str>,
    measure: bool,
    memory: Option<&Bound<'py, PyAny>>,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
    params: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    check_output(py, &output, overwrite)?;
    let goal = goal(py, quality, max_error, max_bytes)?;
    let (given, memory) = (given(params)?, self::memory(py, memory)?);
    let done = run(py, &How { progress, threads }, |progress| {
        let codec = codec::by_name(method)?;
        let lossless = lossless.map(lossless::by_name).transpose()?;
        let source = job::open_btf(&source, &Given::default(), progress)?;
        let params = given.values(codec.params())?;
        let request = CompressRequest { codec, params, goal, finish: Finish { measure, lossless }, memory };
        job::compress(source.as_ref(), &request, &output, progress)
    })?;
    to_python(py, &done)
}

/// Compares materials with the measurement `source`. Returns a list of dictionaries as `loden compare --json` prints them:
/// mean_abs_error, psnr_db, ssim, bytes and more, of BRDFs relative_error and largest_error.
///
/// Each of them is a path, a `Btf`, or an object of one's own: an importer, or the result of a codec. It has `views` and
/// `lights`, polar and azimuth angles in degrees of the shape (n, 2), and `image(view, light)`, which returns numbers of the
/// shape (rows, columns, 3); it may have `encoding` ("linear" unless stated), `cosine` ("included") and `nbytes`.
#[pyfunction]
#[pyo3(signature = (source, *others, progress = None, threads = None))]
fn compare<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    others: Vec<Bound<'py, PyAny>>,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let (mut objects, mut paths) = (Vec::new(), Vec::new());
    for other in &others {
        match foreign::source(other)? {
            Some(object) => objects.push(Ok(object)),
            None => {
                paths.push(other.extract::<PathBuf>()?);
                objects.push(Err(paths.len() - 1));
            }
        }
    }
    let how = How { progress, threads };
    let measured = foreign::source(source)?;
    if measured.is_none() && paths.len() == others.len() {
        let path: PathBuf = source.extract()?;
        let rows = run(py, &how, |progress| job::compare_files(&path, &paths, &Given::default(), false, progress))?;
        return to_python(py, &rows);
    }
    let path: Option<PathBuf> = if measured.is_none() { Some(source.extract()?) } else { None };
    let rows = run(py, &how, |progress| {
        let measured: Arc<dyn BtfSource> = match (measured, path) {
            (Some((_, source)), _) => source,
            (None, path) => job::open_btf(path.unwrap_or_default(), &Given::default(), progress)?,
        };
        let row = |other: &std::result::Result<(String, Arc<dyn BtfSource>), usize>| match other {
            Ok((name, other)) => job::compare_sources(measured.as_ref(), other.as_ref(), name, progress),
            Err(path) => job::compare(measured.as_ref(), &paths[*path], false, progress),
        };
        objects.iter().map(row).collect::<Result<Vec<_>>>()
    })?;
    to_python(py, &rows)
}

/// Compresses a BTF by every method at several settings into the folder `output`, and compares each file with it.
///
/// `methods` are names of codecs, all of them by default. Settings that do not suit the measurement are skipped with a
/// warning. Returns a list of dictionaries as `loden sweep --json` prints them.
#[pyfunction]
#[pyo3(signature = (source, output, *, methods = None, progress = None, threads = None))]
fn sweep<'py>(
    py: Python<'py>,
    source: PathBuf,
    output: PathBuf,
    methods: Option<Vec<String>>,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let rows = run(py, &How { progress, threads }, |progress| {
        let codecs = match &methods {
            Some(names) => names.iter().map(|name| codec::by_name(name)).collect::<Result<Vec<_>>>()?,
            None => codec::CODECS.to_vec(),
        };
        let source = job::open_btf(&source, &Given::default(), progress)?;
        loden::output::create_folder(&output)?;
        let encode = |codec: &'static dyn codec::Codec, setting: &job::Setting, path: &Path| {
            job::encode_here(codec, source.as_ref(), setting, path, progress).map_err(job::Trouble::from)
        };
        let sweeping = job::Sweeping { source: source.as_ref(), codecs: &codecs, folder: &output, encode: &encode };
        job::sweep(&sweeping, progress).map(|swept| swept.rows)
    })?;
    to_python(py, &rows)
}

/// Converts a BTF or a BRDF to the format of the extension of `output`, or to `format`. Options of the format are keyword
/// arguments. Returns a dictionary that says what the format cannot hold, and the error of the result.
#[pyfunction]
#[pyo3(signature = (source, output, *, format = None, overwrite = false, progress = None, threads = None, **options))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn convert<'py>(
    py: Python<'py>,
    source: PathBuf,
    output: PathBuf,
    format: Option<String>,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    check_output(py, &output, overwrite)?;
    let request =
        ConvertRequest { source, output, format, export: given(options)?, import: Given::default(), check: true };
    let done = run(py, &How { progress, threads }, |progress| job::convert(&request, progress))?;
    to_python(py, &done)
}

/// Fits analytic models to a BRDF, or to the average of a BTF, and ranks them by their error.
///
/// `model` is one of `loden.models()`, or None for all of them. `anisotropic` says whether the surface may be anisotropic; by
/// default as the source states. Returns a dictionary with the list "fits", the best first.
#[pyfunction]
#[pyo3(signature = (source, *, model = None, lobes = 1, anisotropic = None, progress = None, threads = None))]
fn fit<'py>(
    py: Python<'py>,
    source: PathBuf,
    model: Option<String>,
    lobes: usize,
    anisotropic: Option<bool>,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let options = loden::fit::Options { lobes, ..Default::default() };
    let request = FitRequest { source, model, anisotropic, options, ..Default::default() };
    let ranking = run(py, &How { progress, threads }, |progress| job::rank(&request, progress))?;
    to_python(py, &ranking)
}

/// Factors a BRDF into small tables and writes the folder `output` with `factored.loden`, a material, and pictures of the
/// tables. Parameters of the `method` are keyword arguments. Returns a dictionary with errors and sizes.
#[pyfunction]
#[pyo3(signature = (source, output, *, method = "hf", overwrite = false, progress = None, threads = None, **params))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn factor<'py>(
    py: Python<'py>,
    source: PathBuf,
    output: PathBuf,
    method: &str,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
    params: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    check_output(py, &output, overwrite)?;
    let given = given(params)?;
    let done = run(py, &How { progress, threads }, |progress| {
        let method = separable::by_name(method)?;
        let params: Values = given.values(method.params())?;
        job::factor(&source, method, &params, &output, &Given::default(), progress)
    })?;
    to_python(py, &done)
}

/// Renders an object wearing a material, or a scene.
///
/// `subject` is a material as for `loden.open`, or a scene file (.toml or .rib with `scene=True`). `object` is a built-in object or
/// a mesh file; `uv_scale` says how often the material repeats, `light` gives the polar and azimuth angle of a key light in
/// degrees. Returns linear light as float32 of the shape (rows, columns, 3).
#[pyfunction]
#[pyo3(signature = (subject, *, object = "sphere", scene = false, size = (512, 512), spp = 64, depth = None, seed = 0, uv_scale = 4.0,
    uv_rotation = 0.0, light = None, denoise = false, interpolation = "triangles", blending = "auto", progress = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn render<'py>(
    py: Python<'py>,
    subject: PathBuf,
    object: &str,
    scene: bool,
    size: (usize, usize),
    spp: u32,
    depth: Option<u32>,
    seed: u64,
    uv_scale: f32,
    uv_rotation: f32,
    light: Option<[f32; 2]>,
    denoise: bool,
    interpolation: &str,
    blending: &str,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Floats<'py>> {
    let interpolation = crate::btf::between(py, interpolation, blending)?;
    let subject = if scene {
        Subject::Scene { file: subject, texture_samples: None, world: None, shadows: None }
    } else {
        Subject::Object(Dressed {
            object: object.into(),
            material: subject,
            import: Given::default(),
            interpolation,
            endless: false,
            texture: TextureMap { scale: uv_scale, rotation_degrees: uv_rotation, ..TextureMap::default() },
            light: light.map_or(job::Light::Standard, job::Light::Key),
        })
    };
    let request = Render {
        subject,
        size: Some([size.0, size.1]),
        spp: Some(spp),
        depth,
        seed,
        denoise,
        limits: Limits::default(),
        memory: None,
        scratch: std::env::temp_dir(),
    };
    let done = run(py, &How { progress, threads }, |progress| job::render(&request, progress))?;
    let picture = done.rendered.picture;
    let numbers = picture.rgb.iter().flat_map(Vec3::to_array).collect();
    shaped(py, numbers, &[picture.height, picture.width, 3])
}

/// Writes a compressed material as a folder for another renderer: "mitsuba", "wgsl", "glsl", "three", "osl", "renderman", "gltf" or "materialx".
/// Returns a dictionary.
#[pyfunction]
#[pyo3(signature = (source, renderer, output, *, progress = None))]
fn export<'py>(
    py: Python<'py>,
    source: PathBuf,
    renderer: &str,
    output: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let done = run(py, &How { progress, threads: None }, |progress| {
        job::export_to(&source, &Given::default(), renderers::by_name(renderer)?, &output, progress)
    })?;
    to_python(py, &done)
}

/// A material on a sphere as PNG.
pub(crate) fn pictured<'py>(py: Python<'py>, material: &dyn Material) -> PyResult<Bound<'py, PyBytes>> {
    let look = Look::new("sphere", 192, 192, 32);
    let png = run(py, &How::default(), |progress| {
        let picture = job::draw(&look, material, "material", progress)?;
        let made: Result<Vec<u8>> = picture.to_png().map_err(|error| Error::parameter("picture", error.to_string()));
        made
    })?;
    Ok(PyBytes::new(py, &png))
}
