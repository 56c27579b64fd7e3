//! The texels of a surface, and what lies around each of them.

use glam::DVec2;
use rayon::prelude::*;

use super::atlas::Atlas;

/// No texel of the surface.
const NONE: u32 = u32::MAX;

/// Texels whose centres are inside of their triangles: together they cover the surface once.
pub(super) struct Points {
    pub points: Vec<Point>,
    /// For each texel of the picture the point that it shows; [`NONE`] between charts.
    shown: Vec<u32>,
}

/// A texel of the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub triangle: usize,
    /// Its centre in the chart.
    pub at: DVec2,
}

/// A point near another one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Neighbour {
    pub point: u32,
    /// The way back in its own chart, in texels.
    pub back: [i16; 2],
}

impl Points {
    pub(super) fn new(atlas: &Atlas) -> Self {
        let mut points = Vec::new();
        let mut shown = vec![NONE; atlas.width * atlas.height];
        for (triangle, chart) in atlas.charts.iter().enumerate() {
            for at in centres(chart.size) {
                if let Some(texel) = atlas.texel(triangle, at).filter(|_| chart.contains(at)) {
                    shown[texel] = points.len() as u32;
                    points.push(Point { triangle, at });
                }
            }
        }
        let mut all = Self { points, shown };
        all.fill_gutters(atlas);
        all
    }

    /// Around triangles, texels show the points that lie there on the surface.
    fn fill_gutters(&mut self, atlas: &Atlas) {
        let first = self.of_triangles(atlas.charts.len());
        let found: Vec<Vec<(usize, u32)>> = (0..atlas.charts.len())
            .into_par_iter()
            .map(|triangle| {
                let chart = &atlas.charts[triangle];
                let gutter = centres(chart.size).filter(|at| !chart.contains(*at));
                let show = |at: DVec2| {
                    let end = atlas.walk(triangle, chart.centre(), at - chart.centre());
                    let beyond = end.and_then(|end| self.nearest(atlas, end.triangle, end.point));
                    let shown = beyond.or_else(|| self.nearest_of(&first, atlas, triangle, at))?;
                    Some((atlas.texel(triangle, at)?, shown))
                };
                gutter.filter_map(show).collect()
            })
            .collect();
        found.into_iter().flatten().for_each(|(texel, point)| self.shown[texel] = point);
    }

    /// The first point of each triangle, and one more number for the end.
    fn of_triangles(&self, triangles: usize) -> Vec<usize> {
        let mut first = vec![0; triangles + 1];
        self.points.iter().for_each(|point| first[point.triangle + 1] += 1);
        (0..triangles).for_each(|triangle| first[triangle + 1] += first[triangle]);
        first
    }

    /// The point nearest to a place of a chart, in the triangle or in the nearest one that has points.
    fn nearest_of(&self, first: &[usize], atlas: &Atlas, triangle: usize, at: DVec2) -> Option<u32> {
        let mut seen = vec![triangle];
        let mut next = 0;
        while next < seen.len() {
            let here = seen[next];
            let points = first[here]..first[here + 1];
            if !points.is_empty() {
                // beyond the triangle itself, distances within the chart say little
                let middle = if here == triangle { at } else { atlas.charts[here].centre() };
                let distance = |point: &usize| (self.points[*point].at - middle).length_squared();
                return points.min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|point| point as u32);
            }
            for (other, _) in atlas.charts[here].across.iter().flatten() {
                if !seen.contains(other) {
                    seen.push(*other);
                }
            }
            next += 1;
        }
        None
    }

    /// The point at a place of a chart, or beside it.
    fn nearest(&self, atlas: &Atlas, triangle: usize, at: DVec2) -> Option<u32> {
        let around = (0..9).map(|k| at + DVec2::new(f64::from(k % 3 - 1), f64::from(k / 3 - 1)));
        let shown = |place: DVec2| {
            let point = self.shown[atlas.texel(triangle, place)?];
            (point != NONE && self.points[point as usize].triangle == triangle).then_some(point)
        };
        let distance = |point: &u32| (self.points[*point as usize].at - at).length_squared();
        shown(at).or_else(|| around.filter_map(shown).min_by(|a, b| distance(a).total_cmp(&distance(b))))
    }

    /// The point at a displacement, in texels; none beyond the edge of the surface.
    pub(super) fn at(&self, atlas: &Atlas, point: usize, by: DVec2) -> Option<Neighbour> {
        let Point { triangle, at } = self.points[point];
        let end = atlas.walk(triangle, at, by)?;
        let shown = self.nearest(atlas, end.triangle, end.point).or_else(|| {
            let shown = self.shown[atlas.texel(end.triangle, end.point)?];
            (shown != NONE).then_some(shown)
        })?;
        let back = end.turn * -by;
        Some(Neighbour { point: shown, back: [back.x.round() as i16, back.y.round() as i16] })
    }

    /// For each texel of the picture the point that it shows.
    pub(super) fn shown(&self) -> impl Iterator<Item = Option<usize>> + '_ {
        self.shown.iter().map(|point| (*point != NONE).then_some(*point as usize))
    }
}

/// The centres of the texels of a chart.
fn centres([width, height]: [usize; 2]) -> impl Iterator<Item = DVec2> {
    (0..width * height).map(move |i| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5))
}
