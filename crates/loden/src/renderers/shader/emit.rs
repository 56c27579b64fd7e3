//! Writes a recipe as a program, and its numbers into textures.

use std::fmt::Write;
use std::path::Path;

use super::bank::{Bank, Format};
use super::lang::Program;
use super::models;
use crate::btf::{BtfMeta, Cosine};
use crate::codec::interpret::{Cell, Interpreter};
use crate::codec::parts::{Axis, Curve, Expr, PlaneKind, TableSpec};
use crate::color::Encoding;
use crate::direction::{DirectionSet, TriangleTables};
use crate::material::Blending;
use crate::{Error, Result};

/// What every program has: the search for directions and texels.
const CORE: &str = include_str!("core.glsl");

/// Directions of light and viewer, with the sampled ones around them, as parameters of functions.
const PLACE: &str = "ivec3 views, vec3 view_weights, ivec3 lights, vec3 light_weights, vec3 wi, vec3 wo";

/// The same as arguments.
const PLACED: &str = "views, view_weights, lights, light_weights, wi, wo";

/// What an expression is evaluated for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Over {
    /// The mean of the four texels around the texture coordinate, and of the sampled directions around light and viewer.
    Four,
    /// One texel, and the mean of sampled directions.
    One,
    /// One texel and one sampled pair of directions.
    Pair,
}

impl Over {
    fn params(self) -> String {
        match self {
            Self::Four => format!("ivec4 texels, vec4 texel_weights, {PLACE}"),
            Self::One => format!("int texel, {PLACE}"),
            Self::Pair => "int texel, int view, int light, vec3 wi, vec3 wo".into(),
        }
    }

    fn arguments(self) -> String {
        match self {
            Self::Four => format!("texels, texel_weights, {PLACED}"),
            Self::One => format!("texel, {PLACED}"),
            Self::Pair => "texel, view, light, wi, wo".into(),
        }
    }
}

/// A table, or a table with the plane that it is multiplied by.
struct Leaf {
    table: usize,
    row: Option<usize>,
    plane: Option<usize>,
}

/// A counted loop, with what is done first inside it.
struct Loop {
    variable: &'static str,
    end: usize,
    inside: Vec<String>,
}

/// The loops of a function, outermost first, that adds up `sum`.
#[derive(Default)]
struct Loops {
    /// Lines before the loops.
    before: Vec<String>,
    all: Vec<Loop>,
    /// Factors of the weight of a cell.
    weight: Vec<&'static str>,
    /// The number of a cell; empty if there is one.
    cell: String,
}

impl Loops {
    /// Adds an axis of cells, faster than those before it.
    fn axis(&mut self, name: &str, length: usize) {
        let cell = std::mem::take(&mut self.cell);
        self.cell = if cell.is_empty() { name.into() } else { format!("({cell} * {length} + {name})") };
    }

    /// Adds a loop outside all but the first `outside`.
    fn add(&mut self, more: Loop, outside: usize) {
        self.all.insert(outside, more);
    }

    /// The weight, as the first factor of a product.
    fn weights(&self) -> String {
        self.weight.iter().map(|factor| format!("{factor} * ")).collect()
    }

    /// The body of the function, with these lines in the innermost loop.
    fn body(&self, innermost: &[String]) -> String {
        let indent = |depth: usize| "    ".repeat(depth + 1);
        let mut body = format!("{}vec3 sum = vec3(0.0);\n", indent(0));
        body.extend(self.before.iter().map(|line| format!("{}{line}\n", indent(0))));
        for (depth, Loop { variable, end, inside }) in self.all.iter().enumerate() {
            let _ = writeln!(body, "{}for (int {variable} = 0; {variable} < {end}; {variable}++) {{", indent(depth));
            body.extend(inside.iter().map(|line| format!("{}{line}\n", indent(depth + 1))));
        }
        body.extend(innermost.iter().map(|line| format!("{}{line}\n", indent(self.all.len()))));
        body.extend((0..self.all.len()).rev().map(|depth| format!("{}}}\n", indent(depth))));
        let _ = writeln!(body, "{}return sum;", indent(0));
        body
    }
}

/// Where parts begin in their textures, once they are written.
#[derive(Debug, Default)]
pub(in crate::renderers) struct Places {
    pub planes: Vec<Option<usize>>,
    pub tables: Vec<Option<usize>>,
}

