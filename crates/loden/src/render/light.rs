//! Light from infinitely far away in one direction.

use glam::{Vec2, Vec3};

use crate::direction::{Frame, concentric_disk, from_angles};

/// A light at infinity: parallel, or from a small disc of the sky when it shall cast soft shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionalLight {
    /// Unit vector towards the light, world coordinates.
    pub direction: Vec3,
    /// Irradiance E_perp on a surface that faces the light. A white Lambertian surface lit by E_perp = pi has
    /// radiance 1.
    pub irradiance: Vec3,
    /// Half the angle under which the light is seen, degrees; 0 is exactly parallel light.
    pub radius_degrees: f32,
}

impl DirectionalLight {
    /// A direction towards a point of the light, uniform over a flat disc at unit distance.
    #[inline]
    pub fn sample(&self, random: Vec2) -> Vec3 {
        let frame = Frame::from_normal(self.direction);
        let p = concentric_disk(random) * self.radius_degrees.to_radians().tan();
        (self.direction + frame.tangent * p.x + frame.bitangent * p.y).normalize()
    }
}

/// The world direction of polar angle `theta` from the up axis +y and azimuth `phi` (radians) seen from a camera
/// in front: phi 0 is to the right (+x), pi/2 towards the camera (+z), pi to the left.
pub fn from_up(theta: f32, phi: f32) -> Vec3 {
    let w = from_angles(theta, phi);
    Vec3::new(w.x, w.z, w.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn samples_stay_on_the_disc_of_the_light(x in 0.0f32..1.0, y in 0.0f32..1.0, theta in 0.0f32..3.1, radius in 0.0f32..20.0) {
            let light = DirectionalLight {
                direction: from_up(theta, 1.0),
                irradiance: Vec3::ONE,
                radius_degrees: radius,
            };
            let w = light.sample(Vec2::new(x, y));
            prop_assert!((w.length() - 1.0).abs() < 1e-5);
            let angle = w.cross(light.direction).length().asin().to_degrees();
            prop_assert!(angle <= radius + 0.05, "{angle}");
        }
    }

    #[test]
    fn angles_count_from_up_and_from_the_right() {
        use std::f32::consts::FRAC_PI_2;
        assert!((from_up(0.0, 0.3) - Vec3::Y).length() < 1e-6);
        assert!((from_up(FRAC_PI_2, 0.0) - Vec3::X).length() < 1e-6);
        assert!((from_up(FRAC_PI_2, FRAC_PI_2) - Vec3::Z).length() < 1e-6);
    }
}
