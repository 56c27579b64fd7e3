mod files;
mod light;

use std::fs;
use std::io::Write;

use glam::Vec2;

use super::*;
use crate::render::{AreaLight, Emitter, Lens, Light, Mapping, Settings, Shape, Wrap, render};

fn write(name: &str, content: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    fs::write(&path, content).unwrap();
    (dir, path)
}

fn scene(text: &str) -> SceneFile {
    let (_dir, path) = write("a.rib", text);
    read(&path, &Reading::default()).unwrap()
}

fn read_error(text: &str) -> String {
    let (_dir, path) = write("a.rib", text);
    read(&path, &Reading::default()).err().map(|e| e.to_string()).expect("an error")
}

/// The nearest hit of a camera ray through an image point in -1..1: distance, outward normal, texture coordinates.
fn hit(scene: &SceneFile, x: f32, y: f32) -> Option<(f32, Vec3, Vec2)> {
    let ray = scene.camera.prepare(100, 100).unwrap().through(Vec2::new(50.0 + 50.0 * x, 50.0 - 50.0 * y), Vec2::ZERO);
    let hit = |placed: &super::super::SceneBody| {
        let at = placed.shape.closest(&ray, f32::INFINITY)?;
        Some((at.t, placed.shape.surface(&ray, &at).hit(-ray.direction)))
    };
    let (t, found) = scene.bodies.iter().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0))?;
    // Return the outward normal even if the inside is seen.
    Some((t, if found.normal.dot(found.geometric) < 0.0 { -found.geometric } else { found.geometric }, found.uv))
}

fn assert_contains_all(all: &str, expected: &[&str]) {
    for expected in expected {
        assert!(all.contains(expected), "{expected} in\n{all}");
    }
}

/// A light behind the camera, without shadows.
const SUN: &str = "LightSource \"distantlight\" 1 ";
const HEAD: &str = "Projection \"perspective\" \"fov\" 90\nWorldBegin\n";

#[test]
fn the_camera_looks_along_z_with_x_to_the_right() {
    let found = scene(&format!("{HEAD}Translate 1 2 4 Sphere .5 -.5 .5 360 WorldEnd"));
    assert!(hit(&found, 0.25, 0.5).is_some() && hit(&found, -0.25, 0.5).is_none() && hit(&found, 0.25, -0.5).is_none());
    assert_eq!(found.background, Some(Vec3::ZERO));
    // A right-handed world seen from +z gives the same image.
    let found = scene(
        "Projection \"perspective\" Scale 1 1 -1\nTranslate 0 0 -9 WorldBegin\n\
        Translate 1 2 5 Sphere .5 -.5 .5 360 WorldEnd",
    );
    assert!(hit(&found, 0.25, 0.5).is_some() && hit(&found, -0.25, 0.5).is_none());
}

#[test]
fn transforms_end_with_their_block() {
    let found = scene(&format!(
        "{HEAD}
        Translate 0 0 10
        AttributeBegin Rotate 90 0 0 1 Translate 4 0 0 Sphere 1 -1 1 360 AttributeEnd
        TransformBegin ConcatTransform [2 0 0 0 0 2 0 0 0 0 2 0 -8 0 0 1] Sphere 1 -1 1 360 TransformEnd
        TransformBegin Identity Translate 0 -4 10 Sphere 1 -1 1 360 TransformEnd
        TransformBegin Transform [1 0 0 0 0 1 0 0 0 0 1 0 4 0 10 1] Sphere 1 -1 1 360 TransformEnd
        WorldEnd"
    ));
    for (x, y) in [(0.0, 0.4), (-0.8, 0.0), (0.0, -0.4), (0.4, 0.0)] {
        assert!(hit(&found, x, y).is_some(), "{x} {y}");
    }
    assert!(hit(&found, 0.0, 0.0).is_none() && hit(&found, -0.95, 0.0).is_some(), "the second is twice as large");
}

#[test]
fn the_outside_faces_as_the_specification_says() {
    // Clockwise seen from the left-handed camera: the outside faces the viewer, which is +z in world space.
    let polygon = "Polygon \"P\" [-1 -1 2  -1 1 2  1 1 2  1 -1 2] \"st\" [0 0 0 1 1 1 1 0]";
    let normal = |text: &str| hit(&scene(&format!("{HEAD}{text} WorldEnd")), 0.1, 0.2).unwrap().1;
    assert_eq!(normal(polygon), Vec3::Z);
    assert_eq!(normal(&format!("Orientation \"inside\" {polygon}")), -Vec3::Z);
    assert_eq!(normal(&format!("Orientation \"lh\" {polygon}")), Vec3::Z);
    assert_eq!(normal(&format!("Orientation \"rh\" {polygon}")), -Vec3::Z);
    assert_eq!(normal(&format!("ReverseOrientation {polygon}")), -Vec3::Z);
    // "outside" is relative to the object, so mirroring keeps it; "lh" and "rh" are absolute.
    assert!(normal("Translate 0 0 4 Scale -1 1 1 Sphere 3 -3 3 360").z > 0.9);
    assert!(normal("Translate 0 0 4 Scale -1 1 1 Orientation \"rh\" Sphere 3 -3 3 360").z > 0.9);
    assert!(normal("Translate 0 0 4 Sphere 3 -3 3 360").z > 0.9);
    assert!(normal("Translate 0 0 4 Orientation \"rh\" Sphere 3 -3 3 360").z < -0.9);
    let uv = hit(&scene(&format!("{HEAD}{polygon} WorldEnd")), 0.25, -0.25).unwrap().2;
    assert!((uv - Vec2::new(0.75, 0.75)).length() < 1e-5, "t runs down: {uv}");
}

