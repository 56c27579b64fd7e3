//! three.js: a node material in its shading language, TSL.

use std::path::Path;

use super::shader::folder::{self, Layout};
use super::shader::{self, Language};
use super::{Renderer, glsl};
use crate::Result;
use crate::codec::CompressedBtf;
use crate::material::Material;
use crate::progress::Progress;

/// three.js.
///
/// The page draws by plain WebGL2: it needs no library, so that it is one small file. The node material is a module of its own for those
/// who have three.js.
pub(super) struct Three;

const LAYOUT: Layout = Layout {
    language: Language::Tsl,
    ending: "js",
    head: include_str!("head.js"),
    tail: include_str!("tail.js"),
    lights_head: None,
    page: &glsl::PAGE,
    readme: include_str!("README.md"),
};

impl Renderer for Three {
    fn name(&self) -> &'static str {
        "three"
    }

    fn doc(&self) -> &'static str {
        "A node material for three.js, for its WebGPU and WebGL2 back ends, and a page of one file that opens from disk."
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
