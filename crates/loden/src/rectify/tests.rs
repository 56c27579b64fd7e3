use std::path::Path;

use glam::{DVec2, Vec3};

use super::detect::Frame;
use super::projection::Distortion;
use super::resample::Photograph;
use super::*;

/// Renders the frame and a bright sample seen through `homography` and `lens`, with 16 points per pixel.
fn painted(size: [usize; 2], homography: &Homography, lens: &Lens, frame: &Frame) -> Vec<f32> {
    // Invert by Newton's method with finite differences; the mapping is smooth.
    let plane = |pixel: DVec2| {
        let target = lens.undistort(pixel);
        let mut p = DVec2::splat(0.5);
        for _ in 0..20 {
            let at = homography.apply(p);
            let (x, y) = (homography.apply(p + DVec2::X * 1e-6) - at, homography.apply(p + DVec2::Y * 1e-6) - at);
            let off = (target - at) * 1e-6;
            let step = DVec2::new(off.perp_dot(y), x.perp_dot(off)) / x.perp_dot(y);
            p += step;
            if step.length_squared() < 1e-16 {
                break;
            }
        }
        p
    };
    let light = |p: DVec2| {
        let sample = (p - 0.5).abs().max_element() <= 0.5;
        if sample { 3.0 + (20.0 * p.x).sin() } else { f64::from(u8::from(frame.is_white(p))) * 0.4 + 0.01 }
    };
    let value = |i: usize| {
        let corner = DVec2::new((i % size[0]) as f64, (i / size[0]) as f64);
        let points = (0..16).map(|k| DVec2::new(f64::from(k % 4) + 0.5, f64::from(k / 4) + 0.5) / 4.0);
        (points.map(|d| light(plane(corner + d))).sum::<f64>() / 16.0) as f32
    };
    (0..size[0] * size[1]).into_par_iter().map(value).collect()
}

const CORNERS: [(f64, f64); 4] = [(52.0, 40.0), (131.0, 30.0), (150.0, 95.0), (40.0, 112.0)];

#[test]
fn the_frame_is_found_to_a_fraction_of_a_pixel_in_any_orientation() {
    let (frame, size) = (Frame::default(), [190, 150]);
    let lens = Lens::new(Distortion { k1: -0.06, k2: 0.01 }, size[0], size[1]);
    for turn in 0..4 {
        let corners = [0, 1, 2, 3].map(|i| DVec2::from(CORNERS[(i + turn) % 4]));
        let truth = Homography::from_square(0.0, 1.0, corners).unwrap();
        let values = painted(size, &truth, &lens, &frame);
        let found = find(&GreyImage { width: size[0], height: size[1], values: &values }, &frame, &lens).unwrap();
        for at in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.5, 0.5)] {
            let off = found.homography.apply(at.into()).distance(truth.apply(at.into()));
            assert!(off < 0.06, "turned by {turn}: {at:?} is off by {off} pixels");
        }
        assert!(found.error < 0.15 && found.points > 300, "{found:?}");
        // A wrong lens model bends the edges and increases the error.
        let wrong = Lens::new(Distortion { k1: 0.2, k2: 0.0 }, size[0], size[1]);
        let bent = find(&GreyImage { width: size[0], height: size[1], values: &values }, &frame, &wrong);
        assert!(bent.is_err() || bent.unwrap().error > 2.0 * found.error);
    }
}

#[test]
fn photographs_without_a_frame_are_errors() {
    let (frame, size) = (Frame::default(), [96, 96]);
    let lens = Lens::new(Distortion::default(), size[0], size[1]);
    let find = |values: Vec<f32>| {
        find(&GreyImage { width: size[0], height: size[1], values: &values }, &frame, &lens).unwrap_err()
    };
    assert!(find(vec![0.0; 96 * 96]).contains("no bright ring"));
    assert!(find((0..96 * 96).map(|i| (i % 96) as f32).collect()).contains("ring"));
    let corners = [(20.0, 20.0), (76.0, 20.0), (76.0, 76.0), (20.0, 76.0)].map(DVec2::from);
    let truth = Homography::from_square(0.0, 1.0, corners).unwrap();
    let unmarked = Frame { mark: 1e-9, ..frame };
    assert!(find(painted(size, &truth, &lens, &unmarked)).contains("mark"));
}

