//! Evaluation at continuous texture coordinates and directions, from the factors.

use glam::{Vec2, Vec3};
use half::f16;
use rayon::prelude::*;

use super::PvmfBtf;
use super::decode::{Coefficients, ViewFactors};
use crate::Result;
use crate::btf::BtfSource;
use crate::codec::domain::Linearizer;
use crate::direction::Scheme;
use crate::material::Material;
use crate::material::angles::{Angles, AngularStencil, Footprint};

/// A PVMF-compressed BTF that can be evaluated; it holds its own copy of the factors.
///
/// # Model
/// Texels, views and lights are interpolated in the domain that was factored (for photographs: in display-encoded
/// values), where the result is linear in the coefficients: four texels cost one blend of c numbers. The sum is
/// turned into linear light, negative results into zero, and into an apparent value by
/// [`AngularStencil::factor`]. At a texel centre and sampled directions this is the decoded image.
///
/// # Limits
/// Interpolating display-encoded values darkens the middle between a dark and a bright sample against interpolation
/// in linear light.
#[derive(Debug, Clone)]
pub struct PvmfMaterial {
    angles: Angles,
    linearizer: Linearizer,
    width: usize,
    height: usize,
    views: usize,
    lights: usize,
    c: usize,
    /// (texel, view, component): what one evaluation needs lies together
    coefficients: Numbers,
    /// (view, light, mean then components, rgb and a spare)
    table: Vec<[f32; 4]>,
}

#[derive(Debug, Clone)]
enum Numbers {
    F32(Vec<f32>),
    F16(Vec<f16>),
    U8(Vec<u8>),
}

/// One texel seen along a pair of directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexelQuery {
    /// Texel number, row by row from the top.
    pub texel: usize,
    /// Towards the light.
    pub wi: Vec3,
    /// Towards the viewer.
    pub wo: Vec3,
}

/// Queries whose memory is fetched together.
const BATCH: usize = 32;

/// Texels transposed at a time.
const BLOCK: usize = 64;

impl PvmfMaterial {
    /// Prepares evaluation.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not suit the interpolation `scheme`.
    pub fn new(btf: &PvmfBtf, scheme: Scheme) -> Result<Self> {
        let meta = btf.meta();
        let (views, lights, c) = (meta.views.len(), meta.lights.len(), btf.components());
        let mut table = Vec::with_capacity(views * lights * (c + 1));
        let factors: Vec<ViewFactors> = (0..views).map(|view| btf.factors(view)).collect();
        for view in &factors {
            (0..lights).for_each(|light| push_rows(view, light, c, &mut table));
        }
        let size = meta.texels() * views * c;
        let coefficients = match factors.first().map(|f| f.coefficients) {
            Some(Coefficients::F16(_)) => Numbers::F16(transpose(size, &factors, c, |f| match f {
                Coefficients::F16(values) => values,
                _ => &[],
            })),
            Some(Coefficients::U8(_)) => Numbers::U8(transpose(size, &factors, c, |f| match f {
                Coefficients::U8(values) => values,
                _ => &[],
            })),
            _ => Numbers::F32(transpose(size, &factors, c, |f| match f {
                Coefficients::F32(values) => values,
                _ => &[],
            })),
        };
        Ok(Self {
            angles: Angles::new(meta, scheme)?,
            linearizer: Linearizer::new(btf.domain(), meta.encoding),
            width: meta.width,
            height: meta.height,
            views,
            lights,
            c,
            coefficients,
            table,
        })
    }

    /// The apparent value of a texel, without interpolation between texels.
    ///
    /// # Panics
    /// If there is no such texel.
    #[inline]
    pub fn apparent_texel(&self, texel: usize, wi: Vec3, wo: Vec3) -> Vec3 {
        match self.angles.stencil(wi, wo) {
            Some(stencil) => self.value(&stencil, [texel], [1.0]),
            None => Vec3::ZERO,
        }
    }

    /// The apparent values of many texels: [`PvmfMaterial::apparent_texel`] in turn, but faster, since memory is
    /// fetched ahead.
    ///
    /// # Panics
    /// If there is no such texel, or `out` is shorter than `queries`.
    pub fn apparent_texels(&self, queries: &[TexelQuery], out: &mut [Vec3]) {
        let mut stencils = [None; BATCH];
        for (queries, out) in queries.chunks(BATCH).zip(out[..queries.len()].chunks_mut(BATCH)) {
            for (query, stencil) in queries.iter().zip(&mut stencils) {
                *stencil = self.angles.stencil(query.wi, query.wo);
                if let Some(stencil) = stencil {
                    self.prefetch(query.texel, stencil);
                }
            }
            for ((query, stencil), out) in queries.iter().zip(&stencils).zip(out) {
                *out = stencil.as_ref().map_or(Vec3::ZERO, |s| self.value(s, [query.texel], [1.0]));
            }
        }
    }

