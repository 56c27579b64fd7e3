//! Mitsuba 3: a BSDF in Python that evaluates the recipe by Dr.Jit.

use std::fs;
use std::path::Path;

use serde_json::json;

use super::tables::{check_directions, triangulated, write_directions, write_lobes, write_parts};
use super::{MANIFEST, Renderer, check_known, model_in, scene};
use crate::codec::CompressedBtf;
use crate::direction::Scheme;
use crate::material::{Blending, Material};
use crate::output::failed;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// Mitsuba 3.
pub(super) struct Mitsuba;

impl Renderer for Mitsuba {
    fn name(&self) -> &'static str {
        "mitsuba"
    }

    fn doc(&self) -> &'static str {
        "Mitsuba 3: a BSDF in Python, exact, with importance sampling, for the scalar, LLVM and CUDA variants."
    }

    fn check(&self, path: &Path, material: &CompressedBtf) -> Result<()> {
        let recipe = material.parts().recipe();
        check_known(path, &recipe.value)?;
        if let Some(model) = model_in(&recipe.value) {
            return Err(Error::unsupported(
                path,
                format!(
                    "each texel has an analytic BRDF ({model}), which the plug-in for Mitsuba does not know; compress the BTF by another method"
                ),
            ));
        }
        let meta = material.meta();
        check_directions(path, meta)?;
        // Dr.Jit counts the numbers of an array in 32 bits
        let numbers = recipe.planes.iter().map(|spec| {
            let views = if spec.per_view() { meta.views.len() } else { 1 };
            (meta.texels() * views * spec.count().next_multiple_of(4)) as u64
        });
        match numbers.max() {
            Some(count) if count > u64::from(u32::MAX) => {
                Err(Error::unsupported(path, format!("a plane has {count} numbers; Dr.Jit holds fewer than 2^32")))
            }
            _ => Ok(()),
        }
    }

    fn write(
        &self,
        name: &str,
        material: &CompressedBtf,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<Box<dyn Material>>> {
        let (meta, recipe) = (material.meta(), material.parts().recipe());
        let task = Task::new(progress, "export", 3);
        let mut triangles = Vec::new();
        for (kind, set) in [("views", &meta.views), ("lights", &meta.lights)] {
            let tables = triangulated(folder, kind, set)?;
            write_directions(kind, set, &tables, folder)?;
            triangles.push(tables.triangles);
        }
        write_parts(material, folder)?;
        task.advance(1)?;
        write_lobes(meta, &*material.material(Scheme::Triangles)?, folder)?;
        task.advance(1)?;
        let description = json!({
            "name": name,
            "loden": env!("CARGO_PKG_VERSION"),
            "btf": { "width": meta.width, "height": meta.height, "encoding": meta.encoding, "cosine": meta.cosine },
            "views": { "count": meta.views.len(), "triangles": triangles[0] },
            "lights": { "count": meta.lights.len(), "triangles": triangles[1] },
            "recipe": recipe,
            "blending": recipe.blending(Blending::Auto).name(),
        });
        let text = serde_json::to_string_pretty(&description).map_err(|e| Error::io(folder)(e.into()))? + "\n";
        let files = [
            (MANIFEST, text),
            ("loden_btf.py", include_str!("loden_btf.py").into()),
            ("scene.py", scene::filled(include_str!("scene.py"))),
            ("README.md", include_str!("README.md").replace("{name}", name)),
        ];
        for (file, text) in files {
            let path = folder.join(file);
            fs::write(&path, text).map_err(failed(&path))?;
        }
        task.advance(1)?;
        Ok(None)
    }
}
