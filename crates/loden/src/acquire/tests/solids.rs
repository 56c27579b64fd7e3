use glam::{Mat4, Vec2};

use super::*;
use crate::acquire::{Paint, Solid, Specimen, coverage, yarn};
use crate::direction::from_angles;
use crate::params::{Params, Values};
use crate::render::MeshData;

const LIGHTS: [[f64; 2]; 5] = [[0.0, 0.0], [30.0, 45.0], [50.0, 200.0], [70.0, 300.0], [85.0, 90.0]];

/// The triangles of a height field, which repeat with it.
fn triangles(field: &HeightField, paint: Paint) -> Solid {
    let n = field.grid();
    let at = |i: usize, j: usize| {
        let z = field.heights()[j % n * n + i % n];
        Vec3::new((i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32, z)
    };
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| at(i, j))).collect();
    let cell = |k: usize| {
        let a = (k / n * (n + 1) + k % n) as u32;
        let row = n as u32 + 1;
        [[a, a + 1, a + row], [a + 1, a + row + 1, a + row]]
    };
    let triangles = (0..n * n).flat_map(cell).collect();
    Solid { positions, triangles, paints: vec![paint], periodic: true, ..Solid::default() }
}

fn images<'a>(sample: impl Into<Specimen<'a>>, views: &DirectionSet, options: &Options) -> Vec<f32> {
    let mut all = Vec::new();
    let mut sink = |_, view: Vec<f32>| {
        all.extend(view);
        Ok(())
    };
    acquire(sample, views, &directions(&LIGHTS), options, &Silent, &mut sink).unwrap();
    all
}

fn covered(solid: &Solid, views: &DirectionSet, options: &Options) -> Vec<f32> {
    let mut all = Vec::new();
    let mut sink = |_, view: Vec<f32>| {
        all.extend(view);
        Ok(())
    };
    coverage(solid, views, options, &Silent, &mut sink).unwrap();
    all
}

#[test]
fn a_height_field_and_its_triangles_look_the_same() {
    let views = directions(&[[0.0, 0.0], [40.0, 70.0], [75.0, 200.0]]);
    let options = Options { size: 8, spp: 256, depth: 3, seed: 3 };
    for (finish, paint) in [
        (Finish::matt(Vec3::new(0.8, 0.5, 0.2)), Paint::plain(Vec3::new(0.8, 0.5, 0.2), 0.0, [1.0; 2])),
        (glossy(), Paint::plain(Vec3::new(0.6, 0.5, 0.3), 0.2, [0.3; 2])),
    ] {
        let field = hills(16, finish);
        let [a, b] = [images(&field, &views, &options), images(&triangles(&field, paint), &views, &options)];
        let count = 8 * 8 * 3;
        for (k, (a, b)) in a.chunks(count).zip(b.chunks(count)).enumerate() {
            let (a, b) = (mean(a), mean(b));
            // the planes of the texels are at slightly different heights
            assert!((a - b).abs() < 0.01 * a.max(0.02), "image {k}: {a} {b}");
        }
    }
}

#[test]
fn a_tile_continues_on_the_other_side() {
    // the same hills, cut elsewhere: the second tile begins in the middle of the first
    let options = Options { size: 8, spp: 64, depth: 3, seed: 1 };
    let views = directions(&[[60.0, 30.0]]);
    let paint = || Paint::plain(Vec3::splat(0.7), 0.0, [1.0; 2]);
    let whole = triangles(&hills(16, Finish::matt(Vec3::splat(0.7))), paint());
    let mut moved = whole.clone();
    for p in &mut moved.positions {
        p.x += 0.5;
    }
    let [a, b] = [&whole, &moved].map(|solid| images(solid, &views, &options));
    let texel = |image: usize, x: usize, y: usize| (image * 64 + y * 8 + x) * 3;
    let mut differences = Vec::new();
    for (image, x, y) in (0..5 * 64).map(|k| (k / 64, k % 8, k / 8 % 8)) {
        differences.push(f64::from(a[texel(image, x, y)] - b[texel(image, (x + 4) % 8, y)]));
    }
    let rms = (differences.iter().map(|d| d * d).sum::<f64>() / differences.len() as f64).sqrt();
    assert!(rms < 0.02 && mean(&a) > 0.1, "{rms}");
}

