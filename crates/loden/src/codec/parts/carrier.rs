//! Parts in 8-bit pictures, the carrier of renderers that read no other textures: every number is a pixel.
//!
//! # Model
//! A number of single precision is a pixel: alpha holds bits 31 to 24, red 23 to 16, green 15 to 8, blue 7 to 0. Pictures are TIFF files whose
//! sides are powers of two, padded with zeros. Two forms of recipe have a carrier:
//!
//! | form | pictures |
//! |---|---|
//! | a dot product per view | for each view the component images of c numbers per texel, tiled into one picture; all parameters in one picture of 81 c rows and 243 columns for 81 views and lights: a row per view and component, three columns per light. A mean, if there is one, is a further row of each view |
//! | one table row per texel | an index image, whose rows are numbered by green (high byte) and blue (low byte); a block image of 8-bit colours with a row per table row and a column per pair, lights fastest |
//!
//! [`MANIFEST`] says what the pictures do not: directions, size, encoding. The thesis keeps no mean and needs no such file.
//!
//! # Limits
//! A block holds display values between 0 and 1, rounded to 8 bits; everything else is kept bit for bit, as values of single precision.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{Axis, Curve, Expr, MemoryParts, Numbers, PlaneKind, PlaneSpec, Provenance, Recipe, TableSpec, Views};
use crate::btf::{BtfMeta, SampleType};
use crate::codec::container::{SourceInfo, VERSION, check_size};
use crate::codec::interpret::{Cell, Interpreter};
use crate::input::{self, guarded};
use crate::output::failed;
use crate::picture::decode::four_bytes;
use crate::picture::four_channels::{Samples, write as write_picture};
use crate::{Error, Result};

/// Name of the file that describes the pictures.
pub const MANIFEST: &str = "carrier.json";

/// Maximum size of the manifest in bytes.
const MAX_MANIFEST: u64 = 16 << 20;

/// Maximum number of views, whose pictures have numbers of three digits.
const MAX_VIEWS: usize = 1000;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    loden: String,
    btf: BtfMeta,
    curve: Curve,
    form: Form,
    /// What the names of the pictures begin with.
    prefix: String,
}

/// What the pictures hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) enum Form {
    /// Component images and parameters per view.
    Views {
        /// Components of a texel.
        components: usize,
        /// Whether there is a mean of each pair.
        mean: bool,
    },
    /// An index image and a block image.
    Index {
        /// Rows of the block.
        rows: usize,
    },
}

/// A recipe that has a carrier: its form, and which parts are meant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Carried {
    pub form: Form,
    pub plane: usize,
    pub table: usize,
    pub mean: Option<usize>,
}

/// The carrier of a recipe; `None` if it has none.
pub(crate) fn carried(recipe: &Recipe, meta: &BtfMeta) -> Option<Carried> {
    let has = |table: usize, axes: &[Axis]| {
        let found = &recipe.tables[table].axes;
        found.len() == axes.len() && axes.iter().all(|axis| found.contains(axis))
    };
    let (pair, views) = ([Axis::View, Axis::Light, Axis::Channel], meta.views.len());
    let dot = |expr: &Expr, mean: Option<usize>| {
        let Expr::Dot { plane, table, row: None } = *expr else { return None };
        let components = recipe.planes[plane].count();
        let suits = recipe.planes[plane].per_view() && views < MAX_VIEWS;
        let suits = suits && has(table, &[&pair[..], &[Axis::Component(components)]].concat());
        let suits = suits && mean.is_none_or(|mean| has(mean, &pair));
        suits.then_some(Carried { form: Form::Views { components, mean: mean.is_some() }, plane, table, mean })
    };
    match &recipe.value {
        Expr::Sum(terms) => match &terms[..] {
            [only] => dot(only, None),
            [Expr::Table { table, row: None }, other] | [other, Expr::Table { table, row: None }] => {
                dot(other, Some(*table))
            }
            _ => None,
        },
        Expr::Table { table, row: Some(plane) } => {
            let PlaneKind::Index { rows } = recipe.planes[*plane].kind else { return None };
            let suits = recipe.curve == Curve::Display && has(*table, &[&pair[..], &[Axis::Row(rows)]].concat());
            suits.then_some(Carried { form: Form::Index { rows }, plane: *plane, table: *table, mean: None })
        }
        other => dot(other, None),
    }
}

