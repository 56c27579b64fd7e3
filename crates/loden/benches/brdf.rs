//! Evaluations per second of every analytic model and every kind of table, one at a time and many per call, on one
//! thread; and of a `.bsdf` file, many per call on all threads, as the peer `benches/peers/brdf.py` does.
//!
//! Prints a JSON line each; the fastest of several runs counts. `LODEN_DATA` is the folder of reference measurements,
//! without which only tables of a model are timed; `LODEN_BENCH_BSDF` is the file for the comparison with the peer.

use std::f32::consts::PI;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::{Vec2, Vec3};
use loden::direction::{Scheme, from_angles};
use loden::import;
use loden::material::{Brdf, Material, Point, TabulatedBrdf};
use loden::model::{self, Analytic, MODELS};
use loden::params::Values;
use loden::progress::Silent;
use loden::separable::FACTORISATIONS;
use rayon::prelude::*;
use serde_json::json;

const PAIRS: usize = 1 << 20;
const RUNS: usize = 15;
const FILES: [&str; 4] =
    ["rgl_epfl/satin_rosaline_rgb.bsdf", "cornell_pbrt_v2/mystique.brdf", "curet/abrdf.dat", "btf/twill.zip"];

/// Pairs of directions, both uniform over the hemisphere.
fn pairs() -> Vec<(Vec3, Vec3)> {
    // additive recurrence in four dimensions: 2^32 / phi^k with phi^5 = phi + 1
    const STEP: [u32; 4] = [3_679_390_609, 3_152_041_523, 2_700_274_806, 2_313_257_605];
    let pair = |i: usize| {
        let [a, b, c, d] = STEP.map(|s| ((i as u32).wrapping_mul(s) >> 8) as f32 / (1u32 << 24) as f32);
        let direction = |z: f32, turn: f32| from_angles(z.acos(), std::f32::consts::TAU * turn);
        (direction(a, b), direction(c, d))
    };
    // shuffled, so that no table gains from the order
    (0..PAIRS).map(|i| pair(i.wrapping_mul(0x9e37_79b1) % PAIRS)).collect()
}

/// Evaluations per second, the best of several runs.
fn rate(count: usize, mut run: impl FnMut()) -> f64 {
    let seconds = (0..RUNS).map(|_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    });
    count as f64 / seconds.fold(f64::INFINITY, f64::min)
}

fn one_by_one(brdf: &dyn Material, pairs: &[(Vec3, Vec3)]) -> f64 {
    rate(pairs.len(), || {
        for &(wi, wo) in pairs {
            black_box(brdf.eval(Vec2::ZERO, black_box(wi), wo));
        }
    })
}

/// Apparent values, with a batch of points prepared at a time.
fn many(brdf: &dyn Material, pairs: &[(Vec3, Vec3)], values: &mut [Vec3]) {
    const BATCH: usize = 1024;
    let index: Vec<u32> = (0..BATCH as u32).collect();
    let (mut points, mut wi) = (Vec::with_capacity(BATCH), Vec::with_capacity(BATCH));
    for (pairs, values) in pairs.chunks(BATCH).zip(values.chunks_mut(BATCH)) {
        points.clear();
        wi.clear();
        points.extend(pairs.iter().map(|&(_, wo)| Point { uv: Vec2::ZERO, wo }));
        wi.extend(pairs.iter().map(|pair| pair.0));
        brdf.prepare(&points).apparent(&index[..values.len()], &wi, values);
    }
}

fn main() {
    let pairs = pairs();
    let few = &pairs[..PAIRS / 16];
    let print = |kind: &str, name: &str, key: &str, rate: f64| {
        println!("{}", json!({ "bench": "brdf", "kind": kind, "name": name, key: rate }));
    };
    if let Some(path) = std::env::var_os("LODEN_BENCH_BSDF") {
        let brdf = open(Path::new(&path));
        let mut values = vec![Vec3::ZERO; PAIRS];
        let all = rate(PAIRS, || {
            let parts = values.par_chunks_mut(1 << 14).zip(pairs.par_chunks(1 << 14));
            parts.for_each(|(values, pairs)| many(brdf.as_ref(), pairs, values));
        });
        let value = |(v, (wi, wo)): (&Vec3, &(Vec3, Vec3))| f64::from(v.element_sum() * wo.z / (PI * wi.z));
        let sum: f64 = values.iter().zip(&pairs).map(value).sum();
        let mean = sum / (3 * PAIRS) as f64;
        println!("{}", json!({ "bench": "brdf", "table": "rgl", "evaluations_per_second": all, "mean": mean }));
        return;
    }
    for model in MODELS {
        let brdf = Analytic::new(*model, Values::defaults(model.params())).expect("defaults work");
        print("model", model.name(), "per_second", one_by_one(&brdf, few));
    }
    let ward = model::by_name("ward").expect("a model");
    let ward = Analytic::new(ward, Values::defaults(ward.params())).expect("defaults work");
    for method in FACTORISATIONS {
        let brdf = method.factor(&ward, &Values::defaults(method.params()), &Silent).expect("defaults work");
        print("factorisation", method.name(), "per_second", one_by_one(&brdf, few));
    }
    let Some(folder) = std::env::var_os("LODEN_DATA") else {
        eprintln!("LODEN_DATA is not set: no measured tables");
        return;
    };
    for name in FILES {
        let brdf = open(&Path::new(&folder).join(name));
        print("table", name, "per_second", one_by_one(brdf.as_ref(), few));
        let mut values = vec![Vec3::ZERO; few.len()];
        print("table", name, "per_second_many", rate(few.len(), || many(brdf.as_ref(), few, &mut values)));
    }
}

fn open(path: &Path) -> Arc<dyn Brdf> {
    match import::open_named(path, &Default::default()).expect("a file that opens").1.images() {
        Err(brdf) => brdf,
        Ok(btf) => {
            Arc::new(TabulatedBrdf::average(btf.as_ref(), Scheme::Triangles, &Silent).expect("directions in triangles"))
        }
    }
}
