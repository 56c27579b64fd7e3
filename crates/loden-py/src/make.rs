//! New materials: measured by the virtual goniometer, rectified, enlarged, exchanged, mixed, edited.

use std::fmt::Display;
use std::path::PathBuf;

use loden::acquire;
use loden::direction::DirectionSet;
use loden::generate::{Edit, Keep, Match, Recolor, Selection, color};
use loden::job::{
    self, BlendRequest, EditRequest, ExchangeRequest, FamilyRequest, Features, Look, On, Sample, SampleRequest, Store,
    SurfaceRequest, SynthesisRequest,
};
use loden::params::{Given, Params};
use loden::synth::surface::Stroke;
use loden::{Error, rectify, synth};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{raise, wrong};
use crate::jobs::{check_output, given, to_python};
use crate::work::{How, run};

/// Adds the functions to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(acquire_sample, module)?)?;
    module.add_function(wrap_pyfunction!(rectify_photographs, module)?)?;
    module.add_function(wrap_pyfunction!(synthesize, module)?)?;
    module.add_function(wrap_pyfunction!(synthesize_on, module)?)?;
    module.add_function(wrap_pyfunction!(apply_map, module)?)?;
    module.add_function(wrap_pyfunction!(exchange, module)?)?;
    module.add_function(wrap_pyfunction!(blend, module)?)?;
    module.add_function(wrap_pyfunction!(edit, module)?)?;
    module.add_function(wrap_pyfunction!(family, module)?)
}

/// One of `all` words.
fn word<T: Copy + Display>(py: Python<'_>, name: &str, found: &str, all: &[T]) -> PyResult<T> {
    all.iter().copied().find(|one| one.to_string() == found).ok_or_else(|| {
        let words = all.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        wrong(py, name, format!("found {found:?}, expected one of {words}"))
    })
}

/// Measures a sample with the virtual goniometer and writes the BTF, in the format of the extension of `output`.
///
/// `sample` is "gravel", "lacquer", "leather", "twill", "yarn", "maps" (with `height`, a picture) or "mesh" (with
/// `object`, a mesh file); `albedo` is a picture for the last two. `size` are texels per side, `spp` paths per texel and
/// view, `depth` the longest path, `grid` points per side of a height field; `directions` are "bonn81" or "ubo2014".
/// Parameters of the sample, such as `weave="satin"`, are keyword arguments. `progress` is called as
/// `progress(name, done, total)`; Ctrl-C cancels.
#[pyfunction]
#[pyo3(name = "acquire", signature = (sample, output, *, size = 64, spp = 32, depth = 4, seed = 0, directions = "bonn81",
    grid = 512, height = None, object = None, albedo = None, overwrite = false, progress = None, threads = None, **params))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn acquire_sample(
    py: Python<'_>,
    sample: String,
    output: PathBuf,
    size: usize,
    spp: u32,
    depth: u32,
    seed: u64,
    directions: &str,
    grid: usize,
    height: Option<PathBuf>,
    object: Option<PathBuf>,
    albedo: Option<PathBuf>,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
    params: Option<&Bound<'_, PyDict>>,
) -> PyResult<()> {
    check_output(py, &output, overwrite)?;
    let request = SampleRequest { name: sample, params: given(params)?, grid, seed, height, object, albedo };
    let options = acquire::Options { size, spp, depth, seed };
    run(py, &How { progress, threads }, |progress| {
        options.check()?;
        let unknown = || Error::parameter("directions", format!("found {directions:?}, expected bonn81 or ubo2014"));
        let set = DirectionSet::named(directions).ok_or_else(unknown)?;
        let built = request.build(progress)?;
        job::measure(&built, &set, &options, &output, &Given::default(), progress)
    })
}

