//! What every method keeps.

use super::*;
use crate::progress::Silent;

/// Texels of a few channels whose values tell them apart.
fn exemplar(width: usize, height: usize) -> Exemplar {
    let value = |i: usize| crate::random::unit(crate::random::mix(i as u64));
    Exemplar::new(width, height, 3, (0..3 * width * height).map(value).collect())
}

fn run(method: &dyn Synthesis, exemplar: &Exemplar, goal: &Goal) -> Result<SourceMap> {
    synthesize(method, exemplar, goal, &Values::defaults(method.params()), &Silent)
}

/// Every method, with its map of an exemplar.
fn each(exemplar: &Exemplar, goal: &Goal, check: impl Fn(&str, SourceMap)) {
    for method in SYNTHESES {
        let map = run(*method, exemplar, goal).unwrap_or_else(|e| panic!("{}: {e}", method.name()));
        assert_eq!((map.width, map.height), (goal.width, goal.height), "{}", method.name());
        assert_eq!(map.sources.len(), goal.width * goal.height, "{}", method.name());
        let inside = |source: &Source| {
            let (x, y) = (source.x.into(), source.y.into());
            x < exemplar.width && y < exemplar.height && exemplar.is_usable(x, y)
        };
        assert!(map.sources.iter().all(inside), "{}: a source is outside or masked", method.name());
        check(method.name(), map);
    }
}

#[test]
fn exemplars_and_results_of_any_shape_are_filled_with_usable_texels() {
    for (width, height) in [(1, 1), (1, 9), (9, 1), (2, 3), (16, 24)] {
        for (goal_width, goal_height) in [(1, 1), (1, 30), (40, 7), (33, 33)] {
            for tileable in [false, true] {
                let goal = Goal { tileable, ..Goal::new(goal_width, goal_height) };
                each(&exemplar(width, height), &goal, |_, _| {});
            }
        }
    }
}

#[test]
fn results_may_be_long_and_exemplars_of_one_colour() {
    let constant = Exemplar::new(12, 7, 2, vec![0.3; 12 * 7 * 2]);
    for goal in [Goal::new(16_384, 2), Goal::new(1, 3000), Goal { tileable: true, ..Goal::new(2, 2048) }] {
        each(&constant, &goal, |_, _| {});
    }
}

#[test]
fn tileable_results_continue_at_their_opposite_edges() {
    // a periodic wave: neighbours in the exemplar differ little, other texels much
    let wave = |i: usize| [(i % 32) as f32, (i / 32) as f32].map(|at| (at * std::f32::consts::TAU / 8.0).sin());
    let exemplar = Exemplar::new(32, 32, 2, (0..32 * 32).flat_map(wave).collect());
    let goal = Goal { tileable: true, ..Goal::new(48, 40) };
    each(&exemplar, &goal, |name, map| {
        let step = |a: (usize, usize), b: (usize, usize)| exemplar.distance(map.at(a.0, a.1), map.at(b.0, b.1));
        let across = |x: usize| (0..40).map(|y| step((x, y), ((x + 1) % 48, y))).sum::<f32>();
        let along = |y: usize| (0..48).map(|x| step((x, y), (x, (y + 1) % 40))).sum::<f32>();
        let inside = (0..47).map(across).sum::<f32>() / 47.0 / 40.0 + (0..39).map(along).sum::<f32>() / 39.0 / 48.0;
        let edges = across(47) / 40.0 + along(39) / 48.0;
        assert!(edges < 2.0 * inside + 0.05, "{name}: {edges} at the edges, {inside} inside");
    });
}

