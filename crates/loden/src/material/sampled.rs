//! Importance sampling for materials that know no shorter way to their values at sampled directions than evaluation.

use glam::{Vec2, Vec3};

use super::Material;
use super::angles::Angles;
use super::lobes::BtfSampler;
use super::texels::{Lookup, Seen, TexelMaterial};
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
}

impl<M: Material> TexelMaterial for Sampled<M> {
    fn lookup(&self) -> Lookup<'_> {
        Lookup { meta: &self.meta, angles: &self.angles, sampler: &self.sampler }
    }

    fn value(&self, seen: &Seen, wi: Vec3) -> Vec3 {
        self.material.apparent(seen.uv, wi, seen.wo)
    }

    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>> {
        let (width, height) = (self.meta.width, self.meta.height);
        let centre = |i: usize, size: usize| (i as f32 + 0.5) / size as f32;
        let uv = |texel: usize| Vec2::new(centre(texel % width, width), 1.0 - centre(texel / width, height));
        let wo = self.meta.views.directions()[view];
        let pairs = lights.iter().flat_map(|&light| texels.iter().map(move |&texel| (light, texel)));
        let value = |(light, texel)| self.material.apparent(uv(texel), self.meta.lights.directions()[light], wo);
        Ok(pairs.map(|pair| luminance(value(pair).to_array())).collect())
    }
}
