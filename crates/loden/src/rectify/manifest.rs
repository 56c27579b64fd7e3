//! The TOML file that describes a set of photographs.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::detect::Frame;
use super::outline::Outline;
use super::projection::Distortion;
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::import::pattern::{self, Lists, Numbers, Pattern, Side};
use crate::import::raw::read_toml;
use crate::{Error, Result};

/// The content of the file; [`super`] describes the fields.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of the format: 1.
    pub loden_photographs: u32,
    /// Pattern of the file names.
    pub files: String,
    /// View directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub views: Option<DirectionSet>,
    /// Light directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lights: Option<DirectionSet>,
    /// Pairs of directions, indexed by `{pair}`, instead of views and lights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pairs: Option<DirectionSet>,
    /// Number of the first view, light, pair and exposure.
    #[serde(default)]
    pub count_from: usize,
    /// Relative exposures, indexed by `{exposure}`.
    #[serde(default = "one")]
    pub exposures: Vec<f64>,
    /// Bit depth of the sensor, where the files store more bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bits: Option<u32>,
    /// Encoding of the numbers.
    #[serde(default = "linear")]
    pub encoding: Encoding,
    /// Dark frame: a photograph without light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dark: Option<PathBuf>,
    /// White frame: a photograph of a white target, lit along its normal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub white: Option<PathBuf>,
    /// Exposure of the white frame.
    #[serde(default = "unity")]
    pub white_exposure: f64,
    /// Apparent value of the white target.
    #[serde(default = "unity")]
    pub white_value: f64,
    /// Lens distortion.
    #[serde(default)]
    pub distortion: Distortion,
    /// Dimensions of the marker frame.
    #[serde(default)]
    pub frame: Frame,
    /// The outline of the sample itself instead of a frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outline: Option<Outline>,
    /// Corners of the sample in pixels instead of a frame, for all views or for each; of a list of pairs, for each of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corners: Option<Vec<Corners>>,
}

/// Top left, top right, bottom right and bottom left corner of the sample: x and y from the top left of the photograph.
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

/// The files of a photograph in several exposures.
pub(super) type Shot = Vec<(PathBuf, f64)>;

/// The files of a manifest, in order.
pub(super) struct Plan {
    pub views: DirectionSet,
    pub lights: DirectionSet,
    /// Files and exposures of each (view, light), shortest exposure first.
    pub shots: Vec<Shot>,
    /// The position of its corners in [`Manifest::corners`] and in [`Outline::top_left`], for each (view, light).
    pub quadrilaterals: Vec<usize>,
}

