//! Instances of meshes, quadrics and tori.

use std::sync::Arc;

use glam::{Affine3A, Mat3, Mat4, Vec3};

use super::bounds::Ball;
use super::bvh::{Bundle, Intersection, RAYS, Triangles};
use super::hit::{Corner, Hit, Place, offset};
use super::mesh::Mesh;
use super::ray::Ray;
use super::revolved::Revolved;
use super::traced::{Surface, Traced};
use crate::{Error, Result};

/// A shape in object coordinates. It is shared, because it may be large and have several instances.
#[derive(Debug, Clone)]
pub enum Form {
    /// A triangle mesh.
    Mesh(Arc<Mesh>),
    /// A quadric or a torus.
    Revolved(Arc<Revolved>),
}

impl Form {
    #[inline]
    fn traced(&self) -> &dyn Traced {
        match self {
            Self::Mesh(mesh) => mesh.as_ref(),
            Self::Revolved(revolved) => revolved.as_ref(),
        }
    }
}

impl PartialEq for Form {
    /// Meshes are equal if they are the same object.
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Mesh(a), Self::Mesh(b)) => Arc::ptr_eq(a, b),
            (Self::Revolved(a), Self::Revolved(b)) => a == b,
            _ => false,
        }
    }
}

impl From<Arc<Mesh>> for Form {
    fn from(mesh: Arc<Mesh>) -> Self {
        Self::Mesh(mesh)
    }
}

impl From<Mesh> for Form {
    fn from(mesh: Mesh) -> Self {
        Self::Mesh(mesh.into())
    }
}

impl From<Revolved> for Form {
    fn from(revolved: Revolved) -> Self {
        Self::Revolved(revolved.into())
    }
}

/// A shape moved by an affine transform. A mirroring transform keeps the outside outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Instance {
    form: Form,
    world_from_object: Affine3A,
    object_from_world: Affine3A,
    /// Inverse transpose, for normals.
    cofactor: Mat3,
    handedness: f32,
}

impl Instance {
    /// Creates an instance.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the transform has no inverse, is not finite, or not affine.
    pub fn new(form: Form, world_from_object: Mat4) -> Result<Self> {
        let bad = |problem: &str| Err(Error::parameter("transform", format!("{world_from_object} {problem}")));
        if !world_from_object.is_finite() || !world_from_object.determinant().is_normal() {
            return bad("is singular or not finite");
        }
        if (world_from_object.row(3) - glam::Vec4::W).abs().max_element() > 1e-5 {
            return bad("is not affine");
        }
        let world_from_object = Affine3A::from_mat4(world_from_object);
        let object_from_world = world_from_object.inverse();
        if !object_from_world.is_finite() {
            return bad("has no inverse");
        }
        let handedness = 1.0f32.copysign(world_from_object.matrix3.determinant());
        let cofactor = Mat3::from(object_from_world.matrix3).transpose();
        Ok(Self { form, world_from_object, object_from_world, cofactor, handedness })
    }

    /// What is moved.
    pub fn form(&self) -> &Form {
        &self.form
    }

    /// The transform.
    pub fn world_from_object(&self) -> Mat4 {
        self.world_from_object.into()
    }

    /// The ray in the mesh's coordinates. Its direction is not normalised, so that distances are preserved.
    #[inline]
    fn inside(&self, ray: &Ray) -> Ray {
        Ray {
            origin: self.object_from_world.transform_point3(ray.origin),
            direction: self.object_from_world.transform_vector3(ray.direction),
        }
    }

    fn all_inside(&self, bundle: &Bundle) -> Bundle {
        let mut moved = Bundle::EMPTY;
        for lane in 0..RAYS {
            moved.set(lane, &self.inside(&bundle.ray(lane)), bundle.t_max.0[lane]);
        }
        moved
    }

    /// A point on a triangle, in world coordinates.
    #[inline]
    fn place(&self, mut place: Place) -> Place {
        place.reach = self.reach(place.reach);
        for corner in &mut place.corners {
            *corner = Corner {
                position: self.world_from_object.transform_point3(corner.position),
                normal: self.normal(corner.normal),
                tangent: self.world_from_object.transform_vector3(corner.tangent),
                handedness: corner.handedness * self.handedness,
                uv: corner.uv,
            };
        }
        place
    }

    /// A hit in world coordinates, seen from the unit vector `viewer`.
    fn hit(&self, hit: &Hit, viewer: Vec3) -> Hit {
        let [low, high] = self.form.traced().extent();
        let position = self.world_from_object.transform_point3(hit.position);
        let normal = self.normal(hit.normal);
        let geometric = if normal.dot(viewer) < 0.0 { -normal } else { normal };
        Hit {
            position,
            origin: offset(position, geometric, self.reach(low.abs().max(high.abs()))),
            geometric,
            normal,
            tangent: self.world_from_object.transform_vector3(hit.tangent),
            handedness: hit.handedness * self.handedness,
            uv: hit.uv,
        }
    }

    #[inline]
    fn normal(&self, normal: Vec3) -> Vec3 {
        (self.cofactor * normal).normalize_or(Vec3::Y)
    }

