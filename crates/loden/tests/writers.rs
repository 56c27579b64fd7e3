//! Writers: written files read back to within their precision.

use std::f32::consts::PI;
use std::path::Path;
use std::sync::Arc;

use crate::common::chi_square::assert_sampling;
use crate::common::{Synthetic, data};
use glam::{Vec2, Vec3};
use loden::btf::{BtfSource, Cosine};
use loden::color::Encoding;
use loden::direction::{DirectionSet, from_angles};
use loden::export;
use loden::import::{self, Measured};
use loden::material::{Brdf, BrdfSample, Material, Promises};
use loden::metric;
use loden::model::Lambert;
use loden::params::{Given, Values};
use loden::progress::Silent;

fn open_brdf(path: &Path) -> Arc<dyn Brdf> {
    match import::open_named(path, &Default::default()).unwrap().1 {
        Measured::Brdf(brdf) => brdf,
        _ => panic!("a BRDF is expected"),
    }
}

/// A reciprocal brushed metal on a diffuse base.
struct Brushed {
    along: f32,
    across: f32,
}

impl Material for Brushed {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.eval(uv, wi, wo) * (PI * wi.z)
    }

    fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let h = (wi + wo).normalize();
        let slope: f32 = (h.x / h.z / self.along).powi(2) + (h.y / h.z / self.across).powi(2);
        Vec3::new(0.1, 0.08, 0.05) + Vec3::new(0.9, 0.7, 0.4) * (-slope).exp() / (PI * self.along * self.across)
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: false, isotropic: self.along == self.across }
    }
}

fn assert_close(a: &dyn Material, b: &dyn Material, tolerance: f32, what: &str) {
    let mut worst = (0.0f32, String::new());
    for i in 0..400 {
        let wi = from_angles(0.0034 * i as f32, 0.37 * i as f32);
        let wo = from_angles(1.3 - 0.0031 * i as f32, 0.37 * i as f32 + PI + 0.4 * (i as f32 * 0.7).sin());
        let (x, y) = (a.eval(Vec2::ZERO, wi, wo), b.eval(Vec2::ZERO, wi, wo));
        let error = (x - y).abs().max_element() / x.max_element().max(0.05);
        if error > worst.0 {
            worst = (error, format!("{wi} {wo}: {x} {y}"));
        }
    }
    println!("{what}: largest relative difference {:.4}", worst.0);
    assert!(worst.0 < tolerance, "{what}: {worst:?}");
}

#[test]
fn an_analytic_brdf_becomes_a_table_and_back() {
    let dir = tempfile::tempdir().unwrap();
    let isotropic = Brushed { along: 0.3, across: 0.3 };
    for (name, tolerance) in [("x.bsdf", 0.03), ("x.binary", 0.01)] {
        let path = dir.path().join(name);
        export::export_brdf(&isotropic, &[], &path, &Given::default()).unwrap();
        assert_close(&isotropic, open_brdf(&path).as_ref(), tolerance, name);
    }
    let brushed = Brushed { along: 0.5, across: 0.25 };
    let path = dir.path().join("aniso.bsdf");
    export::export_brdf(&brushed, &[], &path, &Given::default()).unwrap();
    let back = open_brdf(&path);
    assert!(!back.promises().isotropic);
    assert_close(&brushed, back.as_ref(), 0.08, "aniso.bsdf");
    assert_sampling(back.as_ref(), "aniso.bsdf");
    let samples = back.samples();
    assert!(metric::round_trip(&samples, back.as_ref()).largest_error < 1e-5);
    // a table of directions is read as isotropic
    let path = dir.path().join("x.astm");
    export::export_brdf(&isotropic, &[], &path, &Given::default()).unwrap();
    let back = open_brdf(&path);
    let found = metric::round_trip(&back.samples(), &isotropic);
    assert!(found.largest_error < 1e-4, "{found:?}");
}

