//! Lights, surfaces and colours.

use super::*;

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

/// The middle pixel of a scene without noise.
fn middle(text: &str) -> Vec3 {
    middle_with(text, &Reading::default())
}

fn middle_with(text: &str, reading: &Reading) -> Vec3 {
    let head = HEAD.replace("90", "12");
    let (_dir, path) = write("a.rib", format!("{head}{text} WorldEnd"));
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
    let behind = "AttributeBegin Surface \"constant\" Color [0 1 0] Translate 0 0 5 Disk 0 9 360 AttributeEnd";
    let front = "Surface \"constant\" Color [1 0 0] Polygon \"P\" [-9 -9 2  -9 9 2  9 9 2  9 -9 2]";
    assert_color(&format!("{behind} Opacity [.25 .25 .25] {front}"), Vec3::new(0.25, 0.75, 0.0), 0.05);
    assert_color(&format!("{behind} Opacity [1 .5 0] {front}"), Vec3::new(1.0, 0.5, 0.0), 0.1);
    assert_color(&format!("{behind} Opacity [0 0 0] {front}"), Vec3::Y, 1e-5);
    assert_color(&format!("{behind} {front} \"Os\" [0 0 0 0 0 0 0 0 0 0 0 0]"), Vec3::Y, 1e-5);
    // Half of the light passes a transparent body.
    let lit = "Attribute \"light\" \"shadows\" \"on\" LightSource \"distantlight\" 1 Surface \"matte\"";
    let screen = "AttributeBegin Color [0 0 0] Opacity [.5 .5 .5] Polygon \"P\" [-20 -20 -1 -20 20 -1 20 20 -1 20 -20 -1] AttributeEnd";
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
        "Translate -.5 -.5 0 NuPatch 4 4 [0 0 0 0 1 1 1 1] 0 1 4 4 [0 0 0 0 1 1 1 1] 0 1 \"Pz\" [1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1]",
        "Translate -.5 -.5 1 PatchMesh \"bilinear\" 3 \"nonperiodic\" 3 \"nonperiodic\" \"Pz\" [0 0 0 0 1 0 0 0 0]",
        "Translate 0 -1 9 Rotate -90 1 0 0 Geometry \"teapot\"",
        "Translate 0 0 2 Geometry \"cube\"",
        "Translate 0 0 2 Geometry \"sphere\"",
    ] {
        assert_color(&format!("Surface \"constant\" {shape}"), Vec3::ONE, 0.01);
    }
}

#[test]
fn black_pictures_say_why() {
    let why = |text: &str| {
        let found = scene(&format!("{HEAD}{text} WorldEnd"));
        let settings = Settings { width: 24, height: 24, spp: 1, ..Settings::default() };
        found.why_black(&render(&found.scene(), &settings, &crate::progress::Silent).unwrap()).unwrap_or_default()
    };
    assert_eq!(why(&format!("{SUN} Translate 0 0 4 Sphere 1 -1 1 360")), "");
    for (text, expected) in [
        (String::new(), "the scene has no shapes"),
        ("Translate 0 0 -9 Sphere 1 -1 1 360".into(), "all shapes lie behind the camera"),
        ("Translate 900 0 9 Sphere 1 -1 1 360".into(), "the camera sees none of the shapes"),
        (format!("{SUN} \"from\" [0 0 9] \"to\" [0 0 0] {WALL}"), "shapes fill 100 % of it"),
        (format!("Surface \"constant\" {WALL}"), "the picture has one colour: shapes fill 100 % of it"),
    ] {
        assert!(why(&text).contains(expected), "{text}: {}", why(&text));
    }
}
