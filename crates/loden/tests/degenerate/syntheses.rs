//! Syntheses of degenerate materials.

use loden::btf::BtfSource;
use loden::params::Values;
use loden::progress::Silent;
use loden::synth::{Exemplar, Goal, Relief, SYNTHESES, synthesize};

use super::family::{Member, finite, names_its_cause, not_finite};

#[test]
fn every_synthesis_fills_a_result_from_every_member() {
    for Member { name, btf } in finite() {
        let appearance = Exemplar::of_btf(&btf, 4, &Silent).unwrap();
        let mut exemplars = vec![("appearance", appearance)];
        match Relief::of_btf(&btf, &Silent) {
            Ok(relief) => exemplars.push(("height", Exemplar::of_relief(&relief))),
            Err(error) => assert!(names_its_cause(&error), "{name}: {error:?}"),
        }
        let meta = btf.meta();
        for (what, exemplar) in exemplars {
            assert!(exemplar.values.iter().all(|v| v.is_finite()), "{name}, {what}");
            for method in SYNTHESES {
                let what = format!("{name} by {} of {what}", method.name());
                let goal = Goal::new(9, 7);
                let params = Values::defaults(method.params());
                let map = synthesize(*method, &exemplar, &goal, &params, &Silent);
                let map = map.unwrap_or_else(|error| panic!("{what}: {error}"));
                assert_eq!(map.sources.len(), 63, "{what}");
                let inside = |s: &loden::synth::Source| usize::from(s.x) < meta.width && usize::from(s.y) < meta.height;
                assert!(map.sources.iter().all(inside), "{what}");
            }
        }
    }
}

#[test]
fn no_synthesis_begins_with_what_is_not_finite() {
    for Member { name, btf } in not_finite() {
        match Exemplar::of_btf(&btf, 4, &Silent) {
            Err(error) => assert!(names_its_cause(&error), "{name}: {error:?}"),
            // the value may be in an image that is not looked at
            Ok(exemplar) => assert!(exemplar.values.iter().all(|v| v.is_finite()), "{name}"),
        }
    }
}
