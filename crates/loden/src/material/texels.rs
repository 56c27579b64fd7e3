//! Materials that are interpolated between texels and sampled directions.

use glam::{Vec2, Vec3};

use super::angles::{Angles, Footprint};
use super::lobes::BtfSampler;
use super::{Bounce, Material, Sample};
use crate::Result;
use crate::btf::BtfMeta;
use crate::direction::Stencil;
use crate::simd::many::LANES;

/// A texture coordinate seen by a viewer, with what all evaluations there have in common: [`Material::seen`].
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Texture coordinate.
    pub uv: Vec2,
    /// Unit vector towards the viewer, local frame.
    pub wo: Vec3,
    /// The sampled views around the viewer; none if it is below the surface.
    pub(crate) view: Stencil,
    pub(crate) footprint: Footprint,
    /// Of the lobes that directions are drawn from.
    pub(crate) cluster: usize,
}

impl Seen {
    /// Where nothing is prepared.
    #[inline]
    pub(crate) fn new(uv: Vec2, wo: Vec3) -> Self {
        Self { uv, wo, view: Stencil::NONE, footprint: Footprint::NONE, cluster: 0 }
    }
}

/// What texels and directions are looked up by.
pub(crate) struct Lookup<'a> {
    pub meta: &'a BtfMeta,
    pub angles: &'a Angles,
    pub sampler: &'a BtfSampler,
}

/// What a material of texels must have; the rest of [`Material`] follows from it.
pub(crate) trait TexelMaterial: Send + Sync {
    fn lookup(&self) -> Lookup<'_>;

    /// The apparent value.
    fn value(&self, seen: &Seen, wi: Vec3) -> Vec3;

    /// The apparent values of as many points and directions as there are values.
    fn values(&self, seen: &[&Seen], wi: &[Vec3], values: &mut [Vec3]) {
        for ((value, seen), wi) in values.iter_mut().zip(seen).zip(wi) {
            *value = self.value(seen, *wi);
        }
    }

    /// Luminances of apparent values at sampled pairs, (light, texel).
    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>>;
}

impl<M: TexelMaterial> Material for M {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return Vec3::ZERO;
        }
        self.value(&self.seen(uv, wo), wi)
    }

    fn texels(&self) -> Option<[usize; 2]> {
        let Lookup { meta, .. } = self.lookup();
        Some([meta.width, meta.height])
    }

    fn prepare(&self) -> Result<()> {
        let values = |view: usize, lights: &[usize], texels: &[usize]| self.luminances(view, lights, texels);
        let Lookup { meta, angles, sampler } = self.lookup();
        sampler.prepare(meta, angles, &values)
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.sample_seen(&self.seen(uv, wo), random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.pdf_seen(&self.seen(uv, wo), wi)
    }

    fn seen(&self, uv: Vec2, wo: Vec3) -> Seen {
        let mut seen = Seen::new(uv, wo);
        if wo.z > 0.0 {
            let Lookup { meta, angles, sampler } = self.lookup();
            seen.view = angles.views_around(wo);
            seen.footprint = Footprint::new(uv, meta.width, meta.height);
            seen.cluster = sampler.cluster(uv);
        }
        seen
    }

    fn apparent_seen(&self, seen: &Seen, wi: Vec3) -> Vec3 {
        self.value(seen, wi)
    }

    fn sample_seen(&self, seen: &Seen, random: Vec2) -> Option<Sample> {
        let mut bounce = [Bounce::NONE];
        self.lookup().sampler.sample_many(&[seen], &[random], &mut bounce);
        let [Bounce { wi, pdf, .. }] = bounce;
        (pdf > 0.0).then_some(Sample { wi, pdf })
    }

    fn pdf_seen(&self, seen: &Seen, wi: Vec3) -> f32 {
        self.lookup().sampler.pdf(seen, wi)
    }

    fn apparent_many(&self, seen: &[&Seen], wi: &[Vec3], values: &mut [Vec3]) {
        self.values(seen, wi, values);
    }

    fn scatter_many(&self, seen: &[&Seen], random: &[Vec2], bounces: &mut [Bounce]) {
        self.lookup().sampler.sample_many(seen, random, bounces);
        let (mut wi, mut values) = ([Vec3::ZERO; LANES], [Vec3::ZERO; LANES]);
        for (bounces, seen) in bounces.chunks_mut(LANES).zip(seen.chunks(LANES)) {
            let count = bounces.len();
            wi.iter_mut().zip(&*bounces).for_each(|(wi, bounce)| *wi = bounce.wi);
            self.values(seen, &wi[..count], &mut values[..count]);
            bounces.iter_mut().zip(values).for_each(|(bounce, value)| bounce.value = value);
        }
    }
}
