use super::*;
use crate::acquire::{SAMPLES, maps, named};
use crate::params::{Kind, Params, Values};

fn build(name: &str, grid: usize, seed: u64, given: &[(&str, &str)]) -> HeightField {
    let sample = named(name).unwrap();
    let values = Values::new(sample.params(), given.iter().copied()).unwrap();
    sample.build(&values, grid, seed).unwrap()
}

#[test]
fn names_are_unique_and_sorted_and_defaults_are_allowed() {
    assert!(SAMPLES.iter().map(|s| s.name()).is_sorted());
    for param in SAMPLES.iter().flat_map(|s| s.params()).chain(maps::Options::TABLE).chain(Options::TABLE) {
        param.check(param.default).unwrap();
        assert!(!param.doc.is_empty());
    }
    assert!(named("velvet").is_none());
}

#[test]
fn samples_depend_only_on_the_seed() {
    for sample in SAMPLES {
        let field = |seed| build(sample.name(), 64, seed, &[]);
        let (a, b, c) = (field(1), field(1), field(2));
        assert!(a.heights() == b.heights() && a.finish() == b.finish(), "{}", sample.name());
        assert!(a.heights() != c.heights(), "{}", sample.name());
    }
}

/// The largest height difference between columns `a` and `b`, and between the same rows.
fn step(field: &HeightField, a: usize, b: usize) -> f32 {
    let (n, h) = (field.grid(), field.heights());
    let steps = (0..n).flat_map(|k| [(k * n + a, k * n + b), (a * n + k, b * n + k)]);
    steps.map(|(i, j)| (h[i] - h[j]).abs()).fold(0.0, f32::max)
}

#[test]
fn samples_tile_without_a_seam() {
    for sample in SAMPLES {
        let field = build(sample.name(), 256, 3, &[]);
        let inside = (0..255).map(|k| step(&field, k, k + 1)).fold(0.0, f32::max);
        let seam = step(&field, 255, 0);
        assert!(inside > 0.0 && seam <= inside, "{}: {seam} at the seam, {inside} inside", sample.name());
    }
}

/// At both ends of the range of every parameter, a sample either builds or explains why not.
#[test]
fn every_value_of_a_parameter_builds_or_is_refused() {
    for sample in SAMPLES {
        for param in sample.params() {
            let texts: Vec<String> = match param.kind {
                Kind::Integer { min, max } => vec![min.to_string(), max.to_string()],
                Kind::Real { min, max } => vec![min.to_string(), max.to_string()],
                Kind::Color { min, max } => vec![min.to_string(), max.to_string()],
                Kind::Choice(words) => words.iter().map(|w| (*w).into()).collect(),
                Kind::Switch => vec!["yes".into(), "no".into()],
                Kind::Text(_) => Vec::new(),
            };
            for text in texts {
                let values = Values::new(sample.params(), [(param.name, text.as_str())]).unwrap();
                let field = sample.build(&values, 32, 1);
                assert!(field.is_ok(), "{} {} = {text}: {:?}", sample.name(), param.name, field.err());
            }
        }
    }
    let values = Values::new(named("twill").unwrap().params(), [("yarns", "6")]).unwrap();
    let refused = named("twill").unwrap().build(&values, 32, 1).unwrap_err().to_string();
    assert!(refused.starts_with("yarns: found 6"), "{refused}");
}

#[test]
fn pictures_become_a_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // white above, black below; red on the left, mid-grey on the right
    let height = image::GrayImage::from_fn(8, 8, |_, y| image::Luma([if y < 4 { 255 } else { 0 }]));
    let albedo = image::RgbImage::from_fn(8, 8, |x, _| image::Rgb(if x < 4 { [255, 0, 0] } else { [188, 188, 188] }));
    height.save(path("height.png")).unwrap();
    albedo.save(path("albedo.png")).unwrap();
    let values = maps::Options { height_scale: 0.2, ..maps::Options::default() };
    let field = maps::build(&path("height.png"), Some(&path("albedo.png")), &values, 8).unwrap();
    // rows of a field count upwards
    assert!((field.heights()[7 * 8 + 2] - 0.2).abs() < 1e-6 && field.heights()[8 + 2] == 0.0);
    assert_eq!(field.finish()[1].albedo, [1.0, 0.0, 0.0]);
    assert!((field.finish()[6].albedo[1] - 0.5).abs() < 0.01);

    let missing = maps::build(&path("none.png"), None, &values, 8).unwrap_err();
    assert!(missing.to_string().contains("none.png"));
    std::fs::write(path("bad.png"), &std::fs::read(path("height.png")).unwrap()[..40]).unwrap();
    assert!(maps::build(&path("bad.png"), None, &values, 8).unwrap_err().to_string().contains("bad.png: image"));
    image::GrayImage::new(8, 4).save(path("wide.png")).unwrap();
    assert!(maps::build(&path("wide.png"), None, &values, 8).unwrap_err().to_string().contains("square"));
}
