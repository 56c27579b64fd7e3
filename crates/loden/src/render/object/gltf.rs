//! Reader of glTF 2.0 files, JSON or binary.
//!
//! Read are the triangles, strips and fans of one scene, with the transforms of its nodes; quantised and sparse accessors
//! too; of materials the base colour and its texture, where they are asked for. Extensions of materials are ignored. Points, lines, skins, morph targets and instances of
//! `EXT_mesh_gpu_instancing` are ignored with a warning; meshes compressed by Draco or meshopt are refused.

mod accessor;
mod buffer;
mod json;
mod paint;

use std::path::Path;

use glam::{DMat3, DMat4, DVec3, Vec2};

use self::accessor::Accessors;
use self::json::{Node, Primitive, Root};
pub(super) use self::paint::paints;
use super::polygons::Polygons;
use crate::render::mesh::MAX_TRIANGLES;
use crate::{Error, Result};

/// Maximum nesting depth of nodes.
const MAX_DEPTH: usize = 256;

/// Beginnings of the names of extensions that a file may require: they change how a scene looks, not its shape.
const HARMLESS: [&str; 15] = [
    "ADOBE_materials_",
    "AGI_articulations",
    "EXT_lights_",
    "EXT_materials_",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_",
    "KHR_materials_",
    "KHR_mesh_quantization",
    "KHR_texture_",
    "KHR_xmp",
    "MSFT_texture_",
];

/// Reads the triangles of the default scene, or of the first; of all nodes if there is none.
pub(super) fn read(path: &Path) -> Result<Polygons> {
    let (root, binary) = buffer::split(path)?;
    for name in &root.extensions_required {
        if !HARMLESS.iter().any(|harmless| name.starts_with(harmless)) {
            return Err(Error::unsupported(
                path,
                format!("the file requires the extension {name}, which is not supported"),
            ));
        }
    }
    let mut polygons = Polygons::default();
    let first: Vec<usize> = match root.scene.or((!root.scenes.is_empty()).then_some(0)) {
        Some(scene) => get(path, "scene", &root.scenes, scene)?.nodes.clone(),
        None if root.nodes.is_empty() => return Err(Error::invalid(path, "scenes", "the file has no scene")),
        None => {
            polygons.warnings.push("the file has no scene; all its nodes are read".into());
            let is_child = |index: &usize| root.nodes.iter().any(|node| node.children.contains(index));
            (0..root.nodes.len()).filter(|index| !is_child(index)).collect()
        }
    };
    let accessors = Accessors::new(path, &root, binary);
    let mut reader = Reader { path, root: &root, accessors, visited: vec![false; root.nodes.len()], polygons };
    for node in first {
        reader.node(node, DMat4::IDENTITY, 0)?;
    }
    Ok(reader.polygons)
}

/// The element of a list of the file.
fn get<'a, T>(path: &Path, what: &str, list: &'a [T], index: usize) -> Result<&'a T> {
    let missing = || Error::invalid(path, format!("{what} {index}"), format!("there are {} of them", list.len()));
    list.get(index).ok_or_else(missing)
}

struct Reader<'a> {
    path: &'a Path,
    root: &'a Root,
    accessors: Accessors<'a>,
    visited: Vec<bool>,
    polygons: Polygons,
}

