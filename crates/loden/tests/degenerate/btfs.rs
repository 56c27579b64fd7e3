//! Codecs and exporters of BTFs.

use std::path::Path;

use glam::{Vec2, Vec3};
use loden::Result;
use loden::btf::{BtfMeta, BtfSource};
use loden::codec::{self, CODECS, Codec, Finish, Goal, Outcome};
use loden::direction::{Scheme, from_angles};
use loden::export::{self, EXPORTERS};
use loden::import;
use loden::material::Material;
use loden::params::{Given, Values};
use loden::progress::Silent;

use super::family::{Member, finite, largest, mean_images, names_its_cause, not_finite, rms, values};

fn compress(codec: &dyn Codec, source: &dyn BtfSource, given: &[(&str, &str)], path: &Path) -> Result<Outcome> {
    let params = Values::new(codec.params(), given.iter().copied())?;
    let finish = Finish { measure: true, lossless: None };
    codec::compress(codec, source, &params, Goal::Params, finish, path, &Silent)
}

/// Values at pairs of directions within and beyond those that were measured.
fn assert_finite(material: &dyn Material, most: f32, what: &str) {
    for i in 0..60 {
        let (wi, wo) =
            (from_angles(0.026 * i as f32, 0.7 * i as f32), from_angles(1.55 - 0.026 * i as f32, 2.3 * i as f32));
        let value = material.apparent(Vec2::new(0.13 * i as f32, 0.29 * i as f32), wi, wo);
        assert!(value.is_finite() && value.min_element() >= 0.0, "{what}: {value} at {wi} {wo}");
        // no evaluation is far beyond what was measured
        assert!(value.max_element() <= most, "{what}: {value} at {wi} {wo}, largest stored {most}");
    }
    assert_eq!(material.apparent(Vec2::ZERO, Vec3::NEG_Z, Vec3::Z), Vec3::ZERO, "{what}");
}

/// The values as a method represents them, in the display encoding, in which errors count: nothing negative survives
/// where logarithms or products are factored.
fn displayed(codec: &dyn Codec, meta: &BtfMeta, values: &[f32]) -> Vec<f32> {
    let positive = ["dfmf", "cmf", "analytic"].contains(&codec.name());
    let curve = |v: &f32| {
        let linear = meta.encoding.decode(*v);
        meta.encoding.display().encode(if positive { linear.max(0.0) } else { linear })
    };
    values.iter().map(curve).collect()
}

/// The values of the best Lambertian in every texel, which no model with a diffuse term should lose to.
fn lambertian(meta: &BtfMeta, values: &[f32]) -> Vec<f32> {
    let pairs = meta.pairs();
    let cosine = |pair: usize| meta.lights.directions()[pair % meta.lights.len()].z;
    let mut found = values.to_vec();
    for i in 0..meta.image_len() {
        let at = |pair: usize| pair * meta.image_len() + i;
        let linear = |pair: usize| meta.encoding.decode(values[at(pair)]).max(0.0);
        let (up, down) =
            (0..pairs).fold((0.0, 0.0), |(up, down), p| (up + cosine(p) * linear(p), down + cosine(p).powi(2)));
        (0..pairs).for_each(|pair| found[at(pair)] = meta.encoding.encode((up / down).min(1.0) * cosine(pair)));
    }
    found
}

