use std::f32::consts::PI;

use glam::{DVec3, Vec2, Vec3};
use proptest::prelude::*;

use super::*;
use crate::acquire::reflect::{Facets, Fibrous, LANES, Lights, Reflector};
use crate::acquire::shade::Shade;
use crate::acquire::surface::{Point, Ray, Surface};
use crate::direction::from_angles;
use crate::random::Stream;

const N: usize = 16;

/// Random heights up to `relief` cells.
fn rough(seed: u64, relief: f32) -> HeightField {
    let mut random = Stream::new(seed);
    let heights = (0..N * N).map(|_| relief * random.next() / N as f32).collect();
    HeightField::new(N, heights, vec![WHITE; N * N]).unwrap()
}

/// All triangles of 7 x 7 periods.
fn triangles(surface: &Surface) -> Vec<[DVec3; 3]> {
    let n = N as i32;
    let corner = |x: i32, y: i32| {
        let h = surface.heights()[(y.rem_euclid(n) * n + x.rem_euclid(n)) as usize];
        Vec3::new(x as f32, y as f32, h).as_dvec3()
    };
    let cells = (-3 * n..4 * n).flat_map(|y| (-3 * n..4 * n).map(move |x| (x, y)));
    let halves = |(x, y)| {
        let (b, c) = (corner(x + 1, y), corner(x, y + 1));
        [[corner(x, y), b, c], [corner(x + 1, y + 1), c, b]]
    };
    cells.flat_map(halves).collect()
}

/// The nearest hit beyond `from`, by testing all triangles in double precision.
fn brute(triangles: &[[DVec3; 3]], o: Vec3, d: Vec3, from: f64) -> Option<f64> {
    let (o, d) = (o.as_dvec3(), d.as_dvec3());
    let hit = |[a, b, c]: &[DVec3; 3]| {
        let (e, f) = (b - a, c - a);
        let p = d.cross(f);
        let det = e.dot(p);
        let s = (o - a) / det;
        let (u, q) = (s.dot(p), s.cross(e));
        let (v, t) = (d.dot(q), f.dot(q));
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > from).then_some(t)
    };
    triangles.iter().filter_map(hit).min_by(f64::total_cmp)
}

fn start(surface: &Surface, random: &mut Stream) -> Point {
    let place = random.next2() * N as f32;
    let down = Ray::new(place.extend(surface.top()), -Vec3::Z);
    surface.trace(&down, None).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn rays_hit_the_same_triangle_as_a_brute_force_search(seed in any::<u64>(), relief in 0.5f32..5.0) {
        let surface = Surface::new(&rough(seed, relief));
        let all = triangles(&surface);
        let mut random = Stream::new(seed ^ 1);
        for _ in 0..60 {
            let d = -from_angles(random.range(0.0, 1.3), random.range(0.0, 6.3));
            let o = (random.next2() * N as f32).extend(surface.top());
            let found = surface.trace(&Ray::new(o, d), None).unwrap();
            let expected = o + d * brute(&all, o, d, -1e-6).unwrap() as f32;
            let away = (found.at - expected) / N as f32;
            let away = (away - away.round()) * N as f32;
            prop_assert!(away.length() < 2e-3, "{found:?}, expected {expected}, from {o} along {d}");
            prop_assert!((found.at.z - expected.z).abs() < 2e-3);
        }
    }

    #[test]
    fn shadows_agree_with_a_brute_force_search(seed in any::<u64>(), relief in 0.5f32..5.0, shift in 0u32..=4) {
        let surface = Surface::new(&rough(seed, relief));
        let all = triangles(&surface);
        let mut random = Stream::new(seed ^ 1);
        let lights: Vec<_> =
            (0..20).map(|_| from_angles(random.range(0.0, 1.4), random.range(0.0, 6.3))).chain([Vec3::Z, Vec3::X.lerp(Vec3::Z, 0.3).normalize()]).collect();
        let shade = Shade::with_blocks(shift, N, surface.heights(), &lights);
        for _ in 0..20 {
            let point = start(&surface, &mut random);
            for (l, &light) in lights.iter().enumerate() {
                if surface.normal(&point).dot(light) < 0.01 {
                    continue;
                }
                // if both neighbouring rays agree, rounding cannot change the result
                let tries = [0.0, 1e-3, -1e-3].map(|shift| {
                    let o = point.at + Vec3::new(0.7, -0.6, 0.0).cross(light).normalize() * shift;
                    brute(&all, o, light, 5e-3).is_some()
                });
                if tries != [tries[0]; 3] {
                    continue;
                }
                prop_assert_eq!(surface.is_dark(&Ray::new(point.at, light), &point, l, &shade), tries[0], "{:?} {}", point, light);
                let verdict = shade.verdicts(point.cell, point.at.z, l / LANES)[l % LANES];
                prop_assert!(verdict < 0.0 || (verdict == 0.0) == tries[0], "{}", verdict);
            }
        }
    }

    #[test]
    fn rays_from_every_point_terminate(seed in any::<u64>(), relief in 0.0f32..16.0) {
        let surface = Surface::new(&rough(seed, relief));
        let mut random = Stream::new(seed ^ 1);
        for _ in 0..50 {
            let point = start(&surface, &mut random);
            let along = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::new(0.6, 0.8, 1e-7), Vec3::new(1.0, 1e-9, -1e-3)];
            for d in along {
                if let Some(next) = surface.trace(&Ray::new(point.at, d), Some(&point)) {
                    prop_assert!(next.at.is_finite() && (0..N as i32).contains(&next.cell[0]));
                }
            }
        }
    }
}

