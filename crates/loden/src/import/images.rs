//! `images`: any set of pictures, described by a small TOML file beside it.
//!
//! # Format
//! ```toml
//! loden_images = 1
//! files = "shots/v{view}/l{light}.jpg"   # below this file; {name} stands for a number
//! views = "bonn81"                       # or "ubo2014", or a list of [polar angle, azimuth] in degrees
//! lights = [[0, 0], [30, 0], [30, 90]]
//! count_from = 1                         # the number of the first view and light; 0 if left out
//! encoding = "srgb"                      # srgb, linear or gammaN; else by the kind of picture
//! cosine = "included"                    # or excluded; whether the light's cosine is in the values
//! exposure = [1, 1, 0.5]                 # one number per light, or one for all: linear light is divided by it
//! ```
//! The names in `files` are `view` and `light` (places in the lists), or `theta_v`, `phi_v`, `theta_l`, `phi_l` (degrees, with
//! or without decimals; then the lists are left out), and `any` for numbers without meaning. What a name leaves out must have
//! one direction only: without `{view}` there is one view. So the sets of OUTex, PhoTex and one's own need no code.
//!
//! # Limits
//! Pictures must be rectified and of one size. Missing pairs are reported and repeat the nearest light of their view.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use super::image_set::{ImageSet, Plan};
use super::raw::read_toml;
use super::rti::Listed;
use super::{Importer, Measured, Options, head, located, unstated};
use crate::btf::Cosine;
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::{Error, Result};

/// Folders deeper than this are not looked into: a link to a parent would never end.
const MAX_DEPTH: usize = 16;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    loden_images: u32,
    files: String,
    views: Option<DirectionSet>,
    lights: Option<DirectionSet>,
    #[serde(default)]
    count_from: usize,
    encoding: Option<Encoding>,
    cosine: Option<Cosine>,
    exposure: Option<Exposure>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Exposure {
    All(f32),
    PerLight(Vec<f32>),
}

pub(super) struct Images;

impl Importer for Images {
    fn name(&self) -> &'static str {
        "images"
    }

    fn doc(&self) -> &'static str {
        "Any set of pictures described by a TOML file: path pattern, directions, encoding, cosine, exposure."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 4096)?;
        Ok(String::from_utf8_lossy(&bytes).lines().any(|line| line.trim_start().starts_with("loden_images")))
    }

    fn open(&self, path: &Path, options: &Options) -> Result<Measured> {
        let manifest: Manifest = read_toml(path)?;
        if manifest.loden_images != 1 {
            let problem = format!("version {} is not known, only 1 is", manifest.loden_images);
            return Err(Error::invalid(path, "loden_images", problem));
        }
        let pattern = Pattern::parse(&manifest.files).map_err(|problem| Error::invalid(path, "files", problem))?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut found = Vec::new();
        list(folder, &mut PathBuf::new(), 0, &pattern, &mut found)?;
        found.sort_by(|a, b| a.0.cmp(&b.0));
        if found.is_empty() {
            return Err(Error::invalid(path, "files", format!("no file below is named like {:?}", manifest.files)));
        }
        let views =
            Side::new(path, "views", manifest.views, &found, ["view", "theta_v", "phi_v"], manifest.count_from)?;
        let lights =
            Side::new(path, "lights", manifest.lights, &found, ["light", "theta_l", "phi_l"], manifest.count_from)?;
        let mut image = vec![None; views.set.len() * lights.set.len()];
        let mut exposure = Vec::new();
        for (index, (name, _)) in found.iter().enumerate() {
            let (view, light) = (views.of_file[index], lights.of_file[index]);
            if let Some(other) = image[view * lights.set.len() + light].replace(index) {
                return Err(Error::invalid(path, name, format!("the same directions as {}", found[other].0)));
            }
            match &manifest.exposure {
                Some(Exposure::PerLight(list)) if list.len() == lights.set.len() => exposure.push(list[light]),
                Some(Exposure::PerLight(list)) => {
                    let problem = format!("{} numbers for {} lights", list.len(), lights.set.len());
                    return Err(Error::invalid(path, "exposure", problem));
                }
                Some(Exposure::All(one)) => exposure.push(*one),
                None => {}
            }
        }
        if let Some(bad) = exposure.iter().find(|e| !(e.is_finite() && **e > 0.0)) {
            return Err(Error::invalid(path, "exposure", format!("{bad}, a positive number is expected")));
        }
        let facts = unstated(
            options,
            if manifest.encoding.is_some() { "stated by the manifest" } else { "by the kind of picture" },
            if manifest.cosine.is_some() { "stated by the manifest" } else { "not stated; photographs have it" },
        );
        let cosine = manifest.cosine.unwrap_or(Cosine::Included);
        let options = Options { encoding: options.encoding.or(manifest.encoding), ..*options };
        let plan = Plan { views: views.set, lights: lights.set, image, exposure, cosine, warnings: Vec::new(), facts };
        let files = Listed::new(path, found.into_iter().map(|(name, _)| name).collect())?;
        Ok(Measured::Btf(Arc::new(ImageSet::new(files, plan, &options)?)))
    }
}

