//! Shared by materials made of images, in memory or in a file.

use glam::Vec3;

use super::angles::LightStencil;
use super::texels::{Lookup, TexelPoint};
use crate::Result;
use crate::btf::{BtfMeta, Cosine};
use crate::color::domain::{Domain, Linearizer};
use crate::color::{Encoding, luminance};
use crate::direction::{Scheme, Stencil};

/// Stored values at the four texels of a footprint in one view: (light of the stencil, texel).
pub(super) type Corners = [[Vec3; 4]; 4];

/// Interpolation and sampling of images.
///
/// # Model
/// Stored values are interpolated linearly between texels, views and lights, as in compressed materials, and the result
/// is converted to linear light.
#[derive(Debug)]
pub(super) struct Images {
    pub lookup: Lookup,
    linearizer: Linearizer,
}

impl Images {
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the interpolation `scheme`.
    pub(super) fn new(meta: &BtfMeta, scheme: Scheme) -> Result<Self> {
        let domain = if meta.encoding == Encoding::Linear { Domain::Linear } else { Domain::Display };
        let linearizer = Linearizer::new(domain, meta.encoding);
        Ok(Self { lookup: Lookup::new(meta, scheme)?, linearizer })
    }

    /// The apparent value. `fill` writes the stored values in one view for each light whose weight is positive.
    #[inline]
    pub(super) fn apparent(
        &self,
        point: &TexelPoint,
        wi: Vec3,
        fill: impl Fn(usize, &Stencil, &[usize; 4], &mut Corners),
    ) -> Vec3 {
        let mut light = LightStencil::NONE;
        let Some(stencil) = self.lookup.angles.lit(&point.view, wi, point.wo, &mut light) else { return Vec3::ZERO };
        let footprint = self.lookup.footprint(point);
        let mut corners = [[Vec3::ZERO; 4]; 4];
        let mut sum = Vec3::ZERO;
        for (view, view_weight) in stencil.view.iter().filter(|s| s.1 > 0.0) {
            fill(view, stencil.light, &footprint.texel, &mut corners);
            for ((_, weight), texels) in stencil.light.iter().zip(&corners).filter(|(light, _)| light.1 > 0.0) {
                let value: Vec3 = texels.iter().zip(footprint.weight).map(|(&texel, w)| texel * w).sum();
                sum += view_weight * weight * value;
            }
        }
        sum.map(|v| self.linearizer.linear(v)) * stencil.factor
    }

    /// The luminance of the apparent value for a stored value under a sampled light.
    pub(super) fn luminance(&self, light: usize, stored: Vec3) -> f32 {
        let meta = &self.lookup.meta;
        let cosine = if meta.cosine == Cosine::Excluded { meta.lights.directions()[light].z } else { 1.0 };
        luminance(stored.map(|v| self.linearizer.linear(v)).to_array()) * cosine
    }
}
