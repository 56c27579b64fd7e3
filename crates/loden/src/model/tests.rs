//! Physics of every model, in loops over [`MODELS`] and the properties each declares.

use std::collections::BTreeSet;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::*;
use crate::material::Material;

/// Parameters for testing the models; every model has at least one line.
const CASES: &[(&str, &[(&str, &str)])] = &[
    ("lambert", &[("kd", "0.8,0.5,0.1")]),
    ("oren-nayar", &[("kd", "1")]),
    ("oren-nayar", &[("kd", "1"), ("sigma", "60")]),
    ("phong", &[("kd", "0.2"), ("ks", "0.8,0.6,0.1")]),
    ("phong", &[("form", "original"), ("exponent", "9")]),
    ("blinn-phong", &[("kd", "0.2"), ("ks", "0.8")]),
    ("blinn-phong", &[("form", "original"), ("exponent", "30")]),
    ("lafortune", &[]),
    ("lafortune", &[("lobes", "3"), ("cy", "-0.5"), ("kd", "0.1"), ("cz-2", "0.7")]),
    ("ward", &[("kd", "0"), ("ks", "1")]),
    ("ward", &[("alpha-x", "0.15"), ("alpha-y", "0.5"), ("ks", "0.7")]),
    ("ward", &[("form", "ward"), ("alpha-x", "0.4")]),
    ("ashikhmin-shirley", &[]),
    ("ashikhmin-shirley", &[("nu", "10"), ("nv", "150"), ("ks", "0.05,0.9,0.4"), ("kd", "0.6,0.1,0")]),
    ("schlick", &[("kd", "0.8")]),
    ("schlick", &[("roughness", "0.3"), ("isotropy", "0.4"), ("ks", "0.9"), ("kd", "0.1")]),
    ("cook-torrance", &[("metal", "copper"), ("kd", "0"), ("ks", "1")]),
    ("cook-torrance", &[("lobes", "2"), ("m", "0.5"), ("m-2", "0.15"), ("n", "1.4,1.5,1.6"), ("k", "0.2")]),
    ("beckmann", &[("metal", "mirror"), ("kd", "0"), ("ks", "1")]),
    ("beckmann", &[("alpha-x", "0.6"), ("alpha-y", "0.2"), ("metal", "gold")]),
    ("ggx", &[("metal", "mirror"), ("kd", "0"), ("ks", "1"), ("alpha-x", "0.5"), ("alpha-y", "0.5")]),
    ("ggx", &[("alpha-x", "0.15"), ("alpha-y", "0.5"), ("metal", "silver")]),
    ("ggx", &[("shadowing", "separable"), ("alpha-x", "0.3")]),
    ("he-torrance", &[("metal", "nickel"), ("aperture", "6")]),
    ("he-torrance", &[("sigma", "0.05"), ("tau", "1"), ("aperture", "8"), ("kd", "0.1")]),
];

fn materials() -> Vec<(String, Analytic)> {
    let build = |(name, given): &(&str, &[(&str, &str)])| {
        let model = by_name(name).unwrap();
        let values = Values::new(model.params(), given.iter().copied()).unwrap();
        (format!("{name} {given:?}"), Analytic::new(model, values).unwrap())
    };
    CASES.iter().map(build).collect()
}

fn direction(theta: f64, phi: f64) -> DVec3 {
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// Pseudo-random numbers in [0, 1), an additive sequence per dimension scrambled by a hash.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn direction(&mut self) -> DVec3 {
        direction((self.next()).acos().min(1.56), TAU * self.next())
    }
}

/// Views of the sampling test, (theta, phi) in degrees; the last two are grazing.
const VIEWS: [(f64, f64); 5] = [(0.0, 0.0), (25.0, 40.0), (50.0, 200.0), (75.0, 100.0), (85.0, 310.0)];

#[test]
fn every_model_is_tested_and_has_its_colours() {
    let tested: BTreeSet<_> = CASES.iter().map(|case| case.0).collect();
    for model in MODELS {
        assert!(tested.contains(model.name()), "{} has no case", model.name());
        let values = Values::defaults(model.params());
        let colors = model.color_values(&values).unwrap();
        let back = model.colors_of(&model.coefficients(&colors));
        for (a, b) in colors.iter().zip(&back) {
            assert!((*a - *b).abs().max_element() < 1e-12, "{}", model.name());
        }
    }
}

