//! Materials of glTF files: the base colour and its texture.

use std::path::{Path, PathBuf};

use super::json::{Image, Material, Root};
use super::{buffer, get};
use crate::render::object::MeshPaint;
use crate::{Error, Result};

/// Reads the materials; the first is that of primitives without one.
pub(in crate::render::object) fn paints(path: &Path) -> Result<(Vec<MeshPaint>, Vec<String>)> {
    let (root, binary) = buffer::split(path)?;
    let reader = Reader { path, root: &root, binary };
    let all = root.materials.iter().enumerate().map(|(k, material)| reader.paint(material, &format!("material {k}")));
    let all = [Ok(MeshPaint::default())].into_iter().chain(all);
    Ok((all.collect::<Result<_>>()?, Vec::new()))
}

struct Reader<'a> {
    path: &'a Path,
    root: &'a Root,
    binary: Option<Vec<u8>>,
}

impl Reader<'_> {
    fn paint(&self, material: &Material, field: &str) -> Result<MeshPaint> {
        let surface = &material.pbr_metallic_roughness;
        let [r, g, b, _] = surface.base_color_factor.unwrap_or([1.0; 4]);
        if ![r, g, b].iter().all(|v| v.is_finite()) {
            return Err(Error::invalid(self.path, field, "its base colour is not finite"));
        }
        let texture = match &surface.base_color_texture {
            Some(used) => {
                let texture = get(self.path, &format!("{field}: texture"), &self.root.textures, used.index)?;
                let missing =
                    || Error::unsupported(self.path, format!("{field}: its texture has no picture of a known kind"));
                let image = texture.source.ok_or_else(missing)?;
                let name = format!("{field}: image");
                Some(self.image(get(self.path, &name, &self.root.images, image)?, image)?)
            }
            None => None,
        };
        Ok(MeshPaint { albedo: [r, g, b], texture })
    }

    /// The name and the content of a picture file, which may be embedded.
    fn image(&self, image: &Image, index: usize) -> Result<(PathBuf, Vec<u8>)> {
        let field = format!("image {index}");
        if let Some(uri) = &image.uri {
            return buffer::file(self.path, &field, uri, 0);
        }
        let wrong = |problem: &str| Error::invalid(self.path, &field, problem);
        let view = image.buffer_view.ok_or_else(|| wrong("it has no content"))?;
        let view = get(self.path, &format!("{field}: buffer view"), &self.root.buffer_views, view)?;
        let buffer = get(self.path, &format!("{field}: buffer"), &self.root.buffers, view.buffer)?;
        let loaded;
        let bytes = match &self.binary {
            Some(binary) if view.buffer == 0 && buffer.uri.is_none() => binary,
            _ => {
                loaded = buffer::load(self.path, view.buffer, buffer)?;
                &loaded
            }
        };
        let range = view.byte_offset..view.byte_offset.saturating_add(view.byte_length);
        let content = bytes.get(range).ok_or_else(|| wrong("it exceeds its buffer"))?;
        Ok((self.path.into(), content.to_vec()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::object;

    #[test]
    fn base_colours_and_embedded_textures_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.gltf");
        // three positions and the bytes of a picture: base64 of 36 zeros and "picture!"
        let buffer = "data:;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAcGljdHVyZSE=";
        let primitive = |material: &str| format!(r#"{{"attributes":{{"POSITION":0}}{material}}}"#);
        let primitives = [primitive(""), primitive(r#","material":1"#)].join(",");
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{primitives}]}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":8}}],
            "buffers":[{{"uri":"{buffer}","byteLength":44}}],"images":[{{"bufferView":1}}],"textures":[{{"source":0}}],
            "materials":[{{}},{{"pbrMetallicRoughness":{{"baseColorFactor":[0.5,0.25,0,1],"baseColorTexture":{{"index":0}}}}}}]}}"#
        );
        std::fs::write(&path, &text).unwrap();
        assert_eq!(object::read(&path).unwrap().painted, [0, 2]);
        let (paints, _) = object::paints(&path).unwrap();
        assert_eq!(paints[..2], [MeshPaint::default(), MeshPaint { albedo: [1.0; 3], texture: None }]);
        assert_eq!(paints[2].albedo, [0.5, 0.25, 0.0]);
        assert_eq!(paints[2].texture.as_ref().unwrap().1, b"picture!");
        for (from, to, problem) in [
            (r#""byteOffset":36"#, r#""byteOffset":40"#, "image 0: it exceeds its buffer"),
            (r#""source":0"#, r#""source":7"#, "there are 1 of them"),
            (r#"{"source":0}"#, "{}", "no picture of a known kind"),
        ] {
            std::fs::write(&path, text.replace(from, to)).unwrap();
            let error = object::paints(&path).unwrap_err().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }
}
