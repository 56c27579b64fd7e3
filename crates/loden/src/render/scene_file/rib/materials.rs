//! Materials of the current surface and colour.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;

use super::attributes::{Interface, Surface};
use super::request::{Fault, Step};
use super::shaded::{Kind, Look, Shade};
use super::surface::Translated;
use super::{Reader, bxdf, surface, texture_map};
use crate::import;
use crate::material::{Blending, Interpolation};
use crate::picture::Picture;
use crate::render::TextureMap;
use crate::render::scene_file::SceneMaterial;

/// Endings of pictures that may stand for one that is missing or of another format.
const ENDINGS: &[&str] = &["tif", "tiff", "exr", "png", "jpg", "jpeg", "hdr", "bmp"];

/// What a shape overrides of the current attributes.
#[derive(Clone, Default)]
pub(super) struct Own {
    pub color: Option<Vec3>,
    pub opacity: Option<Vec3>,
    /// Colours over the shape, by its texture coordinates.
    pub paint: Option<Arc<Picture>>,
}

impl Reader {
    /// Whether the current surface is a measured material, which has its own colours: `loden`, or a shader that was exported.
    pub(super) fn is_measured(&self) -> bool {
        let Surface { interface, name, parameters, .. } = &self.attributes.surface;
        let exported = name.starts_with("loden_") && parameters.get("material").is_some();
        *interface == Interface::Shader && (name == "loden" || exported)
    }

    /// The index of the material for the current surface and colour, and its texture map.
    pub(super) fn material(&mut self, own: &Own) -> Step<(usize, TextureMap)> {
        let Surface { interface, name, parameters, file, world_from_surface, .. } = self.attributes.surface.clone();
        let color = own.color.unwrap_or(if own.paint.is_some() { Vec3::ONE } else { self.attributes.color });
        let opacity = own.opacity.unwrap_or(self.attributes.opacity);
        let emitted = self.attributes.emitted;
        // Only a mapping depends on the coordinates of the surface.
        let coordinates = parameters.get("mapping").map(|_| world_from_surface);
        let paint = own.paint.as_ref().map(Arc::as_ptr);
        let patterns = Arc::as_ptr(&self.attributes.patterns);
        let key = format!(
            "{interface:?} {name} {parameters:?} {color} {opacity} {emitted:?} {} {coordinates:?} {paint:?} {patterns:?}",
            file.display()
        );
        if let Some(found) = self.materials.get(&key) {
            return Ok(*found);
        }
        let mut texture = TextureMap::default();
        let shade = if let Some(radiance) = emitted {
            Shade { name: "area light".into(), kind: Kind::Shader(Look::emitting(radiance)), opacity }
        } else if self.is_measured() {
            texture = texture_map::texture_map(&parameters, world_from_surface).map_err(Fault::Stop)?;
            let (name, kind) = self.measured(&file)?;
            Shade { name, kind, opacity }
        } else {
            let look = self.look(color, own.paint.clone());
            Shade { name, kind: Kind::Shader(look), opacity }
        };
        let found = (self.shades.len(), texture);
        self.shades.push(shade);
        // keeps the addresses in the key from being used again
        self.kept_paints.extend(own.paint.clone());
        self.kept_patterns.push(self.attributes.patterns.clone());
        self.materials.insert(key, found);
        Ok(found)
    }

    fn measured(&mut self, scene: &Path) -> Step<(String, Kind)> {
        let parameters = &self.attributes.surface.parameters;
        let missing = || Fault::Stop("Surface \"loden\" has no \"string material\"".into());
        let file = parameters.text("material").ok_or_else(missing)?;
        let how = Interpolation::of_words(
            parameters.text("interpolation").unwrap_or("triangles"),
            parameters.text("blending").unwrap_or(Blending::Auto.name()),
        )
        .map_err(|error| Fault::Stop(error.to_string()))?;
        let folder = folder_of(scene);
        let found = self.archives_path.find(file, folder).unwrap_or_else(|| folder.join(file));
        let file = import::in_scene(Path::new(file), found);
        // the request at which it is opened is that of the first shape
        let line = self.attributes.surface.line;
        let wrong = |e: crate::Error| Fault::Stop(format!("the Surface of line {line}: {e}"));
        let material = self.scene.open_material(&file, how, None).map_err(wrong)?;
        Ok((file.display().to_string(), Kind::Measured(material)))
    }

    /// The look of a shader; warns once of what is unknown.
    fn look(&mut self, color: Vec3, paint: Option<Arc<Picture>>) -> Look {
        let Surface { interface, name, parameters, line, file, .. } = self.attributes.surface.clone();
        let translated = match interface {
            Interface::Bxdf => bxdf::translate(&name, &parameters, &self.attributes.patterns, color),
            _ => surface::translate(&name, &parameters, color),
        };
        let Translated { mut look, texture, known } = translated;
        if !known {
            let what = if interface == Interface::Bxdf { "Bxdf" } else { "Surface" };
            self.note(
                format!("{what} {name:?} is unknown: its parameters are read as those of matte or plastic"),
                line,
                &file,
            );
        }
        look.paint = paint;
        if let (Some(texture), None) = (texture, &look.paint) {
            match self.texture(&texture, &file) {
                Ok(picture) => look.paint = Some(picture),
                Err(problem) => self.note(format!("the texture {texture:?} is not used: {problem}"), line, &file),
            }
        }
        look
    }

    /// The picture of a texture file; read once.
    fn texture(&mut self, name: &str, scene: &Path) -> Result<Arc<Picture>, String> {
        let file = self.find_picture(name, scene).ok_or("it is missing")?;
        if let Some(known) = self.textures.get(&file) {
            return known.clone();
        }
        let read = Picture::read(&file, &mut self.scene.warnings).map(Arc::new).map_err(|e| e.to_string());
        self.textures.insert(file, read.clone());
        read
    }

    /// Finds a picture, or one of another format beside it.
    pub(super) fn find_picture(&self, name: &str, scene: &Path) -> Option<PathBuf> {
        let folder = folder_of(scene);
        let find = |name: &str| {
            let other = || self.archives_path.find(name, folder);
            self.textures_path.find(name, folder).or_else(other)
        };
        // A renderer's own format of textures cannot be read if the original is there.
        let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        let is_own = !ENDINGS.iter().any(|ending| name.to_lowercase().ends_with(&format!(".{ending}")));
        let others = || ENDINGS.iter().find_map(|ending| find(&format!("{stem}.{ending}")));
        if is_own { others().or_else(|| find(name)) } else { find(name).or_else(others) }
    }

    /// Makes the materials under the lights of the world.
    pub(super) fn make_materials(&mut self, ambient: Option<Vec3>) -> Result<(), String> {
        for shade in &self.shades {
            let (name, (material, source)) = (shade.name.clone(), shade.material(ambient)?);
            self.scene.materials.push(SceneMaterial { name, material, source });
        }
        Ok(())
    }
}

/// The folder of a file.
pub(super) fn folder_of(file: &Path) -> &Path {
    file.parent().unwrap_or(Path::new(""))
}
