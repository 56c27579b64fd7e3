//! Importance sampling for BTFs that have no faster access to values at sampled directions than evaluation.

use glam::Vec3;

use super::Material;
use super::texels::{Lookup, TexelMaterial, TexelPoint};
use crate::Result;
use crate::btf::BtfMeta;
use crate::direction::Scheme;

/// A BTF's material that cannot fail, combined with the sampler of BTFs.
pub(crate) struct Sampled<M> {
    material: M,
    lookup: Lookup,
}

impl<M: Material> Sampled<M> {
    /// Of a material with the directions and texels of `meta`.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the interpolation `scheme`.
    pub(crate) fn new(material: M, meta: &BtfMeta, scheme: Scheme) -> Result<Self> {
        Ok(Self { material, lookup: Lookup::new(meta, scheme)? })
    }
}

impl<M: Material> TexelMaterial for Sampled<M> {
    fn lookup(&self) -> &Lookup {
        &self.lookup
    }

    fn value(&self, point: &TexelPoint, wi: Vec3) -> Vec3 {
        self.material.apparent(point.uv, wi, point.wo)
    }

    fn check_values(&self) -> Result<()> {
        self.material.check()
    }
}
