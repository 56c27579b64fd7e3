//! A library of materials: a plain folder with a subfolder per material.
//!
//! # Format
//! ```text
//! library/wool/material.toml         description, and the checksums of all other files
//! library/wool/original/wool.zip     the original measurement, unless it is linked
//! library/wool/compressed/pvmf.loden
//! library/wool/thumbnail.png
//! ```
//! The name of a material is the name of its subfolder: renaming the subfolder renames it. Users may edit
//! `notes` in `material.toml`; a checksum, the seal, reveals changes of the other fields. Paths of files are relative to the
//! subfolder, or absolute for a linked original.
//!
//! Materials are added and removed by renaming a folder. An interruption leaves only a hidden folder, which
//! [`Library::verify`] reports.

mod form;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use form::Wanted;
use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

pub use form::Form;

use crate::btf::Cosine;
use crate::direction::from_angles;
use crate::import::raw::read_toml;
use crate::import::{self, Measured};
use crate::input::{self, hexadecimal};
use crate::output::{self, OutputDir};
use crate::params::Given;
use crate::picture::Picture;
use crate::progress::{Progress, Silent, Task};
use crate::{Error, Result, plot};

/// The description's name in a material's folder.
const DESCRIPTION: &str = "material.toml";
/// Maximum number of pixels per side of a thumbnail.
const THUMBNAIL: usize = 128;

/// A folder of materials.
#[derive(Debug, Clone)]
pub struct Library {
    folder: PathBuf,
}

/// Content of `material.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The version of the format, 1.
    pub loden_material: u32,
    /// The user's notes.
    #[serde(default)]
    pub notes: String,
    /// The importer that reads the original.
    pub kind: String,
    /// The original, relative to the material's folder, or absolute if it is linked.
    pub original: PathBuf,
    /// What the original holds: (name, value), for people to read.
    pub facts: BTreeMap<String, String>,
    /// Compressed forms.
    #[serde(default)]
    pub compressed: Vec<Form>,
    /// All files but this one, by path.
    pub files: BTreeMap<String, Checksum>,
    /// SHA-256 of all fields except `notes`, as this program writes them.
    pub seal: String,
}

/// Length and checksum of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Checksum {
    /// Length in bytes.
    pub bytes: u64,
    /// SHA-256, hexadecimal, as `sha256sum` prints it.
    pub sha256: String,
}

/// How a material is added.
#[derive(Debug, Clone, Default)]
pub struct AddOptions {
    /// Link to the original instead of copying it.
    pub link: bool,
    /// Codecs of the compressed forms; ignored for BRDFs.
    pub methods: Vec<String>,
    /// Parameters of the codecs; each takes those it has.
    pub params: Given,
    /// Options of the importer.
    pub import: Given,
}

/// Something that [`Library::verify`] found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The material, or the hidden folder.
    pub material: String,
    /// The file concerned, as in [`Record::files`].
    pub file: String,
    /// Description of the problem.
    pub problem: String,
    /// Whether data is lost or changed; `false` for files that are merely superfluous.
    pub damage: bool,
}

impl Library {
    /// The library in `folder`, which is created by the first [`Library::add`].
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// The sorted names of all materials: subfolders with a description.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be read; [`Error::Unsupported`] if it has content, but no material.
    pub fn names(&self) -> Result<Vec<String>> {
        let (mut names, hidden) = self.entries()?;
        names.retain(|name| self.folder.join(name).join(DESCRIPTION).is_file());
        if names.is_empty() && hidden.is_empty() {
            self.check_empty()?;
        }
        Ok(names)
    }

    /// A folder without materials is a library only if it is empty.
    fn check_empty(&self) -> Result<()> {
        match fs::read_dir(&self.folder).map_err(Error::io(&self.folder))?.next() {
            Some(_) => Err(Error::unsupported(&self.folder, "is not a library: no folder in it has a material.toml")),
            None => Ok(()),
        }
    }

    /// Subfolders, and hidden subfolders left by an interruption; both sorted.
    fn entries(&self) -> Result<(Vec<String>, Vec<String>)> {
        let mut all = Vec::new();
        for entry in fs::read_dir(&self.folder).map_err(Error::io(&self.folder))? {
            let entry = entry.map_err(Error::io(&self.folder))?;
            if entry.path().is_dir() {
                all.push(entry.file_name().to_string_lossy().into_owned());
            }
        }
        all.sort();
        let (hidden, shown) = all.into_iter().partition::<Vec<_>, _>(|name| name.starts_with('.'));
        Ok((shown, hidden.into_iter().filter(|n| n.ends_with(".partial") || n.ends_with(".removed")).collect()))
    }

