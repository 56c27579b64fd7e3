//! Reader of glTF 2.0 files, JSON or binary.

use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::Path;

use glam::{Mat4, Vec2, Vec3, Vec4};
use gltf::mesh::Mode;

use crate::render::MeshData;
use crate::{Error, Result};

/// Maximum nesting depth of nodes.
const MAX_DEPTH: usize = 256;

/// Reads the triangles of the default scene, or of the first, with node transforms applied. Materials, skins and
/// animations are ignored; only the first set of texture coordinates is used.
pub(super) fn read(path: &Path) -> Result<(MeshData, Vec<String>)> {
    let file = BufReader::new(File::open(path).map_err(Error::io(path))?);
    let gltf = gltf::Gltf::from_reader(file).map_err(|e| located(path, e))?;
    let base = path.parent();
    let buffers = gltf::import_buffers(&gltf.document, base, gltf.blob).map_err(|e| located(path, e))?;
    let mut reader = Reader { path, buffers, data: MeshData::default(), warnings: Vec::new() };
    let scene = gltf.document.default_scene().or_else(|| gltf.document.scenes().next());
    let scene = scene.ok_or_else(|| Error::invalid(path, "scenes", "the file has no scene"))?;
    for node in scene.nodes() {
        reader.node(&node, Mat4::IDENTITY, 0)?;
    }
    if reader.data.triangles.is_empty() {
        return Err(Error::invalid(path, "scene", "the scene has no triangles"));
    }
    Ok((reader.data, reader.warnings))
}

fn located(path: &Path, error: gltf::Error) -> Error {
    match error {
        gltf::Error::Io(source) if source.kind() != ErrorKind::UnexpectedEof => Error::io(path)(source),
        gltf::Error::UnsupportedScheme => Error::unsupported(path, "a buffer is neither a file nor embedded"),
        other => Error::invalid(path, "glTF", other.to_string()),
    }
}

struct Reader<'a> {
    path: &'a Path,
    buffers: Vec<gltf::buffer::Data>,
    data: MeshData,
    warnings: Vec<String>,
}

impl Reader<'_> {
    fn node(&mut self, node: &gltf::Node, parent: Mat4, depth: usize) -> Result<()> {
        let name = format!("node {}", node.name().map_or(node.index().to_string(), String::from));
        if depth > MAX_DEPTH {
            return Err(Error::invalid(self.path, name, "nodes form a cycle or are nested too deeply"));
        }
        let transform = parent * Mat4::from_cols_array_2d(&node.transform().matrix());
        if let Some(mesh) = node.mesh() {
            for primitive in mesh.primitives() {
                if primitive.mode() != Mode::Triangles {
                    let what =
                        format!("{}: {name}: ignored a primitive of mode {:?}", self.path.display(), primitive.mode());
                    self.warnings.push(what);
                    continue;
                }
                let part = self.primitive(&primitive, &name)?;
                self.data.append(&part, transform).map_err(|e| Error::invalid(self.path, &name, e.to_string()))?;
            }
        }
        node.children().try_for_each(|child| self.node(&child, transform, depth + 1))
    }

    fn primitive(&self, primitive: &gltf::Primitive, name: &str) -> Result<MeshData> {
        let bad = |problem: &str| Error::invalid(self.path, name, problem);
        self.check_accessors(primitive, name)?;
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(|b| &b.0[..]));
        let positions: Vec<Vec3> =
            reader.read_positions().ok_or_else(|| bad("a primitive has no positions"))?.map(Vec3::from).collect();
        let count = u32::try_from(positions.len()).map_err(|_| bad("a primitive has more than 2^32 vertices"))?;
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..count).collect(),
        };
        if let Some(index) = indices.iter().find(|&&i| i >= count) {
            return Err(bad(&format!("found vertex index {index}, but there are {count} vertices")));
        }
        // In glTF v points down.
        let uv = |uv: [f32; 2]| Vec2::new(uv[0], 1.0 - uv[1]);
        Ok(MeshData {
            normals: reader.read_normals().map(|n| n.map(Vec3::from).collect()).unwrap_or_default(),
            // Flipping v flips the handedness.
            tangents: reader
                .read_tangents()
                .map(|t| t.map(|[x, y, z, w]| Vec4::new(x, y, z, -w)).collect())
                .unwrap_or_default(),
            uvs: reader.read_tex_coords(0).map(|t| t.into_f32().map(uv).collect()).unwrap_or_default(),
            triangles: indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            positions,
        })
    }

    /// Checks that accessors lie within their buffers; the readers of the gltf crate do not.
    fn check_accessors(&self, primitive: &gltf::Primitive, name: &str) -> Result<()> {
        let accessors = primitive.attributes().map(|(_, accessor)| accessor).chain(primitive.indices());
        for accessor in accessors {
            let wrong = |problem: &str| {
                Err(Error::invalid(self.path, name, format!("accessor {}: {problem}", accessor.index())))
            };
            if accessor.sparse().is_some() {
                return Err(Error::unsupported(self.path, format!("{name}: sparse accessors are not supported")));
            }
            let Some(view) = accessor.view() else { return wrong("it has no buffer view") };
            let stride = view.stride().unwrap_or(accessor.size());
            if stride < accessor.size() {
                return wrong("the stride is smaller than an element");
            }
            let last = accessor.count().saturating_sub(1).saturating_mul(stride);
            let end = last.saturating_add(accessor.size()).saturating_add(accessor.offset());
            let buffer = self.buffers.get(view.buffer().index()).map_or(0, |b| b.0.len());
            if end > view.length() || view.offset().saturating_add(view.length()) > buffer {
                return wrong("it extends beyond its buffer");
            }
        }
        Ok(())
    }
}
