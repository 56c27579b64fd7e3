//! What the default method keeps of a texture.

use super::super::*;
use super::*;
use crate::progress::Silent;

/// Texels per thread of [`twill`], not a whole number.
const THREAD: f64 = 16.0 / 3.0;

/// A 2/2 twill with some noise: warp above weft is bright.
fn twill(side: usize) -> Exemplar {
    let value = |i: usize| {
        let thread = |v: usize| ((v as f64 + 0.25) / THREAD).floor() as i32;
        let above = (thread(i % side) - thread(i / side)).rem_euclid(4) < 2;
        f32::from(u8::from(above)) + 0.3 * random::unit(random::mix(i as u64))
    };
    Exemplar::new(side, side, 1, (0..side * side).map(value).collect())
}

fn result(exemplar: &Exemplar, goal: &Goal) -> SourceMap {
    synthesize(&Optimise, exemplar, goal, &Values::defaults(Table::TABLE), &Silent).unwrap()
}

#[test]
fn the_lattice_of_a_twill_is_found_and_noise_has_none() {
    let sample = Sample::<4>::new(&twill(96)).unwrap();
    let points = Lattice::of(&sample).unwrap().within([-60, -60], [60, 60]);
    for (m, n) in [(1, 1), (2, 2), (4, 0), (0, 4), (8, 8), (3, -1)] {
        let expected = ((f64::from(m) * THREAD).round() as i32, (f64::from(n) * THREAD).round() as i32);
        let found = points.iter().any(|(x, y)| (x - expected.0).abs() <= 1 && (y - expected.1).abs() <= 1);
        assert!(found, "{expected:?} is missing");
    }
    // one point of the lattice for every four threads
    let density = points.len() as f64 * 4.0 * THREAD * THREAD / (121.0 * 121.0);
    assert!((density - 1.0).abs() < 0.1, "{density}");
    let noise = (0..96 * 96).map(|i| random::unit(random::mix(i))).collect();
    assert_eq!(Lattice::of(&Sample::<4>::new(&Exemplar::new(96, 96, 1, noise)).unwrap()), None);
}

#[test]
fn threads_of_a_twill_run_through_unbroken() {
    let exemplar = twill(96);
    let (w, h) = (256, 200);
    for seed in 0..3 {
        let map = result(&exemplar, &Goal { seed, ..Goal::new(w, h) });
        let is_warp = |x: usize, y: usize| exemplar.texel(map.at(x, y).x.into(), map.at(x, y).y.into())[0] > 0.65;
        // Compare with an endless twill away from the edges of threads, at the phase that fits best
        let thread = |v: usize, phase: f64| {
            let at = (v as f64 + phase) / THREAD;
            let is_inside = (at - at.round()).abs() * THREAD > 1.5;
            is_inside.then_some(at.floor() as i32)
        };
        let wrong = |phase: (f64, f64)| {
            let differs = |i: &usize| {
                let (x, y) = (i % w, i / w);
                let Some((i, j)) = thread(x, phase.0).zip(thread(y, phase.1)) else { return false };
                ((i - j).rem_euclid(4) < 2) != is_warp(x, y)
            };
            (0..w * h).filter(differs).count()
        };
        let phases = (0..43).flat_map(|x| (0..11).map(move |y| (f64::from(x) * 0.5, f64::from(y) * 0.5)));
        let least = phases.map(wrong).min();
        assert_eq!(least, Some(0), "seed {seed}: texels of wrong threads");
    }
}

#[test]
fn many_channels_give_what_their_components_give() {
    let grey = twill(64);
    let values = grey.values.iter().flat_map(|v| (0..16).map(move |c| v * (1.0 + 0.1 * c as f32))).collect();
    let many = Exemplar::new(64, 64, 16, values);
    let map = result(&many, &Goal::new(128, 128));
    let is_warp = |x: usize, y: usize| grey.texel(map.at(x, y).x.into(), map.at(x, y).y.into())[0] > 0.65;
    let share = (0..128 * 128).filter(|i| is_warp(i % 128, i / 128)).count() as f64 / (128.0 * 128.0);
    assert!((share - 0.5).abs() < 0.05, "{share}");
}

/// Smooth irregular bumps.
fn bumps() -> Exemplar {
    let bump = |i: usize| {
        let (x, y) = ((i % 64) as f64, (i / 64) as f64);
        let wave =
            |k: f64| libm::sin(0.31 * k * x + 1.7 * libm::sin(0.13 * y * k)) + libm::sin(0.29 * y + k * 0.17 * x);
        (wave(1.0) + wave(1.37)) as f32
    };
    Exemplar::new(64, 64, 1, (0..64 * 64).map(bump).collect())
}

#[test]
fn a_tileable_result_continues_at_its_edges() {
    let exemplar = bumps();
    let (w, h) = (120, 100);
    let step =
        |map: &SourceMap, a: (usize, usize), b: (usize, usize)| exemplar.distance(map.at(a.0, a.1), map.at(b.0, b.1));
    let across = |map: &SourceMap| (0..h).map(|y| step(map, (w - 1, y), (0, y))).sum::<f32>() / h as f32;
    let inside = |map: &SourceMap| (0..h).map(|y| step(map, (w / 2, y), (w / 2 + 1, y))).sum::<f32>() / h as f32;
    let tileable = result(&exemplar, &Goal { tileable: true, ..Goal::new(w, h) });
    let open = result(&exemplar, &Goal::new(w, h));
    assert!(across(&tileable) < 3.0 * inside(&tileable), "{} {}", across(&tileable), inside(&tileable));
    assert!(across(&open) > 10.0 * inside(&open), "{} {}", across(&open), inside(&open));
}