/// Rectifies the raw photographs of a manifest (TOML) and writes the BTF, in the format of the extension of `output`.
///
/// `size` are texels per side; photographs in which the edges of the frame deviate from straight lines by more than
/// `max_error` pixels are refused and replaced by the nearest light of their view. Options of the pictures to write are
/// keyword arguments. Returns a dictionary with errors and what became of each photograph.
#[pyfunction]
#[pyo3(name = "rectify", signature = (manifest, output, *, size = 256, max_error = 0.5, overwrite = false, progress = None,
    threads = None, **options))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn rectify_photographs<'py>(
    py: Python<'py>,
    manifest: PathBuf,
    output: PathBuf,
    size: usize,
    max_error: f64,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    check_output(py, &output, overwrite)?;
    let (pictures, options) = (given(options)?, rectify::Options { size, max_error });
    let done = run(py, &How { progress, threads }, |progress| {
        job::rectify(&manifest, &output, &options, &pictures, progress)
    })?;
    to_python(py, &done)
}

/// Makes a material, or a picture, larger than its sample.
///
/// `source` is a BTF, compressed or not, or a picture with `picture=True`; `output` is a `.loden` file, or a `.png` or
/// `.exr` picture. `size` is (columns, rows) of the result; without it the texels of the sample where `mask` is dark are
/// filled. `others` are more samples of the same directions, (path, weight) with how often each is used relative to the first, which
/// `method="optimise"` follows. Parameters of the `method` are keyword arguments. `compare` says what texels are compared by: "appearance",
/// "height" or "both"; `store` what the file holds: "map" or "planes". `map` is a file for the source coordinates, which
/// `apply_map` puts on other pictures. The same seed gives the same file, for any number of threads.
///
/// Returns a dictionary as `loden synthesize --json` prints it.
#[pyfunction]
#[pyo3(signature = (source, output, *, others = Vec::new(), size = None, method = "optimise", picture = false, tileable = false, seed = 0,
    periodic = false, mask = None, guide = None, guide_weight = 10.0, compare = "appearance", channels = 8, store = "map",
    map = None, overwrite = false, progress = None, threads = None, **params))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn synthesize<'py>(
    py: Python<'py>,
    source: PathBuf,
    output: PathBuf,
    others: Vec<(PathBuf, f32)>,
    size: Option<[usize; 2]>,
    method: &str,
    picture: bool,
    tileable: bool,
    seed: u64,
    periodic: bool,
    mask: Option<PathBuf>,
    guide: Option<PathBuf>,
    guide_weight: f32,
    compare: &str,
    channels: usize,
    store: &str,
    map: Option<PathBuf>,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
    params: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    for path in std::iter::once(&output).chain(&map) {
        check_output(py, path, overwrite)?;
    }
    let method = synth::by_name(method).map_err(|error| raise(py, &error))?;
    let request = SynthesisRequest {
        sample: if picture { Sample::Picture(source) } else { Sample::Material(source, Given::default()) },
        with: others,
        method,
        params: given(params)?.values(method.params()).map_err(|error| raise(py, &error))?,
        size,
        tileable,
        seed,
        mask,
        guide: guide.map(|file| (file, guide_weight)),
        periodic,
        features: word(py, "compare", compare, Features::ALL)?,
        channels,
        store: word(py, "store", store, Store::ALL)?,
        map,
        output,
    };
    let done = run(py, &How { progress, threads }, |progress| job::synthesize(&request, progress))?;
    to_python(py, &done)
}

/// Makes a material for the surface of a mesh: a built-in object, or an .obj, .ply, .gltf or .glb file.
///
/// Beside `output`, a `.loden` file, the mesh is written with its texture coordinates as `.glb`; render it with
/// `uv_scale=1`. `size` are texels per side of the atlas; each of `strokes` is six numbers, a point and a direction that
/// threads follow there.
///
/// Returns a dictionary as `loden synthesize --on --json` prints it.
#[pyfunction]
#[pyo3(signature = (source, mesh, output, *, size, seed = 0, strokes = Vec::new(), compare = "appearance", channels = 8,
    overwrite = false, progress = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn synthesize_on<'py>(
    py: Python<'py>,
    source: PathBuf,
    mesh: String,
    output: PathBuf,
    size: usize,
    seed: u64,
    strokes: Vec<[f64; 6]>,
    compare: &str,
    channels: usize,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let unwrapped = output.with_extension("glb");
    for path in [&output, &unwrapped] {
        check_output(py, path, overwrite)?;
    }
    let request = SurfaceRequest {
        sample: source,
        options: Given::default(),
        on: mesh,
        side: size,
        seed,
        strokes: strokes.iter().map(|&[x, y, z, dx, dy, dz]| Stroke { at: [x, y, z], along: [dx, dy, dz] }).collect(),
        features: word(py, "compare", compare, Features::ALL)?,
        channels,
        output,
        mesh: unwrapped,
    };
    let done = run(py, &How { progress, threads }, |progress| job::synthesize_on(&request, progress))?;
    to_python(py, &done)
}