/// Sides of the pictures, powers of two.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sides {
    /// Component images beside each other.
    pub across: usize,
    /// Of the picture of a view, or of the index image.
    pub texels: [usize; 2],
    /// Of the parameters, or of the block image.
    pub table: [usize; 2],
}

impl Form {
    /// The sides of its pictures.
    pub(crate) fn sides(self, meta: &BtfMeta) -> Sides {
        let padded = |sides: [usize; 2]| sides.map(usize::next_power_of_two);
        match self {
            Self::Views { components, mean } => {
                let across = components.isqrt() + usize::from(components.isqrt().pow(2) < components);
                let texels = [across * meta.width, components.div_ceil(across) * meta.height];
                let rows = (components + usize::from(mean)) * meta.views.len();
                Sides { across, texels: padded(texels), table: padded([3 * meta.lights.len(), rows]) }
            }
            Self::Index { rows } => Sides {
                across: 1,
                texels: padded([meta.width, meta.height]),
                table: padded([meta.views.len() * meta.lights.len(), rows]),
            },
        }
    }
}

/// Names of the pictures: of the texels, one for each view or one, and of the table.
fn names(form: Form, prefix: &str, meta: &BtfMeta) -> (Vec<String>, String) {
    match form {
        Form::Views { .. } => {
            let of_view = |view| format!("{prefix}_view{view:03}.tif");
            ((0..meta.views.len()).map(of_view).collect(), format!("{prefix}_parameters.tif"))
        }
        Form::Index { .. } => (vec![format!("{prefix}_index.tif")], format!("{prefix}_block.tif")),
    }
}

/// The pixel of a number.
pub(crate) fn pixel(number: f32) -> [u8; 4] {
    let [alpha, red, green, blue] = number.to_bits().to_be_bytes();
    [red, green, blue, alpha]
}

fn number([red, green, blue, alpha]: [u8; 4]) -> f32 {
    f32::from_bits(u32::from_be_bytes([alpha, red, green, blue]))
}

/// A picture under construction.
struct Canvas {
    sides: [usize; 2],
    pixels: Vec<u8>,
}

impl Canvas {
    fn new(sides: [usize; 2]) -> Self {
        Self { sides, pixels: vec![0; 4 * sides[0] * sides[1]] }
    }

    fn put(&mut self, [x, y]: [usize; 2], pixel: [u8; 4]) {
        let at = 4 * (y * self.sides[0] + x);
        self.pixels[at..at + 4].copy_from_slice(&pixel);
    }

    fn at(&self, [x, y]: [usize; 2]) -> [u8; 4] {
        let at = 4 * (y * self.sides[0] + x);
        std::array::from_fn(|k| self.pixels[at + k])
    }

    fn write(&self, path: &Path) -> Result<()> {
        write_picture(path, self.sides, Samples::Bytes(&self.pixels))
    }

    fn read(path: &Path, sides: [usize; 2]) -> Result<Self> {
        let bytes = fs::read(path).map_err(Error::io(path))?;
        let failed = |problem: String| Error::invalid(path, "TIFF", problem);
        let (found, pixels) =
            guarded("TIFF", || four_bytes(&bytes)).map_err(failed)?.map_err(|e| failed(e.to_string()))?;
        if found != sides {
            let problem = format!("found {} x {}, expected {} x {}", found[0], found[1], sides[0], sides[1]);
            return Err(Error::invalid(path, "size", problem));
        }
        Ok(Self { sides, pixels })
    }
}

/// The place of a component of a texel in the picture of a view.
fn place_of(meta: &BtfMeta, sides: &Sides, texel: usize, component: usize) -> [usize; 2] {
    [
        component % sides.across * meta.width + texel % meta.width,
        component / sides.across * meta.height + texel / meta.width,
    ]
}

