//! Raw photographs of a sample in a marker frame, made into a BTF.
//!
//! # Format
//! A TOML file beside the photographs:
//! ```toml
//! loden_photographs = 1
//! files = "v{view}/l{light}_e{exposure}.png"  # as for `import::images`; {exposure} counts the exposures
//! views = "bonn81"
//! lights = "bonn81"
//! count_from = 0                # the number of the first view, light and exposure
//! exposures = [0.5, 2.0]        # relative to each other; one if left out
//! bits = 12                     # of a sensor whose numbers are stored in 16 bits; else the full range is used
//! encoding = "linear"           # srgb, linear or gammaN
//! dark = "dark.png"             # a photograph without light
//! white = "white.png"           # a photograph of a white target lit head-on
//! white_exposure = 0.5
//! white_value = 1.0             # the target's apparent value; a perfectly white matt one has 1
//! distortion = [-0.05, 0.0]     # r (1 + k1 r^2 + k2 r^4), r in halves of the width from the middle
//!
//! [frame]                       # in sample sides; a white ring on black, a black mark at the top left corner
//! inner = 0.02
//! outer = 0.12
//! mark = 0.06
//! ```
//! With `corners = [[[x, y], [x, y], [x, y], [x, y]]]`, pixels of the sample's top left, top right, bottom right and bottom
//! left corner for all views or for each, no frame is looked for. Without `white` the numbers are taken as fractions of
//! the full scale per exposure.
//!
//! # Model
//! Exposures are merged to linear light (`develop`), the frame is found in every photograph
//! (`detect`), and texels are means over the photograph (`resample`).
//!
//! # Limits
//! Colour filter arrays must be interpolated before. The directions are those stated, alike for the whole sample.

mod detect;
mod develop;
mod manifest;
mod projection;
mod resample;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

pub use detect::{Found, Frame, Grey, find};
pub use manifest::{Corners, Manifest};
pub use projection::{Distortion, Homography, Lens};
pub use resample::{Photograph, resample};

use crate::btf::{BtfMeta, Cosine, SampleType};
use crate::color::{Encoding, luminance};
use crate::direction::DirectionSet;
use crate::progress::{Progress, Task};
use crate::{Error, Result};
use develop::Developer;

/// More texels a side are refused.
const MAX_SIZE: usize = 8192;

/// How photographs are rectified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Texels per side.
    pub size: usize,
    /// Photographs whose frame's edges are off by more pixels than this, root mean square, are refused.
    pub max_error: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { size: 256, max_error: 0.5 }
    }
}

/// What became of one photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The file of its shortest exposure.
    pub file: PathBuf,
    /// Which view and light.
    pub pair: [usize; 2],
    /// Root mean square distance of the frame's edge points from straight edges, pixels; none where corners were given
    /// or no frame was found.
    pub error: Option<f64>,
    /// Pixels saturated in every exposure, also outside of the sample.
    pub saturated: usize,
    /// Why it is not used, if so; its image is then that of the nearest light of its view.
    pub refused: Option<String>,
}

/// A set of photographs whose files were found.
pub struct Photographs {
    path: PathBuf,
    manifest: Manifest,
    developer: Developer,
    plan: manifest::Plan,
}

impl Photographs {
    /// Reads a manifest, and the dark and white frames it names.
    ///
    /// # Errors
    /// If a field is wrong, a file is missing, or a pair of directions has no photograph.
    pub fn open(path: &Path) -> Result<Self> {
        let manifest = Manifest::read(path)?;
        let plan = manifest.plan(path)?;
        Ok(Self { path: path.into(), developer: Developer::new(&manifest, path)?, manifest, plan })
    }

    /// What the BTF will be.
    pub fn meta(&self, options: &Options) -> BtfMeta {
        BtfMeta {
            width: options.size,
            height: options.size,
            views: self.plan.views.clone(),
            lights: self.plan.lights.clone(),
            encoding: Encoding::Linear,
            cosine: Cosine::Included,
            sample_type: SampleType::F32,
        }
    }

