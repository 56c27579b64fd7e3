//! `rti`: photographs from one view with a list of lights, as in reflectance transformation imaging.
//!
//! # Format
//! `.lp` text: the number of images (omitted by some writers), then one line per image: its path, relative to the list and
//! possibly with spaces, and a vector towards the light (x right, y up, z towards the camera).
//!
//! # Limits
//! The view is along the normal. Lights at or below the horizon are skipped. Vectors of any length are taken as
//! directions. A path that does not exist, as of the machine where the list was written, stands for the file of the same
//! name beside the list. The format states neither encoding nor cosine: plain sRGB photographs are assumed.
//!
//! # References
//! malzbender2001

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;

use super::image_set::{Files, ImageSet, Plan};
use super::rows::{MAX_TEXT, number};
use super::{Conventions, Importer, Measured, head, located};
use crate::btf::Cosine;
use crate::direction::{DirectionSet, phi, theta};
use crate::input::{text, without_bom};
use crate::params::{Param, Params, Values};
use crate::{Error, Result};

pub(super) struct Rti;

impl Importer for Rti {
    fn name(&self) -> &'static str {
        "rti"
    }

    fn doc(&self) -> &'static str {
        "Light-position files (`.lp`) of RTI and PTM sets: one view, many lights."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 1 << 14)?;
        if bytes.contains(&0) {
            return Ok(false);
        }
        let text = String::from_utf8_lossy(without_bom(&bytes));
        let mut lines = text.lines().filter(|line| !line.trim().is_empty());
        let counted = |line: &str| line.trim().parse::<u32>().is_ok();
        let first = lines.next().and_then(|line| if counted(line) { lines.next() } else { Some(line) });
        // rows of a plain table of numbers may end in a unit vector by chance
        let named = |name: &str| name.contains(char::is_alphabetic);
        let light = |(name, words): (&str, _)| {
            vector(words).is_some_and(|vector| is_picture(name) || named(name) && is_unit(vector))
        };
        Ok(first.and_then(split).is_some_and(light))
    }

    fn params(&self) -> &'static [Param] {
        Conventions::TABLE
    }

    fn open(&self, path: &Path, options: &Values) -> Result<Measured> {
        let options = Conventions::from_values(options)?;
        let text = text(path, MAX_TEXT)?;
        let (mut names, mut degrees, mut left_out, mut other_lengths) = (Vec::new(), Vec::new(), 0, 0);
        let mut stated = None;
        for (line, content) in (1..).zip(text.lines()).filter(|(_, content)| !content.trim().is_empty()) {
            if names.is_empty() && stated.is_none() && content.trim().parse::<usize>().is_ok() {
                stated = content.trim().parse().ok();
                continue;
            }
            let missing = || {
                Error::invalid(path, format!("line {line}"), "found too few words, expected a path and three numbers")
            };
            let (name, words) = split(content).ok_or_else(missing)?;
            let mut components = [0.0; 3];
            for (component, word) in components.iter_mut().zip(words) {
                *component = number(path, line, word)?;
            }
            let short = || {
                Error::invalid(path, format!("line {line}"), format!("found {words:?}, expected a vector to the light"))
            };
            other_lengths += usize::from(!is_unit(Vec3::from(components)));
            let light = Vec3::from(components).try_normalize().ok_or_else(short)?;
            if light.z > 1e-3 {
                names.push(name.trim().to_owned());
                degrees.push([theta(light), phi(light)].map(|angle| f64::from(angle).to_degrees()));
            } else {
                left_out += 1;
            }
        }
        if stated.is_some_and(|stated: usize| stated != names.len() + left_out) {
            let problem = format!("{} images, the first line says {}", names.len() + left_out, stated.unwrap_or(0));
            return Err(Error::invalid(path, "number of images", problem));
        }
        if names.is_empty() {
            let problem = if left_out > 0 { "all lights are at or below the horizon" } else { "the list is empty" };
            return Err(Error::invalid(path, "lights", problem));
        }
        let mut warnings = Vec::new();
        if left_out > 0 {
            warnings.push(format!("{left_out} lights are at or below the horizon and left out"));
        }
        if other_lengths > 0 {
            warnings.push(format!("{other_lengths} vectors to lights are not of length 1; their directions are taken"));
        }
        let here: Vec<String> = names.iter().map(|name| beside(path, name)).collect();
        let moved = here.iter().zip(&names).filter(|(here, name)| here != name).count();
        if moved > 0 {
            warnings.push(format!("{moved} paths do not exist; files of the same name beside the list are taken"));
        }
        let names = here;
        let stated = "not stated by the files; photographs have it";
        let plan = Plan {
            views: DirectionSet::from_degrees(vec![[0.0, 0.0]])?,
            lights: DirectionSet::from_degrees(degrees).map_err(located(path))?,
            image: (0..names.len()).map(Some).collect(),
            exposure: Vec::new(),
            turns: Vec::new(),
            cosine: Cosine::Included,
            warnings,
            facts: options.reasons("not stated by the files; 8-bit pictures usually are sRGB", stated),
        };
        let files = Listed::new(path, names)?;
        Ok(Measured::Btf(Arc::new(ImageSet::new(files, plan, &options)?)))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>> {
        let text = text(path, MAX_TEXT)?;
        let names = text.lines().filter_map(split).map(|(name, _)| path.with_file_name(beside(path, name.trim())));
        Ok([path.into()].into_iter().chain(names).collect())
    }
}