#[test]
fn values_are_finite_and_not_negative_and_promises_hold() {
    for (name, brdf) in materials() {
        let promises = brdf.promises();
        let mut random = Random(1);
        let (mut asymmetric, mut turned) = (0, 0);
        for _ in 0..20_000 {
            let (wi, wo) = (random.direction(), random.direction());
            let value = brdf.brdf(wi, wo);
            assert!(value.is_finite() && value.min_element() >= 0.0, "{name}: {value} at {wi} {wo}");
            let close = |other: DVec3| (other - value).abs().max_element() <= 1e-9 * (1.0 + value.max_element());
            asymmetric += usize::from(!close(brdf.brdf(wo, wi)));
            let turn = glam::DQuat::from_rotation_z(TAU * random.next());
            turned += usize::from(!close(brdf.brdf(turn * wi, turn * wo)));
        }
        // a property that is not declared must fail, or the declaration was forgotten
        assert_eq!(asymmetric == 0, promises.reciprocal, "{name}: {asymmetric} pairs differ when swapped");
        assert_eq!(turned == 0, promises.isotropic, "{name}: {turned} pairs differ when turned");
        for below in [direction(1.7, 0.3), DVec3::new(1.0, 0.0, 0.0), DVec3::NAN] {
            assert_eq!(brdf.brdf(below, DVec3::Z), DVec3::ZERO, "{name}");
            assert_eq!(brdf.brdf(DVec3::Z, below), DVec3::ZERO, "{name}");
        }
    }
}

#[test]
fn single_precision_is_close_where_it_is_used() {
    for (name, brdf) in materials() {
        let mut random = Random(3);
        for _ in 0..20_000 {
            let (wi, wo) = (random.direction().as_vec3(), random.direction().as_vec3());
            let (i, o) = (wi.as_dvec3().normalize(), wo.as_dvec3().normalize());
            let expected = brdf.brdf(i, o) * (PI * i.z);
            let (found, pdf) = (brdf.apparent(Vec2::ZERO, wi, wo).as_dvec3(), f64::from(brdf.pdf(Vec2::ZERO, wi, wo)));
            let close = |a: f64, b: f64| (a - b).abs() <= 2e-5 * a.max(b) + 1e-30;
            assert!((0..3).all(|c| close(found[c], expected[c])), "{name}: {found} {expected} at {wi} {wo}");
            assert!(close(pdf, brdf.density(i, o)), "{name}: {pdf} {}", brdf.density(i, o));
        }
    }
}

/// f cos integrated over the hemisphere on a fine grid of wi.
fn albedo(brdf: &Analytic, wo: DVec3) -> DVec3 {
    let (rings, steps) = (500, 144);
    let ring = |ring: usize| {
        // squared: finer towards the horizon
        let x = (ring as f64 + 0.5) / rings as f64;
        let theta = FRAC_PI_2 * (1.0 - x * x);
        let weight = FRAC_PI_2 * 2.0 * x / rings as f64 * theta.sin() * theta.cos() * TAU / steps as f64;
        (0..steps).map(|s| brdf.brdf(direction(theta, TAU * (s as f64 + 0.5) / steps as f64), wo) * weight).sum()
    };
    (0..rings).into_par_iter().map(ring).collect::<Vec<DVec3>>().into_iter().sum()
}

#[test]
fn no_more_light_leaves_than_arrives_where_that_is_promised() {
    for (name, brdf) in materials() {
        let worst = [0.0, 30.0, 60.0, 75.0, 85.0f64].map(|t| albedo(&brdf, direction(t.to_radians(), 0.3)));
        let most = worst.iter().map(|a| a.max_element()).fold(0.0, f64::max);
        println!("{name}: albedo at most {most:.4}");
        assert!(!brdf.promises().energy_conserving || most <= 1.0 + 1e-4, "{name}: {worst:?}");
    }
}

