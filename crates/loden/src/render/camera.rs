//! Cameras: perspective or orthographic, pinhole or thin lens.

use glam::{Vec2, Vec3};

use super::ray::Ray;
use crate::direction::concentric_disk;
use crate::{Error, Result};

/// The projection of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Central projection.
    Perspective {
        /// Full field of view along the shorter side of the image, degrees.
        field_of_view_degrees: f32,
    },
    /// Parallel projection.
    Orthographic {
        /// Extent of the image's shorter side, in world units.
        height: f32,
    },
}

/// A thin lens. Objects away from the plane of focus are blurred.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Radius of the aperture in world units; 0 for a pinhole.
    pub radius: f32,
    /// Distance of the plane of focus, along the view direction.
    pub focus: f32,
}

impl Lens {
    /// A pinhole: everything is in focus.
    pub const PINHOLE: Self = Self { radius: 0.0, focus: 1.0 };
}

/// A camera. Pixels are square unless the window and the image differ in aspect ratio.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position, in world coordinates.
    pub position: Vec3,
    /// The point at the centre of the image.
    pub target: Vec3,
    /// The up direction of the image; need not be perpendicular to the view direction.
    pub up: Vec3,
    /// Perspective or orthographic.
    pub projection: Projection,
    /// The lens.
    pub lens: Lens,
    /// Screen window: left, right, bottom, top, in half lengths of the image's shorter side; `None` for a centred
    /// window.
    pub window: Option<[f32; 4]>,
}

impl Camera {
    /// A perspective pinhole camera.
    pub const fn pinhole(position: Vec3, target: Vec3, field_of_view_degrees: f32) -> Self {
        let projection = Projection::Perspective { field_of_view_degrees };
        Self { position, target, up: Vec3::Y, projection, lens: Lens::PINHOLE, window: None }
    }

    /// A camera that frames a sphere, at an elevation above the horizon and an azimuth from +z towards +x, in
    /// degrees. With `zoom` 1 the sphere touches the edges of the image.
    pub fn around(centre: Vec3, radius: f32, elevation_degrees: f32, azimuth_degrees: f32, zoom: f32) -> Self {
        let field_of_view_degrees = 24.0f32;
        let (se, ce) = elevation_degrees.to_radians().sin_cos();
        let (sa, ca) = azimuth_degrees.to_radians().sin_cos();
        let distance = radius / (0.5 * field_of_view_degrees.to_radians()).sin() / zoom;
        let position = centre + distance * Vec3::new(ce * sa, se, ce * ca);
        Self::pinhole(position, centre, field_of_view_degrees)
    }

    /// Prepares rays for an image of this size.
    ///
    /// # Errors
    /// [`Error::Parameter`] if position and target coincide, the view direction is parallel to `up`, the field of view
    /// is outside 0.1..170 degrees, or height, lens or window are invalid.
    pub(crate) fn prepare(&self, width: usize, height: usize) -> Result<Rays> {
        let bad = |problem: String| Error::parameter("camera", problem);
        // Construct the camera frame
        let forward = (self.target - self.position)
            .try_normalize()
            .ok_or_else(|| bad(format!("position and target are the same point {}", self.position)))?;
        let right = forward
            .cross(self.up)
            .try_normalize()
            .ok_or_else(|| bad(format!("the up vector {} is parallel to the view direction", self.up)))?;
        // Determine the half extent of the image plane
        let (half, parallel) = match self.projection {
            Projection::Perspective { field_of_view_degrees: fov } if (0.1..=170.0).contains(&fov) => {
                ((0.5 * fov.to_radians()).tan(), false)
            }
            Projection::Perspective { field_of_view_degrees: fov } => {
                return Err(bad(format!("found a field of view of {fov} degrees, expected 0.1 to 170")));
            }
            Projection::Orthographic { height } if height > 0.0 && height.is_finite() => (0.5 * height, true),
            Projection::Orthographic { height } => {
                return Err(bad(format!("found an orthographic height of {height}, expected a positive number")));
            }
        };
        let Lens { radius, focus } = self.lens;
        if !(radius >= 0.0 && radius.is_finite() && focus > 0.0 && focus.is_finite()) {
            return Err(bad(format!(
                "found a lens of radius {radius} with focus at {focus}, expected a radius of at least 0 and a positive focus"
            )));
        }
        // Place the screen window
        let shorter = width.min(height) as f32;
        let (x, y) = (width as f32 / shorter, height as f32 / shorter);
        let [left, right_edge, bottom, top] = self.window.unwrap_or([-x, x, -y, y]).map(|edge| edge * half);
        if !(right_edge - left).is_normal() || !(top - bottom).is_normal() {
            return Err(bad(format!("found the window {:?}, expected left, right, bottom, top", self.window)));
        }
        let down = forward.cross(right);
        let pixel = (right * ((right_edge - left) / width as f32), down * ((top - bottom) / height as f32));
        let corner = right * left - down * top;
        Ok(Rays { position: self.position, forward, corner, pixel, parallel, lens: self.lens, aperture: [right, down] })
    }

