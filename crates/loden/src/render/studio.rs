//! The studio: a scene for judging a material.

use glam::{Vec2, Vec3};

use super::light::from_up;
use super::object::Object;
use super::{Body, DirectionalLight, Disc, Environment, EnvironmentMap, Scene, Settings, Shape, TextureMap, render};
use crate::material::Material;
use crate::picture::Picture;
use crate::progress::Progress;
use crate::{Error, Result};

/// The light in the studio.
#[derive(Debug, Clone)]
pub enum Lighting {
    /// One soft directional light and a weak sky, which fills the shadows.
    Key {
        /// Angle between the light and the vertical, degrees.
        theta_degrees: f32,
        /// Azimuth of the light, degrees: 0 from the right, 90 from the camera, 180 from the left.
        phi_degrees: f32,
    },
    /// An environment picture, which is also the background.
    Environment(Box<EnvironmentMap>),
}

impl Default for Lighting {
    fn default() -> Self {
        Self::Key { theta_degrees: 42.0, phi_degrees: 140.0 }
    }
}

/// A material on an object in the studio.
pub struct Studio<'a> {
    /// The object.
    pub object: &'a Object,
    /// The material it wears.
    pub material: &'a dyn Material,
    /// Name of the material in errors.
    pub material_name: &'a str,
    /// How the material is mapped onto the object.
    pub texture: TextureMap,
    /// The light.
    pub lighting: Lighting,
}

/// Irradiance of the key light over pi, which is the radiance of a white surface that faces it.
const KEY: f32 = 0.88;

/// Radiance of the sky beside the key light.
const FILL: f32 = 0.2;

/// Angular radius of the key light, degrees.
const KEY_RADIUS: f32 = 5.0;

/// Renders an object wearing a material. Without an environment, a white surface that faces the light reads
/// about 1, so that the picture needs no exposure.
///
/// # Errors
/// As [`render`] and [`studio_scene`].
pub fn studio(studio: &Studio, settings: &Settings, progress: &dyn Progress) -> Result<Picture> {
    render(&studio_scene(studio)?, settings, progress)
}

/// The scene of [`studio`].
///
/// # Errors
/// [`Error::Parameter`] for invalid angles, scale or rotation.
pub fn studio_scene<'a>(studio: &Studio<'a>) -> Result<Scene<'a>> {
    let object = studio.object;
    studio.texture.check()?;
    let bounds = object.shape.bounds();
    let floor = |radius: f32| Disc { centre: bounds.centre.with_y(object.floor), radius: radius * bounds.radius };
    let wearing = Body {
        shape: object.shape.clone(),
        material: studio.material,
        material_name: studio.material_name.into(),
        texture: TextureMap {
            rotation_degrees: studio.texture.rotation_degrees + object.turn_degrees,
            ..studio.texture
        },
    };
    let standing = |disc: Disc, material| Body {
        shape: Shape::Disc(disc),
        material,
        material_name: "floor".into(),
        texture: TextureMap::default(),
    };
    let (lights, environment, ground) = match &studio.lighting {
        Lighting::Key { theta_degrees, phi_degrees } => {
            let light = key(*theta_degrees, *phi_degrees)?;
            (
                vec![light.into()],
                Environment::Constant(Vec3::splat(FILL)),
                standing(floor(60.0), &SEAMLESS as &dyn Material),
            )
        }
        Lighting::Environment(map) => (Vec::new(), Environment::Map(map.clone()), standing(floor(1.6), &TABLE)),
    };
    let bodies = vec![wearing, ground];
    Ok(Scene { bodies, lights, environment, background: None, camera: object.camera })
}

fn key(theta_degrees: f32, phi_degrees: f32) -> Result<DirectionalLight> {
    if !(0.0..=90.0).contains(&theta_degrees) || !phi_degrees.is_finite() {
        let problem = format!("found {theta_degrees},{phi_degrees}, expected theta in 0..90 and phi, in degrees");
        return Err(Error::parameter("light", problem));
    }
    Ok(DirectionalLight {
        direction: from_up(theta_degrees.to_radians(), phi_degrees.to_radians()),
        irradiance: Vec3::splat(KEY * std::f32::consts::PI),
        radius_degrees: KEY_RADIUS,
    })
}

/// The floor of the studio, lighter under the object, like a paper backdrop under a spot light.
const SEAMLESS: Floor =
    Floor { near: Vec3::new(0.62, 0.615, 0.60), far: Vec3::new(0.30, 0.305, 0.315), reach: 6.5 / 60.0 };

/// The table in an environment.
const TABLE: Floor = Floor { near: Vec3::splat(0.4), far: Vec3::splat(0.4), reach: 1.0 };

/// A diffuse disc whose albedo falls off smoothly from its centre.
struct Floor {
    near: Vec3,
    far: Vec3,
    /// Where the falloff ends, in radii of the disc.
    reach: f32,
}

impl Material for Floor {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return Vec3::ZERO;
        }
        let x = (uv.length() / self.reach).min(1.0);
        self.near.lerp(self.far, x * x * (3.0 - 2.0 * x)) * wi.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use crate::render::{Guides, object};

    /// Its texture coordinates as colours.
    struct Place;

    impl Material for Place {
        fn apparent(&self, uv: Vec2, wi: Vec3, _wo: Vec3) -> Vec3 {
            let (u, v) = (uv.x.rem_euclid(1.0), uv.y.rem_euclid(1.0));
            Vec3::new(u, v, 0.5) * wi.z.max(0.0)
        }
    }

    #[test]
    fn the_sphere_shows_samples_upright() {
        let object = object::load("sphere").unwrap();
        let texture = TextureMap { scale: 0.3, ..TextureMap::default() };
        let lighting = Lighting::default();
        let studio = Studio { object: &object, material: &Place, material_name: "place", texture, lighting };
        let settings = Settings { width: 64, height: 64, ..Settings::default() };
        let seen = Guides::of(&studio_scene(&studio).unwrap(), &settings, &Silent).unwrap().albedo;
        // near the middle of the picture, away from the seam
        let at = |x: usize, y: usize| seen[y * 64 + x];
        let step = |from: Vec3, to: Vec3| to - from;
        let (right, up) = (step(at(30, 30), at(34, 30)), step(at(32, 32), at(32, 28)));
        assert!(right.x > 0.005 && right.x > 3.0 * right.y.abs(), "{right}");
        assert!(up.y > 0.005 && up.y > 3.0 * up.x.abs(), "{up}");
    }
}
