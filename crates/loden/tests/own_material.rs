//! A material written outside the library: with points prepared in its own way it gives what it gives one by one; and a
//! failure in the middle of an evaluation ends the job.

use std::f32::consts::PI;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::Synthetic;
use crate::common::chi_square::assert_sampling;
use glam::{Vec2, Vec3};
use loden::btf::{BtfMeta, BtfSource, Texels};
use loden::direction::Scheme;
use loden::material::{Bounce, Failure, Material, OneByOne, PagedBtf, Point, Prepared, RawBtf, Sample};
use loden::memory::Memory;
use loden::picture::Picture;
use loden::progress::Silent;
use loden::render::{Lighting, Settings, Studio, TextureMap, object, studio};
use loden::{Error, Result};

/// Stripes of two lobes around the mirror direction; its directions are drawn from the lobes.
struct Stripes;

impl Stripes {
    fn exponent(uv: Vec2) -> f32 {
        if (uv.x * 8.0).fract() < 0.5 { 30.0 } else { 4.0 }
    }

    /// The lobe (n + 1) / (2 pi) cos^n about the axis.
    fn lobe(exponent: f32, axis: Vec3, wi: Vec3) -> f32 {
        if wi.z > 0.0 { (exponent + 1.0) / (2.0 * PI) * wi.dot(axis).max(0.0).powf(exponent) } else { 0.0 }
    }

    fn draw(exponent: f32, axis: Vec3, random: Vec2) -> Option<Sample> {
        let cosine = (1.0 - random.x).powf(1.0 / (exponent + 1.0));
        let (sin, cos) = (2.0 * PI * random.y).sin_cos();
        let (tangent, bitangent) = axis.any_orthonormal_pair();
        let radius = (1.0 - cosine * cosine).max(0.0).sqrt();
        let wi = (axis * cosine + tangent * (radius * cos) + bitangent * (radius * sin)).normalize();
        let pdf = Self::lobe(exponent, axis, wi);
        (pdf > 0.0).then_some(Sample { wi, pdf })
    }
}

fn mirrored(wo: Vec3) -> Vec3 {
    Vec3::new(-wo.x, -wo.y, wo.z)
}

impl Material for Stripes {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        Vec3::new(0.9, 0.7, 0.4) * (PI * Self::lobe(Self::exponent(uv), mirrored(wo), wi))
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        Self::draw(Self::exponent(uv), mirrored(wo), random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        Self::lobe(Self::exponent(uv), mirrored(wo), wi)
    }
}

/// The same material with prepared points: exponents and axes.
struct Batched;

struct Axes(Vec<(f32, Vec3)>);

impl Material for Batched {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        Stripes.apparent(uv, wi, wo)
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        Stripes.sample(uv, wo, random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        Stripes.pdf(uv, wi, wo)
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        Box::new(Axes(points.iter().map(|point| (Stripes::exponent(point.uv), mirrored(point.wo))).collect()))
    }
}

impl Axes {
    fn value((exponent, axis): (f32, Vec3), wi: Vec3) -> Vec3 {
        Vec3::new(0.9, 0.7, 0.4) * (PI * Stripes::lobe(exponent, axis, wi))
    }
}

impl Prepared for Axes {
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        for ((value, &index), &wi) in values.iter_mut().zip(index).zip(wi) {
            *value = Self::value(self.0[index as usize], wi);
        }
    }

    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        for ((bounce, &index), &random) in bounces.iter_mut().zip(index).zip(random) {
            let own = self.0[index as usize];
            let drawn = Stripes::draw(own.0, own.1, random);
            *bounce = drawn.map_or(Bounce::NONE, |Sample { wi, pdf }| Bounce { wi, pdf, value: Self::value(own, wi) });
        }
    }

    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]) {
        for ((density, &index), &wi) in densities.iter_mut().zip(index).zip(wi) {
            let (exponent, axis) = self.0[index as usize];
            *density = Stripes::lobe(exponent, axis, wi);
        }
    }
}

fn draw(material: &dyn Material) -> Result<Picture> {
    let teapot = object::load("teapot")?;
    let texture = TextureMap { scale: 2.0, samples: 4, ..TextureMap::default() };
    let view = Studio { object: &teapot, material, material_name: "m", texture, lighting: Lighting::default() };
    studio(&view, &Settings { width: 48, height: 36, spp: 8, depth: 4, seed: 1 }, &Silent)
}

