//! The TOML file that describes a set of photographs.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::detect::Frame;
use super::projection::Distortion;
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::import::pattern::{self, Pattern, Side};
use crate::import::raw::read_toml;
use crate::{Error, Result};

/// What the file says; see [`super`] for its fields.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// The version of the format, 1.
    pub loden_photographs: u32,
    /// The pattern of the files' names.
    pub files: String,
    /// View directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub views: Option<DirectionSet>,
    /// Light directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lights: Option<DirectionSet>,
    /// The number of the first view, light and exposure.
    #[serde(default)]
    pub count_from: usize,
    /// The exposures that `{exposure}` counts, relative to each other.
    #[serde(default = "one")]
    pub exposures: Vec<f64>,
    /// Bits of the sensor, where the files' numbers have more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bits: Option<u32>,
    /// How the numbers encode light.
    #[serde(default = "linear")]
    pub encoding: Encoding,
    /// The photograph without light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dark: Option<PathBuf>,
    /// The photograph of a white target lit head-on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub white: Option<PathBuf>,
    /// The exposure of `white`.
    #[serde(default = "unity")]
    pub white_exposure: f64,
    /// The apparent value of the white target.
    #[serde(default = "unity")]
    pub white_value: f64,
    /// Of the lens: k1 and k2.
    #[serde(default)]
    pub distortion: Distortion,
    /// The marker frame around the sample.
    #[serde(default)]
    pub frame: Frame,
    /// The sample's corners in the photographs, pixels, instead of a frame: of all views, or of each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corners: Option<Vec<Corners>>,
}

/// Top left, top right, bottom right, bottom left corner of the sample, as x and y from the top left of the photograph.
pub type Corners = [[f64; 2]; 4];

fn one() -> Vec<f64> {
    vec![1.0]
}

fn unity() -> f64 {
    1.0
}

fn linear() -> Encoding {
    Encoding::Linear
}

/// The files of a manifest in order.
pub(super) struct Plan {
    pub views: DirectionSet,
    pub lights: DirectionSet,
    /// For each (view, light) its files and their exposures, the shortest first.
    pub shots: Vec<Vec<(PathBuf, f64)>>,
}

impl Manifest {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let manifest: Self = read_toml(path)?;
        let wrong = |field: &str, problem: String| Err(Error::invalid(path, field, problem));
        if manifest.loden_photographs != 1 {
            return wrong(
                "loden_photographs",
                format!("version {} is not known, only 1 is", manifest.loden_photographs),
            );
        }
        let positive = |v: &f64| v.is_finite() && *v > 0.0;
        if manifest.exposures.is_empty() || !manifest.exposures.iter().all(positive) {
            return wrong("exposures", format!("{:?}, positive numbers are expected", manifest.exposures));
        }
        for (field, value) in [("white_exposure", manifest.white_exposure), ("white_value", manifest.white_value)] {
            if !positive(&value) {
                return wrong(field, format!("{value}, a positive number is expected"));
            }
        }
        if let Some(bits) = manifest.bits.filter(|bits| !(1..=16).contains(bits)) {
            return wrong("bits", format!("{bits}, a number from 1 to 16 is expected"));
        }
        if let Some(problem) = manifest.frame.problem() {
            return wrong("frame", problem);
        }
        if manifest.corners.iter().flatten().flatten().flatten().any(|v| !v.is_finite()) {
            return wrong("corners", "a number is not finite".into());
        }
        Ok(manifest)
    }

    /// The files below the folder of the manifest `path`. Every pair must have a file.
    pub(super) fn plan(&self, path: &Path) -> Result<Plan> {
        let known = [&pattern::NAMES[..], &["exposure"]].concat();
        let wrong = |field: &str, problem: String| Error::invalid(path, field, problem);
        let pattern = Pattern::parse(&self.files, &known).map_err(|problem| wrong("files", problem))?;
        let found = pattern::list(path, &pattern, &self.files)?;
        let side = |field, given: &Option<DirectionSet>, names| {
            Side::new(path, field, given.clone(), &found, names, self.count_from)
        };
        let views = side("views", &self.views, ["view", "theta_v", "phi_v"])?;
        let lights = side("lights", &self.lights, ["light", "theta_l", "phi_l"])?;
        if let Some(corners) = &self.corners
            && ![1, views.set.len()].contains(&corners.len())
        {
            return Err(wrong("corners", format!("{} sets for {} views", corners.len(), views.set.len())));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut shots = vec![Vec::new(); views.set.len() * lights.set.len()];
        for (i, (name, numbers)) in found.iter().enumerate() {
            let place = numbers.get("exposure").map_or(0.0, |number| number - self.count_from as f64);
            let exposure = self.exposures.get(place as usize).filter(|_| place >= 0.0 && place.fract() == 0.0);
            let problem = || format!("of {name} is not one of {} exposures", self.exposures.len());
            let exposure = *exposure.ok_or_else(|| wrong("exposures", problem()))?;
            let shot: &mut Vec<(PathBuf, f64)> = &mut shots[views.of_file[i] * lights.set.len() + lights.of_file[i]];
            if let Some((other, _)) = shot.iter().find(|(_, e)| *e == exposure) {
                return Err(wrong(name, format!("the same directions and exposure as {}", other.display())));
            }
            shot.push((folder.join(name), exposure));
        }
        if let Some(empty) = shots.iter().position(Vec::is_empty) {
            let [tv, pv] = views.set.degrees()[empty / lights.set.len()];
            let [tl, pl] = lights.set.degrees()[empty % lights.set.len()];
            return Err(wrong("files", format!("no photograph from ({tv}, {pv}) lit from ({tl}, {pl})")));
        }
        shots.iter_mut().for_each(|shot| shot.sort_by(|a, b| a.1.total_cmp(&b.1)));
        Ok(Plan { views: views.set, lights: lights.set, shots })
    }
}
