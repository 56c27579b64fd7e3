//! The Bonn layout: files round-trip, and every kind of bad input is reported by name.

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::common::{Synthetic, data};
use loden::btf::{BtfSource, Cosine, Texels};
use loden::color::Encoding;
use loden::export;
use loden::import;
use loden::params::Given;
use loden::progress::Silent;

fn bytes(texels: &Texels<'_>) -> Vec<u8> {
    match texels {
        Texels::U8(values) => values.to_vec(),
        _ => panic!("u8 expected"),
    }
}

fn assert_equal(a: &dyn BtfSource, b: &dyn BtfSource) {
    assert_eq!(a.meta(), b.meta());
    for view in 0..a.meta().views.len() {
        assert_eq!(bytes(&a.view(view).unwrap()), bytes(&b.view(view).unwrap()), "view {view}");
    }
}

#[test]
fn png_archives_folders_and_raw_arrays_are_lossless() {
    let dir = tempfile::tempdir().unwrap();
    let source = Synthetic::bonn81(4, 3);
    let png = Given::from([("png", "yes")]);
    for (name, options) in [("a.zip", &png), ("folder", &png), ("raw.toml", &Given::default())] {
        let path = dir.path().join(name);
        export::export(&source, &path, options, &Silent).unwrap();
        let back = import::open(&path, &Default::default()).unwrap();
        assert_equal(&source, back.as_ref());
        assert!(back.missing().is_empty() && back.warnings().is_empty());
        let Texels::U8(image) = back.image(7, 3).unwrap() else { panic!() };
        assert_eq!(image[..], source.pixels(7, 3)[..]);
    }
    // the two files of the raw array, and no temporary file
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 4);
}

#[test]
fn jpeg_archives_stay_close() {
    let dir = tempfile::tempdir().unwrap();
    let source = Synthetic::bonn81(16, 16);
    let path = dir.path().join("a.zip");
    export::export(&source, &path, &Default::default(), &Silent).unwrap();
    let back = import::open(&path, &Default::default()).unwrap();
    let (a, b) = (bytes(&source.view(40).unwrap()), bytes(&back.view(40).unwrap()));
    let mean = a.iter().zip(&b).map(|(&a, &b)| f64::from(a.abs_diff(b))).sum::<f64>() / a.len() as f64;
    assert!(mean < 2.0, "{mean}");
}

#[test]
fn pictures_are_srgb_with_the_cosine_whatever_the_source_has() {
    let dir = tempfile::tempdir().unwrap();
    let mut source = Synthetic::bonn81(2, 2);
    source.meta.encoding = Encoding::Linear;
    source.meta.cosine = Cosine::Excluded;
    let path = dir.path().join("a.zip");
    export::export(&source, &path, &Given::from([("png", "yes")]), &Silent).unwrap();
    let back = import::open(&path, &Default::default()).unwrap();
    let light = 60;
    let cosine = source.meta.lights.directions()[light].z;
    let found = bytes(&back.image(5, light).unwrap());
    for (value, found) in source.pixels(5, light).iter().zip(found) {
        let expected = 255.0 * Encoding::Srgb.encode(f32::from(*value) / 255.0 * cosine);
        assert!((f32::from(found) - expected).abs() <= 0.51, "{found} {expected}");
    }
}

#[test]
fn clockwise_azimuths_are_mirrored() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), "tl030 pl090 tv000 pv000.png", &picture(2, 2));
    let options = Given::from([("azimuth", "cw")]);
    let source = import::open(dir.path(), &options).unwrap();
    assert_eq!(source.meta().lights.degrees(), [[30.0, 270.0]]);
}

#[test]
fn missing_pairs_are_listed_and_repeat_the_nearest_light() {
    let dir = tempfile::tempdir().unwrap();
    let names =
        ["tl000 pl000 tv000 pv000", "tl030 pl000 tv000 pv000", "tl045 pl000 tv030 pv000", "tl000 pl000 tv030 pv000"];
    for (i, name) in names.iter().enumerate() {
        write(dir.path(), &format!("{name}.png"), &grey_picture(i as u8 * 10));
    }
    write(dir.path(), "readme.txt", b"hello");
    let source = import::open(dir.path(), &Default::default()).unwrap();
    assert_eq!(source.missing(), [(0, 2), (1, 1)]);
    assert_eq!(bytes(&source.image(0, 2).unwrap())[0], 10, "45 degrees repeats 30");
    assert_eq!(bytes(&source.image(1, 1).unwrap())[0], 20, "30 degrees repeats 45, not 0");
    assert_eq!(source.warnings().len(), 2);
    assert!(source.warnings()[0].contains("readme.txt"));
    assert!(source.warnings()[1].contains("2 of 6 pairs are missing, the first is tl045 pl000 tv000 pv000"));
}

