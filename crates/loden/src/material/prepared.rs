//! Evaluation of a material at many points.

use glam::{Vec2, Vec3};

use super::{Bounce, Material, Sample};

/// A point on a material and the direction from which it is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Texture coordinate.
    pub uv: Vec2,
    /// Unit vector towards the viewer, local frame.
    pub wo: Vec3,
}

/// Points on a material, ready for evaluation: [`Material::prepare`].
///
/// All slices in a call have the same length. Entry k of the result belongs to the point `index[k]`; indices may be
/// in any order and repeat. A call panics if an index is out of range.
pub trait Prepared {
    /// [`Material::apparent`] for the light directions `wi`.
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]);

    /// [`Material::sample`] with the values for the directions drawn.
    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]);

    /// [`Material::pdf`] for the light directions `wi`.
    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]);
}

/// Points on a material that prepares nothing: the default of [`Material::prepare`].
#[derive(Debug)]
pub struct OneByOne<'a, M: ?Sized> {
    /// The material.
    pub material: &'a M,
    /// The points.
    pub points: &'a [Point],
}

impl<M: Material + ?Sized> Prepared for OneByOne<'_, M> {
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        for ((value, &index), &wi) in values.iter_mut().zip(index).zip(wi) {
            let Point { uv, wo } = self.points[index as usize];
            *value = self.material.apparent(uv, wi, wo);
        }
    }

    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        for ((bounce, &index), &random) in bounces.iter_mut().zip(index).zip(random) {
            let Point { uv, wo } = self.points[index as usize];
            *bounce = match self.material.sample(uv, wo, random) {
                Some(Sample { wi, pdf }) => Bounce { wi, pdf, value: self.material.apparent(uv, wi, wo) },
                None => Bounce::NONE,
            };
        }
    }

    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]) {
        for ((density, &index), &wi) in densities.iter_mut().zip(index).zip(wi) {
            let Point { uv, wo } = self.points[index as usize];
            *density = self.material.pdf(uv, wi, wo);
        }
    }
}
