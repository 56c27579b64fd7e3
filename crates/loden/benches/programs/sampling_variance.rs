//! Compares the noise of BTF importance sampling with cosine sampling: `sampling_variance MATERIAL [ENVIRONMENT]`.
//!
//! A sphere with the material is lit by an environment map (without one: skies with three lamps). It is rendered 24
//! times at 64 x 64 pixels and 16 samples in each of two ways: with the sampling of the material, and with cosine
//! sampling. The program prints the variance of the pixels, summed over the sphere. In both cases directions are also
//! sampled from the environment and combined.

use std::f32::consts::{PI, TAU};
use std::path::PathBuf;

use glam::{Vec2, Vec3};
use loden::direction::Scheme;
use loden::material::Material;
use loden::picture::Picture;
use loden::progress::Silent;
use loden::render::{Body, Camera, Environment, EnvironmentMap, Scene, Settings, Shape, Sphere, TextureMap, render};
use loden::{Result, import};

const RUNS: u64 = 24;

/// Half widths of the lamps in degrees.
const LAMPS: [f32; 3] = [30.0, 15.0, 5.0];

/// The same material with the default sampling.
struct CosineSampled<'a>(&'a dyn Material);

impl Material for CosineSampled<'_> {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.0.apparent(uv, wi, wo)
    }
}

/// A grey sky with three soft lamps that fade to half at this angle; their total light does not depend on it.
fn sky(degrees: f32) -> Picture {
    let (width, height) = (256, 128);
    let sharpness = 0.5f32.ln() / (degrees.to_radians().cos() - 1.0);
    let lamps = [Vec3::new(1.0, 1.5, 1.0), Vec3::new(-2.0, 0.6, 0.8), Vec3::new(0.3, 0.8, -2.0)].map(Vec3::normalize);
    let radiance = |i: usize| {
        let (u, v) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        let w = loden::direction::from_angles(v / height as f32 * PI, u / width as f32 * TAU);
        let w = Vec3::new(w.x, w.z, w.y);
        Vec3::splat(
            0.3 + lamps.iter().map(|lamp| 0.2 * sharpness * (sharpness * (lamp.dot(w) - 1.0)).exp()).sum::<f32>(),
        )
    };
    Picture { width, height, rgb: (0..width * height).map(radiance).collect() }
}

/// Mean and summed variance of the pictures.
fn noise(material: &dyn Material, map: &EnvironmentMap) -> Result<(f64, f64)> {
    let body = Body {
        shape: Shape::Sphere(Sphere { centre: Vec3::ZERO, radius: 1.0, axis: Vec3::Y }),
        material,
        material_name: "material".into(),
        texture: TextureMap { scale: 4.0, ..TextureMap::default() },
    };
    let scene = Scene {
        bodies: vec![body],
        lights: Vec::new(),
        environment: Environment::Map(Box::new(map.clone())),
        background: Some(Vec3::ZERO),
        camera: Camera::pinhole(Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, 30.0),
    };
    let mut pictures = Vec::new();
    for seed in 0..RUNS {
        let settings = Settings { width: 64, height: 64, spp: 16, depth: 2, seed };
        pictures.push(render(&scene, &settings, &Silent)?);
    }
    let (mut sum, mut variance) = (0.0, 0.0);
    // only pixels inside the sphere: its edge has another kind of noise
    let inside = |i: usize| Vec2::new((i % 64) as f32 - 31.5, (i / 64) as f32 - 31.5).length() < 28.0;
    for i in (0..64 * 64).filter(|&i| inside(i)) {
        let values: Vec<f64> = pictures.iter().map(|p| f64::from(p.rgb[i].y)).collect();
        let mean = values.iter().sum::<f64>() / RUNS as f64;
        sum += mean;
        variance += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (RUNS - 1) as f64;
    }
    Ok((sum, variance))
}

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let path = arguments.next().ok_or("missing MATERIAL")?;
    let material = import::open_named(&path, &Default::default())?.1.material(Scheme::Triangles)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let skies = match arguments.next() {
        Some(file) => vec![(file.display().to_string(), Picture::read(file, &mut Vec::new())?)],
        None => LAMPS.map(|degrees| (format!("lamps of {degrees} degrees"), sky(degrees))).into(),
    };
    for (what, light) in skies {
        let map = EnvironmentMap::new(light, 0.0)?;
        let (own, cosine) = (noise(material.as_ref(), &map)?, noise(&CosineSampled(material.as_ref()), &map)?);
        let (variance, apart) = (own.1 / cosine.1, own.0 / cosine.0 - 1.0);
        println!("{name}, {what}: variance {variance:.3} of that of cosine sampling, means {apart:.1e} apart");
    }
    Ok(())
}
