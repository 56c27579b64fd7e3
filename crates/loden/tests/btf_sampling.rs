//! Importance sampling of raw and compressed BTFs: samples match the density, are unbiased, and have less variance than
//! cosine sampling.

use std::f32::consts::PI;
use std::sync::{Arc, LazyLock};

use crate::common::Synthetic;
use crate::common::chi_square::{Random, assert_sampling, integrate, views};
use glam::{Vec2, Vec3};
use loden::btf::{BtfSource, Cosine};
use loden::codec::{self, CODECS};
use loden::direction::Scheme;
use loden::material::{Material, RawBtf};
use loden::params::Values;
use loden::progress::Silent;

fn raw(scheme: Scheme) -> RawBtf<Arc<Synthetic>> {
    RawBtf::new(Arc::new(Synthetic::bonn81(6, 5)), scheme).unwrap()
}

/// The synthetic BTF, raw and compressed by every codec.
static MATERIALS: LazyLock<Vec<(&str, Arc<dyn Material>)>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let scheme = Scheme::Triangles;
    let mut all: Vec<(&str, Arc<dyn Material>)> = vec![("raw", Arc::new(raw(scheme)))];
    for codec in CODECS {
        let path = folder.path().join(codec.name());
        let mut values = Values::defaults(codec.params());
        for (name, value) in [("clusters", "8"), ("components", "3"), ("chroma", "2")] {
            if codec.params().iter().any(|p| p.name == name) {
                values.set(name, value).unwrap();
            }
        }
        if codec.name() == "neural" {
            values.set("samples", "0.1").unwrap();
        }
        codec.encode(&Synthetic::bonn81(6, 5), &values, &path, &Silent).unwrap();
        all.push((codec.name(), codec::open(&path).unwrap().material(scheme).unwrap()));
    }
    all
});

/// A material with the default sampling.
struct CosineSampled<'a>(&'a dyn Material);

impl Material for CosineSampled<'_> {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.0.apparent(uv, wi, wo)
    }
}

/// Mean and standard error of the reflected light of a white sky, and the variance of a sample.
fn estimate(material: &dyn Material, uv: Vec2, wo: Vec3, count: usize) -> (f64, f64, f64) {
    let mut random = Random(5);
    let values: Vec<f64> = (0..count)
        .map(|_| {
            let drawn = material.sample(uv, wo, Vec2::new(random.unit(), random.unit()));
            drawn.map_or(0.0, |s| f64::from(material.apparent(uv, s.wi, wo).y / (PI * s.pdf)))
        })
        .collect();
    let mean = values.iter().sum::<f64>() / count as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1) as f64;
    (mean, (variance / count as f64).sqrt(), variance)
}

#[test]
fn every_btf_draws_as_it_states() {
    for (name, material) in MATERIALS.iter() {
        assert_sampling(material.as_ref(), name);
    }
    assert_sampling(&raw(Scheme::Rings), "raw, rings");
}

#[test]
fn sampling_is_unbiased_and_has_less_variance_than_a_cosine() {
    for (name, material) in MATERIALS.iter() {
        for (i, wo) in views().into_iter().enumerate().step_by(2) {
            let uv = Vec2::new(0.13 + 0.17 * i as f32, 0.9 - 0.21 * i as f32);
            let exact = integrate(&|wi| material.apparent(uv, wi, wo).y / PI).iter().sum::<f64>();
            let (_, _, cosine) = estimate(&CosineSampled(material.as_ref()), uv, wo, 8000);
            let (mean, error, variance) = estimate(material.as_ref(), uv, wo, 8000);
            let difference = (mean - exact).abs();
            assert!(difference < 4.5 * error + 1e-4 * exact, "{name}, view {i}: {mean}, not {exact} +- {error}");
            if i == 0 {
                assert!(variance < cosine, "{name}: variance {variance}, {cosine} of a cosine");
            }
        }
    }
}

#[test]
fn a_black_btf_is_sampled_too() {
    struct Black(Synthetic);
    impl BtfSource for Black {
        fn meta(&self) -> &loden::btf::BtfMeta {
            &self.0.meta
        }
        fn view(&self, _: usize) -> loden::Result<loden::btf::Texels<'_>> {
            Ok(loden::btf::Texels::U8(vec![0; self.0.meta.view_len()].into()))
        }
        fn image(&self, _: usize, _: usize) -> loden::Result<loden::btf::Texels<'_>> {
            Ok(loden::btf::Texels::U8(vec![0; self.0.meta.image_len()].into()))
        }
        fn source_bytes(&self) -> u64 {
            0
        }
    }
    let mut source = Synthetic::bonn81(2, 3);
    source.meta.cosine = Cosine::Excluded;
    let material = RawBtf::new(Box::new(Black(source)), Scheme::Triangles).unwrap();
    assert_sampling(&material, "black");
}
