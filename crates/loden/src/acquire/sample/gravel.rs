//! Gravel: a bed of pebbles.

use glam::{Mat2, Vec2, Vec3};

use super::noise::octaves;
use super::{Sample, srgb};
use crate::Result;
use crate::acquire::field::{Finish, HeightField};
use crate::params::{Param, Params, Values};
use crate::random::{Stream, hash};

crate::params! {
    struct Options {
        /// Large pebbles along one side of the tile.
        pebbles: i32 [4..=40] = 9,
        /// Factor on all heights.
        relief: f32 [0.0..=2.0] = 1,
        /// From dry and matt to wet, dark and glossy.
        wetness: f32 [0.0..=1.0] = 0.15,
    }
}

/// # Model
/// Three layers of rounded pebbles, the smallest at the bottom, lie on sand and overlap at random; the highest point is
/// visible. Each pebble has its own kind of stone, with a mottled albedo and sometimes a vein.
pub(super) struct Gravel;

struct Pebble {
    middle: Vec2,
    /// Maps the plane to the unit disk of the pebble.
    shape: Mat2,
    base: f32,
    thickness: f32,
    albedo: Vec3,
    vein: Option<Vec2>,
    speckle: f32,
    seed: u64,
}

fn stones() -> [(f32, Vec3); 7] {
    [
        (0.26, srgb(128, 124, 118)),
        (0.16, srgb(92, 92, 96)),
        (0.20, srgb(176, 160, 134)),
        (0.12, srgb(152, 112, 86)),
        (0.08, srgb(54, 54, 58)),
        (0.10, srgb(224, 220, 210)),
        (0.08, srgb(140, 82, 66)),
    ]
}

impl Pebble {
    /// A random pebble about `radius` wide, with its base around `level`.
    fn new(random: &mut Stream, radius: f32, level: f32, middle: Vec2) -> Self {
        let mut pick = random.next();
        let stones = stones();
        let stone = stones.iter().find(|(share, _)| {
            pick -= share;
            pick < 0.0
        });
        let albedo = stone.unwrap_or(&stones[0]).1 * random.range(0.8, 1.2);
        let r = radius * random.range(0.75, 1.25);
        let flat = random.range(0.62, 0.98);
        let turn = Mat2::from_angle(random.range(0.0, std::f32::consts::TAU));
        let shape = Mat2::from_diagonal(Vec2::new(1.0 / r, 1.0 / (r * flat))) * turn;
        let vein = (random.next() < 0.18).then(|| Vec2::from_angle(random.range(0.0, 6.3)));
        Self {
            middle,
            shape,
            base: level + random.range(-0.3, 0.3) * radius,
            thickness: r * random.range(0.5, 0.8),
            albedo,
            vein,
            speckle: random.range(0.05, 0.35),
            seed: (random.next() * 1e6) as u64,
        }
    }

    /// Height and albedo at `p`, if the pebble covers it.
    fn at(&self, p: Vec2) -> Option<(f32, Vec3)> {
        let away = p - self.middle;
        let away = away - away.round();
        let bump = octaves(p, [14, 14], 3, self.seed);
        let q = self.shape * away * (1.0 + 0.16 * bump);
        // a superellipse between disk and square
        let r = (q.x.abs().powf(2.3) + q.y.abs().powf(2.3)).powf(2.0 / 2.3);
        if r >= 1.0 {
            return None;
        }
        let grain = octaves(p, [120, 120], 2, self.seed ^ 5);
        let height = self.base + self.thickness * (1.0 - r).sqrt().powf(0.85) + 0.0012 * grain;
        let mottle = 1.0 + 0.22 * octaves(p, [40, 40], 2, self.seed ^ 2) + self.speckle * grain;
        let mut albedo = self.albedo * mottle;
        if let Some(direction) = self.vein {
            let across = (q.dot(direction) + 0.25 * bump).abs();
            albedo = albedo.lerp(Vec3::splat(0.62), (1.0 - across * 12.0).clamp(0.0, 1.0) * 0.8);
        }
        Some((height, albedo))
    }
}

/// Pebbles on a jittered lattice of `count` x `count` cells.
fn layer(count: i32, radius: f32, level: f32, seed: u64) -> Vec<Pebble> {
    let mut random = Stream::new(seed);
    let cells = (0..count).flat_map(|y| (0..count).map(move |x| Vec2::new(x as f32, y as f32)));
    cells
        .map(|cell| {
            let middle = (cell + random.next2() * 1.1) / count as f32;
            Pebble::new(&mut random, radius / count as f32, level, middle)
        })
        .collect()
}

/// For each cell of a coarse lattice, the pebbles that may cover it.
fn bins(pebbles: &[Pebble], side: i32) -> Vec<Vec<usize>> {
    let mut bins = vec![Vec::new(); (side * side) as usize];
    for (k, pebble) in pebbles.iter().enumerate() {
        // noise stretches the outline by up to a fifth
        let inverse = pebble.shape.inverse();
        let reach = (1.25 * 1.5 * inverse.x_axis.length().max(inverse.y_axis.length())).min(0.49);
        let low = ((pebble.middle - Vec2::splat(reach)) * side as f32).floor().as_ivec2();
        let high = ((pebble.middle + Vec2::splat(reach)) * side as f32).floor().as_ivec2();
        for (y, x) in (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| (y, x))) {
            let bin = &mut bins[(y.rem_euclid(side) * side + x.rem_euclid(side)) as usize];
            if bin.last() != Some(&k) {
                bin.push(k);
            }
        }
    }
    bins
}

impl Sample for Gravel {
    fn name(&self) -> &'static str {
        "gravel"
    }

    fn doc(&self) -> &'static str {
        "Overlapping pebbles of many stones with deep shadows between them."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn build(&self, values: &Values, grid: usize, seed: u64) -> Result<HeightField> {
        let Options { pebbles: count, relief, wetness: wet } = Options::from_values(values)?;
        let unit = 1.0 / count as f32;
        let mut pebbles = layer(3 * count, 0.75, 0.0, hash(&[seed, 1]));
        pebbles.extend(layer(2 * count, 0.75, 0.12 * unit, hash(&[seed, 2])));
        pebbles.extend(layer(count, 0.62, 0.22 * unit, hash(&[seed, 3])));
        let side = 2 * count;
        let bins = bins(&pebbles, side);
        HeightField::from_fn(grid, |u, v| {
            let p = Vec2::new(u, v);
            let bin = &bins[(v * side as f32) as usize * side as usize + (u * side as f32) as usize];
            let sand = octaves(p, [100, 100], 2, seed ^ 9);
            let ground = (-0.15 * unit + 0.04 * unit * sand, srgb(150, 132, 104) * (0.75 + 0.3 * sand));
            let cover = bin.iter().filter_map(|&k| pebbles[k].at(p));
            let (height, albedo) = cover.fold(ground, |a, b| if b.0 > a.0 { b } else { a });
            let albedo = (albedo * (1.0 - 0.4 * wet)).clamp(Vec3::ZERO, Vec3::splat(0.95));
            (height * relief, Finish::coated(albedo, 0.04, 0.65 - 0.5 * wet))
        })
    }
}