/// The state of writing one material.
pub(super) struct Emitter<'a> {
    path: &'a Path,
    meta: &'a BtfMeta,
    /// Its numbers, without offsets and scales.
    numbers: &'a Interpreter,
    pub banks: [Bank; 3],
    /// Addresses of planes and tables.
    pub places: Places,
    /// Functions written so far.
    source: String,
    functions: usize,
}

impl<'a> Emitter<'a> {
    pub fn new(path: &'a Path, meta: &'a BtfMeta, numbers: &'a Interpreter, format: Format) -> Self {
        let banks =
            [Bank::new("numbers", format), Bank::new("indices", Format::Byte), Bank::new("directions", Format::Single)];
        let recipe = numbers.recipe();
        let places = Places { planes: vec![None; recipe.planes.len()], tables: vec![None; recipe.tables.len()] };
        Self { path, meta, numbers, banks, places, source: String::new(), functions: 0 }
    }

    /// The whole program; its function `apparent` is for users.
    ///
    /// # Errors
    /// [`Error::Unsupported`].
    pub fn program(mut self, views: &TriangleTables, lights: &TriangleTables) -> Result<(Program, [Bank; 3], Places)> {
        let recipe = self.numbers.recipe();
        let over = if recipe.blending(Blending::Auto) == Blending::Linear { Over::Pair } else { Over::Four };
        let value = self.value(&recipe.value, over)?;
        let [views, lights] = [(views, &self.meta.views), (lights, &self.meta.lights)].map(|(t, set)| self.set(t, set));
        let mut text = String::from("const float PI = 3.14159265;\n");
        let (width, height, side) = (self.meta.width, self.meta.height, views.2);
        for (name, number) in [("WIDTH", width), ("HEIGHT", height), ("GRID", side)] {
            let _ = writeln!(text, "const int {name} = {number};");
        }
        let _ = writeln!(text, "{CORE}\n{}", self.source);
        let _ = writeln!(text, "vec3 value_of({}) {{\n    return {value};\n}}\n", over.params());
        let _ = writeln!(
            text,
            "// Linear light from the numbers that the recipe gives.\n{}",
            linear(recipe.curve, self.meta.encoding)
        );
        text += &light(over);
        let included = self.meta.cosine == Cosine::Included && recipe.curve != Curve::Brdf;
        let factor = if included { "fade(light_cell, light)" } else { "light.z" };
        let _ = write!(
            text,
            "
// Pi times the BRDF times the cosine of the light, in linear RGB: what the surface reflects of a light of irradiance pi. wi and
// wo are unit vectors to the light and to the viewer in the frame of the surface: x where u grows, y where v grows, z outwards.
vec3 apparent(vec2 uv, vec3 wi, vec3 wo) {{
    vec3 light = wi.z > 0.0 ? wi : vec3(0.0, 0.0, 1.0);
    vec3 viewer = wo.z > 0.0 ? wo : vec3(0.0, 0.0, 1.0);
    int view_cell = find_cell({}, {}, viewer);
    int light_cell = find_cell({}, {}, light);
    vec3 shown = light_of(texels_around(uv), texel_weights_around(uv), corners(view_cell), corner_weights(view_cell, viewer),
        corners(light_cell), corner_weights(light_cell, light), light, viewer);
    return wi.z > 0.0 && wo.z > 0.0 ? shown * {factor} : vec3(0.0);
}}
",
            views.0, views.1, lights.0, lights.1
        );
        Ok((Program::parse(&text)?, self.banks, self.places))
    }

    /// An expression of the language that has the value of `expr`.
    fn value(&mut self, expr: &Expr, over: Over) -> Result<String> {
        let single = |expr: &Expr| match expr {
            Expr::Table { row, .. } | Expr::Dot { row, .. } => row.is_some(),
            Expr::Product(_) | Expr::Model { .. } | Expr::Network { .. } | Expr::Shift { .. } => true,
            Expr::Sum(_) | Expr::Channels(_) => false,
        };
        if over == Over::Four && single(expr) {
            return self.mean(expr);
        }
        Ok(match expr {
            Expr::Table { table, row } => self.leaf(&Leaf { table: *table, row: *row, plane: None }, over),
            Expr::Dot { plane, table, row } => self.leaf(&Leaf { table: *table, row: *row, plane: Some(*plane) }, over),
            Expr::Model { name, lobes, grain, plane } => {
                let address = self.plane(*plane);
                let (source, call) = models::model(self.path, name, *lobes, *grain, address)?;
                self.source += &source;
                call
            }
            Expr::Network { .. } | Expr::Shift { .. } => {
                return Err(Error::unsupported(self.path, "a shader knows no neural networks and no parallax"));
            }
            Expr::Sum(terms) => self.all(terms, over)?.join(" + "),
            Expr::Product(terms) => {
                let factors = self.all(terms, over)?;
                factors.iter().map(|factor| format!("({factor})")).collect::<Vec<_>>().join(" * ")
            }
            Expr::Channels(channels) => {
                let [r, g, b]: [String; 3] = match self.all(&channels[..], over)?.try_into() {
                    Ok(channels) => channels,
                    Err(_) => return Err(Error::unsupported(self.path, "its channels are not three")),
                };
                format!("vec3(({r}).x, ({g}).y, ({b}).z)")
            }
        })
    }