    /// The description of a material.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such material, [`Error::Invalid`] naming the line of a damaged description.
    pub fn record(&self, name: &str) -> Result<Record> {
        let path = self.place(name)?.join(DESCRIPTION);
        if !path.is_file() {
            let problem = format!("no material {name:?} in {}", self.folder.display());
            return Err(Error::parameter("NAME", problem));
        }
        let record: Record = read_toml(&path)?;
        match record.loden_material {
            1 => Ok(record),
            other => Err(Error::invalid(&path, "loden_material", format!("found version {other}, expected 1"))),
        }
    }

    /// The folder of a material; refuses names that lead out of the library.
    fn place(&self, name: &str) -> Result<PathBuf> {
        let mut parts = Path::new(name).components();
        let plain = matches!((parts.next(), parts.next()), (Some(std::path::Component::Normal(_)), None));
        if !plain || name.starts_with('.') || name.contains(['/', '\\']) {
            return Err(Error::parameter("NAME", format!("found {name:?}, expected the name of a folder")));
        }
        Ok(self.folder.join(name))
    }

    /// Adds the measurement `source` as `name`: copies or links it, compresses it, and writes the description.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the name is taken, or a method or a parameter unknown; errors of reading, compressing and
    /// writing. Nothing is added then.
    pub fn add(&self, name: &str, source: &Path, options: &AddOptions, progress: &dyn Progress) -> Result<Record> {
        let place = self.place(name)?;
        let wanted = Wanted::all(&options.methods, &options.params)?;
        if place.exists() {
            return Err(Error::parameter(
                "NAME",
                format!("found {} already there, expected a new name", place.display()),
            ));
        }
        // Store the original
        let source = &*import::locate(source)?;
        let (importer, measured) = import::open_named(source, &options.import)?;
        output::create_folder(&self.folder)?;
        let output = OutputDir::create(&place)?;
        let folder = output.folder();
        let mut files = BTreeMap::new();
        let original = store(source, &importer.files(source)?, options.link, folder, &mut files, progress)?;
        // Compress it and draw a thumbnail
        let mut compressed = Vec::new();
        if let Ok(btf) = measured.clone().images() {
            for form in &wanted {
                compressed.push(form.compress(btf.as_ref(), folder, progress)?);
            }
        }
        thumbnail(&measured)?.write_png(folder.join("thumbnail.png"))?;
        for file in compressed.iter().map(|form| form.file.as_path()).chain([Path::new("thumbnail.png")]) {
            files.insert(text(file), checksum(&folder.join(file))?);
        }
        // Write the description
        let kind = importer.name().to_owned();
        let mut record = Record {
            loden_material: 1,
            notes: String::new(),
            kind,
            original,
            facts: facts(&measured),
            compressed,
            files,
            seal: String::new(),
        };
        record.write(folder)?;
        output.commit()?;
        Ok(record)
    }

    /// Adds further compressed forms to the BTF `name`. `options` are those of [`Library::add`], except for the link.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such material, it is a BRDF, it already has such a form, or a method or a
    /// parameter is unknown; errors of reading, compressing and writing. Forms that were finished stay.
    pub fn compress(&self, name: &str, options: &AddOptions, progress: &dyn Progress) -> Result<Record> {
        let (place, mut record) = (self.place(name)?, self.record(name)?);
        let wanted = Wanted::all(&options.methods, &options.params)?;
        if let Some(form) = wanted.iter().find(|form| record.files.contains_key(&text(&form.file()))) {
            let problem = format!("{name} already has {}", form.file().display());
            return Err(Error::parameter("methods", problem));
        }
        let (_, measured) = import::open_named(place.join(&record.original), &options.import)?;
        let brdf = |_| Error::parameter("NAME", format!("{name} is a BRDF, which has no compressed forms"));
        let source = measured.images().map_err(brdf)?;
        for form in &wanted {
            let form = form.compress(source.as_ref(), &place, progress)?;
            record.files.insert(text(&form.file), checksum(&place.join(&form.file))?);
            record.compressed.push(form);
            record.write(&place)?;
        }
        Ok(record)
    }