/// Writes the pictures and their description into a folder. The numbers are explicit ([`Interpreter::explicit`]).
///
/// # Errors
/// [`Error::Unsupported`] for a block whose values are not between 0 and 1, naming `path`; [`Error::Io`].
pub(crate) fn write(
    path: &Path,
    meta: &BtfMeta,
    numbers: &Interpreter,
    carried: &Carried,
    folder: &Path,
    prefix: &str,
) -> Result<()> {
    let sides = carried.form.sides(meta);
    let (texels, table) = names(carried.form, prefix, meta);
    let plane = numbers.plane(carried.plane);
    let mut parameters = Canvas::new(sides.table);
    match carried.form {
        Form::Views { components, mean } => {
            for (view, name) in texels.iter().enumerate() {
                let mut canvas = Canvas::new(sides.texels);
                for (k, &number) in
                    plane[view * meta.texels() * components..][..meta.texels() * components].iter().enumerate()
                {
                    canvas.put(place_of(meta, &sides, k / components, k % components), pixel(number));
                }
                canvas.write(&folder.join(name))?;
            }
            let rows = components + usize::from(mean);
            for (k, column) in
                (0..meta.views.len() * rows).flat_map(|k| (0..3 * meta.lights.len()).map(move |x| (k, x)))
            {
                let (view, component) = (k / rows, k % rows);
                let cell = Cell { view, component, light: column / 3, channel: column % 3, ..Cell::default() };
                let table = carried.mean.filter(|_| component == components).unwrap_or(carried.table);
                parameters.put([column, k], pixel(numbers.number(table, cell) as f32));
            }
        }
        Form::Index { rows } => {
            let mut canvas = Canvas::new(sides.texels);
            for (texel, &row) in plane.iter().enumerate() {
                let [low, high] = (row as u16).to_le_bytes();
                canvas.put([texel % meta.width, texel / meta.width], [0, high, low, 255]);
            }
            canvas.write(&folder.join(&texels[0]))?;
            let pairs = meta.views.len() * meta.lights.len();
            for (row, pair) in (0..rows).flat_map(|row| (0..pairs).map(move |pair| (row, pair))) {
                let cell =
                    Cell { row, view: pair / meta.lights.len(), light: pair % meta.lights.len(), ..Cell::default() };
                let values = [0, 1, 2].map(|channel| numbers.number(carried.table, Cell { channel, ..cell }));
                if !values.iter().all(|value| (-0.001..1.002).contains(value)) {
                    let problem = format!("a block image holds values between 0 and 1; row {row} has {values:?}");
                    return Err(Error::unsupported(path, problem));
                }
                let [r, g, b] = values.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8);
                parameters.put([pair, row], [r, g, b, 255]);
            }
        }
    }
    parameters.write(&folder.join(table))?;
    let (curve, form, prefix) = (numbers.recipe().curve, carried.form, prefix.to_owned());
    let manifest = Manifest { loden: VERSION.into(), btf: meta.clone(), curve, form, prefix };
    let text = serde_json::to_string_pretty(&manifest).map_err(|e| Error::io(folder)(e.into()))?;
    let path = folder.join(MANIFEST);
    fs::write(&path, text + "\n").map_err(failed(&path))
}

/// Reads parts from the pictures of a folder.
///
/// # Errors
/// [`Error::Invalid`], [`Error::Limit`] or [`Error::Unsupported`] naming the file and the field; [`Error::Io`].
pub fn read(folder: &Path) -> Result<(MemoryParts, Provenance)> {
    let path = folder.join(MANIFEST);
    let Manifest { btf, curve, form, prefix, .. } = manifest(&path)?;
    check_size(&path, &btf)?;
    btf.check_pairs().map_err(|error| Error::invalid(&path, "btf", error.to_string()))?;
    if prefix.contains(['/', '\\']) {
        return Err(Error::invalid(&path, "prefix", format!("found {prefix:?}, expected no folder")));
    }
    let count = match form {
        Form::Views { components, .. } => components,
        Form::Index { rows } => rows,
    };
    if !(1..=65536).contains(&count) || btf.views.len() >= MAX_VIEWS {
        return Err(Error::invalid(
            &path,
            "form",
            format!("found {count} numbers and {} views, which are too many or none", btf.views.len()),
        ));
    }
    let sides = form.sides(&btf);
    let (texels, table) = names(form, &prefix, &btf);
    let pictures = texels.iter().map(|name| Canvas::read(&folder.join(name), sides.texels));
    let pictures = pictures.collect::<Result<Vec<_>>>()?;
    let parameters = Canvas::read(&folder.join(table), sides.table)?;
    let (recipe, planes, tables) = match form {
        Form::Views { components, mean } => views(&btf, curve, [components, usize::from(mean)], &pictures, &parameters),
        Form::Index { rows } => index(&btf, curve, rows, &pictures[0], &parameters),
    };
    let source = SourceInfo { bytes: 0, sample_type: SampleType::F32, missing: Vec::new(), identity: None };
    let located = |error: Error| match error {
        Error::Parameter { name, problem } => Error::invalid(folder, name, problem),
        other => other,
    };
    let parts = MemoryParts::new(btf, recipe, planes, tables).map_err(located)?;
    Ok((parts, Provenance::unknown(source)))
}