    fn all(&mut self, terms: &[Expr], over: Over) -> Result<Vec<String>> {
        terms.iter().map(|term| self.value(term, over)).collect()
    }

    fn fresh(&mut self, name: &str) -> String {
        self.functions += 1;
        format!("{name}_{}", self.functions)
    }

    /// The mean over texels of what is not linear in the numbers of a texel.
    fn mean(&mut self, expr: &Expr) -> Result<String> {
        let value = self.value(expr, Over::One)?;
        let name = self.fresh("at_texel");
        let _ = writeln!(self.source, "vec3 {name}({}) {{\n    return {value};\n}}\n", Over::One.params());
        let mean = self.fresh("mean");
        let _ = writeln!(
            self.source,
            "vec3 {mean}(ivec4 texels, vec4 texel_weights, {PLACE}) {{
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; k++) {{
        sum += texel_weights[k] * {name}(texels[k], {PLACED});
    }}
    return sum;
}}
"
        );
        Ok(format!("{mean}(texels, texel_weights, {PLACED})"))
    }

    /// The address of a plane, whose numbers are written if they have not been.
    fn plane(&mut self, plane: usize) -> usize {
        if let Some(address) = self.places.planes[plane] {
            return address;
        }
        let (numbers, spec) = (self.numbers.plane(plane), &self.numbers.recipe().planes[plane]);
        let address = match spec.kind {
            PlaneKind::Index { rows } => {
                let bytes = if rows <= 256 { 1 } else { 2 };
                let split = |&row: &f32| (0..bytes).map(move |byte| ((row as u32 >> (8 * byte)) & 255) as f32);
                self.banks[1].push(numbers.iter().flat_map(split))
            }
            PlaneKind::Numbers { count, .. } => self.banks[0].push(padded(numbers.chunks_exact(count))),
        };
        *self.places.planes[plane].insert(address)
    }

    /// A call of a function that interpolates a table, or a dot product with a table, between directions.
    fn leaf(&mut self, leaf: &Leaf, over: Over) -> String {
        let recipe = self.numbers.recipe();
        let spec = &recipe.tables[leaf.table];
        let table = self.table(spec, leaf.table);
        self.places.tables[leaf.table] = Some(table);
        let mut loops = self.around(leaf, over);
        let groups = leaf.plane.map(|plane| {
            let groups = recipe.planes[plane].count().div_ceil(4);
            let outside = usize::from(over != Over::Pair && recipe.planes[plane].per_view());
            loops.add(self.coefficients(plane, groups, over), outside);
            groups
        });
        let colored = spec.axes.contains(&Axis::Channel);
        let dot = |k: usize| format!("dot(coefficients, number(at + {k}))");
        // the texels of a cell, the place among them, and what they give
        let (unit, group, value) = match (groups, colored) {
            (Some(groups), true) => (3 * groups, " + 3 * g", format!("vec3({}, {}, {})", dot(0), dot(1), dot(2))),
            (Some(groups), false) => (groups, " + g", format!("vec3({})", dot(0))),
            (None, true) => (1, "", "number(at).xyz".into()),
            (None, false) => (1, "", "vec3(number(at).x)".into()),
        };
        let cell = if loops.cell.is_empty() { String::new() } else { format!(" + {unit} * {}", loops.cell) };
        let body =
            loops.body(&[format!("int at = {table}{cell}{group};"), format!("sum += {}{value};", loops.weights())]);
        let name = self.fresh("table");
        let times = leaf.plane.map(|plane| format!(" times the plane {}", recipe.planes[plane].name));
        let comment = format!("The table {}{}, interpolated between directions.", spec.name, times.unwrap_or_default());
        let _ = writeln!(self.source, "// {comment}\nvec3 {name}({}) {{\n{body}}}\n", over.params());
        format!("{name}({})", over.arguments())
    }

    /// The loops over all cells of a table around a place, and the place of a cell in the table.
    fn around(&mut self, leaf: &Leaf, over: Over) -> Loops {
        let recipe = self.numbers.recipe();
        let spec = &recipe.tables[leaf.table];
        let per_view = leaf.plane.is_some_and(|plane| recipe.planes[plane].per_view());
        let mut loops = Loops::default();
        if let (Some(rows), Some(row)) = (spec.rows(), leaf.row) {
            let bits = if rows <= 256 { 8 } else { 16 };
            loops.before.push(format!("int row = index_{bits}({}, texel);", self.plane(row)));
            loops.axis("row", rows);
        }
        // a sampled pair is given as `view` and `light`
        let averaged = over != Over::Pair;
        if averaged && (per_view || spec.axes.contains(&Axis::View)) {
            loops.all.push(Loop { variable: "v", end: 3, inside: vec!["int view = views[v];".into()] });
            loops.weight.push("view_weights[v]");
        }
        if spec.axes.contains(&Axis::View) {
            loops.axis("view", self.meta.views.len());
        }
        if spec.axes.contains(&Axis::Light) {
            if averaged {
                loops.all.push(Loop { variable: "l", end: 3, inside: vec!["int light = lights[l];".into()] });
                loops.weight.push("light_weights[l]");
            }
            loops.axis("light", self.meta.lights.len());
        }
        if let Some((side, vector)) = grid(spec) {
            loops.before.push(format!("vec2 place = place_on_grid({vector}(wi, wo), {side}.0);"));
            loops.before.push(format!("ivec2 before = node_before(place, {side});"));
            loops.before.push("vec2 part = place - vec2(float(before.x), float(before.y));".into());
            let inside = vec![
                "int down = n / 2;".into(),
                "int right = n - 2 * down;".into(),
                format!("int node = (before.y + down) * {side} + before.x + right;"),
                "float beside = right == 1 ? part.x : 1.0 - part.x;".into(),
                "float node_weight = beside * (down == 1 ? part.y : 1.0 - part.y);".into(),
            ];
            loops.all.push(Loop { variable: "n", end: 4, inside });
            loops.weight.push("node_weight");
            loops.axis("node", side * side);
        }
        loops
    }

    /// The loop that reads the numbers of a plane by groups of four.
    fn coefficients(&mut self, plane: usize, groups: usize, over: Over) -> Loop {
        let address = self.plane(plane);
        let per_view = self.numbers.recipe().planes[plane].per_view();
        let view = if per_view { format!(" + {} * view", groups * self.meta.texels()) } else { String::new() };
        let first = format!("{address}{view} + g");
        let four = match over {
            Over::Four => format!("mean_of({first}, {groups}, texels, texel_weights)"),
            Over::One | Over::Pair => format!("number({first} + {groups} * texel)"),
        };
        Loop { variable: "g", end: groups, inside: vec![format!("vec4 coefficients = {four};")] }
    }

    /// Writes a table: cells (row, view, light, node) with one texel, or with components a group of four after the other, for
    /// each channel if it has any.
    fn table(&mut self, spec: &TableSpec, table: usize) -> usize {
        let length =
            |kind: fn(&Axis) -> bool| spec.axes.iter().find(|axis| kind(axis)).map_or(1, |axis| axis.len(self.meta));
        let rows = length(|axis| matches!(axis, Axis::Row(_)));
        let views = length(|axis| matches!(axis, Axis::View));
        let lights = length(|axis| matches!(axis, Axis::Light));
        let nodes = length(|axis| matches!(axis, Axis::Half(_) | Axis::Difference(_)));
        let channels = length(|axis| matches!(axis, Axis::Channel));
        let numbers = self.numbers;
        let cells = (0..rows * views * lights * nodes).map(move |k| Cell {
            row: k / (views * lights * nodes),
            view: k / (lights * nodes) % views,
            light: k / nodes % lights,
            node: k % nodes,
            ..Cell::default()
        });
        let Some(components) = spec.components() else {
            let texel = move |cell: Cell| {
                (0..4).map(move |channel| {
                    if channel < channels { numbers.number(table, Cell { channel, ..cell }) as f32 } else { 0.0 }
                })
            };
            return self.banks[0].push(cells.flat_map(texel));
        };
        let groups = components.div_ceil(4);
        let texels = move |cell: Cell| {
            (0..groups * channels * 4).map(move |k| {
                let (component, channel) = (k / (4 * channels) * 4 + k % 4, k / 4 % channels);
                let at = Cell { component, channel, ..cell };
                if component < components { numbers.number(table, at) as f32 } else { 0.0 }
            })
        };
        self.banks[0].push(cells.flat_map(texels))
    }

    /// Writes the cells of a direction set: address, number of cells, and side of the grid of starting cells.
    fn set(&mut self, tables: &TriangleTables, set: &DirectionSet) -> (usize, usize, usize) {
        let address = self.banks[2].push(tables.start.iter().map(|&cell| f32::from(cell)));
        let index = |k: u32| if k == u32::MAX { -1.0 } else { k as f32 };
        for (k, rows) in tables.rows.iter().enumerate() {
            let (corners, neighbours) = (tables.corners[k], tables.neighbours[k]);
            let matrix =
                (0..3).flat_map(|row| [rows[3 * row], rows[3 * row + 1], rows[3 * row + 2], corners[row] as f32]);
            let cosine = |corner: u32| set.directions()[corner as usize].z;
            let beyond = [index(neighbours[0]), index(neighbours[1]), index(neighbours[2]), 0.0];
            let sector = if k < tables.triangles { 0.0 } else { 1.0 };
            let edge = [cosine(corners[0]), cosine(corners[1]), sector, 0.0];
            self.banks[2].push(matrix.chain(beyond).chain(edge));
        }
        (address, tables.rows.len(), tables.start.len().isqrt())
    }
}

