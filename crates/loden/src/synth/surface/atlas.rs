//! Every triangle in a picture, turned so that its direction points right, and ways over the surface from one to the next.

use glam::{DMat2, DVec2};

use super::field::Field;
use super::mesh::Mesh;
use crate::{Error, Result};

/// Texels around a triangle that are filled, so that interpolation does not leave it.
const GUTTER: f64 = 2.0;

/// Triangles in a picture. Coordinates of charts are in texels, rows go down.
pub(super) struct Atlas {
    pub width: usize,
    pub height: usize,
    pub charts: Vec<Chart>,
}

/// A triangle in the picture.
pub(super) struct Chart {
    /// The corners, within the chart.
    pub corners: [DVec2; 3],
    /// Where the chart is in the picture, and its size.
    pub place: [usize; 2],
    pub size: [usize; 2],
    /// Beyond each edge the triangle there, and the motion of this chart's coordinates to its.
    pub across: [Option<(usize, Motion)>; 3],
}

/// A rotation and a displacement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion {
    turn: DMat2,
    shift: DVec2,
}

impl Motion {
    fn apply(&self, point: DVec2) -> DVec2 {
        self.turn * point + self.shift
    }
}

/// Where a way over the surface ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct End {
    pub triangle: usize,
    pub point: DVec2,
    /// How directions of the first chart turn into the last.
    pub turn: DMat2,
}

impl Atlas {
    /// A picture of `side` x `side` texels with texels as small as fit.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the picture is too small for so many triangles.
    pub(super) fn new(mesh: &Mesh, field: &Field, side: usize) -> Result<Self> {
        let area: f64 = (0..mesh.triangles.len()).map(|triangle| mesh.area(triangle)).sum();
        // Texels per unit of length: halve the interval between what fits and what does not
        let (mut low, mut high) = (0.0, side as f64 / area.sqrt());
        let mut best = None;
        for _ in 0..16 {
            let middle = 0.5 * (low + high);
            match places(mesh, field, middle, side) {
                Some(found) => (low, best) = (middle, Some((middle, found))),
                None => high = middle,
            }
        }
        let Some((scale, places)) = best else {
            let problem = format!("{side} x {side} texels are too few for {} triangles", mesh.triangles.len());
            return Err(Error::parameter("size", problem));
        };
        let mut charts: Vec<Chart> = (0..mesh.triangles.len())
            .map(|triangle| {
                let (corners, size) = chart(mesh, field, triangle, scale);
                Chart { corners, place: places[triangle], size, across: [None; 3] }
            })
            .collect();
        for triangle in 0..charts.len() {
            for edge in 0..3 {
                let Some((other, back)) = mesh.across[triangle][edge] else { continue };
                let ends = |chart: &Chart, k: usize| [chart.corners[k], chart.corners[(k + 1) % 3]];
                let ([a, b], [d, c]) = (ends(&charts[triangle], edge), ends(&charts[other], back));
                let (from, to) = ((b - a).normalize(), (d - c).normalize());
                let turn = DMat2::from_cols_array(&[from.dot(to), from.perp_dot(to), -from.perp_dot(to), from.dot(to)]);
                charts[triangle].across[edge] = Some((other, Motion { turn, shift: c - turn * a }));
            }
        }
        Ok(Self { width: side, height: side, charts })
    }

    /// The straight way from a point inside a triangle; none if it leaves the surface.
    pub(super) fn walk(&self, triangle: usize, from: DVec2, by: DVec2) -> Option<End> {
        const CROSSINGS: usize = 200;
        let mut end = End { triangle, point: from + by, turn: DMat2::IDENTITY };
        let (mut from, mut entered) = (from, None);
        for _ in 0..CROSSINGS {
            let chart = &self.charts[end.triangle];
            let leaves = |edge: usize| {
                let (a, b) = (chart.corners[edge], chart.corners[(edge + 1) % 3]);
                // rows go down, so triangles turn the other way
                let inside = |point: DVec2| -(b - a).perp_dot(point - a);
                let (begin, stop) = (inside(from).max(0.0), inside(end.point));
                (stop < -1e-9 && entered != Some(edge)).then(|| (begin / (begin - stop), edge))
            };
            let first = (0..3).filter_map(leaves).min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((share, edge)) = first else { return Some(end) };
            let (other, motion) = chart.across[edge]?;
            from = motion.apply(from + share * (end.point - from));
            let back = |k: &usize| self.charts[other].across[*k].is_some_and(|(t, _)| t == end.triangle);
            entered = (0..3).filter(back).min_by(|a, b| {
                let off = |k: usize| {
                    let chart = &self.charts[other];
                    (chart.corners[(k + 1) % 3] - chart.corners[k]).normalize().perp_dot(from - chart.corners[k]).abs()
                };
                off(*a).total_cmp(&off(*b))
            });
            end = End { triangle: other, point: motion.apply(end.point), turn: motion.turn * end.turn };
        }
        None
    }

    /// The texel of the picture at a point of a chart; none outside of the chart.
    pub(super) fn texel(&self, triangle: usize, point: DVec2) -> Option<usize> {
        let chart = &self.charts[triangle];
        let [x, y] = [point.x.floor(), point.y.floor()];
        let inside = x >= 0.0 && y >= 0.0 && x < chart.size[0] as f64 && y < chart.size[1] as f64;
        inside.then(|| (chart.place[1] + y as usize) * self.width + chart.place[0] + x as usize)
    }
}

impl Chart {
    /// Whether a point is inside of the triangle.
    pub(super) fn contains(&self, point: DVec2) -> bool {
        (0..3).all(|k| -(self.corners[(k + 1) % 3] - self.corners[k]).perp_dot(point - self.corners[k]) >= -1e-9)
    }

    pub(super) fn centre(&self) -> DVec2 {
        (self.corners[0] + self.corners[1] + self.corners[2]) / 3.0
    }
}

/// The corners of a triangle in its chart, whose size is that of the triangle with a gutter around it.
fn chart(mesh: &Mesh, field: &Field, triangle: usize, scale: f64) -> ([DVec2; 3], [usize; 2]) {
    let right = DVec2::from_angle(field.0[triangle]) * scale;
    let corners = mesh.flat(triangle).map(|p| DVec2::new(p.dot(right), p.perp_dot(right)));
    let low = corners[0].min(corners[1]).min(corners[2]) - GUTTER;
    let corners = corners.map(|p| p - low);
    let high = corners[0].max(corners[1]).max(corners[2]) + GUTTER;
    (corners, [high.x.ceil() as usize, high.y.ceil() as usize])
}

/// Where charts lie in a picture: in rows, the highest first; none if there is not enough room.
fn places(mesh: &Mesh, field: &Field, scale: f64, side: usize) -> Option<Vec<[usize; 2]>> {
    let sizes: Vec<[usize; 2]> =
        (0..mesh.triangles.len()).map(|triangle| chart(mesh, field, triangle, scale).1).collect();
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|chart| (std::cmp::Reverse(sizes[*chart][1]), *chart));
    let mut places = vec![[0; 2]; sizes.len()];
    let (mut x, mut y, mut high) = (0, 0, 0);
    for chart in order {
        let [width, height] = sizes[chart];
        if width > side {
            return None;
        }
        if x + width > side {
            (x, y, high) = (0, y + high, 0);
        }
        if y + height > side {
            return None;
        }
        places[chart] = [x, y];
        (x, high) = (x + width, high.max(height));
    }
    Some(places)
}