#[test]
fn prepared_points_of_a_strangers_material_give_the_same_picture() {
    assert_sampling(&Stripes, "stripes");
    let picture = draw(&Stripes).unwrap();
    assert!(picture.rgb.iter().any(|rgb| rgb.x > 0.2), "it is not black");
    assert_eq!(picture, draw(&Batched).unwrap());
}

#[test]
fn the_default_preparation_serves_every_order_of_points() {
    let points = [0.1, 0.4, 0.7].map(|u| Point { uv: Vec2::splat(u), wo: Vec3::new(u, 0.0, 1.0).normalize() });
    let (index, wi) = ([2, 0, 2, 1], [Vec3::Z, Vec3::Z, Vec3::new(0.0, 0.6, 0.8), Vec3::Z]);
    for prepared in [&OneByOne { material: &Stripes, points: &points } as &dyn Prepared, &*Batched.prepare(&points)] {
        let mut values = [Vec3::NAN; 4];
        prepared.apparent(&index, &wi, &mut values);
        for ((value, index), wi) in values.into_iter().zip(index).zip(wi) {
            assert_eq!(value, Stripes.apparent(points[index as usize].uv, wi, points[index as usize].wo));
        }
    }
}

/// A source that fails after so many images.
struct Failing {
    source: Synthetic,
    left: AtomicUsize,
}

impl Failing {
    fn after(images: usize) -> Self {
        Self { source: Synthetic::bonn81(4, 4), left: AtomicUsize::new(images) }
    }
}

impl BtfSource for Failing {
    fn meta(&self) -> &BtfMeta {
        &self.source.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.source.view(view)
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        let take = |left: usize| left.checked_sub(1);
        if self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_err() {
            return Err(Error::invalid(Path::new("worn/out.btf"), "image", "the disc is broken"));
        }
        self.source.image(view, light)
    }

    fn source_bytes(&self) -> u64 {
        0
    }
}

#[test]
fn a_source_that_fails_while_it_is_evaluated_stops_the_job_with_its_name() {
    for images in [0, 3, 500] {
        let material = RawBtf::on_demand(Arc::new(Failing::after(images)), Scheme::Triangles).unwrap();
        material.check().unwrap();
        let error = draw(&material).unwrap_err().to_string();
        assert!(error.contains("worn/out.btf") && error.contains("the disc is broken"), "{images}: {error}");
        // the failure is remembered
        assert_eq!(material.check().unwrap_err().to_string(), error);
    }
    let paged = PagedBtf::new(&Failing::after(3), Scheme::Triangles, Memory(1 << 20), &std::env::temp_dir(), &Silent);
    assert!(paged.unwrap_err().to_string().contains("worn/out.btf"));
}

#[test]
fn photographs_and_prepared_points_report_failures_too() {
    let material = RawBtf::on_demand(Arc::new(Failing::after(5)), Scheme::Triangles).unwrap();
    let (wi, wo) = (Vec3::new(0.3, 0.1, 0.9).normalize(), Vec3::new(-0.2, 0.4, 0.8).normalize());
    let error = loden::job::photograph(&material, 4, 4, wi, wo).unwrap_err().to_string();
    assert!(error.contains("worn/out.btf"), "{error}");
    let material = RawBtf::on_demand(Arc::new(Failing::after(5)), Scheme::Triangles).unwrap();
    let points = [Point { uv: Vec2::ZERO, wo }; 4];
    let mut values = [Vec3::ZERO; 4];
    material.prepare(&points).apparent(&[0, 1, 2, 3], &[wi; 4], &mut values);
    assert!(material.check().is_err());
}

#[test]
fn the_first_failure_is_kept() {
    let failure = Failure::default();
    assert!(failure.check().is_ok());
    assert_eq!(failure.ok(Ok(3)), Some(3));
    assert_eq!(failure.ok::<u8>(Err(Error::parameter("a", "first"))), None);
    failure.keep(Error::parameter("b", "second"));
    for _ in 0..2 {
        assert_eq!(failure.check().unwrap_err().to_string(), "a: first");
    }
}