/// The function that gives linear light around a point: of the mean value, or the mean over texels and sampled pairs.
fn light(over: Over) -> String {
    let head = format!("vec3 light_of({})", Over::Four.params());
    if over == Over::Four {
        return format!("{head} {{\n    return max(linear(value_of({})), vec3(0.0));\n}}\n", over.arguments());
    }
    format!(
        "// The mean of linear light over texels and sampled pairs of directions.
{head} {{
    vec3 sum = vec3(0.0);
    for (int v = 0; v < 3; v++) {{
        for (int l = 0; l < 3; l++) {{
            for (int k = 0; k < 4; k++) {{
                vec3 value = value_of(texels[k], views[v], lights[l], wi, wo);
                sum += view_weights[v] * light_weights[l] * texel_weights[k] * max(linear(value), vec3(0.0));
            }}
        }}
    }}
    return sum;
}}
"
    )
}

/// The side of a table's grid, and the function that gives the vector on it.
fn grid(spec: &TableSpec) -> Option<(usize, &'static str)> {
    spec.axes.iter().find_map(|axis| match axis {
        Axis::Half(side) => Some((*side, "half_vector")),
        Axis::Difference(side) => Some((*side, "difference_vector")),
        _ => None,
    })
}

/// Rows of numbers, each padded to groups of four.
fn padded<'n>(rows: impl Iterator<Item = &'n [f32]>) -> impl Iterator<Item = f32> {
    rows.flat_map(|row| row.iter().copied().chain(std::iter::repeat_n(0.0, row.len().next_multiple_of(4) - row.len())))
}

