use std::fs;

use super::*;
use crate::progress::Silent;
use crate::render::{Projection, render};

fn scenes() -> impl Iterator<Item = std::path::PathBuf> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes");
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.into_iter().filter(|path| path.extension().is_some_and(|e| e == "toml"))
}

#[test]
fn shipped_scenes_are_the_same_in_both_forms() {
    let mut count = 0;
    for path in scenes() {
        let draw = |path: &Path, seed: u64| {
            let file = SceneFile::open(path).unwrap();
            assert!(file.warnings.is_empty(), "{:?}", file.warnings);
            let settings = Settings { width: 32, height: 24, spp: 64, depth: 4, seed };
            let picture = render(&file.scene(), &settings, &Silent).unwrap();
            // Compare means of tone-mapped 8 x 8 blocks, so that no bright pixel dominates.
            let block = |k: usize| {
                let pixels = (0..64).map(|i| picture.at(k % 4 * 8 + i % 8, k / 4 * 8 + i / 8));
                pixels.map(|p| p / (p + 1.0)).sum::<Vec3>() / 64.0
            };
            (0..12).map(block).collect::<Vec<_>>()
        };
        let (toml, rib) = (draw(&path, 1), draw(&path.with_extension("rib"), 2));
        for (k, (a, b)) in toml.iter().zip(&rib).enumerate() {
            assert!((*a - *b).abs().max_element() < 0.02, "{} block {k}: {a} {b}", path.display());
        }
        assert!(toml.iter().sum::<Vec3>().min_element() > 0.1);
        count += 1;
    }
    assert_eq!(count, 3);
}

fn open(text: &str) -> Result<SceneFile> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.toml");
    fs::write(&path, text).unwrap();
    fs::write(dir.path().join("quad.obj"), "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").unwrap();
    SceneFile::open(&path)
}

const CAMERA: &str = "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n";
const GREY: &str = "[material.grey]\nmodel = \"lambert\"\nkd = 0.5\n";

#[test]
fn everything_documented_is_read() {
    let shapes = [
        "kind = \"sphere\"",
        "kind = \"sphere\"\nradius = 2\nz-min = -1\nsweep = 90",
        "kind = \"cone\"\nheight = 1\nradius = 1",
        "kind = \"cylinder\"\nradius = 1\nz-min = 0\nz-max = 1",
        "kind = \"hyperboloid\"\nfrom = [1, 0, 0]\nto = [0, 1, 1]",
        "kind = \"paraboloid\"\nradius = 1\nz-min = 0\nz-max = 1",
        "kind = \"disk\"\nradius = 1",
        "kind = \"torus\"\nmajor-radius = 2\nminor-radius = 1",
        "kind = \"quad\"\ncorners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]",
        "kind = \"polygon\"\npoints = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\nholes = [[[0.1, 0.1, 0], [0.2, 0.1, 0], [0.1, 0.2, 0]]]",
        "kind = \"patch\"\npoints = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]]",
        "kind = \"object\"\nname = \"teapot\"",
        "kind = \"mesh\"\nfile = \"quad.obj\"",
        "kind = \"subdivision\"\nfile = \"quad.obj\"\nlevels = 2",
    ];
    let mut text = format!(
        "size = [40, 30]\nsamples = 3\ndepth = 2\nbackground = [0, 0, 1]\n{CAMERA}orthographic = 3\n\
        lens-radius = 0.1\nfocus = 4\n[environment]\nradiance = 0.5\n{GREY}"
    );
    for (k, shape) in shapes.iter().enumerate() {
        text += &format!(
            "[[shape]]\n{shape}\nmaterial = \"grey\"\nuv-scale = 2\nuv-rotation = 10\n\
            transform = [{{ scale = 2 }}, {{ rotate = [90, 0, 0, 1] }}, {{ translate = [{k}, 0, 0] }}]\n"
        );
    }
    let lights = [
        "kind = \"directional\"\ndirection = [0, 1, 0]\nirradiance = 1\nradius = 2",
        "kind = \"point\"\nposition = [0, 1, 0]\nintensity = [1, 2, 3]",
        "kind = \"spot\"\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\nintensity = 1\nangle = 30\nedge = 5\nfalloff = 2",
        "kind = \"rectangle\"\ncentre = [0, 1, 0]\nx = [1, 0, 0]\ny = [0, 0, 1]\nradiance = 1",
        "kind = \"disk\"\ncentre = [0, 1, 0]\nx = [1, 0, 0]\ny = [0, 0, 1]\nradiance = 1",
        "kind = \"sphere\"\ncentre = [0, 1, 0]\nradius = 0.1\nradiance = 1",
    ];
    lights.iter().for_each(|light| text += &format!("[[light]]\n{light}\n"));
    let file = open(&text).unwrap();
    assert_eq!((file.bodies.len(), file.lights.len(), file.settings.spp), (shapes.len(), 6, 3));
    assert_eq!(file.camera.projection, Projection::Orthographic { height: 3.0 });
    // The centre (0.5, 0.5) of the quad, scaled, rotated, then translated.
    let centre = file.bodies[8].shape.bounds().centre;
    assert!((centre - Vec3::new(7.0, 1.0, 0.0)).length() < 1e-5, "{centre}");
    assert_eq!(file.bodies[8].texture, TextureMap { scale: 2.0, rotation_degrees: 10.0, ..TextureMap::default() });
}

