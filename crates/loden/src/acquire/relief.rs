//! A height field prepared for measurement.

use glam::{Vec2, Vec3};

use super::field::HeightField;
use super::reflect::{Isotropic, LANES, Lights, Reflector};
use super::shade::Shade;
use super::specimen::Geometry;
use super::surface::{Point, Ray, Surface};
use crate::direction::DirectionSet;

/// The surface of a height field. The unit of positions is the cell.
pub(super) struct Relief {
    surface: Surface,
    /// Height of the plane of the texels, in cells.
    reference: f32,
    /// A ray towards each light.
    rays: Vec<Ray>,
    shade: Shade,
}

impl Relief {
    pub(super) fn new(field: &HeightField, lights: &DirectionSet) -> Self {
        let directions = lights.directions();
        let surface = Surface::new(field);
        Self {
            shade: Shade::new(surface.grid(), surface.heights(), directions),
            surface,
            reference: field.mean_height() * field.grid() as f32,
            rays: directions.iter().map(|&w| Ray::new(Vec3::ZERO, w)).collect(),
        }
    }
}

impl Geometry for Relief {
    type Point = Point;
    type Facets = Isotropic;

    fn side(&self) -> f32 {
        self.surface.grid() as f32
    }

    #[inline(always)]
    fn seen(&self, at: Vec2, wo: Vec3) -> Option<Point> {
        let n = self.surface.grid() as f32;
        let rise = self.surface.top() - self.reference;
        let start = at - Vec2::splat(0.5) + wo.truncate() * (rise / wo.z);
        let start = start - (start / n).floor() * n;
        self.surface.trace(&Ray::new(start.extend(self.surface.top()), -wo), None)
    }

    #[inline(always)]
    fn reflector(&self, point: &Point, wo: Vec3) -> Reflector {
        Reflector::new(self.surface.normal(point), wo, &self.surface.finish(point))
    }

    #[inline(always)]
    fn visibility(&self, point: &Point, normal: Vec3, lights: &Lights, lit: &mut [f32]) {
        let Lights { x, y, z } = lights;
        let (x, y, z) = (x.as_chunks::<LANES>().0, y.as_chunks::<LANES>().0, z.as_chunks::<LANES>().0);
        for (group, lit) in lit.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            // Look up which lights are decided by the bounds
            let known = self.shade.verdicts(point.cell, point.at.z, group);
            let mut open = 0u32;
            for i in 0..LANES {
                let faces = normal.x * x[group][i] + normal.y * y[group][i] + normal.z * z[group][i] > 0.0;
                lit[i] = if faces { known[i] } else { 0.0 };
                open |= u32::from(lit[i] < 0.0) << i;
            }
            // Trace shadow rays to the others
            while open != 0 {
                let (i, light) = (open.trailing_zeros() as usize, group * LANES + open.trailing_zeros() as usize);
                open &= open - 1;
                let dark = self.surface.is_dark(&self.rays[light].from(point.at), point, light, &self.shade);
                lit[i] = if dark { 0.0 } else { 1.0 };
            }
        }
    }

    #[inline(always)]
    fn next(&self, point: &Point, wi: Vec3) -> Option<Point> {
        self.surface.trace(&Ray::new(point.at, wi), Some(point))
    }
}
