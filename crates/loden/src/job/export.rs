//! Exporting a material, or a scene with its materials, to another renderer.

mod scene;

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use glam::Vec3;

use super::open::label;
use crate::btf::SampleType;
use crate::codec::CompressedBtf;
use crate::codec::container::SourceInfo;
use crate::codec::parts::{MemoryParts, Provenance, store};
use crate::direction::Scheme;
use crate::import::{self, Measured};
use crate::material::{Brdf, Material};
use crate::output::{OutputDir, failed};
use crate::params::Given;
use crate::picture::Picture;
use crate::progress::Progress;
use crate::render::{Body, Camera, DirectionalLight, Environment, Scene, Settings, Shape, Sphere, TextureMap, render};
use crate::renderers::scene::{self as ball, SIDE};
use crate::renderers::{Renderer, single};
use crate::{Error, Result, codec};

/// The file of a BRDF in its export: a material of one texel.
const ONE_TEXEL: &str = "material.loden";

/// A folder that was written for another renderer.
#[derive(Debug, Serialize)]
pub struct RendererExport {
    /// Name of the renderer.
    pub renderer: &'static str,
    /// Number of files.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// The mean relative error of a BRDF that is exported as a table over directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table_error: Option<f32>,
    /// How far the renderer's material is from the original, if it is an approximation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub approximation: Option<Approximation>,
}

/// How far an approximation is from the original.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Approximation {
    /// The mean difference of apparent values, relative to their mean, over 20000 random points and pairs of cosine-distributed directions.
    pub relative_error: f32,
    /// The mean difference of the pixels of the test scene's picture, relative to their mean.
    pub picture_error: f32,
}

impl Approximation {
    /// For users.
    pub fn sentence(&self) -> String {
        format!(
            "values differ from the original by {:.1} % of their mean (20000 random points and directions), pixels of the ball by {:.1} %",
            100.0 * self.relative_error,
            100.0 * self.picture_error
        )
    }
}

