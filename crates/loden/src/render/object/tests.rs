use std::fs;

use glam::{Mat4, Vec2, Vec3};

use super::*;
use crate::render::ray::Ray;
use crate::render::traced::Traced as _;
use crate::render::{Mesh, MeshData, Projection};

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
    let known: Vec<_> =
        OBJECTS.iter().map(|o| o.name).chain(["mod", "tests", "obj", "gltf", "ply", "polygons"]).collect();
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
        (format!("{SQUARE}f 1 2 9\n"), "line 9: a face refers to vertex 9, which does not exist"),
        (format!("{SQUARE}f 1/1 2/9 3/3\n"), "texture coordinate 9, which does not exist"),
        (format!("{SQUARE}f a b c\n"), "list of indices"),
        ("v 0 0 zero\n".into(), "three numbers"),
        (String::new(), "found no triangles"),
        ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into(), "line 1: vertex 1"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3\n".into(), "found no triangles; lines are ignored (1)"),
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
    assert_eq!(object.warnings.len(), 2, "{:?}", object.warnings);
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
    let MeshFile { data, warnings, .. } = read(path.as_ref()).unwrap();
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
        (gltf(&triangle()[..8], [0, 1, 2], 3), "a.bin"),
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
fn what_a_part_lacks_is_marked_as_missing() {
    let full = MeshData {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        tangents: Vec::new(),
        uvs: vec![Vec2::ONE; 3],
        triangles: vec![[0, 1, 2]],
    };
    let bare = MeshData { normals: Vec::new(), uvs: Vec::new(), ..full.clone() };
    for (a, b, first) in [(&full, &bare, 0), (&bare, &full, 3)] {
        let mut both = MeshData::default();
        both.append(a, Mat4::IDENTITY).unwrap();
        both.append(b, Mat4::IDENTITY).unwrap();
        let (own, missing) = (first..first + 3, 3 - first..6 - first);
        assert!(both.normals[own.clone()] == [Vec3::Z; 3] && both.normals[missing.clone()] == [Vec3::ZERO; 3]);
        assert!(both.uvs[own] == [Vec2::ONE; 3] && both.uvs[missing].iter().all(|uv| uv.is_nan()));
        assert_eq!(Mesh::new(both).unwrap().triangle_count(), 2);
    }
}

/// Twice the area vectors of all triangles, added up, without regard to their sides if `both_sides`.
fn area(data: &MeshData, both_sides: bool) -> Vec3 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| data.positions[i as usize]);
        let area = 0.5 * (b - a).cross(c - a);
        if both_sides { area.abs() } else { area }
    };
    data.triangles.iter().map(of).sum()
}

#[test]
fn concave_faces_do_not_fill_their_bays() {
    let l = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nf 2 3 4 5 6 1\n";
    let quad = "v 0 0 0\nv 2 0 0\nv 0.5 0.5 0\nv 0 2 0\nf 2 3 4 1\n";
    for (content, expected) in [(l, 3.0), (quad, 1.0)] {
        let (_dir, path) = write("a.obj", content);
        let data = read(path.as_ref()).unwrap().data;
        assert!((area(&data, true) - Vec3::Z * expected).length() < 1e-6, "{}", area(&data, true));
        assert!((area(&data, false) - Vec3::Z * expected).length() < 1e-6, "{}", area(&data, false));
    }
}

#[test]
fn corners_that_lack_something_do_not_spoil_the_others() {
    let points = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0.6 0.8\n";
    for (faces, uvs, normals) in [
        ("f 1/1 2/2 3/3\nf 1 3 4\n", 3, 0),
        ("g a\nf 1/1 2/2 3/3\ng b\nf 1 3 4\n", 3, 0),
        ("f 1//1 2//1 3//1\nf 1 3 4\n", 0, 3),
        ("f 1/1/1 2/2/1 3/3/1\nf 1//1 3//1 4//1\n", 3, 6),
    ] {
        let (_dir, path) = write("a.obj", format!("{points}{faces}"));
        let file = read(path.as_ref()).unwrap();
        let data = &file.data;
        assert_eq!(area(data, false), Vec3::Z * 4.0);
        assert_eq!(data.uvs.iter().filter(|uv| uv.is_finite()).count(), uvs, "{faces}");
        assert_eq!(data.normals.iter().filter(|n| **n != Vec3::ZERO).count(), normals, "{faces}");
        let said = file.no_uvs.unwrap_or_default();
        assert!(said.contains("a.obj") && said.contains("texture coordinates"), "{said}");
        assert!(normals == 6 || file.warnings.iter().any(|w| w.contains("no normals")), "{:?}", file.warnings);
        let mesh = Mesh::new(file.data).unwrap();
        let uv = |x: f32, y: f32| {
            let ray = Ray { origin: Vec3::new(x, y, 1.0), direction: -Vec3::Z };
            mesh.place(&mesh.closest(&ray, 9.0).unwrap()).surface(Vec3::Z)
        };
        // texture coordinates and normals of the first triangle are those of the file
        let hit = uv(1.5, 0.5);
        assert!(uvs == 0 || hit.uv.abs_diff_eq(Vec2::new(0.75, 0.25), 1e-6), "{faces} {}", hit.uv);
        assert!(normals == 0 || hit.normal.abs_diff_eq(Vec3::new(0.0, 0.6, 0.8), 1e-6), "{faces} {}", hit.normal);
    }
}

