//! New materials against the goniometer's: the same height field measured with another albedo or reflectance is the truth.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use loden::acquire::{Finish, HeightField, Options, measure};
use loden::btf::{BtfSource, MemoryBtf};
use loden::codec::parts::{MemoryParts, Parts};
use loden::codec::{self, CompressedBtf, Decoded};
use loden::direction::DirectionSet;
use loden::generate::{
    self, Edit, Keep, Match, Matching, Recolor, Rows, Selection, reflectance::Geometry, reflectance::Separated,
};
use loden::metric;
use loden::params::Values;
use loden::progress::Silent;

const GRID: usize = 64;
const SIZE: usize = 16;

/// 25 directions up to 60 degrees.
fn directions() -> DirectionSet {
    let mut degrees = vec![[0.0, 0.0]];
    for (theta, count) in [(20.0, 6), (40.0, 8), (60.0, 10)] {
        degrees.extend((0..count).map(|k| [theta, 360.0 * f64::from(k) / f64::from(count)]));
    }
    DirectionSet::from_degrees(degrees).unwrap()
}

#[derive(Clone, Copy)]
enum Relief {
    Bumps,
    Grooves,
    Flat,
}

impl Relief {
    fn height(self, x: f32, y: f32) -> f32 {
        let wave = |t: f32| (std::f32::consts::TAU * t).sin();
        match self {
            Self::Bumps => 0.05 * wave(2.0 * x) * wave(2.0 * y) + 0.015 * wave(3.0 * x + 5.0 * y),
            Self::Grooves => 0.04 * wave(3.0 * x) + 0.01 * wave(2.0 * y),
            Self::Flat => 0.0,
        }
    }
}

fn measured(relief: Relief, finish: impl Fn(f32, f32) -> Finish + Sync) -> MemoryBtf {
    measured_at(&directions(), 64, relief, finish)
}

fn measured_at(at: &DirectionSet, spp: u32, relief: Relief, finish: impl Fn(f32, f32) -> Finish + Sync) -> MemoryBtf {
    let field = HeightField::from_fn(GRID, |x, y| (relief.height(x, y), finish(x, y))).unwrap();
    let options = Options { size: SIZE, spp, depth: 4, seed: 1 };
    measure(&field, at, &options, &Silent).unwrap()
}

/// A compressed material, and the folder that holds its file.
struct Compressed {
    btf: Arc<CompressedBtf>,
    _folder: tempfile::TempDir,
}

fn compressed(source: &dyn BtfSource, method: &str, given: &[(&str, &str)]) -> Compressed {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let codec = codec::by_name(method).unwrap();
    codec.encode(source, &Values::new(codec.params(), given.iter().copied()).unwrap(), &path, &Silent).unwrap();
    Compressed { btf: codec::open(&path).unwrap(), _folder: folder }
}

fn rows(compressed: &Compressed) -> Rows {
    Rows::new(compressed.btf.parts().clone()).unwrap().unwrap()
}

/// A row for each texel, so that only the edit is wrong.
fn fine(source: &MemoryBtf) -> Compressed {
    compressed(source, "kmeans", &[("clusters", "256"), ("precision", "f16"), ("dimensions", "64")])
}

fn error(truth: &MemoryBtf, parts: MemoryParts) -> f64 {
    metric::compare(truth, &Decoded::new(Arc::new(parts)).unwrap(), &Silent).unwrap().mean_abs_error
}

/// The mean error of multiplying all values by a colour.
fn multiplied(truth: &MemoryBtf, rows: &Rows, ratio: Vec3) -> f64 {
    let edit = Edit { tint: ratio.to_array(), ..Edit::default() };
    error(truth, generate::edit(rows, &Selection::All, &edit).unwrap())
}

const YELLOW: Vec3 = Vec3::new(0.6, 0.42, 0.05);
const RED: Vec3 = Vec3::new(0.55, 0.06, 0.05);
const GREY: Vec3 = Vec3::new(0.3, 0.3, 0.3);

