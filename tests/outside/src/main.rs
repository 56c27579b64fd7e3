//! Adds a codec and a material from outside, and renders with both.
//!
//! `outside FILE.loden` compresses the material of the file with a codec of its own, then renders one sphere that wears the
//! result and one that wears a velvet of its own. It prints the mean colours of the two pictures.

mod codec;
mod material;

use std::error::Error;

use loden::codec::{Finish, Goal, compress, open, open_with};
use loden::direction::{Scheme, from_angles};
use loden::glam::{Vec2, Vec3};
use loden::material::Material;
use loden::params::Params;
use loden::progress::Silent;
use loden::render::{Lighting, Settings, Studio, TextureMap, object, studio};

use codec::{Classes, Means};
use material::Velvet;

fn main() -> Result<(), Box<dyn Error>> {
    let source = open(std::env::args().nth(1).ok_or("usage: outside FILE.loden")?)?;
    let path = std::env::temp_dir().join(format!("outside-{}.loden", std::process::id()));
    let finish = Finish { measure: true, lossless: None };
    let params = Classes { rows: 2 }.to_values()?;
    let outcome = compress(&Means, &*source, &params, Goal::Params, finish, &path, &Silent)?;
    println!("{} bytes, {:?}", outcome.bytes, outcome.error);

    // opened with the codec at hand and without it: by the recipe in the file
    let (known, unknown) = (open_with(&path, &[&Means])?, open(&path)?);
    let (uv, wi, wo) = (Vec2::new(0.3, 0.7), from_angles(0.4, 1.0), from_angles(0.7, 4.0));
    let values = [known, unknown.clone()].map(|file| Ok(file.material(Scheme::Triangles)?.apparent(uv, wi, wo)));
    let [a, b]: [loden::Result<Vec3>; 2] = values;
    assert_eq!(a?, b?);
    std::fs::remove_file(&path)?;

    render("means", &*unknown.material(Scheme::Triangles)?)?;
    render("velvet", &Velvet { colour: Vec3::new(0.4, 0.05, 0.1), sharpness: 3.0 })
}

/// Renders a sphere and prints the mean of its picture.
fn render(name: &str, material: &dyn Material) -> Result<(), Box<dyn Error>> {
    let sphere = object::load("sphere")?;
    let scene = Studio {
        object: &sphere,
        material,
        material_name: name,
        texture: TextureMap::default(),
        lighting: Lighting::default(),
    };
    let picture = studio(&scene, &Settings { width: 48, height: 48, spp: 4, ..Settings::default() }, &Silent)?;
    let mean = picture.rgb.iter().sum::<Vec3>() / picture.rgb.len() as f32;
    assert!(mean.min_element() > 0.0, "{name} is black: {mean}");
    println!("{name}: {mean}");
    Ok(())
}
