//! Texture maps: how a material is mapped onto a shape.

mod mapping;

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

pub use mapping::Mapping;

use super::hit::Hit;
use crate::direction::Frame;
use crate::{Error, Result};

/// Maximum number of texture samples per camera ray.
pub const MAX_TEXTURE_SAMPLES: u32 = 64;

/// What a material shows beyond its edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The material repeats.
    #[default]
    Repeat,
    /// The material repeats, mirrored every second time, with its grain.
    Mirror,
    /// The texels at the edge continue.
    Clamp,
    /// Black: light is absorbed.
    Black,
}

/// How a material is mapped onto a shape.
///
/// The mapping gives texture coordinates and their directions on the surface. They are then rotated, scaled and
/// wrapped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TextureMap {
    /// Repeats of the material per unit of texture coordinates.
    pub scale: f32,
    /// Counter-clockwise rotation of the material on the surface, with its grain and highlights, degrees.
    pub rotation_degrees: f32,
    /// Source of the texture coordinates.
    pub mapping: Mapping,
    /// What the material shows beyond its edges.
    pub wrap: Wrap,
    /// Maximum number of texture samples per camera ray, 1 to [`MAX_TEXTURE_SAMPLES`]. Where the texture is finer than
    /// the pixels, more samples reduce noise.
    pub samples: u32,
}

impl Default for TextureMap {
    fn default() -> Self {
        Self { scale: 1.0, rotation_degrees: 0.0, mapping: Mapping::Surface, wrap: Wrap::Repeat, samples: 1 }
    }
}

/// A point of a surface seen from one side, as materials are evaluated.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Shading {
    /// Texture coordinates of the material.
    pub uv: Vec2,
    /// x and y along the material's u and v, z on the side of the viewer. Left-handed where the material is seen
    /// mirrored: on the back of a surface or with mirrored texture coordinates.
    pub frame: Frame,
    /// Unit vector towards the viewer, in `frame`.
    pub wo: Vec3,
    /// Origin of the rays that leave the surface.
    pub origin: Vec3,
}

/// The rotation and scale of a texture map.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct TextureTransform {
    sin: f32,
    cos: f32,
    scale: f32,
}

/// Minimum cosine between the shading normal and the viewer.
const LEAST_COSINE: f32 = 1e-3;

impl TextureMap {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a scale outside 0.0001..10000, a number of samples out of range, and a mapping that is
    /// not finite or degenerate.
    pub fn check(&self) -> Result<()> {
        if !(1e-4..=1e4).contains(&self.scale) {
            return Err(Error::parameter("uv-scale", format!("found {}, expected 0.0001 to 10000", self.scale)));
        }
        if !self.rotation_degrees.is_finite() {
            let problem = format!("found {}, expected a finite angle in degrees", self.rotation_degrees);
            return Err(Error::parameter("uv-rotation", problem));
        }
        if !(1..=MAX_TEXTURE_SAMPLES).contains(&self.samples) {
            let problem = format!("found {}, expected 1 to {MAX_TEXTURE_SAMPLES}", self.samples);
            return Err(Error::parameter("texture-samples", problem));
        }
        self.mapping.check()
    }

    /// Whether texture samples can be averaged: one frame and one projection for all points, and no edges.
    pub(super) fn can_be_averaged(&self) -> bool {
        matches!(self.wrap, Wrap::Repeat | Wrap::Clamp) && !matches!(self.mapping, Mapping::Triplanar { .. })
    }

    /// The texture coordinates of a hit before rotation and scale; a triplanar mapping uses one projection.
    pub(super) fn raw(&self, hit: &Hit) -> Vec2 {
        match self.mapping {
            Mapping::Surface => hit.uv,
            ref other => other.project(hit, || 0.0).0,
        }
    }

