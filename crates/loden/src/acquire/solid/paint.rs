//! How triangles reflect: an albedo, from a picture or not, under a coat.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use crate::acquire::texture::Texture;
use crate::{Error, Result};

/// A diffuse base under a coat of fibres.
#[derive(Debug, Clone)]
pub struct Paint {
    /// Diffuse albedo, linear RGB in 0..=1.
    pub albedo: Vec3,
    /// Multiplies the albedo.
    pub texture: Option<Arc<Texture>>,
    /// The coat.
    pub coat: Coat,
}

/// A GGX coat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coat {
    /// Specular reflectance at normal incidence, linear RGB in 0..=1; black means no coat.
    pub f0: Vec3,
    /// Roughness alpha along dP/du and across it, 0.02..=1.
    pub roughness: [f32; 2],
}

impl Paint {
    /// A paint of one colour.
    pub fn plain(albedo: Vec3, f0: f32, roughness: [f32; 2]) -> Self {
        Self { albedo, texture: None, coat: Coat { f0: Vec3::splat(f0), roughness } }
    }

    pub(super) fn check(&self) -> Result<()> {
        let fraction = |v: Vec3| v.cmpge(Vec3::ZERO).all() && v.cmple(Vec3::ONE).all();
        let rough = self.coat.roughness.iter().all(|alpha| (0.02..=1.0).contains(alpha));
        if fraction(self.albedo) && fraction(self.coat.f0) && rough {
            return Ok(());
        }
        Err(Error::parameter("paint", format!("out of range: albedo {}, {:?}", self.albedo, self.coat)))
    }

    /// The albedo at a texture coordinate.
    #[inline]
    pub(super) fn at(&self, uv: Vec2) -> Vec3 {
        match &self.texture {
            Some(texture) => (self.albedo * texture.at(uv)).clamp(Vec3::ZERO, Vec3::ONE),
            None => self.albedo,
        }
    }
}