    /// The largest coordinates that a world position is computed from, for the largest coordinates in the object.
    #[inline]
    fn reach(&self, object: Vec3) -> Vec3 {
        let m = &self.world_from_object.matrix3;
        let moved = m.x_axis.abs() * object.x + m.y_axis.abs() * object.y + m.z_axis.abs() * object.z;
        (moved + self.world_from_object.translation.abs()).into()
    }
}

impl Traced for Instance {
    fn closest(&self, ray: &Ray, t_max: f32) -> Option<Intersection> {
        self.form.traced().closest(&self.inside(ray), t_max)
    }

    fn closest_of(&self, bundle: &mut Bundle, triangles: &mut Triangles) -> u16 {
        let mut moved = self.all_inside(bundle);
        let hits = self.form.traced().closest_of(&mut moved, triangles);
        bundle.t_max = moved.t_max;
        hits
    }

    fn occluded_of(&self, bundle: &Bundle) -> u16 {
        self.form.traced().occluded_of(&self.all_inside(bundle))
    }

    fn surface(&self, ray: &Ray, at: &Intersection) -> Surface {
        match self.form.traced().surface(&self.inside(ray), at) {
            Surface::Triangle(place) => Surface::Triangle(self.place(place)),
            Surface::Smooth(hit) => Surface::Smooth(self.hit(&hit, -ray.direction)),
        }
    }

    fn beside(&self, ray: &Ray, other: &Intersection) -> Option<Intersection> {
        self.form.traced().beside(&self.inside(ray), other)
    }

    fn extent(&self) -> [Vec3; 2] {
        let [low, high] = self.form.traced().extent();
        let corners = (0..8).map(|k| {
            let pick = |axis: usize| if k >> axis & 1 == 0 { low[axis] } else { high[axis] };
            self.world_from_object.transform_point3(Vec3::new(pick(0), pick(1), pick(2)))
        });
        corners.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
    }

    fn bounds(&self) -> Ball {
        let ball = self.form.traced().bounds();
        // the Frobenius norm bounds the largest stretch
        let m = &self.world_from_object.matrix3;
        let stretch = [m.x_axis, m.y_axis, m.z_axis].iter().map(|c| c.length_squared()).sum::<f32>().sqrt();
        Ball { centre: self.world_from_object.transform_point3(ball.centre), radius: stretch * ball.radius }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::Frame;
    use crate::render::MeshData;
    use glam::{Quat, Vec2};

    fn bent() -> MeshData {
        MeshData {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.3), Vec3::new(0.0, 1.0, 0.1)],
            uvs: vec![Vec2::ZERO, Vec2::new(0.9, 0.1), Vec2::ONE, Vec2::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..MeshData::default()
        }
    }

    #[test]
    fn equals_the_mesh_with_the_transform_applied() {
        let turn = Mat4::from_rotation_translation(Quat::from_rotation_y(0.4), Vec3::new(0.3, -0.2, 1.0));
        for scale in [Vec3::splat(2.0), Vec3::new(-1.0, 1.0, 1.0), Vec3::new(0.5, 3.0, -1.5)] {
            let transform = turn * Mat4::from_scale(scale);
            let mut moved = MeshData::default();
            moved.append(&bent(), transform).unwrap();
            let moved = Mesh::new(moved).unwrap();
            let instance = Instance::new(Mesh::new(bent()).unwrap().into(), transform).unwrap();
            let mut met = 0;
            for k in 0..200 {
                let aim = transform.transform_point3(Vec3::new((k % 14) as f32 / 14.0, (k / 14) as f32 / 14.0, 0.1));
                let from =
                    aim + Vec3::new((k as f32).sin(), 1.0, (k as f32).cos()) * if k % 2 == 0 { 3.0 } else { -3.0 };
                let ray = Ray { origin: from, direction: (aim - from).normalize() };
                let found = instance.closest(&ray, f32::INFINITY);
                let expected = moved.closest(&ray, f32::INFINITY);
                let mut bundle = Bundle::EMPTY;
                bundle.set(3, &ray, f32::INFINITY);
                assert_eq!(instance.occluded_of(&bundle), u16::from(found.is_some()) << 3);
                let (Some(found), Some(expected)) = (found, expected) else { continue };
                met += 1;
                assert!((found.t - expected.t).abs() < 1e-4);
                let a = instance.surface(&ray, &found).hit(-ray.direction);
                let b = moved.place(&expected).surface(-ray.direction);
                assert!((a.position - b.position).length() < 1e-4 && (a.uv - b.uv).length() < 1e-4);
                assert!((a.geometric - b.geometric).length() < 1e-3 && a.normal.dot(b.normal) > 0.8);
                let along = |h: &Hit| Frame::from_normal_tangent(h.geometric, h.tangent).tangent;
                assert!(along(&a).dot(along(&b)) > 0.9 && a.handedness == b.handedness, "{scale}");
            }
            assert!(met > 100, "{met}");
        }
    }

    #[test]
    fn impossible_transforms_are_refused() {
        let mesh: Arc<Mesh> = Mesh::new(bent()).unwrap().into();
        let mut perspective = Mat4::IDENTITY;
        perspective.x_axis.w = 1.0;
        for transform in [Mat4::ZERO, Mat4::from_scale(Vec3::new(1.0, f32::NAN, 1.0)), perspective] {
            assert!(Instance::new(mesh.clone().into(), transform).is_err());
        }
    }
}
