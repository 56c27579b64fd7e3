//! Detection of the marker frame in a photograph.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::projection::{Homography, Lens};

/// The marker frame around a sample: a white ring with a square outer edge on a black board. A black square on the ring
/// marks the top left corner of the sample. Lengths are in sample sides.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Distance from the sample to the inner edge of the ring.
    pub inner: f64,
    /// Distance from the sample to the outer edge of the ring.
    pub outer: f64,
    /// Side of the black mark, which is centred on the ring.
    pub mark: f64,
}

impl Default for Frame {
    fn default() -> Self {
        Self { inner: 0.02, outer: 0.12, mark: 0.06 }
    }
}

impl Frame {
    /// Distance from the sample to the centre line of the ring.
    pub fn middle(&self) -> f64 {
        (self.inner + self.outer) / 2.0
    }

    /// Describes what is wrong with the lengths, if anything.
    pub(super) fn problem(&self) -> Option<String> {
        let Self { inner, outer, mark } = *self;
        let good = inner >= 0.0 && outer > inner && outer <= 10.0 && mark > 0.0 && mark < outer - inner;
        (!good).then(|| {
            format!(
                "found inner {inner}, outer {outer}, mark {mark}; \
                 expected 0 <= inner < outer <= 10 and 0 < mark < outer - inner"
            )
        })
    }

    /// Whether a point of the plane (in sample sides, origin at the top left corner) is on the ring, outside the mark.
    pub fn is_white(&self, point: DVec2) -> bool {
        let outside = (point - 0.5).abs().max_element() - 0.5;
        let mark = (point + self.middle()).abs().max_element() <= self.mark / 2.0;
        (self.inner..=self.outer).contains(&outside) && !mark
    }
}

/// A detected frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectedFrame {
    /// From the sample plane to the undistorted photograph.
    pub homography: Homography,
    /// Root mean square distance of the edge points from the edges, in pixels.
    pub error: f64,
    /// Number of edge points.
    pub points: usize,
}

/// A grey image, row by row from the top; pixel (0, 0) covers 0..1.
pub struct GreyImage<'a> {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Pixel values, linear light.
    pub values: &'a [f32],
}

/// Rays from the centre of the photograph along which the outer edge is searched.
const RAYS: usize = 720;
/// Maximum blur of the edge, in pixels.
const BLUR: usize = 4;
/// Points closer than this to a corner of the ring, in pixels, are assigned to no side.
const CORNER: f64 = 4.0;
/// Minimum number of points on a side.
const MIN_POINTS: usize = 8;

/// Four straight sides fitted to points.
pub(super) struct Quadrilateral {
    /// Clockwise in the image (y down), undistorted.
    pub corners: [DVec2; 4],
    /// Root mean square distance of the points from the sides, in pixels.
    pub error: f64,
    /// Number of points on the sides.
    pub points: usize,
}

impl Quadrilateral {
    /// Fits the sides to undistorted points of `what`.
    pub(super) fn of_points(points: &[DVec2], what: &str) -> Result<Self, String> {
        if points.len() < 4 * MIN_POINTS {
            return Err(format!("{what} has only {} edge points", points.len()));
        }
        let mut corners = farthest_corners(points);
        let mut sides = [const { Vec::new() }; 4];
        for _ in 0..3 {
            sides = assign_to_sides(points, &corners);
            if let Some(few) = sides.iter().map(Vec::len).min().filter(|few| *few < MIN_POINTS) {
                return Err(format!("a side of {what} has only {few} edge points"));
            }
            let lines = [0, 1, 2, 3].map(|i| Line::fit_robustly(&mut sides[i]));
            for i in 0..4 {
                let problem = || format!("the sides of {what} are parallel");
                corners[i] = lines[(i + 3) % 4].intersection(&lines[i]).ok_or_else(problem)?;
            }
        }
        let count: usize = sides.iter().map(Vec::len).sum();
        if 2 * count < points.len() {
            return Err(format!("only {count} of {} edge points lie on straight sides", points.len()));
        }
        let squares = sides.iter().flat_map(|side| {
            let line = Line::fit(side);
            side.iter().map(move |p| line.distance(*p).powi(2))
        });
        Ok(Self { corners, error: (squares.sum::<f64>() / count as f64).sqrt(), points: count })
    }
}