#[test]
fn meshes_far_from_zero_keep_their_shape() {
    let offset = [700_034.459_808, 5_200_123.25, 299.0];
    let square = [[0.0, 0.0], [0.01, 0.0], [0.01, 0.01], [0.0, 0.01]];
    let points = |offset: [f64; 3]| {
        let point = |[x, y]: [f64; 2]| format!("v {:.6} {:.6} {:.6}\n", x + offset[0], y + offset[1], offset[2]);
        square.map(point).concat()
    };
    let (_near, near) = write("a.obj", format!("{}f 1 2 3 4\n", points([0.0; 3])));
    let (_far, far) = write("a.obj", format!("v 0 0 0\n{}f -4 -3 -2 -1\n", points(offset)));
    let (near, far) = (read(near.as_ref()).unwrap(), read(far.as_ref()).unwrap());
    assert_eq!(near.origin, glam::DVec3::ZERO);
    assert!(far.origin.abs_diff_eq(glam::DVec3::from(offset) + glam::DVec3::new(0.005, 0.005, 0.0), 1e-7));
    for (p, q) in near.data.positions.iter().zip(&far.data.positions) {
        assert!((*p - Vec3::new(0.005, 0.005, 0.0)).abs_diff_eq(*q, 1e-8), "{p} {q}");
    }
    assert_eq!(near.data.triangles, far.data.triangles);
}

/// A square of side 2 in a separate buffer, as a document that `edit` changes.
fn square_gltf(edit: &str) -> (tempfile::TempDir, String) {
    let points = [[0u8, 0], [2, 0], [2, 2], [0, 2]];
    let mut bytes: Vec<u8> =
        points.iter().flat_map(|[x, y]| [f32::from(*x), f32::from(*y), 0.0]).flat_map(f32::to_le_bytes).collect();
    let mut numbers = |list: &[u16]| bytes.extend(list.iter().flat_map(|i| i.to_le_bytes()));
    numbers(&[0, 1, 2, 0, 2, 3]); // view 1
    numbers(&[0, 1, 3, 2]); // view 2
    points.iter().for_each(|[x, y]| numbers(&[100 * u16::from(*x), 100 * u16::from(*y), 0, 0])); // view 3
    numbers(&[2, 0]); // view 4
    bytes.extend([9.0f32, 9.0, 0.0].map(f32::to_le_bytes).concat()); // view 5
    let view =
        |start: usize, length: usize| serde_json::json!({"buffer": 0, "byteOffset": start, "byteLength": length});
    let mut document = serde_json::json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": "a%20b.bin", "byteLength": bytes.len()}],
        "bufferViews": [view(0, 48), view(48, 12), view(60, 8), view(68, 32), view(100, 4), view(104, 12)],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5123, "count": 4, "type": "SCALAR"},
            {"bufferView": 3, "componentType": 5123, "count": 4, "type": "VEC3"},
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {"count": 1,
                "indices": {"bufferView": 4, "componentType": 5123}, "values": {"bufferView": 5}}},
        ],
    });
    document["bufferViews"][3]["byteStride"] = 8.into();
    for line in edit.lines() {
        let (place, value) = line.split_once(' ').unwrap();
        let (parent, key) = place.rsplit_once('/').unwrap();
        let parent = document.pointer_mut(parent).unwrap();
        let value = serde_json::from_str(value).unwrap();
        match key.parse::<usize>() {
            Ok(index) if parent.is_array() && index == parent.as_array().unwrap().len() => {
                parent.as_array_mut().unwrap().push(value);
            }
            Ok(index) if parent.is_array() => parent[index] = value,
            _ => parent[key] = value,
        }
    }
    let (dir, path) = write("a.gltf", document.to_string());
    fs::write(dir.path().join("a b.bin"), bytes).unwrap();
    (dir, path)
}