#[test]
fn every_kind_of_surface_can_be_hit() {
    let cases = [
        "Translate 0 0 4 Sphere 1 -1 1 360",
        "Translate 0 -1 4 Rotate -90 1 0 0 Cone 2 1 360",
        "Translate 0 0 4 Rotate 90 1 0 0 Cylinder [1 -1 1 360]",
        "Translate 0 0 4 Disk 0 1 360",
        "Translate 0 -.5 4 Rotate -90 1 0 0 Paraboloid 1 0 1 360",
        "Translate 0 0 4 Rotate -90 1 0 0 Hyperboloid 1 0 -1  0 1 1  360",
        "Translate -1 0 4 Torus 1 .3 0 360 360",
        "GeneralPolygon [4 3] \"P\" [-1 -1 2 -1 1 2 1 1 2 1 -1 2  .5 .5 2 .6 .5 2 .6 .6 2]",
        "PointsPolygons [3 3] [0 1 2 0 2 3] \"P\" [-1 -1 2 -1 1 2 1 1 2 1 -1 2]",
        "PointsGeneralPolygons [2] [4 3] [0 1 2 3 4 5 6] \"P\" [-1 -1 2 -1 1 2 1 1 2 1 -1 2  .5 .5 2 .6 .5 2 .6 .6 2]",
        "Patch \"bilinear\" \"P\" [-1 -1 2 1 -1 2 -1 1 2 1 1 2]",
        "Patch \"bicubic\" \"P\" [-3 -3 2 -1 -3 2 1 -3 2 3 -3 2 -3 -1 2 -1 -1 2 1 -1 2 3 -1 2 \
          -3 1 2 -1 1 2 1 1 2 3 1 2 -3 3 2 -1 3 2 1 3 2 3 3 2]",
        "PatchMesh \"bilinear\" 3 \"nonperiodic\" 2 \"nonperiodic\" \"P\" [-1 -1 2 0 -1 2 1 -1 2 -1 1 2 0 1 2 1 1 2]",
        "Basis \"b-spline\" 1 \"b-spline\" 1 PatchMesh \"bicubic\" 4 \"periodic\" 4 \"nonperiodic\" \"P\" \
          [-1 -1 3 -1 1 3 1 1 3 1 -1 3  -1 -1 2 -1 1 2 1 1 2 1 -1 2  -1 -1 2 -1 1 2 1 1 2 1 -1 2  0 0 2 0 0 2 0 0 2 0 0 2]",
        "SubdivisionMesh \"catmull-clark\" [4] [0 1 2 3] [\"interpolateboundary\"] [0 0] [] [] \
          \"P\" [-1 -1 2 -1 1 2 1 1 2 1 -1 2]",
    ];
    for text in cases {
        let found = scene(&format!("{HEAD}{SUN} {text} WorldEnd"));
        let seen =
            (0..400).filter(|k| hit(&found, (k % 20) as f32 / 10.0 - 0.95, (k / 20) as f32 / 10.0 - 0.95).is_some());
        assert!(seen.count() > 5 && found.warnings.is_empty(), "{text}: {:?}", found.warnings);
    }
}

#[test]
fn missing_loden_materials_are_errors() {
    let text = format!("{HEAD}\nSurface \"loden\" \"string material\" [\"nowhere.loden\"]\nSphere 1 -1 1 360 WorldEnd");
    let error = read_error(&text);
    assert!(error.contains("line 5: Sphere") && error.contains("nowhere.loden"), "{error}");
    assert!(read_error(&text.replace("string material", "string file")).contains("no \"string material\""));
}

#[test]
fn objects_can_be_instanced_several_times() {
    let found = scene(&format!(
        "Declare \"Cs\" \"varying color\" {HEAD}
        Translate 0 0 5 ObjectBegin \"pair\" Sphere 1 -1 1 360 Translate 3 0 0 Sphere 1 -1 1 360 ObjectEnd
        Translate 0 2 0 ObjectInstance \"pair\" Scale .5 .5 .5 ObjectInstance \"pair\" WorldEnd"
    ));
    assert_eq!(found.bodies.len(), 4);
    let centre = |k: usize| found.bodies[k].shape.bounds().centre;
    assert!((centre(1) - Vec3::new(3.0, 2.0, -5.0)).length() < 1e-5, "{}", centre(1));
    assert!((centre(3) - Vec3::new(1.5, 2.0, -5.0)).length() < 1e-5);
    let meshes = found.bodies.iter().filter(|b| matches!(b.shape, Shape::Instance(_)));
    assert_eq!(meshes.count(), 4);
}

