//! Bounding boxes and spheres.

use glam::Vec3;

/// A bounding sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// Centre, world coordinates.
    pub centre: Vec3,
    /// Radius.
    pub radius: f32,
}

impl Ball {
    /// The bounding sphere of points, centred on their bounding box.
    pub fn around(points: &[Vec3]) -> Self {
        let [low, high] = extent(points);
        let centre = if points.is_empty() { Vec3::ZERO } else { 0.5 * (low + high) };
        let radius = points.iter().map(|p| p.distance(centre)).fold(0.0, f32::max);
        Self { centre, radius }
    }
}

/// The bounding box of points: lowest and highest coordinates.
pub(super) fn extent(points: &[Vec3]) -> [Vec3; 2] {
    points.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], &p| [low.min(p), high.max(p)])
}
