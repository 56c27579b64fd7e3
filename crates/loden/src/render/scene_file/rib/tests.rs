use std::fs;
use std::io::Write;

use glam::Vec2;

use super::*;
use crate::render::{AreaLight, Emitter, Lens, Light, Mapping, Settings, Shape, Wrap};

fn write(name: &str, content: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    fs::write(&path, content).unwrap();
    (dir, path)
}

fn scene(text: &str) -> SceneFile {
    let (_dir, path) = write("a.rib", text);
    read(&path, None).unwrap()
}

fn read_error(text: &str) -> String {
    let (_dir, path) = write("a.rib", text);
    read(&path, None).err().map(|e| e.to_string()).expect("an error")
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
        let found = scene(&format!("{HEAD}{text} WorldEnd"));
        let seen =
            (0..400).filter(|k| hit(&found, (k % 20) as f32 / 10.0 - 0.95, (k / 20) as f32 / 10.0 - 0.95).is_some());
        assert!(seen.count() > 5 && found.warnings.is_empty(), "{text}: {:?}", found.warnings);
    }
}

#[test]
fn lights_have_renderman_units() {
    use std::f32::consts::PI;
    let found = scene(&format!(
        "LightSource \"ambientlight\" 1 \"intensity\" [.5] \"lightcolor\" [1 .5 0]
        {HEAD}LightSource \"distantlight\" 2 \"intensity\" 2 \"from\" [0 0 0] \"to\" [0 0 3]
        Translate 0 1 0
        LightSource \"pointlight\" \"lamp\" \"uniform float intensity\" [3] \"from\" [0 0 5]
        LightSource \"spotlight\" 4 \"from\" [0 0 0] \"to\" [1 0 0] \"coneangle\" [0.5] \"conedeltaangle\" [.1]
        AttributeBegin AreaLightSource \"arealight\" 5 \"lightcolor\" [4 4 4] Translate 0 0 6 Disk 0 2 360
        Polygon \"P\" [-1 -1 0 -1 1 0 1 1 0 1 -1 0] Sphere 1 -1 1 360 Cone 1 1 360 AttributeEnd
        Sphere 1 -1 1 360 WorldEnd"
    ));
    assert_eq!(found.environment.radiance(Vec3::X), Vec3::new(0.5, 0.25, 0.0));
    let [
        Light::Directional(sun),
        Light::Point(point),
        Light::Spot(spot),
        Light::Area(disk),
        Light::Area(quad),
        Light::Area(ball),
    ] = &found.lights[..]
    else {
        panic!("{:?}", found.lights)
    };
    assert_eq!((sun.direction, sun.irradiance), (Vec3::Z, Vec3::splat(2.0 * PI)));
    assert_eq!((point.position, point.intensity), (Vec3::new(0.0, 1.0, -5.0), Vec3::splat(3.0 * PI)));
    assert!((spot.axis - Vec3::X).length() < 1e-6 && (spot.angle_degrees - 0.5f32.to_degrees()).abs() < 1e-4);
    assert_eq!(spot.falloff, 2.0);
    assert_eq!(disk.radiance, Vec3::splat(4.0));
    // The outside of the disk is RenderMan's +z, away from the camera; that of the clockwise polygon faces the camera.
    let side = |light: &AreaLight| match light.shape {
        Emitter::Disk(flat) | Emitter::Rectangle(flat) => flat.x.cross(flat.y).z,
        Emitter::Sphere { .. } => 0.0,
    };
    assert!(side(disk) < 0.0 && side(quad) > 0.0);
    assert!(matches!(ball.shape, Emitter::Sphere { radius, .. } if (radius - 1.0).abs() < 1e-6));
    assert_eq!(found.bodies.len(), 2, "the cone and the last sphere");
    assert!(found.warnings.len() == 1 && found.warnings[0].contains("AreaLightSource on Cone"), "{:?}", found.warnings);
}