/// The numbers in a file's name.
type Numbers = BTreeMap<String, f64>;

/// The directions of one side, and which of them each file has.
struct Side {
    set: DirectionSet,
    of_file: Vec<usize>,
}

impl Side {
    fn new(
        path: &Path,
        field: &str,
        given: Option<DirectionSet>,
        files: &[(String, Numbers)],
        [index, theta, phi]: [&str; 3],
        count_from: usize,
    ) -> Result<Self> {
        let wrong = |problem: String| Error::invalid(path, field, problem);
        let named = &files[0].1;
        if named.contains_key(theta) && named.contains_key(phi) {
            let degrees = |n: &Numbers| [n[theta], n[phi].rem_euclid(360.0)];
            let mut all: Vec<[f64; 2]> = files.iter().map(|(_, n)| degrees(n)).collect();
            all.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
            all.dedup();
            let place = |n: &Numbers| all.iter().position(|d| *d == degrees(n)).unwrap_or(0);
            let of_file = files.iter().map(|(_, n)| place(n)).collect();
            return Ok(Self { set: DirectionSet::from_degrees(all).map_err(located(path))?, of_file });
        }
        let set = match given {
            Some(set) => set,
            None => DirectionSet::from_degrees(vec![[0.0, 0.0]])?,
        };
        if !named.contains_key(index) {
            let problem = format!("{} directions, but `files` has no {{{index}}} to tell them apart", set.len());
            return if set.len() == 1 { Ok(Self { set, of_file: vec![0; files.len()] }) } else { Err(wrong(problem)) };
        }
        let place = |(name, n): &(String, Numbers)| {
            let place = n[index] - count_from as f64;
            let inside = place >= 0.0 && place.fract() == 0.0 && place < set.len() as f64;
            let problem = format!("{name} has the number {}, but there are {} directions", n[index], set.len());
            if inside { Ok(place as usize) } else { Err(wrong(problem)) }
        };
        let of_file = files.iter().map(place).collect::<Result<_>>()?;
        Ok(Self { set, of_file })
    }
}

/// Text and named numbers in turn.
struct Pattern(Vec<Piece>);

enum Piece {
    Text(String),
    Number(String),
}

impl Pattern {
    fn parse(text: &str) -> std::result::Result<Self, String> {
        let mut pieces = Vec::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('{') {
            let (name, behind) = after.split_once('}').ok_or("a { without its }")?;
            let known = ["view", "light", "theta_v", "phi_v", "theta_l", "phi_l", "any"];
            if !known.contains(&name) {
                return Err(format!("{{{name}}} is not one of {}", known.join(", ")));
            }
            if !before.is_empty() {
                pieces.push(Piece::Text(before.to_owned()));
            } else if matches!(pieces.last(), Some(Piece::Number(_))) {
                return Err(format!("nothing separates {{{name}}} from the number before it"));
            }
            pieces.push(Piece::Number(name.to_owned()));
            rest = behind;
        }
        pieces.push(Piece::Text(rest.to_owned()));
        Ok(Self(pieces))
    }

    /// The numbers, if the name is of this pattern.
    fn matches(&self, name: &str) -> Option<Numbers> {
        let mut numbers = Numbers::new();
        let mut rest = name;
        for (i, piece) in self.0.iter().enumerate() {
            match piece {
                Piece::Text(text) => rest = rest.strip_prefix(text.as_str())?,
                Piece::Number(name) => {
                    let sign = usize::from(rest.starts_with('-'));
                    let digits = |c: char| !c.is_ascii_digit() && c != '.';
                    let mut end = sign + rest[sign..].find(digits).unwrap_or(rest.len() - sign);
                    // a dot may begin what follows, as that of the ending
                    if let Some(Piece::Text(next)) = self.0.get(i + 1) {
                        while end > sign && !rest[end..].starts_with(next.as_str()) {
                            end -= 1;
                        }
                    }
                    let value: f64 = rest[..end].parse().ok()?;
                    if name != "any" && numbers.insert(name.clone(), value).is_some_and(|other| other != value) {
                        return None;
                    }
                    rest = &rest[end..];
                }
            }
        }
        rest.is_empty().then_some(numbers)
    }
}

/// All files below `root` whose slash-separated relative paths are of the pattern.
fn list(
    root: &Path,
    below: &mut PathBuf,
    depth: usize,
    pattern: &Pattern,
    found: &mut Vec<(String, Numbers)>,
) -> Result<()> {
    let folder = root.join(&below);
    for entry in fs::read_dir(&folder).map_err(Error::io(&folder))? {
        let entry = entry.map_err(Error::io(&folder))?;
        below.push(entry.file_name());
        let is_dir = fs::metadata(entry.path()).map_err(Error::io(entry.path()))?.is_dir();
        if is_dir && depth < MAX_DEPTH {
            list(root, below, depth + 1, pattern, found)?;
        } else if let Some(name) = below.to_str().map(|name| name.replace('\\', "/"))
            && let Some(numbers) = pattern.matches(&name)
        {
            found.push((name, numbers));
        }
        below.pop();
    }
    Ok(())
}