#[test]
fn a_white_furnace_is_met_by_samples() {
    // the mean of f cos / pdf is the albedo, which is 1 if nothing is absorbed or lost
    for (name, brdf) in materials() {
        for (t, p) in [VIEWS[1], VIEWS[3]] {
            let wo = direction(t.to_radians(), p.to_radians()).as_vec3();
            let mut random = Random(7);
            let (mut sum, mut squares, n) = (0.0f64, 0.0f64, 20_000);
            for _ in 0..n {
                let u = Vec2::new(random.next() as f32, random.next() as f32).min(Vec2::splat(1.0f32.next_down()));
                let weight = brdf.sample(Vec2::ZERO, wo, u).map_or(0.0, |s| {
                    let weight = f64::from(brdf.eval(Vec2::ZERO, s.wi, wo).y * s.wi.z / s.pdf);
                    // apparent / (pi pdf) is the same value computed differently
                    let other = f64::from(brdf.apparent(Vec2::ZERO, s.wi, wo).y) / PI / f64::from(s.pdf);
                    assert!((weight - other).abs() <= 1e-4 * (1.0 + weight), "{name}: {weight} {other}");
                    weight
                });
                sum += weight;
                squares += weight * weight;
            }
            let mean = sum / f64::from(n);
            let error = ((squares / f64::from(n) - mean * mean).max(0.0) / f64::from(n)).sqrt();
            let expected = albedo(&brdf, wo.as_dvec3()).y;
            assert!((mean - expected).abs() < 4.5 * error + 2e-3 * expected, "{name}: {mean} +- {error}, {expected}");
        }
    }
    let white = Analytic::new(by_name("lambert").unwrap(), Values::new(&[KD], [("kd", "1")]).unwrap()).unwrap();
    assert!((albedo(&white, DVec3::Z) - DVec3::ONE).abs().max_element() < 1e-4);
}

/// The integral of the density over a cell of the (theta, phi) plane, by Gauss-Legendre of 4 x 4 points, refined
/// until it no longer changes.
fn integrate(pdf: &dyn Fn(f64, f64) -> f64, t: [f64; 2], p: [f64; 2], whole: f64, depth: usize) -> f64 {
    let (tm, pm) = (0.5 * (t[0] + t[1]), 0.5 * (p[0] + p[1]));
    let quarters =
        [([t[0], tm], [p[0], pm]), ([tm, t[1]], [p[0], pm]), ([t[0], tm], [pm, p[1]]), ([tm, t[1]], [pm, p[1]])];
    let parts = quarters.map(|(t, p)| gauss(pdf, t, p));
    let sum: f64 = parts.iter().sum();
    if depth == 0 || (sum - whole).abs() < 1e-7 {
        return sum;
    }
    quarters.iter().zip(parts).map(|(&(t, p), part)| integrate(pdf, t, p, part, depth - 1)).sum()
}

fn gauss(pdf: &dyn Fn(f64, f64) -> f64, t: [f64; 2], p: [f64; 2]) -> f64 {
    const X: [f64; 4] =
        [-0.861_136_311_594_052_6, -0.339_981_043_584_856_3, 0.339_981_043_584_856_3, 0.861_136_311_594_052_6];
    const W: [f64; 4] =
        [0.347_854_845_137_453_9, 0.652_145_154_862_546_1, 0.652_145_154_862_546_1, 0.347_854_845_137_453_9];
    let at = |range: [f64; 2], x: f64| 0.5 * (range[0] + range[1]) + 0.5 * (range[1] - range[0]) * x;
    let sum: f64 = (0..16).map(|i| W[i / 4] * W[i % 4] * pdf(at(t, X[i / 4]), at(p, X[i % 4]))).sum();
    sum * 0.25 * (t[1] - t[0]) * (p[1] - p[0])
}

/// Upper limit of chi-square at significance `alpha`, by the Wilson-Hilferty cube.
fn chi_square_limit(freedom: f64, alpha: f64) -> f64 {
    // the normal quantile by bisection of the tail
    let tail = |x: f64| {
        let n = 4000;
        (0..n).map(|i| (-0.5 * (x + 10.0 * (f64::from(i) + 0.5) / f64::from(n)).powi(2)).exp()).sum::<f64>() * 10.0
            / f64::from(n)
            / TAU.sqrt()
    };
    let (mut low, mut high) = (0.0, 9.0);
    for _ in 0..60 {
        let mid = 0.5 * (low + high);
        if tail(mid) > alpha { low = mid } else { high = mid }
    }
    let k = 2.0 / (9.0 * freedom);
    freedom * (1.0 - k + low * k.sqrt()).powi(3)
}

