//! Brushed lacquer and metal.

use glam::{Vec2, Vec3};

use super::noise::{gradient, octaves};
use super::{Sample, srgb};
use crate::Result;
use crate::acquire::field::{Finish, HeightField};
use crate::acquire::random::hash;
use crate::params::{Kind, Param, Values};

const PARAMS: &[Param] = &[
    Param {
        name: "base",
        unit: "",
        kind: Kind::Choice(&["red", "black", "steel", "copper"]),
        default: "red",
        doc: "Coloured lacquer, or bare metal.",
    },
    Param {
        name: "grooves",
        unit: "",
        kind: Kind::Integer { min: 8, max: 512 },
        default: "64",
        doc: "Grooves per side of the tile; they run along x.",
    },
    Param {
        name: "slope",
        unit: "",
        kind: Kind::Real { min: 0.0, max: 1.0 },
        default: "0.18",
        doc: "Typical slope of the sides of the grooves.",
    },
    Param {
        name: "roughness",
        unit: "",
        kind: Kind::Real { min: 0.05, max: 1.0 },
        default: "0.18",
        doc: "GGX alpha of the surface between the grooves.",
    },
];

/// # Model
/// Long brush marks of three widths, lightly wavy, are cut across a smooth film; their slopes spread the gloss across
/// the grooves and hardly along them. The film is a little thinner and darker where the marks are deep.
pub(super) struct Lacquer;

impl Sample for Lacquer {
    fn name(&self) -> &'static str {
        "lacquer"
    }

    fn doc(&self) -> &'static str {
        "Glossy brushed lacquer or metal with fine parallel grooves."
    }

    fn params(&self) -> &'static [Param] {
        PARAMS
    }

    fn build(&self, values: &Values, grid: usize, seed: u64) -> Result<HeightField> {
        let grooves = values.integer("grooves") as i32;
        let (slope, roughness) = (values.real("slope") as f32, values.real("roughness") as f32);
        let color = match values.text("base") {
            "black" => srgb(24, 24, 26),
            "steel" => srgb(200, 198, 194),
            "copper" => srgb(238, 168, 136),
            _ => srgb(168, 22, 20),
        };
        let metal = matches!(values.text("base"), "steel" | "copper");
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
