use glam::Vec3;

use super::*;
use crate::Error;
use crate::direction::theta;
use crate::progress::Progress;

#[test]
fn a_flat_white_sample_reads_the_cosine() {
    let bonn = DirectionSet::bonn81();
    let options = Options { size: 2, spp: 2, ..Options::default() };
    let images = measure(&flat(8, WHITE).unwrap(), &bonn, &bonn, &options);
    for (pair, image) in images.chunks(2 * 2 * 3).enumerate() {
        let cosine = bonn.directions()[pair % 81].z;
        assert!(image.iter().all(|v| (v - cosine).abs() < 1e-5), "{pair}: {image:?}, expected {cosine}");
    }
}

#[test]
fn a_flat_sample_shows_its_albedo_the_right_way_up_from_everywhere() {
    let quadrant = |x: f32, y: f32| match (x < 0.5, y < 0.5) {
        (true, true) => Vec3::X,
        (false, true) => Vec3::Y,
        (true, false) => Vec3::Z,
        (false, false) => Vec3::ONE,
    };
    let field = HeightField::from_fn(64, |x, y| (0.25, Finish::matt(quadrant(x, y)))).unwrap();
    let views = directions(&[[0.0, 0.0], [45.0, 90.0], [75.0, 200.0]]);
    let options = Options { size: 16, spp: 4, ..Options::default() };
    let images = measure(&field, &views, &directions(&[[0.0, 0.0]]), &options);
    for image in images.chunks(16 * 16 * 3) {
        let texel = |row: usize, column: usize| Vec3::from_slice(&image[(row * 16 + column) * 3..]);
        let [left, right] = [4, 12];
        for (found, expected) in [(texel(12, left), Vec3::X), (texel(12, right), Vec3::Y)] {
            assert!(found.abs_diff_eq(expected, 1e-5), "below: {found}");
        }
        for (found, expected) in [(texel(4, left), Vec3::Z), (texel(4, right), Vec3::ONE)] {
            assert!(found.abs_diff_eq(expected, 1e-5), "above: {found}");
        }
    }
}

/// A wall with a flat top between grid points 8 and 12.
fn wall(n: usize, height: f32) -> HeightField {
    let on_top = |x: f32| (8..=12).contains(&((x * n as f32) as usize));
    HeightField::from_fn(n, |x, _| (if on_top(x) { height } else { 0.0 }, WHITE)).unwrap()
}

#[test]
fn a_wall_casts_a_shadow_of_the_right_length() {
    let (n, height) = (64, 0.09);
    let options = Options { size: n, spp: 64, depth: 1, seed: 3 };
    for polar in [30.0f64, 45.0, 60.0, 75.0] {
        let light = directions(&[[polar, 180.0]]);
        let image = measure(&wall(n, height), &directions(&[[0.0, 0.0]]), &light, &options);
        let expected = f64::from(height) * polar.to_radians().tan() * n as f64;
        let cosine = polar.to_radians().cos();
        let dark = |row: &[f32]| row[10 * 3..].chunks(3).map(|rgb| 1.0 - f64::from(rgb[0]) / cosine).sum::<f64>();
        let found = image.chunks(n * 3).map(dark).sum::<f64>() / n as f64;
        // two texels of a row are partly dark, each sampled at 64 positions: an error of about 0.02 per row
        assert!((found - expected).abs() < 0.01, "{polar}: {found} texels, expected {expected}");
    }
}

#[test]
fn a_raised_top_is_shifted_by_its_height_above_the_mean() {
    let (n, height) = (64, 0.1f32);
    let field = wall(n, height);
    // light along the view, so everything visible is lit
    let direction = directions(&[[45.0, 0.0]]);
    let options = Options { size: n, spp: 64, depth: 1, seed: 3 };
    let image = measure(&field, &direction, &direction, &options);
    let above = f64::from(height - field.mean_height()) * n as f64;
    let cosine = 45f64.to_radians().cos();
    for row in image.chunks(n * 3) {
        // everything is level except the steep side towards the viewer
        let steep: Vec<_> = (0..n).filter(|x| (f64::from(row[3 * x]) - cosine).abs() > 0.02).collect();
        // seen from the right at 45 degrees, the edge at grid point 12 is displaced by `above`
        let edge = 12.5 - above;
        let first = *steep.first().unwrap() as f64;
        assert!((first..first + 1.0).contains(&edge), "{steep:?} starts at {edge}");
    }
}

#[test]
fn white_furnace() {
    let lights = dense(20, 40);
    let views = directions(&[[0.0, 0.0], [60.0, 200.0]]);
    let options = Options { size: 4, spp: 256, depth: 400, seed: 1 };
    for (name, field) in [("flat", flat(8, WHITE).unwrap()), ("hills", hills(32, WHITE))] {
        let images = measure(&field, &views, &lights, &options);
        for (view, images) in images.chunks(images.len() / 2).enumerate() {
            // L_out = sum of rho / pi over the solid angles 2 pi / count
            let radiance = 2.0 * mean(images);
            assert!((radiance - 1.0).abs() < 0.01, "{name}, view {view}: {radiance}");
        }
    }
}