#[test]
fn a_texel_is_the_mean_over_its_square() {
    // A linear ramp along x of the plane is preserved exactly under perspective.
    let size = [160, 150];
    let lens = Lens::new(Distortion::default(), size[0], size[1]);
    let corners = [(10.0, 20.0), (150.0, 50.0), (150.0, 100.0), (10.0, 140.0)].map(DVec2::from);
    let map = Homography::from_square(0.0, 1.0, corners).unwrap();
    let x_of = |column: f64| {
        let (mut low, mut high) = (-1.0, 2.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if map.apply(DVec2::new(middle, 0.5)).x < column { low = middle } else { high = middle }
        }
        low
    };
    // The sides are vertical in the photograph, so columns have constant x.
    let rgb = (0..size[0] * size[1]).map(|i| Vec3::splat(x_of((i % size[0]) as f64 + 0.5) as f32)).collect();
    let texels = resample(&Photograph { width: size[0], height: size[1], rgb }, &map, &lens, [8, 8]);
    for (i, rgb) in texels.chunks_exact(3).enumerate() {
        let expected = ((i % 8) as f32 + 0.5) / 8.0;
        assert!((rgb[0] - expected).abs() < 2e-4, "{i}: {} {expected}", rgb[0]);
    }
}

fn picture(path: &Path, side: u32, value: impl Fn(u32, u32) -> u16) {
    let pixel = |x, y| image::Rgb([value(x, y), value(x, y), value(x, y)]);
    image::ImageBuffer::from_fn(side, side, pixel).save(path).unwrap();
}

/// One view, two lights, two 12-bit exposures and given corners; a grey sample of 0.25 and 1.25.
fn manifest(folder: &Path, more: &str) -> PathBuf {
    let flat = |x: u32| 0.5 + 0.005 * f64::from(x);
    let count = |signal: f64| ((100.0 + signal * 4000.0).round() as u16).min(4095);
    picture(&folder.join("dark.png"), 40, |_, _| 100);
    picture(&folder.join("white.png"), 40, |x, _| count(flat(x)));
    for (light, value) in [(0, 0.25), (1, 1.25)] {
        for (e, exposure) in [(0, 0.5), (1, 2.0)] {
            picture(&folder.join(format!("l{light}e{e}.png")), 40, |x, _| count(flat(x) * value * exposure));
        }
    }
    let path = folder.join("set.toml");
    let text = format!(
        "loden_photographs = 1\nfiles = \"l{{light}}e{{exposure}}.png\"\nlights = [[0, 0], [30, 0]]\nexposures = [0.5, 2.0]\n\
         bits = 12\ndark = \"dark.png\"\nwhite = \"white.png\"\ncorners = [[[5, 5], [35, 5], [35, 35], [5, 35]]]\n{more}"
    );
    std::fs::write(&path, text).unwrap();
    path
}

fn rectified(path: &Path) -> Result<(Vec<f32>, Vec<Outcome>)> {
    let mut images = Vec::new();
    let options = Options { size: 4, max_error: 0.5 };
    let outcomes = Photographs::open(path)?.rectify(&options, &crate::progress::Silent, &mut |texels| {
        images = texels;
        Ok(())
    })?;
    Ok((images, outcomes))
}

#[test]
fn dark_and_white_frames_are_applied_and_exposures_merged() {
    let dir = tempfile::tempdir().unwrap();
    let (images, outcomes) = rectified(&manifest(dir.path(), "")).unwrap();
    for (light, expected) in [(0, 0.25f32), (1, 1.25)] {
        for value in &images[light * 48..][..48] {
            // The shorter exposure alone would have a quantization error of 0.0005.
            assert!((value - expected).abs() < 0.0005, "{light}: {value}");
        }
    }
    assert!(outcomes.iter().all(|o| o.saturated == 0 && o.refused.is_none() && o.error.is_none()));
    picture(&dir.path().join("l1e0.png"), 40, |_, _| 4095);
    let (_, outcomes) = rectified(&dir.path().join("set.toml")).unwrap();
    assert_eq!([outcomes[0].saturated, outcomes[1].saturated], [0, 1600]);
}

