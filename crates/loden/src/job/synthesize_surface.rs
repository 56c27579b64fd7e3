//! Materials on surfaces from files.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::{DVec3, Vec3};
use serde::Serialize;
use serde_json::json;

use super::synthesize::{Features, compressed_sample, exemplar};
use crate::codec;
use crate::output::write_file;
use crate::params::Given;
use crate::progress::Progress;
use crate::render::{Shape, object};
use crate::synth::surface::{AtlasCorner, Stroke, SurfaceGoal, on_surface};
use crate::{Error, Result};

/// Settings of a synthesis on a surface.
#[derive(Debug, Clone)]
pub struct SurfaceRequest {
    /// A BTF, compressed or not, named as for [`super::open()`].
    pub sample: PathBuf,
    /// The options of its importer.
    pub options: Given,
    /// A built-in object or the file of a mesh.
    pub on: String,
    /// Texels per side of the atlas.
    pub side: usize,
    /// Chooses one of many results.
    pub seed: u64,
    /// Directions that threads follow.
    pub strokes: Vec<Stroke>,
    /// What the texels are compared by.
    pub features: Features,
    /// The number of principal components.
    pub channels: usize,
    /// The `.loden` file to write.
    pub output: PathBuf,
    /// The `.glb` file to write: the mesh with the texture coordinates of the atlas.
    pub mesh: PathBuf,
}

/// A material made for a surface.
#[derive(Debug, Clone, Serialize)]
pub struct SurfaceMade {
    /// The material.
    pub output: PathBuf,
    /// The mesh that it is made for.
    pub mesh: PathBuf,
    /// The sample.
    pub source: PathBuf,
    /// Texels per side of the atlas.
    pub side: usize,
    /// Points of the surface.
    pub points: usize,
    /// The sum of the indices of singularities of the direction field.
    pub singularities: i64,
    /// Size of the material's file.
    pub bytes: u64,
    /// Seconds for the map.
    pub synthesis_s: f64,
    /// Seconds in all.
    pub seconds: f64,
}

