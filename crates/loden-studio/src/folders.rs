//! The files that the page may see: those below the given folders.

use std::path::{Component, Path, PathBuf};

use loden::output::Rule;
use loden::{Error, Result};

use crate::failure::{Answer, Failure};

/// The given files and folders. The page names a file by the number of its place and its path within, as `0/cloth/twill.zip`.
pub(crate) struct Folders {
    places: Vec<Place>,
    output: usize,
}

/// A file or folder as given, and where it really is.
pub(crate) struct Place {
    pub path: PathBuf,
    real: PathBuf,
    /// Whether nobody named it: it is the current folder, for what is made.
    pub is_implicit: bool,
}

impl Place {
    fn new(path: &Path) -> Result<Self> {
        let real = std::fs::canonicalize(path).map_err(Error::io(path))?;
        Ok(Self { path: path.into(), real, is_implicit: false })
    }

    /// The name of the file or folder.
    pub fn name(&self) -> String {
        self.real.file_name().unwrap_or(self.real.as_os_str()).to_string_lossy().into_owned()
    }
}

impl Folders {
    /// Given files and folders, and the folder for what is made.
    pub fn new(materials: &[PathBuf], output: Option<&Path>) -> Result<Self> {
        let mut places = materials.iter().map(|path| Place::new(path)).collect::<Result<Vec<_>>>()?;
        let output = match output {
            Some(folder) => {
                loden::output::create_folder(folder)?;
                places.push(Place::new(folder)?);
                places.len() - 1
            }
            None => match places.iter().position(|place| place.real.is_dir()) {
                Some(first) => first,
                None => {
                    places.push(Place { is_implicit: true, ..Place::new(Path::new("."))? });
                    places.len() - 1
                }
            },
        };
        Ok(Self { places, output })
    }

    /// All places with their numbers.
    pub fn places(&self) -> impl Iterator<Item = (usize, &Place)> {
        self.places.iter().enumerate()
    }

    /// The folder for what is made.
    pub fn output(&self) -> &Path {
        &self.places[self.output].path
    }

    /// The number of that folder.
    pub fn output_number(&self) -> usize {
        self.output
    }

    /// The file or folder with this name, if it really is below its place.
    pub fn find(&self, id: &str) -> Answer<PathBuf> {
        let missing = || Failure::missing(&format!("material {id:?}"));
        let (number, inside) = id.split_once('/').unwrap_or((id, ""));
        let place = number.parse::<usize>().ok().and_then(|number| self.places.get(number)).ok_or_else(missing)?;
        let inside = Path::new(inside);
        if !inside.components().all(|part| matches!(part, Component::Normal(_))) {
            return Err(missing());
        }
        let path = if inside.as_os_str().is_empty() { place.path.clone() } else { place.path.join(inside) };
        let real = std::fs::canonicalize(&path).map_err(|_| missing())?;
        if real.starts_with(&place.real) { Ok(path) } else { Err(missing()) }
    }

    /// Checks that a file that another one refers to is below one of the places.
    pub fn check(&self, path: &Path) -> Answer<()> {
        let inside =
            std::fs::canonicalize(path).is_ok_and(|real| self.places.iter().any(|p| real.starts_with(&p.real)));
        let outside = || Failure::refused(&format!("{} is not in the folders of the studio", path.display()));
        if inside { Ok(()) } else { Err(outside()) }
    }

    /// The name by which [`Folders::find`] finds a file below the place with this number.
    pub fn id(&self, number: usize, path: &Path) -> Option<String> {
        let inside = path.strip_prefix(&self.places[number].path).ok()?;
        let parts = inside.components().map(|part| part.as_os_str().to_str()).collect::<Option<Vec<_>>>()?;
        Some([vec![number.to_string().as_str()], parts].concat().join("/"))
    }

    /// A new file or folder in the folder for what is made. Names are those of files there, without folders.
    pub fn new_output(&self, name: &str, endings: &[&str]) -> Answer<PathBuf> {
        let wrong = |problem: &str| Failure::from(Error::parameter("name", format!("found {name:?}, {problem}")));
        let plain = !name.is_empty() && !name.starts_with('.') && name.len() <= 200;
        if !plain || name.contains(['/', '\\', '\0']) || name.chars().any(char::is_control) {
            return Err(wrong("expected the name of a file, without folders"));
        }
        let path = self.output().join(name);
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase();
        if !endings.is_empty() && !endings.contains(&ending.as_str()) {
            let expected = endings.iter().map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(" or ");
            return Err(wrong(&format!("expected the ending {expected}")));
        }
        Rule::default().file(&path)?;
        if path.exists() { Err(Error::Exists { path }.into()) } else { Ok(path) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn nothing_outside_of_the_folders_is_found() {
        let all = tempfile::tempdir().unwrap();
        let (inside, outside) = (all.path().join("inside"), all.path().join("inside-not"));
        for folder in [&inside, &outside] {
            fs::create_dir(folder).unwrap();
            fs::write(folder.join("a.zip"), "x").unwrap();
        }
        #[cfg(unix)]
        for (to, link) in [(&outside, "out"), (&inside, "in")] {
            std::os::unix::fs::symlink(to, inside.join(link)).unwrap();
        }
        let folders = Folders::new(std::slice::from_ref(&inside), None).unwrap();
        assert_eq!(folders.find("0/a.zip").unwrap(), inside.join("a.zip"));
        assert_eq!(folders.id(0, &inside.join("a.zip")).unwrap(), "0/a.zip");
        #[cfg(unix)]
        assert!(folders.find("0/in/a.zip").is_ok());
        let absolute = format!("0/{}", outside.join("a.zip").display());
        for id in [
            "",
            "1/a.zip",
            "0/../inside-not/a.zip",
            "0/..",
            "0/./../inside-not/a.zip",
            "0/out/a.zip",
            &absolute,
            "0//etc/passwd",
            "-1/a.zip",
            "0/a.zip\0",
        ] {
            assert!(folders.find(id).is_err(), "{id}");
        }
    }

    #[test]
    fn outputs_are_new_files_of_one_folder() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("old.loden"), "x").unwrap();
        let folders = Folders::new(&[folder.path().to_path_buf()], None).unwrap();
        assert!(folders.new_output("new.loden", &["loden"]).is_ok());
        for name in ["old.loden", "../new.loden", "a/b.loden", ".hidden.loden", "", "new.zip", "new", "a\nb.loden"] {
            assert!(folders.new_output(name, &["loden"]).is_err(), "{name}");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
