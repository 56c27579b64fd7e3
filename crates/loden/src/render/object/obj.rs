//! Reader of Wavefront OBJ files.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use glam::{Mat4, Vec2, Vec3};

use crate::render::MeshData;
use crate::render::geometry::ControlMesh;
use crate::{Error, Result};

/// Reads all groups of an OBJ file as one mesh. Materials are ignored and polygons triangulated.
pub(super) fn read(path: &Path) -> Result<(MeshData, Vec<String>)> {
    let models = load(path, &tobj::LoadOptions { triangulate: true, single_index: true, ..Default::default() })?;
    let mut data = MeshData::default();
    let parts: Vec<_> = models.iter().filter(|m| m.mesh.indices.len() >= 3).collect();
    for model in &parts {
        let part = part(&model.mesh);
        data.append(&part, Mat4::IDENTITY)
            .map_err(|e| Error::invalid(path, format!("group {}", model.name), e.to_string()))?;
    }
    if parts.is_empty() {
        return Err(Error::invalid(path, "faces", "the file has no faces"));
    }
    let lines = models.len() - parts.len();
    let warnings = (lines > 0).then(|| format!("{}: ignored {lines} groups without faces", path.display()));
    Ok((data, warnings.into_iter().collect()))
}

fn load(path: &Path, options: &tobj::LoadOptions) -> Result<Vec<tobj::Model>> {
    let mut reader = BufReader::new(File::open(path).map_err(Error::io(path))?);
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) =
        tobj::load_obj_buf(&mut reader, options, no_materials).map_err(|e| Error::invalid(path, "OBJ", problem(&e)))?;
    Ok(models)
}

/// Reads the polygons of all groups as a control mesh for subdivision.
pub(in crate::render) fn control_mesh(path: &Path) -> Result<ControlMesh> {
    let mut control = ControlMesh::default();
    for model in load(path, &tobj::LoadOptions::default())? {
        let mesh = &model.mesh;
        let first = control.positions.len() as u32;
        control.positions.extend(mesh.positions.chunks_exact(3).map(Vec3::from_slice));
        // tobj leaves the list empty if all faces are triangles.
        let triangles = vec![3; if mesh.face_arities.is_empty() { mesh.indices.len() / 3 } else { 0 }];
        let mut rest = &mesh.indices[..];
        for &arity in mesh.face_arities.iter().chain(&triangles) {
            let (face, others) = rest.split_at((arity as usize).min(rest.len()));
            control.faces.push(face.iter().map(|i| i.saturating_add(first)).collect());
            rest = others;
        }
        let uv = |&i: &u32| mesh.texcoords.chunks_exact(2).nth(i as usize).map(Vec2::from_slice);
        control.uvs.extend(mesh.texcoord_indices.iter().filter_map(uv));
    }
    control.faces.retain(|face| face.len() > 2);
    if control.uvs.len() != control.faces.iter().map(Vec::len).sum::<usize>() {
        control.uvs.clear();
    }
    Ok(control)
}

fn part(mesh: &tobj::Mesh) -> MeshData {
    let triples = |list: &[f32]| list.chunks_exact(3).map(Vec3::from_slice).collect();
    MeshData {
        positions: triples(&mesh.positions),
        normals: triples(&mesh.normals),
        tangents: Vec::new(),
        uvs: mesh.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
        triangles: mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}

fn problem(error: &tobj::LoadError) -> String {
    use tobj::LoadError as E;
    match error {
        E::FaceVertexOutOfBounds => "a face refers to a vertex that does not exist".into(),
        E::FaceTexCoordOutOfBounds => "a face refers to a texture coordinate that does not exist".into(),
        E::FaceNormalOutOfBounds => "a face refers to a normal that does not exist".into(),
        E::PositionParseError => "a line starting with v does not have three numbers".into(),
        E::NormalParseError => "a line starting with vn does not have three numbers".into(),
        E::TexcoordParseError => "a line starting with vt does not have two numbers".into(),
        E::FaceParseError | E::InvalidPolygon => "a line starting with f is not a list of indices".into(),
        other => other.to_string(),
    }
}