/// Covers a surface with copies of a BTF's texels.
///
/// # Errors
/// Errors of opening, compressing and writing; [`Error::Unsupported`] for an object without triangles; see also [`on_surface`].
pub fn synthesize_on(request: &SurfaceRequest, progress: &dyn Progress) -> Result<SurfaceMade> {
    let start = Instant::now();
    let (triangles, origin) = triangles(&request.on, progress)?;
    let (sample, _folder) = compressed_sample(&request.sample, &request.options, progress)?;
    codec::check_mapped(sample.meta(), request.side, request.side, &request.output)?;
    let exemplar = exemplar(&sample, request.features, request.channels, progress)?;
    let moved = |stroke: &Stroke| Stroke { at: (DVec3::from_array(stroke.at) - origin).to_array(), ..*stroke };
    let strokes = request.strokes.iter().map(moved).collect();
    let goal = SurfaceGoal { side: request.side, seed: request.seed, strokes };
    let made_from = Instant::now();
    let made = on_surface(&exemplar, &triangles, &goal, progress).map_err(|error| match error {
        Error::Parameter { name, problem } if name == "mesh" => Error::invalid(&request.on, name, problem),
        other => other,
    })?;
    let synthesis_s = made_from.elapsed().as_secs_f64();
    let bytes = codec::store_mapped(&sample, &made.map, &request.output)?;
    let glb = glb(&made.corners, origin)?;
    write_file(&request.mesh, |file| file.write_all(&glb))?;
    Ok(SurfaceMade {
        output: request.output.clone(),
        mesh: request.mesh.clone(),
        source: request.sample.clone(),
        side: request.side,
        points: made.points,
        singularities: made.singularities,
        bytes,
        synthesis_s,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// The triangles of a built-in object or of a file, relative to an origin; warnings go to `progress`.
fn triangles(on: &str, progress: &dyn Progress) -> Result<(Vec<[Vec3; 3]>, DVec3)> {
    if let Some(object) = object::OBJECTS.iter().find(|object| object.name == on) {
        let Shape::Mesh(mesh) = (object.build)()?.shape else {
            return Err(Error::unsupported(Path::new(on), "is no mesh of triangles"));
        };
        return Ok((mesh.corners().collect(), DVec3::ZERO));
    }
    let file = object::read(Path::new(on))?;
    file.warnings.iter().for_each(|warning| progress.warn(warning));
    let corners = |triangle: &[u32; 3]| triangle.map(|index| file.data.positions[index as usize]);
    Ok((file.data.triangles.iter().map(corners).collect(), file.origin))
}

/// Triangles as a binary glTF file, moved to an origin.
fn glb(corners: &[[AtlasCorner; 3]], origin: DVec3) -> Result<Vec<u8>> {
    let all = || corners.iter().flatten();
    let count = 3 * corners.len();
    let positions = all().flat_map(|corner| corner.position.to_array());
    // v goes down in this format
    let uvs = all().flat_map(|corner| [corner.uv.x, 1.0 - corner.uv.y]);
    let binary: Vec<u8> = positions.chain(uvs).flat_map(f32::to_le_bytes).collect();
    let bound = |f: fn(Vec3, Vec3) -> Vec3, from: f32| {
        all().fold(Vec3::splat(from), |bound, corner| f(bound, corner.position)).to_array()
    };
    let json = json!({
        "asset": { "version": "2.0", "generator": concat!("loden ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "translation": origin.to_array() }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 } }] }],
        "buffers": [{ "byteLength": binary.len() }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 12 * count },
            { "buffer": 0, "byteOffset": 12 * count, "byteLength": 8 * count },
        ],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3",
                "min": bound(Vec3::min, f32::INFINITY), "max": bound(Vec3::max, f32::NEG_INFINITY),
            },
            { "bufferView": 1, "componentType": 5126, "count": count, "type": "VEC2" },
        ],
    });
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let size =
        |bytes: usize| u32::try_from(bytes).map_err(|_| Error::parameter("mesh", "is too large for a .glb file"));
    let mut file = Vec::with_capacity(28 + json.len() + binary.len());
    file.extend(b"glTF");
    file.extend(2u32.to_le_bytes());
    file.extend(size(28 + json.len() + binary.len())?.to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        file.extend(size(chunk.len())?.to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;
    use crate::progress::Silent;
    use crate::synth::Exemplar;

    fn edges_of([a, b, c]: [usize; 3]) -> [[usize; 2]; 3] {
        [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)])
    }

    /// The triangles of the largest connected part of a built-in object, as numbers of their corners.
    fn largest_part(name: &str) -> (Vec<[Vec3; 3]>, Vec<[usize; 3]>) {
        let Shape::Mesh(mesh) = object::load(name).unwrap().shape else { panic!("{name} is a mesh") };
        let corners: Vec<[Vec3; 3]> = mesh.corners().collect();
        let mut numbers = BTreeMap::new();
        let mut number = |p: Vec3| {
            let next = numbers.len();
            *numbers.entry(p.to_array().map(|v| (v * 1e4).round() as i64)).or_insert(next)
        };
        let triangles: Vec<[usize; 3]> = corners.iter().map(|corners| corners.map(&mut number)).collect();
        let whole: Vec<usize> = (0..triangles.len()).filter(|k| BTreeSet::from(triangles[*k]).len() == 3).collect();
        let mut beside = BTreeMap::<[usize; 2], Vec<usize>>::new();
        for k in &whole {
            edges_of(triangles[*k]).into_iter().for_each(|edge| beside.entry(edge).or_default().push(*k));
        }
        // Follow edges from triangle to triangle
        let mut seen = BTreeSet::new();
        let mut kept = Vec::new();
        for first in whole {
            let mut part = Vec::new();
            let mut open = vec![first];
            while let Some(k) = open.pop() {
                if seen.insert(k) {
                    part.push(k);
                    edges_of(triangles[k]).iter().for_each(|edge| open.extend(&beside[edge]));
                }
            }
            if part.len() > kept.len() {
                kept = part;
            }
        }
        (kept.iter().map(|k| corners[*k]).collect(), kept.iter().map(|k| triangles[*k]).collect())
    }

    #[test]
    fn singularities_on_the_body_of_the_teapot_add_up_to_its_euler_characteristic() {
        let (corners, triangles) = largest_part("teapot");
        let mut edges = BTreeMap::<[usize; 2], usize>::new();
        for [a, b, c] in &triangles {
            edges_of([*a, *b, *c]).into_iter().for_each(|edge| *edges.entry(edge).or_default() += 1);
        }
        let vertices: BTreeSet<usize> = triangles.iter().flatten().copied().collect();
        // Count the rims: parts of the open edges
        let open: Vec<[usize; 2]> = edges.iter().filter(|(_, count)| **count == 1).map(|(edge, _)| *edge).collect();
        let mut rim: BTreeMap<usize, usize> = open.iter().flatten().map(|k| (*k, *k)).collect();
        for _ in 0..open.len() {
            for [a, b] in &open {
                let least = rim[a].min(rim[b]);
                rim.insert(*a, least);
                rim.insert(*b, least);
            }
        }
        let rims = rim.values().collect::<BTreeSet<_>>().len();
        let expected = vertices.len() as i64 - edges.len() as i64 + triangles.len() as i64 + rims as i64;
        let grey = Exemplar::new(16, 16, 1, (0..256).map(|i| (i % 7) as f32).collect());
        let goal = SurfaceGoal { side: 1000, seed: 0, strokes: vec![] };
        let made = on_surface(&grey, &corners, &goal, &Silent).unwrap();
        assert_eq!(made.singularities, expected, "{} triangles, {rims} rims", triangles.len());
    }
}
