//! Evaluation at continuous texture coordinates and directions, from the index image and the block.

use std::sync::Arc;

use glam::Vec3;

use super::QuantisedBtf;
use crate::Result;
use crate::color::domain::Linearizer;
use crate::direction::Scheme;
use crate::material::angles::{AngularStencil, Footprint, LightStencil};
use crate::material::texels::{Lookup, TexelMaterial, TexelPoint};

/// A quantised BTF for evaluation, read from the open file.
///
/// # Model
/// Texels, views and lights are interpolated in the domain of the block (display values, except for `pcmf`). The sum
/// is converted to linear light, clamped at zero, and turned into an apparent value by [`AngularStencil::factor`]. At
/// texel centres and sampled directions this equals the decoded image.
#[derive(Debug)]
pub struct QuantisedMaterial {
    btf: Arc<QuantisedBtf>,
    lookup: Lookup,
    linearizer: Linearizer,
}

impl QuantisedMaterial {
    /// Prepares the evaluation.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the interpolation `scheme`.
    pub fn new(btf: Arc<QuantisedBtf>, scheme: Scheme) -> Result<Self> {
        let lookup = Lookup::new(btf.meta(), scheme)?;
        let linearizer = Linearizer::new(btf.domain(), btf.meta().encoding);
        Ok(Self { btf, lookup, linearizer })
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
    fn lookup(&self) -> &Lookup {
        &self.lookup
    }

    fn value(&self, point: &TexelPoint, wi: Vec3) -> Vec3 {
        let mut light = LightStencil::NONE;
        let Some(stencil) = self.lookup.angles.lit(&point.view, wi, point.wo, &mut light) else { return Vec3::ZERO };
        let footprint = self.lookup.footprint(point);
        let Footprint { texel, weight } = footprint;
        if footprint.is_texel() {
            return self.sum(&stencil, [texel[0]], [1.0]);
        }
        self.sum(&stencil, texel, weight)
    }
}
