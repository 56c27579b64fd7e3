//! Pictures that other programs wrote (tifffile, Pillow, OpenCV, OpenEXR), compared with what these read.

use std::fs;
use std::path::Path;

use glam::Vec3;
use loden::picture::Picture;

/// Folder of the pictures. `expected.txt` has a line for each: name, width, height, then colours in linear Rec. 709: the
/// mean, three corners (left top, left bottom, right top), and a pixel inside.
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/pictures");

/// How far values may be from those of the other program: decoders of JPEG differ in rounding and in how they enlarge
/// subsampled colours.
fn tolerance(name: &str) -> f32 {
    match name {
        _ if name.ends_with(".jpg") || name == "jpeg.tif" => 0.04,
        "ycbcr.tif" | "cmyk.tif" => 0.01,
        _ => 1e-4,
    }
}

#[test]
fn pictures_of_other_programs_have_the_values_that_those_read() {
    let expected = fs::read_to_string(Path::new(FOLDER).join("expected.txt")).unwrap();
    let mut faults = Vec::new();
    for line in expected.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let (name, numbers) =
            (words[0], words[1..].iter().map(|word| word.parse::<f32>().unwrap()).collect::<Vec<_>>());
        let mut warnings = Vec::new();
        let picture = match Picture::read(Path::new(FOLDER).join(name), &mut warnings) {
            Ok(picture) => picture,
            Err(error) => {
                faults.push(error.to_string());
                continue;
            }
        };
        if warnings.is_empty() == name.starts_with("cmyk") {
            faults.push(format!("{name}: {warnings:?}"));
        }
        let (width, height) = (picture.width, picture.height);
        if [width as f32, height as f32] != numbers[..2] {
            faults.push(format!("{name}: {width} x {height}"));
            continue;
        }
        let mean = picture.rgb.iter().sum::<Vec3>() / picture.rgb.len() as f32;
        let pixels = [[0, 0], [0, height - 1], [width - 1, 0], [width / 3, height / 2]];
        let found = [mean].into_iter().chain(pixels.map(|[x, y]| picture.at(x, y)));
        for (found, expected) in found.zip(numbers[2..].chunks_exact(3).map(Vec3::from_slice)) {
            if !found.abs_diff_eq(expected, tolerance(name) * expected.abs().max_element().max(1.0)) {
                faults.push(format!("{name}: found {found}, expected {expected}"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(expected.lines().count() > 60);
}
