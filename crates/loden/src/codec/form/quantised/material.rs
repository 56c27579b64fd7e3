//! Evaluation at continuous texture coordinates and directions, from the index image and the block.

use std::sync::Arc;

use glam::Vec3;

use super::QuantisedBtf;
use crate::Result;
use crate::color::domain::Linearizer;
use crate::material::angles::{AngularStencil, Footprint, LightStencil};
use crate::material::texels::{Lookup, TexelMaterial, TexelPoint};
use crate::material::{Blending, Interpolation};

/// A quantised BTF for evaluation, read from the open file.
///
/// # Model
/// Every texel, view and light around a point is looked up, converted to linear light and clamped at zero; their mean is turned
/// into an apparent value by [`AngularStencil::factor`]. With [`Blending::Stored`] the mean is one in the domain of the block,
/// and converted afterwards. At texel centres and sampled directions this equals the decoded image.
#[derive(Debug)]
pub struct QuantisedMaterial {
    btf: Arc<QuantisedBtf>,
    lookup: Lookup,
    linearizer: Linearizer,
    blending: Blending,
    /// Linear light of 8-bit numbers, for each view or for all.
    of_byte: Vec<[f32; 256]>,
}

impl QuantisedMaterial {
    /// Prepares the evaluation.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the scheme of the interpolation.
    pub fn new(btf: Arc<QuantisedBtf>, Interpolation { scheme, blending }: Interpolation) -> Result<Self> {
        let lookup = Lookup::new(btf.meta(), scheme)?;
        let linearizer = Linearizer::new(btf.domain(), btf.meta().encoding);
        let mut of_byte = btf.tables().of_byte();
        of_byte.as_flattened_mut().iter_mut().for_each(|number| *number = linearizer.linear(*number));
        Ok(Self { btf, lookup, linearizer, blending, of_byte })
    }

    /// The mean in linear light, or if not `LINEAR` that in the domain of the block, converted.
    #[inline(always)]
    fn mean<const T: usize, const LINEAR: bool>(
        &self,
        stencil: &AngularStencil,
        texels: [usize; T],
        weights: [f32; T],
    ) -> Vec3 {
        let (tables, index) = (self.btf.tables(), self.btf.index());
        let lights = self.btf.meta().lights.len();
        let mut total = [0.0f32; 3];
        for (texel, texel_weight) in texels.into_iter().zip(weights) {
            let cluster = usize::from(index[texel]);
            for (view, view_weight) in stencil.view.iter() {
                for (light, light_weight) in stencil.light.iter() {
                    let weight = texel_weight * view_weight * light_weight;
                    let pair = view * lights + light;
                    let rgb = match tables.bytes(cluster, pair) {
                        Some(bytes) if LINEAR => {
                            let curve = if self.of_byte.len() > 1 { &self.of_byte[view] } else { &self.of_byte[0] };
                            bytes.map(|byte| curve[usize::from(byte)])
                        }
                        _ if LINEAR => tables.value(texel, cluster, pair).map(|v| self.linearizer.linear(v)),
                        _ => tables.value(texel, cluster, pair),
                    };
                    total.iter_mut().zip(rgb).for_each(|(total, v)| *total += weight * v);
                }
            }
        }
        if !LINEAR {
            total = total.map(|v| self.linearizer.linear(v));
        }
        Vec3::from(total) * stencil.factor
    }

    fn sum<const T: usize>(&self, stencil: &AngularStencil, texels: [usize; T], weights: [f32; T]) -> Vec3 {
        match self.blending {
            Blending::Linear => self.mean::<T, true>(stencil, texels, weights),
            _ => self.mean::<T, false>(stencil, texels, weights),
        }
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
