//! Exporting a scene with its materials.

use std::fs;
use std::path::Path;

use glam::DVec3;

use super::{RendererExport, finished, of_brdf};
use crate::import::{self, IMPORTERS, Measured};
use crate::model::Analytic;
use crate::output::{OutputDir, failed};
use crate::params::Given;
use crate::progress::Progress;
use crate::render::scene_file::{EXTENSIONS, SceneFile};
use crate::render::{Settings, render};
use crate::renderers::Renderer;
use crate::{Error, Result};

/// The exported scene, and our picture of it.
const SCENE: &str = "scene.rib";
const PICTURE: &str = "scene.png";

/// Longer side and samples of the picture, at most.
const LONGER_SIDE: usize = 320;
const SAMPLES: u32 = 16;

/// Whether a path is that of a scene file; measurements may be described by files of the same ending.
pub(super) fn is_scene(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let named = EXTENSIONS.iter().any(|extension| name.ends_with(&format!(".{extension}"))) && path.is_file();
    named && !IMPORTERS.iter().any(|importer| importer.recognises(path).unwrap_or(false))
}

/// Writes a scene with its materials as a folder for `renderer`. Lambertian surfaces and Blinn-Phong highlights in their original form
/// become the interface's own shaders, other materials shaders of ours.
pub(super) fn export(
    input: &Path,
    options: &Given,
    renderer: &dyn Renderer,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<RendererExport> {
    if !renderer.takes_scenes() {
        return Err(Error::unsupported(input, format!("{} takes materials, not scenes", renderer.name())));
    }
    let scene = SceneFile::open(input)?;
    scene.warnings.iter().for_each(|warning| progress.warn(warning));
    let output = OutputDir::create(folder)?;
    let (mut surfaces, mut error) = (Vec::new(), None::<f32>);
    for (number, material) in scene.materials.iter().enumerate() {
        let source = material.source.as_ref().ok_or_else(|| {
            let problem = format!(
                "{}: a surface that emits light, lets it through or is painted cannot be exported",
                material.name
            );
            Error::unsupported(input, problem)
        })?;
        let (surface, lost) = self::surface(source, number, options, renderer, output.folder(), progress)?;
        surfaces.push(surface);
        error = [error, lost].into_iter().flatten().reduce(f32::max);
    }
    let text = scene.to_rib(&surfaces).map_err(|error| match error {
        Error::Parameter { name, problem } => Error::unsupported(input, format!("{name}: {problem}")),
        other => other,
    })?;
    let put = |file: &str, text: &str| {
        let path = output.folder().join(file);
        fs::write(&path, text).map_err(failed(&path))
    };
    put(SCENE, &text)?;
    put("README.md", &include_str!("scene.md").replace("{RENDERER}", renderer.name()))?;
    let longer = scene.settings.width.max(scene.settings.height).max(1);
    let side = |side: usize| (side * LONGER_SIDE.min(longer) / longer).max(1);
    let settings = Settings {
        width: side(scene.settings.width),
        height: side(scene.settings.height),
        spp: scene.settings.spp.min(SAMPLES),
        ..scene.settings
    };
    render(&scene.scene(), &settings, progress)?.write(output.folder().join(PICTURE))?;
    finished(output, renderer, error, None)
}

/// The requests that assign a material, whose files are written, and its relative error if it had to be tabulated.
fn surface(
    source: &str,
    number: usize,
    options: &Given,
    renderer: &dyn Renderer,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<(String, Option<f32>)> {
    let path = Path::new(source);
    if let Some(analytic) = import::analytic(path)?
        && let Some(request) = standard(&analytic)?
    {
        return Ok((request, None));
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_string();
    let name = format!("{number}_{}", stem.split(':').next().unwrap_or_default());
    let own = format!("material{number}.loden");
    let (_, measured) = import::open_material(path, options)?;
    let (material, error, opened_as) = match measured {
        Measured::Compressed(material) => {
            let copy = folder.join(&own);
            fs::copy(material.path(), &copy).map_err(failed(&copy))?;
            (material, None, own)
        }
        Measured::Btf(_) => {
            return Err(Error::unsupported(path, "exports are made of compressed BTFs: use loden compress first"));
        }
        Measured::Brdf(brdf) => {
            let (material, error) = of_brdf(path, &*brdf, renderer, &folder.join(&own), progress)?;
            // an analytic model is exact for us, even if it is a table for others
            (material, error, if import::is_model(path) { source.to_owned() } else { own })
        }
    };
    renderer.check(path, &material)?;
    Ok((renderer.surface(&name, &material, &opened_as, folder)?, error))
}

/// The interface's own shader for a model, if it has one.
///
/// # Model
/// `matte` is Kd Cs / pi; `plastic` is Kd Cs / pi + Ks specularcolor / pi (n . h)^(1 / roughness) / (n . l).
fn standard(analytic: &Analytic) -> Result<Option<String>> {
    let color = |name: &str| analytic.values().get::<[f64; 3]>(name);
    let triple = |[r, g, b]: [f64; 3]| format!("[{} {} {}]", r as f32, g as f32, b as f32);
    Ok(match analytic.model().name() {
        "lambert" => Some(format!("Color {}\nSurface \"matte\"", triple(color("kd")?))),
        "blinn-phong" if analytic.values().written("form")? == "original" => {
            let specular = DVec3::from(color("ks")?) * std::f64::consts::PI;
            let roughness = 1.0 / analytic.values().get::<f64>("exponent")?;
            Some(format!(
                "Color {}\nSurface \"plastic\" \"float Kd\" [1] \"float Ks\" [1] \"color specularcolor\" {} \"float roughness\" [{}]",
                triple(color("kd")?),
                triple(specular.to_array()),
                roughness as f32
            ))
        }
        _ => None,
    })
}
