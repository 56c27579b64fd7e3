//! A BTF evaluated from its images.

use std::ops::Deref;

use glam::{Vec2, Vec3};

use super::lobes::BtfSampler;
use super::{Material, Sample};
use super::angles::{Angles, Footprint};
use crate::btf::{BtfSource, Cosine, Texels};
use crate::codec::domain::{Domain, Linearizer};
use crate::color::{Encoding, luminance};
use crate::direction::Scheme;
use crate::{Error, Result};

/// The images of any [`BtfSource`] as a material: the reference that compressed ones are judged by.
///
/// # Model
/// Texels, views and lights are interpolated linearly in the stored values, as compressed materials do it, then
/// turned into linear light. `S` is `&dyn BtfSource`, an `Arc` or a `Box` of one.
///
/// # Limits
/// Views that the source decodes (rather than lends from memory) are decoded once and kept: the whole BTF is in
/// memory then.
#[derive(Debug)]
pub struct RawBtf<S> {
    source: S,
    angles: Angles,
    linearizer: Linearizer,
    /// Views the source does not lend.
    decoded: Vec<Option<Texels<'static>>>,
    sampler: BtfSampler,
}

impl<S: Deref<Target: BtfSource> + Send + Sync> RawBtf<S> {
    /// Prepares evaluation, which reads every view once.
    ///
    /// # Errors
    /// What the source returns; [`Error::Parameter`] if the directions do not suit the interpolation `scheme`.
    pub fn new(source: S, scheme: Scheme) -> Result<Self> {
        let meta = source.meta();
        let angles = Angles::new(meta, scheme)?;
        let domain = if meta.encoding == Encoding::Linear { Domain::Linear } else { Domain::Display };
        let linearizer = Linearizer::new(domain, meta.encoding);
        let keep = |view: usize| {
            let texels = source.view(view)?;
            if texels.len() != meta.view_len() {
                let problem = format!("view {view} has {} numbers, expected {}", texels.len(), meta.view_len());
                return Err(Error::parameter("source", problem));
            }
            Ok(owned(texels))
        };
        let decoded = (0..meta.views.len()).map(keep).collect::<Result<_>>()?;
        Ok(Self { source, angles, linearizer, decoded, sampler: BtfSampler::default() })
    }

    /// As [`RawBtf::new`], but images are decoded anew for every evaluation and none is kept: slow, for a BTF that does
    /// not fit into memory.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the directions do not suit the interpolation `scheme`.
    pub fn on_demand(source: S, scheme: Scheme) -> Result<Self> {
        let meta = source.meta();
        let angles = Angles::new(meta, scheme)?;
        let domain = if meta.encoding == Encoding::Linear { Domain::Linear } else { Domain::Display };
        let linearizer = Linearizer::new(domain, meta.encoding);
        let decoded = (0..meta.views.len()).map(|_| None).collect();
        Ok(Self { source, angles, linearizer, decoded, sampler: BtfSampler::default() })
    }

    fn texel_sum(&self, view: usize, light: usize, footprint: &Footprint) -> Vec3 {
        let meta = self.source.meta();
        let lent;
        let (texels, first) = match &self.decoded[view] {
            Some(texels) => (texels, light * meta.image_len()),
            // it was readable on construction; a source that fails later shows black
            None => match self.source.image(view, light) {
                Ok(texels) => {
                    lent = texels;
                    (&lent, 0)
                }
                Err(_) => return Vec3::ZERO,
            },
        };
        footprint.texel.iter().zip(footprint.weight).map(|(&t, w)| stored(texels, first + 3 * t) * w).sum()
    }

    /// Luminances of apparent values at sampled pairs, (light, texel).
    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>> {
        let meta = self.source.meta();
        let read;
        let numbers = match &self.decoded[view] {
            Some(numbers) => numbers,
            None => {
                read = self.source.view(view)?;
                &read
            }
        };
        let at = |light: usize, texel: usize| {
            let stored = stored(numbers, light * meta.image_len() + 3 * texel);
            let cosine = if meta.cosine == Cosine::Excluded { meta.lights.directions()[light].z } else { 1.0 };
            luminance(stored.map(|v| self.linearizer.linear(v)).to_array()) * cosine
        };
        Ok(lights.iter().flat_map(|&light| texels.iter().map(move |&texel| at(light, texel))).collect())
    }
}

/// The texel whose first number is the `i`-th.
#[inline]
fn stored(texels: &Texels, i: usize) -> Vec3 {
    match texels {
        Texels::U8(v) => Vec3::new(f32::from(v[i]), f32::from(v[i + 1]), f32::from(v[i + 2])) / 255.0,
        Texels::F16(v) => Vec3::new(v[i].to_f32(), v[i + 1].to_f32(), v[i + 2].to_f32()),
        Texels::F32(v) => Vec3::new(v[i], v[i + 1], v[i + 2]),
    }
}

/// The texels themselves if they were decoded for the caller, nothing if they are lent.
fn owned(texels: Texels<'_>) -> Option<Texels<'static>> {
    use std::borrow::Cow::Owned;
    match texels {
        Texels::U8(Owned(values)) => Some(Texels::U8(Owned(values))),
        Texels::F16(Owned(values)) => Some(Texels::F16(Owned(values))),
        Texels::F32(Owned(values)) => Some(Texels::F32(Owned(values))),
        _ => None,
    }
}

impl<S: Deref<Target: BtfSource> + Send + Sync> Material for RawBtf<S> {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let Some(stencil) = self.angles.stencil(wi, wo) else { return Vec3::ZERO };
        let meta = self.source.meta();
        let footprint = Footprint::new(uv, meta.width, meta.height);
        let mut sum = Vec3::ZERO;
        for (view, view_weight) in stencil.view.iter().filter(|s| s.1 > 0.0) {
            for (light, weight) in stencil.light.iter().filter(|s| s.1 > 0.0) {
                sum += view_weight * weight * self.texel_sum(view, light, &footprint);
            }
        }
        sum.map(|v| self.linearizer.linear(v)) * stencil.factor
    }

    fn prepare(&self) -> Result<()> {
        self.sampler.prepare(self.source.meta(), &self.angles, &|view, lights, texels| self.luminances(view, lights, texels))
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.sampler.sample(&self.angles, uv, wo, random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.sampler.pdf(&self.angles, uv, wi, wo)
    }
}
