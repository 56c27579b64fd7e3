//! Parts of all codecs: what fast decoders and materials make of them is what the interpreter makes of them, and they
//! can be taken out, changed, stored and read again.

mod damage;
mod own;

use std::fs;
use std::path::Path;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, Rect, SampleType, Texels};
use loden::codec::parts::{MemoryParts, Numbers, Parts, folder, store};
use loden::codec::{self, CODECS, Codec, Decoded, Finish, Goal};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme, from_angles};
use loden::material::{Blending, Interpolation, Material, RawBtf};
use loden::params::{Kind, Values};
use loden::picture::Picture;
use loden::progress::Silent;
use loden::render::{Lighting, Settings, Studio, TextureMap, object, studio};

const SIZE: [usize; 2] = [7, 5];

/// Odd sizes, rings of directions that differ for views and lights, texels of several kinds.
fn source(sample_type: SampleType, encoding: Encoding, cosine: Cosine) -> MemoryBtf {
    let ring = |count: usize, theta: f64| (0..count).map(move |i| [theta, 360.0 * i as f64 / count as f64]);
    let set = |rings: &[(usize, f64)]| {
        DirectionSet::from_degrees(rings.iter().flat_map(|&(count, theta)| ring(count, theta)).collect()).unwrap()
    };
    let [width, height] = SIZE;
    let (views, lights) = (set(&[(1, 0.0), (3, 40.0)]), set(&[(1, 0.0), (4, 35.0), (5, 70.0)]));
    let meta = BtfMeta { width, height, views, lights, encoding, cosine, sample_type };
    let mut values = Vec::new();
    for (wo, wi) in meta.views.directions().iter().flat_map(|v| meta.lights.directions().iter().map(move |l| (*v, *l)))
    {
        for i in 0..meta.image_len() {
            let (texel, channel) = (i / 3, (i % 3) as f32);
            let kind = (texel * 7 % 5) as f32;
            let gloss = (wi + wo).normalize().z.powf(5.0 + 3.0 * kind);
            let value = wi.z * (0.25 + 0.05 * kind + 0.04 * channel) + 0.4 * gloss + 0.05 * (texel as f32).sin();
            values.push(value.clamp(0.01, 0.98));
        }
    }
    let texels = match sample_type {
        SampleType::U8 => Texels::U8(values.iter().map(|v| (v * 255.0) as u8).collect()),
        _ => Texels::F32(values.into()),
    };
    MemoryBtf::new(meta, texels).unwrap()
}

/// The words of a parameter, or none if the codec does not have it.
fn words(codec: &dyn Codec, name: &str) -> Vec<Option<&'static str>> {
    match codec.params().iter().find(|param| param.name == name).map(|param| param.kind) {
        Some(Kind::Choice(words)) => words.iter().copied().map(Some).collect(),
        _ => vec![None],
    }
}

