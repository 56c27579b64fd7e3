//! `images`: any set of pictures, described by a small TOML file beside it.
//!
//! # Format
//! ```toml
//! loden_images = 1
//! files = "shots/v{view}/l{light}.jpg"   # below this file; {name} stands for a number
//! views = "bonn81"                       # or "ubo2014", or a list of [polar angle, azimuth] in degrees
//! lights = [[0, 0], [30, 0], [30, 90]]
//! count_from = 1                         # the number of the first view and light; 0 by default
//! encoding = "srgb"                      # srgb, linear or gammaN; by default that of the picture format
//! cosine = "included"                    # or excluded; whether the light's cosine is in the values
//! exposure = [1, 1, 0.5]                 # one number per light, or one for all: linear light is divided by it
//! illuminants = ["inca", "TL84"]          # words that {illuminant} in `files` stands for; see below
//! rotation = "ccw"                       # or cw; see below
//! ```
//! The names in `files` are `view` and `light` (positions in the lists), or `theta_v`, `phi_v`, `theta_l`, `phi_l` (degrees, with
//! or without decimals; omit the lists then), and `any` for numbers without meaning. Omit `{view}` or `{light}` if there is
//! only one such direction. OUTex, PhoTex and sets of your own can be read this way.
//!
//! `{illuminant}` is one of the words of `illuminants`: the first, or that which the option names. Different colours of the same
//! light are different measurements.
//!
//! `{rotation}` is the angle in degrees by which the sample was turned before the lamp and the camera, and `rotation` the sense in
//! which it then turns in the pictures. Pictures are turned back about their centre, and cut to the largest square that all of
//! them show. The azimuths of light and view are reduced by the angle: turning the sample is turning lamp and camera the other way.
//! Of pictures that then have the same directions the first counts.
//!
//! A set in which not every view comes with every light may state its pairs instead:
//! ```toml
//! files = "shot{pair}.png"               # {pair} is the position in the list
//! pairs = [[0, 0, 45, 10], [30, 90, 60, 0]] # polar angle and azimuth of the light, then of the view, in degrees
//! ```
//!
//! # Limits
//! Pictures must be rectified and of one size. If at least half of all pairs of views and lights are there, missing ones are
//! reported and repeat the nearest light of their view; if fewer are there, the set has its own list of pairs, unless it is to
//! be completed.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use super::image_set::{COMPLETE, ImageSet, Plan};
use super::pattern::{self, Lists, Numbers, Pattern, Side};
use super::raw::read_toml;
use super::rti::Listed;
use super::turned::{self, Sense};
use super::{Conventions, Importer, Measured, head, located};
use crate::btf::Cosine;
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::params::{Field, Form, Param, Params, Type, Values, YesNo};
use crate::{Error, Result};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    loden_images: u32,
    files: String,
    views: Option<DirectionSet>,
    lights: Option<DirectionSet>,
    pairs: Option<DirectionSet>,
    #[serde(default)]
    count_from: usize,
    encoding: Option<Encoding>,
    cosine: Option<Cosine>,
    exposure: Option<Exposure>,
    illuminants: Option<Vec<String>>,
    rotation: Option<Sense>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Exposure {
    All(f32),
    PerLight(Vec<f32>),
}

pub(super) struct Images;

crate::params! {
    struct Options {
        conventions: Conventions,
        complete: YesNo => COMPLETE,
        /// The illuminant whose pictures are read, of those that the manifest lists; by default the first.
        illuminant: Option<Word>,
    }
}

/// An illuminant.
#[derive(Debug, Clone, PartialEq)]
struct Word(String);

impl Field for Word {
    const TYPE: Type = Type::Text(Form {
        expected: "the name of an illuminant",
        examples: &[],
        accepts: |name| !name.is_empty() && !name.contains(['{', '}', '/']),
    });

    fn read(values: &Values, name: &str) -> Result<Self> {
        values.written(name).map(|text| Self(text.to_owned()))
    }

