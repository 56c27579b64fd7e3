//! The pinhole camera.

use glam::{Vec2, Vec3};

use super::Ray;
use crate::{Error, Result};

/// A perspective camera without lens; pixels are square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Where the rays begin, world coordinates.
    pub position: Vec3,
    /// What is in the middle of the picture.
    pub target: Vec3,
    /// Points up in the picture; need not be orthogonal to the view.
    pub up: Vec3,
    /// Full angle of view along the picture's shorter side, degrees.
    pub field_of_view_degrees: f32,
}

impl Camera {
    /// A camera that sees all of a ball, from an elevation above the horizon and an azimuth counted from
    /// the +z axis towards +x, degrees. `zoom` 1 makes the ball touch the picture's edges.
    pub fn around(centre: Vec3, radius: f32, elevation_degrees: f32, azimuth_degrees: f32, zoom: f32) -> Self {
        let field_of_view_degrees = 24.0f32;
        let (se, ce) = elevation_degrees.to_radians().sin_cos();
        let (sa, ca) = azimuth_degrees.to_radians().sin_cos();
        let distance = radius / (0.5 * field_of_view_degrees.to_radians()).sin() / zoom;
        let position = centre + distance * Vec3::new(ce * sa, se, ce * ca);
        Self { position, target: centre, up: Vec3::Y, field_of_view_degrees }
    }

    /// Prepares rays for a picture of this size.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the view direction is undefined, parallel to `up`, or the angle is not in 1..170.
    pub fn prepare(&self, width: usize, height: usize) -> Result<Rays> {
        let bad = |problem: String| Error::parameter("camera", problem);
        let forward = (self.target - self.position)
            .try_normalize()
            .ok_or_else(|| bad(format!("it looks from {} at the same point", self.position)))?;
        let right = forward
            .cross(self.up)
            .try_normalize()
            .ok_or_else(|| bad(format!("its up vector {} is parallel to its view", self.up)))?;
        let fov = self.field_of_view_degrees;
        if !(1.0..=170.0).contains(&fov) {
            return Err(bad(format!("the angle of view is {fov} degrees, expected 1 to 170")));
        }
        let pixel = 2.0 * (0.5 * fov.to_radians()).tan() / width.min(height) as f32;
        let down = forward.cross(right);
        let corner = forward - right * (0.5 * width as f32 * pixel) - down * (0.5 * height as f32 * pixel);
        Ok(Rays { position: self.position, corner, right: right * pixel, down: down * pixel })
    }

    /// Unit vectors to the right, up and towards the camera, the right one horizontal if `up` is vertical.
    pub fn axes(&self) -> [Vec3; 3] {
        let back = (self.position - self.target).normalize_or(Vec3::Z);
        let right = self.up.cross(back).normalize_or(Vec3::X);
        [right, back.cross(right), back]
    }
}

/// Rays through the pixels of one picture.
#[derive(Debug, Clone, Copy)]
pub struct Rays {
    position: Vec3,
    corner: Vec3,
    right: Vec3,
    down: Vec3,
}

impl Rays {
    /// The ray through a point in pixels, (0, 0) at the top left corner of the picture.
    #[inline]
    pub fn through(&self, pixel: Vec2) -> Ray {
        let direction = (self.corner + self.right * pixel.x + self.down * pixel.y).normalize();
        Ray { origin: self.position, direction }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_have_the_right_angles_and_orientation() {
        let camera = Camera { position: Vec3::ZERO, target: -Vec3::Z, up: Vec3::Y, field_of_view_degrees: 90.0 };
        let rays = camera.prepare(200, 100).unwrap();
        assert!((rays.through(Vec2::new(100.0, 50.0)).direction + Vec3::Z).length() < 1e-6);
        let top = rays.through(Vec2::new(100.0, 0.0)).direction;
        assert!((top - Vec3::new(0.0, 1.0, -1.0).normalize()).length() < 1e-6);
        let right = rays.through(Vec2::new(200.0, 50.0)).direction;
        assert!((right - Vec3::new(2.0, 0.0, -1.0).normalize()).length() < 1e-6);
        let [x, y, z] = camera.axes();
        assert!((x - Vec3::X).length() + (y - Vec3::Y).length() + (z - Vec3::Z).length() < 1e-6);
    }

    #[test]
    fn impossible_cameras_are_named() {
        let camera = Camera { position: Vec3::Y, target: Vec3::ZERO, up: Vec3::Y, field_of_view_degrees: 30.0 };
        assert!(camera.prepare(10, 10).unwrap_err().to_string().contains("parallel"));
        assert!(Camera { target: Vec3::Y, ..camera }.prepare(10, 10).is_err());
        assert!(Camera { up: Vec3::X, field_of_view_degrees: f32::NAN, ..camera }.prepare(10, 10).is_err());
    }
}
