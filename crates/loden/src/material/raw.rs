//! A BTF evaluated from its images.

use std::ops::Deref;

use glam::Vec3;

use super::images::{Corners, Images};
use super::interpolation::Interpolation;
use super::texels::{Lookup, TexelMaterial, TexelPoint};
use crate::btf::{BtfSource, Texels};
use crate::direction::Stencil;
use crate::{Error, Result};

/// The images of any [`BtfSource`] as a material: the reference for compressed materials.
///
/// # Model
/// Values are interpolated linearly between texels, views and lights: linear light, or as [`super::Blending`] says. `S` is
/// `&dyn BtfSource`, an `Arc` or a `Box` of one.
///
/// # Limits
/// Views that the source decodes, rather than lends from memory, are decoded once and kept: the whole BTF is then in
/// memory.
#[derive(Debug)]
pub struct RawBtf<S> {
    source: S,
    images: Images,
    /// Views that the source does not lend from memory.
    decoded: Vec<Option<Texels<'static>>>,
}

impl<S: Deref<Target: BtfSource> + Send + Sync> RawBtf<S> {
    /// Creates the material. Reads every view once.
    ///
    /// # Errors
    /// Errors of the source; [`Error::Parameter`] if the directions do not allow the scheme of the interpolation.
    pub fn new(source: S, interpolation: impl Into<Interpolation>) -> Result<Self> {
        let meta = source.meta();
        let images = Images::new(meta, interpolation.into())?;
        let keep = |view: usize| {
            let texels = source.view(view)?;
            if texels.len() != meta.view_len() {
                let problem = format!("view {view} has {} numbers, expected {}", texels.len(), meta.view_len());
                return Err(Error::parameter("source", problem));
            }
            Ok(owned(texels))
        };
        let decoded = (0..meta.views.len()).map(keep).collect::<Result<_>>()?;
        Ok(Self { source, images, decoded })
    }

    /// Like [`RawBtf::new`], but decodes images for every evaluation and keeps none. Slow; for BTFs larger than
    /// memory.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the directions do not allow the scheme of the interpolation.
    pub fn on_demand(source: S, interpolation: impl Into<Interpolation>) -> Result<Self> {
        let meta = source.meta();
        let images = Images::new(meta, interpolation.into())?;
        let decoded = (0..meta.views.len()).map(|_| None).collect();
        Ok(Self { source, images, decoded })
    }

    /// The numbers to average of a footprint in one view.
    #[inline]
    fn fill(&self, view: usize, lights: &Stencil, texels: &[usize; 4], out: &mut Corners) {
        let image = self.source.meta().image_len();
        let copy = |texels_of: &Texels, first: usize, out: &mut [Vec3; 4]| {
            out.iter_mut()
                .zip(texels)
                .for_each(|(out, &texel)| *out = numbers(&self.images, texels_of, first + 3 * texel));
        };
        for ((light, _), out) in lights.iter().zip(out).filter(|(light, _)| light.1 > 0.0) {
            match &self.decoded[view] {
                Some(numbers) => copy(numbers, light * image, out),
                // the values are meaningless after a failure
                None => match self.images.lookup.failure.ok(self.source.image(view, light)) {
                    Some(numbers) => copy(&numbers, 0, out),
                    None => *out = [Vec3::ZERO; 4],
                },
            }
        }
    }
}

/// The numbers to average of the texel whose first number is at index `i`.
#[inline]
fn numbers(images: &Images, texels: &Texels, i: usize) -> Vec3 {
    match texels {
        Texels::U8(v) => Vec3::new(images.byte(v[i]), images.byte(v[i + 1]), images.byte(v[i + 2])),
        Texels::F16(v) => Vec3::new(v[i].to_f32(), v[i + 1].to_f32(), v[i + 2].to_f32()).map(|v| images.number(v)),
        Texels::F32(v) => Vec3::new(v[i], v[i + 1], v[i + 2]).map(|v| images.number(v)),
    }
}

/// The texels if they were decoded for the caller; `None` if they are borrowed.
fn owned(texels: Texels<'_>) -> Option<Texels<'static>> {
    use std::borrow::Cow::Owned;
    match texels {
        Texels::U8(Owned(values)) => Some(Texels::U8(Owned(values))),
        Texels::F16(Owned(values)) => Some(Texels::F16(Owned(values))),
        Texels::F32(Owned(values)) => Some(Texels::F32(Owned(values))),
        _ => None,
    }
}

impl<S: Deref<Target: BtfSource> + Send + Sync> TexelMaterial for RawBtf<S> {
    fn lookup(&self) -> &Lookup {
        &self.images.lookup
    }

    #[inline]
    fn value(&self, point: &TexelPoint, wi: Vec3) -> Vec3 {
        let fill =
            |view, lights: &Stencil, texels: &[usize; 4], out: &mut Corners| self.fill(view, lights, texels, out);
        self.images.apparent(point, wi, fill)
    }

    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>> {
        let meta = self.source.meta();
        let read;
        let stored = match &self.decoded[view] {
            Some(stored) => stored,
            None => {
                read = self.source.view(view)?;
                &read
            }
        };
        let at = |light: usize, texel: usize| {
            self.images.luminance(light, numbers(&self.images, stored, light * meta.image_len() + 3 * texel))
        };
        Ok(lights.iter().flat_map(|&light| texels.iter().map(move |&texel| at(light, texel))).collect())
    }
}
