//! Detection of the sample's own outline, where there is no marker frame.

use glam::{DVec2, Vec3};
use serde::{Deserialize, Serialize};

use super::detect::{DetectedFrame, GreyImage, Quadrilateral, median};
use super::projection::{Homography, Lens};
use super::resample::Photograph;

/// What the manifest says of a sample without a marker frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Outline {
    /// Width of the sample over its height.
    pub aspect: f64,
    /// About where the top left corner of the sample is, in pixels from the top left of the photograph: for all views or for each;
    /// of a list of pairs, for each of them.
    pub top_left: Vec<[f64; 2]>,
}

impl Default for Outline {
    fn default() -> Self {
        Self { aspect: 1.0, top_left: vec![[0.0, 0.0]] }
    }
}

/// Values of this many pixels, one after the other, must differ from the background.
const SUSTAINED: usize = 3;
/// Pixels from an edge that its blur reaches.
const BLUR: f64 = 2.0;
/// Pixels behind the blur whose mean is the level of the sample at its edge.
const INSIDE: usize = 3;
/// Pixels between the profiles across a side.
const STEP: f64 = 1.0;
/// Part of a side at each end that is left out, where another side is near.
const ENDS: f64 = 0.04;

/// Detects the outline of a quadrilateral sample before an even background.
///
/// # Model
/// The background is the median colour of the photograph's border. A pixel has the distance of its colour from it, which falls from
/// the sample's to zero as the sample covers less of the pixel. Along rays from the border to the centre, the outline is first
/// passed where three pixels in a row differ; four lines are fitted to these points as to those of a marker frame. Then
/// profiles are taken across every line, one pixel apart: the edge is where a profile passes half of the sample's level behind it.
/// Lines through these points give the corners, the first of which is the nearest to `top_left`.
///
/// # Limits
/// The centre of the photograph must lie on the sample and its border on the background, with nothing between. The sample must
/// differ from the background in brightness or colour all along its edge. Shadows on a bright background count as sample: use a dark
/// one.
///
/// # Errors
/// A description of what was not found.
pub(super) fn find(photograph: &Photograph, lens: &Lens, top_left: DVec2) -> Result<DetectedFrame, String> {
    let Photograph { width, height, rgb } = photograph;
    if *width.min(height) < 16 {
        return Err("the photograph is less than 16 pixels wide or high".into());
    }
    let (background, noise) = background(photograph);
    let values: Vec<f32> = rgb.iter().map(|c| c.distance(background)).collect();
    let picture = GreyImage { width: *width, height: *height, values: &values };
    // Find the outline along rays
    let least = 8.0 * noise + 1e-3;
    let rays = picture.rays().filter_map(|ray| first_different(&picture, &ray, least));
    let points: Vec<DVec2> = rays.map(|p| lens.undistort(p)).collect();
    let mut found = Quadrilateral::of_points(&points, "the outline of the sample")?;
    // Refine it across its sides
    for _ in 0..2 {
        let edges: Vec<DVec2> = (0..4).flat_map(|side| edges(&picture, lens, &found.corners, side, least)).collect();
        found = Quadrilateral::of_points(&edges, "the outline of the sample")?;
    }
    let nearest = (0..4).min_by(|&a, &b| {
        let off = |i: usize| lens.distort(found.corners[i]).distance_squared(top_left);
        off(a).total_cmp(&off(b))
    });
    let corners = [0, 1, 2, 3].map(|i| found.corners[(i + nearest.unwrap_or(0)) % 4]);
    let homography = Homography::from_square(0.0, 1.0, corners);
    let homography = homography.ok_or("the sides of the sample are not a convex quadrilateral")?;
    Ok(DetectedFrame { homography, error: found.error, points: found.points })
}

/// The median colour of the border, and the robust standard deviation from it.
fn background(photograph: &Photograph) -> (Vec3, f64) {
    let (w, h) = (photograph.width, photograph.height);
    let rim: Vec<Vec3> = (0..w * h)
        .filter(|i| i % w == 0 || i % w == w - 1 || i / w == 0 || i / w == h - 1)
        .map(|i| photograph.rgb[i])
        .collect();
    let channel = |k: usize| median(&mut rim.iter().map(|c| f64::from(c[k])).collect::<Vec<_>>()) as f32;
    let colour = Vec3::new(channel(0), channel(1), channel(2));
    (colour, 1.4826 * median(&mut rim.iter().map(|c| f64::from(c.distance(colour))).collect::<Vec<_>>()))
}

/// The first point of a ray, from the border, where pixels differ from the background.
fn first_different(picture: &GreyImage, ray: &[DVec2], least: f64) -> Option<DVec2> {
    let different: Vec<bool> = ray.iter().map(|p| picture.at(*p) > least).collect();
    let first = different.windows(SUSTAINED).position(|three| three.iter().all(|d| *d))?;
    (first > 0).then(|| ray[first])
}

/// Points of the sample's edge across a side, undistorted.
fn edges(picture: &GreyImage, lens: &Lens, corners: &[DVec2; 4], side: usize, least: f64) -> Vec<DVec2> {
    let (from, to) = (corners[side], corners[(side + 1) % 4]);
    let along = to - from;
    // corners are clockwise with y down: the sample is to the right
    let inwards = along.normalize().perp();
    let steps = (along.length() * (1.0 - 2.0 * ENDS) / STEP).max(0.0) as usize;
    let profile = |i: usize| {
        let middle = from + along * (ENDS + (i as f64 + 0.5) * STEP / along.length());
        let at = |off: f64| picture.at(lens.distort(middle + inwards * off));
        let inside = (0..INSIDE).map(|k| at(BLUR + k as f64)).sum::<f64>() / INSIDE as f64;
        let half = inside / 2.0;
        if half < least / 2.0 {
            return None;
        }
        // from the sample outwards
        let offs = (0..=24).map(|k| BLUR - f64::from(k) * (2.0 * BLUR / 24.0));
        let values: Vec<(f64, f64)> = offs.map(|off| (off, at(off))).collect();
        let passed = values.windows(2).find(|pair| pair[0].1 >= half && pair[1].1 < half)?;
        let [(a, of_a), (b, of_b)] = [passed[0], passed[1]];
        Some(middle + inwards * (a + (b - a) * (of_a - half) / (of_a - of_b)))
    };
    (0..steps).filter_map(profile).collect()
}