#[test]
fn samples_conserve_energy() {
    let lights = dense(12, 24);
    let views = directions(&[[0.0, 0.0], [45.0, 30.0], [75.0, 120.0]]);
    let options = Options { size: 8, spp: 16, depth: 30, seed: 1 };
    let metal = |alpha| hills(32, Finish::metal(Vec3::ONE, alpha));
    let fields = [metal(0.3), metal(1.0), hills(32, glossy()), hills(32, Finish::coated(Vec3::ONE, 0.04, 0.5))];
    for (k, field) in fields.iter().enumerate() {
        let images = measure(field, &views, &lights, &options);
        for images in images.chunks(images.len() / 3) {
            let radiance = 2.0 * mean(images);
            assert!((0.2..1.01).contains(&radiance), "field {k}: {radiance}");
        }
    }
}

/// Mean and standard error over several independent measurements, per pair.
fn repeated(field: &HeightField, set: &DirectionSet, runs: u64) -> Vec<(f64, f64)> {
    let options = |seed| Options { size: 16, spp: 32, depth: 6, seed };
    let images: Vec<_> = (0..runs).map(|seed| measure(field, set, set, &options(seed))).collect();
    let per = images[0].len() / set.len().pow(2);
    let pair = |p: usize| {
        let means: Vec<f64> = images.iter().map(|i| mean(&i[p * per..][..per])).collect();
        let all = means.iter().sum::<f64>() / runs as f64;
        let squares: f64 = means.iter().map(|m| (m - all).powi(2)).sum();
        (all, (squares / (runs * (runs - 1)) as f64).sqrt())
    };
    (0..set.len().pow(2)).map(pair).collect()
}

#[test]
fn reflectance_is_reciprocal_on_average() {
    let set = directions(&[[0.0, 0.0], [30.0, 40.0], [60.0, 200.0], [75.0, 310.0]]);
    let cosine = |k: usize| f64::from(set.directions()[k].z);
    for finish in [WHITE, glossy()] {
        let pairs = repeated(&hills(32, finish), &set, 16);
        for (v, l) in (0..4).flat_map(|v| (0..v).map(move |l| (v, l))) {
            let ((a, da), (b, db)) = (pairs[v * 4 + l], pairs[l * 4 + v]);
            let (a, da, b, db) = (a / cosine(l), da / cosine(l), b / cosine(v), db / cosine(v));
            let error = da.hypot(db);
            assert!(error < 0.01 * a, "too noisy to say: {a} +- {error}");
            assert!((a - b).abs() < 4.0 * error + 1e-4 * a, "({v}, {l}): {a} against {b}, error {error}");
        }
    }
}

#[test]
fn more_depth_brings_more_light_and_depth_one_is_direct_alone() {
    let set = directions(&[[30.0, 0.0]]);
    let at = |depth| mean(&measure(&hills(32, WHITE), &set, &set, &Options { size: 8, spp: 64, depth, seed: 5 }));
    let (one, two, eight) = (at(1), at(2), at(8));
    assert!(one < two * 0.99 && two < eight * 0.99, "{one} {two} {eight}");
    // the sample cannot reflect more than it receives
    assert!(eight < 1.0, "{eight}");
}

#[test]
fn results_depend_only_on_the_seed() {
    let bonn = DirectionSet::bonn81();
    let (field, views) = (hills(32, glossy()), directions(&[[20.0, 30.0], [70.0, 0.0]]));
    let run = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| measure(&field, &views, &bonn, &Options { size: 8, spp: 4, depth: 4, seed }))
    };
    assert_eq!(run(1, 7), run(2, 7));
    assert_ne!(run(1, 7), run(1, 8));
}

#[test]
fn bad_options_and_directions_are_named() {
    let field = flat(8, WHITE).unwrap();
    let run = |views: &DirectionSet, options: Options| {
        acquire(&field, views, &DirectionSet::bonn81(), &options, &Silent, &mut |_, _| Ok(())).unwrap_err().to_string()
    };
    let bonn = DirectionSet::bonn81();
    assert!(run(&bonn, Options { size: 0, ..Options::default() }).starts_with("size: found"));
    assert!(run(&bonn, Options { depth: 0, ..Options::default() }).starts_with("depth: found"));
    let low = directions(&[[89.5, 0.0]]);
    assert!(theta(low.directions()[0]) > 1.55);
    assert!(run(&low, Options::default()).contains("expected at most 89"));
}

#[test]
fn bad_fields_are_refused() {
    let heights = |n: usize, h: f32| HeightField::new(n, vec![h; n * n], vec![WHITE; n * n]);
    for (bad, word) in
        [(heights(6, 0.0), "power of two"), (heights(2, 0.0), "power of two"), (heights(8, 2.0), "periods")]
    {
        assert!(bad.unwrap_err().to_string().contains(word));
    }
    assert!(heights(8, f32::NAN).is_err());
    assert!(HeightField::new(8, vec![0.0; 63], vec![WHITE; 64]).is_err());
    assert!(flat(8, Finish { roughness: 0.0, ..WHITE }).is_err());
    assert!(flat(8, Finish { albedo: [0.0, f32::NAN, 0.0], ..WHITE }).is_err());
}

#[test]
fn cancelling_stops() {
    struct Stop;
    impl Progress for Stop {
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let bonn = DirectionSet::bonn81();
    let mut views = 0;
    let mut sink = |_, _| {
        views += 1;
        Ok(())
    };
    let result = acquire(&flat(8, WHITE).unwrap(), &bonn, &bonn, &Options::default(), &Stop, &mut sink);
    assert!(matches!(result, Err(Error::Cancelled)));
    assert_eq!(views, 0);
}
