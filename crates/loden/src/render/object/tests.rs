use std::fs;

use glam::Vec3;

use super::*;
use crate::render::traced::Traced as _;
use crate::render::{Mesh, MeshData, Projection, Ray};

fn write(name: &str, content: impl AsRef<[u8]>) -> (tempfile::TempDir, String) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    fs::write(&path, content).unwrap();
    let path = path.to_str().unwrap().to_string();
    (dir, path)
}

fn mesh(object: &Object) -> &Mesh {
    match &object.shape {
        Shape::Mesh(mesh) => mesh,
        other => panic!("not a mesh: {other:?}"),
    }
}

#[test]
fn every_object_file_is_registered() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/render/object");
    let known: Vec<_> = OBJECTS.iter().map(|o| o.name).chain(["mod", "tests", "obj", "gltf", "ply"]).collect();
    for entry in fs::read_dir(folder).unwrap() {
        let name = entry.unwrap().path().file_stem().unwrap().to_str().unwrap().to_string();
        assert!(known.contains(&name.as_str()), "{name}.rs is not in OBJECTS");
    }
}

#[test]
fn built_in_objects_stand_on_their_floor_within_the_image() {
    for built_in in OBJECTS {
        let object = load(built_in.name).unwrap();
        assert!(object.warnings.is_empty() && !built_in.doc.is_empty());
        let Shape::Mesh(mesh) = &object.shape else { continue };
        let corners: Vec<Vec3> = mesh.corners().flatten().collect();
        let lowest = corners.iter().map(|p| p.y).fold(f32::INFINITY, f32::min);
        assert!(lowest >= object.floor - 1e-4 && lowest < object.floor + 0.05, "{} {lowest}", built_in.name);
        let [right, up, back] = object.camera.axes();
        let Projection::Perspective { field_of_view_degrees } = object.camera.projection else { panic!("perspective") };
        for p in corners {
            let p = p - object.camera.position;
            let edge = -p.dot(back) * (0.5 * field_of_view_degrees.to_radians()).tan();
            assert!(p.dot(right).abs() < edge && p.dot(up).abs() < edge, "{} {p}", built_in.name);
        }
    }
}

#[test]
fn the_teapot_is_closed_and_oriented_outwards() {
    let data = super::teapot::data();
    assert_eq!(data.normals.len(), data.positions.len());
    for t in &data.triangles {
        let [a, b, c] = t.map(|i| data.positions[i as usize]);
        let face = (b - a).cross(c - a).normalize();
        for n in t.map(|i| data.normals[i as usize]) {
            assert!((n.length() - 1.0).abs() < 1e-4);
            assert!(face.dot(n) > 0.0, "a normal against its triangle at {a}");
        }
    }
    let object = load("teapot").unwrap();
    // Look from the side, where neither the gap around the lid nor the opening of the spout is visible.
    let (mut met, mut inside) = (0, 0);
    for k in 0..20_000u32 {
        let random = |salt: u32| {
            (k.wrapping_mul(2_654_435_769).wrapping_add(salt).reverse_bits() >> 8) as f32 / (1 << 24) as f32
        };
        let up = random(0) * 0.9 - 0.9;
        let phi = std::f32::consts::TAU * k as f32 * 0.618_034;
        let s = (1.0 - up * up).sqrt();
        let from = 5.0 * Vec3::new(s * phi.cos(), up, s * phi.sin());
        let target = Vec3::new(random(77) - 0.5, 0.6 * random(12_345) - 0.3, random(999_999) - 0.5);
        let ray = Ray { origin: from, direction: (target - from).normalize() };
        if let Some(hit) = mesh(&object).closest(&ray, f32::INFINITY) {
            met += 1;
            let surface = mesh(&object).place(&hit).surface(-ray.direction);
            inside += u32::from(surface.normal.dot(surface.geometric) < 0.0);
        }
    }
    assert!(met > 10_000 && inside == 0, "{inside} of {met}");
}

#[test]
fn teapot_texture_is_nearly_square_on_the_belly() {
    let data = super::teapot::data();
    let mut checked = 0;
    for t in &data.triangles {
        let [a, b, c] = t.map(|i| data.positions[i as usize]);
        let [p, q, r] = t.map(|i| data.uvs[i as usize]);
        let middle = (a + b + c) / 3.0;
        // On the belly, away from handle and spout.
        if middle.y.abs() < 0.15 && middle.z.abs() > 0.5 {
            let world = (b - a).cross(c - a).length();
            let texture = (q - p).perp_dot(r - p).abs() * (std::f32::consts::PI / 3.3).powi(2);
            assert!((texture / world - 1.0).abs() < 0.25, "{texture} {world}");
            checked += 1;
        }
    }
    assert!(checked > 500);
}

const SQUARE: &str = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

#[test]
fn obj_files_are_read_and_scaled() {
    let (_dir, path) = write("a.obj", format!("{SQUARE}f 1/1 2/2 3/3 4/4\n"));
    let object = load(&path).unwrap();
    assert_eq!(mesh(&object).triangle_count(), 2);
    assert!((object.shape.bounds().radius - 1.0).abs() < 1e-6);
    assert_eq!(object.warnings.len(), 1, "normals were made: {:?}", object.warnings);
    let (_dir, path) = write("b.obj", format!("{SQUARE}f 1 2 3\n"));
    let object = load(&path).unwrap();
    assert!(object.warnings.iter().any(|w| w.contains("texture coordinates")), "{:?}", object.warnings);
}

