//! Sets of pictures with the names and layouts of the OUTex and PhoTex texture databases, described by manifests.

use std::fs;
use std::path::Path;

use loden::color::Encoding;
use loden::import;
use loden::params::Given;

/// The texture of a sample at a place from its centre, x to the right and y up, in texels.
fn texture(x: f64, y: f64) -> [f64; 3] {
    let value = 0.5 + 0.2 * (0.35 * x + 0.1 * y).sin() + 0.15 * (0.25 * y).cos();
    [value, 0.8 * value, 0.4]
}

/// A picture of the sample turned counter-clockwise, in linear light.
fn picture([width, height]: [usize; 2], degrees: f64, brightness: f64) -> Vec<[f64; 3]> {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let pixel = |i: usize| {
        let (x, y) = ((i % width) as f64 + 0.5 - width as f64 / 2.0, height as f64 / 2.0 - (i / width) as f64 - 0.5);
        texture(cos * x + sin * y, cos * y - sin * x).map(|v| brightness * v)
    };
    (0..width * height).map(pixel).collect()
}

/// A Sun raster file of 24 bits.
fn ras([width, height]: [usize; 2], pixels: &[[f64; 3]]) -> Vec<u8> {
    let header = [0x59a6_6a95, width as u32, height as u32, 24, 0, 1, 0, 0];
    let mut bytes: Vec<u8> = header.iter().flat_map(|n| n.to_be_bytes()).collect();
    for row in pixels.chunks_exact(width) {
        let stored = |v: f64| (Encoding::Srgb.encode(v as f32) * 255.0).round() as u8;
        bytes.extend(row.iter().flat_map(|[r, g, b]| [stored(*b), stored(*g), stored(*r)]));
        bytes.resize(bytes.len() + 3 * width % 2, 0);
    }
    bytes
}

/// A Netpbm file of 16 bits in grey.
fn pgm([width, height]: [usize; 2], pixels: &[[f64; 3]]) -> Vec<u8> {
    let mut bytes = format!("P5\n{width} {height}\n65535\n").into_bytes();
    bytes.extend(pixels.iter().flat_map(|[grey, ..]| ((grey * 65_535.0).round() as u16).to_be_bytes()));
    bytes
}

fn error(path: &Path, options: &Given) -> String {
    import::open(path, options).err().expect("an error").to_string()
}

/// Mean and largest difference from the sample itself in linear light.
fn differences(image: &[f32], side: usize, encoding: Encoding, brightness: f64) -> [f64; 2] {
    let truth = picture([side, side], 0.0, brightness);
    assert_eq!(image.len(), 3 * truth.len());
    let off = image.iter().zip(truth.as_flattened()).map(|(v, t)| (f64::from(encoding.decode(*v)) - t).abs());
    let (sum, most) = off.fold((0.0, 0.0f64), |(sum, most), v| (sum + v, most.max(v)));
    [sum / image.len() as f64, most]
}

const OUTEX: &str = r#"
loden_images = 1
files = "canvas001/canvas001-{illuminant}-100dpi-{rotation}.ras"
illuminants = ["inca", "horizon", "TL84"]
rotation = "ccw"
lights = [[40, 20]]
"#;

#[test]
fn outex_pictures_are_turned_back_for_three_illuminants() {
    let dir = tempfile::tempdir().unwrap();
    let (size, rotations) = ([74, 54], [0, 5, 10, 15, 30, 45, 60, 75, 90]);
    fs::create_dir(dir.path().join("canvas001")).unwrap();
    let illuminants = [("inca", 1.0), ("horizon", 0.8), ("TL84", 0.6)];
    for (word, brightness) in illuminants {
        for degrees in rotations {
            let file = format!("canvas001/canvas001-{word}-100dpi-{degrees:02}.ras");
            let pixels = picture(size, f64::from(degrees), brightness);
            fs::write(dir.path().join(file), ras(size, &pixels)).unwrap();
        }
    }
    let path = dir.path().join("canvas001.toml");
    fs::write(&path, OUTEX).unwrap();
    for (word, brightness) in illuminants {
        let source = import::open(&path, &Given::default().with("illuminant", word)).unwrap();
        let meta = source.meta();
        assert_eq!((meta.views.len(), meta.lights.len(), meta.encoding), (1, 9, Encoding::Srgb));
        // the square of all turned pictures: 54 / sqrt(2)
        assert_eq!([meta.width, meta.height], [38, 38]);
        // the lamp goes round the sample clockwise while the sample turns counter-clockwise
        let azimuths: Vec<f64> = meta.lights.degrees().iter().map(|[theta, phi]| theta * 1000.0 + phi).collect();
        assert_eq!(azimuths, [5.0, 10.0, 15.0, 20.0, 290.0, 305.0, 320.0, 335.0, 350.0].map(|phi| 40_000.0 + phi));
        for light in 0..9 {
            let image = source.image(0, light).unwrap().to_f32().into_owned();
            let [mean, most] = differences(&image, 38, meta.encoding, brightness);
            // steps of 8 bits are .004 here
            assert!(mean < 0.0025 && most < 0.012, "{word} {light}: {mean} {most}");
        }
        assert!(source.facts().contains(&("illuminant", word.into())));
    }
    let first = import::open(&path, &Given::default()).unwrap();
    assert!(first.facts().contains(&("illuminant", "inca".into())), "the first of the list");
    // turned the wrong way they differ
    fs::write(&path, OUTEX.replace("ccw", "cw")).unwrap();
    let wrong = import::open(&path, &Given::default()).unwrap();
    let turned = (0..9).map(|l| differences(&wrong.image(0, l).unwrap().to_f32(), 38, Encoding::Srgb, 1.0)[0]);
    assert!(turned.fold(0.0, f64::max) > 0.05);
}