#[test]
fn standard_surfaces_become_models() {
    let sphere = "Sphere 1 -1 1 360";
    let found = scene(&format!(
        "{HEAD}Color 1 .5 .25 {sphere} Surface \"matte\" \"Kd\" .5 {sphere} {sphere}
        Surface \"plastic\" \"Kd\" [.4] \"Ks\" [.3] {sphere} Surface \"metal\" {sphere} Surface \"shinymetal\" {sphere}
        Surface \"marble\" {sphere} WorldEnd"
    ));
    assert_eq!(found.materials.len(), 6, "equal ones are shared");
    let value = |k: usize, wi: Vec3, wo: Vec3| found.materials[k].material.eval(Vec2::ZERO, wi, wo);
    let (wi, wo) = (Vec3::new(0.3, 0.1, 0.9).normalize(), Vec3::new(-0.5, 0.2, 0.7).normalize());
    let pi = std::f32::consts::PI;
    assert!((value(1, wi, wo) - 0.5 * Vec3::new(1.0, 0.5, 0.25) / pi).length() < 1e-6);
    // RenderMan's plastic: Kd Cs (n.l) + Ks (n.h)^(1 / roughness) for a light of irradiance pi
    let highlight = 0.3 * (wi + wo).normalize().z.powi(10);
    let expected = 0.4 * Vec3::new(1.0, 0.5, 0.25) * wi.z + Vec3::splat(highlight);
    assert!((value(2, wi, wo) * pi * wi.z - expected).length() < 1e-5);
    assert!(found.warnings.len() == 1 && found.warnings[0].contains("marble") && found.warnings[0].contains("line 5"));
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
fn ignored_requests_are_reported_once_with_their_line() {
    let found = scene(&format!(
        "Display \"a.tif\" \"file\" \"rgb\"\n{HEAD}\nBlobby 1 2\nBlobby 3 4
        Option \"limits\" \"bucketsize\" [16 16]\nLightSource \"skylight\" 9\nSides 1
        Sphere 1 -1 1 360 \"Cs\" [1 0 0  1 0 0  1 0 0  1 0 0]
        MotionBegin [0 1] Translate 0 0 1 Translate 0 0 9 MotionEnd
        ArchiveBegin \"x\" Sphere 9 -9 9 360 ArchiveEnd Sphere 1 -1 1 360 Geometry \"teapot\"
        SubdivisionMesh \"catmull-clark\" [3] [0 1 2] [\"interpolateboundary\" \"smooth\"] [0 0 0 0] [] [] \
          \"P\" [0 0 0 1 0 0 0 1 0] WorldEnd"
    ));
    let all = found.warnings.join("\n");
    let expected = [
        "line 1: ignored Display",
        "line 5: ignored Blobby (2 times)",
        "Option \"limits\" \"bucketsize\"",
        "LightSource \"skylight\"",
        "Sides 1",
        "varying shape parameter \"Cs\"",
        "MotionBegin",
        "Geometry \"teapot\"",
        "the SubdivisionMesh tag \"smooth\"",
    ];
    assert_contains_all(&all, &expected);
    assert_eq!(found.warnings.len(), 9, "{all}");
    assert_eq!(found.bodies.len(), 3);
    assert!((found.bodies[1].shape.bounds().centre.z + 1.0).abs() < 1e-5, "the first time of the motion");
}

#[test]
fn mistakes_are_named_with_file_line_and_request() {
    for (text, expected) in [
        ("\nSphere 1 2", "a.rib: line 2: Sphere: expected 4 numbers"),
        ("\n\nSphere 0 -1 1 360", "line 3: Sphere: quadric"),
        ("Polygon \"P\" [1 2]", "line 1: Polygon: P: found 2 numbers"),
        ("Polygon \"N\" [0 0 1]", "the parameter P is missing"),
        ("PointsPolygons [3] [0 1 5] \"P\" [0 0 0 1 0 0 0 1 0]", "vertex index 5"),
        ("PointsPolygons [4] [0 1 2] \"P\" [0 0 0 1 0 0 0 1 0]", "fewer vertex indices"),
        ("PointsPolygons [3] [0 1 .5] \"P\" [0 0 0]", "found 0.5, expected non-negative integers"),
        ("Patch \"quartic\" \"P\" [0 0 0]", "bicubic or bilinear"),
        ("PatchMesh \"bicubic\" 5 \"nonperiodic\" 4 \"nonperiodic\" \"P\" [0 0 0]", "whole patches"),
        ("Basis \"bezier\" 9 \"bezier\" 3", "expected two bases"),
        ("SubdivisionMesh \"loop\" [3] [0 1 2] \"P\" [0 0 0 1 0 0 0 1 0]", "catmull-clark"),
        ("AttributeEnd", "no block is open"),
        (
            "AttributeBegin\nTransformEnd",
            "line 2: TransformEnd: expected AttributeEnd, which closes the block of line 1",
        ),
        ("\nWorldBegin", "line 2: WorldBegin: the block is not closed"),
        ("ObjectInstance 4", "there is no object \"4\""),
        ("ReadArchive \"missing.rib\"", "missing.rib"),
        ("Format 0 5 1", "found a resolution of 0"),
        ("Rotate 90 0 0 0", "the axis has length 0"),
        ("Projection \"fisheye\"", "fisheye"),
        ("Color [1 2]", "expected 3 numbers"),
        ("Surface 5", "expected a string"),
        ("Surface \"matte\" \"Kd\"", "a parameter name and a value"),
        ("Sphere 1 -1 1 360 [1", "an array is not closed"),
        ("Sphere ]", "found ] without a matching ["),
        ("Option \"a\" \"b\" [1 \"c\"]", "numbers and strings"),
        ("\"loose\"", "expected a request"),
        ("Scale 0 1 1 Sphere 1 -1 1 360", "singular"),
        ("LightSource \"pointlight\" 1 \"intensity\" [-1]", "intensity"),
    ] {
        let error = read_error(text);
        assert!(error.contains(expected), "{text}: {error}");
    }
}

#[test]
fn archives_are_found_beside_the_file_and_in_the_search_path() {
    let (dir, path) = write(
        "a.rib",
        "Option \"searchpath\" \"archive\" [\"parts:other\"] WorldBegin
        ReadArchive \"ball.rib\" Procedural \"DelayedReadArchive\" [\"cube.rib\"] [-1 1 -1 1 -1 1] WorldEnd",
    );
    fs::create_dir(dir.path().join("other")).unwrap();
    fs::write(dir.path().join("ball.rib"), "Sphere 1 -1 1 360").unwrap();
    fs::write(dir.path().join("other/cube.rib"), "# a flat one\nDisk 0 1 360\n").unwrap();
    assert_eq!(read(&path, None).unwrap().bodies.len(), 2);
    fs::write(dir.path().join("other/cube.rib"), "\nDisk 0 1 nonsense").unwrap();
    let error = read(&path, None).err().unwrap().to_string();
    assert!(error.contains("cube.rib: line 2: Disk"), "{error}");
    fs::write(dir.path().join("other/cube.rib"), "ReadArchive \"../a.rib\"").unwrap();
    assert!(read(&path, None).err().unwrap().to_string().contains("deep"), "a circle ends");
}

#[test]
fn compressed_and_binary_files_equal_text() {
    let text = format!("{HEAD}Translate 0 0 4\nSphere 1 -1 1 360\nWorldEnd\n");
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    let zipped = encoder.finish().unwrap();
    let mut binary = b"Projection \x9bperspective".to_vec();
    binary.extend([0o315, 0, 0o223]);
    binary.extend(b"fov");
    binary.extend([0o317, 0, 0o200, 90]);
    for (code, name) in [(1, "WorldBegin"), (2, "Translate"), (3, "Sphere"), (4, "WorldEnd")] {
        binary.extend([0o314, code, 0o220 + name.len() as u8]);
        binary.extend(name.as_bytes());
    }
    binary.extend([0o246, 1, 0o246, 2, 0o310, 3]);
    [0f32, 0.0, 4.0].iter().for_each(|v| binary.extend(v.to_be_bytes()));
    binary.extend([0o246, 3, 0o200, 1, 0o200, 0xff, 0o200, 1, 0o201, 1, 104, 0o246, 4]);
    let expected = scene(&text);
    for bytes in [&zipped, &binary] {
        let (_dir, path) = write("a.rib", bytes);
        let found = read(&path, None).unwrap();
        assert_eq!(found.camera, expected.camera);
        assert_eq!(found.bodies.len(), 1);
        assert_eq!(hit(&found, 0.1, 0.0), hit(&expected, 0.1, 0.0));
    }
    let (_dir, path) = write("a.rib", &zipped[..zipped.len() - 12]);
    assert!(read(&path, None).err().unwrap().to_string().contains("gzip"));
}

#[test]
fn random_bytes_never_panic() {
    let text = format!(
        "{HEAD}Surface \"plastic\" \"Kd\" [.5]\nPatchMesh \"bilinear\" 3 \"periodic\" 2 \"nonperiodic\" \"P\" \
        [-1 -1 2 0 -1 2 1 -1 2 -1 1 2 0 1 2 1 1 2]\nPolygon \"P\" [0 0 0 1 0 0 0 1 0]\nWorldEnd\n"
    );
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.rib");
    let mut random = 12_345u32;
    for _ in 0..500 {
        let mut bytes = text.clone().into_bytes();
        for _ in 0..3 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let at = random as usize / 7 % bytes.len();
            bytes[at] = (random >> 24) as u8;
        }
        fs::write(&path, &bytes).unwrap();
        let _ = read(&path, None);
    }
}

