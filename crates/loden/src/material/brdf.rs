//! A BRDF as a table over sampled view and light directions.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::Material;
use super::angles::Angles;
use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::direction::Scheme;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// A BRDF known at pairs of sampled directions and interpolated between them; the same at every texture coordinate.
#[derive(Debug, Clone)]
pub struct TabulatedBrdf {
    angles: Angles,
    lights: usize,
    /// (view, light), in linear light with the BTF's cosine convention
    table: Vec<Vec3>,
}

impl TabulatedBrdf {
    /// From a table of one value in linear light per pair, (view, light), with the directions and cosine convention
    /// of `meta`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the table's size is not views x lights, or the directions do not suit the `scheme`.
    pub fn new(meta: &BtfMeta, table: Vec<Vec3>, scheme: Scheme) -> Result<Self> {
        if table.len() != meta.pairs() {
            let problem = format!("found {} values, expected {} pairs", table.len(), meta.pairs());
            return Err(Error::parameter("table", problem));
        }
        Ok(Self { angles: Angles::new(meta, scheme)?, lights: meta.lights.len(), table })
    }

    /// The mean over the texels of a BTF in linear light, pair by pair.
    ///
    /// # Errors
    /// What the source returns; [`Error::Cancelled`]; [`Error::Parameter`] as [`TabulatedBrdf::new`].
    pub fn average(source: &dyn BtfSource, scheme: Scheme, progress: &dyn Progress) -> Result<Self> {
        let meta = source.meta();
        let task = Task::new(progress, "average", meta.pairs() as u64);
        let mut table = Vec::with_capacity(meta.pairs());
        for view in 0..meta.views.len() {
            let images: Result<Vec<Vec3>> = (0..meta.lights.len())
                .into_par_iter()
                .map(|light| {
                    task.advance(1)?;
                    Ok(mean(&source.image(view, light)?, meta))
                })
                .collect();
            table.extend(images?);
            source.release(view);
        }
        Self::new(meta, table, scheme)
    }

    /// The values in linear light, (view, light), with the BTF's cosine convention.
    pub fn table(&self) -> &[Vec3] {
        &self.table
    }
}

fn mean(texels: &Texels, meta: &BtfMeta) -> Vec3 {
    let decode = |value: f32| f64::from(meta.encoding.decode(value));
    let mut sum = [0.0f64; 3];
    let mut add = |i: usize, value: f64| sum[i % 3] += value;
    match texels {
        Texels::U8(values) => {
            let of_byte: [f64; 256] = std::array::from_fn(|i| decode(i as f32 / 255.0));
            values.iter().enumerate().for_each(|(i, &v)| add(i, of_byte[usize::from(v)]));
        }
        _ => texels.to_f32().iter().enumerate().for_each(|(i, &v)| add(i, decode(v))),
    }
    let count = (texels.len() / 3).max(1) as f64;
    Vec3::from(sum.map(|s| (s / count) as f32))
}

impl Material for TabulatedBrdf {
    fn apparent(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let Some(stencil) = self.angles.stencil(wi, wo) else { return Vec3::ZERO };
        let mut sum = Vec3::ZERO;
        for (view, view_weight) in stencil.view.iter() {
            for (light, weight) in stencil.light.iter() {
                sum += view_weight * weight * self.table[view * self.lights + light];
            }
        }
        sum.max(Vec3::ZERO) * stencil.factor
    }
}