#[test]
fn highlights_keep_their_colour() {
    for (relief, f0, roughness) in
        [(Relief::Bumps, 0.05, 0.25), (Relief::Grooves, 0.06, 0.35), (Relief::Flat, 0.04, 0.3)]
    {
        let [old, truth] = [YELLOW, RED].map(|albedo| measured(relief, |_, _| Finish::coated(albedo, f0, roughness)));
        let compressed = fine(&old);
        let rows = rows(&compressed);
        let edit =
            Edit { recolor: Some(Recolor::Ratio { from: YELLOW.to_array(), to: RED.to_array() }), ..Edit::default() };
        let ours = error(&truth, generate::edit(&rows, &Selection::All, &edit).unwrap());
        let plain = multiplied(&truth, &rows, RED / YELLOW);
        println!("recolour f0 {f0} roughness {roughness}: {ours:.4}, by the ratio {plain:.4}");
        assert!(ours <= 0.5 * plain, "{ours} {plain}");
    }
}

#[test]
fn gloss_goes_towards_the_truth() {
    // with 64 paths, two measurements of the bumps differ as much as two roughnesses
    for (relief, spp, part) in [(Relief::Flat, 64, 0.25), (Relief::Bumps, 512, 0.75)] {
        for (old, new) in [(0.35, 0.25), (0.25, 0.4)] {
            let [source, truth] = [old, new].map(|roughness| {
                measured_at(&directions(), spp, relief, |_, _| Finish::coated(YELLOW, 0.05, roughness))
            });
            let compressed = fine(&source);
            let rows = rows(&compressed);
            let edit = Edit { gloss: old / new, ..Edit::default() };
            let ours = error(&truth, generate::edit(&rows, &Selection::All, &edit).unwrap());
            let none = error(&truth, generate::edit(&rows, &Selection::All, &Edit::default()).unwrap());
            println!("gloss {old} to {new}: {ours:.4}, unedited {none:.4}");
            assert!(ours <= part * none, "{ours} {none}");
        }
    }
}

#[test]
fn kept_shading_is_nearer_to_the_truth_than_plain_exchange() {
    let matt = |albedo: Vec3| move |_: f32, _: f32| Finish::matt(albedo);
    let coated = |albedo: Vec3, f0: f32, roughness: f32| move |_: f32, _: f32| Finish::coated(albedo, f0, roughness);
    let pairs = [
        (Relief::Bumps, Relief::Grooves, measured(Relief::Bumps, matt(GREY)), measured(Relief::Grooves, matt(RED))),
        (
            Relief::Grooves,
            Relief::Bumps,
            measured(Relief::Grooves, coated(YELLOW, 0.05, 0.3)),
            measured(Relief::Bumps, coated(RED, 0.05, 0.4)),
        ),
        (
            Relief::Bumps,
            Relief::Flat,
            measured(Relief::Bumps, matt(YELLOW)),
            measured(Relief::Flat, coated(RED, 0.05, 0.3)),
        ),
    ];
    let truths = [
        measured(Relief::Bumps, matt(RED)),
        measured(Relief::Grooves, coated(RED, 0.05, 0.4)),
        measured(Relief::Bumps, coated(RED, 0.05, 0.3)),
    ];
    for ((_, _, structure, reflectance), truth) in pairs.iter().zip(&truths) {
        let (a, b) = (fine(structure), fine(reflectance));
        let (a, b) = (rows(&a), rows(&b));
        let matching = Matching::new(&a, &b, Match::Transport, None).unwrap();
        let [kept, plain] = [Keep::Shading, Keep::Nothing]
            .map(|keep| error(truth, generate::exchange(&a, &b, &matching, keep).unwrap()));
        println!("kept shading {kept:.4}, plain exchange {plain:.4}");
        assert!(kept <= 0.5 * plain, "{kept} {plain}");
    }
}