#[test]
fn samples_are_distributed_like_their_density() {
    const SAMPLES: usize = 300_000;
    const CELLS: (usize, usize) = (12, 24);
    let materials = materials();
    let tests = (materials.len() * VIEWS.len()) as f64;
    // 1 per cent for all tests together (Sidak)
    let alpha = 1.0 - 0.99f64.powf(1.0 / tests);
    let check = |(name, brdf): &(String, Analytic), (t, p): (f64, f64)| {
        let wo = direction(t.to_radians(), p.to_radians()).as_vec3();
        let wo64 = wo.as_dvec3().normalize();
        let mut counts = vec![0.0f64; CELLS.0 * CELLS.1 + 1];
        let mut random = Random(0x1234_5678);
        for _ in 0..SAMPLES {
            let u = Vec2::new(random.next() as f32, random.next() as f32).min(Vec2::splat(1.0f32.next_down()));
            let cell = brdf.sample(Vec2::ZERO, wo, u).map_or(CELLS.0 * CELLS.1, |sample| cell(sample.wi, CELLS));
            counts[cell] += 1.0;
        }
        let density = |t: f64, p: f64| brdf.density(direction(t, p), wo64) * t.sin();
        let mut expected: Vec<f64> = (0..CELLS.0 * CELLS.1)
            .map(|i| {
                let edge = |k: usize, n: usize, whole: f64| whole * k as f64 / n as f64;
                let (row, column) = (i / CELLS.1, i % CELLS.1);
                let t = [edge(row, CELLS.0, FRAC_PI_2), edge(row + 1, CELLS.0, FRAC_PI_2)];
                let p = [edge(column, CELLS.1, TAU), edge(column + 1, CELLS.1, TAU)];
                SAMPLES as f64 * integrate(&density, t, p, gauss(&density, t, p), 7)
            })
            .collect();
        let inside: f64 = expected.iter().sum();
        let excess = inside / SAMPLES as f64;
        // the remainder is the probability that a sample fails
        expected.push((SAMPLES as f64 - inside).max(0.0));
        let (statistic, freedom) = pooled(&counts, &expected);
        let limit = chi_square_limit(freedom, alpha);
        let wrong = || format!("{name} from {t}, {p}: chi-square {statistic:.0} of {freedom}, limit {limit:.0}");
        (statistic >= limit || excess > 1.0001).then(wrong)
    };
    let jobs: Vec<_> = materials.iter().flat_map(|m| VIEWS.map(|view| (m, view))).collect();
    let wrong: Vec<String> = jobs.par_iter().filter_map(|(material, view)| check(material, *view)).collect();
    assert!(wrong.is_empty(), "{} of {tests}:\n{}", wrong.len(), wrong.join("\n"));
}

fn cell(wi: Vec3, cells: (usize, usize)) -> usize {
    let row = f64::from(crate::direction::theta(wi)) / FRAC_PI_2 * cells.0 as f64;
    let column = f64::from(crate::direction::phi(wi)) / TAU * cells.1 as f64;
    (row as usize).min(cells.0 - 1) * cells.1 + (column as usize).min(cells.1 - 1)
}

/// Chi-square and degrees of freedom, with cells of fewer than 5 expected samples merged.
fn pooled(counts: &[f64], expected: &[f64]) -> (f64, f64) {
    let mut order: Vec<usize> = (0..counts.len()).collect();
    order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));
    let (mut statistic, mut used) = (0.0, 0.0);
    let (mut count, mut sum) = (0.0, 0.0);
    for i in order {
        count += counts[i];
        sum += expected[i];
        if sum >= 5.0 {
            statistic += (count - sum) * (count - sum) / sum;
            used += 1.0;
            (count, sum) = (0.0, 0.0);
        }
    }
    (statistic, used - 1.0)
}
