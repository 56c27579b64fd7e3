//! Levels of detail.

use glam::{Mat4, Vec3};

use super::Reader;
use super::request::{Request, RibResult};
use crate::render::Projection;

/// The size of a shape in the image, and the range of sizes at which it is drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Detail {
    /// Area in pixels.
    size: f32,
    /// Least and largest area, each the middle of a transition.
    range: [f32; 2],
}

impl Default for Detail {
    fn default() -> Self {
        Self { size: f32::INFINITY, range: [0.0, f32::INFINITY] }
    }
}

impl Detail {
    /// Whether shapes are drawn.
    pub(super) fn is_drawn(&self) -> bool {
        let [least, most] = self.range;
        self.size >= least && (self.size < most || most == f32::INFINITY)
    }
}

impl Reader {
    /// `Detail`, with the bounding box of what follows.
    pub(super) fn detail(&mut self, request: &Request) -> RibResult<()> {
        let (n, _) = request.numbers(6)?;
        let corner = |k: usize| Vec3::new(n[k & 1], n[2 + (k >> 1 & 1)], n[4 + (k >> 2 & 1)]);
        let settings = &self.scene.settings;
        let half = 0.5 * settings.width.min(settings.height) as f32;
        let place = |p: Vec3| {
            let p = self.transform.transform_point3(p);
            match self.scene.camera.projection {
                Projection::Perspective { field_of_view_degrees: fov } => {
                    (p.z > 1e-6).then(|| p * (half / (0.5 * fov).to_radians().tan() / p.z))
                }
                Projection::Orthographic { height } => Some(p * (2.0 * half / height)),
            }
        };
        // A box that reaches behind the camera fills the image.
        let corners: Option<Vec<Vec3>> = (0..8).map(|k| place(corner(k))).collect();
        self.attributes.detail.size = corners.map_or(f32::INFINITY, |corners| {
            let low = corners.iter().copied().fold(Vec3::INFINITY, Vec3::min);
            let high = corners.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
            (high.x - low.x) * (high.y - low.y)
        });
        Ok(())
    }

    /// `DetailRange`, with the least size, the end of its transition, and the same for the largest size.
    pub(super) fn detail_range(&mut self, request: &Request) -> RibResult<()> {
        let (n, _) = request.numbers(4)?;
        let most = if n[3] >= 1e37 { f32::INFINITY } else { 0.5 * (n[2] + n[3]) };
        self.attributes.detail.range = [0.5 * (n[0] + n[1]), most];
        Ok(())
    }

    /// From a camera ray's point of view: where the camera is in the current coordinates, or, for a parallel
    /// projection, the direction towards it with w = 0. `None` if the transform is singular.
    pub(super) fn viewer(&self) -> Option<glam::Vec4> {
        let inverse: Mat4 = self.transform.inverse();
        let viewer = match self.scene.camera.projection {
            Projection::Perspective { .. } => inverse.transform_point3(Vec3::ZERO).extend(1.0),
            Projection::Orthographic { .. } => inverse.transform_vector3(-Vec3::Z).extend(0.0),
        };
        viewer.is_finite().then_some(viewer)
    }
}
