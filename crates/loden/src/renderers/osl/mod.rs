//! Open Shading Language, for Cycles on the CPU: the material for one distant light.

use std::fs;
use std::path::Path;

use exr::image::{Encoding, Image, Layer, SpecificChannels};
use exr::meta::attribute::LineOrder;
use exr::prelude::{LayerAttributes, WritableImage};
use half::f16;

use super::shader::{self, Bank, Format, Language, Shader};
use super::{Renderer, scene};
use crate::codec::CompressedBtf;
use crate::material::Material;
use crate::output::failed;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// Open Shading Language.
pub(super) struct Osl;

impl Renderer for Osl {
    fn name(&self) -> &'static str {
        "osl"
    }

    fn doc(&self) -> &'static str {
        "Open Shading Language, for Blender's Cycles on the CPU: exact for one distant light, with a script that makes the nodes."
    }

    fn check(&self, path: &Path, material: &CompressedBtf) -> Result<()> {
        shader::check(path, material)
    }

    fn write(
        &self,
        name: &str,
        material: &CompressedBtf,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<Box<dyn Material>>> {
        let task = Task::new(progress, "export", 2);
        let shader = Shader::new(material.path(), material)?;
        task.advance(1)?;
        let functions = shader.functions(Language::Osl, include_str!("head.osl"), include_str!("tail.osl"));
        // a string of Python has the escapes of JSON
        let quoted = serde_json::Value::from(name).to_string();
        let files = [
            ("material.osl", functions),
            ("loden_material.py", include_str!("loden_material.py").replace("{NAME}", &quoted)),
            ("scene.py", scene::filled(include_str!("scene.py"))),
            ("README.md", shader.loss.filled(&include_str!("README.md").replace("{name}", name))),
        ];
        for (file, text) in files {
            let path = folder.join(file);
            fs::write(&path, text).map_err(failed(&path))?;
        }
        for bank in &shader.banks {
            texture(bank, &folder.join(format!("{}.exr", bank.name)))?;
        }
        task.advance(1)?;
        Ok(None)
    }
}

/// Writes numbers as an EXR picture of four channels, the layers one below the other. Bytes, as fractions of 255, have half precision too.
fn texture(bank: &Bank, path: &Path) -> Result<()> {
    let [width, height, layers] = bank.size();
    let size = (width, height * layers);
    let texel = |at: exr::math::Vec2<usize>| bank.texel(at.y() * width + at.x());
    // otherwise blocks are stored in the order in which threads finish them
    let encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::SMALL_FAST_LOSSLESS };
    let problem = |error: exr::error::Error| Error::invalid(path, "EXR", error.to_string());
    if bank.format == Format::Single {
        let channels = SpecificChannels::rgba(|at| texel(at).into());
        let image = Image::from_layer(Layer::new(size, LayerAttributes::default(), encoding, channels));
        return image.write().to_file(path).map_err(problem);
    }
    let channels = SpecificChannels::rgba(|at| <(f16, f16, f16, f16)>::from(texel(at).map(f16::from_f32)));
    let image = Image::from_layer(Layer::new(size, LayerAttributes::default(), encoding, channels));
    image.write().to_file(path).map_err(problem)
}
