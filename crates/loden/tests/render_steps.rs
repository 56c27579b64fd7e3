//! Rendering in steps: interruptions do not change the picture, mismatched checkpoints are rejected, and samples go
//! where they are needed.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use glam::{Vec2, Vec3};
use loden::Error;
use loden::material::Material;
use loden::model::Lambert;
use loden::picture::Picture;
use loden::progress::{Progress, Silent};
use loden::render::{
    Body, Camera, Checkpoint, Effort, Environment, EnvironmentMap, Mapping, Rendered, Scene, Settings, Shape, Sphere,
    TextureMap, Wrap, render, render_in_steps,
};

const SPHERE: Sphere = Sphere { centre: Vec3::ZERO, radius: 1.0, axis: Vec3::Y };

fn scene<'a>(material: &'a dyn Material, texture: TextureMap) -> Scene<'a> {
    let lamp = |i: usize| if i == 9 { Vec3::new(60.0, 50.0, 40.0) } else { Vec3::splat(0.2) };
    let picture = Picture { width: 8, height: 4, rgb: (0..32).map(lamp).collect() };
    let body = Body { shape: Shape::Sphere(SPHERE), material, material_name: "m".into(), texture };
    Scene {
        bodies: vec![body],
        lights: Vec::new(),
        environment: Environment::Map(Box::new(EnvironmentMap::new(picture, 0.0).unwrap())),
        background: Some(Vec3::splat(0.5)),
        camera: Camera::pinhole(Vec3::new(0.0, 1.0, 5.0), Vec3::ZERO, 40.0),
    }
}

fn settings(spp: u32) -> Settings {
    Settings { width: 50, height: 35, spp, depth: 4, seed: 5 }
}

fn grey() -> Lambert {
    Lambert { albedo: Vec3::splat(0.6) }
}

/// Stops after a number of tile samples.
struct Patience {
    left: u64,
    taken: AtomicU64,
}

impl Progress for Patience {
    fn advance(&self, steps: u64) {
        self.taken.fetch_add(steps, Ordering::Relaxed);
    }
    fn is_cancelled(&self) -> bool {
        self.taken.load(Ordering::Relaxed) > self.left
    }
}

fn kept(path: &Path, scene: &str) -> Effort {
    let checkpoint = Checkpoint { path: path.into(), scene: scene.into(), every: Duration::from_secs(1) };
    Effort { checkpoint: Some(checkpoint), ..Effort::default() }
}

fn run(settings: Settings, effort: &Effort, threads: usize, progress: &dyn Progress) -> loden::Result<Rendered> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let grey = grey();
    pool.install(|| render_in_steps(&scene(&grey, TextureMap::default()), &settings, effort, progress))
}

#[test]
fn an_interrupted_picture_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let grey = grey();
    let whole = render(&scene(&grey, TextureMap::default()), &settings(40), &Silent).unwrap();
    for (threads, error) in [(1, None), (2, None), (2, Some(0.05))] {
        let whole = match error {
            None => whole.clone(),
            Some(_) => {
                let effort = Effort { relative_error: error, ..Effort::default() };
                run(settings(40), &effort, 2, &Silent).unwrap().picture
            }
        };
        let path = folder.path().join(format!("{threads}{}.checkpoint", error.is_some()));
        let effort = Effort { relative_error: error, ..kept(&path, "a") };
        let mut interruptions = 0;
        let found = loop {
            let patience = Patience { left: 90, taken: AtomicU64::new(0) };
            match run(settings(40), &effort, threads, &patience) {
                Ok(found) => break found,
                Err(Error::Cancelled) => interruptions += 1,
                Err(other) => panic!("{other}"),
            }
        };
        assert!(interruptions > 2 && found.complete, "{interruptions}");
        assert_eq!(found.picture, whole);
        // a complete picture takes no more samples, and a larger number continues from it
        assert_eq!(run(settings(40), &effort, threads, &Silent).unwrap().samples, 0);
        if error.is_none() {
            let more = run(settings(64), &effort, threads, &Silent).unwrap();
            assert_eq!(more.samples, 24 * 50 * 35);
            let scene = scene(&grey, TextureMap::default());
            assert_eq!(more.picture, render(&scene, &settings(64), &Silent).unwrap());
        }
    }
}