    #[inline]
    fn prefetch(&self, texel: usize, stencil: &AngularStencil) {
        for (view, _) in stencil.view.iter() {
            let place = (texel * self.views + view) * self.c;
            match &self.coefficients {
                Numbers::F32(values) => prefetch(values, place),
                Numbers::F16(values) => prefetch(values, place),
                Numbers::U8(values) => prefetch(values, place),
            }
            for (light, _) in stencil.light.iter() {
                prefetch(&self.table, (view * self.lights + light) * (self.c + 1));
            }
        }
    }

    #[inline]
    fn value<const T: usize>(&self, stencil: &AngularStencil, texels: [usize; T], weights: [f32; T]) -> Vec3 {
        let sum = match &self.coefficients {
            Numbers::F32(values) => self.sum(values, |v| v, stencil, texels, weights),
            Numbers::F16(values) => self.sum(values, f16::to_f32, stencil, texels, weights),
            Numbers::U8(values) => self.sum(values, f32::from, stencil, texels, weights),
        };
        Vec3::new(sum[0], sum[1], sum[2]).map(|v| self.linearizer.linear(v)) * stencil.factor
    }

    /// Sum over views and lights of weights x (mean + components . coefficients), in the domain.
    #[inline(always)]
    fn sum<N: Copy, const T: usize>(
        &self,
        values: &[N],
        number: impl Fn(N) -> f32,
        stencil: &AngularStencil,
        texels: [usize; T],
        weights: [f32; T],
    ) -> [f32; 4] {
        let mut sum = [0.0; 4];
        for (view, view_weight) in stencil.view.iter() {
            let rows = texels.map(|texel| &values[(texel * self.views + view) * self.c..][..self.c]);
            let coefficient = |k: usize| {
                let blend: f32 = rows.iter().zip(weights).map(|(row, w)| w * number(row[k])).sum();
                view_weight * blend
            };
            let tables = |light: usize| &self.table[(view * self.lights + light) * (self.c + 1)..][..self.c + 1];
            for (light, weight) in stencil.light.iter() {
                add(&mut sum, view_weight * weight, &tables(light)[0]);
            }
            // four components at a time keep their coefficients in registers
            let mut k = 0;
            while k + 4 <= self.c {
                let four: [f32; 4] = std::array::from_fn(|i| coefficient(k + i));
                for (light, weight) in stencil.light.iter() {
                    let table = &tables(light)[1 + k..][..4];
                    for (coefficient, row) in four.iter().zip(table) {
                        add(&mut sum, weight * coefficient, row);
                    }
                }
                k += 4;
            }
            for k in k..self.c {
                let coefficient = coefficient(k);
                for (light, weight) in stencil.light.iter() {
                    add(&mut sum, weight * coefficient, &tables(light)[1 + k]);
                }
            }
        }
        sum
    }
}

#[inline(always)]
fn add(sum: &mut [f32; 4], weight: f32, row: &[f32; 4]) {
    for (sum, value) in sum.iter_mut().zip(row) {
        *sum += weight * value;
    }
}

#[inline(always)]
fn prefetch<T>(values: &[T], place: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(value) = values.get(place) {
        // SAFETY: a prefetch of readable memory; SSE is part of x86-64.
        unsafe {
            std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(std::ptr::from_ref(value).cast())
        };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, place);
}

/// Mean and components of a pair; the range of 8-bit coefficients is worked in.
fn push_rows(view: &ViewFactors, light: usize, c: usize, table: &mut Vec<[f32; 4]>) {
    let row = view.mean.len();
    let component = |k: usize, channel: usize| view.basis[k * row + 3 * light + channel];
    let range = |k: usize| view.range.map_or([0.0, 1.0], |r| r[k]);
    let rgb = |value: &dyn Fn(usize) -> f32| [value(0), value(1), value(2), 0.0];
    table.push(rgb(&|channel| {
        view.mean[3 * light + channel] + (0..c).map(|k| range(k)[0] * component(k, channel)).sum::<f32>()
    }));
    for k in 0..c {
        table.push(rgb(&|channel| range(k)[1] * component(k, channel)));
    }
}

/// (view, texel, component) to (texel, view, component).
fn transpose<'a, T: Copy + Default + Send + Sync + 'a>(
    size: usize,
    factors: &[ViewFactors<'a>],
    c: usize,
    values: impl Fn(Coefficients<'a>) -> &'a [T],
) -> Vec<T> {
    let views: Vec<&[T]> = factors.iter().map(|f| values(f.coefficients)).collect();
    let mut out = vec![T::default(); size];
    out.par_chunks_mut(BLOCK * views.len() * c).enumerate().for_each(|(block, out)| {
        for (v, view) in views.iter().enumerate() {
            let texels = view[block * BLOCK * c..].chunks_exact(c);
            for (out, texel) in out.chunks_exact_mut(views.len() * c).zip(texels) {
                out[v * c..(v + 1) * c].copy_from_slice(texel);
            }
        }
    });
    out
}

impl Material for PvmfMaterial {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        match self.angles.stencil(wi, wo) {
            Some(stencil) => {
                let footprint = Footprint::new(uv, self.width, self.height);
                self.value(&stencil, footprint.texel, footprint.weight)
            }
            None => Vec3::ZERO,
        }
    }
}