/// Parameters for few components and clusters, and those that are given.
fn params(codec: &dyn Codec, given: &[(&str, Option<&'static str>)]) -> Values {
    let samples = if codec.name() == "neural" { "0.05" } else { "20" };
    let few = [
        ("components", "3"),
        ("chroma", "2"),
        ("clusters", "4"),
        ("resolution", "3"),
        ("samples", samples),
        ("width", "8"),
    ];
    let known = |(name, _): &(&str, &str)| codec.params().iter().any(|param| param.name == *name);
    let given = given.iter().filter_map(|(name, word)| Some((*name, (*word)?)));
    Values::new(codec.params(), few.into_iter().filter(known).chain(given)).unwrap()
}

/// Every codec in every precision and domain it has.
fn cases() -> Vec<(&'static dyn Codec, Values)> {
    let mut cases = Vec::new();
    for codec in CODECS {
        for precision in words(*codec, "precision") {
            for domain in words(*codec, "domain") {
                cases.push((*codec, params(*codec, &[("precision", precision), ("domain", domain)])));
            }
        }
    }
    let products = codec::by_name("cmf").unwrap();
    for [factors, terms] in [["3", "2"], ["4", "1"], ["4", "2"]] {
        cases.push((products, params(products, &[("factors", Some(factors)), ("terms", Some(terms))])));
    }
    cases
}

fn direction(i: usize) -> Vec3 {
    let i = i as f32;
    // one in nine is below the surface
    from_angles(if i % 9.0 == 8.0 { 1.7 } else { (i * 0.377).fract() * 1.55 }, i * 2.4)
}

fn uv(i: usize) -> Vec2 {
    Vec2::new(i as f32 * 0.618, 1.0 - i as f32 * 0.414)
}

/// Fast decoders add up in single precision, the interpreter in double: values differ by their rounding, which the steep
/// end of an encoding near black magnifies by up to 13.
const ROUNDING: f32 = 3e-5;

/// Coefficients of `klt` are evaluated as 16-bit fractions.
const FIXED_POINT: f32 = 4e-3;

fn same(fast: &Decoded, slow: &Decoded, tolerance: f32, about: &str) {
    let meta = fast.meta();
    for view in 0..meta.views.len() {
        let (a, b) = (fast.view(view).unwrap(), slow.view(view).unwrap());
        for (i, (a, b)) in a.to_f32().iter().zip(b.to_f32().iter()).enumerate() {
            assert!((a - b).abs() < ROUNDING * b.abs().max(1.0), "{about} view {view} number {i}: {a} {b}");
        }
        let image = fast.image(view, 3).unwrap();
        assert!(*image.to_f32() == a.to_f32()[3 * meta.image_len()..4 * meta.image_len()], "{about}");
    }
    let schemes = [Scheme::Triangles, Scheme::Rings];
    for (scheme, &blending) in schemes.into_iter().flat_map(|s| Blending::ALL.iter().map(move |b| (s, b))) {
        let how = Interpolation { scheme, blending };
        let (fast, slow) = (fast.material(how).unwrap(), slow.material(how).unwrap());
        let about = format!("{about} {blending}");
        let mut seen = 0;
        for i in 0..200 {
            let (uv, wi, wo) = (uv(i), direction(i), direction(7 * i + 3));
            let (a, b) = (fast.apparent(uv, wi, wo), slow.apparent(uv, wi, wo));
            let bound = tolerance * b.abs().max_element().max(1.0);
            assert!((a - b).abs().max_element() < bound, "{about} {scheme:?} {i}: {a} {b}");
            assert!(b == Vec3::ZERO || wi.z > 0.0 && wo.z > 0.0, "{about} {scheme:?} {i}: light from below");
            seen += usize::from(b.max_element() > 0.01);
        }
        assert!(seen > 100, "{about} {scheme:?}: only {seen} values are not black");
    }
}

#[test]
fn fast_decoders_and_materials_are_the_interpreter() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let sources = [
        source(SampleType::U8, Encoding::Srgb, Cosine::Included),
        source(SampleType::F32, Encoding::Linear, Cosine::Excluded),
    ];
    for (codec, params) in cases() {
        for source in &sources {
            codec.encode(source, &params, &path, &Silent).unwrap();
            let btf = codec::open(&path).unwrap();
            let slow = Decoded::interpreted(btf.parts().clone()).unwrap();
            let text: Vec<_> = params.iter().collect();
            let about = format!("{} {:?} {text:?}", codec.name(), source.meta().sample_type);
            println!("{about}");
            let tolerance = if codec.name() == "klt" { FIXED_POINT } else { ROUNDING };
            same(btf.decoded(), &slow, tolerance, &about);
            // the parts alone are enough for a fast decoder
            let copy = MemoryParts::copy(&**btf.parts()).unwrap();
            same(&Decoded::new(Arc::new(copy)).unwrap(), &slow, ROUNDING, &about);
        }
    }
}

#[test]
fn a_cluster_for_every_texel_is_the_images_in_light_and_as_stored() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    for (encoding, cosine) in [(Encoding::Srgb, Cosine::Included), (Encoding::Gamma(1.8), Cosine::Excluded)] {
        let source = source(SampleType::F32, encoding, cosine);
        let codec = codec::by_name("kmeans").unwrap();
        let clusters = source.meta().texels().to_string();
        let params = Values::new(codec.params(), [("clusters", &*clusters), ("precision", "f32")]).unwrap();
        codec.encode(&source, &params, &path, &Silent).unwrap();
        let btf = codec::open(&path).unwrap();
        let mut differ = 0;
        let values = |blending: Blending| -> Vec<Vec3> {
            let how = Interpolation { scheme: Scheme::Triangles, blending };
            let images = RawBtf::new(&source as &dyn BtfSource, how).unwrap();
            let clusters = btf.material(how).unwrap();
            let value = |i: usize| {
                let (wi, wo) = (direction(i), direction(7 * i + 3));
                let (a, b) = (images.apparent(uv(i), wi, wo), clusters.apparent(uv(i), wi, wo));
                assert!((a - b).abs().max_element() < ROUNDING * a.max_element().max(1.0), "{blending} {i}: {a} {b}");
                a
            };
            (0..200).map(value).collect()
        };
        let [auto, linear, stored] = [Blending::Auto, Blending::Linear, Blending::Stored].map(values);
        assert_eq!(auto, linear);
        for (linear, stored) in linear.iter().zip(&stored) {
            // the curves are convex
            assert!(linear.cmpge(*stored - 1e-6).all(), "{linear} {stored}");
            differ += usize::from(linear.x > 1.001 * stored.x);
        }
        assert!(differ > 100, "{differ}");
    }
}

