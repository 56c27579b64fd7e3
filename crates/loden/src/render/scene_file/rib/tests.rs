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
        LightSource \"spotlight\" 6 \"from\" [0 0 0] \"to\" [1 0 0] \"coneangle\" [40] \"conedeltaangle\" [3]
        AttributeBegin AreaLightSource \"arealight\" 5 \"lightcolor\" [4 4 4] Translate 0 0 6 Disk 0 2 360
        Polygon \"P\" [-1 -1 0 -1 1 0 1 1 0 1 -1 0] Sphere 1 -1 1 360 Cone 1 1 360 AttributeEnd
        Sphere 1 -1 1 360 WorldEnd"
    ));
    let Light::Shadowless(light) = &found.lights[0] else { panic!("{:?}", found.lights) };
    let plain: Vec<&Light> = found.lights[..4]
        .iter()
        .map(|light| match light {
            Light::Shadowless(light) => light.as_ref(),
            other => panic!("{other:?} casts shadows"),
        })
        .collect();
    assert_eq!(plain[0], light.as_ref());
    let [Light::Directional(sun), Light::Point(point), Light::Spot(spot), Light::Spot(wide)] = plain[..] else {
        panic!("{plain:?}")
    };
    let [Light::Area(disk), Light::Area(quad), Light::Area(ball)] = &found.lights[4..] else {
        panic!("{:?}", found.lights)
    };
    assert_eq!((sun.direction, sun.irradiance), (Vec3::Z, Vec3::splat(2.0 * PI)));
    assert_eq!((point.position, point.intensity), (Vec3::new(0.0, 1.0, -5.0), Vec3::splat(3.0 * PI)));
    assert!((spot.axis - Vec3::X).length() < 1e-6 && (spot.angle_degrees - 0.5f32.to_degrees()).abs() < 1e-4);
    assert_eq!((wide.angle_degrees, wide.edge_degrees), (40.0, 3.0), "no number of radians");
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
    let cone = found.materials[found.bodies[0].material].material.own(Vec2::ZERO, Vec3::Z);
    assert_eq!(cone.emitted, Vec3::splat(4.0));
    // matte under ambient light
    let ball = found.materials[found.bodies[1].material].material.own(Vec2::ZERO, Vec3::Z);
    assert_eq!((ball.shown, ball.emitted), (Vec3::new(0.5, 0.25, 0.0), Vec3::ZERO));
    assert!(found.warnings.len() == 1 && found.warnings[0].contains("Cone emits light"), "{:?}", found.warnings);
}

/// A light behind the camera, without shadows.
const SUN: &str = "LightSource \"distantlight\" 1 ";

#[test]
fn standard_surfaces_become_models() {
    let sphere = "Sphere 1 -1 1 360";
    let found = scene(&format!(
        "{HEAD}{SUN} Color 1 .5 .25 {sphere} Surface \"matte\" \"Kd\" .5 {sphere} {sphere}
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
        "Display \"a.tif\" \"file\" \"rgb\"\n{HEAD}{SUN}\nTrimCurve 1 2\nTrimCurve 3 4
        Option \"limits\" \"bucketsize\" [16 16]\nLightSource \"skylight\" 9\nSides 1
        Sphere 1 -1 1 360 \"varying float heat\" [1 0 0 1]
        MotionBegin [0 1] Translate 0 0 1 Translate 0 0 9 MotionEnd
        ArchiveBegin \"x\" Sphere 9 -9 9 360 ArchiveEnd Sphere 1 -1 1 360 Geometry \"cow\"
        SubdivisionMesh \"catmull-clark\" [3] [0 1 2] [\"interpolateboundary\" \"smooth\"] [0 0 0 0] [] [] \
          \"P\" [0 0 0 1 0 0 0 1 0] WorldEnd"
    ));
    let all = found.warnings.join("\n");
    let expected = [
        "line 1: ignored Display",
        "line 4: ignored TrimCurve (2 times)",
        "line 6: ignored Option \"limits\" \"bucketsize\"",
        "line 7: LightSource \"skylight\" is unknown: a constant environment is used",
        "line 8: ignored Sides 1",
        "line 9: ignored the varying shape parameter \"heat\"",
        "line 10: ignored motion blur",
        "line 11: ignored Geometry \"cow\"",
        "line 12: ignored the SubdivisionMesh tag \"smooth\"",
    ];
    assert_contains_all(&all, &expected);
    assert_eq!(found.warnings.len(), 9, "{all}");
    let lines: Vec<&str> = found.warnings.iter().map(|w| w.split("line ").nth(1).unwrap()).collect();
    let line = |text: &str| text.split(':').next().unwrap().parse::<usize>().unwrap();
    assert!(lines.windows(2).all(|pair| line(pair[0]) <= line(pair[1])), "{all}");
    assert_eq!(found.bodies.len(), 3);
    assert!((found.bodies[1].shape.bounds().centre.z + 1.0).abs() < 1e-5, "the first time of the motion");
}

