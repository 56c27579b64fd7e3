//! Evaluation at continuous texture coordinates and directions, from the index image and the block.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::QuantisedBtf;
use crate::Result;
use crate::btf::BtfSource;
use crate::codec::domain::Linearizer;
use crate::color::luminance;
use crate::direction::Scheme;
use crate::material::angles::{Angles, AngularStencil, Footprint};
use crate::material::lobes::BtfSampler;
use crate::material::{Material, Sample};

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
            Some(stencil) => self.value(&stencil, [texel], [1.0]),
            None => Vec3::ZERO,
        }
    }

    /// Luminances at sampled pairs, (light, texel).
    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Vec<f32> {
        let meta = self.btf.meta();
        let wo = meta.views.directions()[view];
        let pairs = lights.iter().flat_map(|&light| texels.iter().map(move |&texel| (light, texel)));
        let value = |(light, texel): (usize, usize)| self.apparent_texel(texel, meta.lights.directions()[light], wo);
        pairs.map(|pair| luminance(value(pair).to_array())).collect()
    }

    fn value<const T: usize>(&self, stencil: &AngularStencil, texels: [usize; T], weights: [f32; T]) -> Vec3 {
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

impl Material for QuantisedMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        match self.angles.stencil(wi, wo) {
            Some(stencil) => {
                let meta = self.btf.meta();
                let footprint = Footprint::new(uv, meta.width, meta.height);
                self.value(&stencil, footprint.texel, footprint.weight)
            }
            None => Vec3::ZERO,
        }
    }

    fn texels(&self) -> Option<[usize; 2]> {
        Some([self.btf.meta().width, self.btf.meta().height])
    }

    fn prepare(&self) -> Result<()> {
        self.sampler
            .prepare(self.btf.meta(), &self.angles, &|view, lights, texels| Ok(self.luminances(view, lights, texels)))
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.sampler.sample(&self.angles, uv, wo, random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.sampler.pdf(&self.angles, uv, wi, wo)
    }
}