impl Reader<'_> {
    fn node(&mut self, index: usize, parent: DMat4, depth: usize) -> Result<()> {
        let node = get(self.path, "node", &self.root.nodes, index)?;
        let name = format!("node {}", node.name.clone().unwrap_or(index.to_string()));
        // nodes are trees
        if std::mem::replace(&mut self.visited[index], true) || depth > MAX_DEPTH {
            let problem = "nodes form a cycle, share a child or are nested too deeply";
            return Err(Error::invalid(self.path, name, problem));
        }
        let transform = parent * node.transform();
        if let Some(mesh) = node.mesh {
            self.mesh(node, mesh, transform, &name)?;
        }
        node.children.iter().try_for_each(|&child| self.node(child, transform, depth + 1))
    }

    fn mesh(&mut self, node: &Node, mesh: usize, transform: DMat4, name: &str) -> Result<()> {
        let mesh = get(self.path, &format!("{name}: mesh"), &self.root.meshes, mesh)?;
        for (given, what) in [
            (node.skin.is_some(), "its skin is ignored"),
            (node.extensions.contains_key("EXT_mesh_gpu_instancing"), "its instances are ignored"),
            (node.weights.iter().chain(&mesh.weights).any(|w| *w != 0.0), "its morph targets are ignored"),
        ] {
            if given {
                self.polygons.warnings.push(format!("{name}: {what}"));
            }
        }
        let lost = lost_dimensions(transform);
        if lost > 1 {
            self.polygons.warnings.push(format!("{name}: it is scaled to zero and left out"));
            return Ok(());
        }
        for primitive in &mesh.primitives {
            let ignored = match primitive.mode {
                0 => "points",
                1..=3 => "lines",
                4..=6 => {
                    self.vertices(primitive, transform, lost == 1, name)?;
                    continue;
                }
                other => {
                    let problem = format!("a primitive has the mode {other}, expected 0 to 6");
                    return Err(Error::invalid(self.path, name, problem));
                }
            };
            self.polygons.warnings.push(format!("{name}: {ignored} are ignored"));
        }
        Ok(())
    }

    /// Appends the vertices and triangles of a primitive.
    fn vertices(&mut self, primitive: &Primitive, transform: DMat4, is_flat: bool, name: &str) -> Result<()> {
        let position = primitive.attributes.get("POSITION").copied();
        let position = position.ok_or_else(|| Error::invalid(self.path, name, "a primitive has no positions"))?;
        if primitive.extensions.contains_key("KHR_draco_mesh_compression") && self.accessors.is_empty(position) {
            let problem = format!("{name}: meshes compressed by KHR_draco_mesh_compression are not supported");
            return Err(Error::unsupported(self.path, problem));
        }
        let first = self.polygons.positions.len();
        let positions = self.accessors.vectors::<3>(position, name)?;
        let count = positions.len();
        let normals = self.attribute::<3>(primitive, "NORMAL", count, name)?;
        let tangents = self.attribute::<4>(primitive, "TANGENT", count, name)?;
        let uvs = self.attribute::<2>(primitive, "TEXCOORD_0", count, name)?;
        // Append positions, normals and texture coordinates
        let sign = if transform.determinant() < 0.0 { -1.0 } else { 1.0 };
        let linear = DMat3::from_mat4(transform);
        let cofactor = sign * cofactor(linear);
        for (k, &position) in positions.iter().enumerate() {
            // the normals of a flattened mesh lose their direction
            let normal = normals.as_ref().filter(|_| !is_flat).map(|normals| cofactor * DVec3::from(normals[k]));
            let normal = normal.map(|normal| normal.normalize_or_zero().as_vec3());
            // in glTF v points down
            let uv = uvs.as_ref().map(|uvs| Vec2::new(uvs[k][0] as f32, (1.0 - uvs[k][1]) as f32));
            self.polygons.vertex(transform.transform_point3(DVec3::from(position)), normal, uv);
        }
        // Append tangents, which all meshes must have; flipping v flips their handedness
        let moved =
            |t: &[f64; 4]| (linear * DVec3::new(t[0], t[1], t[2])).normalize_or_zero().extend(-t[3] * sign).as_vec4();
        match tangents {
            Some(tangents) if self.polygons.tangents.len() == first => {
                self.polygons.tangents.extend(tangents.iter().map(moved));
            }
            _ => self.polygons.tangents.clear(),
        }
        self.triangles(primitive, first, count, sign < 0.0, name)
    }

    fn attribute<const N: usize>(
        &mut self,
        primitive: &Primitive,
        semantic: &str,
        count: usize,
        name: &str,
    ) -> Result<Option<Vec<[f64; N]>>> {
        let Some(&accessor) = primitive.attributes.get(semantic) else { return Ok(None) };
        let found = self.accessors.vectors::<N>(accessor, name)?;
        if found.len() != count {
            let problem = format!("{semantic} has {} elements, but there are {count} positions", found.len());
            return Err(Error::invalid(self.path, name, problem));
        }
        Ok(Some(found))
    }

    /// Appends the triangles of `count` vertices from `first` on.
    fn triangles(
        &mut self,
        primitive: &Primitive,
        first: usize,
        count: usize,
        is_mirrored: bool,
        name: &str,
    ) -> Result<()> {
        let bad = |problem: String| Error::invalid(self.path, name, problem);
        let (start, end) = match (u32::try_from(first), u32::try_from(first + count)) {
            (Ok(start), Ok(end)) => (start, end),
            _ => return Err(bad("found more than 2^32 vertices".into())),
        };
        let indices: Vec<u32> = match primitive.indices {
            Some(accessor) => {
                let indices = self.accessors.vectors::<1>(accessor, name)?;
                if let Some([index]) = indices.iter().find(|[index]| !(0.0..count as f64).contains(index)) {
                    return Err(bad(format!("found vertex index {index}, but there are {count} vertices")));
                }
                indices.iter().map(|[index]| start + *index as u32).collect()
            }
            None => (start..end).collect(),
        };
        let begin = self.polygons.corners.len();
        match primitive.mode {
            5 => self.polygons.strip(&indices),
            6 => {
                let Some((&hub, rim)) = indices.split_first() else { return Ok(()) };
                rim.windows(2).for_each(|edge| self.polygons.polygon([edge[0], edge[1], hub]));
            }
            _ => indices.chunks_exact(3).for_each(|t| self.polygons.polygon(t.iter().copied())),
        }
        // the first paint is that of primitives without a material
        let paint = primitive.material.map_or(0, |k| u16::try_from(k + 1).unwrap_or(0));
        self.polygons.painted.resize(self.polygons.ends.len(), paint);
        if self.polygons.ends.len() > MAX_TRIANGLES {
            return Err(bad(format!("found more than {MAX_TRIANGLES} triangles")));
        }
        if is_mirrored {
            self.polygons.corners[begin..].chunks_exact_mut(3).for_each(|t| t.swap(1, 2));
        }
        Ok(())
    }
}

/// The matrix that transforms area vectors; it exists for every matrix.
fn cofactor(m: DMat3) -> DMat3 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
}

/// By how many dimensions a transform flattens what it is applied to, as far as double precision tells.
fn lost_dimensions(transform: DMat4) -> usize {
    const NEAR_ZERO: f64 = 1e-14;
    let largest = |m: DMat3| m.to_cols_array().iter().fold(0.0, |largest: f64, v| largest.max(v.abs()));
    let linear = DMat3::from_mat4(transform);
    let scale = largest(linear);
    match () {
        () if scale == 0.0 => 3,
        () if largest(cofactor(linear * scale.recip())) < NEAR_ZERO => 2,
        () if (linear * scale.recip()).determinant().abs() < NEAR_ZERO => 1,
        () => 0,
    }
}