#[test]
fn mistakes_are_skipped_and_named_with_file_line_and_request() {
    for (text, expected) in [
        ("\nSphere 1 2", "a.rib: line 2: skipped Sphere: expected 4 numbers"),
        ("\n\nSphere 0 -1 1 360", "line 3: skipped Sphere: quadric"),
        ("Polygon \"P\" [1 2]", "line 1: skipped Polygon: P: found 2 numbers"),
        ("Polygon \"N\" [0 0 1]", "the parameter P is missing"),
        ("PointsPolygons [] [] \"P\" []", "skipped PointsPolygons"),
        ("PointsPolygons [3] [0 1 5] \"P\" [0 0 0 1 0 0 0 1 0]", "vertex index 5"),
        ("PointsPolygons [4] [0 1 2] \"P\" [0 0 0 1 0 0 0 1 0]", "fewer vertex indices"),
        ("PointsPolygons [3] [0 1 .5] \"P\" [0 0 0]", "found 0.5, expected non-negative integers"),
        ("Patch \"quartic\" \"P\" [0 0 0]", "bicubic or bilinear"),
        ("PatchMesh \"bicubic\" 5 \"nonperiodic\" 4 \"nonperiodic\" \"P\" [0 0 0]", "whole patches"),
        ("NuPatch 3 3 [0 0 0 1] 0 1 3 3 [0 0 0 1 1 1] 0 1 \"P\" [0 0 0]", "found 4 knots, expected 6"),
        ("Curves \"cubic\" [4] \"nonperiodic\" \"P\" [0 0 0]", "found 1 points, expected 4"),
        ("Blobby 1 [1001 3] [1 0 0] []", "expected 16 from 3 on"),
        ("Basis \"bezier\" 9 \"bezier\" 3", "expected two bases"),
        ("SubdivisionMesh \"loop\" [3] [0 1 2] \"P\" [0 0 0 1 0 0 0 1 0]", "subdivided as catmull-clark"),
        ("AttributeEnd", "skipped AttributeEnd: there is no AttributeBegin before it"),
        ("AttributeBegin\nTransformEnd", "line 2: skipped TransformEnd"),
        ("TransformBegin AttributeBegin\nTransformEnd", "line 2: TransformEnd closes the AttributeBegin of line 1"),
        ("WorldBegin AttributeBegin Sphere 1 -1 1 360\nWorldEnd", "WorldEnd closes the AttributeBegin of line 1"),
        ("\nWorldBegin", "line 2: WorldBegin is not closed"),
        ("ObjectInstance 4", "there is no object \"4\""),
        ("\nReadArchive \"missing.rib\"", "line 2: skipped ReadArchive: the archive \"missing.rib\" is missing"),
        ("Format 0 5 1", "found a resolution of 0"),
        ("Rotate 90 0 0 0", "the axis has length 0"),
        ("Projection \"fisheye\"", "Projection \"fisheye\" is unknown: perspective is used"),
        ("Projection \"perspective\" \"fov\" 200", "found a field of view of 200 degrees"),
        ("Color [1 2]", "expected 3 numbers"),
        ("Surface 5", "expected a string"),
        ("Surface \"matte\" \"Kd\"", "a parameter name and a value"),
        ("Sphere 1 -1 1 360 [1", "an array is not closed"),
        ("Sphere ]", "found ] without a matching ["),
        ("Option \"a\" \"b\" [1 \"c\"]", "numbers and strings"),
        ("\"loose\"\n", "expected a request"),
        ("% &\n", "starts no token"),
        ("Scale 0 1 1 Sphere 1 -1 1 360", "singular"),
        ("LightSource \"pointlight\" 1 \"intensity\" [-1]", "intensity"),
        ("IfBegin \"(1\" IfEnd", "the condition counts as false: a parenthesis is not closed"),
        ("\nElse", "line 2: skipped Else: there is no IfBegin"),
        ("\nIfBegin \"1\"", "line 2: IfBegin is not closed"),
    ] {
        // The rest of the scene is drawn.
        let found = scene(&format!("{text} Sphere 1 -1 1 360"));
        let all = found.warnings.join("\n");
        assert!(all.contains(expected), "{text}: {all}");
        let swallowed = ["[1", "Scale 0", "missing.rib", "IfBegin \"1\""].iter().any(|part| text.contains(part));
        assert!(!found.bodies.is_empty() || swallowed, "{text}: {all}");
    }
    assert!(read_error("a picture?").contains("found no request of RIB"));
}

