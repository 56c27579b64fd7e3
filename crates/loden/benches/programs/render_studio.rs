//! Renders an object in the studio with a simple material, and prints the speed.
//!
//! `render_studio OBJECT OUT.png lambert|checker|weave ALBEDO [SIZE] [SPP] [THETA,PHI | MAP.exr]`

use std::time::Instant;

use glam::{Vec2, Vec3};
use loden::material::Material;
use loden::model::Lambert;
use loden::progress::Silent;
use loden::render::{EnvironmentMap, Lighting, Settings, Studio, TextureMap, object, studio};

/// Dark and light squares, eight per period.
struct Checker(Vec3);

impl Material for Checker {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let square = ((uv.x * 8.0).floor() + (uv.y * 8.0).floor()).rem_euclid(2.0);
        let shade = if wi.z > 0.0 && wo.z > 0.0 { wi.z * (0.4 + 0.6 * square) } else { 0.0 };
        self.0 * shade
    }
}

/// A plain weave of two shiny threads, in place of a measured cloth.
struct Weave(Vec3);

impl Material for Weave {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return Vec3::ZERO;
        }
        let p = uv * 24.0;
        let warp = ((p.x.floor() + p.y.floor()).rem_euclid(2.0)) > 0.5;
        let (along, across) = if warp { (p.y.fract(), p.x.fract()) } else { (p.x.fract(), p.y.fract()) };
        let tilt = Vec2::new(along.rem_euclid(1.0) - 0.5, across.rem_euclid(1.0) - 0.5);
        let normal = Vec3::new(tilt.x * 0.9, tilt.y * 1.3, 1.0).normalize();
        let normal = if warp { Vec3::new(normal.y, normal.x, normal.z) } else { normal };
        let half = (wi + wo).normalize();
        let thread = if warp { Vec3::Y } else { Vec3::X };
        let glint = (1.0 - half.dot(thread).powi(2)).max(0.0).powf(40.0) * 0.25;
        let diffuse = self.0 * if warp { Vec3::new(1.0, 0.92, 0.85) } else { Vec3::new(0.55, 0.6, 0.75) };
        // like a measured cloth, it darkens towards the horizon
        diffuse * normal.dot(wi).max(0.0) * (wi.z / 0.26).min(1.0) + Vec3::splat(glint * wi.z * self.0.max_element())
    }
}

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

fn argument<T: std::str::FromStr>(position: usize, name: &str, default: Option<T>) -> Outcome<T> {
    match (std::env::args().nth(position), default) {
        (Some(text), _) => text.parse().map_err(|_| format!("{name}: found {text:?}").into()),
        (None, Some(default)) => Ok(default),
        (None, None) => Err(format!("missing {name}").into()),
    }
}

fn main() -> Outcome {
    let start = Instant::now();
    let object = object::load(&argument::<String>(1, "OBJECT", None)?)?;
    println!("object in {:.2} s", start.elapsed().as_secs_f64());
    let out: String = argument(2, "OUT.png", None)?;
    let albedo = Vec3::splat(argument(4, "ALBEDO", Some(0.5))?);
    let kind: String = argument(3, "material", Some("lambert".into()))?;
    let material: Box<dyn Material> = match kind.as_str() {
        "checker" => Box::new(Checker(albedo)),
        "weave" => Box::new(Weave(albedo)),
        _ => Box::new(Lambert { albedo }),
    };
    let size = argument(5, "SIZE", Some(512))?;
    let settings = Settings { width: size, height: size, spp: argument(6, "SPP", Some(64))?, ..Settings::default() };
    let light: String = argument(7, "light", Some(String::new()))?;
    let lighting = match light.split_once(',') {
        Some((theta, phi)) => Lighting::Key { theta_degrees: theta.parse()?, phi_degrees: phi.parse()? },
        None if light.is_empty() => Lighting::default(),
        None => Lighting::Environment(Box::new(EnvironmentMap::read(light, 0.0, &mut Vec::new())?)),
    };
    let texture = TextureMap::default();
    let material = &*material;
    let scene = Studio { object: &object, material, material_name: &kind, texture, lighting };
    let start = Instant::now();
    let picture = studio(&scene, &settings, &Silent)?;
    let seconds = start.elapsed().as_secs_f64();
    let samples = (settings.width * settings.height) as f64 * f64::from(settings.spp);
    println!("{seconds:.2} s, {:.2} Msamples/s", samples / seconds / 1e6);
    picture.write(out)?;
    let mean = picture.rgb.iter().sum::<Vec3>() / picture.rgb.len() as f32;
    println!("mean radiance {:.3}", mean.y);
    Ok(())
}
