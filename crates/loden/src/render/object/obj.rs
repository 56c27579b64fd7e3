//! Reader of Wavefront OBJ files.
//!
//! Read are vertices, texture coordinates, normals and faces of any number of corners, and the materials of `mtl` files
//! where they are asked for. Groups, colours of vertices and smoothing groups are ignored; points, lines and free-form surfaces are ignored with a warning. A line may continue
//! after a backslash, comments may follow numbers, and text need not be UTF-8.

mod paint;

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

pub(super) use paint::paints;

use super::polygons::Polygons;
use crate::render::geometry::ControlMesh;
use crate::{Error, Result};

/// Reads all groups of an OBJ file as one mesh.
pub(super) fn read(path: &Path) -> Result<Polygons> {
    let Obj { positions, uvs, normals, corners, ends, painted, warnings } = Obj::read(path)?;
    let mut polygons = Polygons { painted, warnings, ..Polygons::default() };
    let mut known: HashMap<[Option<u32>; 3], u32> = HashMap::new();
    for corner in corners {
        let vertex = *known.entry(corner).or_insert_with(|| {
            let [position, uv, normal] = corner;
            let position = position.map_or(DVec3::ZERO, |i| positions[i as usize]);
            polygons.vertex(position, normal.map(|i| normals[i as usize]), uv.map(|i| uvs[i as usize]))
        });
        polygons.corners.push(vertex);
    }
    polygons.ends = ends;
    Ok(polygons)
}

/// Reads the polygons of all groups as a control mesh for subdivision, with warnings without the name of the file.
pub(super) fn control_mesh(path: &Path) -> Result<(ControlMesh, Vec<String>)> {
    let mut obj = Obj::read(path)?;
    if obj.ends.is_empty() {
        let reasons = obj.warnings.iter().map(|warning| format!("; {warning}")).collect::<String>();
        return Err(Error::invalid(path, "faces", format!("found no faces{reasons}")));
    }
    let starts = [0].into_iter().chain(obj.ends.iter().copied());
    let vertices = |corners: &[Corner]| corners.iter().filter_map(|corner| corner[0]).collect();
    let faces = starts.zip(&obj.ends).map(|(start, &end)| vertices(&obj.corners[start..end])).collect();
    let mut uvs: Vec<Vec2> = obj.corners.iter().filter_map(|corner| corner[1]).map(|i| obj.uvs[i as usize]).collect();
    if uvs.len() != obj.corners.len() || uvs.iter().any(|uv| !uv.is_finite()) {
        if !uvs.is_empty() {
            obj.warnings.push("texture coordinates are ignored, as some corners have none".into());
        }
        uvs.clear();
    }
    let positions = obj.positions.iter().map(|p| p.as_vec3()).collect();
    Ok((ControlMesh { positions, faces, uvs, ..ControlMesh::default() }, obj.warnings))
}

/// Indices of the position, texture coordinate and normal of a corner of a face.
type Corner = [Option<u32>; 3];

/// The content of a file.
#[derive(Default)]
struct Obj {
    positions: Vec<DVec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    corners: Vec<Corner>,
    ends: Vec<usize>,
    /// The material of each face, as [`paint::Names`] numbers it.
    painted: Vec<u16>,
    warnings: Vec<String>,
}

/// What was ignored.
#[derive(Default)]
struct Ignored {
    lines: usize,
    points: usize,
    surfaces: usize,
    short_faces: usize,
    bad_numbers: usize,
    unknown: usize,
    first_unknown: String,
}

impl Obj {
    fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        Self::parse(&bytes).map_err(|(line, problem)| Error::invalid(path, format!("line {line}"), problem))
    }

    /// Parses a file; an error has the number of its line.
    fn parse(bytes: &[u8]) -> std::result::Result<Self, (usize, String)> {
        let mut parser = Parser::default();
        for (line, text) in lines(bytes) {
            parser.line(line, &text).map_err(|problem| (line, problem))?;
        }
        let mut obj = parser.obj;
        let lists =
            [("vertex", obj.positions.len()), ("texture coordinate", obj.uvs.len()), ("normal", obj.normals.len())];
        for ((what, count), (index, line)) in lists.into_iter().zip(parser.largest) {
            if index as usize > count {
                let problem = format!("a face refers to {what} {index}, which does not exist: the file has {count}");
                return Err((line, problem));
            }
        }
        obj.warnings = parser.ignored.warnings();
        Ok(obj)
    }
}

/// A file that is being read.
#[derive(Default)]
struct Parser {
    obj: Obj,
    ignored: Ignored,
    /// The largest index into each list, counted from 1, with its line.
    largest: [(u32, usize); 3],
    materials: paint::Names,
    /// The material of the next face.
    paint: u16,
}

