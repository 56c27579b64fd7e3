//! Rectification: a BTF from raw photographs of a sample in a marker frame, or of a rectangular sample by its outline.
//!
//! # Format
//! A TOML file next to the photographs:
//! ```toml
//! loden_photographs = 1
//! files = "v{view}/l{light}_e{exposure}.png"  # as for `import::images`; {exposure} is the number of the exposure
//! views = "bonn81"
//! lights = "bonn81"
//! pairs = [[0, 0, 45, 10]]      # instead of both: polar angle and azimuth of the light, then of the view, of photograph {pair}
//! count_from = 0                # number of the first view, light, pair and exposure; default 0
//! exposures = [0.5, 2.0]        # relative exposures; default: one exposure of 1
//! bits = 12                     # bit depth of the sensor, for numbers stored in 16 bits; default: the full range
//! encoding = "linear"           # srgb, linear or gammaN
//! dark = "dark.png"             # dark frame: a photograph without light
//! white = "white.png"           # white frame: a photograph of a white target, lit along its normal
//! white_exposure = 0.5
//! white_value = 1.0             # apparent value of the target; 1 for a perfect diffuser
//! distortion = [-0.05, 0.0]     # k1, k2 of r (1 + k1 r^2 + k2 r^4), r in half widths from the centre
//!
//! [frame]                       # in sample sides: a white ring on black, with a black mark at the top left corner
//! inner = 0.02
//! outer = 0.12
//! mark = 0.06
//!
//! [outline]                     # instead of a frame: the sample's own outline before an even background
//! aspect = 1.5                  # width of the sample over its height; default 1
//! top_left = [[0, 0]]           # about where its top left corner is, in pixels, for all views or for each; default [[0, 0]]
//! ```
//! Instead of both, `corners = [[[x, y], [x, y], [x, y], [x, y]]]` gives the top left, top right, bottom right and
//! bottom left corner of the sample in pixels, for all views or for each; of `pairs`, for each of them. If less than half of
//! all pairs of views and lights have a photograph, the BTF has its own list of pairs, those that have one; otherwise, and of
//! `pairs`, all must have one. Without `white`, values are fractions of full scale per unit of exposure.
//!
//! # Model
//! Exposures are merged to linear light (`develop`), the frame (`detect`) or outline is found in every photograph, and each texel
//! is a mean over the photograph (`resample`).
//!
//! # Limits
//! Colour filter arrays must be demosaiced first. Directions are taken from the manifest, the same for the whole sample.

pub(crate) mod detect;
mod develop;
pub(crate) mod manifest;
mod outline;
pub(crate) mod projection;
mod resample;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::btf::{BtfMeta, Cosine, SampleType};
use crate::color::{Encoding, luminance};
use crate::progress::{Progress, Task};
use crate::{Error, Result};
use detect::{DetectedFrame, GreyImage, find};
use develop::Developer;
use manifest::Manifest;
use outline::Outline;
use projection::{Homography, Lens};
use resample::{Photograph, resample};

/// Maximum number of texels per side.
const MAX_SIZE: usize = 8192;

/// Options of the rectification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Texels per side.
    pub size: usize,
    /// Photographs whose frame edges deviate by more than this, in pixels (root mean square), are rejected.
    pub max_error: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { size: 256, max_error: 0.5 }
    }
}

/// The result of one photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// File of the shortest exposure.
    pub file: PathBuf,
    /// Indices of view and light.
    pub pair: [usize; 2],
    /// Root mean square distance of the edge points of the frame from straight lines, in pixels; `None` if corners were
    /// given or no frame was found.
    pub error: Option<f64>,
    /// Number of pixels that are saturated in every exposure, including those outside the sample.
    pub saturated: usize,
    /// Why the photograph was rejected, if it was; the image of the nearest light in the same view replaces it, or that of the
    /// nearest pair.
    pub refused: Option<String>,
}

/// A set of photographs whose files exist.
pub struct Photographs {
    path: PathBuf,
    manifest: Manifest,
    developer: Developer,
    plan: manifest::Plan,
}

impl Photographs {
    /// Reads a manifest and its dark and white frames.
    ///
    /// # Errors
    /// [`Error::Invalid`] if a field is wrong; [`Error::Io`].
    pub fn open(path: &Path) -> Result<Self> {
        let manifest = Manifest::read(path)?;
        let plan = manifest.plan(path)?;
        Ok(Self { path: path.into(), developer: Developer::new(&manifest, path)?, manifest, plan })
    }

    /// The metadata of the resulting BTF.
    pub fn meta(&self, options: &Options) -> BtfMeta {
        BtfMeta {
            width: options.size,
            height: self.rows(options),
            views: self.plan.views.clone(),
            lights: self.plan.lights.clone(),
            encoding: Encoding::Linear,
            cosine: Cosine::Included,
            sample_type: SampleType::F32,
        }
    }

    /// Rows of texels: as many as columns, or by the aspect of the sample.
    fn rows(&self, options: &Options) -> usize {
        let aspect = self.manifest.outline.as_ref().map_or(1.0, |outline| outline.aspect);
        ((options.size as f64 / aspect).round() as usize).clamp(1, MAX_SIZE)
    }