#[test]
fn errors_name_their_line() {
    for (text, expected) in [
        (String::new(), "camera"),
        ("size = [1, 2".into(), "line 1"),
        (format!("{CAMERA}colour = 1"), "line 4: scene: unknown field `colour`"),
        (format!("{CAMERA}field-of-view = 30\northographic = 1"), "both"),
        (format!("{CAMERA}\n[[light]]\nkind = \"laser\""), "line 5: light: field: unknown variant `laser`"),
        (format!("{CAMERA}\n[[light]]\nkind = \"point\"\nposition = [0, 1]\nintensity = 1"), "line 5: light"),
        (format!("{CAMERA}\n[[light]]\nkind = \"point\"\nposition = [0, 1, 0]\nintensity = -1"), "intensity"),
        (
            format!(
                "{CAMERA}[[light]]\nkind = \"disk\"\ncentre = [0, 1, 0]\nx = [1, 0, 0]\ny = [2, 0, 0]\nradiance = 1"
            ),
            "no area",
        ),
        (format!("{CAMERA}{GREY}gloss = 1"), "line 4: material.grey: gloss: no such parameter"),
        (format!("{CAMERA}[material.x]\nfile = \"none.loden\""), "none.loden"),
        (format!("{CAMERA}[material.x]\nkd = 1"), "expected either model or file"),
        (
            format!("{CAMERA}{GREY}[[shape]]\nkind = \"sphere\"\nmaterial = \"gray\""),
            "line 7: shape: material: found \"gray\", expected one of: grey",
        ),
        (
            format!("{CAMERA}{GREY}[[shape]]\nkind = \"sphere\"\nradius = 0\nmaterial = \"grey\""),
            "line 7: shape: quadric",
        ),
        (format!("{CAMERA}{GREY}[[shape]]\nkind = \"sphere\"\ndiameter = 1\nmaterial = \"grey\""), "diameter"),
        (format!("{CAMERA}{GREY}[[shape]]\nkind = \"object\"\nname = \"kettle\"\nmaterial = \"grey\""), "teapot"),
        (format!("{CAMERA}{GREY}[[shape]]\nkind = \"mesh\"\nfile = \"none.ply\"\nmaterial = \"grey\""), "none.ply"),
        (
            format!("{CAMERA}{GREY}[[shape]]\nkind = \"sphere\"\nmaterial = \"grey\"\ntransform = [{{ scale = 0 }}]"),
            "singular",
        ),
        (format!("{CAMERA}{GREY}[[shape]]\nkind = \"sphere\"\nmaterial = \"grey\"\nuv-scale = 0"), "uv-scale"),
        (
            format!(
                "{CAMERA}{GREY}[[shape]]\nkind = \"sphere\"\nmaterial = \"grey\"\nmapping = {{ kind = \"triplanar\", size = 0 }}"
            ),
            "mapping",
        ),
        (format!("{CAMERA}[environment]\nrotation = 3"), "either radiance or file"),
    ] {
        let error = open(&text).err().map(|e| e.to_string()).expect("an error");
        // a file that is missing is named beside the line that asks for it
        assert!(error.contains(expected) && error.contains("s.toml"), "{text}\n{error}");
        assert!(!expected.starts_with("none") || error.contains("line"), "{text}\n{error}");
    }
    assert!(matches!(SceneFile::open("a.obj"), Err(Error::Unsupported { .. })));
}