#[test]
fn single_quotes_and_marks_and_old_line_ends_are_read() {
    let found = scene(
        "\u{feff}Projection 'perspective' 'fov' [30]\rTranslate 0 0 5 # here\rWorldBegin Sphere 1 -1 1 360 WorldEnd",
    );
    assert_eq!(found.camera.projection, Projection::Perspective { field_of_view_degrees: 30.0 });
    assert_eq!(found.bodies.len(), 1);
}

#[test]
fn one_branch_of_a_condition_is_drawn() {
    let bodies =
        |text: &str| scene(&format!("Option \"user\" \"string pass\" [\"fast\"] {HEAD} {text} WorldEnd")).bodies.len();
    let [one, two, three] = [1, 2, 3].map(|n| "Sphere 1 -1 1 360 Translate 0 0 1 ".repeat(n));
    for (text, expected) in [
        (format!("IfBegin \"0\" {one} Else {two} IfEnd"), 2),
        (format!("IfBegin \"$user:pass == 'fast'\" {one} ElseIf \"1\" {two} Else {three} IfEnd"), 1),
        (format!("IfBegin \"0\" {one} ElseIf \"$pass == 'fast'\" {two} Else {three} IfEnd"), 2),
        (format!("IfBegin \"0\" IfBegin \"1\" {one} Else {two} IfEnd {one} Else {three} IfEnd"), 3),
        (format!("IfBegin \"0\" ArchiveBegin \"a\" {one} ArchiveEnd IfEnd {two}"), 2),
    ] {
        assert_eq!(bodies(&text), expected, "{text}");
    }
}

/// The middle pixel of a scene without noise.
fn middle(text: &str) -> Vec3 {
    middle_with(text, &Reading::default())
}

fn middle_with(text: &str, reading: &Reading) -> Vec3 {
    let (_dir, path) = write("a.rib", format!("{HEAD}{text} WorldEnd"));
    let scene = read(&path, reading).unwrap_or_else(|e| panic!("{e}"));
    let settings = Settings { width: 3, height: 3, spp: 256, ..Settings::default() };
    render(&scene.scene(), &settings, &crate::progress::Silent).unwrap().at(1, 1)
}

fn assert_color(text: &str, expected: Vec3, tolerance: f32) {
    let found = middle(text);
    assert!((found - expected).abs().max_element() <= tolerance, "{text}: {found}, expected {expected}");
}

/// A square that fills the image.
const WALL: &str = "Polygon \"P\" [-9 -9 2  -9 9 2  9 9 2  9 -9 2]";

#[test]
fn surfaces_without_light_are_visible() {
    let color = "Color [.9 .5 .2]";
    let expected = Vec3::new(0.9, 0.5, 0.2);
    // RenderMan's default surface: .2 Cs + .8 Cs cos^2; the rays of the middle pixel are nearly perpendicular
    assert_color(&format!("{color} {WALL}"), expected, 0.06);
    assert_color(&format!("{color} Surface \"constant\" {WALL}"), expected, 1e-5);
    assert_color(&format!("{color} Surface \"constant\" {WALL} {SUN}"), expected, 1e-5);
    let tilted = middle("Translate 0 0 2 Rotate 60 0 1 0 Polygon \"P\" [-9 -9 0 -9 9 0 9 9 0 9 -9 0]");
    assert!((tilted - 0.4).abs().max_element() < 0.1, "{tilted}");
    let found = scene(&format!("{HEAD}{WALL} WorldEnd"));
    assert!(found.warnings.len() == 1 && found.warnings[0].contains("the world has no light"), "{:?}", found.warnings);
}

