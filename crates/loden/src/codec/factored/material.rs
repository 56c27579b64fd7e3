//! Evaluation at continuous texture coordinates and directions, from the factors.

use std::sync::Arc;

use glam::Vec3;

use super::decode::ViewFactors;
use super::table::{Numbers, Table};
use super::{Compact, FactoredBtf};
use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::color::domain::Linearizer;
use crate::color::luminance;
use crate::direction::{Scheme, Stencil};
use crate::material::angles::{Angles, AngularStencil};
use crate::material::lobes::BtfSampler;
use crate::material::texels::{Lookup, Seen, TexelMaterial};
use crate::simd::prefetch;

/// A factored BTF that can be evaluated; it holds its own copy of factors that are mapped, and shares others.
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
#[derive(Debug)]
pub struct FactoredMaterial {
    angles: Angles,
    linearizer: Linearizer,
    meta: BtfMeta,
    factors: Factors,
    sampler: BtfSampler,
}

#[derive(Debug)]
enum Factors {
    /// Rearranged in the precision in which they are stored.
    Table(Numbers, Table),
    /// As they are held.
    Compact(Arc<Compact>),
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

/// Points of a surface whose memory is asked for at a time: not more than the first-level cache holds.
const FETCHED: usize = 8;

impl FactoredMaterial {
    /// Prepares evaluation.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not suit the interpolation `scheme`; [`crate::Error::Io`] if
    /// there is not enough memory.
    pub fn new(btf: &FactoredBtf, scheme: Scheme) -> Result<Self> {
        let meta = btf.meta();
        let factors = match btf.compact() {
            Some(factors) => Factors::Compact(factors),
            None => {
                let factors: Vec<ViewFactors> = (0..meta.views.len()).map(|view| btf.factors(view)).collect();
                let blocks = &factors[..btf.sharing().blocks(meta)];
                Factors::Table(
                    Numbers::new(blocks, meta.texels(), btf.components())?,
                    Table::new(&factors, meta, btf.components(), btf.sharing())?,
                )
            }
        };
        Ok(Self {
            angles: Angles::new(meta, scheme)?,
            linearizer: Linearizer::new(btf.domain(), meta.encoding),
            meta: meta.clone(),
            factors,
            sampler: BtfSampler::default(),
        })
    }

    /// The apparent value of a texel, without interpolation between texels.
    ///
    /// # Panics
    /// If there is no such texel.
    #[inline]
    pub fn apparent_texel(&self, texel: usize, wi: Vec3, wo: Vec3) -> Vec3 {
        match self.angles.stencil(wi, wo) {
            Some(stencil) => self.sum(&stencil, [texel], [1.0]),
            None => Vec3::ZERO,
        }
    }

    /// The apparent values of many texels: [`FactoredMaterial::apparent_texel`] in turn, but faster, since memory is
    /// fetched ahead.
    ///
    /// # Panics
    /// If there is no such texel, or `out` is shorter than `queries`.
    pub fn apparent_texels(&self, queries: &[TexelQuery], out: &mut [Vec3]) {
        let mut stencils = [AngularStencil::NONE; BATCH];
        let mut sums = [[0.0; 3]; BATCH];
        for (queries, out) in queries.chunks(BATCH).zip(out[..queries.len()].chunks_mut(BATCH)) {
            self.locate(queries, &mut stencils);
            let (stencils, sums) = (&stencils[..queries.len()], &mut sums[..queries.len()]);
            let texels = queries.iter().map(|query| query.texel);
            match &self.factors {
                Factors::Table(Numbers::F32(values), table) => table.sums(values, stencils, texels, sums),
                Factors::Table(Numbers::F16(values), table) => table.sums(values, stencils, texels, sums),
                Factors::Table(Numbers::U8(values), table) => table.sums(values, stencils, texels, sums),
                Factors::Compact(factors) => {
                    let mut numbers = [0; BATCH];
                    numbers.iter_mut().zip(texels).for_each(|(number, texel)| *number = texel);
                    factors.sums(stencils, self.meta.lights.len(), &numbers[..stencils.len()], sums);
                }
            }
            for ((sum, stencil), out) in sums.iter().zip(stencils).zip(out) {
                *out = self.apparent_of(*sum, stencil);
            }
        }
    }