#[test]
fn limits_are_named_when_they_are_met() {
    let with = |shapes: &[&str]| {
        let shape = |text: &&str| format!("[[shape]]\nmaterial = \"grey\"\n{text}\n");
        open(&format!("{CAMERA}{GREY}{}", shapes.iter().map(shape).collect::<String>()))
    };
    let ball = "kind = \"sphere\"\ntransform = [{ translate = [1, 2, 3] }]";
    let found = with(&[ball, ball, "kind = \"sphere\"", ball]).unwrap();
    assert_eq!((found.bodies.len(), found.warnings.len()), (2, 1));
    assert!(found.warnings[0].ends_with("exactly on earlier ones: 2"), "{:?}", found.warnings);
    let far = with(&["kind = \"sphere\"\ntransform = [{ translate = [0, 10000, 0] }]"]).unwrap();
    assert!(far.warnings.len() == 1 && far.warnings[0].contains("from the origin: 1"), "{:?}", far.warnings);
    let deep = with(&["kind = \"subdivision\"\nfile = \"quad.obj\"\nlevels = 30"]).unwrap();
    assert!(deep.warnings.iter().any(|w| w.contains("times, not 30")), "{:?}", deep.warnings);
    let sharp = with(&["kind = \"mesh\"\nfile = \"quad.obj\"\ncrease = 200"]).err().unwrap().to_string();
    assert!(sharp.contains("crease"), "{sharp}");
}

#[test]
fn distinct_quadrics_need_little_memory() {
    let shapes: String = (0..2000)
        .map(|k| {
            format!(
                "[[shape]]\nmaterial = \"grey\"\nkind = \"sphere\"\nradius = {}\nz-max = 0.5\n",
                1.0 + 1e-3 * k as f32
            )
        })
        .collect();
    let found = open(&format!("{CAMERA}{GREY}{shapes}")).unwrap();
    assert_eq!(found.bodies.len(), 2000);
    let settings = Settings { width: 8, height: 8, spp: 1, depth: 2, seed: 0 };
    render(&found.scene(), &settings, &Silent).unwrap();
    assert!(size_of::<crate::render::Revolved>() < 256);
}

#[test]
fn meshes_far_from_zero_are_moved_precisely() {
    let dir = tempfile::tempdir().unwrap();
    let point = |[x, y]: [f64; 2]| format!("v {} {} 300.25\n", x + 700_000.125, y + 5_200_000.375);
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(point).concat();
    fs::write(dir.path().join("far.obj"), format!("{square}f 1 2 3 4\n")).unwrap();
    let shape = "[[shape]]\nkind = \"mesh\"\nfile = \"far.obj\"\nmaterial = \"grey\"\n\
        transform = [{ translate = [-700000, -5200000, -300] }]\n";
    let path = dir.path().join("s.toml");
    fs::write(&path, format!("{CAMERA}{GREY}{shape}{shape}")).unwrap();
    let file = SceneFile::open(&path).unwrap();
    for body in &file.bodies {
        let [low, high] = body.shape.extent();
        // Boxes have room for rounding: 1e-5 of the largest coordinate.
        assert!(low.abs_diff_eq(Vec3::new(0.125, 0.375, 0.25), 2e-5), "{low}");
        assert!(high.abs_diff_eq(Vec3::new(1.125, 1.375, 0.25), 2e-5), "{high}");
    }
    assert!(file.warnings.iter().any(|w| w.contains("far.obj: no texture coordinates")), "{:?}", file.warnings);
}