#[test]
fn work_can_be_cancelled() {
    struct Stop;
    impl Progress for Stop {
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    for method in SYNTHESES.iter().filter(|method| method.name() != "tiling") {
        let values = Values::defaults(method.params());
        let result = synthesize(*method, &exemplar(32, 32), &Goal::new(4096, 4096), &values, &Stop);
        assert!(matches!(result, Err(Error::Cancelled)), "{}", method.name());
    }
}

#[test]
fn work_can_be_watched() {
    /// What was shown: how often, and the share of texels that were known at first and at last.
    #[derive(Default)]
    struct Watch(std::sync::Mutex<Vec<f64>>);
    impl Progress for Watch {
        fn unfinished(&self, width: usize, height: usize, source: &dyn Fn(usize, usize) -> Option<[u16; 2]>) {
            let texels = (0..width * height).map(|texel| source(texel % width, texel / width));
            let known: Vec<[u16; 2]> = texels.flatten().collect();
            assert!(known.iter().all(|[x, y]| *x < 32 && *y < 28), "{known:?}");
            self.0.lock().unwrap().push(known.len() as f64 / (width * height) as f64);
        }
    }
    for method in SYNTHESES.iter().filter(|method| method.name() != "tiling") {
        let (values, watch) = (Values::defaults(method.params()), Watch::default());
        synthesize(*method, &exemplar(32, 28), &Goal::new(40, 44), &values, &watch).unwrap();
        let shown = watch.0.into_inner().unwrap();
        assert!(shown.len() > 3 && shown.last() == Some(&1.0), "{}: {shown:?}", method.name());
        // what starts from a layout shows all of it at once
        assert_eq!(shown[0] == 1.0, method.name() == "optimise", "{}: {shown:?}", method.name());
    }
}

#[test]
fn masked_texels_are_not_copied() {
    let mut exemplar = exemplar(24, 20);
    exemplar.mask = Some((0..24 * 20usize).map(|texel| (texel / 24).abs_diff(5) > 1 || texel % 24 > 3).collect());
    each(&exemplar, &Goal::new(40, 30), |_, _| {});
    exemplar.mask = Some(vec![false; 24 * 20]);
    for method in SYNTHESES {
        let error = run(*method, &exemplar, &Goal::new(8, 8)).unwrap_err().to_string();
        assert_eq!(error, "mask: leaves no texel of the exemplar");
    }
}

#[test]
fn maps_do_not_depend_on_threads_but_on_the_seed() {
    let exemplar = exemplar(20, 20);
    let goal = Goal { seed: 3, ..Goal::new(48, 40) };
    for method in SYNTHESES {
        let with = |threads: usize, goal: &Goal| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(*method, &exemplar, goal)).unwrap()
        };
        let map = with(1, &goal);
        assert_eq!(map, with(2, &goal), "{}", method.name());
        let other = with(2, &Goal { seed: 4, ..goal.clone() });
        assert_eq!(method.name() == "tiling", map == other, "{}: the seed", method.name());
    }
}

#[test]
fn unusable_exemplars_and_sizes_are_refused() {
    let goal = Goal::new(4, 4);
    let refused = |exemplar: &Exemplar, goal: &Goal| run(&tiling::Tiling, exemplar, goal).unwrap_err().to_string();
    let good = exemplar(4, 4);
    assert_eq!(refused(&good, &Goal::new(0, 4)), "size: found 0 x 4, expected 1 to 268435456 texels");
    assert_eq!(
        refused(&good, &Goal::new(1 << 40, 1 << 40)).split(',').next(),
        Some("size: found 1099511627776 x 1099511627776")
    );
    let short = Exemplar { height: 5, ..good.clone() };
    assert_eq!(refused(&short, &goal), "values of the exemplar: found 48 of 3 channels, expected 60");
    let empty = Exemplar::new(0, 4, 3, vec![]);
    assert_eq!(refused(&empty, &goal), "width of the exemplar: found 0 texels, expected 1 to 65536");
    let mut infinite = good.clone();
    infinite.values[7] = f32::INFINITY;
    assert_eq!(refused(&infinite, &goal), "the exemplar holds numbers that are not finite");
    assert!(by_name("weaving").err().unwrap().to_string().contains("tiling"));
}
