//! Plies and loose fibres as tubes.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::super::Solid;
use super::axes;
use crate::random::{Stream, hash};

/// Numbers of higher and lower ridges around a ply.
const RIDGES: [f32; 2] = [10.0, 15.0];

/// Turns of fibres around a ply per tile are multiples of this fraction, so that all ridges meet again.
pub(super) const FIBRE_STEPS: f32 = 5.0;

/// Height of the ridges of fibres, relative to the radius of a ply.
const RIDGE: f32 = 0.06;

/// Sides and rings of a loose fibre.
const LOOSE: [usize; 2] = [4, 14];

/// A ply. Lengths are in spacings of the yarns, and positions along it count crossings from the edge of the tile.
pub(super) struct Ply<'a> {
    pub warp: bool,
    /// Position of the axis across the yarn.
    pub place: f32,
    /// Yarns per side of the tile.
    pub count: i32,
    /// The level of the yarn at each crossing, 1 or -1.
    pub levels: &'a Vec<f32>,
    /// Height of the upper level.
    pub lift: f32,
    /// Radius of the helix.
    pub helix: f32,
    /// Radius of the ply.
    pub radius: f32,
    pub flatness: f32,
    /// Turns at the edge of the tile.
    pub phase: f32,
    /// Turns around the yarn per tile.
    pub turns: f32,
    /// Turns of the fibres around the ply per tile.
    pub fibre_turns: f32,
    pub colour: Vec3,
    pub seed: u64,
}

/// A tube: rings of points, the last of which has the positions of the first one tile further if it is a ply.
pub(super) struct Tube {
    /// Points per ring; the last one repeats the first.
    around: usize,
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    albedo: Vec<Vec3>,
}

