//! A solid prepared for measurement: a hierarchy of its triangles, with neighbours where the tile repeats.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{Coat, Solid};
use crate::acquire::reflect::{Fibrous, Lights, Reflector};
use crate::acquire::specimen::Geometry;
use crate::direction::DirectionSet;
use crate::render::bvh::{Bundle, Bvh, Intersection, RAYS, Ray, lanes};

/// Offset of the origins of rays from a surface, relative to the coordinates.
const OFFSET: f32 = 32.0 * f32::EPSILON;

/// Longest ray, in periods: a nearly horizontal ray that hits nothing for this long has escaped.
const REACH: f32 = 16.0;

/// Most of a period that is copied beyond each edge of a tile.
const MARGIN: f32 = 0.5;

/// # Model
/// The triangles that overlap a square somewhat larger than the tile are copied into it. A ray that leaves this square
/// between the lowest and the highest point continues on the opposite side, at the same place of the tile, so that
/// periodicity is exact.
pub(in crate::acquire) struct Tile<'a> {
    solid: &'a Solid,
    bvh: Bvh,
    /// The triangle of which each triangle of the hierarchy is a copy, and by how many periods it is moved.
    copies: Vec<(u32, [i16; 2])>,
    /// How far the square extends beyond the tile; infinite if the tile does not repeat.
    margin: f32,
    lowest: f32,
    highest: f32,
    /// Height of the plane of the texels.
    reference: f32,
    lights: Vec<Vec3>,
}

/// A point of a triangle, in or near the tile.
#[derive(Debug, Clone, Copy)]
pub(in crate::acquire) struct Point {
    at: Vec3,
    /// Unit normal of the triangle.
    geometric: Vec3,
    /// Unit normal that light is reflected about, on either side.
    normal: Vec3,
    /// Along dP/du, of any length.
    tangent: Vec3,
    albedo: Vec3,
    coat: Coat,
}

impl<'a> Tile<'a> {
    /// Prepares a solid that was checked.
    pub(in crate::acquire) fn new(solid: &'a Solid, lights: &DirectionSet) -> Self {
        let [lowest, highest] = solid.heights();
        let margin = if solid.periodic { (2.0 * (highest - lowest)).clamp(0.01, MARGIN) } else { f32::INFINITY };
        let copies = copies(solid, margin);
        let corner = |&(triangle, shift): &(u32, [i16; 2])| corners(solid, triangle, shift);
        let bvh = Bvh::new(&copies.par_iter().map(corner).collect::<Vec<_>>());
        // rays begin and end beyond all triangles
        let slack = 1e-3 * (highest - lowest).max(1e-3);
        let (lowest, highest) = (lowest - slack, highest + slack);
        let lights = lights.directions().to_vec();
        let mut tile = Self { solid, bvh, copies, margin, lowest, highest, reference: 0.0, lights };
        tile.reference = tile.mean_height();
        tile
    }

    /// The mean height of what is seen from above; of the lowest and the highest point if that is nothing.
    fn mean_height(&self) -> f32 {
        const SIDE: usize = 128;
        let height = |k: usize| {
            let at = Vec2::new((k % SIDE) as f32 + 0.5, (k / SIDE) as f32 + 0.5) / SIDE as f32;
            Some(f64::from(self.trace(at.extend(self.highest), Vec3::NEG_Z)?.at.z))
        };
        let seen: Vec<f64> = (0..SIDE * SIDE).into_par_iter().filter_map(height).collect();
        match seen.len() {
            0 => 0.5 * (self.lowest + self.highest),
            count => (seen.iter().sum::<f64>() / count as f64) as f32,
        }
    }

    /// The distance at which a ray leaves the square, and that at which it leaves the heights of the triangles.
    #[inline]
    fn exits(&self, o: Vec3, d: Vec3) -> [f32; 2] {
        let exit = |o: f32, d: f32, low: f32, high: f32| match d {
            _ if d > 0.0 => (high - o) / d,
            _ if d < 0.0 => (low - o) / d,
            _ => f32::INFINITY,
        };
        let (low, high) = (-self.margin, 1.0 + self.margin);
        let side = exit(o.x, d.x, low, high).min(exit(o.y, d.y, low, high)).max(0.0);
        [side, exit(o.z, d.z, self.lowest, self.highest).max(0.0)]
    }

    /// The position in the tile that is the same as `p`.
    #[inline]
    fn wrapped(&self, p: Vec3) -> Vec3 {
        if self.solid.periodic { (p.truncate() - p.truncate().floor()).extend(p.z) } else { p }
    }

    /// The first point that a ray hits.
    fn trace(&self, o: Vec3, d: Vec3) -> Option<Point> {
        let (mut o, mut travelled) = (self.wrapped(o), 0.0);
        loop {
            let [side, end] = self.exits(o, d);
            if let Some(hit) = self.bvh.closest(&Ray { origin: o, direction: d }, side.min(end)) {
                return Some(self.point(&hit));
            }
            travelled += side;
            if end <= side || travelled > REACH {
                return None;
            }
            o = self.wrapped(o + side * d);
        }
    }

    /// Whether a ray hits anything.
    fn is_blocked(&self, o: Vec3, d: Vec3) -> bool {
        let (mut o, mut travelled) = (self.wrapped(o), 0.0);
        loop {
            let [side, end] = self.exits(o, d);
            let mut bundle = Bundle::EMPTY;
            bundle.set(0, &Ray { origin: o, direction: d }, side.min(end));
            if self.bvh.occluded_of(&bundle) != 0 {
                return true;
            }
            travelled += side;
            if end <= side || travelled > REACH {
                return false;
            }
            o = self.wrapped(o + side * d);
        }
    }

