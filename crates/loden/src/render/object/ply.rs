//! Reader of Stanford PLY files, ASCII or binary.

use std::collections::HashMap;
use std::path::Path;
use std::str::FromStr;

use glam::{DVec3, Vec2, Vec3};

use super::polygons::Polygons;
use crate::{Error, Result};

/// Maximum header size in bytes; limits the search in a file that has no header.
const MAX_HEADER: usize = 1 << 16;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl FromStr for Number {
    type Err = ();
    fn from_str(name: &str) -> std::result::Result<Self, ()> {
        Ok(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(()),
        })
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    Text,
    Little,
    Big,
}

struct Property {
    name: String,
    number: Number,
    /// The type of the list length, if this is a list.
    count: Option<Number>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Reads vertices (x, y, z; nx, ny, nz; u, v or s, t or texture_u, texture_v), faces and triangle strips. Texture
/// coordinates of faces (`texcoord`) come before those of vertices. Other elements and properties are ignored.
pub(super) fn read(path: &Path) -> Result<Polygons> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    parse(&bytes).map_err(|(field, problem)| Error::invalid(path, field, problem))
}

type Parsed<T> = std::result::Result<T, (String, String)>;

fn bad<T>(field: &str, problem: impl Into<String>) -> Parsed<T> {
    Err((field.into(), problem.into()))
}

fn parse(bytes: &[u8]) -> Parsed<Polygons> {
    let mut reader = Reader::default();
    let (form, elements, body) = header(bytes, &mut reader.polygons.warnings)?;
    let rows = elements.iter().fold(0, |rows, element| element.count.saturating_add(rows));
    let mut body = Body::new(form, body, rows);
    for element in &elements {
        let layout = Layout::new(element)?;
        if !["vertex", "face", "tristrips"].contains(&element.name.as_str()) && element.count > 0 {
            let warning = format!("elements {:?} are ignored ({})", element.name, element.count);
            reader.polygons.warnings.push(warning);
        }
        let mut values = vec![Vec::new(); element.properties.len()];
        for row in 0..element.count {
            body.begin_row();
            for (property, values) in element.properties.iter().zip(&mut values) {
                body.property(property, values).map_err(|problem| (format!("{} {row}", element.name), problem))?;
            }
            reader.counts.longer += usize::from(body.end_row());
            match element.name.as_str() {
                "vertex" => reader.vertex(&layout, &values),
                "face" => reader.face(&layout, &values),
                "tristrips" => {
                    let strips: Vec<u32> = layout.indices(&values).collect();
                    strips.split(|&i| i == u32::MAX).for_each(|strip| reader.polygons.strip(strip));
                }
                _ => {}
            }
        }
    }
    let Reader { mut polygons, counts, .. } = reader;
    polygons.count(counts.longer, "rows hold more numbers than the header lists; the last ones are ignored");
    polygons.count(counts.short, "faces of fewer than three corners are ignored");
    polygons.count(counts.uv_lists, "lists of texture coordinates that do not fit their face are ignored");
    polygons.count(counts.not_finite, "normals and texture coordinates that are not finite are ignored");
    Ok(polygons)
}

/// The polygons of a file that is being read.
#[derive(Default)]
struct Reader {
    polygons: Polygons,
    counts: Counts,
    /// Vertices with a texture coordinate that a face gives them.
    with_uv: HashMap<(u32, [u32; 2]), u32>,
}

impl Reader {
    fn vertex(&mut self, layout: &Layout, values: &[Vec<f64>]) {
        let of = |place: usize| values[place].first().copied().unwrap_or(0.0);
        let position = layout.position.map(|place| place.map_or(0.0, of));
        let normal = layout.normal.map(|places| Vec3::from(places.map(|k| of(k) as f32)));
        let uv = layout.uv.map(|places| Vec2::from(places.map(|k| of(k) as f32)));
        self.counts.not_finite += usize::from(normal.is_some_and(|n| !n.is_finite()));
        self.counts.not_finite += usize::from(uv.is_some_and(|uv| !uv.is_finite()));
        self.polygons.vertex(DVec3::from(position), normal.filter(|n| n.is_finite()), uv);
    }

    fn face(&mut self, layout: &Layout, values: &[Vec<f64>]) {
        let corners: Vec<u32> = layout.indices(values).collect();
        let uvs = layout.corner_uvs.map_or(&[][..], |k| values[k].as_slice());
        let polygons = &mut self.polygons;
        if corners.len() < 3 {
            self.counts.short += 1;
        } else if uvs.len() == 2 * corners.len() {
            let uvs = uvs.chunks_exact(2).map(|uv| Vec2::new(uv[0] as f32, uv[1] as f32));
            for (corner, uv) in corners.into_iter().zip(uvs) {
                let vertex = *self.with_uv.entry((corner, uv.to_array().map(f32::to_bits))).or_insert_with(|| {
                    let Some(&position) = polygons.positions.get(corner as usize) else { return corner };
                    polygons.vertex(position, Some(polygons.normals[corner as usize]), Some(uv))
                });
                polygons.corners.push(vertex);
            }
            polygons.ends.push(polygons.corners.len());
        } else {
            self.counts.uv_lists += usize::from(!uvs.is_empty());
            polygons.polygon(corners);
        }
    }
}

