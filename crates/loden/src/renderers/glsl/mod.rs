//! GLSL ES 3.00, for WebGL2 and OpenGL ES 3.

use std::path::Path;

use super::Renderer;
use super::shader::folder::{self, Layout, Page};
use super::shader::{self, Language};
use crate::Result;
use crate::codec::CompressedBtf;
use crate::material::Material;
use crate::progress::Progress;

/// GLSL ES 3.00, for WebGL2 and OpenGL ES 3.
pub(super) struct Glsl;

const HEAD: &str = include_str!("head.glsl");
const LIGHTS: &str = include_str!("lights.glsl");

/// A page that draws by WebGL2.
pub(super) const PAGE: Page =
    Page { language: Language::Glsl, head: HEAD, lights_head: LIGHTS, engine: include_str!("../shader/webgl.js") };

const LAYOUT: Layout = Layout {
    language: Language::Glsl,
    ending: "glsl",
    head: HEAD,
    tail: "",
    lights_head: Some(LIGHTS),
    page: &PAGE,
    readme: include_str!("README.md"),
};

impl Renderer for Glsl {
    fn name(&self) -> &'static str {
        "glsl"
    }

    fn doc(&self) -> &'static str {
        "Shader functions in GLSL ES 3.00, for WebGL2 and OpenGL ES 3, with array textures in half precision and a page that shows the material."
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
        folder::write(&LAYOUT, name, material, folder, progress).map(|()| None)
    }
}