    /// Removes a material and its files; a linked original stays.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such material, [`Error::Io`].
    pub fn remove(&self, name: &str) -> Result<()> {
        let place = self.place(name)?;
        if !place.join(DESCRIPTION).is_file() {
            return Err(Error::parameter("NAME", format!("no material {name:?} in {}", self.folder.display())));
        }
        // rename first: the material disappears at once, even if deleting is interrupted
        let hidden = self.folder.join(format!(".{name}.{}.removed", std::process::id()));
        fs::rename(&place, &hidden).map_err(Error::io(&place))?;
        fs::remove_dir_all(&hidden).map_err(Error::io(&hidden))
    }

    /// Reads every file of the materials `names`, or of all, and reports damaged, missing and superfluous files.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a name that is not there, [`Error::Io`] if a folder cannot be read, [`Error::Cancelled`].
    pub fn verify(&self, names: &[String], progress: &dyn Progress) -> Result<Vec<Finding>> {
        let (shown, leftovers) = self.entries()?;
        if shown.is_empty() && leftovers.is_empty() {
            self.check_empty()?;
        }
        let mut findings = Vec::new();
        if names.is_empty() {
            findings.extend(leftovers.iter().map(|name| Finding {
                material: name.clone(),
                file: String::new(),
                problem: "left by an interruption; it can be deleted".into(),
                damage: false,
            }));
        }
        if let Some(missing) = names.iter().find(|name| !shown.contains(name)) {
            return Err(Error::parameter("NAME", format!("no material {missing:?} in {}", self.folder.display())));
        }
        let chosen = if names.is_empty() { &shown } else { names };
        let task = Task::new(progress, "verify", chosen.len() as u64);
        for name in chosen {
            findings.extend(self.verify_one(name)?);
            task.advance(1)?;
        }
        Ok(findings)
    }

    fn verify_one(&self, name: &str) -> Result<Vec<Finding>> {
        let finding =
            |file: &str, problem: String, damage| Finding { material: name.into(), file: file.into(), problem, damage };
        let place = self.place(name)?;
        let record = match self.record(name) {
            Ok(record) => record,
            Err(error @ (Error::Invalid { .. } | Error::Parameter { .. })) => {
                return Ok(vec![finding(DESCRIPTION, error.to_string(), true)]);
            }
            Err(other) => return Err(other),
        };
        let mut findings = Vec::new();
        if record.seal != record.sealed(&place)? {
            let problem = "a field other than `notes` was changed: the seal does not match";
            findings.push(finding(DESCRIPTION, problem.into(), true));
        }
        let check = |(file, expected): (&String, &Checksum)| match checksum(&place.join(file)) {
            Ok(found) if found == *expected => None,
            Ok(found) if found.bytes != expected.bytes => {
                Some(finding(file, format!("found {} bytes, expected {}", found.bytes, expected.bytes), true))
            }
            Ok(_) => Some(finding(file, "is damaged: the checksum does not match".into(), true)),
            Err(error) => Some(finding(file, format!("cannot be read: {error}"), true)),
        };
        findings.par_extend(record.files.par_iter().filter_map(check));
        for path in input::files_of(&place)? {
            let file = text(path.strip_prefix(&place).unwrap_or(&path));
            if file != DESCRIPTION && !record.files.contains_key(&file) {
                findings.push(finding(&file, "is not listed in the description".into(), false));
            }
        }
        Ok(findings)
    }
}

impl Record {
    /// Seals the description and writes it into the folder of its material.
    fn write(&mut self, folder: &Path) -> Result<()> {
        self.seal = self.sealed(folder)?;
        let content = toml::to_string(self).map_err(|e| Error::invalid(folder, DESCRIPTION, e.to_string()))?;
        output::write_file(folder.join(DESCRIPTION), |file| file.write_all(content.as_bytes()))
    }

    fn sealed(&self, path: &Path) -> Result<String> {
        let bare = Self { notes: String::new(), seal: String::new(), ..self.clone() };
        let content = toml::to_string(&bare).map_err(|e| Error::invalid(path, DESCRIPTION, e.to_string()))?;
        Ok(hexadecimal(&Sha256::digest(content)))
    }
}

/// A path with slashes, as in the description.
fn text(path: &Path) -> String {
    path.to_string_lossy().replace('\\', "/")
}