    /// The rotation and scale.
    #[inline]
    pub(super) fn transform(&self) -> TextureTransform {
        let turned = self.rotation_degrees != 0.0;
        let (sin, cos) = if turned { self.rotation_degrees.to_radians().sin_cos() } else { (0.0, 1.0) };
        TextureTransform { sin, cos, scale: self.scale }
    }

    /// Replaces the texture coordinates of a hit, and their directions, by those of the mapping. `random` returns a
    /// number in [0, 1); it is called only by the triplanar mapping.
    #[inline]
    pub(super) fn mapped(&self, hit: &Hit, random: impl FnOnce() -> f32) -> Hit {
        if self.mapping == Mapping::Surface {
            return *hit;
        }
        let (uv, tangent, handedness) = self.mapping.project(hit, random);
        Hit { uv, tangent, handedness, ..*hit }
    }

    /// Wraps the texture coordinates of a material with this many `texels`. Returns false where the material is black.
    #[inline(always)]
    pub(super) fn wrap(&self, shading: &mut Shading, texels: Option<[usize; 2]>) -> bool {
        let (uv, mirrored, covered) = self.wrapped(shading.uv, texels);
        shading.uv = uv;
        for (sign, axis, wo) in [
            (mirrored.x, &mut shading.frame.tangent, &mut shading.wo.x),
            (mirrored.y, &mut shading.frame.bitangent, &mut shading.wo.y),
        ] {
            *axis *= sign;
            *wo *= sign;
        }
        covered
    }

    /// The wrapped texture coordinates, the signs of the two axes, and false where the material is black.
    #[inline]
    pub(super) fn wrapped(&self, uv: Vec2, texels: Option<[usize; 2]>) -> (Vec2, Vec2, bool) {
        // Materials repeat: half a texel from the edge, interpolation does not yet reach the opposite edge.
        let edge = texels.map_or(Vec2::ZERO, |[w, h]| 0.5 / Vec2::new(w as f32, h as f32));
        match self.wrap {
            Wrap::Repeat => (uv, Vec2::ONE, true),
            Wrap::Clamp => (uv.clamp(edge, Vec2::ONE - edge), Vec2::ONE, true),
            Wrap::Black => {
                let covered = uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all();
                (uv.clamp(edge, Vec2::ONE - edge), Vec2::ONE, covered)
            }
            Wrap::Mirror => {
                let odd = uv.floor().rem_euclid(Vec2::splat(2.0)).cmpeq(Vec2::ONE);
                let within = uv - uv.floor();
                let uv = Vec2::select(odd, Vec2::ONE - within, within);
                (uv.clamp(edge, Vec2::ONE - edge), Vec2::select(odd, Vec2::NEG_ONE, Vec2::ONE), true)
            }
        }
    }
}

