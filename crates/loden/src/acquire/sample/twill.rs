//! Woven 2/2 twill of two yarns.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::noise::{gradient, octaves};
use super::{Sample, srgb};
use crate::acquire::field::{Finish, HeightField};
use crate::params::{Param, Params, Values};
use crate::random::{Stream, hash};
use crate::{Error, Result};

crate::words! {
    enum Colors { Ochre = "ochre", Denim = "denim", Grey = "grey" }
}

crate::params! {
    struct Options {
        /// Yarns per side of the tile, a multiple of 4.
        yarns: i32 [4..=64] = 12,
        /// Colours of warp and weft.
        colors: Colors = "ochre",
        /// Factor on the thickness of the cloth.
        relief: f32 [0.0..=2.0] = 1,
        /// Turns of the fibres per yarn spacing.
        twist: f32 [-4.0..=4.0] = 1,
    }
}

/// # Model
/// Warp yarns run along y, weft yarns along x. At crossing (i, j) the warp is on top if (i + j) mod 4 < 2. The axis of
/// a yarn swings between two levels, its cross-section is an ellipse, and the highest point is visible. Fibres wind
/// around each yarn as helices, which give it ridges and streaks.
pub(super) struct Twill;

/// Properties of all yarns of one direction.
struct Yarns<'a> {
    count: i32,
    twist: f32,
    color: Vec3,
    seed: u64,
    /// +1 for the warp, -1 for the weft.
    side: f32,
    /// Properties of each yarn.
    each: &'a [Yarn],
}

#[derive(Clone, Copy)]
struct Yarn {
    offset: f32,
    width: f32,
    shade: f32,
    phase: f32,
}

fn random_yarns(count: i32, seed: u64) -> Vec<Yarn> {
    let yarn = |k: i32| {
        let mut random = Stream::new(hash(&[seed, k as u64]));
        Yarn {
            offset: random.range(-0.04, 0.04),
            width: random.range(0.46, 0.5),
            shade: random.range(0.88, 1.12),
            phase: random.next(),
        }
    };
    (0..count).map(yarn).collect()
}

/// Height, in units of the yarn spacing, and colour of the surface of a yarn.
struct Fibre {
    height: f32,
    color: Vec3,
}

impl Yarns<'_> {
    /// The highest yarn at `across` and `along`, both in units of the yarn spacing.
    fn at(&self, across: f32, along: f32) -> Option<Fibre> {
        let middle = across.floor() as i32;
        let all = (middle - 1..=middle + 1).filter_map(|k| self.one(k, across, along));
        all.max_by(|a, b| a.height.total_cmp(&b.height))
    }

    fn one(&self, k: i32, across: f32, along: f32) -> Option<Fibre> {
        let yarn = self.each[k.rem_euclid(self.count) as usize];
        let p = Vec2::new(across, along) / self.count as f32;
        let sway = 0.05 * gradient(p, [self.count, self.count / 2], self.seed ^ 77);
        let x = (across - k as f32 - 0.5 - yarn.offset - sway) / yarn.width;
        if x.abs() >= 1.0 {
            return None;
        }
        // angle around the yarn: 0 on top, a quarter turn at either edge
        let angle = x.asin();
        let helix = TAU * (along * self.twist + yarn.phase) + 2.0 * angle;
        let ply = 0.5 + 0.5 * (3.0 * helix).cos();
        // stretch the noise in the direction of the helix so that it follows the fibres
        let along_fibre = Vec2::new(across + 0.32 * self.twist * along * yarn.width, along) / self.count as f32;
        let streak = octaves(along_fibre, [self.count * 14, self.count], 2, self.seed ^ 3);
        let fuzz = octaves(p, [self.count * 12; 2], 2, self.seed ^ 9);
        let round = (1.0 - x * x).sqrt();
        let height = self.axis(k, along) + 0.30 * round + round * (0.025 * ply + 0.05 * streak + 0.025 * fuzz);
        let shade = yarn.shade * (1.0 + 0.35 * streak + 0.15 * fuzz) * (0.8 + 0.2 * ply);
        Some(Fibre { height, color: (self.color * shade).clamp(Vec3::ZERO, Vec3::splat(0.95)) })
    }

    /// Level of the axis of yarn `k`, between -1/4 and 1/4.
    fn axis(&self, k: i32, along: f32) -> f32 {
        let level = |j: i32| if (k + j).rem_euclid(4) < 2 { self.side } else { -self.side };
        let q = along - 0.5;
        let (j, t) = (q.floor() as i32, q - q.floor());
        let blend = 0.5 - 0.5 * (PI * t).cos();
        0.25 * (level(j) + (level(j + 1) - level(j)) * blend)
    }
}

impl Sample for Twill {
    fn name(&self) -> &'static str {
        "twill"
    }

    fn doc(&self) -> &'static str {
        "Woven 2/2 twill of two coloured yarns with twisted fibres."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn build(&self, values: &Values, grid: usize, seed: u64) -> Result<HeightField> {
        let Options { yarns: count, colors, relief, twist } = Options::from_values(values)?;
        if count % 4 != 0 {
            return Err(Error::parameter("yarns", format!("found {count}, expected a multiple of 4")));
        }
        let (warp, weft) = match colors {
            Colors::Ochre => (srgb(196, 136, 46), srgb(108, 34, 30)),
            Colors::Denim => (srgb(48, 66, 110), srgb(206, 202, 190)),
            Colors::Grey => (srgb(70, 72, 78), srgb(168, 166, 160)),
        };
        let each = [1, 2].map(|k| random_yarns(count, hash(&[seed, k])));
        let yarns = |k: usize, color, side| Yarns {
            count,
            twist,
            color,
            seed: hash(&[seed, 8, k as u64]),
            side,
            each: &each[k],
        };
        let (warp, weft) = (yarns(0, warp, 1.0), yarns(1, weft, -1.0));
        let scale = relief / count as f32;
        HeightField::from_fn(grid, |u, v| {
            let (x, y) = (u * count as f32, v * count as f32);
            // gaps between yarns show the dark inside of the cloth
            let gap = Fibre { height: -0.3, color: Vec3::splat(0.03) };
            let all = [warp.at(x, y), weft.at(y, x), Some(gap)];
            let top = all.into_iter().flatten().max_by(|a, b| a.height.total_cmp(&b.height));
            let Fibre { height, color } = top.unwrap_or(Fibre { height: 0.0, color: Vec3::ZERO });
            (height * scale, Finish::coated(color, 0.03, 0.5))
        })
    }
}