impl Ply<'_> {
    /// The axis of the yarn at `s`, and the unit vector upwards from it; both with (along, z).
    fn axis(&self, s: f32) -> [Vec2; 2] {
        let q = s - 0.5;
        let (j, t) = (q.floor(), q - q.floor());
        let level = |j: i32| self.levels[j.rem_euclid(self.count) as usize];
        let (low, high) = (level(j as i32), level(j as i32 + 1));
        let z = self.lift * (low + (high - low) * (0.5 - 0.5 * (PI * t).cos()));
        let slope = self.lift * (high - low) * 0.5 * PI * (PI * t).sin();
        [Vec2::new(s, z), Vec2::new(-slope, 1.0).normalize()]
    }

    /// A sum of waves that repeat with the tile, within -1..1.
    fn wave(&self, s: f32, salt: u64) -> f32 {
        let mut random = Stream::new(hash(&[self.seed, salt]));
        let wave = |k: usize, random: &mut Stream| {
            (TAU * (s / self.count as f32 * (k * k + 2 * k + 1) as f32 + random.next())).sin() / (k + 1) as f32
        };
        (0..4).map(|k| wave(k, &mut random)).sum::<f32>() / 2.1
    }

    /// The point at `s` and the angle `beta` around the ply, at `reach` radii from its axis.
    fn point(&self, s: f32, beta: f32, reach: f32) -> Vec3 {
        let [axis, up] = self.axis(s);
        let turn = TAU * (self.turns * s / self.count as f32 + self.phase);
        let radius = self.radius * (1.0 + 0.05 * self.wave(s, 1));
        let across = self.helix * turn.cos() + radius * reach * beta.cos();
        let rise = self.flatness * (self.helix * turn.sin() + radius * reach * beta.sin());
        let sway = 0.02 * self.wave(s, 2);
        let [along, sideways] = axes(self.warp);
        let flat = along * (axis.x + up.x * rise) + sideways * (self.place + sway + across);
        flat.extend(axis.y + up.y * rise) / self.count as f32
    }

    /// The turns of a point around the ply, counted from the fibre that begins at angle 0.
    fn fibre(&self, s: f32, beta: f32) -> f32 {
        beta / TAU - self.fibre_turns * s / self.count as f32
    }

    /// Height of the ridges above the mean, within -1..1.
    fn ridge(&self, fibre: f32) -> f32 {
        0.7 * (TAU * RIDGES[0] * fibre).cos() + 0.3 * (TAU * (RIDGES[1] * fibre + 0.3)).cos()
    }

    /// The surface, with `points` around it and half as many rings per spacing.
    pub(super) fn tube(&self, points: usize) -> Tube {
        let rings = points.div_ceil(2) * self.count as usize;
        let place = |ring: usize, k: usize| {
            (ring as f32 / rings as f32 * self.count as f32, TAU * (k % points) as f32 / points as f32)
        };
        let position = |ring: usize, k: usize| {
            let (s, beta) = place(ring % rings, k);
            let end = axes(self.warp)[0] * (ring / rings) as f32;
            self.point(s, beta, 1.0 + RIDGE * self.ridge(self.fibre(s, beta))) + end.extend(0.0)
        };
        let mut tube = Tube::new(points + 1);
        for ring in 0..=rings {
            for k in 0..=points {
                let (s, beta) = place(ring, k);
                // central differences, on rings that continue beyond the ends
                let around = position(ring, k + 1) - position(ring, k + points - 1);
                let end = axes(self.warp)[0].extend(0.0);
                let along = position(ring + 1, k) - (position(ring + rings - 1, k) - end);
                let outward = position(ring, k) - self.point(s, beta, 0.0);
                let normal = around.cross(along).normalize_or(Vec3::Z);
                let fibre = self.fibre(s, if k == points { TAU } else { beta });
                let shade = 0.84 + 0.12 * self.ridge(fibre) + 0.08 * self.wave(s, 3) + 0.16 * self.streak(fibre, s);
                tube.positions.push(position(ring, k));
                tube.normals.push(normal * 1f32.copysign(normal.dot(outward)));
                tube.uvs.push(Vec2::new(s / self.count as f32, fibre));
                tube.albedo.push((self.colour * shade).clamp(Vec3::ZERO, Vec3::ONE));
            }
        }
        tube
    }

    /// A shade of its own for every fibre, within -1..1, which varies along it.
    fn streak(&self, fibre: f32, s: f32) -> f32 {
        let bins = 4.0 * RIDGES[0];
        let bin = (fibre - fibre.floor()) * bins;
        let shade = |k: f32| {
            let mut random = Stream::new(hash(&[self.seed, 11, k.rem_euclid(bins) as u64]));
            let (own, phase, waves) = (random.range(-1.0, 1.0), random.next(), 1.0 + (random.next() * 5.0).floor());
            0.7 * own + 0.3 * (TAU * (waves * s / self.count as f32 + phase)).sin()
        };
        let t = bin - bin.floor();
        shade(bin.floor()) * (1.0 - t) + shade(bin.floor() + 1.0) * t
    }

    /// A fibre that leaves the ply, bends outwards and ends in the air or on the cloth.
    pub(super) fn loose_fibre(&self, random: &mut Stream) -> Tube {
        let (s, beta) = (random.range(0.0, self.count as f32), random.range(0.0, TAU));
        let start = self.point(s, beta, 0.9);
        let outward = (self.point(s, beta, 1.0) - self.point(s, beta, 0.0)).normalize_or(Vec3::Z);
        let ahead = (self.point(s + 0.05, beta, 1.0) - self.point(s, beta, 1.0)).normalize_or(Vec3::X);
        let sense = if random.next() < 0.5 { -1.0 } else { 1.0 };
        let aside = outward.cross(ahead) * random.range(-0.6, 0.6);
        let unit = 1.0 / self.count as f32;
        let (length, height) = (unit * random.range(0.3, 1.0), unit * random.range(0.04, 0.22));
        let (end, radius) = (random.range(-0.4, 0.8), 0.009 * unit);
        let path = |t: f32| {
            let rise = height * (2.0 * t * (1.0 - t) + end * t * t);
            start + (ahead * sense + aside * (t + (2.5 * t).sin())) * (length * t) + outward * rise
        };
        let [sides, rings] = LOOSE;
        let mut tube = Tube::new(sides + 1);
        for ring in 0..=rings {
            let t = ring as f32 / rings as f32;
            let along = (path(t + 0.01) - path(t - 0.01)).normalize_or(Vec3::X);
            let (x, y) = along.any_orthonormal_pair();
            for k in 0..=sides {
                let (sin, cos) = (TAU * (k % sides) as f32 / sides as f32).sin_cos();
                let normal = x * cos + y * sin;
                // fibres taper towards their ends
                tube.positions.push(path(t) + normal * (radius * (1.05 - t * t).sqrt()));
                tube.normals.push(normal);
                tube.uvs.push(Vec2::new(t, k as f32 / sides as f32));
                tube.albedo.push(self.colour);
            }
        }
        tube
    }
}

impl Tube {
    fn new(around: usize) -> Self {
        Self { around, positions: Vec::new(), normals: Vec::new(), uvs: Vec::new(), albedo: Vec::new() }
    }

    /// Appends the tube, as triangles.
    pub(super) fn append_to(self, solid: &mut Solid) {
        let first = solid.positions.len();
        let rings = self.positions.len() / self.around;
        for ring in 1..rings {
            for k in 1..self.around {
                let at = |ring: usize, k: usize| (first + ring * self.around + k) as u32;
                let [a, b, c, d] = [at(ring - 1, k - 1), at(ring - 1, k), at(ring, k), at(ring, k - 1)];
                solid.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        solid.positions.extend(self.positions);
        solid.normals.extend(self.normals);
        solid.uvs.extend(self.uvs);
        solid.albedo.extend(self.albedo);
    }
}