/// Rearranges a picture by the source coordinates `map` that `synthesize` wrote.
#[pyfunction]
#[pyo3(signature = (map, picture, output, *, overwrite = false))]
fn apply_map(py: Python<'_>, map: PathBuf, picture: PathBuf, output: PathBuf, overwrite: bool) -> PyResult<()> {
    check_output(py, &output, overwrite)?;
    run(py, &How::default(), |_| job::apply_map(&map, &picture, &output))
}

/// Puts the reflectance of one material on the pattern of another and writes a `.loden` file.
///
/// `match` says how rows are matched: "transport", "assignment", "brightness" or "index"; `regularise` spreads the
/// transport over rows whose squared differences are that close to the best. `split` shares the texels of a row out among all rows that
/// the transport sends them to. `keep` is "nothing" or "shading". Materials
/// without rows are clustered into `clusters` first, and a warning says what that costs.
///
/// Returns a dictionary as `loden generate exchange --json` prints it.
#[pyfunction]
#[pyo3(signature = (structure, reflectance, output, *, r#match = "transport", regularise = None, split = false,
    keep = "nothing", clusters = 256, overwrite = false, progress = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn exchange<'py>(
    py: Python<'py>,
    structure: PathBuf,
    reflectance: PathBuf,
    output: PathBuf,
    r#match: &str,
    regularise: Option<f64>,
    split: bool,
    keep: &str,
    clusters: usize,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    check_output(py, &output, overwrite)?;
    let request = ExchangeRequest {
        structure,
        reflectance,
        options: Given::default(),
        by: word(py, "match", r#match, Match::ALL)?,
        epsilon: regularise,
        split,
        keep: word(py, "keep", keep, Keep::ALL)?,
        clusters,
        output,
    };
    let done = run(py, &How { progress, threads }, |progress| job::exchange(&request, progress))?;
    to_python(py, &done)
}

/// Mixes a second material into a first, everywhere or by a mask, and writes a `.loden` file.
///
/// The pattern of `first` is kept. `amount` is 0 to 1 and is multiplied by the brightness of `mask`, a picture of the
/// size of the first. Materials without rows are clustered into `clusters` first, and a warning says what that costs.
///
/// Returns a dictionary as `loden generate blend --json` prints it.
#[pyfunction]
#[pyo3(signature = (first, second, output, *, amount = 0.5, mask = None, clusters = 256, overwrite = false,
    progress = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn blend<'py>(
    py: Python<'py>,
    first: PathBuf,
    second: PathBuf,
    output: PathBuf,
    amount: f32,
    mask: Option<PathBuf>,
    clusters: usize,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    check_output(py, &output, overwrite)?;
    let request = BlendRequest { first, second, options: Given::default(), amount, mask, clusters, output };
    let done = run(py, &How { progress, threads }, |progress| job::blend(&request, progress))?;
    to_python(py, &done)
}