#[test]
fn parts_add_up_and_are_not_negative() {
    let source = measured(Relief::Bumps, |_, _| Finish::coated(YELLOW, 0.05, 0.3));
    let (compressed, geometry) = (fine(&source), Geometry::new(source.meta()));
    let rows = rows(&compressed);
    for row in (0..rows.count()).step_by(17) {
        let values = rows.values(row);
        let parts = Separated::new(&geometry, &values);
        for ((value, diffuse), h) in values.iter().zip(&parts.diffuse).zip(&parts.specular) {
            assert!((*value - (*diffuse + *h)).abs().max_element() < 1e-5 && *h >= 0.0);
            assert!(diffuse.min_element() >= value.min_element().min(0.0));
        }
    }
    // a matt material has hardly a highlight
    let matt = fine(&measured(Relief::Bumps, |_, _| Finish::matt(YELLOW)));
    let matt = self::rows(&matt);
    let share = |rows: &Rows| {
        let parts = (0..rows.count()).map(|row| Separated::new(&geometry, &rows.values(row)));
        let sums = parts.map(|p| (p.specular.iter().sum::<f32>(), p.diffuse.iter().map(|d| d.y).sum::<f32>()));
        let (s, d) = sums.fold((0.0, 0.0), |(a, b), (s, d)| (a + s, b + d));
        s / (s + d)
    };
    let (none, some) = (share(&matt), share(&rows));
    println!("share of highlights: matt {none:.3}, coated {some:.3}");
    assert!(none < 0.03 && some > 2.0 * none, "{none} {some}");
}

#[test]
fn edits_by_zero_and_exchanges_with_oneself_are_the_identity() {
    let source =
        measured(Relief::Grooves, |x, _| if x < 0.5 { Finish::matt(GREY) } else { Finish::coated(RED, 0.05, 0.3) });
    for (method, given) in [
        ("kmeans", &[("clusters", "20")][..]),
        ("median-cut", &[("clusters", "20"), ("precision", "f16")]),
        ("tsvq", &[("clusters", "20"), ("precision", "f32")]),
    ] {
        let compressed = compressed(&source, method, given);
        let rows = rows(&compressed);
        let same = MemoryParts::copy(&**compressed.btf.parts()).unwrap();
        let turn = Recolor::Turn { hue: 0.0, saturation: 1.0, lightness: 0.0 };
        let zero = Edit { recolor: Some(turn), ..Edit::default() };
        assert!(generate::edit(&rows, &Selection::Rows(vec![1, 3]), &zero).unwrap() == same, "{method}");
        for (by, keep) in Match::ALL.iter().flat_map(|by| Keep::ALL.iter().map(move |keep| (*by, *keep))) {
            let matching = Matching::new(&rows, &rows, by, None).unwrap();
            let found = generate::exchange(&rows, &rows, &matching, keep).unwrap();
            assert!(found == same, "{method} {by} {keep}");
        }
        // rows that were not chosen keep their numbers
        let edit = Edit { exposure: -1.0, ..Edit::default() };
        let edited = Arc::new(generate::edit(&rows, &Selection::Rows(vec![2]), &edit).unwrap());
        let edited = Rows::new(edited).unwrap().unwrap();
        for row in 0..rows.count() {
            assert_eq!(edited.values(row) == rows.values(row), row != 2, "{method} {row}");
        }
        let (before, after) = (rows.values(2), edited.values(2));
        let off = before.iter().zip(&after).map(|(a, b)| (*a * 0.5 - *b).abs().max_element());
        assert!(off.fold(0.0, f32::max) < 0.01);
    }
}

