//! Bundles of rays that are traced together.

use glam::Vec3;

use super::Intersection;
use super::traverse::HUGE;
use crate::render::ray::Ray;
use crate::simd::many::LANES;

/// Number of rays in a bundle.
pub(crate) const RAYS: usize = LANES;

/// A number for each ray of a bundle.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Row(pub [f32; RAYS]);

impl Row {
    pub(in crate::render) const ZERO: Self = Self([0.0; RAYS]);
}

/// Rays traced together, as a structure of arrays.
#[derive(Debug, Clone)]
pub(crate) struct Bundle {
    pub origin: [Row; 3],
    pub direction: [Row; 3],
    /// Maximum distance of each ray; 0 for unused ones.
    pub t_max: Row,
}

impl Bundle {
    pub(crate) const EMPTY: Self = Self { origin: [Row::ZERO; 3], direction: [Row([1.0; RAYS]); 3], t_max: Row::ZERO };

    #[inline]
    pub(crate) fn set(&mut self, lane: usize, ray: &Ray, t_max: f32) {
        for axis in 0..3 {
            self.origin[axis].0[lane] = ray.origin[axis];
            self.direction[axis].0[lane] = ray.direction[axis];
        }
        self.t_max.0[lane] = t_max;
    }

    #[inline]
    pub(crate) fn ray(&self, lane: usize) -> Ray {
        let at = |rows: &[Row; 3]| Vec3::from_array([0, 1, 2].map(|axis: usize| rows[axis].0[lane]));
        Ray { origin: at(&self.origin), direction: at(&self.direction) }
    }

    /// The inverse directions: huge, but finite, where a ray is parallel to a plane, because 0 times infinity would
    /// be NaN.
    #[inline(always)]
    pub(in crate::render) fn inverse(&self) -> [Row; 3] {
        self.direction.map(|row| Row(row.0.map(|d| d.recip().clamp(-HUGE, HUGE))))
    }
}

/// The triangles hit by the rays of a bundle; the bundle has the distances.
#[derive(Debug, Clone)]
pub(in crate::render) struct Triangles {
    /// Barycentric weight of the second corner.
    pub u: Row,
    /// Barycentric weight of the third corner.
    pub v: Row,
    /// Index of the triangle.
    pub triangle: [u32; RAYS],
}

impl Triangles {
    pub(in crate::render) const fn none() -> Self {
        Self { u: Row::ZERO, v: Row::ZERO, triangle: [0; RAYS] }
    }

    /// The intersection of one ray.
    #[inline]
    pub(in crate::render) fn hit(&self, bundle: &Bundle, lane: usize) -> Intersection {
        let Self { u, v, triangle } = self;
        Intersection { t: bundle.t_max.0[lane], triangle: triangle[lane], u: u.0[lane], v: v.0[lane] }
    }
}

/// The indices of the bits set in a mask.
#[inline]
pub(crate) fn lanes(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask.checked_sub(1)?;
        Some(lane % RAYS)
    })
}