/// A horizontal square from `low` to `high` at height z.
fn square(low: f32, high: f32, z: f32) -> MeshData {
    let p = |x, y| Vec3::new(x, y, z);
    MeshData {
        positions: vec![p(low, low), p(high, low), p(high, high), p(low, high)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..MeshData::default()
    }
}

fn alone(parts: &[MeshData], paint: Paint) -> Solid {
    let mut all = MeshData::default();
    parts.iter().for_each(|part| all.append(part, Mat4::IDENTITY).unwrap());
    Solid { positions: all.positions, triangles: all.triangles, paints: vec![paint], ..Solid::default() }
}

#[test]
fn an_overhang_hides_and_shades_what_is_below_it() {
    let white = || Paint::plain(Vec3::ONE, 0.0, [1.0; 2]);
    // a roof at 0.25 over the middle of a floor; the mean height seen from above is 1/16
    let solid = alone(&[square(0.0, 1.0, 0.0), square(0.25, 0.75, 0.25)], white());
    let options = Options { size: 16, spp: 16, depth: 1, seed: 0 };
    let oblique = directions(&[[45.0, 0.0]]);
    let image = images(&solid, &oblique, &options);
    let value = |light: usize, x: usize, y: usize| image[(light * 256 + y * 16 + x) * 3];
    // towards the viewer at the right, the roof is displaced to the left by 0.25 - 1/16 and the floor to the right by 1/16
    assert!((value(0, 4, 8) - 1.0).abs() < 1e-5, "the roof under light from above");
    assert!((value(0, 10, 8) - 0.0).abs() < 1e-5, "the floor under the roof");
    assert!((value(0, 14, 8) - 1.0).abs() < 1e-5, "the floor beside it");
    // light and viewer are the same: no shadow is seen
    let lights = directions(&[[45.0, 0.0]]);
    let mut same = Vec::new();
    acquire(&solid, &oblique, &lights, &options, &Silent, &mut |_, view| {
        same.extend(view);
        Ok(())
    })
    .unwrap();
    let lit = from_angles(45f32.to_radians(), 0.0).z;
    let seen = covered(&solid, &oblique, &options);
    for (value, seen) in same.iter().zip(&seen) {
        assert!((value - lit * seen).abs() < 1e-4, "{value} {seen}");
    }
}

#[test]
fn holes_are_black_and_not_covered() {
    let grey = Paint::plain(Vec3::splat(0.5), 0.0, [1.0; 2]);
    let options = Options { size: 8, spp: 32, depth: 4, seed: 0 };
    let views = directions(&[[0.0, 0.0], [50.0, 120.0]]);
    let solid = alone(&[square(0.0, 0.5, 0.0)], grey.clone());
    let (image, seen) = (images(&solid, &views, &options), covered(&solid, &views, &options));
    for k in 0..64 {
        let inside = k % 8 < 4 && k / 8 >= 4;
        assert_eq!(seen[3 * k], if inside { 1.0 } else { 0.0 }, "{k}");
        assert!((image[3 * k] - 0.5 * seen[3 * k]).abs() < 1e-5, "{k}");
    }
    let whole = Solid { periodic: true, ..alone(&[square(0.0, 1.0, 0.0)], grey) };
    assert!(covered(&whole, &views, &options).iter().all(|&seen| seen == 1.0));
}

#[test]
fn white_yarns_neither_lose_nor_gain_light() {
    let options = yarn::Options {
        yarns: 4,
        points: 12,
        fuzz: 0.0,
        warp: [1.0; 3],
        weft: [1.0; 3],
        specular: 0.0,
        ..yarn::Options::default()
    };
    let mut cloth = yarn::build(&options, 1).unwrap();
    // true normals, and a floor without holes
    cloth.normals.clear();
    cloth.albedo.iter_mut().for_each(|albedo| *albedo = Vec3::ONE);
    let first = cloth.positions.len() as u32;
    cloth.positions.extend(square(0.0, 1.0, -0.4).positions);
    cloth.uvs.resize(cloth.positions.len(), Vec2::ZERO);
    cloth.albedo.resize(cloth.positions.len(), Vec3::ONE);
    cloth.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    let measuring = Options { size: 2, spp: 48, depth: 200, seed: 4 };
    let lights = dense(12, 16);
    let mut sum = 0.0;
    acquire(&cloth, &directions(&[[20.0, 0.0]]), &lights, &measuring, &Silent, &mut |_, view| {
        sum = mean(&view);
        Ok(())
    })
    .unwrap();
    // the mean of rho over the hemisphere is half the albedo
    assert!((2.0 * sum - 1.0).abs() < 0.03, "{}", 2.0 * sum);
}

#[test]
fn yarns_of_every_weave_cover_their_tile_and_repeat() {
    for weave in ["plain", "twill", "basket", "satin"] {
        let values = Values::new(yarn::Options::TABLE, [("weave", weave), ("points", "10"), ("fuzz", "0")]).unwrap();
        let options = yarn::Options::from_values(&values).unwrap();
        let [a, b, other] = [1, 1, 2].map(|seed| yarn::build(&options, seed).unwrap());
        assert!(a.positions == b.positions && a.albedo == b.albedo && a.positions != other.positions, "{weave}");
        let measuring = Options { size: 32, spp: 4, depth: 1, seed: 0 };
        let seen = covered(&a, &directions(&[[0.0, 0.0]]), &measuring);
        let share = mean(&seen);
        assert!((0.9..=1.0).contains(&share), "{weave}: {share}");
        // every ply ends where it begins
        let [low, high] = a.heights();
        assert!(high - low < 1.2 / 8.0 && high > -low * 0.5, "{weave}: {low} {high}");
    }
    let values = Values::new(yarn::Options::TABLE, [("weave", "satin"), ("yarns", "12")]).unwrap();
    let refused = yarn::build(&yarn::Options::from_values(&values).unwrap(), 0).unwrap_err().to_string();
    assert!(refused.starts_with("yarns: found 12, expected a multiple of 8"), "{refused}");
}

#[test]
fn highlights_of_yarns_stretch_across_their_fibres() {
    // fibres along x: light and view in the plane across them reflect over a wide range, those along them in a narrow one
    let mut solid = alone(&[square(0.0, 1.0, 0.0)], Paint::plain(Vec3::ZERO, 1.0, [0.1, 0.6]));
    solid.uvs = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let options = Options { size: 1, spp: 1, depth: 1, seed: 0 };
    let value = |phi: f64| {
        let mut found = 0.0;
        let (views, lights) = (directions(&[[0.0, 0.0]]), directions(&[[50.0, phi]]));
        acquire(&solid, &views, &lights, &options, &Silent, &mut |_, view| {
            found = view[0];
            Ok(())
        })
        .unwrap();
        found
    };
    assert!(value(90.0) > 20.0 * value(0.0), "{} {}", value(90.0), value(0.0));
}

#[test]
fn wrong_solids_are_refused() {
    let fine = || alone(&[square(0.0, 1.0, 0.0)], Paint::plain(Vec3::ONE, 0.0, [1.0; 2]));
    fine().check().unwrap();
    for (solid, name) in [
        (Solid { triangles: vec![[0, 1, 9]], ..fine() }, "triangles"),
        (Solid { triangles: vec![], ..fine() }, "triangles"),
        (Solid { normals: vec![Vec3::Z], ..fine() }, "normals"),
        (Solid { painted: vec![0, 3], ..fine() }, "paints"),
        (Solid { paints: vec![Paint::plain(Vec3::ONE, 0.0, [0.0; 2])], ..fine() }, "paint"),
        (Solid { albedo: vec![Vec3::splat(2.0); 4], ..fine() }, "albedo"),
        (Solid { positions: vec![Vec3::NAN; 4], ..fine() }, "positions"),
    ] {
        let error = solid.check().unwrap_err().to_string();
        assert!(error.starts_with(&format!("{name}:")), "{error}");
    }
    // a parallel sheet seen edge-on, and no extent at all
    let mut point = fine();
    point.positions.iter_mut().for_each(|p| *p = Vec3::splat(0.5));
    let flat = covered(&point, &directions(&[[10.0, 0.0]]), &Options { size: 2, ..Options::default() });
    assert!(flat.iter().all(|&seen| seen == 0.0));
}
