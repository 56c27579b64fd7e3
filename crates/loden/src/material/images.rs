//! Shared by materials made of images, in memory or in a file.

use glam::Vec3;

use super::angles::{AngularStencil, LightStencil};
use super::interpolation::{Blending, Interpolation};
use super::texels::{Lookup, TexelPoint};
use crate::Result;
use crate::btf::{BtfMeta, Cosine};
use crate::color::domain::{Domain, Linearizer};
use crate::color::{Encoding, luminance};
use crate::direction::Stencil;

/// Numbers to average at the four texels of a footprint in one view: (light of the stencil, texel).
pub(super) type Corners = [[Vec3; 4]; 4];

/// Interpolation and sampling of images.
///
/// # Model
/// Linear light is interpolated linearly between texels, views and lights; on request stored values are, and the result
/// is converted to linear light.
#[derive(Debug)]
pub(super) struct Images {
    pub lookup: Lookup,
    linearizer: Linearizer,
    /// Whether linear light is averaged, not stored values.
    is_linear: bool,
    /// The numbers to average for 8-bit values.
    of_byte: Box<[f32; 256]>,
}

impl Images {
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the scheme of the interpolation.
    pub(super) fn new(meta: &BtfMeta, Interpolation { scheme, blending }: Interpolation) -> Result<Self> {
        let domain = if meta.encoding == Encoding::Linear { Domain::Linear } else { Domain::Display };
        let linearizer = Linearizer::new(domain, meta.encoding);
        let is_linear = domain != Domain::Linear && blending != Blending::Stored;
        let number = |byte: usize| {
            let stored = byte as f32 / 255.0;
            if is_linear { linearizer.linear(stored) } else { stored }
        };
        let of_byte = Box::new(std::array::from_fn(number));
        Ok(Self { lookup: Lookup::new(meta, scheme)?, linearizer, is_linear, of_byte })
    }

    /// The number to average for an 8-bit value.
    #[inline(always)]
    pub(super) fn byte(&self, stored: u8) -> f32 {
        self.of_byte[usize::from(stored)]
    }

    /// The number to average for a stored value.
    #[inline(always)]
    pub(super) fn number(&self, stored: f32) -> f32 {
        if self.is_linear { self.linearizer.linear(stored) } else { stored }
    }

    /// Converts averaged numbers to linear light.
    #[inline(always)]
    fn linear(&self, mean: Vec3) -> Vec3 {
        if self.is_linear { mean } else { mean.map(|v| self.linearizer.linear(v)) }
    }

    /// The apparent value. `fill` writes the numbers to average in one view for each light whose weight is positive.
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
        self.apparent_of(sum, &stencil)
    }

    /// The apparent value of averaged numbers.
    #[inline(always)]
    pub(super) fn apparent_of(&self, mean: Vec3, stencil: &AngularStencil) -> Vec3 {
        self.linear(mean) * stencil.factor
    }

    /// The luminance of the apparent value for the numbers of a texel under a sampled light.
    pub(super) fn luminance(&self, light: usize, numbers: Vec3) -> f32 {
        let meta = &self.lookup.meta;
        let cosine = if meta.cosine == Cosine::Excluded { meta.lights.directions()[light].z } else { 1.0 };
        luminance(self.linear(numbers).to_array()) * cosine
    }
}
