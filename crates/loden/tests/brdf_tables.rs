//! Physics of every kind of tabulated BRDF: values, promises, sampling.

use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::sync::{Arc, LazyLock};

use crate::common::chi_square::{Random, assert_sampling, integrate, views};
use crate::common::data;
use glam::{Quat, Vec2, Vec3};
use loden::btf::{BtfMeta, Cosine, SampleType};
use loden::color::Encoding;
use loden::direction::{DirectionSet, HalfDifference, Scheme, from_angles};
use loden::import::{self, Measured};
use loden::material::{
    Azimuths, BrdfSample, HalfTable, InOutTable, Material, Notes, Period, Point, RglBrdf, RglData, Sample, Scattered,
    Table, Tabulated, TabulatedBrdf,
};
use loden::model::Lambert;
use loden::model::{self, Analytic};
use loden::params::Values;
use loden::progress::Silent;
use loden::separable::FACTORISATIONS;

type Kinds = Vec<(String, Arc<dyn Material>)>;

/// Glossy, isotropic and reciprocal.
fn glossy() -> Analytic {
    analytic("ward", &[("alpha-x", "0.2"), ("alpha-y", "0.2"), ("kd", "0.2,0.1,0.05"), ("ks", "0.3")])
}

/// Brushed, hence anisotropic.
fn brushed() -> Analytic {
    analytic("ward", &[("alpha-x", "0.25"), ("alpha-y", "0.6"), ("kd", "0.1,0.2,0.3"), ("ks", "0.4")])
}

fn analytic(name: &str, given: &[(&str, &str)]) -> Analytic {
    let model = model::by_name(name).unwrap();
    Analytic::new(model, Values::new(model.params(), given.iter().copied()).unwrap()).unwrap()
}

fn half_table(brdf: &dyn Material, period: Period) -> HalfTable {
    let steps =
        |count: usize, most: f32| (0..count).map(|i| (i as f32 + 0.5) / count as f32 * most).collect::<Vec<_>>();
    let theta_h: Vec<f32> = steps(45, 1.0).iter().map(|x| x * x * FRAC_PI_2).collect();
    let theta_d = steps(30, FRAC_PI_2);
    let phi_d = if period == Period::Half { steps(36, PI) } else { steps(72, TAU) };
    let mut values = Vec::new();
    for &h in &theta_h {
        for &d in &theta_d {
            for &p in &phi_d {
                let (wi, wo) = HalfDifference { wh: from_angles(h, 0.0), wd: from_angles(d, p) }.directions();
                let seen = wi.z > 0.0 && wo.z > 0.0;
                values.push(if seen { brdf.eval(Vec2::ZERO, wi, wo) } else { Vec3::NAN });
            }
        }
    }
    HalfTable::new([theta_h, theta_d, phi_d], period, values).unwrap()
}

fn in_out_table(brdf: &dyn Material, view_is_relative: bool) -> InOutTable {
    let thetas: Vec<f32> = (0..12).map(|i| i as f32 * 7.5f32.to_radians()).collect();
    let (light, view) = (12, 36);
    let mut values = Vec::new();
    for &ti in &thetas {
        for pi in 0..light {
            for &to in &thetas {
                for po in 0..view {
                    let (phi_i, phi_o) = (pi as f32 / light as f32 * TAU, po as f32 / view as f32 * TAU);
                    let base = if view_is_relative { phi_i } else { 0.0 };
                    values.push(brdf.eval(Vec2::ZERO, from_angles(ti, phi_i), from_angles(to, phi_o + base)));
                }
            }
        }
    }
    InOutTable::new(thetas.clone(), thetas, Azimuths { light, view, first: 0.0, view_is_relative }, values).unwrap()
}

fn scattered(brdf: &dyn Material) -> Scattered {
    let mut random = Random(9);
    let mut direction = || from_angles(random.unit().acos().min(1.5), TAU * random.unit());
    let sample = |_| {
        let (wi, wo) = (direction(), direction());
        BrdfSample { wi, wo, value: brdf.eval(Vec2::ZERO, wi, wo) }
    };
    Scattered::new((0..1500).map(sample).collect()).unwrap()
}

fn over_directions(brdf: &dyn Material, scheme: Scheme) -> TabulatedBrdf {
    let meta = BtfMeta {
        width: 1,
        height: 1,
        views: DirectionSet::bonn81(),
        lights: DirectionSet::bonn81(),
        encoding: Encoding::Linear,
        cosine: Cosine::Included,
        sample_type: SampleType::F32,
    };
    let pairs = meta.views.directions().iter().flat_map(|&wo| meta.lights.directions().iter().map(move |&wi| (wi, wo)));
    let table = pairs.map(|(wi, wo)| brdf.apparent(Vec2::ZERO, wi, wo)).collect();
    TabulatedBrdf::new(&meta, table, scheme).unwrap()
}

fn material<T: Table + 'static>(table: T) -> Arc<dyn Material> {
    Arc::new(Tabulated::new(table, Notes::default()))
}

fn rgl(brdf: &dyn Material) -> Arc<dyn Material> {
    Arc::new(RglBrdf::new(RglData::tabulate(brdf), Notes::default()).unwrap())
}