#[test]
fn invalid_obj_files_are_errors() {
    for (content, fault) in [
        (format!("{SQUARE}f 1 2 9\n"), "vertex that does not exist"),
        (format!("{SQUARE}f 1/1 2/9 3/3\n"), "texture coordinate that does not exist"),
        (format!("{SQUARE}f a b c\n"), "list of indices"),
        ("v 0 0 zero\n".into(), "three numbers"),
        (String::new(), "no faces"),
        ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into(), "vertex 0"),
    ] {
        let (_dir, path) = write("a.obj", content);
        let error = load(&path).unwrap_err().to_string();
        assert!(error.contains("a.obj") && error.contains(fault), "{error}");
    }
    assert!(matches!(load("/nowhere/a.obj"), Err(Error::Io { .. })));
    let error = load("kettle").unwrap_err().to_string();
    assert!(error.contains("teapot") && error.contains("gltf"), "{error}");
    let (_dir, path) = write("a.stl", "");
    assert!(matches!(load(&path), Err(Error::Unsupported { .. })));
}

/// A triangle in a separate buffer, under a node that translates and scales it.
fn gltf(buffer: &[u8], indices: [u16; 3], count: usize) -> (tempfile::TempDir, String) {
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"children":[1],"translation":[5,0,0]}},{{"mesh":0,"scale":[2,2,2]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "buffers":[{{"uri":"a.bin","byteLength":42}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":6}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{count},"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
        {{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}}]}}"#
    );
    let (dir, path) = write("a.gltf", json);
    let mut bytes = buffer.to_vec();
    bytes.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
    fs::write(dir.path().join("a.bin"), bytes).unwrap();
    (dir, path)
}

fn triangle() -> Vec<u8> {
    [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn gltf_files_are_read_with_their_transforms() {
    let (_dir, path) = gltf(&triangle(), [0, 1, 2], 3);
    let object = load(&path).unwrap();
    assert_eq!(mesh(&object).triangle_count(), 1);
    assert_eq!(object.warnings.len(), 2);
    let [a, b, c] = mesh(&object).corners().next().unwrap();
    assert!(((b - a).length() - (c - a).length()).abs() < 1e-5 && (b - a).dot(c - a).abs() < 1e-5);
}

#[test]
fn tangents_of_gltf_files_follow_their_node_and_turn_with_v() {
    // Normals along z, tangents along y, bitangents (v down) along -x = cross(normal, tangent).
    let vectors = [[0.0f32, 0.0, 1.0].repeat(3), [0.0, 1.0, 0.0, 1.0].repeat(3), vec![0.0, 0.0, 0.0, 1.0, 1.0, 0.0]];
    let numbers = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].into_iter().chain(vectors.concat());
    let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
    let view = |offset: usize, len: usize| format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{len}}}"#);
    let views = [view(0, 36), view(36, 36), view(72, 48), view(120, 24)].join(",");
    let accessor =
        |i: usize, kind: &str| format!(r#"{{"bufferView":{i},"componentType":5126,"count":3,"type":"{kind}"}}"#);
    let positions = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}"#;
    let accessors = [positions.to_string(), accessor(1, "VEC3"), accessor(2, "VEC4"), accessor(3, "VEC2")].join(",");
    // A quarter turn about x maps y to z.
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"mesh":0,"rotation":[0.70710678,0,0,0.70710678],"scale":[3,3,3]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TANGENT":2,"TEXCOORD_0":3}}}}]}}],
        "buffers":[{{"uri":"a.bin","byteLength":144}}],"bufferViews":[{views}],"accessors":[{accessors}]}}"#
    );
    let (dir, path) = write("a.gltf", json);
    fs::write(dir.path().join("a.bin"), bytes).unwrap();
    let (data, warnings) = super::gltf::read(path.as_ref()).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    for (normal, tangent) in data.normals.iter().zip(&data.tangents) {
        let tangent_of_u = tangent.truncate().normalize();
        assert!(tangent_of_u.abs_diff_eq(Vec3::Z, 1e-6), "{tangent}");
        // Our v points up, opposite to glTF's bitangent.
        let of_v = normal.normalize().cross(tangent_of_u) * tangent.w;
        assert!(of_v.abs_diff_eq(Vec3::X, 1e-6), "{of_v}");
    }
    assert_eq!((data.tangents.len(), data.uvs[1]), (3, glam::Vec2::new(0.0, 0.0)));
}

#[test]
fn invalid_gltf_files_are_errors() {
    for ((_dir, path), fault) in [
        (gltf(&triangle(), [0, 1, 7], 3), "index 7"),
        (gltf(&triangle(), [0, 1, 2], 4), "beyond its buffer"),
        (gltf(&triangle()[..8], [0, 1, 2], 3), "a.gltf"),
        (write("a.gltf", "{"), "glTF"),
        (write("a.glb", "glTF\x02\0\0\0\x0c\0\0\0"), "a.glb"),
        (write("a.gltf", r#"{"asset":{"version":"2.0"}}"#), "scenes"),
    ] {
        let error = load(&path).unwrap_err().to_string();
        assert!(error.contains(fault), "{error}");
    }
    assert!(matches!(load("/nowhere/a.glb"), Err(Error::Io { .. })));
}

#[test]
fn missing_texture_coordinates_of_a_part_drop_them_all() {
    let full = MeshData {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        tangents: Vec::new(),
        uvs: vec![glam::Vec2::ZERO; 3],
        triangles: vec![[0, 1, 2]],
    };
    let bare = MeshData { normals: Vec::new(), uvs: Vec::new(), ..full.clone() };
    for (a, b) in [(&full, &bare), (&bare, &full)] {
        let mut both = MeshData::default();
        both.append(a, glam::Mat4::IDENTITY).unwrap();
        both.append(b, glam::Mat4::IDENTITY).unwrap();
        assert_eq!((both.positions.len(), both.normals.len(), both.uvs.len()), (6, 0, 0));
    }
}
