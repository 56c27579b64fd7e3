//! What the goniometer measures: height fields and solids, and what paths need to know of them.

use glam::{Vec2, Vec3};

use super::field::HeightField;
use super::reflect::{Facets, Lights, Reflector};
use super::solid::Solid;

/// A sample of any kind.
#[derive(Debug, Clone, Copy)]
pub enum Specimen<'a> {
    /// A height field.
    Field(&'a HeightField),
    /// Triangles with overhangs and holes.
    Solid(&'a Solid),
}

impl<'a> From<&'a HeightField> for Specimen<'a> {
    fn from(field: &'a HeightField) -> Self {
        Self::Field(field)
    }
}

impl<'a> From<&'a Solid> for Specimen<'a> {
    fn from(solid: &'a Solid) -> Self {
        Self::Solid(solid)
    }
}

/// The surfaces of a sample, prepared for paths and for the lights of a measurement.
pub(super) trait Geometry: Sync {
    /// A point of a surface.
    type Point: Copy;

    /// The microfacets of its surfaces.
    type Facets: Facets;

    /// The side of the tile, in the unit of positions.
    fn side(&self) -> f32;

    /// The point that is seen in the direction `wo` at the position `at` of the plane of texels.
    fn seen(&self, at: Vec2, wo: Vec3) -> Option<Self::Point>;

    /// How a point reflects light towards `wo`.
    fn reflector(&self, point: &Self::Point, wo: Vec3) -> Reflector<Self::Facets>;

    /// Whether each light reaches a point with this shading normal: 1 or 0 per light.
    fn visibility(&self, point: &Self::Point, normal: Vec3, lights: &Lights, lit: &mut [f32]);

    /// The point that is seen from another one in the direction `wi`.
    fn next(&self, point: &Self::Point, wi: Vec3) -> Option<Self::Point>;
}