#[test]
fn patterns_are_matched_with_more_and_fewer_rows() {
    let two = |x: f32| if x < 0.5 { YELLOW } else { GREY };
    let a = measured(Relief::Flat, |x, _| Finish::matt(two(x)));
    let b = measured(Relief::Flat, |_, y| Finish::matt(if y < 0.5 { 0.9 * YELLOW } else { 0.8 * GREY }));
    for (n, m) in [("2", "9"), ("9", "2"), ("5", "5")] {
        let (a, b) = (compressed(&a, "kmeans", &[("clusters", n)]), compressed(&b, "kmeans", &[("clusters", m)]));
        let (from, to) = (rows(&a), rows(&b));
        for by in Match::ALL {
            let matching = Matching::new(&from, &to, *by, None).unwrap();
            let parts = generate::exchange(&from, &to, &matching, Keep::Nothing).unwrap();
            assert_eq!((parts.meta().width, matching.rows.len()), (SIZE, from.count()));
            if *by == Match::Transport {
                // the yellow half stays yellow, the grey half grey
                let mut image = vec![0.0; parts.meta().image_len()];
                Decoded::new(Arc::new(parts)).unwrap().decode(0, 0..1, &mut image).unwrap();
                let blue = |x: usize| image[3 * (SIZE * 5 + x) + 2] / image[3 * (SIZE * 5 + x)];
                assert!(blue(3) < 0.3 && blue(12) > 0.8, "{n} {m}: {} {}", blue(3), blue(12));
            }
        }
        let soft = Matching::new(&from, &to, Match::Transport, Some(0.5)).unwrap();
        assert_eq!(soft.rows.len(), from.count());
    }
}

#[test]
fn rows_are_split_as_the_plan_says() {
    let a = measured(Relief::Bumps, |x, _| Finish::matt(if x < 0.5 { YELLOW } else { GREY }));
    let b = measured(Relief::Grooves, |_, y| Finish::matt(if y < 0.25 { 0.9 * YELLOW } else { 0.8 * GREY }));
    for (n, m) in [("2", "9"), ("9", "2"), ("1", "7")] {
        let (a, b) = (compressed(&a, "kmeans", &[("clusters", n)]), compressed(&b, "kmeans", &[("clusters", m)]));
        let (from, to) = (rows(&a), rows(&b));
        let matching = Matching::split(&from, &to, None).unwrap();
        assert!(matching.shares.iter().all(|shares| (shares.iter().map(|s| s.1).sum::<f64>() - 1.0).abs() < 1e-9));
        // both have as many texels, so each row occurs as often as in its own material
        let parts = generate::exchange(&from, &to, &matching, Keep::Nothing).unwrap();
        let made = Rows::new(Arc::new(parts)).unwrap().unwrap();
        let off = made.populations().iter().zip(to.populations()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off <= 1.0, "{n} {m}: {off}");
        assert_eq!(matching.used().len(), to.count());
        // with its shading kept, a row becomes one for each that takes its place
        let parts = generate::exchange(&from, &to, &matching, Keep::Shading).unwrap();
        let made = Rows::new(Arc::new(parts)).unwrap().unwrap();
        assert_eq!(made.count(), matching.shares.iter().map(Vec::len).sum::<usize>());
        let same = Matching::split(&from, &from, None).unwrap();
        let parts = generate::exchange(&from, &from, &same, Keep::Nothing).unwrap();
        assert!(parts == MemoryParts::copy(&**from.parts()).unwrap());
    }
}

#[test]
fn materials_of_other_directions_are_interpolated_and_the_loss_is_said() {
    let finish = |albedo: Vec3, roughness: f32| move |_: f32, _: f32| Finish::coated(albedo, 0.05, roughness);
    let a = measured(Relief::Flat, finish(YELLOW, 0.5));
    let other = |albedo: Vec3, roughness: f32| {
        let mut degrees = vec![[0.0, 0.0]];
        for (theta, count) in [(14.0, 6), (29.0, 12), (45.0, 16), (62.0, 20)] {
            degrees.extend((0..count).map(|k| [theta, 7.0 + 360.0 * f64::from(k) / f64::from(count)]));
        }
        let set = DirectionSet::from_degrees(degrees).unwrap();
        measured_at(&set, 64, Relief::Flat, finish(albedo, roughness))
    };
    let few = [("clusters", "3"), ("precision", "f16")];
    let from = compressed(&a, "kmeans", &few);
    let from = rows(&from);
    let loss = |b: &MemoryBtf| {
        let b = compressed(b, "kmeans", &few);
        let to = rows(&b);
        let matching = Matching::new(&from, &to, Match::Transport, None).unwrap();
        let mixed = generate::blend(&from, &to, &matching, 0.5, None).unwrap();
        assert_eq!(mixed.meta().views, from.meta().views);
        (generate::resampling_error(&to, from.meta()).unwrap(), mixed)
    };
    let ((wide, mixed), (narrow, _)) = (loss(&other(RED, 0.5)), loss(&other(RED, 0.1)));
    println!("interpolated at other directions and back: roughness 0.5 {wide:.4}, 0.1 {narrow:.4}");
    assert!(0.0 < wide && wide < 0.02 && narrow > wide, "{wide} {narrow}");
    // what was measured at the directions of the first gives the same mixture, up to that loss
    let direct = measured(Relief::Flat, finish(RED, 0.5));
    let direct = compressed(&direct, "kmeans", &few);
    let to = rows(&direct);
    let matching = Matching::new(&from, &to, Match::Transport, None).unwrap();
    let expected = Decoded::new(Arc::new(generate::blend(&from, &to, &matching, 0.5, None).unwrap())).unwrap();
    let off = metric::compare(&expected, &Decoded::new(Arc::new(mixed)).unwrap(), &Silent).unwrap().mean_abs_error;
    assert!(off < 0.5 * wide + 0.005, "{off}");
}