    /// Rectifies all photographs and gives the images to `sink`, view by view in order: apparent values of shape
    /// (light, y, x, rgb).
    ///
    /// # Errors
    /// If a file cannot be read, all photographs of a view are refused, an option is out of range; [`Error::Cancelled`];
    /// what `sink` returns.
    pub fn rectify(
        &self,
        options: &Options,
        progress: &dyn Progress,
        sink: &mut dyn FnMut(Vec<f32>) -> Result<()>,
    ) -> Result<Vec<Outcome>> {
        if !(1..=MAX_SIZE).contains(&options.size) {
            return Err(Error::parameter("size", format!("found {}, expected 1..{MAX_SIZE}", options.size)));
        }
        let lights = self.plan.lights.len();
        let task = Task::new(progress, "rectify", self.plan.shots.len() as u64);
        let mut outcomes = Vec::new();
        for view in 0..self.plan.views.len() {
            let one = |light: usize| {
                task.advance(1)?;
                self.one(view, light, options)
            };
            let (mut images, all): (Vec<_>, Vec<_>) =
                (0..lights).into_par_iter().map(one).collect::<Result<Vec<_>>>()?.into_iter().unzip();
            self.substitute(&mut images, &all, &self.plan.lights)?;
            sink(images.concat())?;
            outcomes.extend(all);
        }
        Ok(outcomes)
    }

    /// One image, empty if the photograph is refused.
    fn one(&self, view: usize, light: usize, options: &Options) -> Result<(Vec<f32>, Outcome)> {
        let shot = &self.plan.shots[view * self.plan.lights.len() + light];
        let (photograph, saturated) = self.developer.develop(shot)?;
        let lens = Lens::new(self.manifest.distortion, photograph.width, photograph.height);
        if !lens.is_monotonic() {
            return Err(Error::invalid(&self.path, "distortion", "it folds the photographs over"));
        }
        let mut outcome =
            Outcome { file: shot[0].0.clone(), pair: [view, light], error: None, saturated, refused: None };
        let homography = match &self.manifest.corners {
            Some(corners) => {
                let corners =
                    corners[if corners.len() == 1 { 0 } else { view }].map(|corner| lens.undistort(corner.into()));
                let problem = || {
                    Error::invalid(&self.path, "corners", format!("those of view {view} are not convex and clockwise"))
                };
                Ok(Homography::from_square(0.0, 1.0, corners).ok_or_else(problem)?)
            }
            None => {
                let values: Vec<f32> = photograph.rgb.iter().map(|c| luminance(c.to_array())).collect();
                let grey = Grey { width: photograph.width, height: photograph.height, values: &values };
                find(&grey, &self.manifest.frame, &lens).and_then(|found| {
                    outcome.error = Some(found.error);
                    let problem = format!(
                        "the frame's edges are off by {:.2} pixels, more than {}",
                        found.error, options.max_error
                    );
                    if found.error <= options.max_error { Ok(found.homography) } else { Err(problem) }
                })
            }
        };
        match homography {
            Ok(homography) => Ok((resample(&photograph, &homography, &lens, options.size), outcome)),
            Err(problem) => Ok((Vec::new(), Outcome { refused: Some(problem), ..outcome })),
        }
    }

    /// Gives refused photographs the image of the nearest light that has one.
    fn substitute(&self, images: &mut [Vec<f32>], all: &[Outcome], lights: &DirectionSet) -> Result<()> {
        let good: Vec<usize> = (0..images.len()).filter(|&l| all[l].refused.is_none()).collect();
        for light in (0..images.len()).filter(|&l| all[l].refused.is_some()) {
            let nearness = |&l: &usize| lights.directions()[l].dot(lights.directions()[light]);
            let nearest = good.iter().copied().max_by(|a, b| nearness(a).total_cmp(&nearness(b)));
            let problem = || {
                format!("no photograph of its view can be used: {}", all[light].refused.as_deref().unwrap_or_default())
            };
            let nearest = nearest.ok_or_else(|| Error::invalid(&all[light].file, "frame", problem()))?;
            images[light] = images[nearest].clone();
        }
        Ok(())
    }
}
