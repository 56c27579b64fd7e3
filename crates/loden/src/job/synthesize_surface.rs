//! Materials on surfaces from files.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::Vec3;
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
    let object = object::load(&request.on)?;
    object.warnings.iter().for_each(|warning| progress.warn(warning));
    let Shape::Mesh(mesh) = &object.shape else {
        return Err(Error::unsupported(Path::new(&request.on), "is no mesh of triangles"));
    };
    let triangles: Vec<[Vec3; 3]> = mesh.corners().collect();
    let (sample, _folder) = compressed_sample(&request.sample, &request.options, progress)?;
    codec::check_mapped(sample.meta(), request.side, request.side, &request.output)?;
    let exemplar = exemplar(&sample, request.features, request.channels, progress)?;
    let goal = SurfaceGoal { side: request.side, seed: request.seed, strokes: request.strokes.clone() };
    let made_from = Instant::now();
    let made = on_surface(&exemplar, &triangles, &goal, progress)?;
    let synthesis_s = made_from.elapsed().as_secs_f64();
    let bytes = codec::store_mapped(&sample, &made.map, &request.output)?;
    let glb = glb(&made.corners)?;
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

/// Triangles as a binary glTF file.
fn glb(corners: &[[AtlasCorner; 3]]) -> Result<Vec<u8>> {
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
        "nodes": [{ "mesh": 0 }],
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
        let mut part: Vec<usize> = (0..numbers.len()).collect();
        // spread the smallest number of each part
        loop {
            let mut changed = false;
            for triangle in &triangles {
                let least = triangle.iter().map(|k| part[*k]).min().unwrap();
                triangle.iter().for_each(|k| {
                    changed |= part[*k] != least;
                    part[*k] = least;
                });
            }
            if !changed {
                break;
            }
        }
        let mut counts = BTreeMap::<usize, usize>::new();
        triangles.iter().for_each(|triangle| *counts.entry(part[triangle[0]]).or_default() += 1);
        let largest = *counts.iter().max_by_key(|(_, count)| **count).unwrap().0;
        let kept = |k: &usize| part[triangles[*k][0]] == largest && BTreeSet::from(triangles[*k]).len() == 3;
        let kept: Vec<usize> = (0..triangles.len()).filter(kept).collect();
        (kept.iter().map(|k| corners[*k]).collect(), kept.iter().map(|k| triangles[*k]).collect())
    }

    #[test]
    fn singularities_on_the_body_of_the_teapot_add_up_to_its_euler_characteristic() {
        let (corners, triangles) = largest_part("teapot");
        let mut edges = BTreeMap::<[usize; 2], usize>::new();
        for [a, b, c] in &triangles {
            for [a, b] in [[a, b], [b, c], [c, a]] {
                *edges.entry([*a.min(b), *a.max(b)]).or_default() += 1;
            }
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
        let goal = SurfaceGoal { side: 512, seed: 0, strokes: vec![] };
        let made = on_surface(&grey, &corners, &goal, &Silent).unwrap();
        assert_eq!(made.singularities, expected, "{} triangles, {rims} rims", triangles.len());
    }
}