impl Parser {
    fn line(&mut self, line: usize, text: &str) -> std::result::Result<(), String> {
        let Self { obj, ignored, .. } = self;
        let mut words = text.split_whitespace();
        match words.next().unwrap_or_default() {
            "v" => {
                let position = DVec3::from(numbers(words, 3, "v does not have three numbers")?);
                if !position.is_finite() {
                    return Err(format!("vertex {} is not finite", obj.positions.len() + 1));
                }
                obj.positions.push(position);
            }
            "vt" => {
                let [u, v, _] = numbers(words, 1, "vt does not have a number")?;
                ignored.bad_numbers += usize::from(!(u.is_finite() && v.is_finite()));
                obj.uvs.push(Vec2::new(u as f32, v as f32));
            }
            "vn" => {
                let normal = DVec3::from(numbers(words, 3, "vn does not have three numbers")?).as_vec3();
                ignored.bad_numbers += usize::from(!normal.is_finite());
                obj.normals.push(if normal.is_finite() { normal } else { Vec3::ZERO });
            }
            "f" | "fo" => return self.face(line, words),
            "usemtl" => self.paint = self.materials.number(text),
            "l" => ignored.lines += 1,
            "p" => ignored.points += 1,
            "surf" | "curv" | "curv2" => ignored.surfaces += 1,
            known if known.is_empty() || IGNORED.contains(&known) => {}
            other => {
                if ignored.unknown == 0 {
                    ignored.first_unknown = other.chars().take(20).collect();
                }
                ignored.unknown += 1;
            }
        }
        Ok(())
    }

    fn face<'a>(&mut self, line: usize, words: impl Iterator<Item = &'a str>) -> std::result::Result<(), String> {
        let obj = &mut self.obj;
        let counts = [obj.positions.len(), obj.uvs.len(), obj.normals.len()];
        let start = obj.corners.len();
        for word in words {
            obj.corners.push(corner(word, counts)?);
        }
        if obj.corners.len() < start + 3 {
            obj.corners.truncate(start);
            self.ignored.short_faces += 1;
            return Ok(());
        }
        for corner in &obj.corners[start..] {
            for (index, largest) in corner.iter().zip(&mut self.largest) {
                let count = index.map_or(0, |index| index + 1);
                *largest = (*largest).max((count, line));
            }
        }
        obj.ends.push(obj.corners.len());
        obj.painted.push(self.paint);
        Ok(())
    }
}

/// Keywords of groups, materials, and details of curves and surfaces.
const IGNORED: [&str; 29] = [
    "bevel",
    "bmat",
    "c_interp",
    "con",
    "cstype",
    "ctech",
    "d_interp",
    "deg",
    "end",
    "g",
    "hole",
    "lod",
    "maplib",
    "mg",
    "mtllib",
    "o",
    "parm",
    "s",
    "scrv",
    "shadow_obj",
    "sp",
    "stech",
    "step",
    "trace_obj",
    "trim",
    "usemap",
    "vp",
    "res",
    "cdc",
];

impl Ignored {
    fn warnings(&self) -> Vec<String> {
        let unknown = format!("lines of an unknown kind are ignored, such as {:?}", self.first_unknown);
        [
            (self.lines, "lines are ignored"),
            (self.points, "points are ignored"),
            (self.surfaces, "free-form curves and surfaces are ignored"),
            (self.short_faces, "faces of fewer than three corners are ignored"),
            (self.bad_numbers, "normals and texture coordinates that are not finite are ignored"),
            (self.unknown, &unknown),
        ]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{what} ({count})"))
        .collect()
    }
}

/// The lines of a file with their numbers, without comments; a line that ends with a backslash is joined with the next.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // files of old Macintosh programs
    let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    let mut raw = (1..).zip(bytes.split(move |&b| b == end).map(without_comment));
    std::iter::from_fn(move || {
        let (line, first) = raw.next()?;
        let Some(first) = first.strip_suffix(b"\\") else { return Some((line, String::from_utf8_lossy(first))) };
        let mut joined = String::from_utf8_lossy(first).into_owned();
        for (_, next) in raw.by_ref() {
            let more = next.strip_suffix(b"\\");
            joined.push(' ');
            joined.push_str(&String::from_utf8_lossy(more.unwrap_or(next)));
            if more.is_none() {
                break;
            }
        }
        Some((line, Cow::Owned(joined)))
    })
}

/// A `#` inside a word is no comment: `1.#QNAN` is a number that is not finite.
fn without_comment(line: &[u8]) -> &[u8] {
    let starts = |&i: &usize| line[i] == b'#' && (i == 0 || line[i - 1].is_ascii_whitespace());
    let end = (0..line.len()).find(starts).unwrap_or(line.len());
    line[..end].trim_ascii_end()
}

