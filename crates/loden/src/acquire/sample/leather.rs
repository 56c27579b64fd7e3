//! Grained leather.

use glam::{Vec2, Vec3};

use super::noise::{cellular, gradient, octaves};
use super::{Sample, smoothstep, srgb};
use crate::Result;
use crate::acquire::field::{Finish, HeightField};
use crate::params::{Param, Params, Values};
use crate::random::{Stream, hash};

crate::words! {
    enum Dye { Brown = "brown", Black = "black", Red = "red" }
}

crate::params! {
    struct Options {
        /// Grains per side of the tile.
        cells: i32 [4..=64] = 13,
        /// Colour of the dye.
        color: Dye = "brown",
        /// Factor on the depth of the creases.
        relief: f32 [0.0..=3.0] = 1,
        /// GGX alpha of the finish.
        roughness: f32 [0.05..=1.0] = 0.32,
    }
}

/// # Model
/// Rounded cells of two sizes, distorted by noise, with creases between them, fine wrinkles and scattered pores. Dye
/// collects in the creases; the tops are polished and slightly smoother.
pub(super) struct Leather;

/// A rounded profile, from 0 at a crease to 1 on top.
fn pillow(t: f32) -> f32 {
    let t = 1.0 - t.clamp(0.0, 1.0);
    1.0 - t * t * t.sqrt()
}

/// Height of the grain in units of the grain spacing, and how deep in a crease the point is (0..1).
fn grain(p: Vec2, cells: i32, seed: u64) -> (f32, f32) {
    let bend = |k: u64| octaves(p, [cells / 2, cells / 2], 3, seed ^ k);
    let q = p + Vec2::new(bend(11), bend(12)) * (0.45 / cells as f32);
    let coarse = cellular(q, cells, 0.95, seed);
    let fine = cellular(q, 2 * cells, 0.95, seed ^ 1);
    let depth = Stream::new(coarse.id).range(0.7, 1.0);
    let dome = pillow(coarse.border / 0.42);
    let small = pillow(fine.border / 0.34);
    let wrinkles = 1.0 - gradient(q, [cells * 4, cells * 4], seed ^ 2).abs();
    let swell = octaves(p, [3, 3], 2, seed ^ 3);
    let level = Stream::new(coarse.id ^ 9).range(-0.03, 0.03);
    let height =
        0.13 * depth * dome + 0.028 * small * dome + level * dome - 0.012 * wrinkles.powi(4) * dome + 0.10 * swell;
    (height, 1.0 - dome * (0.75 + 0.25 * small))
}

/// Depth of a pore: 1 at its centre.
fn pore(p: Vec2, cells: i32, seed: u64) -> f32 {
    let near = cellular(p, 3 * cells, 1.0, seed ^ 4);
    let size = Stream::new(near.id).range(-0.12, 0.17);
    if size <= 0.04 { 0.0 } else { 1.0 - smoothstep(0.4 * size, size, near.first) }
}

impl Sample for Leather {
    fn name(&self) -> &'static str {
        "leather"
    }

    fn doc(&self) -> &'static str {
        "Grained leather with creases, pores and a mild gloss."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn build(&self, values: &Values, grid: usize, seed: u64) -> Result<HeightField> {
        let Options { cells, color, relief, roughness } = Options::from_values(values)?;
        let relief = relief / cells as f32;
        let color = match color {
            Dye::Brown => srgb(142, 86, 50),
            Dye::Black => srgb(42, 40, 40),
            Dye::Red => srgb(140, 28, 26),
        };
        let seed = hash(&[seed, 0x1ea]);
        HeightField::from_fn(grid, |u, v| {
            let p = Vec2::new(u, v);
            let (height, crease) = grain(p, cells, seed);
            let pore = pore(p, cells, seed);
            let mottle = 1.0 + 0.14 * octaves(p, [5, 5], 3, seed ^ 6) + 0.08 * gradient(p, [cells * 5; 2], seed ^ 7);
            let dye = mottle * (1.0 - 0.55 * crease) * (1.0 - 0.4 * pore);
            let albedo = (color * dye).clamp(Vec3::ZERO, Vec3::splat(0.9));
            let finish = Finish::coated(albedo, 0.045, (roughness * (1.0 + 0.5 * crease)).min(1.0));
            ((height - 0.05 * pore) * relief, finish)
        })
    }
}
