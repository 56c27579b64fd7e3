//! Perfectly diffuse reflection.

use std::f32::consts::PI;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::{KD, MAX_TERMS, Model, Shape, Terms};
use crate::Result;
use crate::direction::cosine_hemisphere;
use crate::material::plain::{Plain, PlainPoints};
use crate::material::{Bounce, Material, Point, Prepared, Promises};
use crate::params::{Param, Values};

/// A perfectly diffuse material of one colour.
///
/// # Model
/// f = albedo / pi.
///
/// # References
/// lambert1760
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lambert {
    /// Reflected fraction per channel, 0..1.
    pub albedo: Vec3,
}

impl Material for Lambert {
    fn apparent(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.value(wi, wo)
    }

    fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if wi.z > 0.0 && wo.z > 0.0 { self.albedo / PI } else { Vec3::ZERO }
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: true, isotropic: true }
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        Box::new(PlainPoints { material: self, points })
    }
}

impl Plain for Lambert {
    #[inline(always)]
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3 {
        if wi.z > 0.0 && wo.z > 0.0 { self.albedo * wi.z } else { Vec3::ZERO }
    }

    #[inline(always)]
    fn draw(&self, wo: Vec3, random: Vec2) -> Bounce {
        let wi = cosine_hemisphere(random);
        let pdf = if wi.z > 0.0 && wo.z > 0.0 { wi.z / PI } else { 0.0 };
        Bounce { wi, pdf, value: self.albedo * wi.z }
    }

    #[inline(always)]
    fn density(&self, wi: Vec3, wo: Vec3) -> f32 {
        if wi.z > 0.0 && wo.z > 0.0 { wi.z / PI } else { 0.0 }
    }
}

/// The entry of [`Lambert`] among the models.
pub(super) struct LambertModel;

impl Model for LambertModel {
    fn name(&self) -> &'static str {
        "lambert"
    }

    fn doc(&self) -> &'static str {
        "Perfectly diffuse reflection: equally bright from all directions."
    }

    fn params(&self) -> &'static [Param] {
        &[KD]
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd"]
    }

    fn shape(&self, _values: &Values) -> Result<Box<dyn Shape>> {
        Ok(Box::new(Diffuse))
    }
}

#[derive(Debug)]
struct Diffuse;

/// Constant 1/pi in the first term.
pub(super) fn diffuse_term() -> Terms {
    let mut terms = [DVec3::ZERO; MAX_TERMS];
    terms[0] = DVec3::splat(std::f64::consts::FRAC_1_PI);
    terms
}

impl Shape for Diffuse {
    fn count(&self) -> usize {
        1
    }

    fn terms(&self, _wi: DVec3, _wo: DVec3) -> Terms {
        diffuse_term()
    }

    fn single(&self, factors: &Terms, _shares: &[f64; MAX_TERMS]) -> Option<Box<dyn Material>> {
        Some(Box::new(Lambert { albedo: factors[0].max(DVec3::ZERO).as_vec3() }))
    }

    fn sample(&self, _term: usize, _wo: DVec3, random: DVec2) -> Option<DVec3> {
        Some(diffuse_sample(random))
    }

    fn pdf(&self, _term: usize, wi: DVec3, _wo: DVec3) -> f64 {
        diffuse_pdf(wi)
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: true, isotropic: true }
    }
}
