//! MaterialX 1.39: the closest standard material as `standard_surface`, with its maps.

use std::f32::consts::PI;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use super::Renderer;
use super::closest::{described, fitted, normal, png, srgb};
use crate::Result;
use crate::codec::CompressedBtf;
use crate::material::Material;
use crate::output::failed;
use crate::progress::Progress;
use crate::standard::{Standard, Texel};

/// MaterialX.
pub(super) struct MaterialX;

impl Renderer for MaterialX {
    fn name(&self) -> &'static str {
        "materialx"
    }

    fn doc(&self) -> &'static str {
        "MaterialX 1.39: the closest standard material as a standard_surface with its maps; its error is stated."
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
        let maps = maps(folder, &standard)?;
        let readme = include_str!("README.md").replace("{name}", name).replace("{layers}", &described(&standard));
        let put = |file: &str, bytes: &[u8]| {
            let path = folder.join(file);
            fs::write(&path, bytes).map_err(failed(&path))
        };
        put("material.mtlx", document(&standard, &maps).as_bytes())?;
        put("README.md", readme.as_bytes())?;
        for map in &maps {
            put(&map.file(), &map.bytes)?;
        }
        Ok(Some(Box::new(standard)))
    }
}

/// A texture and the input of the surface that it drives.
struct Map {
    /// The name of the input.
    input: &'static str,
    /// Its type, which is also that of the texture.
    kind: &'static str,
    /// A PNG file.
    bytes: Vec<u8>,
}

impl Map {
    fn file(&self) -> String {
        format!("{}.png", self.input)
    }

    /// Colours are sRGB; numbers have no colour space.
    fn color_space(&self) -> &'static str {
        if self.kind == "color3" { " colorspace=\"srgb_texture\"" } else { "" }
    }
}

fn maps(path: &Path, standard: &Standard) -> Result<Vec<Map>> {
    let layers = standard.layers();
    let color = |input, of: &dyn Fn(&Texel) -> [f32; 3]| {
        Ok::<_, crate::Error>(Map { input, kind: "color3", bytes: png(path, standard, |texel| srgb(of(texel)))? })
    };
    let number = |input, of: &dyn Fn(&Texel) -> f32| {
        Ok::<_, crate::Error>(Map { input, kind: "float", bytes: png(path, standard, |texel| [of(texel)])? })
    };
    let mut maps = vec![
        color("base_color", &|texel| texel.base)?,
        number("metalness", &|texel| texel.metallic)?,
        number("specular", &|texel| texel.weight)?,
        number("specular_roughness", &|texel| (texel.alpha[0] * texel.alpha[1]).sqrt().sqrt())?,
        Map { input: "normal", kind: "vector3", bytes: png(path, standard, normal)? },
    ];
    if layers.grain {
        maps.push(number("specular_anisotropy", &|texel| 1.0 - texel.alpha[1] / texel.alpha[0])?);
        maps.push(number("specular_rotation", &|texel| rotation(texel.grain))?);
    }
    if layers.sheen.is_some() {
        maps.push(color("sheen_color", &|texel| texel.sheen)?);
    }
    if layers.coat.is_some() {
        maps.push(number("coat", &|texel| texel.coat)?);
    }
    Ok(maps)
}

/// The rotation of the tangent in turns, 0 to 1/2. Nodes of MaterialX turn vectors clockwise, and half a turn changes nothing.
fn rotation(grain: f32) -> f32 {
    (1.0 - grain / PI) * 0.5
}

/// The document.
fn document(standard: &Standard, maps: &[Map]) -> String {
    let layers = standard.layers();
    let mut text = String::from("<?xml version=\"1.0\"?>\n<materialx version=\"1.39\" colorspace=\"lin_rec709\">\n");
    text += "  <nodegraph name=\"maps\">\n";
    for map in maps {
        let (name, kind, file, space) = (map.input, map.kind, map.file(), map.color_space());
        // writing to a string cannot fail
        let _ = write!(
            text,
            "    <image name=\"{name}_map\" type=\"{kind}\">\n      <input name=\"file\" type=\"filename\" value=\"{file}\"{space} />\n      \
             <input name=\"uaddressmode\" type=\"string\" value=\"periodic\" />\n      <input name=\"vaddressmode\" type=\"string\" value=\"periodic\" />\n    </image>\n"
        );
        if name == "normal" {
            text += "    <normalmap name=\"normal_turned\" type=\"vector3\">\n      <input name=\"in\" type=\"vector3\" nodename=\"normal_map\" />\n    </normalmap>\n";
        }
        let node = if name == "normal" { "normal_turned".into() } else { format!("{name}_map") };
        let _ = writeln!(text, "    <output name=\"{name}\" type=\"{kind}\" nodename=\"{node}\" />");
    }
    text += "  </nodegraph>\n  <standard_surface name=\"surface\" type=\"surfaceshader\">\n    <input name=\"base\" type=\"float\" value=\"1\" />\n";
    let _ = writeln!(text, "    <input name=\"specular_IOR\" type=\"float\" value=\"{}\" />", layers.ior());
    if let Some(roughness) = layers.sheen {
        text += "    <input name=\"sheen\" type=\"float\" value=\"1\" />\n";
        let _ = writeln!(text, "    <input name=\"sheen_roughness\" type=\"float\" value=\"{roughness}\" />");
    }
    if let Some(roughness) = layers.coat {
        let _ = writeln!(text, "    <input name=\"coat_roughness\" type=\"float\" value=\"{roughness}\" />");
    }
    for map in maps {
        let (name, kind) = (map.input, map.kind);
        let _ = writeln!(text, "    <input name=\"{name}\" type=\"{kind}\" nodegraph=\"maps\" output=\"{name}\" />");
    }
    text += "  </standard_surface>\n  <surfacematerial name=\"material\" type=\"material\">\n    <input name=\"surfaceshader\" type=\"surfaceshader\" nodename=\"surface\" />\n  </surfacematerial>\n</materialx>\n";
    text
}