/// A file as exporters write it: frames, a shadow pass first, an inline archive, custom names.
const EXPORTED: &str = r#"##RenderMan RIB-Structure 1.1
##Scene: three balls
##Creator: an exporter
version 3.03
Option "searchpath" "string archive" ["./archives:&"] "string shader" ["./shaders:&"]
Declare "Kglow" "uniform float"
FrameBegin 1
    Format 64 32 1
    Display "shadow.z" "zfile" "z"
    Projection "orthographic"
    WorldBegin
        Sphere 9 -9 9 360
        ReadArchive "nowhere.rib"
    WorldEnd
    MakeShadow "shadow.z" "shadow.sm"
FrameEnd
FrameBegin 2
    Display "beauty.tif" "file" "rgba" "int[4] quantize" [0 255 0 255]
    Display "+beauty.z" "zfile" "z"
    PixelSamples 4 4
    ShadingRate 1
    Hider "hidden" "int jitter" [1]
    Projection "perspective" "fov" [45]
    Transform [1 0 0 0  0 1 0 0  0 0 1 0  0 0 5 1]
    WorldBegin
        ArchiveBegin "ball"
            AttributeBegin
                Attribute "identifier" "string name" ["ball"]
                Attribute "visibility" "int diffuse" [1]
                Surface "glow" "Kglow" 2
                ReverseOrientation
                Sphere .5 -.5 .5 360
            AttributeEnd
        ArchiveEnd
        LightSource "shadowspot" "key" "string shadowname" ["shadow.sm"] "intensity" 8 "from" [0 4 0] "to" [0 0 0]
        Illuminate "key" 1
        TransformBegin
            CoordinateSystem "here"
            Translate -1 0 0
            ReadArchive "ball"
            Translate 2 0 0
            Procedural "DelayedReadArchive" ["ball"] [-1 1 -1 1 -1 1]
        TransformEnd
        AttributeBegin
            Attribute "identifier" "name" "soft ball"
            SubdivisionMesh "catmull-clark" [4 4 4 4 4 4] [0 1 3 2 2 3 5 4 4 5 7 6 6 7 1 0 1 7 5 3 6 0 2 4]
                ["interpolateboundary"] [0 0] [] []
                "vertex point P" [-1 -1 1  1 -1 1  -1 1 1  1 1 1  -1 1 -1  1 1 -1  -1 -1 -1  1 -1 -1]
        AttributeEnd
        NuPatch 4 4 [0 0 0 0 1 1 1 1] 0 1 4 4 [0 0 0 0 1 1 1 1] 0 1 "Pz" [0 0 0 0  0 0 0 0  0 0 0 0  0 0 0 0]
        Points "P" [0 0 0  1 0 0] "constantwidth" [.1]
        Curves "cubic" [4] "nonperiodic" "P" [0 0 0  1 0 0  1 1 0  0 1 0] "constantwidth" [.1]
    WorldEnd