/// Every kind of table, for a glossy and a brushed material.
static TABLES: LazyLock<Kinds> = LazyLock::new(|| {
    let (glossy, brushed) = (glossy(), brushed());
    let mut kinds: Kinds = vec![
        ("half angles, half a turn".into(), material(half_table(&glossy, Period::Half))),
        ("half angles, a turn".into(), material(half_table(&glossy, Period::Full))),
        ("light and view".into(), material(in_out_table(&brushed, false))),
        ("light and view from the light".into(), material(in_out_table(&brushed, true))),
        ("scattered".into(), material(scattered(&glossy))),
        ("rgl".into(), rgl(&glossy)),
        ("rgl with a grain".into(), rgl(&brushed)),
    ];
    for scheme in [Scheme::Triangles, Scheme::Rings] {
        kinds.push((format!("pairs of directions, {scheme:?}"), Arc::new(over_directions(&brushed, scheme))));
    }
    for method in FACTORISATIONS {
        let factored = method.factor(&glossy, &Values::defaults(method.params()), &Silent).unwrap();
        kinds.push((format!("factorisation {}", method.name()), Arc::new(factored)));
    }
    kinds
});

/// Files of the reference measurements, one of each kind and source.
fn files() -> Kinds {
    let folder = data("");
    let names = [
        "rgl_epfl/satin_rosaline_rgb.bsdf",
        "rgl_epfl/vch_golden_yellow_rgb.bsdf",
        "cornell_pbrt_v2/mystique.brdf",
        "curet/abrdf.dat",
    ];
    let open = |name: &str| match import::open_named(folder.join(name), &Default::default()).unwrap().1.images() {
        Err(brdf) => brdf as Arc<dyn Material>,
        Ok(btf) => Arc::new(TabulatedBrdf::average(btf.as_ref(), Scheme::Triangles, &Silent).unwrap()),
    };
    names.into_iter().chain(["btf/twill.zip"]).map(|name| (name.into(), open(name))).collect()
}

/// Checks that values are finite and non-negative, zero below the surface, and keep the promises of the material.
fn assert_values(name: &str, brdf: &dyn Material) {
    let promises = brdf.promises();
    let mut random = Random(3);
    let mut direction = || from_angles(random.unit().acos().min(1.56), TAU * random.unit());
    for i in 0..20_000 {
        let (wi, wo) = (direction(), direction());
        let at = |wi: Vec3, wo: Vec3| brdf.eval(Vec2::ZERO, wi, wo);
        let value = at(wi, wo);
        assert!(value.is_finite() && value.min_element() >= 0.0, "{name}: {value} at {wi} {wo}");
        // the rounding of angles is visible in steep lobes
        let close = |other: Vec3| (other - value).abs().max_element() <= 0.01 * (0.1 + value.max_element());
        assert!(!promises.reciprocal || close(at(wo, wi)), "{name}: {value}, exchanged {}", at(wo, wi));
        let turn = Quat::from_rotation_z(0.001 * i as f32);
        assert!(!promises.isotropic || close(at(turn * wi, turn * wo)), "{name}: turned at {wi} {wo}");
        for below in [Vec3::new(wi.x, wi.y, -wi.z), Vec3::NAN] {
            assert_eq!([at(below, wo), at(wo, below)], [Vec3::ZERO; 2], "{name}");
            assert_eq!(brdf.pdf(Vec2::ZERO, below, wo), 0.0, "{name}");
        }
    }
}

/// Checks that the mean of f cos / pdf over samples is the integral of f cos.
fn assert_albedo(name: &str, brdf: &dyn Material) {
    for wo in views() {
        let expected: f64 = integrate(&|wi| brdf.eval(Vec2::ZERO, wi, wo).y * wi.z).iter().sum();
        let mut random = Random(5);
        let (mut sum, mut squares, count) = (0.0, 0.0, 40_000);
        for _ in 0..count {
            let drawn = brdf.sample(Vec2::ZERO, wo, Vec2::new(random.unit(), random.unit()));
            let weight = drawn.map_or(0.0, |s| {
                let weight = f64::from(brdf.eval(Vec2::ZERO, s.wi, wo).y * s.wi.z / s.pdf);
                // apparent / (pi pdf) is the same weight, where the cosine is above 0.01
                let other = f64::from(brdf.apparent(Vec2::ZERO, s.wi, wo).y / (PI * s.pdf));
                assert!(s.wi.z < 0.01 || (weight - other).abs() <= 1e-3 * (1e-3 + weight), "{name}: {weight} {other}");
                weight
            });
            sum += weight;
            squares += weight * weight;
        }
        let mean = sum / f64::from(count);
        let error = ((squares / f64::from(count) - mean * mean).max(0.0) / f64::from(count)).sqrt();
        println!("{name}: from {wo}: {mean:.4} +- {error:.4}, integral {expected:.4}");
        assert!((mean - expected).abs() <= 4.5 * error + 5e-3 * expected, "{name}: from {wo}");
    }
}