/// The function that turns the numbers of a recipe into linear light.
fn linear(curve: Curve, encoding: Encoding) -> String {
    let each = |value: &str| {
        format!(
            "float linear_channel(float value) {{\n    return {value};\n}}\n\nvec3 linear(vec3 value) {{\n    return vec3(linear_channel(value.x), linear_channel(value.y), linear_channel(value.z));\n}}\n"
        )
    };
    match (curve, encoding.display()) {
        (Curve::Display, Encoding::Gamma(gamma)) => each(&format!("pow(max(value, 0.0), {gamma:?})")),
        (Curve::Display, _) => each("value <= 0.04045 ? value / 12.92 : pow(max((value + 0.055) / 1.055, 0.0), 2.4)"),
        (Curve::Log, _) => each("exp(min(value, 80.0)) - 0.001"),
        (Curve::LogYuv, _) => "vec3 linear(vec3 value) {
    float y = exp(min(value.x, 40.0));
    float u = value.y * y;
    float v = value.z * y;
    float luminance = y - 0.00001;
    return vec3(luminance + 1.13983 * v, luminance - 0.39465 * u - 0.5806 * v, luminance + 2.03211 * u);
}
"
        .into(),
        (Curve::Linear | Curve::Brdf, _) => "vec3 linear(vec3 value) {\n    return value;\n}\n".into(),
    }
}