    /// Fills the stencils and asks for the memory that they need.
    fn locate(&self, queries: &[TexelQuery], stencils: &mut [AngularStencil]) {
        #[inline(always)]
        fn portable(material: &FactoredMaterial, queries: &[TexelQuery], stencils: &mut [AngularStencil]) {
            for (query, stencil) in queries.iter().zip(stencils) {
                material.angles.find(query.wi, query.wo, stencil);
                material.prefetch(query.texel, &stencil.view);
            }
        }
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            fn avx2(material: &FactoredMaterial, queries: &[TexelQuery], stencils: &mut [AngularStencil]) {
                portable(material, queries, stencils);
            }
            if crate::simd::has_avx2() {
                // SAFETY: the processor has AVX2.
                return unsafe { avx2(self, queries, stencils) };
            }
        }
        portable(self, queries, stencils);
    }

    #[inline(always)]
    fn prefetch(&self, texel: usize, views: &Stencil) {
        // held factors are asked for in turn: those of a whole batch are more than the first-level cache holds
        let Factors::Table(values, table) = &self.factors else { return };
        // the table of pairs is small and stays in the second-level cache: only coefficients are fetched
        for &view in &views.index[..views.count.min(4)] {
            let place = table.coefficients(texel, view as usize);
            match values {
                Numbers::F32(values) => prefetch(values, place),
                Numbers::F16(values) => prefetch(values, place),
                Numbers::U8(values) => prefetch(values, place),
            }
        }
    }

    /// Asks for the memory that an evaluation needs.
    #[inline]
    fn fetch(&self, seen: &Seen, stencil: &AngularStencil) {
        match &self.factors {
            Factors::Table(..) => seen.footprint.texel.iter().for_each(|&texel| self.prefetch(texel, &seen.view)),
            Factors::Compact(factors) => {
                seen.footprint.texel.iter().for_each(|&texel| factors.prefetch_texel(texel));
                factors.prefetch_pairs(stencil, self.meta.lights.len());
            }
        }
    }

    #[inline]
    fn sum<const T: usize>(&self, stencil: &AngularStencil, texels: [usize; T], weights: [f32; T]) -> Vec3 {
        let rgb = match &self.factors {
            Factors::Table(Numbers::F32(values), table) => table.sum(values, stencil, texels, weights),
            Factors::Table(Numbers::F16(values), table) => table.sum(values, stencil, texels, weights),
            Factors::Table(Numbers::U8(values), table) => table.sum(values, stencil, texels, weights),
            Factors::Compact(factors) => factors.sum(stencil, self.meta.lights.len(), texels, weights),
        };
        self.apparent_of(rgb, stencil)
    }

    #[inline(always)]
    fn apparent_of(&self, [r, g, b]: [f32; 3], stencil: &AngularStencil) -> Vec3 {
        let linear = |v| self.linearizer.linear(v);
        Vec3::new(linear(r), linear(g), linear(b)) * stencil.factor
    }
}

impl TexelMaterial for FactoredMaterial {
    fn lookup(&self) -> Lookup<'_> {
        Lookup { meta: &self.meta, angles: &self.angles, sampler: &self.sampler }
    }

    fn value(&self, seen: &Seen, wi: Vec3) -> Vec3 {
        let stencil = self.angles.lit(&seen.view, wi);
        stencil.map_or(Vec3::ZERO, |stencil| self.sum(&stencil, seen.footprint.texel, seen.footprint.weight))
    }

    fn values(&self, seen: &[&Seen], wi: &[Vec3], values: &mut [Vec3]) {
        let mut stencils = [AngularStencil::NONE; FETCHED];
        for ((seen, wi), values) in seen.chunks(FETCHED).zip(wi.chunks(FETCHED)).zip(values.chunks_mut(FETCHED)) {
            for ((seen, wi), stencil) in seen.iter().zip(wi).zip(&mut stencils) {
                *stencil = self.angles.lit(&seen.view, *wi).unwrap_or(AngularStencil::NONE);
                self.fetch(seen, stencil);
            }
            for ((seen, stencil), value) in seen.iter().zip(&stencils).zip(values) {
                *value = self.sum(stencil, seen.footprint.texel, seen.footprint.weight);
            }
        }
    }

    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>> {
        let wo = self.meta.views.directions()[view];
        let mut found = Vec::with_capacity(lights.len() * texels.len());
        let mut values = vec![Vec3::ZERO; texels.len()];
        for &light in lights {
            let wi = self.meta.lights.directions()[light];
            let queries: Vec<TexelQuery> = texels.iter().map(|&texel| TexelQuery { texel, wi, wo }).collect();
            self.apparent_texels(&queries, &mut values);
            found.extend(values.iter().map(|value| luminance(value.to_array())));
        }
        Ok(found)
    }
}