#[test]
fn every_table_keeps_its_promises() {
    for (name, brdf) in TABLES.iter() {
        assert_values(name, brdf.as_ref());
    }
}

#[test]
fn every_table_is_sampled_by_its_density() {
    for (name, brdf) in TABLES.iter() {
        assert_sampling(brdf.as_ref(), name);
    }
}

/// A wrong density, computed from the right one, the light and the viewer.
type Density = fn(&dyn Material, Vec3, Vec3) -> f32;

/// A material with a wrong density that is consistent between its methods.
struct Mistaken {
    brdf: Arc<dyn Material>,
    pdf: Density,
}

impl Material for Mistaken {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.brdf.apparent(uv, wi, wo)
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        let Sample { wi, .. } = self.brdf.sample(uv, wo, random)?;
        Some(Sample { wi, pdf: self.pdf(uv, wi, wo) })
    }

    fn pdf(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        (self.pdf)(self.brdf.as_ref(), wi, wo)
    }
}

#[test]
fn mistakes_of_a_density_are_found_in_every_table() {
    for (name, brdf) in TABLES.iter() {
        assert_mistakes_are_found(name, brdf);
    }
}

fn assert_mistakes_are_found(name: &str, brdf: &Arc<dyn Material>) {
    let swapped = |brdf: &dyn Material, wi, wo| brdf.pdf(Vec2::ZERO, wo, wi);
    // 1 / (4 wo.z) for 1 / (4 wo.h), where half vectors become directions
    let jacobian = |brdf: &dyn Material, wi: Vec3, wo: Vec3| {
        brdf.pdf(Vec2::ZERO, wi, wo) * wo.dot((wi + wo).normalize_or(Vec3::Z)) / wo.z
    };
    let cosine = |brdf: &dyn Material, wi: Vec3, wo: Vec3| brdf.pdf(Vec2::ZERO, wi, wo) * wi.z;
    let mistakes: [(&str, Density); 3] = [("swapped", swapped), ("jacobian", jacobian), ("cosine", cosine)];
    for (mistake, pdf) in mistakes {
        let wrong = Mistaken { brdf: brdf.clone(), pdf };
        let test = std::panic::AssertUnwindSafe(|| assert_sampling(&wrong, name));
        assert!(std::panic::catch_unwind(test).is_err(), "{name}: {mistake} is not found");
    }
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn measured_tables_pass_the_same_tests() {
    for (name, brdf) in &files() {
        assert_values(name, brdf.as_ref());
        assert_sampling(brdf.as_ref(), name);
        assert_albedo(name, brdf.as_ref());
        assert_mistakes_are_found(name, brdf);
    }
}

#[test]
fn every_table_meets_its_albedo_by_samples() {
    for (name, brdf) in TABLES.iter() {
        assert_albedo(name, brdf.as_ref());
    }
}

/// A white furnace: a white diffuse table reflects all light.
#[test]
fn white_tables_reflect_everything() {
    let white = Lambert { albedo: Vec3::ONE };
    let kinds: Kinds = vec![
        ("half angles".into(), material(half_table(&white, Period::Half))),
        ("light and view".into(), material(in_out_table(&white, false))),
        ("scattered".into(), material(scattered(&white))),
        ("pairs of directions".into(), Arc::new(over_directions(&white, Scheme::Triangles))),
        ("rgl".into(), rgl(&white)),
    ];
    for (name, brdf) in &kinds {
        for wo in views() {
            let albedo: f64 = integrate(&|wi| brdf.eval(Vec2::ZERO, wi, wo).y * wi.z).iter().sum();
            println!("{name}: {albedo:.4}");
            assert!((albedo - 1.0).abs() < 0.02, "{name}: {albedo} from {wo}");
        }
    }
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn many_pairs_are_evaluated_as_one_by_one() {
    let folder = data("rgl_epfl");
    let Measured::Brdf(brdf) =
        import::open_named(folder.join("satin_rosaline_rgb.bsdf"), &Default::default()).unwrap().1
    else {
        panic!("a BRDF is expected")
    };
    let mut random = Random(1);
    let mut direction = || from_angles(1.7 * random.unit(), TAU * random.unit());
    let pairs: Vec<(Vec3, Vec3)> = (0..1000).map(|_| (direction(), direction())).collect();
    let points: Vec<Point> = pairs.iter().map(|&(_, wo)| Point { uv: Vec2::ZERO, wo }).collect();
    let (index, wi): (Vec<u32>, Vec<Vec3>) = (0..).zip(&pairs).map(|(k, pair)| (k, pair.0)).unzip();
    let prepared = brdf.prepare(&points);
    let (mut values, mut densities) = (vec![Vec3::ONE; pairs.len()], vec![1.0; pairs.len()]);
    prepared.apparent(&index, &wi, &mut values);
    prepared.pdf(&index, &wi, &mut densities);
    for ((&(wi, wo), value), density) in pairs.iter().zip(values).zip(densities) {
        assert_eq!(value, brdf.apparent(Vec2::ZERO, wi, wo), "{wi} {wo}");
        assert_eq!(density, brdf.pdf(Vec2::ZERO, wi, wo), "{wi} {wo}");
    }
}