#[test]
fn masks_split_rows_and_wrong_choices_are_named() {
    let source = measured(Relief::Flat, |x, _| Finish::matt(if x < 0.5 { YELLOW } else { GREY }));
    let compressed = compressed(&source, "kmeans", &[("clusters", "2")]);
    let rows = rows(&compressed);
    let edit = Edit { exposure: -1.0, ..Edit::default() };
    let mask: Vec<bool> = (0..SIZE * SIZE).map(|texel| texel / SIZE < 4).collect();
    let parts = generate::edit(&rows, &Selection::Mask(mask), &edit).unwrap();
    let edited = Rows::new(Arc::new(parts)).unwrap().unwrap();
    assert_eq!((rows.count(), edited.count()), (2, 4));
    assert!((0..SIZE * SIZE).all(|texel| (edited.index()[texel] >= 2) == (texel / SIZE < 4)));
    let grown = Selection::Grow { x: 2, y: 3, radius: 10.0 };
    let parts = generate::edit(&rows, &grown, &edit).unwrap();
    let edited = Rows::new(Arc::new(parts)).unwrap().unwrap();
    assert_eq!(edited.count(), 2, "half of the texels are connected, and have one row");
    let near = Selection::Colors { center: YELLOW, radius: 30.0 };
    assert!(generate::edit(&rows, &near, &edit).is_ok());
    let problem = |on: Selection, edit: &Edit| generate::edit(&rows, &on, edit).unwrap_err().to_string();
    assert_eq!(problem(Selection::Rows(vec![1, 2]), &edit), "rows: found 2, expected less than 2");
    assert_eq!(problem(Selection::Mask(vec![true; 3]), &edit), "mask: found 3 texels, expected 256");
    assert_eq!(problem(Selection::Mask(vec![false; 256]), &edit), "mask: chooses no texel");
    assert!(problem(Selection::Grow { x: 16, y: 0, radius: 1.0 }, &edit).starts_with("grow: found texel 16,0"));
    assert_eq!(problem(Selection::All, &Edit { gloss: 0.0, ..edit }), "gloss: found 0, expected 0.05 to 20");
    assert!("hue=4,from=000000".parse::<Recolor>().is_err() && "huh=4".parse::<Recolor>().is_err());
    // values above those of 8 bits make the block one of half precision
    let bright = Edit { exposure: 4.0, ..Edit::default() };
    let parts = generate::edit(&rows, &Selection::All, &bright).unwrap();
    assert_eq!(parts.recipe().tables.len(), 1);
}

