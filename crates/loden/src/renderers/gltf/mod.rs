//! glTF 2.0: a binary file with a ball that wears the closest standard material.

mod ball;
mod glb;

use std::fs;
use std::path::Path;

use glam::{Mat4, Vec3};
use serde_json::{Map, Value, json};

use super::closest::{described, fitted, normal, png, srgb};
use super::{Renderer, scene};
use crate::Result;
use crate::codec::CompressedBtf;
use crate::material::Material;
use crate::output::failed;
use crate::progress::Progress;
use crate::standard::{Layers, Standard, USUAL_F0};
use glb::Glb;

/// glTF 2.0.
pub(super) struct Gltf;

/// Name of the file.
const FILE: &str = "ball.glb";

impl Renderer for Gltf {
    fn name(&self) -> &'static str {
        "gltf"
    }

    fn doc(&self) -> &'static str {
        "glTF 2.0: a ball that wears the closest standard material, as one GLB file for Blender, three.js and game engines; its error is stated."
    }

    fn check(&self, _path: &Path, _material: &CompressedBtf) -> Result<()> {
        Ok(())
    }

    fn write(
        &self,
        name: &str,
        material: &CompressedBtf,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<Box<dyn Material>>> {
        let standard = fitted(material, progress)?;
        let path = folder.join(FILE);
        let mut glb = Glb::default();
        let (textured, extensions) = textured(&path, &standard, name, &mut glb)?;
        let document = document(&mut glb, textured, &extensions);
        let readme = include_str!("README.md").replace("{name}", name).replace("{layers}", &described(&standard));
        let files = [(FILE, glb.into_bytes(document)), ("README.md", readme.into_bytes())];
        for (file, bytes) in files {
            let path = folder.join(file);
            fs::write(&path, bytes).map_err(failed(&path))?;
        }
        Ok(Some(Box::new(standard)))
    }
}

/// The material, with its textures in `glb`, and the extensions that it uses.
fn textured(path: &Path, standard: &Standard, name: &str, glb: &mut Glb) -> Result<(Value, Vec<&'static str>)> {
    let mut texture = |name: &str, bytes: Vec<u8>| json!({ "index": glb.texture(name, &bytes) });
    let base = texture("base-color", png(path, standard, |texel| srgb(texel.base))?);
    let rough = png(path, standard, |texel| [1.0, texel.alpha[1].sqrt(), texel.metallic])?;
    let rough = texture("metallic-roughness", rough);
    let bumps = texture("normal", png(path, standard, normal)?);
    let layers = standard.layers();
    let mut extensions = Map::new();
    let weight = texture("specular", png(path, standard, |texel| [1.0, 1.0, 1.0, texel.weight])?);
    extensions.insert("KHR_materials_specular".into(), json!({ "specularTexture": weight }));
    if f64::from(layers.f0) as f32 != USUAL_F0 as f32 {
        extensions.insert("KHR_materials_ior".into(), json!({ "ior": layers.ior() }));
    }
    if layers.grain {
        let direction = |texel: &crate::standard::Texel| {
            let (sin, cos) = texel.grain.sin_cos();
            [0.5 + 0.5 * cos, 0.5 + 0.5 * sin, strength(texel.alpha)]
        };
        let map = texture("anisotropy", png(path, standard, direction)?);
        let value = json!({ "anisotropyStrength": 1.0, "anisotropyTexture": map });
        extensions.insert("KHR_materials_anisotropy".into(), value);
    }
    if let Some(roughness) = layers.sheen {
        let map = texture("sheen", png(path, standard, |texel| srgb(texel.sheen))?);
        let value =
            json!({ "sheenColorFactor": [1, 1, 1], "sheenColorTexture": map, "sheenRoughnessFactor": roughness });
        extensions.insert("KHR_materials_sheen".into(), value);
    }
    if let Some(roughness) = layers.coat {
        let map = texture("clearcoat", png(path, standard, |texel| [texel.coat, 0.0, 0.0])?);
        let value = json!({ "clearcoatFactor": 1.0, "clearcoatTexture": map, "clearcoatRoughnessFactor": roughness });
        extensions.insert("KHR_materials_clearcoat".into(), value);
    }
    let used = names(&layers, extensions.contains_key("KHR_materials_ior"));
    let material = json!({
        "name": name,
        "pbrMetallicRoughness": { "baseColorTexture": base, "metallicRoughnessTexture": rough },
        "normalTexture": bumps,
        "extensions": extensions,
    });
    Ok((material, used))
}

/// The extensions of a material and of the light.
fn names(layers: &Layers, has_ior: bool) -> Vec<&'static str> {
    let material = [
        (true, "KHR_materials_specular"),
        (has_ior, "KHR_materials_ior"),
        (layers.grain, "KHR_materials_anisotropy"),
        (layers.sheen.is_some(), "KHR_materials_sheen"),
        (layers.coat.is_some(), "KHR_materials_clearcoat"),
        (true, "KHR_lights_punctual"),
    ];
    material.into_iter().filter_map(|(used, name)| used.then_some(name)).collect()
}

/// The strength of anisotropy: the larger alpha lies that much, squared, of the way from the smaller one to 1.
fn strength([along, across]: [f32; 2]) -> f32 {
    ((along - across) / (1.0 - across).max(1e-6)).clamp(0.0, 1.0).sqrt()
}

/// The scene: a ball, a distant light, a camera. In glTF y is up.
fn document(glb: &mut Glb, material: Value, extensions: &[&str]) -> Value {
    let primitive = ball::primitive(glb);
    // our scene has z up
    let upright = Mat4::from_rotation_x(-std::f32::consts::FRAC_PI_2);
    // cameras and lights look along their negative z
    let looking = |from: Vec3| {
        let back = from.normalize();
        let right = Vec3::Z.cross(back).normalize();
        Mat4::from_cols(right.extend(0.0), back.cross(right).extend(0.0), back.extend(0.0), from.extend(1.0))
    };
    let matrix = |matrix: Mat4| json!(matrix.to_cols_array());
    let light = json!({ "type": "directional", "intensity": scene::IRRADIANCE });
    json!({
        "asset": { "version": "2.0", "generator": concat!("loden ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": extensions,
        "extensions": { "KHR_lights_punctual": { "lights": [light] } },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [
            { "name": "z up", "matrix": matrix(upright), "children": [1, 2, 3] },
            { "name": "ball", "mesh": 0 },
            { "name": "camera", "camera": 0, "matrix": matrix(looking(scene::EYE)) },
            {
                "name": "light", "matrix": matrix(looking(5.0 * scene::TO_LIGHT.normalize())),
                "extensions": { "KHR_lights_punctual": { "light": 0 } },
            },
        ],
        "cameras": [{
            "type": "perspective",
            "perspective": { "aspectRatio": 1, "yfov": scene::FIELD_OF_VIEW.to_radians(), "znear": 0.1, "zfar": 100 },
        }],
        "meshes": [{ "name": "ball", "primitives": [primitive] }],
        "materials": [material],
    })
}
