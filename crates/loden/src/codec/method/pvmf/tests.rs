use std::borrow::Cow;

use glam::{Vec2, Vec3};
use half::f16;
use proptest::prelude::*;

use super::*;
use crate::btf::{BtfMeta, Cosine, MemoryBtf, SampleType, Texels};
use crate::codec::form::factored::{FactoredBtf, FactoredMaterial};
use crate::codec::open;
use crate::color::Encoding;
use crate::direction::{DirectionSet, Scheme};
use crate::material::angles::texel_centre;
use crate::material::{Blending, Interpolation, Material, Point, RawBtf};
use crate::metric::compare;
use crate::progress::Silent;
use crate::simd::portable;

fn meta(width: usize, height: usize, sample_type: SampleType) -> BtfMeta {
    let degrees = vec![[0.0, 0.0], [40.0, 10.0], [40.0, 130.0], [40.0, 250.0], [70.0, 60.0]];
    BtfMeta {
        width,
        height,
        views: DirectionSet::from_degrees(degrees[..4].to_vec()).unwrap(),
        lights: DirectionSet::from_degrees(degrees).unwrap(),
        encoding: Encoding::Srgb,
        cosine: Cosine::Included,
        sample_type,
    }
}

/// A smooth pattern with some noise: a few components dominate, but all are present.
fn values(meta: &BtfMeta, seed: u32) -> Vec<f32> {
    let mut state = seed;
    let n = meta.views.len() * meta.view_len();
    let noise = (0..n).map(|i| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let texel = i % meta.image_len() / 3;
        let light = i / meta.image_len();
        let smooth = (texel as f32 * 0.31).sin() * (light as f32).cos() + (texel as f32 * 0.07).cos();
        (0.5 + 0.2 * smooth + 0.1 * ((state >> 8) as f32 / (1 << 24) as f32 - 0.5)).clamp(0.0, 1.0)
    });
    noise.collect()
}

fn source(meta: BtfMeta, seed: u32) -> MemoryBtf {
    let values = values(&meta, seed);
    let texels = match meta.sample_type {
        SampleType::U8 => Texels::U8(Cow::Owned(values.iter().map(|v| (v * 255.0).round() as u8).collect())),
        SampleType::F16 => Texels::F16(Cow::Owned(values.iter().map(|&v| f16::from_f32(v)).collect())),
        SampleType::F32 => Texels::F32(Cow::Owned(values)),
    };
    MemoryBtf::new(meta, texels).unwrap()
}

struct Encoded {
    _folder: tempfile::TempDir,
    path: std::path::PathBuf,
}

fn encode(source: &dyn BtfSource, params: &[(&str, &str)]) -> Result<Encoded> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let values = Values::new(Settings::TABLE, params.iter().copied())?;
    let summary = Pvmf.encode(source, &values, &path, &Silent)?;
    assert_eq!(summary.bytes, std::fs::metadata(&path).unwrap().len());
    Ok(Encoded { _folder: folder, path })
}

fn largest_difference(a: &dyn BtfSource, b: &dyn BtfSource) -> f32 {
    let mut largest = 0.0f32;
    for view in 0..a.meta().views.len() {
        let (a, b) = (a.view(view).unwrap(), b.view(view).unwrap());
        assert_eq!(a.len(), b.len());
        for (a, b) in a.to_f32().iter().zip(b.to_f32().iter()) {
            largest = largest.max((a - b).abs());
        }
    }
    largest
}

#[test]
fn full_rank_reproduces_the_source() {
    for sample_type in [SampleType::U8, SampleType::F16, SampleType::F32] {
        for domain in ["display", "linear", "log"] {
            let source = source(meta(9, 7, sample_type), 1);
            let file = encode(&source, &[("components", "15"), ("precision", "f32"), ("domain", domain)]).unwrap();
            let error = largest_difference(&source, &*open(&file.path).unwrap());
            assert!(error < 2e-5, "{sample_type:?} {domain}: {error}");
        }
    }
}

