//! Evaluation at continuous texture coordinates and directions, from the index image and the block.

use std::sync::Arc;

use glam::Vec3;

use super::QuantisedBtf;
use crate::Result;
use crate::btf::BtfSource;
use crate::color::domain::Linearizer;
use crate::color::luminance;
use crate::direction::Scheme;
use crate::material::angles::{Angles, AngularStencil};
use crate::material::lobes::BtfSampler;
use crate::material::texels::{Lookup, Seen, TexelMaterial};

/// A quantised BTF that can be evaluated, from the open file.
///
/// # Model
/// Texels, views and lights are interpolated in the domain of the block (display values but for `pcmf`); the sum is
/// turned into linear light, negative results into zero, and into an apparent value by [`AngularStencil::factor`]. At a
/// texel centre and sampled directions this is the decoded image.
#[derive(Debug)]
pub struct QuantisedMaterial {
    btf: Arc<QuantisedBtf>,
    angles: Angles,
    linearizer: Linearizer,
    sampler: BtfSampler,
}

impl QuantisedMaterial {
    /// Prepares evaluation.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not suit the interpolation `scheme`.
    pub fn new(btf: Arc<QuantisedBtf>, scheme: Scheme) -> Result<Self> {
        let angles = Angles::new(btf.meta(), scheme)?;
        let linearizer = Linearizer::new(btf.domain(), btf.meta().encoding);
        Ok(Self { btf, angles, linearizer, sampler: BtfSampler::default() })
    }

    /// The apparent value of a texel, without interpolation between texels.
    ///
    /// # Panics
    /// If there is no such texel.
    pub fn apparent_texel(&self, texel: usize, wi: Vec3, wo: Vec3) -> Vec3 {
        match self.angles.stencil(wi, wo) {
            Some(stencil) => self.sum(&stencil, [texel], [1.0]),
            None => Vec3::ZERO,
        }
    }

    fn sum<const T: usize>(&self, stencil: &AngularStencil, texels: [usize; T], weights: [f32; T]) -> Vec3 {
        let (tables, index) = (self.btf.tables(), self.btf.index());
        let lights = self.btf.meta().lights.len();
        let mut total = [0.0f32; 3];
        for (texel, texel_weight) in texels.into_iter().zip(weights) {
            let cluster = usize::from(index[texel]);
            for (view, view_weight) in stencil.view.iter() {
                for (light, light_weight) in stencil.light.iter() {
                    let weight = texel_weight * view_weight * light_weight;
                    let rgb = tables.value(texel, cluster, view * lights + light);
                    total.iter_mut().zip(rgb).for_each(|(total, v)| *total += weight * v);
                }
            }
        }
        Vec3::from(total.map(|v| self.linearizer.linear(v))) * stencil.factor
    }
}

impl TexelMaterial for QuantisedMaterial {
    fn lookup(&self) -> Lookup<'_> {
        Lookup { meta: self.btf.meta(), angles: &self.angles, sampler: &self.sampler }
    }

    fn value(&self, seen: &Seen, wi: Vec3) -> Vec3 {
        let stencil = self.angles.lit(&seen.view, wi);
        stencil.map_or(Vec3::ZERO, |stencil| self.sum(&stencil, seen.footprint.texel, seen.footprint.weight))
    }

    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>> {
        let meta = self.btf.meta();
        let wo = meta.views.directions()[view];
        let pairs = lights.iter().flat_map(|&light| texels.iter().map(move |&texel| (light, texel)));
        let value = |(light, texel): (usize, usize)| self.apparent_texel(texel, meta.lights.directions()[light], wo);
        Ok(pairs.map(|pair| luminance(value(pair).to_array())).collect())
    }
}
