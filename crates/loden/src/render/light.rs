//! Lights: directional, point, spot and area lights.

mod area;

use glam::{Vec2, Vec3};

pub use area::{AreaLight, Emitter, Flat};

use crate::direction::{Frame, concentric_disk, from_angles};

/// A light source.
#[derive(Debug, Clone, PartialEq)]
pub enum Light {
    /// From infinitely far away; invisible itself.
    Directional(DirectionalLight),
    /// From a point; invisible itself.
    Point(PointLight),
    /// From a point into a cone; invisible itself.
    Spot(SpotLight),
    /// From a surface, which can be seen and casts shadows.
    Area(AreaLight),
    /// A light without shadows: it reaches everything that faces it, whatever is in between, and is not reflected
    /// further from there. Only a body seen from its inside keeps the light out: closed bodies stay dark inside.
    Shadowless(Box<Light>),
}

impl From<DirectionalLight> for Light {
    fn from(light: DirectionalLight) -> Self {
        Self::Directional(light)
    }
}

/// Light that arrives at a point from one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Arriving {
    /// Unit vector towards the light.
    pub direction: Vec3,
    /// Distance to the light.
    pub distance: f32,
    /// Irradiance on a surface facing the light; for an area light, the estimate from this direction alone.
    pub irradiance: Vec3,
    /// The density of the direction, 1/sr; 0 if no material could have drawn it.
    pub pdf: f32,
}

impl Light {
    /// Draws a direction from which light arrives; `None` if there is none. `random` returns two numbers in [0, 1)
    /// and is called only for lights with an extent.
    #[inline]
    pub(super) fn arriving(&self, at: Vec3, random: impl FnOnce() -> Vec2) -> Option<Arriving> {
        let light = if let Self::Shadowless(light) = self { light } else { self };
        match light {
            Self::Directional(light) => {
                let direction = if light.radius_degrees > 0.0 { light.sample(random()) } else { light.direction };
                let irradiance = light.irradiance * light.widening();
                Some(Arriving { direction, distance: f32::INFINITY, irradiance, pdf: 0.0 })
            }
            Self::Point(light) => from_point(at, light.position, light.intensity),
            Self::Spot(light) => light.arriving(at),
            Self::Area(light) => light.arriving(at, random()),
            Self::Shadowless(_) => None,
        }
    }

    /// Whether bodies between the light and a surface keep the light off.
    #[inline]
    pub(super) fn casts_shadows(&self) -> bool {
        !matches!(self, Self::Shadowless(_))
    }
}

#[inline]
fn from_point(at: Vec3, position: Vec3, intensity: Vec3) -> Option<Arriving> {
    let to_light = position - at;
    let distance = to_light.length();
    let direction = to_light.try_normalize()?;
    Some(Arriving { direction, distance, irradiance: intensity / (distance * distance), pdf: 0.0 })
}

/// A light that shines from one point in all directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointLight {
    /// Position, world coordinates.
    pub position: Vec3,
    /// Radiant intensity, per steradian: a surface facing it at distance d has irradiance intensity / d^2.
    pub intensity: Vec3,
}

/// A light that shines from one point into a cone.
///
/// # Model
/// I = intensity cos^falloff(a) smoothstep(cos(angle), cos(angle - edge), cos(a)) at the angle a from the axis.
///
/// # References
/// pixar2000 (the shader `spotlight`)
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpotLight {
    /// Position, world coordinates.
    pub position: Vec3,
    /// Unit vector along the axis, away from the light.
    pub axis: Vec3,
    /// Radiant intensity along the axis, per steradian.
    pub intensity: Vec3,
    /// Half the angle of the cone, degrees.
    pub angle_degrees: f32,
    /// Width of the fade at the edge of the cone, degrees; 0 is a sharp edge.
    pub edge_degrees: f32,
    /// Power of the cosine with which the light falls off from the axis; 0 is constant.
    pub falloff: f32,
}

impl SpotLight {
    #[inline]
    fn arriving(&self, at: Vec3) -> Option<Arriving> {
        let arriving = from_point(at, self.position, self.intensity)?;
        let cosine = -arriving.direction.dot(self.axis);
        let outer = self.angle_degrees.to_radians().cos();
        if cosine <= outer {
            return None;
        }
        let inner = (self.angle_degrees - self.edge_degrees).max(0.0).to_radians().cos();
        let x = if inner > outer { ((cosine - outer) / (inner - outer)).min(1.0) } else { 1.0 };
        let fade = x * x * (3.0 - 2.0 * x) * if self.falloff == 0.0 { 1.0 } else { cosine.max(0.0).powf(self.falloff) };
        Some(Arriving { irradiance: arriving.irradiance * fade, ..arriving })
    }
}