    /// Rectifies all photographs and passes the images of one view after the other to `sink`: apparent values of shape
    /// (light, y, x, rgb).
    ///
    /// # Errors
    /// If a file cannot be read, all photographs of a view are rejected, or an option is out of range;
    /// [`Error::Cancelled`]; errors of `sink`.
    pub fn rectify(
        &self,
        options: &Options,
        progress: &dyn Progress,
        sink: &mut dyn FnMut(Vec<f32>) -> Result<()>,
    ) -> Result<Vec<Outcome>> {
        if !(1..=MAX_SIZE).contains(&options.size) {
            return Err(Error::parameter("size", format!("found {}, expected 1 to {MAX_SIZE}", options.size)));
        }
        let lights = self.plan.lights.len();
        let task = Task::new(progress, "rectify", self.plan.shots.len() as u64);
        let mut outcomes = Vec::new();
        for view in 0..self.plan.views.len() {
            let one = |light: usize| {
                task.advance(1)?;
                self.rectify_pair(view, light, options)
            };
            let (mut images, all): (Vec<_>, Vec<_>) =
                (0..lights).into_par_iter().map(one).collect::<Result<Vec<_>>>()?.into_iter().unzip();
            self.substitute(&mut images, &all)?;
            sink(images.concat())?;
            outcomes.extend(all);
        }
        Ok(outcomes)
    }

    /// The image of one pair; empty if the photograph is rejected.
    fn rectify_pair(&self, view: usize, light: usize, options: &Options) -> Result<(Vec<f32>, Outcome)> {
        let pair = view * self.plan.lights.len() + light;
        let shot = &self.plan.shots[pair];
        let (photograph, saturated) = self.developer.develop(shot)?;
        let lens = Lens::new(self.manifest.distortion, photograph.width, photograph.height);
        if !lens.is_monotonic() {
            return Err(Error::invalid(
                &self.path,
                "distortion",
                "the distortion is not invertible within the photograph",
            ));
        }
        let mut outcome =
            Outcome { file: shot[0].0.clone(), pair: [view, light], error: None, saturated, refused: None };
        let homography = match &self.manifest.corners {
            Some(corners) => {
                let place = if corners.len() == 1 { 0 } else { self.plan.quadrilaterals[pair] };
                let corners = corners[place].map(|corner| lens.undistort(corner.into()));
                let problem = || {
                    let what = if self.manifest.pairs.is_some() { "pair" } else { "view" };
                    let problem =
                        format!("{what} {place}: expected a convex quadrilateral, clockwise from the top left");
                    Error::invalid(&self.path, "corners", problem)
                };
                Ok(Homography::from_square(0.0, 1.0, corners).ok_or_else(problem)?)
            }
            None => self.detected(&photograph, &lens, pair).and_then(|found| {
                outcome.error = Some(found.error);
                let problem = format!(
                    "the edges of the {} deviate by {:.2} pixels, more than the limit of {}",
                    if self.manifest.outline.is_some() { "sample" } else { "frame" },
                    found.error,
                    options.max_error
                );
                if found.error <= options.max_error { Ok(found.homography) } else { Err(problem) }
            }),
        };
        match homography {
            Ok(homography) => {
                let size = [options.size, self.rows(options)];
                Ok((resample(&photograph, &homography, &lens, size), outcome))
            }
            Err(problem) => Ok((Vec::new(), Outcome { refused: Some(problem), ..outcome })),
        }
    }

    /// The frame or outline in a photograph.
    fn detected(
        &self,
        photograph: &Photograph,
        lens: &Lens,
        pair: usize,
    ) -> std::result::Result<DetectedFrame, String> {
        if let Some(Outline { top_left, .. }) = &self.manifest.outline {
            let place = if top_left.len() == 1 { 0 } else { self.plan.quadrilaterals[pair] };
            return outline::find(photograph, lens, top_left[place].into());
        }
        let values: Vec<f32> = photograph.rgb.iter().map(|c| luminance(c.to_array())).collect();
        let grey = GreyImage { width: photograph.width, height: photograph.height, values: &values };
        find(&grey, &self.manifest.frame, lens)
    }

    /// Replaces rejected photographs by the image of the nearest light in the same view, or by that of the nearest pair.
    fn substitute(&self, images: &mut [Vec<f32>], all: &[Outcome]) -> Result<()> {
        let (lights, views) = (self.plan.lights.directions(), self.plan.lights.seen_from());
        let good: Vec<usize> = (0..images.len()).filter(|&l| all[l].refused.is_none()).collect();
        for light in (0..images.len()).filter(|&l| all[l].refused.is_some()) {
            let nearness = |&l: &usize| {
                let of_views = views.map_or(0.0, |set| set.directions()[l].dot(set.directions()[light]));
                lights[l].dot(lights[light]) + of_views
            };
            let nearest = good.iter().copied().max_by(|a, b| nearness(a).total_cmp(&nearness(b)));
            let problem = || {
                format!("no photograph of this view is usable: {}", all[light].refused.as_deref().unwrap_or_default())
            };
            let nearest = nearest.ok_or_else(|| Error::invalid(&all[light].file, "frame", problem()))?;
            images[light] = images[nearest].clone();
        }
        Ok(())
    }
}