/// Writes a material as a folder for `renderer`; the folder must be empty or not exist. `input` is a compressed BTF, any BRDF, or a scene file: an
/// analytic model that the renderer has is exported by its parameters, any other BRDF as a table. The options are those of the renderer,
/// and of a BRDF file that leaves conventions unstated.
///
/// # Errors
/// Errors of opening the file; [`Error::Unsupported`] if the renderer cannot show such a material, and for a BTF that is not
/// compressed; [`Error::Exists`]; [`Error::Io`]; [`Error::Cancelled`]. Nothing is left behind.
pub fn export_to(
    input: &Path,
    options: &Given,
    renderer: &dyn Renderer,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<RendererExport> {
    let (own, reading) = options.split(renderer.params());
    let chosen = renderer.with(&own.values(renderer.params())?)?;
    let renderer = chosen.as_deref().unwrap_or(renderer);
    if scene::is_scene(input) {
        return scene::export(input, &reading, renderer, folder, progress);
    }
    let (_, measured) = import::open_material(input, &reading)?;
    measured.warnings().iter().for_each(|warning| progress.warn(warning));
    let output = OutputDir::create(folder)?;
    let (material, table_error) = match measured {
        Measured::Compressed(material) => (material, None),
        Measured::Btf(_) => {
            return Err(Error::unsupported(input, "exports are made of compressed BTFs: use loden compress first"));
        }
        Measured::Brdf(brdf) => of_brdf(input, &*brdf, renderer, &output.folder().join(ONE_TEXEL), progress)?,
    };
    renderer.check(input, &material)?;
    let approximated = renderer.write(&label(input), &material, output.folder(), progress)?;
    let original = material.material(Scheme::Triangles)?;
    let picture = test_picture(&*original, &label(input), progress)?;
    let approximation = match &approximated {
        Some(other) => {
            let shown = test_picture(&**other, &label(input), progress)?;
            shown.write(output.folder().join(ball::PICTURE))?;
            side_by_side(&picture, &shown).write(output.folder().join(ball::COMPARISON))?;
            let loss = Approximation {
                relative_error: single::difference(&*original, &**other),
                picture_error: picture_error(&picture, &shown),
            };
            append(&output.folder().join("README.md"), &format!("What is lost: {}.\n", loss.sentence()))?;
            Some(loss)
        }
        None => {
            picture.write(output.folder().join(ball::PICTURE))?;
            None
        }
    };
    finished(output, renderer, table_error, approximation)
}

/// Makes the folder visible, and counts its files.
fn finished(
    output: OutputDir,
    renderer: &dyn Renderer,
    table_error: Option<f32>,
    approximation: Option<Approximation>,
) -> Result<RendererExport> {
    let folder = output.folder();
    let written = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let sizes = written.map(|entry| Ok(entry?.metadata()?.len())).collect::<std::io::Result<Vec<u64>>>();
    let sizes = sizes.map_err(Error::io(folder))?;
    output.commit()?;
    Ok(RendererExport {
        renderer: renderer.name(),
        files: sizes.len(),
        bytes: sizes.iter().sum(),
        table_error,
        approximation,
    })
}

/// A BRDF as a material of one texel, stored at `path`, and its mean relative error if it had to be tabulated.
fn of_brdf(
    input: &Path,
    brdf: &dyn Brdf,
    renderer: &dyn Renderer,
    path: &Path,
    progress: &dyn Progress,
) -> Result<(Arc<CompressedBtf>, Option<f32>)> {
    let stored = |parts: &MemoryParts| {
        let source = SourceInfo { bytes: 0, sample_type: SampleType::F32, missing: Vec::new(), identity: None };
        store(parts, &Provenance::unknown(source), path)?;
        codec::open(path)
    };
    let model = import::analytic(input)?;
    if let Some(parts) = model.map(|model| single::of_model(&model)).transpose()?.flatten() {
        let exact = stored(&parts)?;
        if renderer.check(input, &exact).is_ok() {
            return Ok((exact, None));
        }
    }
    // replaces what was stored by a model that the renderer does not have
    let table = stored(&single::tabulated(brdf, progress)?)?;
    let error = single::difference(brdf, &*table.material(Scheme::Triangles)?);
    Ok((table, Some(error)))
}

/// Two pictures of one size in one.
fn side_by_side(left: &Picture, right: &Picture) -> Picture {
    let rows = left.rgb.chunks_exact(left.width).zip(right.rgb.chunks_exact(right.width));
    let rgb = rows.flat_map(|(left, right)| [left, right].concat()).collect();
    Picture { width: left.width + right.width, height: left.height, rgb }
}

/// The mean difference of pixels, relative to the mean of the first picture.
fn picture_error(original: &Picture, other: &Picture) -> f32 {
    let pixels = original.rgb.iter().zip(&other.rgb);
    let sums = pixels.fold([0.0f64; 2], |[difference, whole], (a, b)| {
        [difference + f64::from((*a - *b).abs().element_sum()), whole + f64::from(a.element_sum())]
    });
    (sums[0] / sums[1].max(1e-30)) as f32
}

/// Adds a line to a text file.
fn append(path: &Path, line: &str) -> Result<()> {
    let mut file = std::fs::OpenOptions::new().append(true).open(path).map_err(failed(path))?;
    file.write_all(line.as_bytes()).map_err(failed(path))
}

/// Samples per pixel of the picture of the test scene.
const SAMPLES: u32 = 16;

/// Our picture of the test scene, which the exported one should equal.
fn test_picture(material: &dyn Material, name: &str, progress: &dyn Progress) -> Result<Picture> {
    let ball = Body {
        shape: Shape::Sphere(Sphere { centre: Vec3::ZERO, radius: 1.0, axis: Vec3::Z }),
        material,
        material_name: name.into(),
        texture: TextureMap { scale: ball::REPEATS, ..TextureMap::default() },
    };
    let light = DirectionalLight {
        direction: ball::TO_LIGHT.normalize(),
        irradiance: Vec3::splat(ball::IRRADIANCE),
        radius_degrees: 0.0,
    };
    let camera = Camera { up: Vec3::Z, ..Camera::pinhole(ball::EYE, Vec3::ZERO, ball::FIELD_OF_VIEW) };
    let scene = Scene {
        bodies: vec![ball],
        lights: vec![light.into()],
        environment: Environment::Dark,
        background: None,
        camera,
    };
    let settings = Settings { width: SIDE, height: SIDE, spp: SAMPLES, depth: 2, ..Settings::default() };
    render(&scene, &settings, progress)
}