#[test]
fn bad_archives_are_named() {
    let good = ("tl000 pl000 tv000 pv000.png".to_owned(), picture(2, 2));
    type Files = Vec<(String, Vec<u8>)>;
    let cases: Vec<(&str, Files, &str)> = vec![
        (
            "a name that does not parse",
            vec![("tl000 pl000 tv000.png".into(), picture(2, 2))],
            "tl000 pl000 tv000.png: no `pv`",
        ),
        (
            "a pair twice",
            vec![good.clone(), ("x/00001 tl0 pl0 tv0 pv0.png".into(), picture(2, 2))],
            "x/00001 tl0 pl0 tv0 pv0.png: the same directions as tl000",
        ),
        ("nothing", vec![("readme.txt".into(), b"hello".to_vec())], "no picture"),
        (
            "no picture",
            vec![("tl000 pl000 tv000 pv000.jpg".into(), b"hello".to_vec())],
            "tv000 pv000.jpg: expected a PNG, JPEG",
        ),
        (
            "a truncated picture",
            vec![("tl000 pl000 tv000 pv000.png".into(), picture(2, 2)[..60].to_vec())],
            "the PNG image is damaged",
        ),
        (
            "another size",
            vec![good, ("tl015 pl000 tv000 pv000.png".into(), picture(3, 2))],
            "tl015 pl000 tv000 pv000.png: 3 x 2 texels, the other images have 2 x 2",
        ),
    ];
    for (what, files, expected) in cases {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("folder");
        let archive = dir.path().join("archive.zip");
        let mut zip = zip::ZipWriter::new(fs::File::create(&archive).unwrap());
        for (name, content) in &files {
            write(&folder, name, content);
            zip.start_file(name.as_str(), zip::write::SimpleFileOptions::default()).unwrap();
            zip.write_all(content).unwrap();
        }
        zip.finish().unwrap();
        for path in [folder, archive] {
            let opened = import::open(&path, &Default::default()).and_then(|source| source.view(0).map(|t| t.len()));
            let error = opened.unwrap_err().to_string();
            assert!(error.contains(expected), "{what}: {error}\nshould contain {expected}");
            assert!(error.starts_with(&path.display().to_string()), "{error}");
        }
    }
}

#[test]
fn a_truncated_or_damaged_zip_never_panics() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.zip");
    let mut source = Synthetic::bonn81(2, 2);
    source.meta.views = loden::direction::DirectionSet::from_degrees(vec![[0.0, 0.0], [30.0, 0.0]]).unwrap();
    source.meta.lights = source.meta.views.clone();
    export::export(&source, &path, &Default::default(), &Silent).unwrap();
    let whole = fs::read(&path).unwrap();
    let read = |content: &[u8]| {
        fs::write(&path, content).unwrap();
        let source = import::open(&path, &Default::default())?;
        (0..source.meta().views.len()).try_for_each(|v| source.view(v).map(drop))
    };
    read(&whole).unwrap();
    for cut in (0..whole.len()).step_by(17) {
        assert!(read(&whole[..cut]).is_err(), "cut at {cut}");
    }
    for at in (0..whole.len()).step_by(3) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x5a;
        let _ = read(&damaged);
    }
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn an_archive_of_another_writer_opens() {
    let folder = data("oracle");
    let source = import::open(folder.join("synthetic_ubo2003.zip"), &Default::default()).unwrap();
    let meta = source.meta();
    assert_eq!(meta.lights.degrees(), [[0.0, 0.0], [15.0, 0.0], [75.0, 345.0]]);
    assert_eq!(meta.views.degrees(), [[0.0, 0.0], [15.0, 60.0]]);
    assert!(source.missing().is_empty());
    assert_eq!(source.image(1, 2).unwrap().len(), meta.image_len());
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn shared_measurements_open() {
    let folder = data("btf");
    for name in ["twill.zip", "pebble.zip"] {
        let source = import::open(folder.join(name), &Default::default()).unwrap();
        let meta = source.meta();
        assert_eq!(
            (meta.width, meta.height, meta.views.name(), meta.lights.name()),
            (64, 64, Some("bonn81"), Some("bonn81"))
        );
        assert!(source.missing().is_empty());
        assert!(bytes(&source.image(0, 0).unwrap()).iter().any(|&v| v > 40));
    }
}

fn write(folder: &Path, name: &str, content: &[u8]) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, content).unwrap();
}

fn picture(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let image = image::RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, 7]));
    image.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    bytes
}

fn grey_picture(level: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let image = image::GrayImage::from_pixel(2, 2, image::Luma([level]));
    image.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    bytes
}
