//! BTFs within a memory budget equal those in memory, bit by bit.

use std::borrow::Cow;

use crate::common::Synthetic;
use crate::common::chi_square::Random;
use glam::Vec2;
use half::f16;
use loden::Result;
use loden::btf::{BtfMeta, BtfSource, SampleType, Texels};
use loden::direction::{DirectionSet, Scheme, from_angles};
use loden::material::{Material, PagedBtf, RawBtf};
use loden::memory::Memory;
use loden::picture::Picture;
use loden::progress::Silent;
use loden::render::{Lighting, Settings, Studio, TextureMap, object, studio};

/// The synthetic BTF with other sizes.
struct Numbers(Synthetic);

impl Numbers {
    fn convert(&self, bytes: Vec<u8>) -> Texels<'static> {
        let values = bytes.into_iter().map(|v| f32::from(v) / 200.0);
        match self.0.meta.sample_type {
            SampleType::U8 => Texels::U8(values.map(|v| (v * 200.0) as u8).collect()),
            SampleType::F16 => Texels::F16(Cow::Owned(values.map(f16::from_f32).collect())),
            SampleType::F32 => Texels::F32(values.collect()),
        }
    }
}

impl BtfSource for Numbers {
    fn meta(&self) -> &BtfMeta {
        &self.0.meta
    }
    fn view(&self, view: usize) -> Result<Texels<'_>> {
        let all = (0..self.0.meta.lights.len()).flat_map(|light| self.0.pixels(view, light));
        Ok(self.convert(all.collect()))
    }
    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        Ok(self.convert(self.0.pixels(view, light)))
    }
    fn source_bytes(&self) -> u64 {
        0
    }
}

fn source(width: usize, height: usize, sample_type: SampleType) -> Numbers {
    let mut source = Synthetic::bonn81(width, height);
    let degrees = (0..13).map(|k| [f64::from(k % 4) * 20.0, f64::from(k) * 83.0]).collect();
    source.meta.views = DirectionSet::from_degrees(degrees).unwrap();
    source.meta.sample_type = sample_type;
    Numbers(source)
}

#[test]
fn values_and_samples_are_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    for (width, height, kind) in [(16, 8, SampleType::U8), (7, 5, SampleType::F16), (9, 13, SampleType::F32)] {
        let source = source(width, height, kind);
        let raw = RawBtf::new(&source as &dyn BtfSource, Scheme::Triangles).unwrap();
        for kib in [150, 400, 4000] {
            let memory = Memory(kib << 10);
            let paged = PagedBtf::new(&source, Scheme::Triangles, memory, folder.path(), &Silent).unwrap();
            let mut random = Random(1);
            for _ in 0..3000 {
                let mut direction = || from_angles(1.6 * random.unit(), 6.3 * random.unit());
                let (wi, wo) = (direction(), direction());
                let uv = Vec2::new(random.unit() * 3.0 - 1.0, random.unit());
                assert_eq!(paged.apparent(uv, wi, wo), raw.apparent(uv, wi, wo));
                let u = Vec2::new(random.unit(), random.unit());
                assert_eq!(paged.sample(uv, wo, u), raw.sample(uv, wo, u));
                assert_eq!(paged.pdf(uv, wi, wo), raw.pdf(uv, wi, wo));
            }
            assert!(paged.resident_bytes() <= memory.0);
            let (asked, read) = paged.requests();
            assert!(read > 0 && read <= asked);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "the file has no name");
    }
}

#[test]
fn pictures_are_the_same_bits_for_any_memory_and_threads() {
    let folder = tempfile::tempdir().unwrap();
    let source = source(24, 20, SampleType::U8);
    let draw = |material: &dyn Material, threads: usize| -> Picture {
        let teapot = object::load("teapot").unwrap();
        let texture = TextureMap { scale: 4.0, samples: 8, ..TextureMap::default() };
        let view = Studio { object: &teapot, material, material_name: "m", texture, lighting: Lighting::default() };
        let settings = Settings { width: 40, height: 30, spp: 4, depth: 4, seed: 1 };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| studio(&view, &settings, &Silent)).unwrap()
    };
    let raw = RawBtf::new(&source as &dyn BtfSource, Scheme::Triangles).unwrap();
    let expected = draw(&raw, 2);
    for (kib, threads) in [(64, 2), (300, 1), (900, 2)] {
        let memory = Memory(kib << 10);
        let paged = PagedBtf::new(&source, Scheme::Triangles, memory, folder.path(), &Silent).unwrap();
        assert_eq!(draw(&paged, threads), expected, "{memory}");
        assert!(paged.resident_bytes() <= memory.0);
    }
}

#[test]
fn too_little_memory_is_named() {
    let source = source(8, 8, SampleType::U8);
    let folder = std::env::temp_dir();
    let error = PagedBtf::new(&source, Scheme::Triangles, Memory(20_000), &folder, &Silent).unwrap_err();
    assert!(error.to_string().starts_with("memory: found 0.0 MiB, expected at least"), "{error}");
    let nowhere = folder.join("there is no such folder");
    let error = PagedBtf::new(&source, Scheme::Triangles, Memory(1 << 20), &nowhere, &Silent).unwrap_err();
    assert!(error.to_string().contains("no such folder"), "{error}");
}
