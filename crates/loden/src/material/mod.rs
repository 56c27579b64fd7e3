//! Materials: reflectance that can be evaluated and sampled, whatever its origin.
//!
//! A [`Material`] evaluates one point at a time, or prepares many points at once ([`Material::prepare`]). Renderers
//! prepare: whatever depends only on the texture coordinate and the viewer is computed once per point.

pub(crate) mod angles;
mod brdf;
mod failure;
mod images;
mod interpolation;
pub(crate) mod lobes;
mod measured;
mod paged;
mod pairs;
pub(crate) mod plain;
mod prepared;
mod raw;
pub(crate) mod sampled;
mod sampler;
pub(crate) mod texels;

use std::f32::consts::PI;

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

use crate::Result;
pub use brdf::TabulatedBrdf;
pub use failure::Failure;
pub use interpolation::{Blending, Interpolation};
pub use measured::{
    Asymmetry, Azimuths, Brdf, BrdfSample, HalfTable, InOutTable, Notes, Period, RglBrdf, RglData, Scattered, Table,
    Tabulated,
};
pub use paged::PagedBtf;
pub use prepared::{OneByOne, Point, Prepared};
pub use raw::RawBtf;

/// Physical properties of a material. Tests check every material for the properties it declares.
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

/// A direction drawn by [`Prepared::scatter`], and the value for it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Bounce {
    /// Unit vector towards the light, local frame.
    pub wi: Vec3,
    /// Probability density per solid angle, 1/sr; 0 if no direction was drawn.
    pub pdf: f32,
    /// The apparent value for the light from `wi`.
    pub value: Vec3,
}

/// What a surface does besides reflecting light: [`Material::own`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnLight {
    /// Emitted radiance, which illuminates other surfaces.
    pub emitted: Vec3,
    /// Radiance seen by the camera and in sharp reflections, which illuminates nothing: shading that stands for
    /// light which is not simulated.
    pub shown: Vec3,
    /// The fraction of light that does not pass straight through, per channel. What the surface emits, shows and
    /// reflects is multiplied by it.
    pub opacity: Vec3,
}

impl OwnLight {
    /// An opaque surface that only reflects light.
    pub const NONE: Self = Self { emitted: Vec3::ZERO, shown: Vec3::ZERO, opacity: Vec3::ONE };
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
///
/// Only [`Material::apparent`] is required. A material with a narrow lobe overrides [`Material::sample`] and
/// [`Material::pdf`] together; one that is evaluated faster in batches overrides [`Material::prepare`].
pub trait Material: Send + Sync {
    /// The apparent value rho = pi L_out / E_perp: the BRDF times pi times the light's cosine. This is what a
    /// BTF stores and what a renderer multiplies with E_perp / pi. Zero if either direction is below the surface.
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3;

    /// The BRDF f_r in 1/sr, without the cosine. A material that stores apparent values divides by the
    /// cosine, which is held at 0.01 or more so that grazing light stays finite.
    fn eval(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.apparent(uv, wi, wo) / (PI * wi.z.max(0.01))
    }

    /// The physical properties that the material has.
    fn promises(&self) -> Promises {
        Promises::default()
    }

    /// The number of texels along u and v in one repeat; `None` for a material without texels.
    fn texels(&self) -> Option<[usize; 2]> {
        None
    }

    /// Draws a light direction for the viewer `wo` from two uniform numbers in [0, 1). `None` if the sample
    /// fails. The default is cosine-distributed. The first call may take a moment, to build tables.
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

    /// Prepares evaluation and sampling at `points`. The result gives the same values, samples and densities as the
    /// functions above. The default calls them for one point at a time.
    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        Box::new(OneByOne { material: self, points })
    }

    /// The apparent values for a point and a light direction each. This is the fastest way to many values if no point is
    /// used twice; otherwise prepare the points.
    fn apparent_many(&self, points: &[Point], wi: &[Vec3], values: &mut [Vec3]) {
        const BATCH: usize = 64;
        let index: [u32; BATCH] = std::array::from_fn(|k| k as u32);
        for ((points, wi), values) in points.chunks(BATCH).zip(wi.chunks(BATCH)).zip(values.chunks_mut(BATCH)) {
            self.prepare(points).apparent(&index[..points.len()], wi, values);
        }
    }

    /// Whether the material is opaque and only reflects light: [`Material::own`] is then [`OwnLight::NONE`] everywhere.
    fn only_reflects(&self) -> bool {
        true
    }

    /// What the surface does besides reflecting light, seen from `wo`.
    fn own(&self, _uv: Vec2, _wo: Vec3) -> OwnLight {
        OwnLight::NONE
    }

    /// Fails if an evaluation or a draw has failed since the material was created: values returned since then are
    /// meaningless. A material that reads files during evaluation keeps its first error in a [`Failure`]; others
    /// cannot fail. Call this before using values of a material of unknown type.
    ///
    /// # Errors
    /// The first error, on every call.
    fn check(&self) -> Result<()> {
        Ok(())
    }
}