#[test]
fn uniform_materials_stay_uniform() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let meta = source(SampleType::U8, Encoding::Srgb, Cosine::Included).meta().clone();
    for stored in [0u8, 120] {
        let texels = vec![stored; meta.views.len() * meta.view_len()];
        let source = MemoryBtf::new(meta.clone(), Texels::U8(texels.into())).unwrap();
        // An analytic model must follow the cosine of every light.
        for (codec, params) in cases().into_iter().filter(|(codec, _)| codec.name() != "analytic") {
            codec.encode(&source, &params, &path, &Silent).unwrap();
            let about = format!("{} {:?} {stored}", codec.name(), params.iter().collect::<Vec<_>>());
            let btf = codec::open(&path).unwrap();
            let image = btf.image(1, 2).unwrap().to_f32().into_owned();
            let expected = f32::from(stored) / 255.0;
            assert!(image.iter().all(|v| (v - expected).abs() < 0.01), "{about}: {}", image[0]);
            let material = btf.material(Scheme::Triangles).unwrap();
            for i in 0..20 {
                let (wi, wo) = (from_angles(0.5, i as f32), from_angles(0.3, 2.0 * i as f32));
                let found = material.apparent(uv(i), wi, wo);
                let linear = Encoding::Srgb.decode(expected);
                assert!((found - linear).abs().max_element() < 0.01, "{about} {i}: {found}, expected {linear}");
            }
        }
    }
}

fn compress(codec: &dyn Codec, params: &Values, source: &MemoryBtf, lossless: Option<&str>, path: &Path) {
    let lossless = lossless.map(|name| codec::lossless::by_name(name).unwrap());
    let finish = Finish { measure: true, lossless };
    codec::compress(codec, source, params, Goal::Params, finish, path, &Silent).unwrap();
}

#[test]
fn parts_are_stored_and_written_as_files_and_come_back() {
    let temporary = tempfile::tempdir().unwrap();
    let [path, again, parts] = ["x.loden", "again.loden", "parts"].map(|name| temporary.path().join(name));
    let source = source(SampleType::U8, Encoding::Srgb, Cosine::Included);
    for (i, (codec, params)) in cases().into_iter().enumerate() {
        let about = format!("{} {:?}", codec.name(), params.iter().collect::<Vec<_>>());
        compress(codec, &params, &source, [None, Some("zstd")][i % 2], &path);
        let btf = codec::open(&path).unwrap();
        let from = btf.provenance().unwrap();
        let files = folder::write(&**btf.parts(), &from, &parts).unwrap();
        assert_eq!(files, fs::read_dir(&parts).unwrap().count(), "{about}");
        let (read, said) = folder::read_folder(&parts).unwrap();
        assert_eq!(said, from, "{about}");
        assert!(read == MemoryParts::copy(&read).unwrap());
        for parts in [&**btf.parts(), &read as &dyn Parts] {
            let bytes = store(parts, &from, &again).unwrap();
            assert_eq!(bytes, fs::metadata(&again).unwrap().len());
            if codec.decoder().is_none() {
                assert!(fs::read(&path).unwrap() == fs::read(&again).unwrap(), "{about}: another file");
            } else {
                let stored = codec::open(&again).unwrap();
                assert_eq!((stored.method(), stored.error()), ("parts", btf.error()));
                same(stored.decoded(), &Decoded::interpreted(btf.parts().clone()).unwrap(), ROUNDING, &about);
            }
        }
        fs::remove_dir_all(&parts).unwrap();
    }
}