#[test]
fn photographs_of_some_pairs_become_a_list_of_pairs() {
    let dir = tempfile::tempdir().unwrap();
    let path = manifest(dir.path(), "");
    let text = std::fs::read_to_string(&path).unwrap();
    let degrees = |path: &Path| {
        let meta = Photographs::open(path).unwrap().meta(&Options::default());
        (0..meta.lights.len()).map(|light| meta.pair_degrees(0, light)).collect::<Vec<_>>()
    };
    // two of ten pairs of views and lights
    for (from, to) in [("l0", "v0_l0"), ("l1", "v4_l1")] {
        for exposure in ["e0.png", "e1.png"] {
            std::fs::copy(dir.path().join(format!("{from}{exposure}")), dir.path().join(format!("{to}{exposure}")))
                .unwrap();
        }
    }
    let views = "views = [[45, 9], [1, 0], [2, 0], [3, 0], [9, 1]]\nlights = ";
    std::fs::write(&path, text.replace("l{light}", "v{view}_l{light}").replace("lights = ", views)).unwrap();
    let (some, _) = rectified(&path).unwrap();
    assert_eq!(degrees(&path), [[[0.0, 0.0], [45.0, 9.0]], [[30.0, 0.0], [9.0, 1.0]]]);
    // the same photographs as pairs
    let pairs = text
        .replace("{light}", "{pair}")
        .replace("lights = [[0, 0], [30, 0]]", "pairs = [[0, 0, 45, 9], [30, 0, 9, 1]]");
    assert!(pairs.contains("pairs = "), "{text}");
    std::fs::write(&path, pairs).unwrap();
    let (listed, _) = rectified(&path).unwrap();
    assert_eq!(degrees(&path), [[[0.0, 0.0], [45.0, 9.0]], [[30.0, 0.0], [9.0, 1.0]]]);
    assert_eq!(some, listed);
    // a pair that is listed must have a photograph
    let more = std::fs::read_to_string(&path).unwrap().replace("9, 1]]", "9, 1], [60, 0, 0, 0]]");
    std::fs::write(&path, more).unwrap();
    let error = rectified(&path).unwrap_err().to_string();
    assert!(error.contains("set.toml: files: found no photograph for view (0, 0) and light (60, 0)"), "{error}");
}

#[test]
fn manifest_errors_name_file_and_field() {
    let dir = tempfile::tempdir().unwrap();
    for (more, expected) in [
        ("colour = 1", "set.toml: line 9: "),
        ("white_value = 0", "set.toml: white_value: "),
        ("count_from = 1", "set.toml: lights: "),
        ("distortion = [-1, 0]", "set.toml: distortion: "),
        ("frame = { inner = 0.2, outer = 0.1, mark = 0.1 }", "set.toml: frame: "),
    ] {
        let error = rectified(&manifest(dir.path(), more)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\nshould contain {expected}");
    }
    let path = manifest(dir.path(), "");
    let text = std::fs::read_to_string(&path).unwrap();
    for (from, to, expected) in [
        ("loden_photographs = 1", "loden_photographs = 2", "set.toml: loden_photographs: "),
        ("exposures = [0.5, 2.0]", "exposures = [0.5]", "set.toml: exposures: l0e1.png: "),
        ("exposures = [0.5, 2.0]", "exposures = [0.5, -1]", "set.toml: exposures: "),
        ("[30, 0]]", "[30, 0], [60, 0]]", "set.toml: files: found no photograph for view (0, 0) and light (60, 0)"),
        ("lights = ", "pairs = [[0, 0, 30, 0]]\nlights = ", "set.toml: pairs: "),
        ("bits = 12", "bits = 17", "set.toml: bits: "),
        ("[35, 5], [35, 35]", "[35, 35], [35, 5]", "set.toml: corners: "),
        ("{light}e", "{lite}e", "set.toml: files: {lite}"),
    ] {
        std::fs::write(&path, text.replace(from, to)).unwrap();
        let error = rectified(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\nshould contain {expected}");
    }
    std::fs::write(&path, text).unwrap();
    picture(&dir.path().join("l1e1.png"), 41, |_, _| 100);
    assert!(
        rectified(&path)
            .unwrap_err()
            .to_string()
            .contains("l1e1.png: size: found 41 x 41 pixels, but the dark frame has 40 x 40")
    );
}