#[test]
fn every_codec_represents_every_member_no_worse_than_its_mean() {
    let folder = tempfile::tempdir().unwrap();
    let mut problems = Vec::new();
    for Member { name, btf } in finite() {
        let (meta, original) = (btf.meta(), values(&btf));
        for codec in CODECS {
            let what = format!("{name} ({:?}) by {}", meta.sample_type, codec.name());
            let path = folder.path().join("x.loden");
            // half precision ends at 65504
            let precise = codec.params().iter().any(|param| param.name == "precision") && largest(&original) > 1e4;
            let given: &[_] = match codec.name() {
                // what is compared here are root mean squares
                "neural" => &[("loss", "squared"), ("samples", "0.2")],
                _ if precise => &[("precision", "f32")],
                _ => &[],
            };
            if let Err(error) = compress(*codec, &btf, given, &path) {
                // a factor over lights and one over views need every view with every light
                if codec.name() == "cmf" && meta.is_listed() && error.to_string().starts_with("pairs:") {
                    continue;
                }
                // no model reflects more light than arrives
                if codec.name() != "analytic" || largest(&original) <= 1e4 || !error.to_string().starts_with("model:") {
                    problems.push(format!("{what}: {error}"));
                }
                continue;
            }
            let opened = codec::open(&path).unwrap();
            let decoded = values(opened.as_ref());
            assert!(decoded.iter().all(|v| v.is_finite()), "{what}");
            let [found, wanted] = [&decoded, &original].map(|values| displayed(*codec, meta, values));
            let scale = f64::from(largest(&wanted)).max(1e-3);
            // the default precision: a step of klt changes a whole texel, so that a single one has all of the error
            let precision = if codec.name() == "klt" { 0.03 } else { 0.01 } * scale;
            let plain = match codec.name() {
                "analytic" => displayed(*codec, meta, &lambertian(meta, &original)),
                _ => mean_images(meta, &wanted),
            };
            let (error, of_plain) = (rms(&found, &wanted), rms(&plain, &wanted));
            println!("{what}: {:.5} {:.5}", error / scale, of_plain / scale);
            if error > of_plain + precision {
                problems.push(format!("{what}: error {error:e}, of the mean {of_plain:e}, scale {scale:e}"));
            }
            let material = opened.material(Scheme::Triangles).unwrap();
            let linear = original.iter().fold(0.0f32, |most, v| most.max(meta.encoding.decode(*v)));
            assert_finite(material.as_ref(), 20.0 * linear + 0.1, &what);
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn no_codec_stores_what_is_not_finite() {
    let folder = tempfile::tempdir().unwrap();
    for Member { name, btf } in not_finite() {
        for codec in CODECS {
            let path = folder.path().join("x.loden");
            let error = compress(*codec, &btf, &[], &path).unwrap_err();
            assert!(names_its_cause(&error), "{name} by {}: {error:?}", codec.name());
            assert!(!path.exists());
        }
    }
}

/// All values of a source in the order of the pairs of `meta`: readers may sort directions.
fn ordered_as(meta: &BtfMeta, source: &dyn BtfSource) -> Vec<f32> {
    let other = source.meta();
    assert_eq!((other.views.len(), other.lights.len()), (meta.views.len(), meta.lights.len()));
    if meta.is_listed() {
        let nearest = |light| {
            let (wi, wo) = meta.pair(0, light);
            other.nearest_pair(wi, wo)
        };
        let image = |(view, light)| source.image(view, light).unwrap().to_f32().into_owned();
        return (0..meta.lights.len()).map(nearest).flat_map(image).collect();
    }
    let pairs = meta.views.directions().iter().flat_map(|wo| meta.lights.directions().iter().map(move |wi| (wi, wo)));
    pairs
        .enumerate()
        .flat_map(|(pair, (&wi, &wo))| {
            // of equal directions, take that of the same number
            let same = |set: &loden::direction::DirectionSet, i: usize, w: Vec3| match set.directions().get(i) {
                Some(found) if found.dot(w) > 0.999_999 => i,
                _ => set.nearest(w),
            };
            let view = same(&other.views, pair / meta.lights.len(), wo);
            let light = same(&other.lights, pair % meta.lights.len(), wi);
            source.image(view, light).unwrap().to_f32().into_owned()
        })
        .collect()
}

#[test]
fn every_exporter_gives_every_member_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut problems = Vec::new();
    for (i, Member { name, btf }) in finite().into_iter().enumerate() {
        let original = values(&btf);
        for exporter in EXPORTERS {
            let what = format!("{name} ({:?}) as {}", btf.meta().sample_type, exporter.name());
            let path = folder.path().join(format!(
                "{i}-{}{}",
                exporter.name(),
                exporter.ending().map_or(String::new(), |e| format!(".{e}"))
            ));
            if let Err(error) = export::export_as(*exporter, &btf, &path, &Given::default(), &Silent) {
                println!("{what}: {error}");
                assert!(names_its_cause(&error), "{what}: {error:?}");
                continue;
            }
            let back = match import::open_named(&path, &Given::default()).map(|(_, measured)| measured.images()) {
                Ok(Ok(back)) => back,
                Ok(Err(_)) => panic!("{what}: is no BTF"),
                Err(error) => {
                    problems.push(format!("{what}: {error}"));
                    continue;
                }
            };
            // pictures end at 0 and 1, logarithms at 0
            let most = if exporter.name() == "ubo2003" { 1.0 } else { f32::INFINITY };
            let least = if exporter.name() == "raw" { f32::NEG_INFINITY } else { 0.0 };
            let linear = |meta: &BtfMeta, values: &[f32]| -> Vec<f32> {
                values.iter().map(|v| meta.encoding.decode(*v).clamp(least, most)).collect()
            };
            let (a, b) = (linear(btf.meta(), &original), linear(back.meta(), &ordered_as(btf.meta(), back.as_ref())));
            let error = rms(&a, &b) / f64::from(largest(&a)).max(1e-3);
            println!("{what}: {error:.5}");
            // neighbouring texels have nothing in common, which JPEG does not expect
            let most = if exporter.name() == "ubo2003" { 0.06 } else { 0.01 };
            if error.is_nan() || error > most {
                problems.push(format!("{what}: {error}"));
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