impl TextureTransform {
    /// Rotates and scales texture coordinates.
    #[inline(always)]
    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        Vec2::new(self.cos, -self.sin).rotate(uv) * self.scale
    }

    /// The shading point of a hit seen from the unit vector `viewer`, in world coordinates, before wrapping.
    ///
    /// Interpolated normals may face away from the viewer near a silhouette. Such a normal is bent until the viewer is
    /// just above the horizon.
    #[inline(always)]
    pub(super) fn shading(&self, hit: &Hit, viewer: Vec3) -> Shading {
        // Bend the normal towards the viewer
        let flipped = if hit.normal.dot(hit.geometric) < 0.0 { -1.0 } else { 1.0 };
        let facing = hit.normal * flipped;
        let cosine = facing.dot(viewer);
        let bent = (facing + viewer * (LEAST_COSINE - cosine)).normalize_or(viewer);
        let normal = if cosine < LEAST_COSINE { bent } else { facing };
        // Construct the rotated frame
        let mut frame = Frame::from_normal_tangent(normal, hit.tangent);
        frame.bitangent *= hit.handedness * flipped;
        let (tangent, bitangent) = (frame.tangent, frame.bitangent);
        frame.tangent = tangent * self.cos + bitangent * self.sin;
        frame.bitangent = bitangent * self.cos - tangent * self.sin;
        let mut wo = frame.local(viewer);
        wo.z = wo.z.max(0.5 * LEAST_COSINE);
        Shading { uv: self.apply(hit.uv), frame, wo: wo.normalize(), origin: hit.origin }
    }
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
        fn the_viewer_is_always_above_the_shading_normal(n in unit(), g in unit(), t in unit(), viewer in unit()) {
            prop_assume!(g.dot(viewer) > 1e-3);
            let hit = Hit {
                position: Vec3::ZERO, origin: Vec3::ZERO, geometric: g, normal: n, tangent: t, handedness: 1.0,
                uv: Vec2::ZERO,
            };
            let shading = TextureMap { rotation_degrees: 33.0, ..TextureMap::default() }.transform().shading(&hit, viewer);
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
            origin: Vec3::ZERO,
            geometric: Vec3::Z,
            normal: Vec3::Z,
            tangent: Vec3::X,
            handedness: 1.0,
            uv: Vec2::new(0.0, 1.0),
        };
        let map = TextureMap { scale: 2.0, rotation_degrees: 90.0, ..TextureMap::default() };
        let shading = map.transform().shading(&hit, Vec3::Z);
        // The material's u axis now points along the shape's v.
        assert!((shading.frame.tangent - Vec3::Y).length() < 1e-6);
        assert!((shading.frame.bitangent + Vec3::X).length() < 1e-6);
        assert!((shading.uv - Vec2::new(2.0, 0.0)).length() < 1e-6);
    }

    #[test]
    fn the_back_of_a_sheet_shows_the_material_mirrored() {
        let hit = Hit {
            position: Vec3::ZERO,
            origin: Vec3::ZERO,
            geometric: -Vec3::Z,
            normal: Vec3::Z,
            tangent: Vec3::X,
            handedness: 1.0,
            uv: Vec2::ZERO,
        };
        let frame = TextureMap::default().transform().shading(&hit, -Vec3::Z).frame;
        assert_eq!((frame.tangent, frame.bitangent, frame.normal), (Vec3::X, Vec3::Y, -Vec3::Z));
    }

    fn flat(uv: Vec2) -> Hit {
        let (position, normal) = (Vec3::ZERO, Vec3::Z);
        Hit { position, origin: position, geometric: normal, normal, tangent: Vec3::X, handedness: 1.0, uv }
    }

    #[test]
    fn wrap_modes() {
        let at = |wrap, u: f32| {
            let map = TextureMap { wrap, ..TextureMap::default() };
            let mut shading = map.transform().shading(&flat(Vec2::new(u, 0.5)), Vec3::new(0.6, 0.0, 0.8));
            let covered = map.wrap(&mut shading, Some([4, 4]));
            assert_eq!(shading.wo.x * shading.frame.tangent.x, 0.6, "directions turn with the frame");
            (shading.uv.x, shading.frame.tangent.x, covered)
        };
        for (wrap, u, expected) in [
            (Wrap::Repeat, 1.25, (1.25, 1.0, true)),
            (Wrap::Mirror, 0.25, (0.25, 1.0, true)),
            (Wrap::Mirror, 1.25, (0.75, -1.0, true)),
            (Wrap::Mirror, -0.25, (0.25, -1.0, true)),
            (Wrap::Mirror, 2.25, (0.25, 1.0, true)),
            (Wrap::Mirror, 1.0, (0.875, -1.0, true)),
            (Wrap::Clamp, 1.25, (0.875, 1.0, true)),
            (Wrap::Clamp, -3.0, (0.125, 1.0, true)),
            (Wrap::Black, 0.5, (0.5, 1.0, true)),
            (Wrap::Black, 1.01, (0.875, 1.0, false)),
            (Wrap::Black, -0.01, (0.125, 1.0, false)),
        ] {
            assert_eq!(at(wrap, u), expected, "{wrap:?} at {u}");
        }
    }
}
