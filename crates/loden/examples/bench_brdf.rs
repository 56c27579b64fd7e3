//! Times evaluation on one thread: `bench_brdf [FILE...]` prints million evaluations a second for every analytic model
//! with its default parameters, and for measured BRDFs.

use std::hint::black_box;
use std::time::Instant;

use glam::{Vec2, Vec3};
use loden::factor::brdf::pairs;
use loden::import::{self, Measured};
use loden::material::Material;
use loden::model::{Analytic, MODELS};
use loden::params::Values;

/// The best of several runs over the same pairs of directions.
fn rate(material: &dyn Material, directions: &[(Vec3, Vec3)]) -> f64 {
    let run = |_| {
        let start = Instant::now();
        for &(wi, wo) in directions {
            black_box(material.eval(Vec2::ZERO, black_box(wi), wo));
        }
        start.elapsed().as_secs_f64()
    };
    directions.len() as f64 / (0..5).map(run).fold(f64::INFINITY, f64::min) / 1e6
}

fn main() -> loden::Result<()> {
    let directions: Vec<_> = pairs(200_000).collect();
    println!("| BRDF | million evaluations a second |\n|---|---|");
    for model in MODELS {
        let brdf = Analytic::new(*model, Values::defaults(model.params()));
        println!("| {} | {:.2} |", model.name(), rate(&brdf, &directions));
    }
    for path in std::env::args().skip(1) {
        if let (importer, Measured::Brdf(brdf)) = import::open_named(&path, &import::Options::default())? {
            println!("| {} ({}) | {:.2} |", path, importer.name(), rate(brdf.as_ref(), &directions));
        }
    }
    Ok(())
}
