//! Fast decoder of recipes that are an analytic model with its own parameters in every texel.

use std::f64::consts::PI;
use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::Result;
use crate::btf::{BtfMeta, Rect};
use crate::codec::decoder::Decoder;
use crate::codec::interpret::stored_cosine;
use crate::codec::parts::{Curve, Expr, Parts, free_of};
use crate::material::angles::Footprint;
use crate::material::sampled::Sampled;
use crate::material::{Interpolation, Material};
use crate::model::{MAX_TERMS, Model, Shape, by_name};
use crate::params::Values;

/// The BRDF of a texel.
struct Texel {
    shape: Box<dyn Shape>,
    factors: [Vec3; MAX_TERMS],
}

impl Texel {
    fn new(model: &'static dyn Model, values: &Values) -> Result<Self> {
        let factors = model.coefficients(&model.color_values(values)?).map(|factor| factor.as_vec3());
        Ok(Self { shape: model.shape(values)?, factors })
    }

    /// pi times the BRDF; zero below the surface.
    fn value(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return DVec3::ZERO;
        }
        let terms = self.shape.terms(wi, wo);
        let terms = terms.iter().zip(&self.factors).take(self.shape.count());
        let sum: DVec3 = terms.map(|(term, factor)| *term * factor.as_dvec3()).sum();
        // the bound keeps the average of texels finite
        (PI * sum).clamp(DVec3::ZERO, DVec3::splat(1e9))
    }
}

/// One BRDF per texel.
struct ModelsBtf {
    meta: BtfMeta,
    texels: Vec<Texel>,
}

/// See [`super::FORMS`].
///
/// # Errors
/// Errors of reading the parts.
pub fn form(parts: &Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>> {
    let (meta, recipe) = (parts.meta(), parts.recipe());
    let (Expr::Model { name, lobes, grain, plane }, Curve::Brdf) = (&recipe.value, recipe.curve) else {
        return Ok(None);
    };
    if recipe.planes[*plane].range().is_some() {
        return Ok(None);
    }
    let (model, free) = (by_name(name)?, free_of(name, *lobes, *grain)?);
    let numbers = parts.plane(*plane, 0, Rect::whole(meta))?.to_f32();
    let texels = numbers.par_chunks_exact(free.count()).map(|numbers| Texel::new(model, &free.values(numbers)?));
    Ok(Some(Arc::new(ModelsBtf { meta: meta.clone(), texels: texels.collect::<Result<_>>()? })))
}

impl Decoder for ModelsBtf {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let meta = &self.meta;
        for (light, out) in lights.zip(out.chunks_exact_mut(meta.image_len())) {
            let (wi, wo) = meta.pair(view, light);
            let scale = f64::from(stored_cosine(meta, wi));
            let (wi, wo) = (unit(wi), unit(wo));
            for (out, texel) in out.chunks_exact_mut(3).zip(&self.texels) {
                let linear = (texel.value(wi, wo) * scale).as_vec3().to_array();
                out.copy_from_slice(&linear.map(|v| meta.encoding.encode(v)));
            }
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        let bytes = |texel: &Texel| size_of::<Texel>() + size_of_val(&*texel.shape);
        self.texels.iter().map(bytes).sum::<usize>() as u64
    }

    fn material(self: Arc<Self>, Interpolation { scheme, .. }: Interpolation) -> Result<Arc<dyn Material>> {
        Ok(Arc::new(Sampled::new(ModelsMaterial(self.clone()), &self.meta, scheme)?))
    }
}

fn unit(w: Vec3) -> DVec3 {
    w.as_dvec3().normalize()
}

/// Interpolates texels in linear light; models need no interpolation of directions.
struct ModelsMaterial(Arc<ModelsBtf>);

impl Material for ModelsMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        // This form of the condition also rejects NaN
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return Vec3::ZERO;
        }
        let (wi, wo, meta) = (unit(wi), unit(wo), &self.0.meta);
        let footprint = Footprint::new(uv, meta.width, meta.height);
        let texels = footprint.texel.into_iter().zip(footprint.weight).filter(|(_, weight)| *weight > 0.0);
        let sum: DVec3 = texels.map(|(texel, weight)| self.0.texels[texel].value(wi, wo) * f64::from(weight)).sum();
        (sum * wi.z).as_vec3()
    }
}