#[test]
fn shade_bounds_hold_for_grids_with_long_shadows() {
    let field = HeightField::from_fn(64, |x, _| (if x < 0.05 { 0.5 } else { 0.0 }, WHITE)).unwrap();
    let surface = Surface::new(&field);
    let light = from_angles(80f32.to_radians(), 0.3);
    let shade = Shade::new(64, surface.heights(), &[light]);
    // 32 cells times tan 80 reaches over two periods: everything on the floor is dark
    for cell in [[10, 0], [40, 60], [60, 31]] {
        assert_eq!(shade.verdicts(cell, 0.0, 0)[0], 0.0, "{cell:?}");
    }
    assert_eq!(shade.verdicts([30, 2], 32.1, 0)[0], 1.0);
}

fn finishes() -> [Finish; 4] {
    [WHITE, glossy(), Finish::coated(Vec3::splat(0.8), 0.04, 0.9), Finish::metal(Vec3::new(0.9, 0.6, 0.4), 0.25)]
}

#[test]
fn lights_add_up_to_single_evaluations() {
    let normal = Vec3::new(0.3, -0.2, 1.0).normalize();
    let set: Vec<Vec3> = (0..16).map(|k| from_angles(0.09 * k as f32, 1.7 * k as f32)).collect();
    let axis = |k: usize| set.iter().map(|w| w[k]).collect();
    let lights = Lights { x: axis(0), y: axis(1), z: axis(2) };
    fn check(reflector: Reflector<impl Facets>, lights: &Lights, set: &[Vec3]) {
        let (mut r, mut g, mut b) = (vec![0.0; 16], vec![0.0; 16], vec![0.0; 16]);
        reflector.add_lights(lights, &[1.0; 16], Vec3::new(0.5, 1.0, 2.0), [&mut r, &mut g, &mut b]);
        for (k, &wi) in set.iter().enumerate() {
            let expected = reflector.eval(wi) * PI * Vec3::new(0.5, 1.0, 2.0);
            let found = Vec3::new(r[k], g[k], b[k]);
            assert!(
                (found - expected).abs().max_element() < 2e-4 * (1.0 + expected.max_element()),
                "{found} {expected}"
            );
        }
    }
    let wo = from_angles(0.7, 2.0);
    finishes().iter().for_each(|finish| check(Reflector::new(normal, wo, finish), &lights, &set));
    check(fibres(normal, wo), &lights, &set);
}

/// Glossy fibres with a coloured base.
fn fibres(normal: Vec3, wo: Vec3) -> Reflector<Fibrous> {
    let facets = Fibrous::new(normal, Vec3::new(0.8, 0.6, 0.3), [0.2, 0.7]);
    Reflector::with(normal, wo, [Vec3::new(0.6, 0.5, 0.3), Vec3::splat(0.3)], facets)
}

