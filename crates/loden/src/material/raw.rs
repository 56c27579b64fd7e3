//! A BTF evaluated from its images.

use std::ops::Deref;

use glam::Vec3;
use half::f16;

use super::angles::{AngularStencil, Footprint, LightStencil};
use super::images::Images;
use super::interpolation::Interpolation;
use super::texels::{Lookup, TexelMaterial, TexelPoint};
use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::memory::Pages;
use crate::simd::prefetch;
use crate::{Error, Result};

/// Points whose texels are prefetched together: their cache lines must fit the first-level cache.
const FETCHED: usize = 8;

/// The images of any [`BtfSource`] as a material: the reference for compressed materials.
///
/// # Model
/// Values are interpolated linearly between texels, views and lights: linear light, or as [`super::Blending`] says. `S` is
/// `&dyn BtfSource`, an `Arc` or a `Box` of one.
///
/// # Limits
/// Images that the source decodes, rather than lends from memory, are decoded once and kept: the whole BTF is then in
/// memory.
#[derive(Debug)]
pub struct RawBtf<S> {
    source: S,
    images: Images,
    /// All images, if the source does not lend them from memory.
    decoded: Option<Decoded>,
}

/// Numbers of the shape (view, light, y, x, rgb), as they are stored.
#[derive(Debug)]
enum Decoded {
    U8(Pages<u8>),
    F16(Pages<f16>),
    F32(Pages<f32>),
}

impl Decoded {
    /// Room for the images of a BTF whose views are like `first`.
    ///
    /// # Errors
    /// [`Error::Io`] if there is not enough memory.
    fn like(first: &Texels, meta: &BtfMeta) -> Result<Self> {
        let len = meta.views.len() * meta.view_len();
        Ok(match first {
            Texels::U8(_) => Self::U8(Pages::zeros(len)?),
            Texels::F16(_) => Self::F16(Pages::zeros(len)?),
            Texels::F32(_) => Self::F32(Pages::zeros(len)?),
        })
    }

    /// Keeps the numbers of a view, which begin at `first`; false if they are of another type.
    fn keep(&mut self, first: usize, texels: &Texels) -> bool {
        match (self, texels) {
            (Self::U8(all), Texels::U8(view)) => all[first..first + view.len()].copy_from_slice(view),
            (Self::F16(all), Texels::F16(view)) => all[first..first + view.len()].copy_from_slice(view),
            (Self::F32(all), Texels::F32(view)) => all[first..first + view.len()].copy_from_slice(view),
            _ => return false,
        }
        true
    }

    #[inline(always)]
    fn numbers(&self) -> Numbers<'_> {
        match self {
            Self::U8(values) => Numbers::U8(values),
            Self::F16(values) => Numbers::F16(values),
            Self::F32(values) => Numbers::F32(values),
        }
    }
}

