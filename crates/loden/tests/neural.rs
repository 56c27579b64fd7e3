//! The codec `neural` finds relief: a texture on a bump seen from several directions, right and mirrored.

use glam::{Vec2, Vec3};
use loden::btf::{BtfMeta, Cosine, MemoryBtf, SampleType, Texels};
use loden::codec::parts::Expr;
use loden::codec::{self, Finish, Goal, Outcome};
use loden::color::Encoding;
use loden::direction::DirectionSet;
use loden::params::Values;
use loden::progress::Silent;

const SIDE: usize = 24;

/// Height in texels, and colour, of a periodic surface.
fn height(at: Vec2) -> f32 {
    let [x, y] = [at.x, at.y].map(|v| (std::f32::consts::TAU * v / SIDE as f32).cos());
    1.5 * x * y
}

fn colour(at: Vec2) -> Vec3 {
    let wave = |fx: f32, fy: f32| (std::f32::consts::TAU * (fx * at.x + fy * at.y) / SIDE as f32).sin();
    Vec3::new(0.5 + 0.4 * wave(4.0, 1.0), 0.5 + 0.4 * wave(-1.0, 5.0), 0.5 + 0.4 * wave(3.0, -3.0))
}

/// Each texel shows where the viewer's ray meets the surface.
fn relief(mirror: bool) -> MemoryBtf {
    let ring = |count: usize, theta: f64| (0..count).map(move |i| [theta, 360.0 * i as f64 / count as f64]);
    let views = DirectionSet::from_degrees(ring(1, 0.0).chain(ring(6, 30.0)).chain(ring(8, 60.0)).collect()).unwrap();
    let lights = DirectionSet::from_degrees(ring(1, 0.0).chain(ring(4, 45.0)).collect()).unwrap();
    let (encoding, cosine, sample_type) = (Encoding::Srgb, Cosine::Included, SampleType::U8);
    let meta = BtfMeta { width: SIDE, height: SIDE, views, lights, encoding, cosine, sample_type };
    let mut values = Vec::new();
    for (wo, wi) in
        meta.views.directions().iter().flat_map(|wo| meta.lights.directions().iter().map(move |wi| (wo, wi)))
    {
        let slope = Vec2::new(wo.x, if mirror { wo.y } else { -wo.y }) / wo.z;
        for texel in 0..meta.texels() {
            let centre = Vec2::new((texel % SIDE) as f32, (texel / SIDE) as f32);
            let met = (0..50).fold(centre, |at, _| centre + slope * height(at));
            values.extend((colour(met) * wi.z * 255.0).to_array().map(|v| v.round() as u8));
        }
    }
    MemoryBtf::new(meta, Texels::U8(values.into())).unwrap()
}

#[test]
fn heights_follow_the_parallax_right_and_mirrored() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let codec = codec::by_name("neural").unwrap();
    for mirror in [false, true] {
        let source = relief(mirror);
        let compressed = |flat: &str| -> Outcome {
            let params = [("features", "4"), ("width", "16"), ("samples", "0.4"), ("flat", flat)];
            let params = Values::new(codec.params(), params).unwrap();
            let finish = Finish { measure: true, lossless: None };
            codec::compress(codec, &source, &params, Goal::Params, finish, &path, &Silent).unwrap()
        };
        let flat = compressed("yes").error.unwrap().mean_abs_error;
        assert!(matches!(codec::open(&path).unwrap().parts().recipe().value, Expr::Network { .. }));
        let shifted = compressed("no").error.unwrap().mean_abs_error;
        let opened = codec::open(&path).unwrap();
        let Expr::Shift { mirror: found, .. } = opened.parts().recipe().value else { panic!("no shift") };
        assert_eq!(found, mirror);
        println!("mirrored {mirror}: {shifted:.4} with parallax, {flat:.4} without");
        assert!(shifted < 0.7 * flat, "mirrored {mirror}: {shifted} with parallax, {flat} without");
    }
}