#[test]
fn a_constant_material_stays_constant_and_threads_do_not_matter() {
    let source = measured(Relief::Bumps, |_, _| Finish::coated(YELLOW, 0.05, 0.3));
    let compressed = fine(&source);
    let rows = rows(&compressed);
    let recolor = Some(Recolor::Turn { hue: 120.0, saturation: 0.7, lightness: 10.0 });
    let edit = Edit { recolor, gloss: 1.5, contrast: 0.5, desaturate: 0.2, ..Edit::default() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| generate::edit(&rows, &Selection::All, &edit).unwrap())
    };
    assert!(with(1) == with(2));
    let flat = fine(&measured(Relief::Flat, |_, _| Finish::matt(YELLOW)));
    let flat = self::rows(&flat);
    let geometry = Geometry::new(flat.meta());
    let first = generate::edited_row(&geometry, &flat.values(0), &edit);
    for row in 1..flat.count() {
        let row = generate::edited_row(&geometry, &flat.values(row), &edit);
        let most = first.iter().zip(&row).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max);
        assert!(most < 0.06, "{most}");
    }
    assert!(Path::new(&compressed.btf.path()).exists());
}

#[test]
fn blends_end_at_both_materials_and_highlights_move() {
    let [a, b] = [(YELLOW, 0.2), (RED, 0.45)]
        .map(|(albedo, roughness)| measured(Relief::Flat, |_, _| Finish::coated(albedo, 0.05, roughness)));
    let (first, second) =
        (compressed(&a, "kmeans", &[("clusters", "4")]), compressed(&b, "kmeans", &[("clusters", "4")]));
    let (from, to) = (rows(&first), rows(&second));
    let matching = Matching::new(&from, &to, Match::Transport, None).unwrap();
    let mixed = |amount: f32, mask: Option<&[f32]>| generate::blend(&from, &to, &matching, amount, mask).unwrap();
    assert!(mixed(0.0, None) == MemoryParts::copy(&**first.btf.parts()).unwrap());
    assert!(mixed(1.0, None) == generate::exchange(&from, &to, &matching, Keep::Nothing).unwrap());
    // between both roughnesses lies one highlight of the mean width
    let half = Rows::new(Arc::new(mixed(0.5, None))).unwrap().unwrap();
    let geometry = Geometry::new(a.meta());
    let fit = Separated::new(&geometry, &half.values(0)).fit;
    let ends = [from.values(0), to.values(matching.rows[0])].map(|v| Separated::new(&geometry, &v).fit.alpha);
    assert!((fit.alpha / (ends[0] * ends[1]).sqrt() - 1.0).abs() < 0.15, "{} {ends:?}", fit.alpha);
    // a mask of one amount does the same, to half precision
    let masked = Decoded::new(Arc::new(mixed(1.0, Some(&[0.5; SIZE * SIZE])))).unwrap();
    let whole = Decoded::new(Arc::new(mixed(0.5, None))).unwrap();
    assert!(metric::compare(&masked, &whole, &Silent).unwrap().max_abs_error < 0.01);
    let problem = generate::blend(&from, &to, &matching, 0.5, Some(&[0.0; 3])).unwrap_err().to_string();
    assert_eq!(problem, "mask: found 3 texels, expected 256");
    assert_eq!(generate::resampling_error(&to, from.meta()).unwrap(), 0.0);
}

#[test]
fn families_are_spread_evenly_and_depend_on_the_seed() {
    let count = 12;
    let edits = generate::family(count, 3, 1.0).unwrap();
    edits.iter().for_each(|edit| edit.check().unwrap());
    let stratum = |edit: &Edit| ((edit.gloss.ln() / 1.6f32.ln() + 1.0) / 2.0 * count as f32) as usize;
    let strata: std::collections::BTreeSet<usize> = edits.iter().map(|edit| stratum(edit).min(count - 1)).collect();
    // rounding may move a number into the next stratum
    assert!(strata.len() >= count - 2, "{strata:?}");
    assert_eq!(edits, generate::family(count, 3, 1.0).unwrap());
    assert_ne!(edits, generate::family(count, 4, 1.0).unwrap());
    assert!(generate::family(count, 3, 0.0).unwrap().iter().all(Edit::is_neutral));
    let problem = |count: usize, spread: f32| generate::family(count, 0, spread).unwrap_err().to_string();
    assert_eq!(problem(0, 1.0), "count: found 0, expected 1 to 999");
    assert_eq!(problem(1, f32::NAN), "spread: found NaN, expected 0 to 2");
}
