//! RenderMan: a surface shader in the RenderMan Shading Language, with a scene in RIB.

mod pictures;

use std::fs;
use std::path::Path;

use glam::Vec3;

use super::shader::{self, Shader};
use super::{Renderer, scene};
use crate::codec::CompressedBtf;
use crate::codec::parts::carrier;
use crate::material::Material;
use crate::output::failed;
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::{Error, Result};
use pictures::Written;

crate::words! {
    /// What the textures are.
    pub(super) enum Textures { Tiff = "tiff", Carrier = "carrier" }
}

crate::params! {
    /// Options of the export.
    pub(super) struct Settings {
        /// Textures: TIFF pictures of floating-point numbers, or 8-bit pictures that carry the bits of the numbers, for renderers that
        /// read no others.
        textures: Textures = "tiff",
        /// Write a scene for each of three ranges of the angle between view and normal, 0 to 45, to 60 and to 90 degrees, whose
        /// pictures add up to the whole: each needs only some of the textures.
        split: bool,
    }
}

/// RenderMan, with its options.
pub(super) struct RenderMan(pub Settings);

/// Without options.
pub(super) const DEFAULT: RenderMan = RenderMan(Settings { textures: Textures::Tiff, split: false });

/// The material, as loden reads it from the scene.
const MATERIAL: &str = "material.loden";

/// Ranges of the angle between view and normal, degrees, as in the thesis (7.8); the last ends beyond the horizon.
const RANGES: [[u32; 2]; 3] = [[0, 45], [45, 60], [60, 91]];

impl Renderer for RenderMan {
    fn name(&self) -> &'static str {
        "renderman"
    }

    fn doc(&self) -> &'static str {
        "RenderMan Shading Language, for Aqsis, 3Delight and PRMan up to 20: a surface shader with textures, and a scene in RIB."
    }

    fn params(&self) -> &'static [Param] {
        Settings::TABLE
    }

    fn with(&self, params: &Values) -> Result<Option<Box<dyn Renderer>>> {
        Ok(Some(Box::new(Self(Settings::from_values(params)?))))
    }

    fn takes_scenes(&self) -> bool {
        true
    }

    fn surface(&self, name: &str, material: &CompressedBtf, opened_as: &str, folder: &Path) -> Result<String> {
        let shader = Shader::single(material.path(), material)?;
        let written = Written::write(&shader_name(name), self.0.textures, &shader, material, folder)?;
        Ok(written.filled(&format!(
            "Surface \"{{SHADER}}\" \"uniform string material\" [{opened_as:?}]\n  \"uniform string numbers\" [\"{{NUMBERS}}\"] \"uniform string indices\" [\"{{INDICES}}\"] \"uniform string directions\" [\"{{DIRECTIONS}}\"]"
        )))
    }

    fn check(&self, path: &Path, material: &CompressedBtf) -> Result<()> {
        shader::check(path, material)?;
        let recipe = material.parts().recipe();
        if self.0.textures == Textures::Carrier && carrier::carried(recipe, material.meta()).is_none() {
            let problem = "the carrier has no form for its formula: it holds a dot product per view, or one table row of display values per texel; use --textures tiff";
            return Err(Error::unsupported(path, problem));
        }
        Ok(())
    }

    fn write(
        &self,
        name: &str,
        material: &CompressedBtf,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<Box<dyn Material>>> {
        let task = Task::new(progress, "export", 2);
        let shader = Shader::single(material.path(), material)?;
        task.advance(1)?;
        let written = Written::write(&shader_name(name), self.0.textures, &shader, material, folder)?;
        let own = folder.join(MATERIAL);
        if !own.exists() {
            fs::copy(material.path(), &own).map_err(failed(&own))?;
        }
        self.scenes(name, &written, folder)?;
        task.advance(1)?;
        Ok(None)
    }
}

impl RenderMan {
    /// The test scene, its parts if it is split, and the instructions.
    fn scenes(&self, name: &str, written: &Written, folder: &Path) -> Result<()> {
        let put = |file: &str, text: &str| {
            let path = folder.join(file);
            fs::write(&path, written.filled(text).replace("{name}", name)).map_err(failed(&path))
        };
        let [right, up, forward] = scene::axes();
        let column = |axis: Vec3| [axis.x, axis.y, axis.z, -axis.dot(scene::EYE)];
        let (x, y, z) = (column(right), column(up), column(forward));
        let rows: Vec<String> = (0..4).map(|k| format!("{:?} {:?} {:?} {}", x[k], y[k], z[k], k / 3)).collect();
        let [from_x, from_y, from_z] = scene::TO_LIGHT.to_array();
        let scene = include_str!("scene.rib")
            .replace("{TO_LIGHT}", &format!("[{from_x} {from_y} {from_z}]"))
            .replace("{CAMERA}", &rows.join("  "));
        let scene = scene::filled(&scene);
        put("scene.rib", &scene.replace("{RANGE}", ""))?;
        if self.0.split {
            for [least, most] in RANGES {
                let range = format!(" \"least\" [{least}] \"most\" [{most}]");
                let text = scene.replace("{RANGE}", &range).replace("ball.tif", &format!("ball_{least}.tif"));
                put(&format!("scene_{least}.rib"), &text)?;
            }
        }
        put("README.md", include_str!("README.md"))
    }
}

/// A name that the shading language allows.
fn shader_name(name: &str) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
    format!("loden_{}", name.chars().take(40).map(allowed).collect::<String>())
}