/// Rows that were not read as they stand.
#[derive(Default)]
struct Counts {
    longer: usize,
    short: usize,
    uv_lists: usize,
    not_finite: usize,
}

/// A negative index becomes one that does not exist; in strips it separates.
fn index(value: f64) -> u32 {
    if value < 0.0 { u32::MAX } else { value as u32 }
}

/// The places of the properties that are read.
struct Layout {
    position: [Option<usize>; 3],
    normal: Option<[usize; 3]>,
    uv: Option<[usize; 2]>,
    indices: Option<usize>,
    corner_uvs: Option<usize>,
}

impl Layout {
    fn new(element: &Element) -> Parsed<Self> {
        let place = |what: &str| element.properties.iter().position(|p| p.name == what && p.count.is_none());
        let list = |is: fn(&str) -> bool| element.properties.iter().position(|p| p.count.is_some() && is(&p.name));
        let pair = |&[u, v]: &[&str; 2]| Some([place(u)?, place(v)?]);
        let normal = || Some([place("nx")?, place("ny")?, place("nz")?]);
        let layout = Self {
            position: ["x", "y", "z"].map(place),
            normal: normal(),
            uv: [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"], ["tx", "ty"]]
                .iter()
                .find_map(pair),
            indices: list(|name| name.starts_with("vertex_ind")),
            corner_uvs: list(|name| name == "texcoord" || name == "texcoords"),
        };
        if element.name == "vertex" && layout.position.contains(&None) {
            return bad("vertex", "the properties x, y and z are required");
        }
        if ["face", "tristrips"].contains(&element.name.as_str()) && element.count > 0 && layout.indices.is_none() {
            return bad(&element.name, "the list vertex_indices is required");
        }
        Ok(layout)
    }

    /// The vertices of a face or strip.
    fn indices(&self, values: &[Vec<f64>]) -> impl Iterator<Item = u32> {
        self.indices.map_or(&[][..], |k| values[k].as_slice()).iter().copied().map(index)
    }
}

/// Parses the header; lines that are none of a header are ignored with a warning.
fn header<'a>(bytes: &'a [u8], warnings: &mut Vec<String>) -> Parsed<(Form, Vec<Element>, &'a [u8])> {
    let mut form = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut at = 0;
    // files of old Macintosh programs
    let line_end = if bytes.iter().take(MAX_HEADER).any(|&b| b == b'\n') { b'\n' } else { b'\r' };
    for line in 1.. {
        let end = bytes[at..].iter().take(MAX_HEADER).position(|&b| b == line_end);
        let Some(end) = end.filter(|_| at < MAX_HEADER) else { return bad("header", "end_header is missing") };
        let text = String::from_utf8_lossy(&bytes[at..at + end]);
        at += end + 1;
        let words: Vec<&str> = text.split_whitespace().collect();
        let field = format!("line {line}");
        let number = |word: &str| {
            word.parse::<Number>().map_err(|()| (field.clone(), format!("found the unknown type {word:?}")))
        };
        match words[..] {
            ["ply"] if line == 1 => {}
            _ if line == 1 => return bad("line 1", "expected \"ply\""),
            ["format", "ascii", _] => form = Some(Form::Text),
            ["format", "binary_little_endian", _] => form = Some(Form::Little),
            ["format", "binary_big_endian", _] => form = Some(Form::Big),
            ["comment" | "obj_info", ..] | [] => {}
            ["element", name, count] => match count.parse() {
                Ok(count) => elements.push(Element { name: name.into(), count, properties: Vec::new() }),
                Err(_) => return bad(&field, format!("found the element count {count:?}, expected a number")),
            },
            ["property", ref rest @ ..] => {
                let property = match *rest {
                    ["list", count, kind, name] => {
                        Property { name: name.into(), number: number(kind)?, count: Some(number(count)?) }
                    }
                    [kind, name] => Property { name: name.into(), number: number(kind)?, count: None },
                    _ => return bad(&field, format!("found {text:?}, expected \"property TYPE NAME\"")),
                };
                let Some(element) = elements.last_mut() else { return bad(&field, "a property precedes all elements") };
                element.properties.push(property);
            }
            ["end_header"] => {
                let Some(form) = form else { return bad("header", "the format line is missing") };
                return match elements.iter().find(|e| e.properties.is_empty()) {
                    Some(element) => bad("header", format!("element {} has no properties", element.name)),
                    None => Ok((form, elements, &bytes[at..])),
                };
            }
            _ => warnings.push(format!("{field} is no line of a header and is ignored: {:?}", excerpt(&text))),
        }
    }
    bad("header", "end_header is missing")
}