/// Changes the colour, gloss or contrast of a material, and writes a `.loden` file.
///
/// `recolor` is text such as "hue=90,saturation=0.8" or "from=d8b020,to=b02018", or a dictionary of the same; it changes the
/// diffuse part. `gloss` divides the roughness of highlights, `highlights` multiplies their strength, `contrast` is the
/// exponent of shadows, `tint` a colour RRGGBB, `exposure` in stops, `desaturate` 0 to 1.
///
/// At most one of these chooses what is changed: `rows`, a list of numbers; `colors`, a colour RRGGBB and a radius in
/// CIE Lab; `mask`, a picture; `grow`, column and row of a texel whose neighbours are taken as far as their colours are
/// `similar`. A material without rows is clustered into `clusters` first, and a warning says what that costs.
///
/// Returns a dictionary as `loden edit --json` prints it.
#[pyfunction]
#[pyo3(signature = (source, output, *, recolor = None, gloss = 1.0, highlights = 1.0, contrast = 1.0, tint = "ffffff",
    exposure = 0.0, desaturate = 0.0, rows = None, colors = None, mask = None, grow = None, similar = 10.0, clusters = 256,
    overwrite = false, progress = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn edit<'py>(
    py: Python<'py>,
    source: PathBuf,
    output: PathBuf,
    recolor: Option<&Bound<'py, PyAny>>,
    gloss: f32,
    highlights: f32,
    contrast: f32,
    tint: &str,
    exposure: f32,
    desaturate: f32,
    rows: Option<Vec<usize>>,
    colors: Option<(String, f64)>,
    mask: Option<PathBuf>,
    grow: Option<(usize, usize)>,
    similar: f64,
    clusters: usize,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    check_output(py, &output, overwrite)?;
    let tint = color(tint).map_err(|error| raise(py, &error))?.to_array();
    let recolor = recolor.map(|how| recolored(py, how)).transpose()?;
    let on = match (rows, colors, mask, grow) {
        (None, None, None, None) => On::Selection(Selection::All),
        (Some(rows), None, None, None) => On::Selection(Selection::Rows(rows)),
        (None, Some((center, radius)), None, None) => {
            let center = color(&center).map_err(|error| raise(py, &error))?;
            On::Selection(Selection::Colors { center, radius })
        }
        (None, None, Some(mask), None) => On::Mask(mask),
        (None, None, None, Some((x, y))) => On::Selection(Selection::Grow { x, y, radius: similar }),
        _ => return Err(wrong(py, "rows", "give one of rows, colors, mask and grow")),
    };
    let edit = Edit { recolor, gloss, highlights, contrast, tint, exposure, desaturate };
    let request = EditRequest { input: source, options: Given::default(), on, edit, clusters, output };
    let done = run(py, &How { progress, threads }, |progress| job::edit(&request, progress))?;
    to_python(py, &done)
}

/// Writes plausible variants of a material into the folder `output`: NAME-01.loden and so on, and a picture of all, sheet.png.
///
/// `count` edits are drawn at random, each property spread evenly over its range; `spread` says how different they are, 0 to 2. The
/// same `seed` gives the same files. `object` wears the material in the picture. A material without rows is clustered into `clusters`
/// first, and a warning says what that costs.
///
/// Returns a dictionary as `loden generate family --json` prints it.
#[pyfunction]
#[pyo3(signature = (source, output, *, count = 12, seed = 0, spread = 1.0, object = "cloth", clusters = 256, overwrite = false,
    progress = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn family<'py>(
    py: Python<'py>,
    source: PathBuf,
    output: PathBuf,
    count: usize,
    seed: u64,
    spread: f32,
    object: &str,
    clusters: usize,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    check_output(py, &output, overwrite)?;
    let look = Look { denoise: true, ..Look::new(object, 240, 224, 32) };
    let sheet = output.join("sheet.png");
    let request =
        FamilyRequest { input: source, options: Given::default(), count, seed, spread, look, clusters, output };
    let done = run(py, &How { progress, threads }, |progress| {
        let done = job::family(&request, progress)?;
        done.sheet.write(&sheet)?;
        Ok(done)
    })?;
    to_python(py, &done)
}

/// A change of colour from text or a dictionary.
fn recolored(py: Python<'_>, how: &Bound<'_, PyAny>) -> PyResult<Recolor> {
    let text = match how.cast::<PyDict>() {
        Ok(parts) => {
            let part =
                |(name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| Ok(format!("{}={}", name.str()?, value.str()?));
            parts.iter().map(part).collect::<PyResult<Vec<_>>>()?.join(",")
        }
        Err(_) => how.extract()?,
    };
    text.parse().map_err(|problem| wrong(py, "recolor", format!("{problem}")))
}