#[test]
fn a_slice_shows_the_plane_across_the_plane_of_incidence() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let grey = Lambert { albedo: Vec3::splat(0.5) };
    export::export_brdf(&grey, &[], &path, &Given::default()).unwrap();
    let picture = loden::picture::Picture::read(&path, &mut Vec::new()).unwrap();
    assert_eq!((picture.width, picture.height), (90, 90));
    assert!((picture.at(0, 89).x - 0.5 / PI).abs() < 1e-6);
    assert!((picture.at(89, 0).z - 0.5 / PI).abs() < 1e-6, "both directions are above the surface all over this plane");
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn shared_brdfs_round_trip() {
    let root = data("");
    let dir = tempfile::tempdir().unwrap();
    for (name, to, limit) in [
        ("rgl_epfl/satin_rosaline_rgb.bsdf", "a.binary", 0.02),
        ("rgl_epfl/satin_rosaline_rgb.bsdf", "a.bsdf", 0.02),
        ("cornell_pbrt_v2/acryl_blue.brdf", "b.binary", 0.25),
        ("cornell_pbrt_v2/acryl_blue.brdf", "b.astm", 1e-5),
    ] {
        let source = open_brdf(&root.join(name));
        let path = dir.path().join(to);
        let samples = source.samples();
        export::export_brdf(source.as_ref(), &samples, &path, &Given::default()).unwrap();
        let found = metric::round_trip(&samples, open_brdf(&path).as_ref());
        // a reciprocal format stores the mean of both orders of the directions, which differs from each by half of the
        // asymmetry
        let exchanged: Vec<BrdfSample> = samples.iter().map(|s| BrdfSample { wi: s.wo, wo: s.wi, ..*s }).collect();
        let asymmetry = metric::round_trip(&exchanged, source.as_ref()).relative_error;
        println!("{name} -> {to}: {found:?}, asymmetry {asymmetry:.4}");
        assert!(found.relative_error < limit + 0.5 * asymmetry, "{name} -> {to}: {found:?}");
    }
}

fn write(source: &dyn BtfSource, path: &Path, to: &str, options: &Given) -> f64 {
    let exporter = export::by_name(path, Some(to)).unwrap();
    export::export_as(exporter, source, path, options, &Silent).unwrap();
    let back = import::open(path, &Default::default()).unwrap();
    assert_eq!(back.meta().views.degrees().len(), source.meta().views.len());
    let report = metric::compare(source, back.as_ref(), &Silent).unwrap();
    println!("{to} {options:?}: mean {:.6}, largest {:.5}", report.mean_abs_error, report.max_abs_error);
    report.max_abs_error
}

#[test]
fn btf_files_read_back_with_the_error_of_their_precision() {
    let dir = tempfile::tempdir().unwrap();
    let mut source = Synthetic::bonn81(5, 4);
    source.meta.views = DirectionSet::from_degrees(source.meta.views.degrees()[..7].to_vec()).unwrap();
    let path = dir.path().join("x.btf");
    // with as many components as texels, only rounding remains
    let all = Given::from([("components", "60")]);
    for color_model in ["yuv-log", "rgb-log", "rgb", "yuv", "ycocg"] {
        let half = all.clone().with("color-model", color_model);
        assert!(write(&source, &path, "dfmf", &half.clone().with("single", "yes")) < 0.002);
        assert!(write(&source, &path, "dfmf", &half) < 0.02);
    }
    assert!(write(&source, &path, "fmf", &all.clone().with("single", "yes")) < 0.002);
    assert!(write(&source, &path, "fmf", &all) < 0.02);
    // the steepest slope of the sRGB curve times 2^-12 of the value is far below a grey level
    assert!(write(&source, &path, "bdi", &Given::default()) < 0.001);
    let few = Given::from([("components", "2")]);
    let many = Given::from([("components", "10")]);
    assert!(write(&source, &path, "dfmf", &few) > write(&source, &path, "dfmf", &many));
    let exr = Given::from([("exr", "yes")]);
    assert!(write(&source, &dir.path().join("exr"), "ubo2003", &exr) < 0.001);
}

#[test]
fn conventions_survive_a_btf_file() {
    let dir = tempfile::tempdir().unwrap();
    let mut source = Synthetic::bonn81(3, 3);
    source.meta.cosine = Cosine::Excluded;
    source.meta.encoding = Encoding::Gamma(2.2);
    let path = dir.path().join("x.btf");
    write(&source, &path, "bdi", &Default::default());
    let back = import::open(&path, &Default::default()).unwrap();
    assert_eq!((back.meta().cosine, back.meta().encoding), (Cosine::Excluded, Encoding::Linear));
    assert_eq!(back.meta().views.name(), Some("bonn81"));
    assert_eq!(back.meta().lights.name(), Some("bonn81"));
}

#[test]
fn a_view_that_is_missing_is_an_error_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let source = Synthetic::bonn81(2, 2);
    for to in ["dfmf", "fmf", "bdi"] {
        let path = dir.path().join("x.btf");
        let exporter = export::by_name(&path, Some(to)).unwrap();
        let mut writer = exporter.create(&path, &source.meta, &Values::defaults(exporter.params())).unwrap();
        writer.view(&source.view(0).unwrap()).unwrap();
        let error = writer.finish().unwrap_err().to_string();
        assert!(error.contains("views: found 1, expected 81"), "{error}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}
