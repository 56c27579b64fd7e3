//! Render an object that wears a material.

use glam::Vec3;
use loden::glam;
use loden::model::Lambert;
use loden::progress::Silent;
use loden::render::{Lighting, Settings, Studio, TextureMap, object, studio};

fn main() -> loden::Result<()> {
    // any material: of a compressed BTF, a measured BRDF, a formula, or your own
    let material = Lambert { albedo: Vec3::new(0.6, 0.2, 0.1) };
    let scene = Studio {
        object: &object::load("teapot")?, // or an OBJ, PLY or glTF file
        material: &material,
        material_name: "terracotta",
        texture: TextureMap::default(),
        lighting: Lighting::Key { theta_degrees: 40.0, phi_degrees: 120.0 },
    };
    let settings = Settings { width: 96, height: 72, spp: 4, ..Settings::default() };
    let picture = studio(&scene, &settings, &Silent)?;
    picture.write(std::env::temp_dir().join("loden-example-teapot.png"))
}
