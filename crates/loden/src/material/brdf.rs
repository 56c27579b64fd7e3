//! A BRDF as a table over sampled view and light directions.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::angles::{Angles, LightStencil};
use super::sampler::HalfSampler;
use super::{Brdf, BrdfSample, Material, Sample};
use crate::btf::{BtfMeta, BtfSource, Cosine, Texels};
use crate::direction::{DirectionSet, Scheme};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// A BRDF tabulated at pairs of sampled directions, with interpolation between them.
#[derive(Debug, Clone)]
pub struct TabulatedBrdf {
    angles: Angles,
    views: DirectionSet,
    lights: DirectionSet,
    cosine: Cosine,
    /// (view, light), in linear light with the BTF's cosine convention
    table: Vec<Vec3>,
    sampler: HalfSampler,
}

impl TabulatedBrdf {
    /// Creates a BRDF from one value in linear light per pair, (view, light), with the directions and the cosine
    /// convention of `meta`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the table's size is not views x lights, or the directions do not suit the `scheme`.
    pub fn new(meta: &BtfMeta, table: Vec<Vec3>, scheme: Scheme) -> Result<Self> {
        if table.len() != meta.pairs() {
            let problem = format!("found {} values, expected one for each of {} pairs", table.len(), meta.pairs());
            return Err(Error::parameter("table", problem));
        }
        let (views, lights) = (meta.views.clone(), meta.lights.clone());
        let angles = Angles::new(meta, scheme)?;
        let sampler = HalfSampler::new(false, |wi, wo| {
            interpolate(&angles, &table, lights.len(), wi, wo) / (PI * wi.z.max(0.01))
        });
        Ok(Self { angles, views, lights, cosine: meta.cosine, table, sampler })
    }

    /// Averages the texels of a BTF in linear light, pair by pair.
    ///
    /// # Errors
    /// Errors of the source; [`Error::Cancelled`]; [`Error::Parameter`] as [`TabulatedBrdf::new`].
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

/// The apparent value from a table over (view, light).
fn interpolate(angles: &Angles, table: &[Vec3], lights: usize, wi: Vec3, wo: Vec3) -> Vec3 {
    let view = angles.views_around(wo);
    let mut light = LightStencil::NONE;
    let Some(stencil) = angles.lit(&view, wi, wo, &mut light) else { return Vec3::ZERO };
    let mut sum = Vec3::ZERO;
    for (view, view_weight) in stencil.view.iter() {
        for (light, weight) in stencil.light.iter() {
            sum += view_weight * weight * table[view * lights + light];
        }
    }
    sum.max(Vec3::ZERO) * stencil.factor
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
        interpolate(&self.angles, &self.table, self.lights.len(), wi, wo)
    }

    fn sample(&self, _uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.sampler.sample(wo, random)
    }

    fn pdf(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.sampler.pdf(wi, wo)
    }
}

impl Brdf for TabulatedBrdf {
    /// The table, view by view.
    fn samples(&self) -> Vec<BrdfSample> {
        let mut samples = Vec::with_capacity(self.table.len());
        for view in 0..self.views.len() {
            for (light, &wi) in self.lights.directions().iter().enumerate() {
                let wo = self.lights.seen_from().map_or(self.views.directions()[view], |set| set.directions()[light]);
                let stored = self.table[view * self.lights.len() + light];
                let cosine = match self.cosine {
                    Cosine::Included => wi.z.max(0.01),
                    Cosine::Excluded => 1.0,
                };
                samples.push(BrdfSample { wi, wo, value: stored / (PI * cosine) });
            }
        }
        samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, MemoryBtf, SampleType};
    use crate::color::Encoding;
    use crate::direction::DirectionSet;
    use crate::progress::Silent;
    use std::borrow::Cow;

    fn btf(encoding: Encoding, cosine: Cosine) -> MemoryBtf {
        let meta = BtfMeta {
            width: 2,
            height: 1,
            views: DirectionSet::bonn81(),
            lights: DirectionSet::bonn81(),
            encoding,
            cosine,
            sample_type: SampleType::F32,
        };
        // a diffuse sample with albedo 0.4 and 0.2 in its two texels
        let light = |image: usize| match cosine {
            Cosine::Included => meta.lights.directions()[image % 81].z,
            Cosine::Excluded => 1.0,
        };
        let value = |i: usize| encoding.encode(light(i / 6) * if i % 6 < 3 { 0.4 } else { 0.2 });
        let values = (0..meta.pairs() * 6).map(value).collect();
        MemoryBtf::new(meta, Texels::F32(Cow::Owned(values))).unwrap()
    }

    #[test]
    fn the_mean_of_a_diffuse_sample_is_diffuse() {
        for (encoding, cosine) in [(Encoding::Linear, Cosine::Included), (Encoding::Srgb, Cosine::Excluded)] {
            let source = btf(encoding, cosine);
            for scheme in [Scheme::Triangles, Scheme::Rings] {
                let brdf = TabulatedBrdf::average(&source, scheme, &Silent).unwrap();
                for i in 0..200 {
                    let direction = |x: f32| crate::direction::from_angles((x * 0.61).sin().abs() * 1.5, x);
                    let (wi, wo) = (direction(i as f32), direction(i as f32 + 0.3));
                    let found = brdf.apparent(Vec2::ZERO, wi, wo);
                    // between samples a cosine is interpolated linearly: below it by at most 3 per cent
                    assert!((found - Vec3::splat(0.3 * wi.z)).abs().max_element() < 0.01, "{wi} {found}");
                }
                let samples = brdf.samples();
                assert!(samples.iter().all(|s| (s.value - Vec3::splat(0.3 / PI)).abs().max_element() < 1e-5));
                let at_sample = brdf.apparent(Vec2::ZERO, source.meta().lights.directions()[40], Vec3::Z);
                let expected = 0.3 * source.meta().lights.directions()[40].z;
                assert!((at_sample - Vec3::splat(expected)).abs().max_element() < 1e-5);
            }
        }
    }

    #[test]
    fn a_table_of_the_wrong_size_is_refused() {
        let source = btf(Encoding::Linear, Cosine::Included);
        assert!(TabulatedBrdf::new(source.meta(), vec![Vec3::ONE; 5], Scheme::Triangles).is_err());
    }
}