#[test]
fn samples_have_the_mean_of_the_integral_and_the_density_integrates_to_one() {
    const SIDE: usize = 700;
    fn check(reflector: Reflector<impl Facets>, name: &str) {
        let (mut albedo, mut density) = (glam::DVec3::ZERO, 0.0);
        for k in 0..SIDE * SIDE {
            let (z, phi) = (((k / SIDE) as f32 + 0.5) / SIDE as f32, (k % SIDE) as f32 / SIDE as f32 * 2.0 * PI);
            let wi = from_angles(z.acos(), phi);
            albedo += reflector.eval(wi).as_dvec3();
            density += f64::from(reflector.pdf(wi));
        }
        let solid = 2.0 * f64::from(PI) / (SIDE * SIDE) as f64;
        let (albedo, density) = (albedo * solid, density * solid);
        let mut random = Stream::new(9);
        let (mut sum, mut squares, mut kept, count) = (glam::DVec3::ZERO, glam::DVec3::ZERO, 0, 200_000);
        for _ in 0..count {
            let Some((wi, weight)) = reflector.sample(random.next2(), random.next()) else { continue };
            assert!(wi.is_normalized() && wi.z > 0.0);
            let weight = weight.as_dvec3();
            (sum, squares, kept) = (sum + weight, squares + weight * weight, kept + 1);
        }
        let found = sum / f64::from(count);
        let error = ((squares / f64::from(count) - found * found) / f64::from(count)).max(glam::DVec3::ZERO);
        for c in 0..3 {
            let allowed = 4.0 * error[c].sqrt() + 1e-3 * albedo[c];
            assert!((found[c] - albedo[c]).abs() < allowed, "{name}: {found}, expected {albedo}");
        }
        let share = f64::from(kept) / f64::from(count);
        assert!((density - share).abs() < 4e-3, "{name}: density {density}, above the horizon {share}");
    }
    let wo = from_angles(0.8, 1.0);
    for finish in finishes() {
        check(Reflector::new(Vec3::Z, wo, &finish), &format!("{finish:?}"));
    }
    check(fibres(Vec3::Z, wo), "fibres");
}

#[test]
fn reflection_is_reciprocal() {
    let (a, b) = (from_angles(0.3, 1.0), from_angles(1.2, 4.0));
    for finish in finishes() {
        let f = |wi: Vec3, wo: Vec3| Reflector::new(Vec3::Z, wo, &finish).eval(wi) / wi.z;
        assert!(f(a, b).abs_diff_eq(f(b, a), 1e-5 * f(a, b).max_element().max(1.0)));
    }
    let f = |wi: Vec3, wo: Vec3| fibres(Vec3::Z, wo).eval(wi) / wi.z;
    assert!(f(a, b).abs_diff_eq(f(b, a), 1e-5 * f(a, b).max_element().max(1.0)));
}

#[test]
fn fibres_that_are_equally_rough_are_a_coat() {
    let (normal, wo) = (Vec3::new(0.2, 0.1, 1.0).normalize(), from_angles(0.9, 2.0));
    let finish = glossy();
    let facets = Fibrous::new(normal, Vec3::X, [finish.roughness; 2]);
    let fibres = Reflector::with(normal, wo, [finish.albedo, finish.f0].map(Vec3::from), facets);
    let coat = Reflector::new(normal, wo, &finish);
    for k in 0..50 {
        let wi = from_angles(0.03 * k as f32, 0.7 * k as f32);
        assert!(coat.eval(wi).abs_diff_eq(fibres.eval(wi), 1e-4 * coat.eval(wi).max_element().max(0.01)));
        assert!((coat.pdf(wi) - fibres.pdf(wi)).abs() < 1e-4 * coat.pdf(wi).max(0.01));
    }
}

#[test]
fn random_places_are_uniform() {
    let mut random = Stream::new(4);
    let sum = (0..100_000).map(|_| random.next2()).sum::<Vec2>() / 100_000.0;
    // the standard error of the mean is 0.0009
    assert!((sum - Vec2::splat(0.5)).abs().max_element() < 0.004, "{sum}");
}
