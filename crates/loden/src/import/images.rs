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
//! ```
//! The names in `files` are `view` and `light` (positions in the lists), or `theta_v`, `phi_v`, `theta_l`, `phi_l` (degrees, with
//! or without decimals; omit the lists then), and `any` for numbers without meaning. Omit `{view}` or `{light}` if there is
//! only one such direction. OUTex, PhoTex and sets of your own can be read this way.
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
use super::pattern::{self, Lists, Pattern};
use super::raw::read_toml;
use super::rti::Listed;
use super::{Conventions, Importer, Measured, head, located};
use crate::btf::Cosine;
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::params::{Param, Params, Values, YesNo};
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
        let Options { conventions: options, complete } = Options::from_values(options)?;
        let manifest: Manifest = read_toml(path)?;
        if manifest.loden_images != 1 {
            let problem = format!("version {} is not known, only 1 is", manifest.loden_images);
            return Err(Error::invalid(path, "loden_images", problem));
        }
        let pattern = Pattern::parse(&manifest.files, &pattern::NAMES);
        let pattern = pattern.map_err(|problem| Error::invalid(path, "files", problem))?;
        let found = pattern::list(path, &pattern, &manifest.files)?;
        let lists =
            Lists { views: manifest.views.as_ref(), lights: manifest.lights.as_ref(), pairs: manifest.pairs.as_ref() };
        let [views, lights] = lists.sides(path, &found, manifest.count_from)?;
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
            return Err(Error::invalid(path, "exposure", format!("found {bad}, expected a positive number")));
        }
        let facts = options.reasons(
            if manifest.encoding.is_some() { "stated by the manifest" } else { "by the kind of picture" },
            if manifest.cosine.is_some() { "stated by the manifest" } else { "not stated; photographs have it" },
        );
        let cosine = manifest.cosine.unwrap_or(Cosine::Included);
        let options = Conventions { encoding: options.encoding.or(manifest.encoding), ..options };
        let plan = Plan { views: views.set, lights: lights.set, image, exposure, cosine, warnings: Vec::new(), facts };
        let plan = plan.listed_unless(complete).map_err(located(path))?;
        let files = Listed::new(path, found.into_iter().map(|(name, _)| name).collect())?;
        Ok(Measured::Btf(Arc::new(ImageSet::new(files, plan, &options)?)))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>> {
        let manifest: Manifest = read_toml(path)?;
        let pattern = Pattern::parse(&manifest.files, &pattern::NAMES);
        let pattern = pattern.map_err(|problem| Error::invalid(path, "files", problem))?;
        let found = pattern::list(path, &pattern, &manifest.files)?;
        Ok([path.into()].into_iter().chain(found.iter().map(|(name, _)| path.with_file_name(name))).collect())
    }
}