FrameEnd
"#;

#[test]
fn exported_files_are_read_or_warned_about() {
    let found = scene(EXPORTED);
    assert_eq!((found.bodies.len(), found.lights.len()), (3, 1));
    let spheres: Vec<f32> = found.bodies[..2].iter().map(|body| body.shape.bounds().centre.x).collect();
    assert_eq!(spheres, [-1.0, 1.0]);
    assert!(hit(&found, 0.0, 0.0).is_some_and(|(t, ..)| t > 3.9 && t < 4.6), "the subdivided cube is round");
    assert_eq!(found.settings, Settings::default(), "options of the first frame ended with it");
    assert_eq!(found.camera.projection, Projection::Perspective { field_of_view_degrees: 45.0 });
    let all = found.warnings.join("\n");
    let expected = [
        "line 5: ignored Option \"searchpath\" \"shader\"",
        "line 9: ignored Display (3 times)",
        "line 11: ignored the world of a depth map",
        "line 15: ignored MakeShadow",
        "line 22: ignored Hider \"hidden\"",
        "line 29: ignored Attribute \"visibility\" (2 times)",
        "line 30: ignored Surface \"glow\" (matte is used)",
        "line 36: ignored Illuminate",
        "line 50: ignored NuPatch",
        "line 51: ignored Points",
        "line 52: ignored Curves",
    ];
    assert_contains_all(&all, &expected);
    assert!(!all.contains("identifier"), "{all}");
}

#[test]
fn recursive_inline_archives_end() {
    let error = read_error("ArchiveBegin \"a\" ReadArchive \"a\" ArchiveEnd\nReadArchive \"a\"");
    assert!(error.contains("more than 32 deep"), "{error}");
    let error = read_error("ReadArchive \"a\"");
    assert!(error.contains("a:"), "a file's name where there is no archive: {error}");
    let unfinished = scene("ArchiveBegin \"a\" Sphere 1 -1 1 360");
    let all = unfinished.warnings.join("\n");
    assert!(all.contains("archive \"a\" is not closed") && all.contains("the scene has no shapes"), "{all}");
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
        read(&path, None)
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

#[test]
fn objects_of_objects_have_a_limit() {
    let level = |k: usize| format!("ObjectBegin {} {} ObjectEnd ", k + 1, format!("ObjectInstance {k} ").repeat(32));
    let text = format!("{HEAD}ObjectBegin 0 Sphere 1 -1 1 360 ObjectEnd {}", (0..6).map(level).collect::<String>());
    let error = read_error(&text);
    assert!(error.contains("more than 1048576 shapes"), "{error}");
}