#[test]
fn options_set_image_and_camera() {
    let found = scene(
        "Format 320 200 1\nProjection \"orthographic\"\nScreenWindow -2 2 -1 1\n\
        Imager \"background\" \"color background\" [.1 .2 .3]\nDepthOfField 2 1 7\nWorldBegin Sphere 1 -1 1 360 WorldEnd",
    );
    assert_eq!((found.settings.width, found.settings.height), (320, 200));
    assert_eq!(found.camera.window, Some([-2.0, 2.0, -1.0, 1.0]));
    assert_eq!(found.camera.projection, Projection::Orthographic { height: 2.0 });
    assert_eq!(found.camera.lens, Lens { radius: 0.25, focus: 7.0 });
    assert_eq!(found.background, Some(Vec3::new(0.1, 0.2, 0.3)));
    let wide = scene("Format 100 100 2\nWorldBegin Sphere 1 -1 1 360 WorldEnd");
    assert_eq!(wide.camera.window, Some([-2.0, 2.0, -1.0, 1.0]));
}

#[test]
fn polygons_without_texture_coordinates_take_x_and_y_of_the_object() {
    let uv = |shape: &str| hit(&scene(&format!("{HEAD}{shape} WorldEnd")), 0.25, -0.25).unwrap().2;
    let corners = "\"P\" [-1 -1 2  -1 1 2  1 1 2  1 -1 2]";
    let given = uv(&format!("Polygon {corners} \"st\" [-1 -1 -1 1 1 1 1 -1]"));
    for shape in [format!("Polygon {corners}"), format!("PointsPolygons [4] [0 1 2 3] {corners}")] {
        assert!((uv(&shape) - given).length() < 1e-5, "{shape}");
        assert!((uv(&format!("Scale 2 2 1 {shape}")) - given).length() > 0.1, "object coordinates");
    }
}

#[test]
fn levels_of_detail_and_invisible_shapes_are_chosen() {
    let ball = "Sphere 1 -1 1 360";
    let near = format!(
        "{HEAD} Translate 0 0 5 AttributeBegin Detail [-1 1 -1 1 -1 1]
        DetailRange [0 0 100 100] {ball} {ball} Scale 2 2 2 {ball} DetailRange [100 100 1e38 1e38] {ball} AttributeEnd
        Attribute \"visibility\" \"int camera\" [0] {ball} WorldEnd"
    );
    assert_eq!(scene(&near).bodies.len(), 1);
    let far = near.replace("0 0 5", "0 0 500");
    let found = scene(&far);
    assert_eq!(found.bodies.len(), 2, "one of three lies on another");
    assert!(found.warnings.join(" ").contains("the camera does not see"));
}

#[test]
fn surface_parameters_set_the_texture_map() {
    let dir = tempfile::tempdir().unwrap();
    let sphere = |parameters: &str| {
        let path = dir.path().join("a.rib");
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/pvmf-u8.loden");
        let surface = format!("Surface \"loden\" \"string material\" [\"{file}\"] {parameters}");
        fs::write(&path, format!("{HEAD}Translate 0 0 4 {surface} Translate 0 0 1 Sphere 1 -1 1 360 WorldEnd"))
            .unwrap();
        read(&path, &Reading::default())
    };
    let Ok(plain) = sphere("") else { panic!("{:?}", sphere("").err()) };
    assert_eq!(plain.bodies[0].texture, TextureMap::default());
    let found = sphere(
        "\"scale\" 3 \"samples\" 4 \"rotation\" 20 \"string wrap\" [\"mirror\"] \"string mapping\" [\"cylinder\"] \
         \"point centre\" [1 2 0] \"vector axis\" [0 2 1]",
    );
    let expected = TextureMap {
        scale: 3.0,
        rotation_degrees: 20.0,
        wrap: Wrap::Mirror,
        samples: 4,
        // In the coordinates of the surface, z negated.
        mapping: Mapping::Cylinder { centre: Vec3::new(1.0, 2.0, -4.0), axis: Vec3::new(0.0, 2.0, -1.0) },
    };
    assert_eq!(found.unwrap_or_else(|e| panic!("{e}")).bodies[0].texture, expected);
    for (wrong, expected) in [
        ("\"string wrap\" [\"often\"]", "wrap: found \"often\""),
        ("\"string mapping\" [\"cone\"]", "mapping: found \"cone\""),
        ("\"string mapping\" [\"triplanar\"]", "mapping"),
        ("\"string mapping\" [\"plane\"] \"vector u\" [1 0 0] \"vector v\" [1 0 0]", "u perpendicular to v"),
    ] {
        let error = sphere(wrong).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(expected), "{wrong}: {error}");
    }
}