impl GreyImage<'_> {
    pub(super) fn at(&self, p: DVec2) -> f64 {
        let clamp = |v: f64, n: usize| (v - 0.5).clamp(0.0, (n - 1) as f64);
        let (x, y) = (clamp(p.x, self.width), clamp(p.y, self.height));
        let (i, j) = (x as usize, y as usize);
        let (k, l) = ((i + 1).min(self.width - 1), (j + 1).min(self.height - 1));
        let (s, t) = (x - i as f64, y - j as f64);
        let v = |i: usize, j: usize| f64::from(self.values[j * self.width + i]);
        (1.0 - t) * ((1.0 - s) * v(i, j) + s * v(k, j)) + t * ((1.0 - s) * v(i, l) + s * v(k, l))
    }

    /// The brightness of the board: median of the border pixels and their robust standard deviation.
    fn board(&self) -> (f64, f64) {
        let (w, h) = (self.width, self.height);
        let rim = (0..w * h).filter(|i| i % w == 0 || i % w == w - 1 || i / w == 0 || i / w == h - 1);
        let mut values: Vec<f64> = rim.map(|i| f64::from(self.values[i])).collect();
        let level = median(&mut values);
        let mut off: Vec<f64> = values.iter().map(|v| (v - level).abs()).collect();
        (level, 1.4826 * median(&mut off))
    }

    /// Rays from the border of the photograph to its centre.
    pub(super) fn rays(&self) -> impl Iterator<Item = Vec<DVec2>> {
        (0..RAYS).map(|index| self.ray(index))
    }

    /// The points of a ray from the border of the photograph to its centre, one pixel apart.
    fn ray(&self, index: usize) -> Vec<DVec2> {
        let middle = DVec2::new(self.width as f64, self.height as f64) / 2.0;
        let towards = DVec2::from_angle(std::f64::consts::TAU * index as f64 / RAYS as f64);
        let room = ((middle - 0.5) / towards.abs().max(DVec2::splat(1e-9))).min_element();
        (0..=room as usize).map(|i| middle + towards * (room - i as f64)).collect()
    }
}

/// Detects the frame.
///
/// # Model
/// Along each ray from the border inwards, the outer edge of the ring is the first crossing of the level halfway
/// between board and ring, interpolated linearly between pixels. The edge points are undistorted and assigned to four
/// sides. Each side is a total least squares line, refitted without outliers. The intersections of the sides give the
/// homography; the darkest corner of the ring is the top left one.
///
/// # Limits
/// The centre of the photograph must lie inside the ring and its border on the board, and the ring must be the first
/// bright object from the border. The sample may have any brightness.
///
/// # Errors
/// A description of what was not found.
pub fn find(picture: &GreyImage<'_>, frame: &Frame, lens: &Lens) -> Result<DetectedFrame, String> {
    if picture.width.min(picture.height) < 16 {
        return Err("the photograph is less than 16 pixels wide or high".into());
    }
    let (board, noise) = picture.board();
    // Determine the levels of board and ring
    let white = ring_level(picture, board, noise).ok_or("found no bright ring on a dark board")?;
    let half = (board + white) / 2.0;
    // Find edge points along the rays
    let seen = (0..RAYS).filter_map(|i| crossing(picture, &picture.ray(i), half));
    let points: Vec<DVec2> = seen.map(|p| lens.undistort(p)).collect();
    if points.len() < RAYS / 2 {
        return Err(format!("only {} of {RAYS} rays cross a bright ring", points.len()));
    }
    let sides = Quadrilateral::of_points(&points, "the ring")?;
    let homography = orient(picture, frame, lens, sides.corners, half)?;
    Ok(DetectedFrame { homography, error: sides.error, points: sides.points })
}

pub(super) fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The brightness of the ring: the median over the rays of the first plateau from the border.
fn ring_level(picture: &GreyImage<'_>, board: f64, noise: f64) -> Option<f64> {
    let plateau = |i: usize| {
        let values: Vec<f64> = picture.ray(i).iter().map(|p| picture.at(*p)).collect();
        let rise = values.iter().position(|v| *v > board + 12.0 * noise + 1e-4)?;
        values[rise..].iter().take(BLUR).copied().reduce(f64::max)
    };
    let mut levels: Vec<f64> = (0..RAYS).filter_map(plateau).collect();
    (levels.len() > RAYS / 2).then(|| median(&mut levels))
}