#[test]
fn constant_and_periodic_exemplars_work() {
    let constant = Exemplar::new(20, 30, 3, vec![0.4; 20 * 30 * 3]);
    assert_eq!(result(&constant, &Goal::new(50, 10)).sources.len(), 500);
    let periodic = Exemplar { periodic: true, ..twill(64) };
    let map = result(&periodic, &Goal::new(100, 100));
    // the edges of a periodic exemplar are neighbourhoods like others
    let edge = map.sources.iter().filter(|source| source.x < 3).count() as f64 / 1e4;
    assert!(edge > 0.5 * 3.0 / 64.0, "{edge}");
}

#[test]
fn a_hole_in_a_twill_is_filled_with_threads_that_run_on() {
    let whole = twill(96);
    let hole = |texel: usize| (30..62).contains(&(texel % 96)) && (34..58).contains(&(texel / 96));
    let mask: Vec<bool> = (0..96 * 96).map(|texel| !hole(texel)).collect();
    let exemplar = Exemplar { mask: Some(mask), ..whole.clone() };
    let own = |texel: usize| (!hole(texel)).then(|| Source::new(texel % 96, texel / 96));
    let goal = Goal { known: Some((0..96 * 96).map(own).collect()), ..Goal::new(96, 96) };
    let map = result(&exemplar, &goal);
    let mut wrong = 0;
    for (texel, source) in map.sources.iter().enumerate() {
        assert!(hole(texel) || source.texel(96) == texel, "{texel}");
        assert!(!hole(source.texel(96)), "{texel}");
        let is_warp = |texel: usize| whole.values[texel] > 0.65;
        wrong += usize::from(is_warp(texel) != is_warp(source.texel(96)));
    }
    // texels at the edges of threads may be either
    assert!(wrong < 32 * 24 / 10, "{wrong} texels of wrong threads");
}

#[test]
fn bands_go_on_with_each_other() {
    let exemplar = bumps();
    let sample = Sample::<4>::new(&exemplar).unwrap();
    for (w, h) in [(64, 700), (700, 64)] {
        let goal = Goal::new(w, h);
        let sources = bands::run_within(&sample, &goal, &Table::default(), 64 * 300, &Silent).unwrap();
        let map = SourceMap { width: w, height: h, sources };
        let step = |a: (usize, usize), b: (usize, usize)| exemplar.distance(map.at(a.0, a.1), map.at(b.0, b.1));
        // differences between neighbours are no larger where a band begins
        let at = |k: usize| match w > h {
            true => (0..h).map(|y| step((k - 1, y), (k, y))).sum::<f32>(),
            false => (0..w).map(|x| step((x, k - 1), (x, k))).sum::<f32>(),
        };
        let mut all: Vec<f32> = (1..700).map(at).collect();
        all.sort_by(f32::total_cmp);
        for k in [204, 408, 612] {
            assert!(at(k) < all[690], "{w} x {h}, {k}: {}, others {:?}", at(k), &all[600..]);
        }
    }
    let goal = Goal { tileable: true, ..Goal::new(300, 300) };
    let error = bands::run_within(&sample, &goal, &Table::default(), 1000, &Silent).unwrap_err().to_string();
    assert_eq!(error, "size: a tileable result has at most 1000 texels: repeat a smaller one");
}

#[test]
fn a_guide_is_followed() {
    // dark and bright grains, left and right
    let value = |i: usize| 0.3 * random::unit(random::mix(i as u64)) + if i % 64 < 32 { 0.0 } else { 0.6 };
    let exemplar = Exemplar::new(64, 64, 1, (0..64 * 64).map(value).collect());
    let wanted = |i: usize| if (i % 120 / 30 + i / 120 / 30).is_multiple_of(2) { 0.1 } else { 0.8 };
    let result_guide: Vec<f32> = (0..120 * 90).map(wanted).collect();
    let guide = |weight| Some(Guide { sample: exemplar.values.clone(), result: result_guide.clone(), weight });
    let error = |weight: f32| {
        let map = result(&exemplar, &Goal { guide: guide(weight), ..Goal::new(120, 90) });
        let value = |i: usize| exemplar.values[map.sources[i].texel(64)];
        (0..120 * 90).map(|i| (value(i) - result_guide[i]).abs()).sum::<f32>() / (120.0 * 90.0)
    };
    let (followed, ignored) = (error(20.0), error(0.0));
    assert!(followed < 0.15 && ignored > 0.25, "{followed} {ignored}");
    let wrong = Goal { guide: guide(1.0), ..Goal::new(10, 10) };
    let values = Values::defaults(Table::TABLE);
    let error = synthesize(&Optimise, &exemplar, &wrong, &values, &Silent).unwrap_err().to_string();
    assert_eq!(error, "guide: expected a number for every texel of the sample and of the result");
}

#[test]
fn samples_are_used_as_often_as_their_weights_say() {
    // two samples beside each other, one bright, with a column between that is not copied
    let value = |i: usize| random::unit(random::mix(i as u64)) * if i % 97 < 48 { 0.5 } else { 0.6 };
    let share = |weight: f32| {
        let exemplar = Exemplar {
            mask: Some((0..97 * 48).map(|i| i % 97 != 48).collect()),
            weights: Some((0..97 * 48).map(|i| if i % 97 < 48 { 1.0 } else { weight }).collect()),
            ..Exemplar::new(97, 48, 1, (0..97 * 48).map(value).collect())
        };
        let map = result(&exemplar, &Goal::new(128, 128));
        map.sources.iter().filter(|source| source.x > 48).count() as f64 / (128.0 * 128.0)
    };
    let (equal, more, less) = (share(1.0), share(3.0), share(1.0 / 3.0));
    assert!(less < equal - 0.08 && more > equal + 0.08, "{less} {equal} {more}");
    assert!((0.3..0.7).contains(&equal), "{equal}");
}