/// The first three numbers, at least `least`; missing ones are zero.
fn numbers<'a>(
    words: impl Iterator<Item = &'a str>,
    least: usize,
    problem: &str,
) -> std::result::Result<[f64; 3], String> {
    let mut found = [0.0; 3];
    let mut count = 0;
    for (number, word) in found.iter_mut().zip(words) {
        match word.parse() {
            Ok(value) => *number = value,
            // as written by the runtime of one compiler, `1.#QNAN` and `-nan(ind)`
            Err(_) if word.contains('#') || word.contains("nan") => *number = f64::NAN,
            // text may follow the numbers that are needed
            Err(_) if count >= least => break,
            Err(_) => return Err(format!("{problem}: found {word:?}")),
        }
        count += 1;
    }
    if count >= least { Ok(found) } else { Err(problem.into()) }
}

/// Parses `v`, `v/vt`, `v//vn` or `v/vt/vn`. Indices count from 1, or backwards from -1.
fn corner(word: &str, counts: [usize; 3]) -> std::result::Result<Corner, String> {
    let wrong = || format!("a face is not a list of indices: found {word:?}");
    let mut corner = [None; 3];
    let mut parts = word.split('/');
    for (place, count) in corner.iter_mut().zip(counts) {
        let Some(part) = parts.next() else { break };
        if part.is_empty() {
            continue;
        }
        let index: i64 = part.parse().map_err(|_| wrong())?;
        let from_zero = if index < 0 { count as i64 + index } else { index - 1 };
        // the largest index is reserved
        let index = u32::try_from(from_zero).ok().filter(|&index| index < u32::MAX);
        *place = Some(index.ok_or_else(|| format!("a face has the index {part}, which is no index here"))?);
    }
    if corner[0].is_none() || parts.next().is_some() {
        return Err(wrong());
    }
    Ok(corner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn obj(text: impl AsRef<[u8]>) -> Obj {
        Obj::parse(text.as_ref()).unwrap_or_else(|(line, problem)| panic!("line {line}: {problem}"))
    }

    #[test]
    fn dialects_of_other_programs_are_read() {
        let points = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\n";
        let plain = obj(format!("{points}f 1 2 3 4\n"));
        assert_eq!((plain.positions.len(), plain.ends.as_slice()), (4, &[4][..]));
        for text in [
            format!("\u{feff}{points}f 1 2 3 4"),
            format!("{points}f 1 2 \\\n3 4"),
            format!("{points}f 1 2 \\\r\n3 \\\r\n4\r\n"),
            format!("{points}f 1 2 3 4 # the face"),
            format!("# C:\\models\\\n{points}usemtl\ng\nf -4 -3 -2 -1"),
            "v 0 0 0 1 0 0\nv 2 0 0\nv 2 2 0 # 2\nv 0 2 0 1.0\nfo 1 2 3 4\n".into(),
            format!("f 1 2 3 4\n{points}"),
            format!("{points}f 1 2 3 4\n").replace('\n', "\r"),
        ] {
            let found = obj(&text);
            assert_eq!(
                (&found.positions, &found.corners, &found.ends),
                (&plain.positions, &plain.corners, &plain.ends)
            );
            assert!(found.warnings.is_empty(), "{:?}", found.warnings);
        }
        let latin1 = [b"# M\xfcnchen\n".as_slice(), format!("{points}f 1 2 3 4 # \u{e9}").as_bytes()].concat();
        assert_eq!(obj(latin1).corners, plain.corners);
    }

    #[test]
    fn corners_may_lack_texture_coordinates_and_normals() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1 2/1 3//1\n";
        let corners = obj(text).corners;
        assert_eq!(corners[1], [Some(1), Some(0), Some(0)]);
        assert_eq!(corners[3..], [[Some(0), None, None], [Some(1), Some(0), None], [Some(2), None, Some(0)]]);
    }

    #[test]
    fn what_is_ignored_is_counted() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 1.#QNAN 0 0\nl 1 2 3\np 1\nl 1 2\nf 1 2\nhello world\nf 1 2 3\n";
        let warnings = obj(text).warnings.join("; ");
        for what in ["lines are ignored (2)", "points are ignored (1)", "fewer than three", "not finite", "\"hello\""] {
            assert!(warnings.contains(what), "{warnings}");
        }
    }

    #[test]
    fn errors_name_the_line() {
        for (text, line, fault) in [
            ("v 0 0 0\nf 1 2 3\n", 2, "vertex 3, which does not exist"),
            ("v 0 0 0\nv 0 0 0\nf 0 1 2\n", 3, "the index 0"),
            ("v 0 0 0\nf -2 1 1\n", 2, "the index -2"),
            ("v 0 0\n", 1, "three numbers"),
            ("v 0 0 0\nvt x\n", 2, "does not have a number"),
            ("v 0 0 0\nf 1/1/1/1 1 1\n", 2, "list of indices"),
        ] {
            let Err((found, problem)) = Obj::parse(text.as_bytes()) else { panic!("{text} was read") };
            assert!(found == line && problem.contains(fault), "{found}: {problem}");
        }
    }
}
