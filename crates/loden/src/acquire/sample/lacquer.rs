//! Brushed lacquer and metal.

use glam::{Vec2, Vec3};

use super::noise::{gradient, octaves};
use super::{Sample, srgb};
use crate::Result;
use crate::acquire::field::{Finish, HeightField};
use crate::params::{Param, Params, Values};
use crate::random::hash;

crate::words! {
    enum Base { Red = "red", Black = "black", Steel = "steel", Copper = "copper" }
}

crate::params! {
    struct Options {
        /// Coloured lacquer, or bare metal.
        base: Base = "red",
        /// Grooves per side of the tile; they run along x.
        grooves: i32 [8..=512] = 64,
        /// Typical slope of the sides of the grooves.
        slope: f32 [0.0..=1.0] = 0.18,
        /// GGX alpha of the surface between the grooves.
        roughness: f32 [0.05..=1.0] = 0.18,
    }
}

/// # Model
/// Long, slightly wavy brush marks of three widths are cut into a smooth film. Their slopes spread the gloss across the
/// grooves and hardly along them. The film is thinner and darker where the marks are deep.
pub(super) struct Lacquer;

impl Sample for Lacquer {
    fn name(&self) -> &'static str {
        "lacquer"
    }

    fn doc(&self) -> &'static str {
        "Glossy brushed lacquer or metal with fine parallel grooves."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn build(&self, values: &Values, grid: usize, seed: u64) -> Result<HeightField> {
        let Options { base, grooves, slope, roughness } = Options::from_values(values)?;
        let color = match base {
            Base::Red => srgb(168, 22, 20),
            Base::Black => srgb(24, 24, 26),
            Base::Steel => srgb(200, 198, 194),
            Base::Copper => srgb(238, 168, 136),
        };
        let metal = matches!(base, Base::Steel | Base::Copper);
        let seed = hash(&[seed, 0x1ac]);
        HeightField::from_fn(grid, |u, v| {
            let wave = 0.12 / grooves as f32 * gradient(Vec2::new(u, v), [3, 8], seed ^ 1);
            let p = Vec2::new(u, v + wave);
            let wide = gradient(p, [2, grooves / 2], seed ^ 2);
            let mid = gradient(p, [3, grooves], seed ^ 3);
            let fine = gradient(p, [5, grooves * 2], seed ^ 4);
            let marks = 0.5 * wide + 0.35 * mid + 0.17 * fine;
            let orange_peel = 0.25 * octaves(p, [9, 9], 2, seed ^ 5);
            let shade = 1.0 + 0.16 * mid + 0.10 * wide + 0.05 * octaves(p, [4, 6], 2, seed ^ 6);
            let albedo = (color * shade).clamp(Vec3::ZERO, Vec3::splat(0.95));
            let rough = (roughness * (1.0 - 0.25 * mid)).clamp(0.04, 1.0);
            let finish = if metal { Finish::metal(albedo, rough) } else { Finish::coated(albedo, 0.05, rough) };
            ((marks + orange_peel) * slope * 0.5 / grooves as f32, finish)
        })
    }
}