/// Stored numbers of any type.
#[derive(Clone, Copy)]
enum Numbers<'a> {
    U8(&'a [u8]),
    F16(&'a [f16]),
    F32(&'a [f32]),
}

impl<'a> From<&'a Texels<'_>> for Numbers<'a> {
    fn from(texels: &'a Texels) -> Self {
        match texels {
            Texels::U8(values) => Self::U8(values),
            Texels::F16(values) => Self::F16(values),
            Texels::F32(values) => Self::F32(values),
        }
    }
}

impl Numbers<'_> {
    /// The numbers to average of the texel that begins at `place`.
    #[inline(always)]
    fn texel(self, images: &Images, place: usize) -> Vec3 {
        match self {
            Self::U8(values) => rgb(values, place, |v| images.byte(v)),
            Self::F16(values) => rgb(values, place, |v| images.number(v.to_f32())),
            Self::F32(values) => rgb(values, place, |v| images.number(v)),
        }
    }

    /// The mean of four texels of the image that begins at `first`.
    #[inline(always)]
    fn blended(self, images: &Images, first: usize, footprint: &Footprint) -> Vec3 {
        let each = footprint.texel.iter().zip(footprint.weight);
        each.map(|(texel, weight)| self.texel(images, first + 3 * texel) * weight).sum()
    }

    #[inline(always)]
    fn prefetch(self, place: usize) {
        match self {
            Self::U8(values) => prefetch(values, place),
            Self::F16(values) => prefetch(values, place),
            Self::F32(values) => prefetch(values, place),
        }
    }
}

#[inline(always)]
fn rgb<T: Copy>(values: &[T], place: usize, number: impl Fn(T) -> f32) -> Vec3 {
    let texel = &values[place..][..3];
    Vec3::new(number(texel[0]), number(texel[1]), number(texel[2]))
}

impl<S: Deref<Target: BtfSource> + Send + Sync> RawBtf<S> {
    /// Creates the material. Reads every view once.
    ///
    /// # Errors
    /// Errors of the source; [`Error::Parameter`] if the directions do not allow the scheme of the interpolation;
    /// [`Error::Io`] if memory runs out.
    pub fn new(source: S, interpolation: impl Into<Interpolation>) -> Result<Self> {
        let mut material = Self::on_demand(source, interpolation)?;
        let meta = material.source.meta();
        for view in 0..meta.views.len() {
            let texels = material.source.view(view)?;
            let wrong = |problem: String| Error::parameter("source", format!("view {view} {problem}"));
            if texels.len() != meta.view_len() {
                return Err(wrong(format!("has {} numbers, expected {}", texels.len(), meta.view_len())));
            }
            if view == 0 && is_owned(&texels) {
                material.decoded = Some(Decoded::like(&texels, meta)?);
            }
            if let Some(decoded) = &mut material.decoded
                && !decoded.keep(view * meta.view_len(), &texels)
            {
                return Err(wrong("has numbers of another type than view 0".into()));
            }
        }
        Ok(material)
    }

    /// Like [`RawBtf::new`], but decodes images for every evaluation and keeps none. Slow; for BTFs larger than
    /// memory.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the directions do not allow the scheme of the interpolation.
    pub fn on_demand(source: S, interpolation: impl Into<Interpolation>) -> Result<Self> {
        let images = Images::new(source.meta(), interpolation.into())?;
        Ok(Self { source, images, decoded: None })
    }

    /// The mean of the numbers around a point.
    #[inline]
    fn mean(&self, stencil: &AngularStencil, footprint: &Footprint) -> Vec3 {
        let (images, meta) = (&self.images, &self.images.lookup.meta);
        let mut sum = Vec3::ZERO;
        for (view, view_weight) in stencil.view.iter().filter(|view| view.1 > 0.0) {
            for (light, weight) in stencil.light.iter().filter(|light| light.1 > 0.0) {
                let texels = match &self.decoded {
                    Some(decoded) => {
                        let first = view * meta.view_len() + light * meta.image_len();
                        decoded.numbers().blended(images, first, footprint)
                    }
                    // the values are meaningless after a failure
                    None => match images.lookup.failure.ok(self.source.image(view, light)) {
                        Some(image) => Numbers::from(&image).blended(images, 0, footprint),
                        None => Vec3::ZERO,
                    },
                };
                sum += view_weight * weight * texels;
            }
        }
        sum
    }

    /// Prefetches the texels of a point. Those beside each other mostly share a cache line.
    #[inline(always)]
    fn prefetch(&self, stencil: &AngularStencil, footprint: &Footprint) {
        let Some(decoded) = &self.decoded else { return };
        let meta = &self.images.lookup.meta;
        for (view, _) in stencil.view.iter() {
            for (light, _) in stencil.light.iter() {
                let first = view * meta.view_len() + light * meta.image_len();
                decoded.numbers().prefetch(first + 3 * footprint.texel[0]);
                decoded.numbers().prefetch(first + 3 * footprint.texel[2]);
            }
        }
    }
}

/// Whether texels were decoded for the caller, rather than lent from memory.
fn is_owned(texels: &Texels<'_>) -> bool {
    use std::borrow::Cow::Owned;
    matches!(texels, Texels::U8(Owned(_)) | Texels::F16(Owned(_)) | Texels::F32(Owned(_)))
}

impl<S: Deref<Target: BtfSource> + Send + Sync> TexelMaterial for RawBtf<S> {
    fn lookup(&self) -> &Lookup {
        &self.images.lookup
    }

    #[inline]
    fn value(&self, point: &TexelPoint, wi: Vec3) -> Vec3 {
        let mut light = LightStencil::NONE;
        let stencil = self.images.lookup.angles.lit(&point.view, wi, point.wo, &mut light);
        stencil.map_or(Vec3::ZERO, |stencil| {
            self.images.apparent_of(self.mean(&stencil, &self.images.lookup.footprint(point)), &stencil)
        })
    }

    fn values(&self, points: &[&TexelPoint], wi: &[Vec3], values: &mut [Vec3]) {
        let (mut lights, mut footprints) = ([LightStencil::NONE; FETCHED], [Footprint::NONE; FETCHED]);
        let angles = &self.images.lookup.angles;
        for ((points, wi), values) in points.chunks(FETCHED).zip(wi.chunks(FETCHED)).zip(values.chunks_mut(FETCHED)) {
            // Find the samples around each point and prefetch their texels
            for (((point, wi), light), footprint) in points.iter().zip(wi).zip(&mut lights).zip(&mut footprints) {
                *footprint = self.images.lookup.footprint(point);
                match angles.lit(&point.view, *wi, point.wo, light) {
                    Some(stencil) => self.prefetch(&stencil, footprint),
                    None => *light = LightStencil::NONE,
                }
            }
            // Average them
            for (((value, point), light), footprint) in values.iter_mut().zip(points).zip(&lights).zip(&footprints) {
                let stencil = AngularStencil::new(&point.view, light);
                *value = self.images.apparent_of(self.mean(&stencil, footprint), &stencil);
            }
        }
    }

    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>> {
        let (meta, images) = (&self.images.lookup.meta, &self.images);
        let read;
        let (numbers, first) = match &self.decoded {
            Some(decoded) => (decoded.numbers(), view * meta.view_len()),
            None => {
                read = self.source.view(view)?;
                (Numbers::from(&read), 0)
            }
        };
        let at = |light: usize, texel: usize| {
            images.luminance(light, numbers.texel(images, first + light * meta.image_len() + 3 * texel))
        };
        Ok(lights.iter().flat_map(|&light| texels.iter().map(move |&texel| at(light, texel))).collect())
    }
}