/// The path and the last three words of a line.
fn split(line: &str) -> Option<(&str, [&str; 3])> {
    let (rest, z) = line.trim().rsplit_once(char::is_whitespace)?;
    let (rest, y) = rest.trim_end().rsplit_once(char::is_whitespace)?;
    let (name, x) = rest.trim_end().rsplit_once(char::is_whitespace)?;
    Some((name, [x, y, z]))
}

fn vector(words: [&str; 3]) -> Option<Vec3> {
    let [x, y, z] = words.map(|word| word.parse::<f32>().ok());
    Some(Vec3::new(x?, y?, z?)).filter(|vector| vector.is_finite())
}

/// Whether a vector has length 1, up to rounding.
fn is_unit(vector: Vec3) -> bool {
    (vector.length() - 1.0).abs() < 0.05
}

/// Whether a path ends like that of a picture.
fn is_picture(name: &str) -> bool {
    let endings = ["bmp", "exr", "hdr", "jpeg", "jpg", "png", "tif", "tiff"];
    name.rsplit_once('.').is_some_and(|(_, ending)| endings.iter().any(|e| ending.eq_ignore_ascii_case(e)))
}

/// A path of the list as it is valid here: unchanged if it exists, else with slashes for backslashes, else the file of
/// that name beside the list; unchanged if none of them exists.
fn beside(list: &Path, name: &str) -> String {
    let slashes = name.replace('\\', "/");
    let base = slashes.rsplit('/').next().unwrap_or(&slashes).to_owned();
    let exists = |name: &&str| list.with_file_name("").join(name).is_file();
    [name, &slashes, &base].into_iter().find(exists).unwrap_or(name).to_owned()
}

/// Picture files named in a list, relative to it.
pub(super) struct Listed {
    list: PathBuf,
    names: Vec<String>,
    bytes: u64,
}

impl Listed {
    /// Checks that all files exist.
    pub(super) fn new(list: &Path, names: Vec<String>) -> Result<Self> {
        let mut files = Self { list: list.into(), names, bytes: 0 };
        for index in 0..files.names.len() {
            let file = files.file(index);
            files.bytes += fs::metadata(&file).map_err(Error::io(&file))?.len();
        }
        Ok(files)
    }

    fn file(&self, index: usize) -> PathBuf {
        self.list.parent().unwrap_or(Path::new("")).join(&self.names[index])
    }
}

impl Files for Listed {
    fn path(&self) -> &Path {
        &self.list
    }

    fn name(&self, index: usize) -> &str {
        &self.names[index]
    }

    fn read(&self, index: usize) -> Result<Vec<u8>> {
        let file = self.file(index);
        fs::read(&file).map_err(Error::io(&file))
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }
}