    /// Unit vectors to the right, up and backwards. The right vector is horizontal if `up` is vertical.
    pub fn axes(&self) -> [Vec3; 3] {
        let back = (self.position - self.target).normalize_or(Vec3::Z);
        let right = self.up.cross(back).normalize_or(Vec3::X);
        [right, back.cross(right), back]
    }
}

/// Camera rays through the pixels of an image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rays {
    position: Vec3,
    forward: Vec3,
    /// Vector from the centre of the image plane, at distance 1, to its top left corner.
    corner: Vec3,
    /// Vectors from a pixel to the next on the right and below.
    pixel: (Vec3, Vec3),
    parallel: bool,
    lens: Lens,
    aperture: [Vec3; 2],
}

impl Rays {
    /// Whether rays start on a lens rather than at a point.
    pub fn has_lens(&self) -> bool {
        self.lens.radius > 0.0
    }

    /// The ray through `pixel`, (0, 0) being the top left corner of the image, and through the point of the lens that
    /// two numbers in [0, 1) select; a pinhole ignores them.
    #[inline(always)]
    pub fn through(&self, pixel: Vec2, lens: Vec2) -> Ray {
        let across = self.corner + self.pixel.0 * pixel.x + self.pixel.1 * pixel.y;
        let (origin, direction) =
            if self.parallel { (self.position + across, self.forward) } else { (self.position, self.forward + across) };
        if !self.has_lens() {
            return Ray { origin, direction: direction.normalize() };
        }
        // All rays through the lens converge where the central ray meets the plane of focus.
        let sharp = origin + direction * self.lens.focus;
        let p = concentric_disk(lens) * self.lens.radius;
        let origin = origin + self.aperture[0] * p.x + self.aperture[1] * p.y;
        Ray { origin, direction: (sharp - origin).normalize() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(camera: &Camera, x: f32, y: f32, random: Vec2) -> Ray {
        camera.prepare(200, 100).unwrap().through(Vec2::new(x, y), random)
    }

    #[test]
    fn rays_have_the_right_angles_and_orientation() {
        let camera = Camera::pinhole(Vec3::ZERO, -Vec3::Z, 90.0);
        let direction = |x: f32, y: f32| through(&camera, x, y, Vec2::ZERO).direction;
        assert!((direction(100.0, 50.0) + Vec3::Z).length() < 1e-6);
        assert!((direction(100.0, 0.0) - Vec3::new(0.0, 1.0, -1.0).normalize()).length() < 1e-6);
        assert!((direction(200.0, 50.0) - Vec3::new(2.0, 0.0, -1.0).normalize()).length() < 1e-6);
        let [x, y, z] = camera.axes();
        assert!((x - Vec3::X).length() + (y - Vec3::Y).length() + (z - Vec3::Z).length() < 1e-6);
    }

    #[test]
    fn parallel_rays_start_side_by_side() {
        let projection = Projection::Orthographic { height: 3.0 };
        let camera = Camera { projection, ..Camera::pinhole(Vec3::ZERO, -Vec3::Z, 1.0) };
        let ray = through(&camera, 200.0, 0.0, Vec2::ZERO);
        assert!((ray.origin - Vec3::new(3.0, 1.5, 0.0)).length() < 1e-6 && ray.direction == -Vec3::Z);
        let shifted = Camera { window: Some([0.0, 4.0, 0.0, 2.0]), ..camera };
        assert!(
            through(&shifted, 0.0, 100.0, Vec2::ZERO).origin.length() < 1e-6,
            "the corner of the window is on the axis"
        );
    }

    #[test]
    fn rays_through_a_lens_meet_in_its_plane_of_focus() {
        let lens = Lens { radius: 0.2, focus: 5.0 };
        let camera = Camera { lens, ..Camera::pinhole(Vec3::ZERO, -Vec3::Z, 60.0) };
        let at = |random: Vec2| {
            let ray = through(&camera, 30.0, 40.0, random);
            assert!(ray.origin.length() <= 0.2001 && ray.origin.z == 0.0);
            ray.origin + ray.direction * (-5.0 / ray.direction.z)
        };
        let sharp = at(Vec2::splat(0.5));
        for random in [Vec2::ZERO, Vec2::new(0.1, 0.9), Vec2::new(0.99, 0.3)] {
            assert!((at(random) - sharp).length() < 1e-5);
        }
    }

    #[test]
    fn invalid_cameras_are_errors() {
        let camera = Camera::pinhole(Vec3::Y, Vec3::ZERO, 30.0);
        assert!(camera.prepare(10, 10).unwrap_err().to_string().contains("parallel"));
        assert!(Camera { target: Vec3::Y, ..camera }.prepare(10, 10).is_err());
        let camera = Camera { up: Vec3::X, ..camera };
        assert!(camera.prepare(10, 10).is_ok());
        for projection in
            [Projection::Perspective { field_of_view_degrees: f32::NAN }, Projection::Orthographic { height: 0.0 }]
        {
            assert!(Camera { projection, ..camera }.prepare(10, 10).is_err());
        }
        assert!(Camera { lens: Lens { radius: -1.0, focus: 1.0 }, ..camera }.prepare(10, 10).is_err());
        assert!(Camera { window: Some([1.0, 1.0, 0.0, 1.0]), ..camera }.prepare(10, 10).is_err());
    }
}