#[test]
fn checkpoints_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.checkpoint");
    run(settings(2), &kept(&path, "a"), 2, &Silent).unwrap();
    let refused = |settings: Settings, scene: &str| {
        let error = run(settings, &kept(&path, scene), 2, &Silent).unwrap_err().to_string();
        assert!(error.contains("x.checkpoint"), "{error}");
        error
    };
    assert!(refused(settings(2), "b").contains("another scene"));
    assert!(refused(Settings { seed: 6, ..settings(2) }, "a").contains("seed"));
    assert!(refused(Settings { depth: 2, ..settings(2) }, "a").contains("depth"));
    assert!(refused(Settings { width: 51, ..settings(2) }, "a").contains("bytes"));
    let good = std::fs::read(&path).unwrap();
    for cut in [0, 7, 60, good.len() - 1] {
        std::fs::write(&path, &good[..cut]).unwrap();
        assert!(refused(settings(2), "a").contains("size"));
    }
    for place in [0, 70, good.len() / 2, good.len() - 1] {
        let mut bad = good.clone();
        bad[place] ^= 4;
        std::fs::write(&path, &bad).unwrap();
        assert!(refused(settings(2), "a").contains("damaged"));
    }
}

#[test]
fn the_time_limit_leaves_a_sample_in_every_pixel() {
    let effort = Effort { time_limit: Some(Duration::ZERO), ..Effort::default() };
    let found = run(settings(1 << 20), &effort, 2, &Silent).unwrap();
    assert!(!found.complete && found.samples_per_pixel >= 1.0 && found.samples_per_pixel < 100.0);
    if found.samples_per_pixel == 1.0 {
        assert_eq!(found.picture, run(settings(1), &Effort::default(), 2, &Silent).unwrap().picture);
    }
}

#[test]
fn samples_go_where_the_noise_is() {
    let effort = Effort { relative_error: Some(0.02), ..Effort::default() };
    let adaptive = run(settings(4096), &effort, 2, &Silent).unwrap();
    assert!(adaptive.complete && adaptive.samples_per_pixel > 16.0 && adaptive.samples_per_pixel < 2000.0);
    let exact = run(Settings { seed: 99, ..settings(4096) }, &Effort::default(), 2, &Silent).unwrap().picture;
    for (top, left) in [(0, 0), (0, 16), (16, 16), (16, 32)] {
        let (mut errors, mut values) = (0.0, 0.0);
        for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (left + x, top + y))) {
            errors += (adaptive.picture.at(x, y).y - exact.at(x, y).y).powi(2);
            values += exact.at(x, y).y.powi(2);
        }
        let error = (errors / values).sqrt();
        // the bound is on a standard error; a tile has 256 pixels
        assert!(error < 0.025, "tile at {left}, {top}: {error}");
    }
    let wrong = Effort { relative_error: Some(0.0), ..Effort::default() };
    assert!(run(settings(4), &wrong, 2, &Silent).unwrap_err().to_string().starts_with("relative error"));
}

/// Bands in u and v that reflect light from one side of their grain.
struct Bands;

impl Material for Bands {
    fn apparent(&self, uv: Vec2, wi: Vec3, _wo: Vec3) -> Vec3 {
        let wave = |x: f32| 0.5 + 0.5 * (std::f32::consts::TAU * x).sin();
        Vec3::new(wave(uv.x), wave(uv.y), 0.5 + 0.4 * wi.x) * wi.z
    }
}

#[test]
fn a_projected_sphere_looks_like_its_own_coordinates() {
    let at = |mapping: Mapping, wrap: Wrap| {
        let texture = TextureMap { mapping, wrap, scale: 2.0, rotation_degrees: 20.0, samples: 1 };
        render(&scene(&Bands, texture), &settings(16), &Silent).unwrap()
    };
    let own = at(Mapping::Surface, Wrap::Repeat);
    let projected = at(Mapping::Sphere { centre: Vec3::ZERO, axis: 2.0 * Vec3::Y }, Wrap::Repeat);
    let difference = own.rgb.iter().zip(&projected.rgb).map(|(a, b)| (*a - *b).length()).sum::<f32>();
    assert!(difference / (own.rgb.len() as f32) < 2e-3, "{difference}");
    // beyond its edges a material absorbs everything
    let decal =
        at(Mapping::Plane { origin: Vec3::new(-0.3, -0.3, 0.0), u: 1.2 * Vec3::X, v: 1.2 * Vec3::Y }, Wrap::Black);
    let black = decal.rgb.iter().filter(|c| **c == Vec3::ZERO).count();
    assert!(black > 100 && black < 800, "{black}");
}

#[test]
fn blended_projections_are_the_mean_of_the_three() {
    // for a normal with three equal coordinates, each projection has a third of the weight
    let texture = TextureMap { mapping: Mapping::Triplanar { origin: Vec3::ZERO, size: 1.0 }, ..TextureMap::default() };
    let picture = render(&scene(&Bands, texture), &settings(64), &Silent).unwrap();
    assert!(picture.rgb.iter().all(|c| c.is_finite()));
    let different = picture.rgb.iter().filter(|c| (**c - Vec3::splat(0.5)).length() > 0.05).count();
    assert!(different > 300, "{different}");
}
