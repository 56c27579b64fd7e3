//! Materials of OBJ files: the diffuse colour of `mtl` files and its texture.

use std::path::Path;

use crate::render::object::MeshPaint;
use crate::{Error, Result};

/// The names of materials in the order in which faces use them.
#[derive(Default)]
pub(super) struct Names(Vec<String>);

impl Names {
    /// The number of the material that a `usemtl` line names, counted from 1.
    pub(super) fn number(&mut self, line: &str) -> u16 {
        let name = after_word(line);
        let known = self.0.iter().position(|known| known == name);
        let index = known.unwrap_or_else(|| {
            self.0.push(name.into());
            self.0.len() - 1
        });
        u16::try_from(index + 1).unwrap_or(0)
    }
}

/// What follows the first word of a line.
fn after_word(line: &str) -> &str {
    line.trim().split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim())
}

/// Reads the materials of an OBJ file, numbered as its faces use them; the first is that of faces without one.
pub(in crate::render::object) fn paints(path: &Path) -> Result<(Vec<MeshPaint>, Vec<String>)> {
    let (mut names, mut libraries, mut warnings) = (Names::default(), Vec::new(), Vec::new());
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    for (_, line) in super::lines(&bytes) {
        match line.split_whitespace().next().unwrap_or_default() {
            "usemtl" => drop(names.number(&line)),
            "mtllib" => libraries.push(after_word(&line).to_owned()),
            _ => {}
        }
    }
    let mut found = vec![None; names.0.len()];
    for library in libraries {
        read_library(&path.with_file_name(library), &names.0, &mut found)?;
    }
    for (name, paint) in names.0.iter().zip(&found) {
        if paint.is_none() {
            warnings.push(format!("{}: the material {name} is not defined; it is grey", path.display()));
        }
    }
    let all = [MeshPaint::default()].into_iter().chain(found.into_iter().map(Option::unwrap_or_default));
    Ok((all.collect(), warnings))
}

/// Reads those materials of an `mtl` file that are named.
fn read_library(path: &Path, names: &[String], found: &mut [Option<MeshPaint>]) -> Result<()> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let mut current = None;
    for (number, line) in super::lines(&bytes) {
        let wrong = |problem: &str| Error::invalid(path, format!("line {number}"), problem);
        let mut words = line.split_whitespace();
        match (words.next().unwrap_or_default(), current.and_then(|k: usize| found.get_mut(k)?.as_mut())) {
            ("newmtl", _) => {
                current = names.iter().position(|name| name == after_word(&line));
                if let Some(paint) = current.and_then(|k| found.get_mut(k)) {
                    // a texture alone shows its own colours
                    *paint = Some(MeshPaint { albedo: [1.0; 3], texture: None });
                }
            }
            ("Kd", Some(paint)) => {
                let numbers: Vec<f32> = words.map_while(|word| word.parse().ok()).collect();
                paint.albedo = match numbers[..] {
                    [grey] => [grey; 3],
                    [r, g, b, ..] => [r, g, b],
                    _ => return Err(wrong("Kd does not have three numbers")),
                };
                if !paint.albedo.iter().all(|v| v.is_finite()) {
                    return Err(wrong("Kd has numbers that are not finite"));
                }
            }
            ("map_Kd", Some(paint)) => {
                // the name may contain spaces, or follow options
                let whole = path.with_file_name(after_word(&line));
                let last = path.with_file_name(line.split_whitespace().next_back().unwrap_or_default());
                let file = if whole.is_file() { whole } else { last };
                let content = std::fs::read(&file).map_err(Error::io(&file))?;
                paint.texture = Some((file, content));
            }
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::object;

    #[test]
    fn faces_get_the_materials_of_their_library() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.obj");
        let faces =
            "f 1 2 3\nusemtl red paint\nf 1 2 4\nusemtl cloth\nf 1 2 3 4\nusemtl red paint\nf 2 3 4\nusemtl lost\n";
        let text = format!("mtllib x.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n{faces}");
        std::fs::write(&path, text).unwrap();
        let library =
            "newmtl cloth\nmap_Kd -s 1 1 1 a.png\nnewmtl other\nKd 1 1 1\nnewmtl red paint\nNs 10\nKd .5 .25 0\n";
        std::fs::write(folder.path().join("x.mtl"), library).unwrap();
        std::fs::write(folder.path().join("a.png"), "picture").unwrap();
        let file = object::read(&path).unwrap();
        assert_eq!(file.painted, [0, 1, 2, 2, 1]);
        let (paints, warnings) = object::paints(&path).unwrap();
        assert_eq!(paints[0], MeshPaint::default());
        assert_eq!(paints[1], MeshPaint { albedo: [0.5, 0.25, 0.0], texture: None });
        assert_eq!((paints[2].albedo, paints[2].texture.as_ref().unwrap().1.as_slice()), ([1.0; 3], &b"picture"[..]));
        assert!(warnings.len() == 1 && warnings[0].contains("the material lost"), "{warnings:?}");
        std::fs::remove_file(folder.path().join("a.png")).unwrap();
        assert!(object::paints(&path).unwrap_err().to_string().contains("a.png"));
    }
}