/// The beginning of a line.
fn excerpt(text: &str) -> String {
    text.trim().chars().take(40).collect()
}

struct Body<'a> {
    form: Form,
    rest: &'a [u8],
    /// Whether each row of a text is a line by itself: numbers behind the last one of a row are ignored.
    by_line: bool,
}

impl<'a> Body<'a> {
    fn new(form: Form, rest: &'a [u8], rows: usize) -> Self {
        let lines = || rest.split(|b| matches!(b, b'\n' | b'\r')).filter(|line| !line.trim_ascii().is_empty());
        Self { form, rest, by_line: form == Form::Text && lines().take(rows).count() == rows }
    }

    /// Skips empty lines before a row.
    fn begin_row(&mut self) {
        if self.by_line {
            self.rest = self.rest.trim_ascii_start();
        }
    }

    /// Skips to the next line; whether anything else was skipped.
    fn end_row(&mut self) -> bool {
        if !self.by_line {
            return false;
        }
        let end = self.rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        !line.trim_ascii().is_empty()
    }

    /// Reads the value of a property, or the values of a list.
    fn property(&mut self, property: &Property, values: &mut Vec<f64>) -> std::result::Result<(), String> {
        values.clear();
        let count = match property.count {
            Some(count) => self.number(count)?,
            None => 1.0,
        };
        if !(0.0..=1e9).contains(&count) {
            return Err(format!("found the list length {count}"));
        }
        for _ in 0..count as usize {
            values.push(self.number(property.number)?);
        }
        Ok(())
    }

    fn number(&mut self, number: Number) -> std::result::Result<f64, String> {
        if self.form == Form::Text {
            let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(self.rest.len());
            let word = &self.rest[start..];
            let end = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
            self.rest = &word[end..];
            let word = String::from_utf8_lossy(&word[..end]);
            return word
                .parse()
                .map_err(|_| if word.is_empty() { ENDS.into() } else { format!("found {word:?}, expected a number") });
        }
        Ok(match number {
            Number::I8 => f64::from(i8::from_le_bytes(self.bytes()?)),
            Number::U8 => f64::from(u8::from_le_bytes(self.bytes()?)),
            Number::I16 => f64::from(i16::from_le_bytes(self.bytes()?)),
            Number::U16 => f64::from(u16::from_le_bytes(self.bytes()?)),
            Number::I32 => f64::from(i32::from_le_bytes(self.bytes()?)),
            Number::U32 => f64::from(u32::from_le_bytes(self.bytes()?)),
            Number::F32 => f64::from(f32::from_le_bytes(self.bytes()?)),
            Number::F64 => f64::from_le_bytes(self.bytes()?),
        })
    }

    /// The next `N` bytes in little-endian order.
    fn bytes<const N: usize>(&mut self) -> std::result::Result<[u8; N], String> {
        let (own, rest) = self.rest.split_first_chunk::<N>().ok_or(ENDS)?;
        self.rest = rest;
        let mut own = *own;
        if self.form == Form::Big {
            own.reverse();
        }
        Ok(own)
    }
}