/// A light at infinity: parallel, or a small disc of the sky for soft shadows.
///
/// # Model
/// A disc of angular radius r has constant radiance E_perp / (pi sin^2 r), so that a surface that faces its centre and
/// sees all of it has the irradiance E_perp. Directions are drawn uniformly from its solid angle 2 pi (1 - cos r).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionalLight {
    /// Unit vector towards the light, world coordinates.
    pub direction: Vec3,
    /// Irradiance E_perp on a surface that faces the light. A white Lambertian surface lit by E_perp = pi has
    /// radiance 1.
    pub irradiance: Vec3,
    /// Angular radius, at most 90 degrees; 0 is exactly parallel light.
    pub radius_degrees: f32,
}

impl DirectionalLight {
    /// A direction towards a point of the light, uniform in solid angle.
    #[inline]
    pub(crate) fn sample(&self, random: Vec2) -> Vec3 {
        let frame = Frame::from_normal(self.direction);
        let p = concentric_disk(random);
        // 1 - cos of the light's radius and of the direction's angle: precise even for small angles
        let edge = 2.0 * (0.5 * self.radius_degrees.to_radians()).sin().powi(2);
        let h = edge * p.length_squared();
        let sine = (edge * (2.0 - h)).sqrt();
        (self.direction * (1.0 - h) + frame.tangent * (p.x * sine) + frame.bitangent * (p.y * sine)).normalize()
    }

    /// Ratio of solid angle to projected solid angle of the light: what a facing surface loses because parts of the
    /// light are not straight ahead.
    #[inline]
    fn widening(&self) -> f32 {
        2.0 / (1.0 + self.radius_degrees.to_radians().cos())
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
        fn samples_stay_on_the_disc_of_the_light(x in 0.0f32..1.0, y in 0.0f32..1.0, theta in 0.0f32..3.1, radius in 0.0f32..90.0) {
            let light = DirectionalLight {
                direction: from_up(theta, 1.0),
                irradiance: Vec3::ONE,
                radius_degrees: radius,
            };
            let w = light.sample(Vec2::new(x, y));
            prop_assert!((w.length() - 1.0).abs() < 1e-5);
            let angle = w.cross(light.direction).length().atan2(w.dot(light.direction)).to_degrees();
            prop_assert!(angle <= radius + 0.05, "{angle}");
        }
    }

    #[test]
    fn facing_surfaces_have_the_stated_irradiance() {
        for radius_degrees in [0.0, 0.3, 20.0, 45.0, 89.0] {
            let sun = DirectionalLight { direction: Vec3::Y, irradiance: Vec3::splat(3.0), radius_degrees };
            let n = 64;
            let cell = |i: usize| Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            let arriving = (0..n * n).map(|i| Light::from(sun).arriving(Vec3::ZERO, || cell(i)).unwrap());
            let sum: f64 = arriving.map(|a| f64::from(a.irradiance.x * a.direction.y)).sum();
            let mean = sum / (n * n) as f64;
            assert!((mean - 3.0).abs() < 3e-3, "{radius_degrees}: {mean}");
        }
    }

    #[test]
    fn spots_fade_towards_their_edge() {
        let spot = SpotLight {
            position: Vec3::Y * 2.0,
            axis: -Vec3::Y,
            intensity: Vec3::splat(8.0),
            angle_degrees: 45.0,
            edge_degrees: 10.0,
            falloff: 0.0,
        };
        let at = |degrees: f32| {
            let found = spot.arriving(Vec3::new(2.0 * degrees.to_radians().tan(), 0.0, 0.0));
            found.map_or(0.0, |a| a.irradiance.x * a.distance * a.distance)
        };
        assert_eq!(at(46.0), 0.0);
        assert!((at(0.0) - 8.0).abs() < 1e-5 && (at(34.0) - 8.0).abs() < 1e-4);
        assert!(at(40.0) > at(43.0) && at(43.0) > 0.0 && at(40.0) < 8.0);
        assert!(
            (SpotLight { falloff: 2.0, ..spot }.arriving(Vec3::X).unwrap().irradiance.x - 8.0 * 0.8 / 5.0).abs() < 1e-5
        );
    }

    #[test]
    fn angles_count_from_up_and_from_the_right() {
        use std::f32::consts::FRAC_PI_2;
        assert!((from_up(0.0, 0.3) - Vec3::Y).length() < 1e-6);
        assert!((from_up(FRAC_PI_2, 0.0) - Vec3::X).length() < 1e-6);
        assert!((from_up(FRAC_PI_2, FRAC_PI_2) - Vec3::Z).length() < 1e-6);
    }
}
