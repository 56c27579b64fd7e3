//! A material from a model with fixed parameters.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::{MAX_TERMS, Model, Shape, Terms};
use crate::Result;
use crate::material::{Bounce, Brdf, BrdfSample, Material, OneByOne, Point, Prepared, Promises, Sample};
use crate::params::Values;

/// A model with its parameters, without texture.
pub struct Analytic {
    model: &'static dyn Model,
    values: Values,
    shape: Box<dyn Shape>,
    factors: Terms,
    /// Fraction of the samples drawn from each term; the sum is 1.
    shares: [f64; MAX_TERMS],
    /// Whether the sum of the colours is at most 1.
    bounded: bool,
    /// The same material in single precision, if that is accurate enough.
    single: Option<Box<dyn Material>>,
}

impl std::fmt::Debug for Analytic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Analytic").field("model", &self.model.name()).field("values", &self.values).finish()
    }
}

impl Analytic {
    /// Creates a material from a model and values of its parameter table.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the values belong to another table.
    pub fn new(model: &'static dyn Model, values: Values) -> Result<Self> {
        let colors = model.color_values(&values)?;
        let shape = model.shape(&values)?;
        let factors = model.coefficients(&colors);
        let mut shares = [0.0; MAX_TERMS];
        for (term, share) in shares.iter_mut().enumerate().take(shape.count()) {
            *share = factors[term].element_sum().max(0.0) * shape.importance(term);
        }
        let sum: f64 = shares.iter().sum();
        if sum > 0.0 {
            shares.iter_mut().for_each(|share| *share /= sum);
        } else {
            // a black material can be sampled, too
            shares[0] = 1.0;
        }
        let single = shape.single(&factors, &shares);
        let bounded = colors.iter().sum::<DVec3>().max_element() <= 1.0;
        Ok(Self { model, values, shape, factors, shares, bounded, single })
    }

    /// Its model.
    pub fn model(&self) -> &'static dyn Model {
        self.model
    }

    /// The name that opens it again: `ward:alpha-x=0.1:kd=0.2,0.1,0`.
    pub fn specification(&self) -> String {
        let given = self.values.iter().filter(|(name, _)| self.values.is_given(name));
        given.fold(self.model.name().to_owned(), |text, (name, value)| format!("{text}:{name}={value}"))
    }

    /// Its parameters.
    pub fn values(&self) -> &Values {
        &self.values
    }

    /// The BRDF in 1/sr, without the cosine, in double precision; zero below the surface.
    pub fn brdf(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        // This form of the condition also rejects NaN
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return DVec3::ZERO;
        }
        let terms = self.shape.terms(wi, wo);
        let sum: DVec3 = terms.iter().zip(&self.factors).take(self.shape.count()).map(|(t, f)| *t * *f).sum();
        sum.max(DVec3::ZERO)
    }

    /// The density of the samples, 1/sr, in double precision.
    pub fn density(&self, wi: DVec3, wo: DVec3) -> f64 {
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return 0.0;
        }
        let used = self.shares.iter().enumerate().filter(|(_, share)| **share > 0.0);
        used.map(|(term, share)| share * self.shape.pdf(term, wi, wo)).sum()
    }

    /// Draws a direction for the viewer `wo`. The result is in double precision, too.
    fn drawn(&self, wo: Vec3, random: Vec2) -> Option<(Sample, DVec3, DVec3)> {
        if wo.z <= 0.0 || wo.z.is_nan() {
            return None;
        }
        let wo = unit(wo);
        let wi = self.draw(wo, random.as_dvec2())?.as_vec3();
        let exact = unit(wi);
        let pdf = self.density(exact, wo) as f32;
        (wi.z > 0.0 && pdf > 0.0 && pdf.is_finite()).then_some((Sample { wi, pdf }, exact, wo))
    }

    fn draw(&self, wo: DVec3, random: DVec2) -> Option<DVec3> {
        let mut x = random.x;
        for (term, &share) in self.shares.iter().enumerate() {
            if x < share {
                // stay below 1 in spite of rounding
                let random = DVec2::new((x / share).min(1.0 - f64::EPSILON), random.y);
                return self.shape.sample(term, wo, random).filter(|wi| wi.z > 0.0);
            }
            x -= share;
        }
        None
    }
}

/// Normalises in double precision: single precision is not accurate enough at an exponent of 10 000.
fn unit(w: Vec3) -> DVec3 {
    w.as_dvec3().normalize()
}

impl Material for Analytic {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        match &self.single {
            Some(single) => single.apparent(uv, wi, wo),
            None => self.eval(uv, wi, wo) * (std::f32::consts::PI * wi.z),
        }
    }

    fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.brdf(unit(wi), unit(wo)).as_vec3()
    }

    fn promises(&self) -> Promises {
        let promises = self.shape.promises();
        Promises { energy_conserving: promises.energy_conserving && self.bounded, ..promises }
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        if let Some(single) = &self.single {
            return single.sample(uv, wo, random);
        }
        Some(self.drawn(wo, random)?.0)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        if let Some(single) = &self.single {
            return single.pdf(uv, wi, wo);
        }
        self.density(unit(wi), unit(wo)) as f32
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        match &self.single {
            Some(single) => single.prepare(points),
            None => Box::new(ExactPoints { material: self, points }),
        }
    }
}

/// Points evaluated in double precision, without preparation.
struct ExactPoints<'a> {
    material: &'a Analytic,
    points: &'a [Point],
}

impl Prepared for ExactPoints<'_> {
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        OneByOne { material: self.material, points: self.points }.apparent(index, wi, values);
    }

    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        for ((bounce, &index), &random) in bounces.iter_mut().zip(index).zip(random) {
            *bounce = match self.material.drawn(self.points[index as usize].wo, random) {
                Some((Sample { wi, pdf }, exact, wo)) => {
                    let value = self.material.brdf(exact, wo).as_vec3() * (std::f32::consts::PI * wi.z);
                    Bounce { wi, pdf, value }
                }
                None => Bounce::NONE,
            };
        }
    }

    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]) {
        OneByOne { material: self.material, points: self.points }.pdf(index, wi, densities);
    }
}

impl Brdf for Analytic {
    /// The value at every pair of a grid: polar angles of 5 to 85 degrees in steps of 10 and 5, the light's azimuth
    /// 0 (and, if the model is anisotropic, every 30 degrees), the view's every 10.
    fn samples(&self) -> Vec<BrdfSample> {
        let turns = if self.promises().isotropic { 1 } else { 12 };
        let mut samples = Vec::new();
        let angles = |theta: usize, phi: usize| {
            let (theta, phi) = ((theta as f64).to_radians(), (phi as f64).to_radians());
            DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
        };
        for light in (5..90).step_by(10) {
            for turn in 0..turns {
                let wi = angles(light, 30 * turn);
                for view in (5..90).step_by(5) {
                    for azimuth in (0..360).step_by(10) {
                        let wo = angles(view, azimuth);
                        let value = self.brdf(wi, wo).as_vec3();
                        samples.push(BrdfSample { wi: wi.as_vec3(), wo: wo.as_vec3(), value });
                    }
                }
            }
        }
        samples
    }
}

/// Cosine-distributed about the normal, for the diffuse term.
pub(super) fn diffuse_sample(random: DVec2) -> DVec3 {
    let (r, phi) = (random.x.sqrt(), 2.0 * PI * random.y);
    DVec3::new(r * phi.cos(), r * phi.sin(), (1.0 - random.x).max(0.0).sqrt())
}

/// The density of [`diffuse_sample`].
pub(super) fn diffuse_pdf(wi: DVec3) -> f64 {
    wi.z / PI
}