#[test]
fn ambient_light_is_ka_times_the_color() {
    let ambient = "LightSource \"ambientlight\" 1 \"intensity\" [.5]";
    let expected = Vec3::new(0.9, 0.5, 0.2);
    assert_color(&format!("{ambient} Color [.9 .5 .2] {WALL}"), 0.5 * expected, 1e-5);
    let plastic = "Surface \"plastic\" \"Ka\" [.1] \"Ks\" [.6] \"roughness\" [.4]";
    assert_color(&format!("{ambient} {plastic} Color [.9 .5 .2] {WALL}"), 0.05 * expected, 1e-5);
    // It neither adds up between surfaces nor is it shadowed.
    let corner = "Polygon \"P\" [-1 -9 1.9 -1 9 1.9  -1 9 0  -1 -9 0]";
    assert_color(&format!("{ambient} {corner} {WALL}"), Vec3::splat(0.5), 1e-5);
    // A measured material reflects it by its albedo.
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/pvmf-u8.loden");
    let lit = middle(&format!("{ambient} Surface \"loden\" \"string material\" [\"{file}\"] {WALL}"));
    assert!(lit.min_element() > 0.01 && lit.max_element() < 0.5, "{lit}");
}

#[test]
fn lights_cast_shadows_only_if_asked() {
    let backdrop = "Polygon \"P\" [-20 -20 -1 -20 20 -1 20 20 -1 20 -20 -1]";
    let lit = Vec3::ONE;
    assert_color(&format!("{SUN} Surface \"matte\" {WALL} {backdrop}"), lit, 0.05);
    let all = Reading { shadows: Some(Shadows::All), ..Reading::default() };
    let dark = |text: &str, reading: &Reading| middle_with(text, reading).max_element() < 0.2;
    let scene = format!("{SUN} Surface \"matte\" {WALL} {backdrop}");
    assert!(dark(&scene, &all));
    let asked = Reading { shadows: Some(Shadows::Asked), ..Reading::default() };
    for ask in [
        "Attribute \"light\" \"shadows\" \"on\" LightSource \"distantlight\" 1",
        "Attribute \"light\" \"string shadows\" [\"on\"] LightSource \"distantlight\" 1",
        "LightSource \"shadowdistant\" 1 \"string shadowname\" [\"raytrace\"]",
        "Light \"PxrDistantLight\" \"sun\"",
    ] {
        assert!(dark(&format!("{ask} Surface \"matte\" {WALL} {backdrop}"), &asked), "{ask}");
    }
    // Closed bodies stay black inside.
    assert_eq!(middle(&format!("{SUN} Surface \"matte\" Sphere 100 -100 100 360")), Vec3::ZERO);
}

#[test]
fn unknown_lights_become_the_nearest_known_one() {
    let kind = |text: &str| {
        let found = scene(&format!("{HEAD}LightSource {text} Sphere 1 -1 1 360 WorldEnd"));
        let all = found.warnings.join("\n");
        assert!(all.contains("is unknown") && all.contains("line 3"), "{text}: {all}");
        match found.lights.first() {
            Some(Light::Shadowless(light)) => match light.as_ref() {
                Light::Point(_) => "point",
                Light::Spot(_) => "spot",
                Light::Directional(_) => "distant",
                _ => "?",
            },
            Some(_) => "?",
            None => "sky",
        }
    };
    for (text, expected) in [
        ("\"uberlight\" 1 \"from\" [0 3 -3] \"intensity\" [10]", "point"),
        ("\"slide\" 1 \"from\" [0 3 -3] \"to\" [0 0 0] \"coneangle\" [.3]", "spot"),
        ("\"superSpotLight\" 1 \"from\" [0 3 -3]", "spot"),
        ("\"my_sun\" 1 \"intensity\" [2]", "distant"),
        ("\"rays\" 1 \"to\" [0 0 1]", "distant"),
        ("\"occlusionlight\" 1 \"filename\" [\"\"]", "sky"),
        ("\"bulb\" 1 \"decay\" [0] \"from\" [0 0 4]", "point"),
    ] {
        assert_eq!(kind(text), expected, "{text}");
    }
    // Without decay it is as bright at the middle of the scene as a distant light.
    let even = "LightSource \"bulb\" 1 \"decay\" [0] \"from\" [0 0 -48]";
    assert_color(&format!("{even} Surface \"matte\" {WALL}"), Vec3::ONE, 0.06);
}