#[test]
fn error_falls_with_components_and_precision_costs_little() {
    let source = source(meta(16, 12, SampleType::U8), 2);
    let error = |components: &str, precision: &str| {
        let file = encode(&source, &[("components", components), ("precision", precision)]).unwrap();
        compare(&source, &*open(&file.path).unwrap(), &Silent).unwrap()
    };
    let errors = ["1", "2", "4", "8", "15"].map(|c| error(c, "f32"));
    assert!(errors.windows(2).all(|w| w[1].rmse < w[0].rmse), "{errors:?}");
    assert!(errors.windows(2).all(|w| w[1].ssim > w[0].ssim), "{errors:?}");
    // a coefficient's range is below 4 here, so half a step of 8 bits is below 0.008, spread over components
    for (precision, bound) in [("f16", 2e-4), ("u8", 5e-3)] {
        let cost = (error("4", precision).rmse - errors[2].rmse).abs();
        assert!(cost < bound, "{precision}: {cost}");
    }
}

#[test]
fn bytes_do_not_depend_on_threads() {
    for (sample_type, precision) in [(SampleType::U8, "u8"), (SampleType::F32, "f16"), (SampleType::F16, "f32")] {
        let source = source(meta(40, 30, sample_type), 3);
        let bytes = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let encoded = pool.install(|| encode(&source, &[("precision", precision)]).unwrap());
            std::fs::read(&encoded.path).unwrap()
        };
        assert_eq!(bytes(1), bytes(2));
    }
}

#[test]
fn components_beyond_the_rank_are_refused_with_the_limit() {
    for (size, limit) in [((9, 7), 15), ((3, 2), 5), ((1, 1), 1)] {
        let source = source(meta(size.0, size.1, SampleType::U8), 4);
        assert!(encode(&source, &[("components", &limit.to_string())]).is_ok());
        let error = encode(&source, &[("components", &(limit + 1).to_string())]).map(drop).unwrap_err().to_string();
        assert!(error.starts_with("components: ") && error.contains(&format!("at most {limit} ")), "{error}");
    }
}

#[test]
fn numbers_that_are_not_finite_or_do_not_fit_are_refused() {
    let meta = meta(4, 4, SampleType::F32);
    let mut numbers = values(&meta, 5);
    numbers[300] = f32::NAN;
    let btf = |numbers: Vec<f32>| MemoryBtf::new(meta.clone(), Texels::F32(Cow::Owned(numbers))).unwrap();
    let error = encode(&btf(numbers.clone()), &[]).map(drop).unwrap_err().to_string();
    assert!(error.contains("view 1"), "{error}");
    numbers[300] = 1e9;
    assert!(encode(&btf(numbers.clone()), &[("precision", "f32")]).is_ok());
    let error = encode(&btf(numbers), &[("precision", "f16")]).map(drop).unwrap_err().to_string();
    assert!(error.starts_with("precision: "), "{error}");
}

#[test]
fn images_views_and_portable_code_agree() {
    // wide enough for several blocks, with an image that ends inside a block
    let source = source(meta(61, 83, SampleType::U8), 6);
    for (precision, c) in [("f32", "3"), ("f16", "4"), ("u8", "9")] {
        let file = encode(&source, &[("precision", precision), ("components", c)]).unwrap();
        let btf = open(&file.path).unwrap();
        for view in [0, 3] {
            let whole = btf.view(view).unwrap();
            assert_eq!(portable(|| btf.view(view).unwrap()), whole);
            for light in 0..5 {
                let image = btf.image(view, light).unwrap();
                let len = btf.meta().image_len();
                assert_eq!(&whole.to_f32()[light * len..(light + 1) * len], &*image.to_f32());
            }
        }
        assert!(btf.decode_view(4, &mut []).is_err() && btf.decode_view(0, &mut [0.0]).is_err());
        assert!(btf.image(0, 5).is_err());
    }
}