const ENDS: &str = "the file ends too early";

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "element vertex 4\ncomment a square\nproperty float x\nproperty double y\nproperty float z\n\
        property uchar red\nproperty float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\n\
        end_header\n";

    fn square(form: &str) -> Vec<u8> {
        let mut bytes = format!("ply\nformat {form} 1.0\n{HEADER}").into_bytes();
        if form == "ascii" {
            bytes.extend(b"0 0 0 7 0 0\n2 0 0 7 1 0\n2 2 0 7 1 1\n0 2 0 7 0 1\n4 0 1 2 3\n");
            return bytes;
        }
        let order = |mut b: Vec<u8>| {
            if form.contains("big") {
                b.reverse();
            }
            b
        };
        for (x, y) in [(0.0f32, 0.0f64), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)] {
            bytes.extend(order(x.to_le_bytes().to_vec()));
            bytes.extend(order(y.to_le_bytes().to_vec()));
            bytes.extend(order(0f32.to_le_bytes().to_vec()));
            bytes.push(7);
            bytes.extend(order((x / 2.0).to_le_bytes().to_vec()));
            bytes.extend(order((y as f32 / 2.0).to_le_bytes().to_vec()));
        }
        bytes.push(4);
        (0..4i32).for_each(|i| bytes.extend(order(i.to_le_bytes().to_vec())));
        bytes
    }

    #[test]
    fn all_encodings_give_the_same_mesh() {
        let mesh = |form: &str| parse(&square(form)).unwrap().finish(Path::new("a.ply")).unwrap();
        let text = mesh("ascii").data;
        assert_eq!(text.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!((text.positions[2], text.uvs[2]), (Vec3::new(2.0, 2.0, 0.0), Vec2::ONE));
        for form in ["binary_little_endian", "binary_big_endian"] {
            assert_eq!(mesh(form).data, text);
        }
        let one_line = String::from_utf8(square("ascii")).unwrap();
        let (head, body) = one_line.split_once("end_header\n").unwrap();
        let one_line = format!("{head}end_header\n{}", body.replace('\n', " "));
        assert_eq!(parse(one_line.as_bytes()).unwrap().finish(Path::new("a.ply")).unwrap().data, text);
    }

    #[test]
    fn damaged_files_are_errors() {
        for form in ["ascii", "binary_little_endian"] {
            let bytes = square(form);
            for end in 0..bytes.len() - 2 {
                let cut = parse(&bytes[..end]);
                assert!(cut.is_err() || form == "ascii" && end > bytes.len() - 4, "{form} {end}");
            }
        }
        let fault = |from: &str, to: &str| {
            let text = String::from_utf8(square("ascii")).unwrap().replace(from, to);
            let error = parse(text.as_bytes()).map_err(|(field, problem)| Error::invalid("a.ply", field, problem));
            error.and_then(|polygons| polygons.finish(Path::new("a.ply"))).unwrap_err().to_string()
        };
        assert!(fault("ply\n", "plx\n").contains("line 1"));
        assert!(fault("4 0 1 2 3", "4 0 1 2 9").contains("vertex index 9"));
        assert!(fault("4 0 1 2 3", "-4 0 1 2 3").contains("face 0: found the list length -4"));
        assert!(fault("float x", "float a").contains("the properties x, y and z are required"));
        assert!(fault("2 2 0 7", "2 two 0 7").contains("vertex 2: found \"two\""));
        assert!(fault("property double", "property real").contains("line 6: found the unknown type"));
        assert!(fault("format ascii 1.0\n", "").contains("the format line is missing"));
    }
    const CORNERS: &str =
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
    const POINTS: &str = "end_header\n0 0 0\n2 0 0\n2 2 0\n0 2 0\n";

    #[test]
    fn strips_are_cut_and_their_windings_agree() {
        for (strip, count) in [("4 0 1 3 2", 2), ("7 0 1 3 -1 1 2 3", 2), ("6 0 1 3 3 3 2", 1)] {
            let strips = "element tristrips 1\nproperty list int int vertex_indices\n";
            let mesh = parse(format!("{CORNERS}{strips}{POINTS}{strip}\n").as_bytes()).unwrap();
            let data = mesh.finish(Path::new("a.ply")).unwrap().data;
            let area = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| data.positions[i as usize]);
                0.5 * (b - a).cross(c - a).z
            };
            assert_eq!((data.triangles.len(), data.triangles.iter().map(area).sum()), (count, 2.0 * count as f32));
        }
    }

    #[test]
    fn rows_may_be_longer_than_the_header_says() {
        let faces = "element face 2\nproperty list uchar int vertex_indices\nproperty uchar red\n";
        let text = format!("{CORNERS}{faces}{POINTS}3 0 1 2 9 1 1 1\n3 0 2 3 9 1 1 1\n");
        let polygons = parse(text.as_bytes()).unwrap();
        assert_eq!(polygons.corners, [0, 1, 2, 0, 2, 3]);
        assert!(polygons.warnings[0].contains("more numbers than the header lists"), "{:?}", polygons.warnings);
    }

    #[test]
    fn faces_have_texture_coordinates_of_their_own() {
        let faces = "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n";
        let text = format!("{CORNERS}{faces}{POINTS}3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0 0 1 1 0 0.5\n");
        let data = parse(text.as_bytes()).unwrap().finish(Path::new("a.ply")).unwrap().data;
        let uvs: Vec<Vec2> = data.triangles.as_flattened().iter().map(|&i| data.uvs[i as usize]).collect();
        let expected = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0], [0.0, 0.5]];
        assert_eq!(uvs, expected.map(Vec2::from));
        // the first and third vertex are shared
        assert_eq!(data.positions.len(), 4);
    }

    #[test]
    fn lines_that_are_no_header_are_named() {
        let faces = "Created by a program\nelement face 1\nproperty list uchar int vertex_index\n";
        let polygons = parse(format!("{CORNERS}{faces}{POINTS}4 0 1 2 3\n").as_bytes()).unwrap();
        assert!(polygons.warnings[0].contains("Created by a program"), "{:?}", polygons.warnings);
    }
}
