//! Files, worlds, conditions, mistakes.

use super::*;

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
        "line 5: ignored TrimCurve (2 times)",
        "line 7: ignored Option \"limits\" \"bucketsize\"",
        "line 8: LightSource \"skylight\" is unknown: a constant environment is used",
        "line 9: ignored Sides 1",
        "line 10: ignored the varying shape parameter \"heat\"",
        "line 11: ignored motion blur",
        "line 12: ignored Geometry \"cow\"",
        "line 13: ignored the SubdivisionMesh tag \"smooth\"",
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
    // A bare name that only one folder beside the scene has
    fs::create_dir(dir.path().join("pass")).unwrap();
    fs::write(dir.path().join("pass/ring.rib"), "Torus 1 .1 0 360 360").unwrap();
    fs::write(dir.path().join("other/cube.rib"), "Disk 0 1 360").unwrap();
    fs::write(dir.path().join("ball.rib"), "ReadArchive \"ring.rib\"").unwrap();
    let found = open().unwrap();
    assert!(found.warnings.join("\n").contains("\"ring.rib\" is not in the search path"), "{:?}", found.warnings);
    fs::create_dir(dir.path().join("pass2")).unwrap();
    fs::write(dir.path().join("pass2/ring.rib"), "Torus 2 .1 0 360 360").unwrap();
    assert!(open().unwrap().warnings.join("\n").contains("the archive \"ring.rib\" is missing"), "two candidates");
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
        &["nothing.rib", "C:\\\\work", "skipped ReadArchive: /dev/zero: archive: it is no regular file"],
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
        "found 2 worlds: number 2 (line 25) is drawn",
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
fn objects_of_objects_have_a_limit() {
    let level = |k: usize| format!("ObjectBegin {} {} ObjectEnd ", k + 1, format!("ObjectInstance {k} ").repeat(32));
    let text = format!("{HEAD}ObjectBegin 0 Sphere 1 -1 1 360 ObjectEnd {}", (0..6).map(level).collect::<String>());
    let error = read_error(&text);
    assert!(error.contains("more than 1048576 shapes"), "{error}");
    let chain: String = (0..300).map(|k| format!("ObjectBegin {} ObjectInstance {k} ObjectEnd ", k + 1)).collect();
    let error = read_error(&format!("{HEAD}ObjectBegin 0 Sphere 1 -1 1 360 ObjectEnd {chain}"));
    assert!(error.contains("nested more than 256 deep"), "{error}");
    // objects without shapes cost nothing, however often they double
    let doubled = (0..300).map(|k| format!("ObjectBegin {} ObjectInstance {k} ObjectInstance {k} ObjectEnd ", k + 1));
    let text = format!("{HEAD}ObjectBegin 0 ObjectEnd {} ObjectInstance 300 WorldEnd", doubled.collect::<String>());
    assert!(scene(&text).bodies.is_empty());
}

#[test]
fn objects_of_objects_are_placed_by_the_product_of_their_transforms() {
    let found = scene(&format!(
        "{HEAD}ObjectBegin \"a\" Translate 1 0 0 Sphere .1 -.1 .1 360 ObjectEnd
        ObjectBegin \"b\" Translate 0 2 0 ObjectInstance \"a\" Sphere .2 -.2 .2 360 ObjectEnd
        Translate 0 0 9 Scale 2 2 2 ObjectInstance \"b\" WorldEnd"
    ));
    let centres: Vec<Vec3> = found.bodies.iter().map(|body| body.shape.bounds().centre).collect();
    let expected = [Vec3::new(2.0, 4.0, -9.0), Vec3::new(0.0, 4.0, -9.0)];
    assert_eq!(centres.len(), 2);
    assert!(centres.iter().zip(expected).all(|(a, b)| a.distance(b) < 1e-4), "{centres:?}");
}

#[test]
fn a_limit_of_texture_memory_limits_the_images_of_materials() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("images.u8"), [99u8; 48]).unwrap();
    let btf = "loden_raw = 1\ndata = \"images.u8\"\ntype = \"u8\"\nshape = [2, 2, 2, 2, 3]\nviews = [[0, 0], [40, 0]]\n\
        lights = [[0, 0], [40, 0]]\nencoding = \"srgb\"\ncosine = \"included\"\n";
    fs::write(dir.path().join("btf.toml"), btf).unwrap();
    let limited = |options: &str, memory: Option<crate::memory::Memory>| {
        let path = dir.path().join("a.rib");
        let material = "Surface \"loden\" \"string material\" [\"btf.toml\"]";
        fs::write(&path, format!("{options} {HEAD} {material} Sphere 1 -1 1 360 WorldEnd")).unwrap();
        let found = read(&path, &Reading { memory, ..Reading::default() }).unwrap();
        assert!(found.warnings.iter().all(|w| !w.contains("texturememory")), "{:?}", found.warnings);
        // this one is smaller than any limit
        assert!(found.paged.is_empty());
        found.memory
    };
    use crate::memory::Memory;
    let limit = "Option \"limits\" \"texturememory\" [40960]";
    assert_eq!(limited("", None), None);
    assert_eq!(limited(limit, None), Some(Memory(40 << 20)));
    // what the caller says counts more; a limit of another time is no limit for a BTF
    assert_eq!(limited(limit, Some(Memory(64 << 20))), Some(Memory(64 << 20)));
    assert_eq!(limited("Option \"limits\" \"texturememory\" [256]", None), Some(Memory(16 << 20)));
}