#[test]
fn one_material_wears_the_tables_of_another() {
    let temporary = tempfile::tempdir().unwrap();
    let path = |name: &str| temporary.path().join(name);
    let texels = source(SampleType::U8, Encoding::Srgb, Cosine::Included);
    // half as bright
    let dark: Vec<u8> = (0..texels.meta().views.len())
        .flat_map(|view| texels.view(view).unwrap().to_f32().iter().map(|v| (v * 127.0) as u8).collect::<Vec<_>>())
        .collect();
    let dark = MemoryBtf::new(texels.meta().clone(), Texels::U8(dark.into())).unwrap();
    for name in ["kmeans", "cmf", "pvmf", "pca", "pcmf"] {
        let codec = codec::by_name(name).unwrap();
        // clusters that no texel uses any more are left out: do not refine them
        let given: &[_] = if name == "cmf" { &[("rounds", Some("0"))] } else { &[] };
        let params = params(codec, given);
        compress(codec, &params, &texels, None, &path("a.loden"));
        compress(codec, &params, &dark, None, &path("b.loden"));
        let [a, b] = ["a.loden", "b.loden"].map(|name| codec::open(path(name)).unwrap());
        let mut parts = MemoryParts::copy(&**a.parts()).unwrap();
        for table in 0..b.parts().recipe().tables.len() {
            parts.set_table(table, b.parts().table(table).unwrap()).unwrap();
        }
        let from = a.provenance().unwrap();
        store(&parts, &from, &path("c.loden")).unwrap();
        let c = codec::open(path("c.loden")).unwrap();
        assert_eq!(c.method(), name);
        assert!(a.error().is_some() && c.error().is_none(), "{name}: the error is that of other parts");
        let mean = |btf: &dyn BtfSource| {
            let values = btf.view(0).unwrap().to_f32().into_owned();
            values.iter().sum::<f32>() / values.len() as f32
        };
        assert!(mean(&*c) < 0.8 * mean(&*a), "{name}: {} {}", mean(&*c), mean(&*a));
        let slow = Decoded::interpreted(Arc::new(parts)).unwrap();
        same(c.decoded(), &slow, ROUNDING, name);
        // and on an object
        let [bright, dark, slow] = [a.decoded(), c.decoded(), &slow].map(rendered);
        assert!(brightness(&dark) < 0.9 * brightness(&bright), "{name}");
        assert!((brightness(&dark) - brightness(&slow)).abs() < 1e-3, "{name}");
    }
}

fn rendered(parts: &Decoded) -> Picture {
    let material = parts.material(Scheme::Triangles).unwrap();
    let scene = Studio {
        object: &object::load("sphere").unwrap(),
        material: &*material,
        material_name: "parts",
        texture: TextureMap::default(),
        lighting: Lighting::Key { theta_degrees: 40.0, phi_degrees: 120.0 },
    };
    studio(&scene, &Settings { width: 24, height: 18, spp: 4, ..Settings::default() }, &Silent).unwrap()
}

fn brightness(picture: &Picture) -> f32 {
    picture.rgb.iter().map(|rgb| rgb.element_sum()).sum::<f32>() / (3 * picture.rgb.len()) as f32
}

#[test]
fn planes_are_rearranged_to_another_size() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("x.loden");
    let codec = codec::by_name("pcmf").unwrap();
    codec
        .encode(&source(SampleType::U8, Encoding::Srgb, Cosine::Included), &params(codec, &[]), &path, &Silent)
        .unwrap();
    let btf = codec::open(&path).unwrap();
    let [width, height] = SIZE;
    // every texel twice beside itself, upside down
    let meta = BtfMeta { width: 2 * width, ..btf.meta().clone() };
    let texel = |i: usize| (height - 1 - i / (2 * width)) * width + i % (2 * width) / 2;
    let planes = btf.parts().recipe().planes.iter().enumerate().map(|(plane, spec)| {
        let rearranged = (0..meta.texels()).map(|i| {
            let (x, y) = (texel(i) % width, texel(i) / width);
            btf.parts().plane(plane, 0, Rect { x, y, width: 1, height: 1 }).unwrap()
        });
        let numbers = Numbers::concat(&rearranged.collect::<Vec<_>>()).unwrap();
        assert_eq!(numbers.len(), meta.texels() * spec.count());
        numbers
    });
    let tables = (0..btf.parts().recipe().tables.len()).map(|table| btf.parts().table(table).unwrap()).collect();
    let parts = MemoryParts::new(meta.clone(), btf.parts().recipe().clone(), planes.collect(), tables).unwrap();
    store(&parts, &btf.provenance().unwrap(), &path).unwrap();
    let large = codec::open(&path).unwrap();
    let (before, after) = (btf.image(1, 2).unwrap(), large.image(1, 2).unwrap());
    for i in 0..meta.texels() {
        assert_eq!(after.to_f32()[3 * i..3 * i + 3], before.to_f32()[3 * texel(i)..3 * texel(i) + 3]);
    }
}