    fn write(&self, name: &str, values: &mut Values) -> Result<()> {
        values.set(name, &self.0)
    }
}

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

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn open(&self, path: &Path, options: &Values) -> Result<Measured> {
        let Options { conventions: options, complete, illuminant } = Options::from_values(options)?;
        let manifest = Manifest::read(path)?;
        let chosen = manifest.illuminant(path, illuminant.map(|Word(word)| word))?;
        let found = manifest.list(path, chosen.as_deref())?;
        let lists =
            Lists { views: manifest.views.as_ref(), lights: manifest.lights.as_ref(), pairs: manifest.pairs.as_ref() };
        let mut sides = lists.sides(path, &found, manifest.count_from)?;
        let turns = manifest.turns(path, &found)?;
        if !turns.is_empty() {
            let turned = |side: &Side| turned::in_sample(side, &turns).map_err(located(path));
            sides = [turned(&sides[0])?, turned(&sides[1])?];
        }
        let [views, lights] = sides;
        let (mut warnings, mut again) = (Vec::new(), Vec::new());
        let mut image: Vec<Option<usize>> = vec![None; views.set.len() * lights.set.len()];
        let mut exposure = Vec::new();
        for (index, (name, _)) in found.iter().enumerate() {
            let (view, light) = (views.of_file[index], lights.of_file[index]);
            match &mut image[view * lights.set.len() + light] {
                Some(other) if turns.is_empty() => {
                    return Err(Error::invalid(path, name, format!("the same directions as {}", found[*other].0)));
                }
                Some(_) => again.push(name),
                empty => *empty = Some(index),
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
            return Err(Error::invalid(path, "exposure", format!("found {bad}, expected a positive number")));
        }
        if let Some(first) = again.first() {
            let count = again.len();
            warnings.push(format!(
                "{count} turned pictures have the directions of another and are not used, the first is {first}"
            ));
        }
        let mut facts = options.reasons(
            if manifest.encoding.is_some() { "stated by the manifest" } else { "by the kind of picture" },
            if manifest.cosine.is_some() { "stated by the manifest" } else { "not stated; photographs have it" },
        );
        facts.extend(chosen.map(|word| ("illuminant", word)));
        let cosine = manifest.cosine.unwrap_or(Cosine::Included);
        let options = Conventions { encoding: options.encoding.or(manifest.encoding), ..options };
        let plan = Plan { views: views.set, lights: lights.set, image, exposure, turns, cosine, warnings, facts };
        let plan = plan.listed_unless(complete).map_err(located(path))?;
        let files = Listed::new(path, found.into_iter().map(|(name, _)| name).collect())?;
        Ok(Measured::Btf(Arc::new(ImageSet::new(files, plan, &options)?)))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>> {
        let manifest = Manifest::read(path)?;
        let illuminants: Vec<Option<&str>> = match &manifest.illuminants {
            Some(words) => words.iter().map(|word| Some(&word[..])).collect(),
            None => vec![None],
        };
        let mut files = vec![path.to_path_buf()];
        for illuminant in illuminants {
            files.extend(manifest.list(path, illuminant)?.iter().map(|(name, _)| path.with_file_name(name)));
        }
        Ok(files)
    }
}

impl Manifest {
    fn read(path: &Path) -> Result<Self> {
        let manifest: Self = read_toml(path)?;
        match manifest.loden_images {
            1 => Ok(manifest),
            other => Err(Error::invalid(path, "loden_images", format!("version {other} is not known, only 1 is"))),
        }
    }

    /// The illuminant that is asked for, or the first.
    fn illuminant(&self, path: &Path, asked: Option<String>) -> Result<Option<String>> {
        let wrong = |problem: &str| Err(Error::invalid(path, "illuminants", problem));
        let words = match &self.illuminants {
            Some(words) if words.is_empty() => return wrong("the list is empty"),
            Some(_) if !self.files.contains(ILLUMINANT) => return wrong("`files` has no {illuminant}"),
            Some(words) => words,
            None if self.files.contains(ILLUMINANT) => {
                return wrong("the list is missing, but `files` has {illuminant}");
            }
            None if asked.is_some() => {
                return Err(Error::parameter("illuminant", format!("{} lists no illuminants", path.display())));
            }
            None => return Ok(None),
        };
        let chosen = asked.unwrap_or_else(|| words[0].clone());
        if !words.contains(&chosen) {
            let problem = format!("found {chosen:?}, expected one of {}", words.join(", "));
            return Err(Error::parameter("illuminant", problem));
        }
        Ok(Some(chosen))
    }

    /// The files with the numbers in their names.
    fn list(&self, path: &Path, illuminant: Option<&str>) -> Result<Vec<(String, Numbers)>> {
        let files = illuminant.map_or(self.files.clone(), |word| self.files.replace(ILLUMINANT, word));
        let known = [&pattern::NAMES[..], &["rotation"]].concat();
        let pattern = Pattern::parse(&files, &known).map_err(|problem| Error::invalid(path, "files", problem))?;
        pattern::list(path, &pattern, &files)
    }

    /// By how many degrees the sample of each file was turned, counter-clockwise; empty if `files` has no `{rotation}`.
    fn turns(&self, path: &Path, found: &[(String, Numbers)]) -> Result<Vec<f64>> {
        let wrong = |problem: &str| Err(Error::invalid(path, "rotation", problem));
        match (self.rotation, found[0].1.contains_key("rotation")) {
            (None, false) => Ok(Vec::new()),
            (None, true) => wrong("the sense is missing, ccw or cw, but `files` has {rotation}"),
            (Some(_), false) => wrong("`files` has no {rotation}"),
            (Some(_), true) if self.pairs.is_some() => {
                wrong("found a list of pairs, which already says how the sample lies")
            }
            (Some(sense), true) => Ok(found.iter().map(|(_, numbers)| sense.degrees(numbers["rotation"])).collect()),
        }
    }
}

/// Stands for a word in the names of files.
const ILLUMINANT: &str = "{illuminant}";
