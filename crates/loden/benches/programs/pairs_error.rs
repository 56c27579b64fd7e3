//! Measures BTFs with their own list of pairs: how well random pairs predict others that were not measured.
//!
//! Usage: `pairs_error SAMPLE [COUNT [SIZE]]`. The virtual goniometer measures a built-in sample at so many random pairs of
//! directions within 75 degrees of the normal, 300 by default, and at 300 others. The first are compressed by several
//! methods, and their materials evaluated at the others, at the centres of all texels. Prints a Markdown table: bytes, the
//! ratio to the 8-bit values of the measured pairs, the mean error of their display values, and the mean difference over the
//! mean value in linear light at the other pairs; for comparison that of the nearest measured pair, as it is and scaled by
//! the cosines of the lights.

use glam::{Vec2, Vec3};
use loden::acquire::{self, HeightField, Options};
use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use loden::codec::{self, Finish, Goal};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme};
use loden::material::{Material, RawBtf};
use loden::params::Values;
use loden::progress::Silent;

const METHODS: [(&str, &[(&str, &str)]); 5] = [
    ("pvmf", &[("components", "16")]),
    ("pca", &[("components", "16")]),
    ("klt", &[]),
    ("kmeans", &[("clusters", "64")]),
    ("analytic", &[]),
];

/// Number of pairs that are not measured.
const OTHERS: usize = 300;
/// Largest angle from the normal, in degrees.
const LOWEST: f64 = 75.0;

/// Random pairs: theta and phi of light and view in degrees, uniform per solid angle.
fn random_pairs(count: usize, state: &mut u64) -> Vec<[f64; 4]> {
    let mut unit = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut angles = || {
        let height = 1.0 - unit() * (1.0 - LOWEST.to_radians().cos());
        [height.acos().to_degrees(), 360.0 * unit()]
    };
    (0..count).map(|_| [angles(), angles()]).map(|[light, view]| [light[0], light[1], view[0], view[1]]).collect()
}

/// The images of these pairs, of display values as photographs have them.
fn measured(field: &HeightField, pairs: &[[f64; 4]], options: &Options) -> loden::Result<MemoryBtf> {
    let mut values = Vec::new();
    for &[tl, pl, tv, pv] in pairs {
        let [view, light] = [[tv, pv], [tl, pl]].map(|direction| DirectionSet::from_degrees(vec![direction]));
        acquire::acquire(field, &view?, &light?, options, &Silent, &mut |_, image| {
            values.extend(image.into_iter().map(|v| Encoding::Srgb.encode(v)));
            Ok(())
        })?;
    }
    let meta = BtfMeta {
        width: options.size,
        height: options.size,
        views: DirectionSet::normal(),
        lights: DirectionSet::of_pairs(pairs)?,
        encoding: Encoding::Srgb,
        cosine: Cosine::Included,
        sample_type: SampleType::F32,
    };
    MemoryBtf::new(meta, Texels::F32(values.into()))
}

/// The relative difference of values from the truth over all texels and pairs.
fn error(truth: &MemoryBtf, value: impl Fn(Vec2, Vec3, Vec3, usize) -> Vec3) -> loden::Result<f64> {
    let meta = truth.meta();
    let (mut difference, mut whole) = (0.0f64, 0.0f64);
    for light in 0..meta.lights.len() {
        let (wi, wo) = meta.pair(0, light);
        for (texel, rgb) in truth.image(0, light)?.to_f32().as_chunks::<3>().0.iter().enumerate() {
            let (x, y) = ((texel % meta.width) as f32 + 0.5, (texel / meta.width) as f32 + 0.5);
            let uv = Vec2::new(x / meta.width as f32, 1.0 - y / meta.height as f32);
            let truth = Vec3::from_array(rgb.map(|v| meta.encoding.decode(v)));
            difference += f64::from((value(uv, wi, wo, texel) - truth).abs().element_sum());
            whole += f64::from(truth.element_sum());
        }
    }
    Ok(difference / whole)
}

/// The value of the nearest measured pair, if asked for scaled by the cosines of the lights.
fn nearest(known: &MemoryBtf, scaled: bool, texel: usize, wi: Vec3, wo: Vec3) -> loden::Result<Vec3> {
    let meta = known.meta();
    let (view, light) = meta.nearest_pair(wi, wo);
    let cosine = if scaled { wi.z / meta.pair(view, light).0.z } else { 1.0 };
    let image = known.image(view, light)?;
    let rgb = image.part(3 * texel..3 * texel + 3);
    Ok(Vec3::from_slice(&rgb.to_f32()).map(|v| meta.encoding.decode(v)) * cosine)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize, default| words.get(at).map_or(Ok(default), |word| word.parse::<usize>());
    let name = words.first().ok_or("usage: pairs_error SAMPLE [COUNT [SIZE]]")?;
    let sample = acquire::named(name).ok_or("SAMPLE is no built-in sample")?;
    let options = Options { size: number(2, 32)?, ..Options::default() };
    let field = sample.build(&Values::defaults(sample.params()), 512, options.seed)?;
    let state = &mut 1;
    let known = measured(&field, &random_pairs(number(1, 300)?, state), &options)?;
    let truth = measured(&field, &random_pairs(OTHERS, state), &options)?;
    println!(
        "| method | bytes | raw / bytes | error of display values | error at other pairs |\n|---|---|---|---|---|"
    );
    for (name, scaled) in [("nearest pair", false), ("nearest pair, scaled by the cosines of the lights", true)] {
        let of_nearest = |_, wi, wo, texel| nearest(&known, scaled, texel, wi, wo).unwrap_or(Vec3::NAN);
        println!("| {name} | | | | {:.3} |", error(&truth, of_nearest)?);
    }
    let raw = RawBtf::new(&known as &dyn BtfSource, Scheme::Triangles)?;
    println!("| images | | | | {:.3} |", error(&truth, |uv, wi, wo, _| raw.apparent(uv, wi, wo))?);
    let folder = tempfile::tempdir()?;
    for (name, given) in METHODS {
        let (codec, path) = (codec::by_name(name)?, folder.path().join(name));
        let params = Values::new(codec.params(), given.iter().copied())?;
        let finish = Finish { measure: true, lossless: None };
        let done = codec::compress(codec, &known, &params, Goal::Params, finish, &path, &Silent)?;
        let material = codec::open(&path)?.material(Scheme::Triangles)?;
        let of_pairs = done.error.map_or(f64::NAN, |report| report.mean_abs_error);
        let ratio = known.meta().raw8_bytes() as f64 / done.bytes as f64;
        let of_others = error(&truth, |uv, wi, wo, _| material.apparent(uv, wi, wo))?;
        println!("| {name} | {} | {ratio:.1} | {of_pairs:.4} | {of_others:.3} |", done.bytes);
    }
    Ok(())
}
