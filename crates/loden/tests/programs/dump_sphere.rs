//! Renders a unit sphere of one diffuse colour as linear EXR, for comparison with other renderers.
//!
//! `dump_sphere OUT.exr ALBEDO SPP SEED directional|map [MAP.exr]`: from (0, 0, 4) with 30 degrees angle of view,
//! 128 x 128 pixels, depth 6; lit from direction (1, 2, 2) / 3 with irradiance 2 under a sky of radiance 0.3, or by
//! the map alone.

use arguments::{Outcome, argument};
use glam::Vec3;
use loden::btf::FloatType;
use loden::model::Lambert;
use loden::progress::Silent;
use loden::render::{
    Body, Camera, DirectionalLight, Environment, EnvironmentMap, Scene, Settings, Shape, Sphere, TextureMap, render,
};

mod arguments {
    //! Arguments without a parser.
    pub type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

    /// The argument at a position, as a number or text.
    pub fn argument<T: std::str::FromStr>(position: usize, name: &str) -> Outcome<T> {
        let text = std::env::args().nth(position).ok_or_else(|| format!("missing {name}"))?;
        text.parse().map_err(|_| format!("{name}: found {text:?}").into())
    }
}

fn main() -> Outcome {
    let out: String = argument(1, "OUT.exr")?;
    let material = Lambert { albedo: Vec3::splat(argument(2, "ALBEDO")?) };
    let (spp, seed) = (argument(3, "SPP")?, argument(4, "SEED")?);
    let (lights, environment) = match argument::<String>(5, "directional|map")?.as_str() {
        "map" => {
            let map = EnvironmentMap::read(argument::<String>(6, "MAP.exr")?, 0.0, &mut Vec::new())?;
            (Vec::new(), Environment::Map(Box::new(map)))
        }
        _ => {
            let direction = Vec3::new(1.0, 2.0, 2.0) / 3.0;
            let light = DirectionalLight { direction, irradiance: Vec3::splat(2.0), radius_degrees: 0.0 };
            (vec![light.into()], Environment::Constant(Vec3::splat(0.3)))
        }
    };
    let sphere = Sphere { centre: Vec3::ZERO, radius: 1.0, axis: Vec3::Y };
    let scene = Scene {
        bodies: vec![Body {
            shape: Shape::Sphere(sphere),
            material: &material,
            material_name: "diffuse".into(),
            texture: TextureMap::default(),
        }],
        lights,
        environment,
        camera: Camera::pinhole(Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, 30.0),
        background: None,
    };
    let settings = Settings { width: 128, height: 128, spp, depth: 6, seed };
    render(&scene, &settings, &Silent)?.write_exr(out, FloatType::F32)?;
    Ok(())
}