fn checksum(path: &Path) -> Result<Checksum> {
    copy(path, None)
}

/// The checksum of a file, which is copied to `to`.
fn copy(path: &Path, mut to: Option<(&Path, &mut File)>) -> Result<Checksum> {
    let mut file = File::open(path).map_err(Error::io(path))?;
    let (mut hash, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; 1 << 20]);
    loop {
        let count = file.read(&mut buffer).map_err(Error::io(path))?;
        if count == 0 {
            return Ok(Checksum { bytes, sha256: hexadecimal(&hash.finalize()) });
        }
        hash.update(&buffer[..count]);
        if let Some((name, file)) = &mut to {
            file.write_all(&buffer[..count]).map_err(output::failed(name))?;
        }
        bytes += count as u64;
    }
}

/// Copies or links the files of an original; returns its path for the description.
fn store(
    source: &Path,
    all: &[PathBuf],
    link: bool,
    folder: &Path,
    sums: &mut BTreeMap<String, Checksum>,
    progress: &dyn Progress,
) -> Result<PathBuf> {
    // a source given as `.` needs a name
    let source = fs::canonicalize(source).map_err(Error::io(source))?;
    let root = source.parent().unwrap_or(&source);
    let task = Task::new(progress, if link { "read" } else { "copy" }, all.len() as u64);
    for file in all {
        let file = fs::canonicalize(file).map_err(Error::io(file))?;
        if link {
            sums.insert(text(&file), checksum(&file)?);
        } else {
            let outside =
                |_| Error::unsupported(&file, "lies outside the folder of its measurement, so it can only be linked");
            let inside = Path::new("original").join(file.strip_prefix(root).map_err(outside)?);
            let to = folder.join(&inside);
            let parent = to.parent().unwrap_or(folder);
            output::create_folder(parent)?;
            let mut copied = File::create_new(&to).map_err(output::failed(&to))?;
            sums.insert(text(&inside), copy(&file, Some((&to, &mut copied)))?);
            copied.sync_all().map_err(output::failed(&to))?;
        }
        task.advance(1)?;
    }
    let name = source.file_name().unwrap_or_default();
    Ok(if link { source.clone() } else { Path::new("original").join(name) })
}

/// A BTF seen from above with the light at 30 degrees, or a BRDF on a sphere.
fn thumbnail(measured: &Measured) -> Result<Picture> {
    let source = match measured.clone().images() {
        Err(brdf) => return plot::spheres(&[brdf.as_ref()], THUMBNAIL, 1, &Silent),
        Ok(source) => source,
    };
    let meta = source.meta();
    let (view, light) = meta.nearest_pair(from_angles(0.52, 1.05), Vec3::Z);
    let texels = source.image(view, light)?;
    let values = texels.to_f32();
    let (width, height) = (meta.width.min(THUMBNAIL), meta.height.min(THUMBNAIL));
    let pixel = |i: usize| {
        let at = 3 * (i / width * meta.width + i % width);
        Vec3::from([0, 1, 2].map(|c| meta.encoding.decode(values[at + c])))
    };
    Ok(Picture { width, height, rgb: (0..width * height).map(pixel).collect() })
}

fn facts(measured: &Measured) -> BTreeMap<String, String> {
    let facts = match measured.clone().images() {
        Err(brdf) => {
            let facts = brdf.notes().facts.iter().map(|(name, value)| (*name, value.clone()));
            facts.chain([("holds", "brdf".to_owned())]).collect::<Vec<_>>()
        }
        Ok(source) => {
            let meta = source.meta();
            let set = |set: &crate::direction::DirectionSet| match set.name() {
                Some(name) => name.to_owned(),
                None if meta.is_listed() => format!("of {} pairs", set.len()),
                None => format!("{} directions", set.len()),
            };
            let cosine = if meta.cosine == Cosine::Included { "included" } else { "excluded" };
            vec![
                ("holds", "btf".to_owned()),
                ("size", format!("{} x {}", meta.width, meta.height)),
                ("views", set(meta.lights.seen_from().unwrap_or(&meta.views))),
                ("lights", set(&meta.lights)),
                ("encoding", meta.encoding.to_string()),
                ("cosine", cosine.to_owned()),
                ("missing", source.missing().len().to_string()),
            ]
        }
    };
    facts.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}
