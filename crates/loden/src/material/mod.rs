//! What can be evaluated: everything a renderer, an exporter or a metric needs to know of a material.

pub mod angles;
mod brdf;
mod images;
pub(crate) mod lobes;
mod measured;
mod paged;
pub(crate) mod plain;
mod raw;
pub(crate) mod sampled;
mod sampler;
pub(crate) mod texels;

use std::f32::consts::PI;

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

use crate::Result;
pub use brdf::TabulatedBrdf;
pub use measured::{
    Azimuths, BrdfSample, HalfTable, InOutTable, Brdf, Notes, Period, RglBrdf, RglData, Scattered, Table,
    Tabulated,
};
pub use paged::PagedBtf;
pub use raw::RawBtf;
pub use texels::Seen;

/// Physical properties a material declares, and is tested for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Promises {
    /// `eval(wi, wo) == eval(wo, wi)`.
    pub reciprocal: bool,
    /// The directional albedo never exceeds 1.
    pub energy_conserving: bool,
    /// Rotating both directions about the normal changes nothing.
    pub isotropic: bool,
}

/// A direction drawn by [`Material::sample`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Unit vector towards the light, local frame.
    pub wi: Vec3,
    /// Probability density per solid angle, 1/sr.
    pub pdf: f32,
}

/// A direction drawn by [`Material::scatter_many`], and what is seen of the light from there.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Bounce {
    /// Unit vector towards the light, local frame.
    pub wi: Vec3,
    /// Probability density per solid angle, 1/sr; 0 if no direction was drawn.
    pub pdf: f32,
    /// The apparent value.
    pub value: Vec3,
}

impl Bounce {
    /// No direction.
    pub const NONE: Self = Self { wi: Vec3::ZERO, pdf: 0.0, value: Vec3::ZERO };
}

/// A material that can be evaluated at a texture coordinate for a pair of directions.
///
/// Directions are unit vectors in the local frame (x = tangent, y = bitangent, z = normal) that point away
/// from the surface: `wi` towards the light, `wo` towards the viewer. `uv` is continuous and periodic with
/// period 1; u runs right, v up, so image row 0 lies at v = 1. Colours are linear sRGB/Rec. 709.
pub trait Material: Send + Sync {
    /// The apparent value rho = pi L_out / E_perp: the BRDF times pi times the light's cosine. This is what a
    /// BTF stores and what a renderer multiplies with E_perp / pi. Zero if either direction is below the surface.
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3;

    /// The BRDF f_r in 1/sr, without the cosine. A material that stores apparent values divides by the
    /// cosine, which is held at 0.01 or more so that grazing light stays finite.
    fn eval(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.apparent(uv, wi, wo) / (PI * wi.z.max(0.01))
    }

    /// What the material promises.
    fn promises(&self) -> Promises {
        Promises::default()
    }

    /// How many texels there are along u and v of one repeat; `None` if there are none.
    fn texels(&self) -> Option<[usize; 2]> {
        None
    }

    /// Builds what sampling needs, where that takes a moment; a renderer calls it before its first ray. Until then
    /// [`Material::sample`] and [`Material::pdf`] may be cosine-distributed. Nothing happens the second time.
    ///
    /// # Errors
    /// What reading the material gives.
    fn prepare(&self) -> Result<()> {
        Ok(())
    }

    /// Draws a light direction for the viewer `wo` from two uniform numbers in [0, 1). `None` if the sample
    /// fails; by default cosine-distributed.
    fn sample(&self, _uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = crate::direction::cosine_hemisphere(random);
        (wi.z > 0.0).then_some(Sample { wi, pdf: wi.z / PI })
    }

    /// The density of [`Material::sample`], 1/sr.
    fn pdf(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        if wi.z > 0.0 && wo.z > 0.0 { wi.z / PI } else { 0.0 }
    }

    /// Prepares evaluations that have the texture coordinate and the viewer in common.
    fn seen(&self, uv: Vec2, wo: Vec3) -> Seen {
        Seen::new(uv, wo)
    }

    /// [`Material::apparent`] of what [`Material::seen`] of the same material gave.
    fn apparent_seen(&self, seen: &Seen, wi: Vec3) -> Vec3 {
        self.apparent(seen.uv, wi, seen.wo)
    }

    /// [`Material::sample`] likewise.
    fn sample_seen(&self, seen: &Seen, random: Vec2) -> Option<Sample> {
        self.sample(seen.uv, seen.wo, random)
    }

    /// [`Material::pdf`] likewise.
    fn pdf_seen(&self, seen: &Seen, wi: Vec3) -> f32 {
        self.pdf(seen.uv, wi, seen.wo)
    }

    /// [`Material::apparent_seen`] of as many points and directions as there are values; faster than one by one.
    fn apparent_many(&self, seen: &[&Seen], wi: &[Vec3], values: &mut [Vec3]) {
        for ((value, seen), wi) in values.iter_mut().zip(seen).zip(wi) {
            *value = self.apparent_seen(seen, *wi);
        }
    }

    /// [`Material::sample_seen`] of as many points as there are bounces, with the apparent values there; faster than one
    /// by one.
    fn scatter_many(&self, seen: &[&Seen], random: &[Vec2], bounces: &mut [Bounce]) {
        for ((bounce, seen), random) in bounces.iter_mut().zip(seen).zip(random) {
            *bounce = match self.sample_seen(seen, *random) {
                Some(Sample { wi, pdf }) => Bounce { wi, pdf, value: self.apparent_seen(seen, wi) },
                None => Bounce::NONE,
            };
        }
    }
}