#[test]
fn the_newer_interface_gives_light_and_color() {
    let red = "Bxdf \"PxrDiffuse\" \"b\" \"color diffuseColor\" [.8 .1 .1]";
    let expected = Vec3::new(0.8, 0.1, 0.1);
    let dome = "Light \"PxrDomeLight\" \"l\" \"float intensity\" [1]";
    assert_color(&format!("{dome} {red} {WALL}"), expected, 0.05);
    assert_color(&format!("Light \"PxrDistantLight\" \"l\" {red} {WALL}"), expected, 0.05);
    let pattern = "Pattern \"PxrVary\" \"p\" \"color inputRGB\" [.8 .1 .1]";
    let disney = "Bxdf \"PxrDisney\" \"b\" \"reference color baseColor\" [\"p:resultRGB\"] \"float specular\" [0]";
    assert_color(&format!("{dome} {pattern} {disney} {WALL}"), expected, 0.05);
    let glow = "Bxdf \"PxrConstant\" \"b\" \"color emitColor\" [.8 .1 .1]";
    assert_color(&format!("{glow} {WALL}"), expected, 1e-5);
    // A light of half the image's size, one unit away, facing the camera's wall
    let lamp = "AttributeBegin Translate 3 0 0 Light \"PxrRectLight\" \"l\" \"float intensity\" [20] AttributeEnd";
    assert!(middle(&format!("{lamp} {red} {WALL}")).x > 0.01);
}

#[test]
fn custom_surfaces_use_the_parameters_they_share_with_standard_ones() {
    let wear = |parameters: &str| format!("{SUN} Surface \"mine\" {parameters} {WALL}");
    assert_color(&wear(""), Vec3::ONE, 0.05);
    assert_color(&wear("\"Kd\" [.5]"), Vec3::splat(0.5), 0.05);
    assert_color(&wear("\"Kd\" [1] \"color basecolor\" [.2 .4 .6]"), Vec3::new(0.2, 0.4, 0.6), 0.05);
    assert_color(&wear("\"color speccolor\" [.2 .4 .6]"), Vec3::ONE, 0.05);
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("red.png");
    Picture::filled(2, 2, Vec3::new(1.0, 0.0, 0.0)).write(&file).unwrap();
    // The renderer's own texture is missing; the picture beside it is there.
    for name in ["red.png", "red.tx", "red.tif"] {
        let name = dir.path().join(name);
        assert_color(&wear(&format!("\"string texturename\" [\"{}\"]", name.display())), Vec3::X, 0.05);
    }
    let missing = scene(&format!("{HEAD}{} WorldEnd", wear("\"string colormap\" [\"nowhere.tx\"]")));
    let all = missing.warnings.join("\n");
    assert!(all.contains("line 3: the texture \"nowhere.tx\" is not used: it is missing"), "{all}");
}

#[test]
fn opacity_lets_what_is_behind_through() {
    let behind =
        "AttributeBegin Surface \"constant\" Color [0 1 0] Translate 0 0 2 Scale 9 9 9 Disk 0 9 360 AttributeEnd";
    let front = "Surface \"constant\" Color [1 0 0] Polygon \"P\" [-9 -9 2  -9 9 2  9 9 2  9 -9 2]";
    assert_color(&format!("{behind} Opacity [.25 .25 .25] {front}"), Vec3::new(0.25, 0.75, 0.0), 0.05);
    assert_color(&format!("{behind} Opacity [1 .5 0] {front}"), Vec3::new(1.0, 0.5, 0.0), 0.1);
    assert_color(&format!("{behind} Opacity [0 0 0] {front}"), Vec3::Y, 1e-5);
    assert_color(&format!("{behind} {front} \"Os\" [0 0 0 0 0 0 0 0 0 0 0 0]"), Vec3::Y, 1e-5);
    // Half of the light passes a transparent body.
    let lit = "Attribute \"light\" \"shadows\" \"on\" LightSource \"distantlight\" 1 Surface \"matte\"";
    let screen =
        "AttributeBegin Opacity [.5 .5 .5] Polygon \"P\" [-20 -20 -1 -20 20 -1 20 20 -1 20 -20 -1] AttributeEnd";
    assert_color(&format!("{lit} {screen} {WALL}"), Vec3::splat(0.5), 0.15);
}