    fn point(&self, hit: &Intersection) -> Point {
        let (triangle, shift) = self.copies[hit.triangle as usize];
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let solid = self.solid;
        let indices = solid.triangles[triangle as usize].map(|i| i as usize);
        let [a, b, c] = corners(solid, triangle, shift);
        let (ab, ac) = (b - a, c - a);
        let geometric = ab.cross(ac).normalize_or(Vec3::Z);
        let mean = |list: &[Vec3]| (0..3).map(|k| list[indices[k]] * weights[k]).sum::<Vec3>();
        let normal = if solid.normals.is_empty() { geometric } else { mean(&solid.normals).normalize_or(geometric) };
        let (mut uv, mut tangent) = (Vec2::ZERO, ab);
        if !solid.uvs.is_empty() {
            let [p, q, r] = indices.map(|i| solid.uvs[i]);
            uv = p * weights[0] + q * weights[1] + r * weights[2];
            // solve for dP/du; the sign of the determinant matters, its size does not
            let (pq, pr) = (q - p, r - p);
            tangent = (ab * pr.y - ac * pq.y) * pq.perp_dot(pr).signum();
        }
        let own = if solid.albedo.is_empty() { Vec3::ONE } else { mean(&solid.albedo) };
        let paint = &solid.paints[solid.painted.get(triangle as usize).map_or(0, |&k| usize::from(k))];
        let at = self.wrapped(a * weights[0] + b * weights[1] + c * weights[2]);
        Point { at, geometric, normal, tangent, albedo: own * paint.at(uv), coat: paint.coat }
    }

    /// The origin of a ray that leaves a point in the direction `d`: on that side of the triangle.
    #[inline]
    fn origin(&self, point: &Point, d: Vec3) -> Vec3 {
        let reach = OFFSET * (1.0 + point.at.abs().max_element());
        point.at + point.geometric * reach.copysign(point.geometric.dot(d))
    }
}

/// The triangles, moved by whole periods, that overlap the square around the tile.
fn copies(solid: &Solid, margin: f32) -> Vec<(u32, [i16; 2])> {
    let own = |triangle: usize| {
        let points = corners(solid, triangle as u32, [0, 0]).map(|p| p.truncate());
        let low = points.iter().copied().fold(Vec2::MAX, Vec2::min);
        let high = points.iter().copied().fold(Vec2::MIN, Vec2::max);
        let range = |low: f32, high: f32| match solid.periodic {
            true => (-margin - high).ceil() as i16..=(1.0 + margin - low).floor() as i16,
            false => 0..=0,
        };
        let columns = range(low.x, high.x);
        let rows = range(low.y, high.y);
        rows.flat_map(move |y| columns.clone().map(move |x| (triangle as u32, [x, y])))
    };
    (0..solid.triangles.len()).into_par_iter().flat_map_iter(own).collect()
}

fn corners(solid: &Solid, triangle: u32, [x, y]: [i16; 2]) -> [Vec3; 3] {
    let shift = Vec3::new(f32::from(x), f32::from(y), 0.0);
    solid.triangles[triangle as usize].map(|i| solid.positions[i as usize] + shift)
}

impl Geometry for Tile<'_> {
    type Point = Point;
    type Facets = Fibrous;

    fn side(&self) -> f32 {
        1.0
    }

    fn seen(&self, at: Vec2, wo: Vec3) -> Option<Point> {
        let start = at.extend(self.reference) + wo * ((self.highest - self.reference) / wo.z);
        self.trace(start.truncate().extend(self.highest), -wo)
    }

    fn reflector(&self, point: &Point, wo: Vec3) -> Reflector<Fibrous> {
        let normal = if point.normal.dot(wo) < 0.0 { -point.normal } else { point.normal };
        let facets = Fibrous::new(normal, point.tangent, point.coat.roughness);
        Reflector::with(normal, wo, [point.albedo, point.coat.f0], facets)
    }

    fn visibility(&self, point: &Point, normal: Vec3, _lights: &Lights, lit: &mut [f32]) {
        lit.fill(0.0);
        for (first, lights) in self.lights.chunks(RAYS).enumerate().map(|(k, lights)| (k * RAYS, lights)) {
            // Trace the lights that the surface faces together
            let mut bundle = Bundle::EMPTY;
            let (mut facing, mut beyond) = (0u16, 0u16);
            for (lane, &light) in lights.iter().enumerate().filter(|(_, light)| normal.dot(**light) > 0.0) {
                let origin = self.origin(point, light);
                let [side, end] = self.exits(origin, light);
                bundle.set(lane, &Ray { origin, direction: light }, side.min(end));
                facing |= 1 << lane;
                beyond |= u16::from(side < end) << lane;
            }
            if facing == 0 {
                continue;
            }
            // Follow those that leave the square
            for lane in lanes(facing & !self.bvh.occluded_of(&bundle)) {
                let continued = || {
                    let Ray { origin, direction } = bundle.ray(lane);
                    self.is_blocked(origin + direction * bundle.t_max.0[lane], direction)
                };
                let blocked = beyond >> lane & 1 != 0 && continued();
                lit[first + lane] = if blocked { 0.0 } else { 1.0 };
            }
        }
    }

    fn next(&self, point: &Point, wi: Vec3) -> Option<Point> {
        self.trace(self.origin(point, wi), wi)
    }
}