/// The first point of a ray, from the border, that crosses `level`.
fn crossing(picture: &GreyImage<'_>, ray: &[DVec2], level: f64) -> Option<DVec2> {
    let inside = ray.iter().position(|p| picture.at(*p) > level).filter(|i| *i > 0)?;
    let (a, b) = (picture.at(ray[inside - 1]), picture.at(ray[inside]));
    Some(ray[inside - 1].lerp(ray[inside], (level - a) / (b - a)))
}

/// Initial corners of the convex quadrilateral through the points, clockwise in the image (y down): the farthest point
/// from the centre, the farthest from that one, and the farthest on either side of the line between them.
fn farthest_corners(points: &[DVec2]) -> [DVec2; 4] {
    let middle = points.iter().sum::<DVec2>() / points.len() as f64;
    let farthest =
        |of: &dyn Fn(DVec2) -> f64| points.iter().copied().max_by(|a, b| of(*a).total_cmp(&of(*b))).unwrap_or(middle);
    let a = farthest(&|p| p.distance_squared(middle));
    let c = farthest(&|p| p.distance_squared(a));
    let b = farthest(&|p| (p - a).perp_dot(c - a));
    let d = farthest(&|p| (c - a).perp_dot(p - a));
    [a, b, c, d]
}

/// Assigns points to the nearest side, except near the corners. Side i runs from corner i to the next.
fn assign_to_sides(points: &[DVec2], corners: &[DVec2; 4]) -> [Vec<DVec2>; 4] {
    let mut sides = [const { Vec::new() }; 4];
    for &p in points {
        let off = |i: usize| {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            p.distance(a.lerp(b, along))
        };
        let nearest = (0..4).min_by(|&i, &j| off(i).total_cmp(&off(j))).unwrap_or(0);
        if corners.iter().all(|corner| corner.distance(p) > CORNER) {
            sides[nearest].push(p);
        }
    }
    sides
}

/// The line normal . p = offset, with a unit normal.
struct Line {
    normal: DVec2,
    offset: f64,
}

impl Line {
    /// Total least squares fit.
    fn fit(points: &[DVec2]) -> Self {
        let middle = points.iter().sum::<DVec2>() / points.len().max(1) as f64;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for d in points.iter().map(|p| *p - middle) {
            xx += d.x * d.x;
            xy += d.x * d.y;
            yy += d.y * d.y;
        }
        let normal = DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy)).perp();
        Self { normal, offset: normal.dot(middle) }
    }

    /// Fits repeatedly, removing points off by more than three robust standard deviations.
    fn fit_robustly(points: &mut Vec<DVec2>) -> Self {
        for _ in 0..3 {
            let line = Self::fit(points);
            let mut off: Vec<f64> = points.iter().map(|p| line.distance(*p)).collect();
            let limit = 3.0 * 1.4826 * median(&mut off) + 0.02;
            points.retain(|p| line.distance(*p) <= limit);
        }
        Self::fit(points)
    }

    fn distance(&self, p: DVec2) -> f64 {
        (self.normal.dot(p) - self.offset).abs()
    }

    fn intersection(&self, other: &Self) -> Option<DVec2> {
        let bottom = self.normal.perp_dot(other.normal);
        let p = DVec2::new(
            self.offset * other.normal.y - other.offset * self.normal.y,
            self.normal.x * other.offset - other.normal.x * self.offset,
        );
        (bottom.abs() > 1e-6).then(|| p / bottom)
    }
}

/// Of the four rotations of the corners, the one in which the mark is dark.
fn orient(
    picture: &GreyImage<'_>,
    frame: &Frame,
    lens: &Lens,
    corners: [DVec2; 4],
    half: f64,
) -> Result<Homography, String> {
    let mut candidates = Vec::new();
    for turn in 0..4 {
        let turned = [0, 1, 2, 3].map(|i| corners[(i + turn) % 4]);
        let homography = Homography::from_square(-frame.outer, 1.0 + frame.outer, turned);
        let homography = homography.ok_or("the sides of the ring are not a convex quadrilateral")?;
        let dots = (0..25).map(|i| DVec2::new(f64::from(i % 5 - 2), f64::from(i / 5 - 2)) / 8.0);
        let values =
            dots.map(|d| picture.at(lens.distort(homography.apply(d * frame.mark - frame.middle())))).sum::<f64>();
        candidates.push((values / 25.0, homography));
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let contrast = 0.3 * (candidates[3].0 - candidates[0].0);
    if candidates[0].0 > half || candidates[1].0 - candidates[0].0 < contrast.max(1e-6) {
        return Err("the black mark in a corner of the ring was not found".into());
    }
    Ok(candidates[0].1)
}