#[test]
fn streamed_views_equal_images() {
    // above the size from which stores bypass the caches
    let source = source(meta(300, 260, SampleType::U8), 7);
    let file = encode(&source, &[("components", "2")]).unwrap();
    let btf = open(&file.path).unwrap();
    let view = btf.view(2).unwrap();
    let len = btf.meta().image_len();
    let mut unaligned = vec![0.0; 5 * len + 1];
    btf.decode_view(2, &mut unaligned[1..]).unwrap();
    assert_eq!(&unaligned[1..], &*view.to_f32());
    for light in 0..5 {
        assert_eq!(&view.to_f32()[light * len..][..len], &*btf.image(2, light).unwrap().to_f32());
    }
}

fn material(path: &Path) -> FactoredMaterial {
    blended(path, Blending::Stored)
}

fn blended(path: &Path, blending: Blending) -> FactoredMaterial {
    let btf = FactoredBtf::new(&**open(path).unwrap().parts()).unwrap().unwrap();
    FactoredMaterial::new(&btf, Interpolation { scheme: Scheme::Triangles, blending }).unwrap()
}

#[test]
fn evaluation_at_samples_is_the_decoded_image() {
    let (width, height) = (6, 5);
    for cosine in [Cosine::Included, Cosine::Excluded] {
        for (precision, c, domain) in [("f32", "4", "display"), ("f16", "9", "linear"), ("u8", "5", "log")] {
            let meta = BtfMeta { cosine, ..meta(width, height, SampleType::U8) };
            let source = source(meta, 8);
            let file = encode(&source, &[("precision", precision), ("components", c), ("domain", domain)]).unwrap();
            let btf = open(&file.path).unwrap();
            let (material, meta) = (material(&file.path), btf.meta());
            let shared = btf.clone().material(Scheme::Triangles).unwrap();
            for (v, l, t) in (0..4).flat_map(|v| (0..5).flat_map(move |l| (0..30).map(move |t| (v, l, t)))) {
                let (wo, wi) = (meta.views.directions()[v], meta.lights.directions()[l]);
                let image = btf.image(v, l).unwrap();
                let stored = Vec3::from_slice(&image.to_f32()[3 * t..]);
                let factor = if cosine == Cosine::Included { 1.0 } else { wi.z };
                let expected = stored.map(|x| meta.encoding.decode(x).max(0.0)) * factor;
                let uv = Vec2::new(
                    ((t % width) as f32 + 0.5) / width as f32,
                    1.0 - ((t / width) as f32 + 0.5) / height as f32,
                );
                let found = [
                    material.apparent(uv, wi, wo),
                    at_once(&material, &[(uv, wi, wo)])[0],
                    shared.apparent(uv, wi, wo),
                    portable(|| material.apparent(uv, wi, wo)),
                ];
                for found in found {
                    assert!(found.distance(expected) < 2e-5, "{precision} {domain} {v} {l} {t}: {found} {expected}");
                }
            }
            assert_eq!(material.apparent(Vec2::ZERO, -Vec3::Z, Vec3::Z), Vec3::ZERO);
            assert_eq!(material.apparent(Vec2::ZERO, Vec3::Z, Vec3::NAN), Vec3::ZERO);
        }
    }
}

#[test]
fn batches_equal_single_evaluations() {
    let source = source(meta(8, 8, SampleType::U8), 9);
    let file = encode(&source, &[]).unwrap();
    let material = material(&file.path);
    let direction =
        |i: usize| Vec3::new((i as f32).sin(), (i as f32 * 0.7).cos(), 0.6 - (i % 3) as f32 * 0.4).normalize();
    let centre = |texel: usize| texel_centre(texel, 8, 8);
    let anywhere = |i: usize| Vec2::new(0.37 * i as f32, 0.61 * i as f32);
    for place in [&centre as &dyn Fn(usize) -> Vec2, &anywhere] {
        let queries: Vec<_> = (0..100).map(|i| (place(i * 13 % 64), direction(i), direction(i + 1))).collect();
        for ((uv, wi, wo), found) in queries.iter().zip(at_once(&material, &queries)) {
            assert_eq!(material.apparent(*uv, *wi, *wo), found);
        }
    }
}

