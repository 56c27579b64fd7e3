//! Bodies, lights and a camera.

use glam::{Vec2, Vec3};

use super::camera::Camera;
use super::environment::Environment;
use super::light::Light;
use super::shape::{Hit, Shape};
use crate::direction::Frame;
use crate::material::Material;

/// Everything a picture is made from.
pub struct Scene<'a> {
    /// What can be seen.
    pub bodies: Vec<Body<'a>>,
    /// What sheds light.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub environment: Environment,
    /// The radiance the camera sees where there is nothing, if it is not that of the environment.
    pub background: Option<Vec3>,
    /// From where it is seen.
    pub camera: Camera,
}

/// A shape wearing a material.
pub struct Body<'a> {
    /// Where rays hit it.
    pub shape: Shape,
    /// What it wears.
    pub material: &'a dyn Material,
    /// What errors call the material.
    pub material_name: String,
    /// How the material lies on the shape.
    pub texture: TextureMap,
}

/// How a material lies on a shape's texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TextureMap {
    /// Repeats of the material per repeat of the shape's texture coordinates.
    pub scale: f32,
    /// Turns the material counter-clockwise on the surface, with its grain and its highlights, degrees.
    pub rotation_degrees: f32,
}

impl Default for TextureMap {
    fn default() -> Self {
        Self { scale: 1.0, rotation_degrees: 0.0 }
    }
}

/// A point of a body's surface seen from one side: all a material needs.
pub(super) struct Shading {
    /// Texture coordinate of the material.
    pub uv: Vec2,
    /// x and y along the material's u and v, z on the viewer's side. Left-handed where the material is seen
    /// mirrored: on the back of a sheet, or with mirrored texture coordinates.
    pub frame: Frame,
    /// Unit vector towards the viewer, local.
    pub wo: Vec3,
    /// Start of rays that leave.
    pub origin: Vec3,
}

/// The least cosine between the shading normal and the viewer.
const LEAST_COSINE: f32 = 1e-3;

impl TextureMap {
    /// The material's view of a hit from the unit vector `viewer`, world coordinates.
    ///
    /// A shading normal that faces away from the viewer, as interpolated normals do near a silhouette, is bent
    /// until the viewer is just above its horizon.
    #[inline]
    pub(super) fn shading(&self, hit: &Hit, viewer: Vec3) -> Shading {
        let flipped = if hit.normal.dot(hit.geometric) < 0.0 { -1.0 } else { 1.0 };
        let mut normal = hit.normal * flipped;
        let cosine = normal.dot(viewer);
        if cosine < LEAST_COSINE {
            normal = (normal + viewer * (LEAST_COSINE - cosine)).normalize_or(viewer);
        }
        let mut frame = Frame::from_normal_tangent(normal, hit.tangent);
        frame.bitangent *= hit.handedness * flipped;
        let (sin, cos) =
            if self.rotation_degrees == 0.0 { (0.0, 1.0) } else { self.rotation_degrees.to_radians().sin_cos() };
        let turn = Vec2::new(cos, -sin);
        let (tangent, bitangent) = (frame.tangent, frame.bitangent);
        frame.tangent = tangent * cos + bitangent * sin;
        frame.bitangent = bitangent * cos - tangent * sin;
        let mut wo = frame.local(viewer);
        wo.z = wo.z.max(0.5 * LEAST_COSINE);
        Shading {
            uv: turn.rotate(hit.uv) * self.scale,
            frame,
            wo: wo.normalize(),
            origin: offset(hit.lifted, hit.geometric),
        }
    }
}

/// Moves a point off a surface along its normal, far enough that rounding cannot put a ray's start behind it.
///
/// # References
/// waechter2019
#[inline]
fn offset(p: Vec3, n: Vec3) -> Vec3 {
    const NEAR_ZERO: f32 = 1.0 / 32.0;
    const FLOAT_STEP: f32 = 1.0 / 65_536.0;
    const ULPS: f32 = 256.0;
    let component = |p: f32, n: f32| {
        if p.abs() < NEAR_ZERO {
            return p + FLOAT_STEP * n;
        }
        let ulps = (ULPS * n) as i32;
        f32::from_bits(p.to_bits().wrapping_add_signed(if p < 0.0 { -ulps } else { ulps }))
    };
    Vec3::new(component(p.x, n.x), component(p.y, n.y), component(p.z, n.z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit() -> impl Strategy<Value = Vec3> {
        (0.0f32..3.1, 0.0f32..6.2).prop_map(|(t, p)| crate::direction::from_angles(t, p))
    }

    proptest! {
        #[test]
        fn offsets_are_small_and_outwards(n in unit(), x in unit(), scale in 0.0f32..1000.0) {
            let p = x * scale;
            let moved = (offset(p, n) - p).dot(n);
            prop_assert!(moved > 0.0 && moved < 1e-4 * scale.max(1.0), "{moved}");
        }

        #[test]
        fn the_viewer_is_always_above_the_shading_normal(n in unit(), g in unit(), t in unit(), viewer in unit()) {
            prop_assume!(g.dot(viewer) > 1e-3);
            let hit = Hit {
                position: Vec3::ZERO, lifted: Vec3::ZERO, geometric: g, normal: n, tangent: t, handedness: 1.0,
                uv: Vec2::ZERO,
            };
            let shading = TextureMap { scale: 1.0, rotation_degrees: 33.0 }.shading(&hit, viewer);
            prop_assert!(shading.wo.z > 0.0);
            prop_assert!((shading.wo.length() - 1.0).abs() < 1e-5);
            let frame = shading.frame;
            let back = frame.world(frame.local(viewer));
            prop_assert!((back - viewer).length() < 1e-4, "orthonormal");
        }
    }

    #[test]
    fn rotation_turns_texture_and_frame_alike() {
        let hit = Hit {
            position: Vec3::ZERO,
            lifted: Vec3::ZERO,
            geometric: Vec3::Z,
            normal: Vec3::Z,
            tangent: Vec3::X,
            handedness: 1.0,
            uv: Vec2::new(0.0, 1.0),
        };
        let shading = TextureMap { scale: 2.0, rotation_degrees: 90.0 }.shading(&hit, Vec3::Z);
        // the material's u axis now points along the shape's v
        assert!((shading.frame.tangent - Vec3::Y).length() < 1e-6);
        assert!((shading.frame.bitangent + Vec3::X).length() < 1e-6);
        assert!((shading.uv - Vec2::new(2.0, 0.0)).length() < 1e-6);
    }

    #[test]
    fn the_back_of_a_sheet_shows_the_material_mirrored() {
        let hit = Hit {
            position: Vec3::ZERO,
            lifted: Vec3::ZERO,
            geometric: -Vec3::Z,
            normal: Vec3::Z,
            tangent: Vec3::X,
            handedness: 1.0,
            uv: Vec2::ZERO,
        };
        let frame = TextureMap::default().shading(&hit, -Vec3::Z).frame;
        assert_eq!((frame.tangent, frame.bitangent, frame.normal), (Vec3::X, Vec3::Y, -Vec3::Z));
    }
}
