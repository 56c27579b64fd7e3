//! Reader of Stanford PLY files, ASCII or binary.

use std::path::Path;
use std::str::FromStr;

use glam::{Vec2, Vec3};

use crate::render::MeshData;
use crate::render::geometry::polygons;
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

/// Reads vertices (x, y, z; nx, ny, nz; u, v or s, t) and faces, which are triangulated. Other elements and properties
/// are skipped.
pub(super) fn read(path: &Path) -> Result<(MeshData, Vec<String>)> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    parse(&bytes).map(|data| (data, Vec::new())).map_err(|(field, problem)| Error::invalid(path, field, problem))
}

type Parsed<T> = std::result::Result<T, (String, String)>;

fn bad<T>(field: &str, problem: impl Into<String>) -> Parsed<T> {
    Err((field.into(), problem.into()))
}

fn parse(bytes: &[u8]) -> Parsed<MeshData> {
    let (form, elements, body) = header(bytes)?;
    let mut body = Body { form, rest: body };
    let mut data = MeshData::default();
    let mut faces: Vec<Vec<Vec<u32>>> = Vec::new();
    for element in &elements {
        let place = |what: &str| element.properties.iter().position(|p| p.name == what && p.count.is_none());
        let either = |a: &str, b: &str| place(a).or_else(|| place(b));
        let position = [place("x"), place("y"), place("z")];
        let normal = [place("nx"), place("ny"), place("nz")];
        let uv = [either("u", "s"), either("v", "t")];
        let list = element.properties.iter().position(|p| p.count.is_some() && p.name.starts_with("vertex_ind"));
        if element.name == "vertex" && position.contains(&None) {
            return bad("vertex", "the properties x, y and z are required");
        }
        let mut values = vec![Vec::new(); element.properties.len()];
        for row in 0..element.count {
            let field = format!("{} {row}", element.name);
            for (property, values) in element.properties.iter().zip(&mut values) {
                body.property(property, values).map_err(|problem| (field.clone(), problem))?;
            }
            let of = |place: Option<usize>| place.and_then(|k| values[k].first()).copied().unwrap_or(0.0) as f32;
            if element.name == "vertex" {
                data.positions.push(Vec3::from(position.map(of)));
                if !normal.contains(&None) {
                    data.normals.push(Vec3::from(normal.map(of)));
                }
                if !uv.contains(&None) {
                    data.uvs.push(Vec2::from(uv.map(of)));
                }
            } else if let Some(list) = list.filter(|_| element.name == "face") {
                // Map a negative index to one that does not exist.
                faces.push(vec![values[list].iter().map(|&v| if v < 0.0 { u32::MAX } else { v as u32 }).collect()]);
            }
        }
    }
    let corners: Vec<u32> = faces.iter().flatten().flatten().copied().collect();
    let triangles = polygons(&data.positions, &faces).map_err(|e| ("face".to_owned(), e.to_string()))?;
    data.triangles = triangles.iter().map(|t| t.map(|place| corners[place as usize])).collect();
    Ok(data)
}

fn header(bytes: &[u8]) -> Parsed<(Form, Vec<Element>, &[u8])> {
    let mut form = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut at = 0;
    for line in 1.. {
        let end = bytes[at..].iter().take(MAX_HEADER).position(|&b| b == b'\n');
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
            _ => return bad(&field, format!("found {text:?}, expected a PLY header line")),
        }
    }
    bad("header", "end_header is missing")
}

struct Body<'a> {
    form: Form,
    rest: &'a [u8],
}

impl Body<'_> {
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
        let text = parse(&square("ascii")).unwrap();
        assert_eq!(text.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!((text.positions[2], text.uvs[2]), (Vec3::new(2.0, 2.0, 0.0), Vec2::ONE));
        for form in ["binary_little_endian", "binary_big_endian"] {
            assert_eq!(parse(&square(form)).unwrap(), text);
        }
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
            let (field, problem) = parse(text.as_bytes()).unwrap_err();
            format!("{field}: {problem}")
        };
        assert!(fault("ply\n", "plx\n").contains("line 1"));
        assert!(fault("4 0 1 2 3", "4 0 1 2 9").contains("vertex index 9"));
        assert!(fault("4 0 1 2 3", "-4 0 1 2 3").contains("face 0: found the list length -4"));
        assert!(fault("float x", "float a").contains("the properties x, y and z are required"));
        assert!(fault("2 2 0 7", "2 two 0 7").contains("vertex 2: found \"two\""));
        assert!(fault("property double", "property real").contains("line 6: found the unknown type"));
        assert!(fault("format ascii 1.0\n", "").contains("the format line is missing"));
    }
}
