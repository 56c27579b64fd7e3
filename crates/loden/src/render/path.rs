//! Paths of light.

use glam::Vec3;

use super::ray::Ray;
use super::sampler::Sampler;

/// A path that has not ended.
pub(super) struct Path {
    pub ray: Ray,
    pub throughput: Vec3,
    /// The density with which the material drew the ray; `None` for a camera ray.
    pub drawn: Option<f32>,
    pub sampler: Sampler,
    /// Index of its camera sample.
    pub place: u32,
}
