//! What a blend keeps of a sample.

use super::*;
use crate::btf::{BtfMeta, Cosine, MemoryBtf, SampleType, Texels};
use crate::color::Encoding;
use crate::direction::{DirectionSet, from_angles};
use crate::material::{Blending, Interpolation, RawBtf};
use crate::progress::Silent;
use crate::random::{Stream, hash, unit};

const SIDE: usize = 48;

/// A BTF whose display value at a texel is `value(texel, wi, wo)`.
fn btf(value: impl Fn(usize, Vec3, Vec3) -> [f32; 3]) -> Arc<MemoryBtf> {
    let directions = || {
        let rings = [(0.0, 1), (30.0, 6), (60.0, 8), (75.0, 8)];
        let degrees = rings.iter().flat_map(|&(t, n)| (0..n).map(move |k| [t, 360.0 * f64::from(k) / f64::from(n)]));
        DirectionSet::from_degrees(degrees.collect()).unwrap()
    };
    let (encoding, cosine, sample_type) = (Encoding::Srgb, Cosine::Included, SampleType::F32);
    let meta =
        BtfMeta { width: SIDE, height: SIDE, views: directions(), lights: directions(), encoding, cosine, sample_type };
    let mut texels = Vec::new();
    for wo in meta.views.directions() {
        for wi in meta.lights.directions() {
            texels.extend((0..meta.texels()).flat_map(|texel| value(texel, *wi, *wo)));
        }
    }
    Arc::new(MemoryBtf::new(meta, Texels::F32(texels.into())).unwrap())
}

fn endless(source: &Arc<MemoryBtf>) -> Endless {
    let sample = Arc::new(RawBtf::new(source.clone(), Scheme::Triangles).unwrap());
    Endless::new(&**source, sample, Scheme::Triangles, (5, false), &Silent).unwrap()
}

/// Grains of two kinds, one of which shines, with parallax: seen from the side, texels show what is beside them.
fn grains() -> Arc<MemoryBtf> {
    let at = |x: i32, y: i32, k: u64| {
        unit(hash(&[(x.rem_euclid(1 << 20) / 2) as u64, (y.rem_euclid(1 << 20) / 2) as u64, k]))
    };
    btf(move |texel, wi, wo| {
        let (x, y) = ((texel % SIDE) as i32 + (2.0 * wo.x) as i32, (texel / SIDE) as i32 - (2.0 * wo.y) as i32);
        let diffuse = 0.2 + 0.6 * at(x, y, 1).powi(2) * wi.z;
        let shine = 0.3 * at(x, y, 2) * (wi + wo).normalize().z.powi(8);
        [diffuse + shine, 0.8 * diffuse + shine, 0.5 * diffuse]
    })
}

/// Mean and standard deviation of the display values of a material over many places.
fn statistics(material: &dyn Material, wi: Vec3, wo: Vec3, reach: f32) -> [[f64; 2]; 3] {
    let mut random = Stream::new(11);
    let count = 60_000;
    let (mut sums, mut squares) = ([0.0f64; 3], [0.0f64; 3]);
    for _ in 0..count {
        let value = material.apparent(random.next2() * reach, wi, wo).to_array();
        for k in 0..3 {
            let display = f64::from(Encoding::Srgb.encode(value[k]));
            (sums[k], squares[k]) = (sums[k] + display, squares[k] + display * display);
        }
    }
    std::array::from_fn(|k| {
        let mean = sums[k] / f64::from(count);
        [mean, (squares[k] / f64::from(count) - mean * mean).max(0.0).sqrt()]
    })
}

/// Directions at which materials are compared: from the front, and at 75 degrees.
fn pairs() -> [(Vec3, Vec3); 3] {
    let direction = |theta: f32, phi: f32| from_angles(theta.to_radians(), phi.to_radians());
    [
        (direction(30.0, 60.0), direction(0.0, 0.0)),
        (direction(30.0, 0.0), direction(75.0, 90.0)),
        (direction(75.0, 45.0), direction(75.0, 225.0)),
    ]
}

#[test]
fn a_constant_material_stays_constant() {
    let constant = btf(|_, wi, wo| [0.3 + 0.2 * wi.z, 0.4, 0.1 + 0.1 * wo.z]);
    let endless = endless(&constant);
    let raw = RawBtf::new(constant, Scheme::Triangles).unwrap();
    let mut random = Stream::new(1);
    for (wi, wo) in pairs() {
        let expected = raw.apparent(Vec2::ZERO, wi, wo);
        for _ in 0..200 {
            let found = endless.apparent(random.next2() * 40.0 - 20.0, wi, wo);
            assert!((found - expected).abs().max_element() < 1e-5, "{found} {expected}");
        }
    }
}

#[test]
fn colours_and_contrast_stay_also_at_75_degrees() {
    let source = grains();
    let endless = endless(&source);
    // components are sums of stored values, between texels too
    let stored = Interpolation { blending: Blending::Stored, ..Interpolation::default() };
    let raw = RawBtf::new(source, stored).unwrap();
    for (wi, wo) in pairs() {
        let [found, expected] = [statistics(&endless, wi, wo, 60.0), statistics(&raw, wi, wo, 1.0)];
        for ([mean, deviation], [expected_mean, expected_deviation]) in found.into_iter().zip(expected) {
            assert!((mean - expected_mean).abs() < 1.0 / 255.0, "mean {mean}, expected {expected_mean}");
            let ratio = deviation / expected_deviation;
            assert!((0.8..1.15).contains(&ratio), "contrast {deviation}, expected {expected_deviation}");
        }
    }
}

#[test]
fn nothing_repeats_and_prepared_points_give_the_same() {
    let endless = endless(&grains());
    let (wi, wo) = pairs()[0];
    let mut random = Stream::new(4);
    let points: Vec<Point> = (0..100).map(|_| Point { uv: random.next2() * 9.0, wo }).collect();
    let index: Vec<u32> = (0..100).rev().collect();
    let (mut values, mut densities) = (vec![Vec3::ZERO; 100], vec![0.0; 100]);
    let prepared = endless.prepare(&points);
    prepared.apparent(&index, &[wi; 100], &mut values);
    prepared.pdf(&index, &[wi; 100], &mut densities);
    let mut differing = 0;
    for (k, index) in index.into_iter().enumerate() {
        let uv = points[index as usize].uv;
        assert_eq!(values[k], endless.apparent(uv, wi, wo));
        assert_eq!(densities[k], endless.pdf(uv, wi, wo));
        differing += usize::from(values[k] != endless.apparent(uv + Vec2::X, wi, wo));
    }
    assert!(differing > 90, "{differing}");
    let mut bounces = [Bounce::NONE; 2];
    prepared.scatter(&[3, 9], &[Vec2::splat(0.3); 2], &mut bounces);
    for (bounce, index) in bounces.iter().zip([3usize, 9]) {
        assert!(bounce.pdf > 0.0);
        assert_eq!(bounce.value, endless.apparent(points[index].uv, bounce.wi, wo));
    }
}

#[test]
fn a_weave_is_lost_but_grains_are_not() {
    let weave = btf(|texel, wi, _| {
        let (x, y) = (texel % SIDE / 4, texel / SIDE / 4);
        [if (x + y) % 4 < 2 { 0.8 } else { 0.2 } * wi.z; 3]
    });
    let (grains, weave) = (endless(&grains()).loss(), endless(&weave).loss());
    assert!(grains < Endless::LOST && weave > Endless::LOST && weave > 1.5 * grains, "grains {grains}, weave {weave}");
}
