//! Whether directions are drawn with the density that is stated.

use glam::{Vec2, Vec3};
use loden::direction::from_angles;
use loden::material::Material;
use rayon::prelude::*;

const RINGS: usize = 10;
const SECTORS: usize = 20;
/// Directions drawn with one seed.
const PART: usize = 10_000;

/// Directions drawn from a viewer, and the most steps of the integration of a cell in each of its two angles: with
/// `LODEN_THOROUGH` in the environment a million, and fine ones.
fn effort() -> (usize, usize) {
    if std::env::var_os("LODEN_THOROUGH").is_some() { (1_000_000, 1024) } else { (40_000, 128) }
}

/// Uniform numbers (SplitMix64).
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// The viewers, the last ones grazing.
pub fn views() -> [Vec3; 5] {
    [(0.0f32, 0.0f32), (25.0, 40.0), (50.0, 200.0), (75.0, 100.0), (85.0, 310.0)]
        .map(|(theta, phi)| from_angles(theta.to_radians(), phi.to_radians()))
}

/// Draws directions for all viewers and compares their histogram with the integrated density by a chi-square test; what
/// fails to be drawn must be what the density lacks to 1.
pub fn assert_sampling(material: &dyn Material, name: &str) {
    let (drawn, _) = effort();
    for (i, wo) in views().into_iter().enumerate() {
        let mut expected = integrate(&|wi| material.pdf(Vec2::ZERO, wi, wo));
        let total: f64 = expected.iter().sum();
        assert!(total < 1.02, "{name}: view {i}: the density has the integral {total}");
        expected.push((1.0 - total).max(0.0));
        let observed = draw(material, wo, 77 + i as u64);
        let (mut statistic, mut freedom) = (0.0, -1.0);
        let (mut pooled_expected, mut pooled_observed) = (0.0, 0.0);
        for (e, o) in expected.iter().zip(&observed) {
            let e = e * drawn as f64;
            if e < 5.0 {
                pooled_expected += e;
                pooled_observed += o;
            } else {
                statistic += (o - e).powi(2) / e;
                freedom += 1.0;
            }
        }
        if pooled_expected >= 5.0 {
            statistic += (pooled_observed - pooled_expected).powi(2) / pooled_expected;
            freedom += 1.0;
        }
        // Wilson and Hilferty: the cube root of chi-square is almost normal
        let spread = 2.0 / (9.0 * freedom);
        let z = ((statistic / freedom).cbrt() - (1.0 - spread)) / f64::sqrt(spread);
        println!("{name}: view {i}: chi-square {statistic:.1} of {freedom}, z {z:.2}");
        // 1 per cent, corrected for about a hundred tests
        assert!(z < 3.7, "{name}: view {i}: chi-square {statistic:.1} with {freedom} degrees of freedom");
    }
}

/// The integral of a function over each cell of the hemisphere.
pub fn integrate(value: &(impl Fn(Vec3) -> f32 + Sync)) -> Vec<f64> {
    let (drawn, most) = effort();
    let cell = |cell: usize| {
        // finer until what changes is small beside the noise of the drawing
        let mut steps = most / 16 + 24;
        let mut last = integrate_cell(value, cell, steps);
        while steps < most {
            steps = 2 * steps + 1;
            let next = integrate_cell(value, cell, steps);
            let change = (next - last).abs();
            last = next;
            if change * drawn as f64 <= 0.1 * (last * drawn as f64).sqrt().max(1.0) {
                break;
            }
        }
        last
    };
    (0..RINGS * SECTORS).into_par_iter().map(cell).collect()
}

fn integrate_cell(value: &impl Fn(Vec3) -> f32, cell: usize, steps: usize) -> f64 {
    let (ring, sector) = (cell / SECTORS, cell % SECTORS);
    let edge = |ring: usize| (ring as f64 / RINGS as f64).acos();
    let (low, high) = (edge(ring + 1), edge(ring));
    let mut sum = 0.0;
    for step in 0..steps * steps {
        // a shift that differs from meridian to meridian: a step of the density along a circle would bias them all alike
        let shift = ((step % steps) as f64 * 0.618_033_988_749_895).fract();
        let theta = low + ((step / steps) as f64 + shift) / steps as f64 * (high - low);
        let p = (sector as f64 + ((step % steps) as f64 + 0.5) / steps as f64) / SECTORS as f64;
        sum += f64::from(value(from_angles(theta as f32, (p * std::f64::consts::TAU) as f32))) * theta.sin();
    }
    sum * (high - low) * std::f64::consts::TAU / (SECTORS * steps * steps) as f64
}

/// How many directions fall into each cell, and at the end how many draws gave none.
fn draw(material: &dyn Material, wo: Vec3, seed: u64) -> Vec<f64> {
    let sum = |a: Vec<f64>, b: Vec<f64>| a.iter().zip(b).map(|(a, b)| a + b).collect();
    (0..effort().0 / PART)
        .into_par_iter()
        .map(|part| draw_part(material, wo, seed << 32 | part as u64))
        .reduce(|| vec![0.0; RINGS * SECTORS + 1], sum)
}

fn draw_part(material: &dyn Material, wo: Vec3, seed: u64) -> Vec<f64> {
    // far apart in the sequence of numbers
    let mut random = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
    let mut counts = vec![0.0; RINGS * SECTORS + 1];
    for i in 0..PART {
        let u = Vec2::new(random.unit(), random.unit());
        let Some(sample) = material.sample(Vec2::ZERO, wo, u) else {
            counts[RINGS * SECTORS] += 1.0;
            continue;
        };
        let wi = sample.wi;
        if i < 100 {
            let pdf = material.pdf(Vec2::ZERO, wi, wo);
            assert!((sample.pdf - pdf).abs() <= 1e-3 * pdf.max(1e-3), "{} {pdf}", sample.pdf);
            assert!((wi.length() - 1.0).abs() < 1e-4);
        }
        let ring = ((wi.z * RINGS as f32) as usize).min(RINGS - 1);
        let turn = (wi.y.atan2(wi.x) / std::f32::consts::TAU).rem_euclid(1.0);
        counts[ring * SECTORS + ((turn * SECTORS as f32) as usize).min(SECTORS - 1)] += 1.0;
    }
    counts
}