#[test]
fn gltf_files_of_every_kind_are_read() {
    let primitive = "/meshes/0/primitives/0";
    for (edit, expected, warning) in [
        (String::new(), 4.0, ""),
        (format!("{primitive}/attributes/_WEIGHT 2"), 4.0, ""),
        ("/extensionsRequired [\"KHR_materials_unlit\"]".into(), 4.0, ""),
        (format!("{primitive}/mode 5\n{primitive}/indices 2"), 4.0, ""),
        (format!("{primitive}/mode 6\n{primitive}/indices null"), 4.0, ""),
        (format!("{primitive}/attributes/POSITION 3\n/nodes/0/scale [0.01, 0.01, 0.01]"), 4.0, ""),
        (format!("{primitive}/attributes/POSITION 3\n/accessors/3/normalized true"), 4e4 / (65_535.0 * 65_535.0), ""),
        // the square with its third corner at (9, 9)
        (format!("{primitive}/attributes/POSITION 4"), 18.0, ""),
        ("/nodes/1 {\"mesh\": 0, \"scale\": [0, 0, 0]}\n/scenes/0/nodes [0, 1]".into(), 4.0, "scaled to zero"),
        ("/nodes/0/scale [1, 1, 0]".into(), 4.0, ""),
        ("/nodes/0/scale [-1, 1, 1]".into(), -4.0, ""),
        ("/scenes []\n/scene null".into(), 4.0, "no scene"),
        ("/meshes/0/primitives/1 {\"attributes\": {\"POSITION\": 0}, \"mode\": 1}".into(), 4.0, "lines are ignored"),
        ("/nodes/0/skin 0".into(), 4.0, "skin is ignored"),
    ] {
        let (_dir, path) = square_gltf(&edit);
        let MeshFile { data, warnings, .. } = read(path.as_ref()).unwrap();
        let z = if expected < 0.0 { -1.0 } else { 1.0 };
        let found = area(&data, false).z;
        // a mirrored node turns its faces round, so they still face the viewer
        assert!((found * z - expected).abs() < 1e-5 * expected.abs() || found == expected.abs(), "{edit}: {found}");
        assert!(warnings.join(" ").contains(warning), "{edit}: {warnings:?}");
        assert_eq!(warnings.len(), 1 + usize::from(!warning.is_empty()), "{edit}: {warnings:?}");
    }
}

#[test]
fn faults_of_gltf_files_are_named() {
    let primitive = "/meshes/0/primitives/0";
    for (edit, fault) in [
        (format!("{primitive}/attributes/POSITION 9"), "accessor 9: there are 5"),
        (format!("{primitive}/attributes/NORMAL 9"), "accessor 9: there are 5"),
        (format!("{primitive}/indices 9"), "accessor 9: there are 5"),
        (format!("{primitive}/indices 0"), "found VEC3, expected SCALAR"),
        (format!("{primitive}/mode 9"), "mode 9"),
        (format!("{primitive}/mode 1"), "found no triangles; node 0: lines are ignored"),
        ("/buffers/0/uri \"gone.bin\"".into(), "gone.bin"),
        ("/buffers/0/uri \"http://nowhere.net/a.bin\"".into(), "neither a file nor embedded"),
        ("/buffers/0/uri \"/dev/zero\"".into(), "not a file"),
        ("/buffers/0/byteLength 4000".into(), "expected 4000"),
        ("/accessors/0/count 5000000000".into(), "beyond its buffer"),
        ("/accessors/0/bufferView null\n/accessors/0/count 5000000000".into(), "the limit is"),
        ("/nodes/0/children [0]".into(), "cycle"),
        ("/extensionsRequired [\"ACME_hidden_mesh\"]".into(), "ACME_hidden_mesh"),
        (
            format!("{primitive}/extensions {{\"KHR_draco_mesh_compression\": {{}}}}\n/accessors/0/bufferView null"),
            "KHR_draco_mesh_compression",
        ),
        ("/asset/version \"1.0\"".into(), "glTF 1"),
        ("/scene 3".into(), "scene 3"),
    ] {
        let (_dir, path) = square_gltf(&edit);
        let error = load(&path).unwrap_err().to_string();
        assert!(error.contains(fault), "{edit}: {error}");
    }
}