#[test]
fn mistakes_in_manifests_of_turned_pictures_are_named() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("canvas001")).unwrap();
    let path = dir.path().join("set.toml");
    let pixels = picture([9, 8], 0.0, 1.0);
    for name in ["inca-100dpi-00", "inca-100dpi-30"] {
        fs::write(dir.path().join(format!("canvas001/canvas001-{name}.ras")), ras([9, 8], &pixels)).unwrap();
    }
    let none = Given::default();
    for (from, to, options, expected) in [
        (
            "",
            "",
            none.clone().with("illuminant", "D65"),
            "illuminant: found \"D65\", expected one of inca, horizon, TL84",
        ),
        ("", "", none.clone().with("illuminant", "TL84"), "found no file that matches \"canvas001/canvas001-TL84-"),
        ("illuminants =", "# ", none.clone(), "illuminants: the list is missing, but `files` has {illuminant}"),
        ("[\"inca\", \"horizon\", \"TL84\"]", "[]", none.clone(), "illuminants: the list is empty"),
        ("-{illuminant}-", "-inca-", none.clone(), "illuminants: `files` has no {illuminant}"),
        ("rotation = \"ccw\"", "", none.clone(), "rotation: the sense is missing, ccw or cw"),
        ("-{rotation}", "-{any}", none.clone(), "rotation: `files` has no {rotation}"),
        ("ccw", "left", none.clone(), "set.toml: line 5"),
    ] {
        fs::write(&path, OUTEX.replace(from, to)).unwrap();
        let found = error(&path, &options);
        assert!(found.contains(expected), "{found}\nshould contain {expected}");
    }
    fs::write(&path, "loden_images = 1\nfiles = \"canvas001/canvas001-inca-100dpi-{light}.ras\"\n").unwrap();
    let found = error(&path, &none.with("illuminant", "inca"));
    assert!(found.contains("lists no illuminants"), "{found}");
}

const PHOTEX: &str = r#"
loden_images = 1
files = "aab/aab.{rotation}.{theta_l}.{phi_l}.pgm"   # rotation of the sample, slant, tilt
rotation = "ccw"
encoding = "linear"
"#;

#[test]
fn photex_pictures_of_sixteen_bits_have_slant_and_tilt_in_their_names() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("aab")).unwrap();
    let size = [60, 60];
    for (rotation, slant, tilt) in [(0, 45, 0), (0, 45, 90), (0, 60, 0), (30, 45, 0), (90, 45, 90), (90, 60, 180)] {
        let brightness = f64::from(slant) / 100.0;
        let pixels = picture(size, f64::from(rotation), brightness);
        fs::write(dir.path().join(format!("aab/aab.{rotation}.{slant}.{tilt}.pgm")), pgm(size, &pixels)).unwrap();
    }
    let path = dir.path().join("aab.toml");
    fs::write(&path, PHOTEX).unwrap();
    let source = import::open(&path, &Given::default()).unwrap();
    // the sample turned by 90 degrees under a lamp at 90 degrees is the sample under a lamp at 0
    assert_eq!(source.meta().lights.degrees(), [[45.0, 0.0], [45.0, 90.0], [45.0, 330.0], [60.0, 0.0], [60.0, 90.0]]);
    assert!(source.warnings().iter().any(|w| w.contains("1 turned pictures") && w.contains("aab.90.45.90.pgm")));
    let (side, encoding) = (source.meta().width, source.meta().encoding);
    assert_eq!((side, encoding), (42, Encoding::Linear));
    for (light, [slant, _]) in source.meta().lights.degrees().iter().enumerate() {
        let image: Vec<f32> = source.image(0, light).unwrap().to_f32().to_vec();
        // grey pictures have the first channel in all
        let grey: Vec<f32> =
            image.chunks_exact(3).flat_map(|c| [c[0], 0.8 * c[1], 0.4 * (slant / 100.0) as f32]).collect();
        let [mean, most] = differences(&grey, side, encoding, slant / 100.0);
        assert!(mean < 3e-4 && most < 4e-3, "{light}: {mean} {most}");
        assert!(image.chunks_exact(3).all(|c| c[0] == c[1] && c[1] == c[2]));
    }
}