impl Manifest {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let manifest: Self = read_toml(path)?;
        let wrong = |field: &str, problem: String| Err(Error::invalid(path, field, problem));
        if manifest.loden_photographs != 1 {
            return wrong("loden_photographs", format!("found version {}, expected 1", manifest.loden_photographs));
        }
        let positive = |v: &f64| v.is_finite() && *v > 0.0;
        if manifest.exposures.is_empty() || !manifest.exposures.iter().all(positive) {
            return wrong("exposures", format!("found {:?}, expected positive numbers", manifest.exposures));
        }
        for (field, value) in [("white_exposure", manifest.white_exposure), ("white_value", manifest.white_value)] {
            if !positive(&value) {
                return wrong(field, format!("found {value}, expected a positive number"));
            }
        }
        if let Some(bits) = manifest.bits.filter(|bits| !(1..=16).contains(bits)) {
            return wrong("bits", format!("found {bits}, expected 1 to 16"));
        }
        if let Some(problem) = manifest.frame.problem() {
            return wrong("frame", problem);
        }
        if manifest.corners.iter().flatten().flatten().flatten().any(|v| !v.is_finite()) {
            return wrong("corners", "found a number that is not finite".into());
        }
        if let Some(Outline { aspect, top_left }) = &manifest.outline {
            if !(aspect.is_finite() && (0.01..=100.0).contains(aspect)) {
                return wrong("outline", format!("aspect: found {aspect}, expected 0.01 to 100"));
            }
            if top_left.iter().flatten().any(|v| !v.is_finite()) {
                return wrong("outline", "top_left: found a number that is not finite".into());
            }
            if manifest.corners.is_some() {
                return wrong("outline", "found corners beside the outline".into());
            }
        }
        Ok(manifest)
    }

    /// Finds the files in the folder of the manifest `path`. If less than half of all pairs of views and lights have any, the
    /// plan has its own list of pairs; otherwise each must have one.
    pub(super) fn plan(&self, path: &Path) -> Result<Plan> {
        // Match the files and their directions
        let known = [&pattern::NAMES[..], &["exposure"]].concat();
        let wrong = |field: &str, problem: String| Error::invalid(path, field, problem);
        let pattern = Pattern::parse(&self.files, &known).map_err(|problem| wrong("files", problem))?;
        let found = pattern::list(path, &pattern, &self.files)?;
        let lists = Lists { views: self.views.as_ref(), lights: self.lights.as_ref(), pairs: self.pairs.as_ref() };
        let [views, lights] = lists.sides(path, &found, self.count_from)?;
        let (what, count) = if self.pairs.is_some() { ("pair", lights.set.len()) } else { ("view", views.set.len()) };
        let corners = self.corners.as_ref().map(|corners| ("corners", "quadrilaterals", corners.len()));
        let outline = self.outline.as_ref().map(|outline| ("outline", "points top_left", outline.top_left.len()));
        if let Some((field, things, found)) = corners.or(outline)
            && ![1, count].contains(&found)
        {
            return Err(wrong(
                field,
                format!("found {found} {things} for {count} {what}s, expected 1 or one per {what}"),
            ));
        }
        let mut shots = self.shots(path, &found, [&views, &lights])?;
        let is_listed = self.pairs.is_some();
        let quadrilateral = |i: usize| if is_listed { i } else { i / lights.set.len() };
        let degrees = |i: usize| pattern::pair_degrees(&views.set, &lights.set, i);
        let there: Vec<usize> = (0..shots.len()).filter(|i| !shots[*i].is_empty()).collect();
        if is_listed || pattern::is_grid(&views.set, there.len(), shots.len()) {
            // Check that every pair has a photograph
            if let Some(empty) = shots.iter().position(Vec::is_empty) {
                let [tl, pl, tv, pv] = degrees(empty);
                let problem = format!("found no photograph for view ({tv}, {pv}) and light ({tl}, {pl})");
                return Err(wrong("files", problem));
            }
            let quadrilaterals = (0..shots.len()).map(quadrilateral).collect();
            return Ok(Plan { views: views.set, lights: lights.set, shots, quadrilaterals });
        }
        let listed = DirectionSet::of_pairs(&there.iter().map(|&i| degrees(i)).collect::<Vec<_>>())?;
        shots.retain(|shot| !shot.is_empty());
        let quadrilaterals = there.into_iter().map(quadrilateral).collect();
        Ok(Plan { views: DirectionSet::normal(), lights: listed, shots, quadrilaterals })
    }

    /// The files and exposures of each (view, light), shortest exposure first.
    fn shots(&self, path: &Path, found: &[(String, Numbers)], [views, lights]: [&Side; 2]) -> Result<Vec<Shot>> {
        let wrong = |field: &str, problem: String| Error::invalid(path, field, problem);
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut shots = vec![Shot::new(); views.set.len() * lights.set.len()];
        for (i, (name, numbers)) in found.iter().enumerate() {
            let place = numbers.get("exposure").map_or(0.0, |number| number - self.count_from as f64);
            let exposure = self.exposures.get(place as usize).filter(|_| place >= 0.0 && place.fract() == 0.0);
            let problem = || format!("{name}: the exposure is not one of the {} listed", self.exposures.len());
            let exposure = *exposure.ok_or_else(|| wrong("exposures", problem()))?;
            let shot = &mut shots[views.of_file[i] * lights.set.len() + lights.of_file[i]];
            if let Some((other, _)) = shot.iter().find(|(_, e)| *e == exposure) {
                return Err(wrong(name, format!("found the same directions and exposure as in {}", other.display())));
            }
            shot.push((folder.join(name), exposure));
        }
        shots.iter_mut().for_each(|shot| shot.sort_by(|a, b| a.1.total_cmp(&b.1)));
        Ok(shots)
    }
}
