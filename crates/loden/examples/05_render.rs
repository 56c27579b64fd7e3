//! Render an object that wears a material.

use loden::codec;
use loden::direction::Scheme;
use loden::progress::Silent;
use loden::render::{Lighting, Settings, Studio, TextureMap, object, studio};

fn main() -> loden::Result<()> {
    // any material: a compressed BTF, a measured BRDF, a formula, or one of your own
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/pvmf-f16.loden");
    let material = codec::open(file)?.material(Scheme::Triangles)?;
    let scene = Studio {
        object: &object::load("teapot")?, // or an OBJ, PLY or glTF file
        material: &*material,
        material_name: file,
        texture: TextureMap::default(),
        lighting: Lighting::Key { theta_degrees: 40.0, phi_degrees: 120.0 },
    };
    let settings = Settings { width: 96, height: 72, spp: 4, ..Settings::default() };
    let picture = studio(&scene, &settings, &Silent)?;
    picture.write(std::env::temp_dir().join("loden-example-teapot.png"))
}