fn manifest(path: &Path) -> Result<Manifest> {
    let bytes = fs::metadata(path).map_err(Error::io(path))?.len();
    if bytes > MAX_MANIFEST {
        return Err(Error::Limit { path: path.into(), field: "bytes".into(), found: bytes, limit: MAX_MANIFEST });
    }
    let text = fs::read(path).map_err(Error::io(path))?;
    serde_json::from_slice(&text).map_err(|e| Error::invalid(path, "JSON", input::in_words(&e.to_string())))
}

type Content = (Recipe, Vec<Numbers>, Vec<Numbers>);

fn views(
    meta: &BtfMeta,
    curve: Curve,
    [components, mean]: [usize; 2],
    pictures: &[Canvas],
    parameters: &Canvas,
) -> Content {
    let sides = Form::Views { components, mean: mean == 1 }.sides(meta);
    let of_view = |picture: &Canvas| {
        let at = |k: usize| number(picture.at(place_of(meta, &sides, k / components, k % components)));
        (0..meta.texels() * components).map(at).collect::<Vec<_>>()
    };
    let plane: Vec<f32> = pictures.iter().flat_map(of_view).collect();
    let rows = |wanted: std::ops::Range<usize>| {
        let row = move |view: usize| wanted.clone().map(move |k| view * (components + mean) + k);
        let columns = 3 * meta.lights.len();
        let all = (0..meta.views.len()).flat_map(row).flat_map(move |y| (0..columns).map(move |x| [x, y]));
        Numbers::F32(all.map(|at| number(parameters.at(at))).collect::<Vec<_>>().into())
    };
    let axes = [Axis::View, Axis::Component(components), Axis::Light, Axis::Channel];
    let (mut specs, mut tables) = (vec![TableSpec::new("basis", &axes, SampleType::F32)], vec![rows(0..components)]);
    let mut terms = vec![Expr::dot(0, 0)];
    if mean == 1 {
        specs.push(TableSpec::new("mean", &[Axis::View, Axis::Light, Axis::Channel], SampleType::F32));
        tables.push(rows(components..components + 1));
        terms.insert(0, Expr::table(1));
    }
    let kind = PlaneKind::Numbers { count: components, views: Views::Each, sample_type: SampleType::F32, range: None };
    let planes = vec![PlaneSpec { name: "coefficients".into(), kind }];
    let recipe = Recipe { planes, tables: specs, value: Expr::Sum(terms), curve };
    (recipe, vec![Numbers::F32(plane.into())], tables)
}

fn index(meta: &BtfMeta, curve: Curve, rows: usize, picture: &Canvas, block: &Canvas) -> Content {
    let row = |texel: usize| {
        let [_, high, low, _] = picture.at([texel % meta.width, texel / meta.width]);
        u16::from_le_bytes([low, high])
    };
    let index: Vec<u16> = (0..meta.texels()).map(row).collect();
    let pairs = meta.views.len() * meta.lights.len();
    let colours = (0..rows).flat_map(|row| (0..pairs).map(move |pair| block.at([pair, row])));
    let values: Vec<f32> = colours.flat_map(|[r, g, b, _]| [r, g, b].map(|byte| f32::from(byte) / 255.0)).collect();
    let axes = [Axis::Row(rows), Axis::View, Axis::Light, Axis::Channel];
    let recipe = Recipe {
        planes: vec![PlaneSpec::index("index", rows)],
        tables: vec![TableSpec::new("block", &axes, SampleType::F32)],
        value: Expr::Table { table: 0, row: Some(0) },
        curve,
    };
    (recipe, vec![Numbers::Index(index.into())], vec![Numbers::F32(values.into())])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_pixels_bit_for_bit() {
        // sign in the highest bit of alpha, exponent across alpha and red
        assert_eq!(pixel(-1.0), [0x80, 0, 0, 0xbf]);
        for bits in [0u32, 1, 0x0080_0000, 0x7f7f_ffff, 0x8000_0001, 0xc123_4567, 0x3f80_0000] {
            assert_eq!(number(pixel(f32::from_bits(bits))).to_bits(), bits);
        }
    }
}
