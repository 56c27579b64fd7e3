//! Times the path tracer on an object file: `bench_render FILE.obj [OUT.exr]` prints million samples per second.
//!
//! 512 x 512 pixels, 64 samples, depth 6, albedo 0.8, under a directional light and a constant sky, seen from
//! (0, 0, 4) with 30 degrees angle of view.

use std::time::Instant;

use glam::Vec3;
use loden::model::Lambert;
use loden::progress::Silent;
use loden::render::{Body, Camera, DirectionalLight, Environment, Scene, Settings, TextureMap, object, render};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("missing FILE.obj")?;
    let material = Lambert { albedo: Vec3::splat(0.8) };
    let direction = Vec3::new(1.0, 2.0, 2.0) / 3.0;
    let scene = Scene {
        bodies: vec![Body {
            shape: object::load(&path)?.shape,
            material: &material,
            material_name: "diffuse".into(),
            texture: TextureMap::default(),
        }],
        lights: vec![DirectionalLight { direction, irradiance: Vec3::splat(2.0), radius_degrees: 0.0 }.into()],
        environment: Environment::Constant(Vec3::splat(0.3)),
        camera: Camera::pinhole(Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, 30.0),
        background: None,
    };
    let settings = Settings { width: 512, height: 512, spp: 64, depth: 6, seed: 0 };
    let start = Instant::now();
    let picture = render(&scene, &settings, &Silent)?;
    println!("{:.3}", 512.0 * 512.0 * 64e-6 / start.elapsed().as_secs_f64());
    if let Some(out) = std::env::args().nth(2) {
        picture.write(out)?;
    }
    Ok(())
}
