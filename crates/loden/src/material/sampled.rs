//! Importance sampling for materials that know no shorter way to their values at sampled directions than evaluation.

use glam::{Vec2, Vec3};

use super::angles::Angles;
use super::lobes::BtfSampler;
use super::{Material, Sample};
use crate::Result;
use crate::btf::BtfMeta;
use crate::color::luminance;
use crate::direction::Scheme;

/// A BTF's material with the sampler of BTFs.
pub(crate) struct Sampled<M> {
    material: M,
    meta: BtfMeta,
    angles: Angles,
    sampler: BtfSampler,
}

impl<M: Material> Sampled<M> {
    /// Of a material with the directions and texels of `meta`.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not suit the interpolation `scheme`.
    pub(crate) fn new(material: M, meta: &BtfMeta, scheme: Scheme) -> Result<Self> {
        let angles = Angles::new(meta, scheme)?;
        Ok(Self { material, meta: meta.clone(), angles, sampler: BtfSampler::default() })
    }

    /// Luminances at sampled pairs, (light, texel).
    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Vec<f32> {
        let (width, height) = (self.meta.width, self.meta.height);
        let centre = |i: usize, size: usize| (i as f32 + 0.5) / size as f32;
        let uv = |texel: usize| Vec2::new(centre(texel % width, width), 1.0 - centre(texel / width, height));
        let wo = self.meta.views.directions()[view];
        let pairs = lights.iter().flat_map(|&light| texels.iter().map(move |&texel| (light, texel)));
        let value = |(light, texel)| self.material.apparent(uv(texel), self.meta.lights.directions()[light], wo);
        pairs.map(|pair| luminance(value(pair).to_array())).collect()
    }
}

impl<M: Material> Material for Sampled<M> {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.material.apparent(uv, wi, wo)
    }

    fn texels(&self) -> Option<[usize; 2]> {
        Some([self.meta.width, self.meta.height])
    }

    fn prepare(&self) -> Result<()> {
        self.sampler.prepare(
            &self.meta,
            &self.angles,
            &|view, lights, texels| Ok(self.luminances(view, lights, texels)),
        )
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.sampler.sample(&self.angles, uv, wo, random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.sampler.pdf(&self.angles, uv, wi, wo)
    }
}