#[test]
fn colors_vary_over_shapes() {
    let base = "Surface \"constant\" Translate 0 0 1";
    let four = "[1 0 0  1 0 0  0 0 1  0 0 1]";
    let mixed = Vec3::new(0.5, 0.0, 0.5);
    for shape in [
        format!("Patch \"bilinear\" \"P\" [-1 -1 0  1 -1 0  -1 1 0  1 1 0] \"Cs\" {four}"),
        format!("PatchMesh \"bilinear\" 2 \"nonperiodic\" 2 \"nonperiodic\" \"P\" [-1 -1 0 1 -1 0 -1 1 0 1 1 0] \"Cs\" {four}"),
        "Polygon \"P\" [-1 -1 0  1 -1 0  1 1 0  -1 1 0] \"Cs\" [1 0 0  1 0 0  0 0 1  0 0 1]".into(),
        "PointsPolygons [4] [0 1 3 2] \"P\" [-1 -1 0  1 -1 0  -1 1 0  1 1 0] \"varying color Cs\" [1 0 0 1 0 0 0 0 1 0 0 1]".into(),
        "SubdivisionMesh \"catmull-clark\" [4] [0 1 3 2] [\"interpolateboundary\"] [0 0] [] [] \
          \"P\" [-1 -1 0  1 -1 0  -1 1 0  1 1 0] \"vertex color Cs\" [1 0 0 1 0 0 0 0 1 0 0 1]".into(),
        format!("NuPatch 2 2 [0 0 1 1] 0 1 2 2 [0 0 1 1] 0 1 \"P\" [-1 -1 0 1 -1 0 -1 1 0 1 1 0] \"Cs\" {four}"),
    ] {
        assert_color(&format!("{base} {shape}"), mixed, 0.06);
    }
    let uniform = "PointsPolygons [4 4] [0 1 3 2 2 3 5 4] \"P\" [-1 -9 0 1 -9 0 -1 -3 0 1 -3 0 -1 3 0 1 3 0] \
      \"uniform color Cs\" [1 0 0 0 1 0]";
    assert_color(&format!("{base} {uniform}"), Vec3::Y, 1e-4);
    assert_color(&format!("{base} Disk 0 1 360 \"Cs\" [0 1 0 0 1 0 0 1 0 0 1 0]"), Vec3::Y, 1e-4);
}

#[test]
fn strands_points_and_blobs_are_drawn() {
    for shape in [
        "Points \"P\" [0 0 3  9 9 9] \"constantwidth\" [2]",
        "Points \"P\" [0 0 3  9 9 9] \"varying float width\" [2 .1]",
        "Curves \"linear\" [2 2] \"nonperiodic\" \"P\" [-3 0 3 3 0 3 9 9 9 9 9 8] \"constantwidth\" [2]",
        "Curves \"cubic\" [4] \"nonperiodic\" \"P\" [-3 0 3 -1 0 3 1 0 3 3 0 3] \"width\" [2 2]",
        "Basis \"b-spline\" 1 \"b-spline\" 1 Curves \"cubic\" [5] \"nonperiodic\" \
          \"P\" [-6 0 3 -3 0 3 0 0 3 3 0 3 6 0 3] \"constantwidth\" [2] \"uniform color Cs\" [1 1 1]",
        "Blobby 1 [1001 0] [2 0 0 0 0 2 0 0 0 0 2 0 0 0 4 1] []",
        "Blobby 2 [1001 0 1002 16 0 2 0 1] [2 0 0 0 0 2 0 0 0 0 2 0 0 0 4 1  -1 0 4 1 0 4 1  1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1] []",
        "NuPatch 4 4 [0 0 0 0 1 1 1 1] 0 1 4 4 [0 0 0 0 1 1 1 1] 0 1 \"Pz\" [1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1]",
        "Translate -.5 -.5 1 PatchMesh \"bilinear\" 3 \"nonperiodic\" 3 \"nonperiodic\" \"Pz\" [0 0 0 0 1 0 0 0 0]",
        "Translate 0 -1 9 Rotate -90 1 0 0 Geometry \"teapot\"",
        "Translate 0 0 2 Geometry \"cube\"",
        "Translate 0 0 2 Geometry \"sphere\"",
    ] {
        assert_color(&format!("Surface \"constant\" {shape}"), Vec3::ONE, 0.01);
    }
}

