//! WGSL, for WebGPU.

use std::path::Path;

use super::Renderer;
use super::shader::folder::{self, Layout, Page};
use super::shader::{self, Language};
use crate::Result;
use crate::codec::CompressedBtf;
use crate::material::Material;
use crate::progress::Progress;

/// WGSL, for WebGPU.
pub(super) struct Wgsl;

const HEAD: &str = include_str!("head.wgsl");
const LIGHTS: &str = include_str!("lights.wgsl");

/// A page that draws by WebGPU.
pub(super) const PAGE: Page =
    Page { language: Language::Wgsl, head: HEAD, lights_head: LIGHTS, engine: include_str!("../shader/webgpu.js") };

const LAYOUT: Layout = Layout {
    language: Language::Wgsl,
    ending: "wgsl",
    head: HEAD,
    tail: "",
    lights_head: Some(LIGHTS),
    page: &PAGE,
    readme: include_str!("README.md"),
};

impl Renderer for Wgsl {
    fn name(&self) -> &'static str {
        "wgsl"
    }

    fn doc(&self) -> &'static str {
        "Shader functions in WGSL, for WebGPU, with array textures in half precision and a page that shows the material."
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