/// Apparent values for a list of (uv, wi, wo), prepared together.
fn at_once(material: &dyn Material, queries: &[(Vec2, Vec3, Vec3)]) -> Vec<Vec3> {
    let points: Vec<Point> = queries.iter().map(|&(uv, _, wo)| Point { uv, wo }).collect();
    let (index, wi): (Vec<u32>, Vec<Vec3>) = (0..).zip(queries).map(|(k, query)| (k, query.1)).unzip();
    let mut values = vec![Vec3::ONE; queries.len()];
    material.prepare(&points).apparent(&index, &wi, &mut values);
    values
}

#[test]
fn at_full_rank_the_material_is_the_raw_one() {
    let source = source(meta(5, 4, SampleType::U8), 10);
    let file = encode(&source, &[("components", "15"), ("precision", "f32")]).unwrap();
    for blending in [Blending::Stored, Blending::Linear] {
        let how = Interpolation { scheme: Scheme::Triangles, blending };
        let raw = RawBtf::new(&source as &dyn BtfSource, how).unwrap();
        assert_same(&blended(&file.path, blending), &raw);
    }
}

fn assert_same(material: &FactoredMaterial, raw: &RawBtf<&dyn BtfSource>) {
    for i in 0..500 {
        let direction = |x: f32| Vec3::new((x * 1.3).sin(), (x * 0.7).cos(), 0.2 + (x * 0.37).sin().abs()).normalize();
        let (uv, wi, wo) =
            (Vec2::new(i as f32 * 0.37, i as f32 * -0.61), direction(i as f32), direction(i as f32 + 0.5));
        let (a, b) = (material.apparent(uv, wi, wo), raw.apparent(uv, wi, wo));
        assert!(a.distance(b) < 2e-5, "{i}: {a} {b}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn any_small_btf_round_trips(
        width in 1usize..9, height in 1usize..9, seed in any::<u32>(), constant in any::<bool>(),
        precision in 0usize..3, kind in 0usize..3, c in 1usize..16,
    ) {
        let meta = meta(width, height, [SampleType::U8, SampleType::F16, SampleType::F32][kind]);
        let limit = Sharing::PerView.rank(&meta);
        let source = if constant {
            let n = meta.views.len() * meta.view_len();
            let texels = match meta.sample_type {
                SampleType::U8 => Texels::U8(Cow::Owned(vec![seed as u8; n])),
                SampleType::F16 => Texels::F16(Cow::Owned(vec![f16::from_f32(0.25); n])),
                SampleType::F32 => Texels::F32(Cow::Owned(vec![0.3; n])),
            };
            MemoryBtf::new(meta, texels).unwrap()
        } else {
            source(meta, seed)
        };
        let precision = ["f32", "f16", "u8"][precision];
        let result = encode(&source, &[("components", &c.to_string()), ("precision", precision)]);
        prop_assert_eq!(result.is_ok(), c <= limit);
        let Ok(file) = result else { return Ok(()) };
        let btf = open(&file.path).unwrap();
        prop_assert_eq!(btf.bytes(), std::fs::metadata(&file.path).unwrap().len());
        let error = largest_difference(&source, &*btf);
        // full rank, or nothing but a mean: only rounding is left
        let bound = match precision { "f32" => 1e-4, "f16" => 5e-3, _ => 0.06 };
        if c == limit || constant {
            prop_assert!(error < bound, "{} {}", precision, error);
        } else {
            prop_assert!(error < 1.0, "{}", error);
        }
    }
}
