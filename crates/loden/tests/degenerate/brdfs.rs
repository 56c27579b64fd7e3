//! Fits, factorisations and exporters of BRDFs.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use loden::direction::from_angles;
use loden::export::BRDF_EXPORTERS;
use loden::fit::{self, Data, Metric, Options};
use loden::import::{self, Measured};
use loden::material::{BrdfSample, Material, Promises};
use loden::metric;
use loden::model::MODELS;
use loden::params::{Given, Values};
use loden::progress::Silent;
use loden::separable::{self, FACTORISATIONS};

use super::family::names_its_cause;

/// A BRDF given by a function of the cosine between half vector and normal, or a broken one.
#[derive(Debug, Clone, Copy)]
struct Made {
    name: &'static str,
    value: fn(Vec3, Vec3) -> Vec3,
}

fn glossy(wi: Vec3, wo: Vec3) -> Vec3 {
    Vec3::new(0.1, 0.08, 0.02) + Vec3::splat(0.3 * (wi + wo).normalize().z.max(0.0).powi(20))
}

const FINITE: [Made; 8] = [
    Made { name: "ordinary", value: glossy },
    Made { name: "constant", value: |_, _| Vec3::splat(0.25) },
    Made { name: "black", value: |_, _| Vec3::ZERO },
    Made { name: "one channel", value: |wi, wo| glossy(wi, wo) * Vec3::X },
    Made { name: "values of 1e-30", value: |wi, wo| 1e-30 * glossy(wi, wo) },
    Made { name: "values of 1e6", value: |wi, wo| 1e6 * glossy(wi, wo) },
    Made { name: "negative in places", value: |wi, wo| glossy(wi, wo) * if wi.z * wo.z < 0.3 { -1.0 } else { 1.0 } },
    Made { name: "negative", value: |wi, wo| -glossy(wi, wo) },
];

const BROKEN: [Made; 2] = [
    Made { name: "NaN", value: |wi, wo| if wi.z * wo.z < 0.3 { Vec3::NAN } else { glossy(wi, wo) } },
    Made { name: "infinite", value: |wi, wo| if wi.z * wo.z < 0.3 { Vec3::INFINITY } else { glossy(wi, wo) } },
];

impl Material for Made {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.eval(uv, wi, wo) * (PI * wi.z)
    }

    fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if wi.z > 0.0 && wo.z > 0.0 { (self.value)(wi, wo) } else { Vec3::ZERO }
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: false, energy_conserving: false, isotropic: false }
    }
}

impl Made {
    fn samples(self, count: usize) -> Vec<BrdfSample> {
        let pair = |i: usize| {
            let at = |k: f32| (k * (i as f32 + 0.5)).fract();
            (from_angles(1.4 * at(0.7549), TAU * at(0.5698)), from_angles(1.4 * at(0.438_58), TAU * at(0.3247)))
        };
        let sample = |(wi, wo)| BrdfSample { wi, wo, value: (self.value)(wi, wo) };
        (0..count).map(|i| sample(pair(i))).collect()
    }
}

/// Samples by name, each with a different fault.
fn sample_sets() -> Vec<(String, Vec<BrdfSample>)> {
    let all = FINITE.iter().chain(&BROKEN).map(|made| (made.name.to_owned(), made.samples(40)));
    let few = [1, 2].map(|count| (format!("{count} of 40"), FINITE[0].samples(count)));
    let equal = vec![FINITE[0].samples(1)[0]; 5];
    all.chain(few).chain([("five equal ones".to_owned(), equal)]).collect()
}

#[test]
fn every_fit_of_every_set_of_samples_is_finite_and_no_worse_than_black() {
    let mut problems = Vec::new();
    for (name, samples) in sample_sets() {
        let data = Data::new(&samples).unwrap();
        for model in MODELS {
            for &metric in Metric::ALL {
                let what = format!("{name} by {} ({})", model.name(), metric.name());
                let options = Options { metric, starts: 1, ..Options::default() };
                match fit::fit(*model, &Values::defaults(model.params()), &data, &options, &Silent) {
                    Ok(found) => {
                        println!("{what}: {:.4}", found.relative_error);
                        let finite = found.error.is_finite() && found.relative_error.is_finite();
                        let value = found.brdf.eval(Vec2::ZERO, Vec3::Z, from_angles(0.3, 1.0));
                        // Schlick's term of Fresnel is white at grazing angles whatever its colour is
                        let most =
                            data.scale(metric) * 1.000_001 + if model.name() == "schlick" { 0.03 } else { 1e-20 };
                        if !finite || !value.is_finite() || found.error > most {
                            problems.push(format!("{what}: {} of {}, {value}", found.error, data.scale(metric)));
                        }
                    }
                    Err(error) => problems.push(format!("{what}: {error}")),
                }
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn every_factorisation_of_every_member_is_finite_and_close() {
    let mut problems = Vec::new();
    for method in FACTORISATIONS {
        let values = Values::new(method.params(), [("resolution", "6")]).unwrap();
        for made in FINITE {
            let what = format!("{} by {}", made.name, method.name());
            match method.factor(&made, &values, &Silent) {
                Ok(factored) => {
                    // what is negative cannot be reflected
                    let positive = Positive(made);
                    let (found, black) =
                        (separable::compare(&positive, &factored), separable::compare(&positive, &FINITE[2]));
                    println!("{what}: {:e} of {:e}", found.rmse, black.rmse);
                    let most = match (made.name, method.name()) {
                        ("constant", _) => 1e-3,
                        // a norm and a mean of a matrix whose signs differ
                        (_, "nd" | "gshd") => 1.0,
                        _ => 0.9,
                    };
                    if !found.rmse.is_finite() || found.rmse > most * black.rmse {
                        problems.push(format!("{what}: {found:?}, black {black:?}"));
                    }
                }
                Err(error) => problems.push(format!("{what}: {error}")),
            }
        }
        for made in BROKEN {
            let error = method.factor(&made, &values, &Silent).unwrap_err();
            assert!(names_its_cause(&error), "{} by {}: {error:?}", made.name, method.name());
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

struct Positive(Made);

impl Material for Positive {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.0.apparent(uv, wi, wo).max(Vec3::ZERO)
    }

    fn eval(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.0.eval(uv, wi, wo).max(Vec3::ZERO)
    }
}

#[test]
fn every_exporter_writes_every_member_or_says_why_not() {
    let folder = tempfile::tempdir().unwrap();
    let mut problems = Vec::new();
    for exporter in BRDF_EXPORTERS {
        for (i, made) in FINITE.iter().chain(&BROKEN).enumerate() {
            let what = format!("{} as {}", made.name, exporter.name());
            let path = folder.path().join(format!("{i}.{}", exporter.ending()));
            let written = exporter.write(made, &made.samples(60), &path, &Values::defaults(exporter.params()));
            if let Err(error) = written {
                println!("{what}: {error}");
                assert!(names_its_cause(&error) && !path.exists(), "{what}: {error:?}");
                continue;
            }
            if exporter.name() == "slice" {
                continue;
            }
            let brdf = match import::open_named(&path, &Given::default()) {
                Ok((_, Measured::Brdf(brdf))) => brdf,
                Ok(_) => panic!("{what}: is no BRDF"),
                Err(error) => {
                    problems.push(format!("{what}: {error}"));
                    continue;
                }
            };
            let found = metric::round_trip(&brdf.samples(), &Positive(*made));
            println!("{what}: {found:?}");
            if found.relative_error.is_nan() || found.relative_error > 0.2 {
                problems.push(format!("{what}: {found:?}"));
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