#[test]
fn the_last_picture_is_drawn_or_the_world_asked_for() {
    let file = |text: &str| write("a.rib", text);
    let sphere = |x: f32| format!("Translate {x} 0 5 Sphere 1 -1 1 360");
    let text = format!(
        "Projection \"perspective\"
        FrameBegin 1 Display \"bake\" \"null\" \"rgb\" WorldBegin {} WorldEnd FrameEnd
        FrameBegin 2 Display \"a\" \"file\" \"rgb\" LightSource \"pointlight\" 1 WorldBegin {} WorldEnd FrameEnd
        FrameBegin 3 Display \"b\" \"file\" \"rgb\" Format 40 30 1 WorldBegin {} Sphere 2 -2 2 360 WorldEnd FrameEnd
        FrameBegin 4 Display \"z\" \"shadow\" \"z\" WorldBegin {} WorldEnd FrameEnd
        FrameBegin 5 WorldBegin WorldEnd FrameEnd",
        sphere(1.0),
        sphere(2.0),
        sphere(3.0),
        sphere(4.0)
    );
    let (_dir, path) = file(&text);
    let drawn = |world: Option<usize>| read(&path, &Reading { world, ..Reading::default() });
    let last = drawn(None).unwrap();
    assert_eq!((last.bodies.len(), last.lights.len(), last.settings.width), (2, 0, 40));
    assert_contains_all(
        &last.warnings.join("\n"),
        &["found 5 worlds: number 3 (line 4) is drawn; --world chooses another"],
    );
    for (number, x) in [(1, 1.0), (2, 2.0), (3, 3.0), (4, 4.0)] {
        let found = drawn(Some(number)).unwrap();
        assert!((found.bodies[0].shape.bounds().centre.x - x).abs() < 1e-5, "{number}");
        assert_eq!(found.lights.len(), usize::from(number == 2), "{number}");
    }
    for number in [0, 6] {
        assert!(matches!(drawn(Some(number)), Err(Error::Parameter { name, .. }) if name == "world"), "{number}");
    }
    // A file of depth maps alone
    let (_dir, path) = file(&format!("Display \"z\" \"zfile\" \"z\" WorldBegin {} WorldEnd", sphere(1.0)));
    assert_eq!(read(&path, &Reading::default()).unwrap().bodies.len(), 1);
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
fn archives_are_found_beside_the_file_and_in_the_search_path() {
    let (dir, path) = write(
        "a.rib",
        "Option \"searchpath\" \"archive\" [\"parts:other\"] WorldBegin
        ReadArchive \"ball.rib\" Procedural \"DelayedReadArchive\" [\"cube.rib\"] [-1 1 -1 1 -1 1]
        Procedural2 \"DelayedReadArchive2\" \"SimpleBound\" \"string filename\" [\"ball.rib\"] WorldEnd",
    );
    let open = || read(&path, &Reading::default());
    fs::create_dir(dir.path().join("other")).unwrap();
    fs::write(dir.path().join("ball.rib"), "Sphere 1 -1 1 360 Translate 1 0 0").unwrap();
    fs::write(dir.path().join("other/cube.rib"), "# a flat one\nDisk 0 1 360\nReadArchive \"edge.rib\"").unwrap();
    // The search path belongs to the file that sets it, not to the one in which it is used.
    fs::write(dir.path().join("other/edge.rib"), "Torus 1 .1 0 360 360").unwrap();
    assert_eq!(open().unwrap().bodies.len(), 4);
    fs::write(dir.path().join("other/cube.rib"), "\nDisk 0 1 nonsense").unwrap();
    let found = open().unwrap();
    assert!(found.warnings.join("\n").contains("cube.rib: line 2: skipped Disk"), "{:?}", found.warnings);
    assert_eq!(found.bodies.len(), 2, "the rest is drawn");
    fs::write(dir.path().join("other/cube.rib"), "ReadArchive \"../a.rib\"").unwrap();
    assert!(open().err().unwrap().to_string().contains("deep"), "a circle ends");
}

#[test]
fn archives_lie_in_zip_files_and_named_folders() {
    let (dir, path) = write(
        "a.rib",
        "Option \"searchpath\" \"archive\" [\"&:${LODEN_TEST_NOWHERE}/x:parts:@\"] WorldBegin
        ReadArchive \"all.zip!models/ball.rib\" ReadArchive \"all.zip!nothing.rib\" ReadArchive \"C:\\\\work\\\\ball.rib\"
        ReadArchive \"/elsewhere/disk.rib\" ReadArchive \"/dev/zero\" WorldEnd",
    );
    fs::write(dir.path().join("disk.rib"), "Disk 0 1 360").unwrap();
    fs::create_dir(dir.path().join("parts")).unwrap();
    let mut zip = zip::ZipWriter::new(fs::File::create(dir.path().join("parts/all.zip")).unwrap());
    zip.start_file("models/ball.rib", zip::write::SimpleFileOptions::default()).unwrap();
    zip.write_all(b"Sphere 1 -1 1 360").unwrap();
    zip.finish().unwrap();
    let found = read(&path, &Reading::default()).unwrap();
    assert_eq!(found.bodies.len(), 2);
    let all = found.warnings.join("\n");
    assert_contains_all(
        &all,
        &["nothing.rib", "C:\\\\work", "line 3: skipped ReadArchive: the archive \"/dev/zero\" is missing"],
    );
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
        let found = read(&path, &Reading::default()).unwrap();
        assert_eq!(found.camera, expected.camera);
        assert_eq!(found.bodies.len(), 1);
        assert_eq!(hit(&found, 0.1, 0.0), hit(&expected, 0.1, 0.0));
    }
    let (_dir, path) = write("a.rib", &zipped[..zipped.len() - 12]);
    assert!(read(&path, &Reading::default()).err().unwrap().to_string().contains("gzip"));
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
        let _ = read(&path, &Reading::default());
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
    assert_eq!((found.bodies.len(), found.lights.len()), (6, 1));
    assert!(!matches!(found.lights[0], Light::Shadowless(_)), "it names a shadow map");
    let spheres: Vec<f32> = found.bodies[..2].iter().map(|body| body.shape.bounds().centre.x).collect();
    assert_eq!(spheres, [-1.0, 1.0]);
    assert!(hit(&found, 0.0, 0.0).is_some_and(|(t, ..)| t > 3.9 && t < 4.6), "the subdivided cube is round");
    assert_eq!(found.settings, Settings::default(), "options of the first frame ended with it");
    assert_eq!(found.camera.projection, Projection::Perspective { field_of_view_degrees: 45.0 });
    let all = found.warnings.join("\n");
    let expected = [
        "line 5: ignored Option \"searchpath\" \"shader\"",
        "line 9: ignored Display (3 times)",
        "found 2 worlds: number 2 (line 26) is drawn",
        "line 11: ignored the world of a depth map",
        "line 15: ignored MakeShadow",
        "line 22: ignored Hider \"hidden\"",
        "line 29: ignored Attribute \"visibility\" (2 times)",
        "line 30: Surface \"glow\" is unknown",
        "line 36: ignored Illuminate",
    ];
    assert_contains_all(&all, &expected);
    assert!(!all.contains("identifier"), "{all}");
}

#[test]
fn recursive_inline_archives_end() {
    let error = read_error("ArchiveBegin \"a\" ReadArchive \"a\" ArchiveEnd\nReadArchive \"a\"");
    assert!(error.contains("more than 32 deep"), "{error}");
    let unfinished = scene("ArchiveBegin \"a\" Sphere 1 -1 1 360");
    let all = unfinished.warnings.join("\n");
    assert!(
        all.contains("line 1: the archive \"a\" is not closed") && all.contains("the scene has no shapes"),
        "{all}"
    );
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

#[test]
fn objects_of_objects_have_a_limit() {
    let level = |k: usize| format!("ObjectBegin {} {} ObjectEnd ", k + 1, format!("ObjectInstance {k} ").repeat(32));
    let text = format!("{HEAD}ObjectBegin 0 Sphere 1 -1 1 360 ObjectEnd {}", (0..6).map(level).collect::<String>());
    let error = read_error(&text);
    assert!(error.contains("more than 1048576 shapes"), "{error}");
}
