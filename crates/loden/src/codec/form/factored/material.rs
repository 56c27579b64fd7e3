//! Evaluation at continuous texture coordinates and directions, from the factors.

use std::slice::from_ref;
use std::sync::Arc;

use glam::Vec3;

use super::decode::ViewFactors;
use super::table::{Numbers, Table};
use super::{Compact, FactoredBtf};
use crate::Result;
use crate::color::domain::Linearizer;
use crate::direction::Stencil;
use crate::material::angles::{AngularStencil, Footprint, LightStencil, PLACES, Places};
use crate::material::texels::{Lookup, TexelMaterial, TexelPoint};
use crate::material::{Blending, Interpolation, Point};
use crate::simd::{prefetch, wide};

/// A factored BTF for evaluation. It copies factors that are memory-mapped and shares those in memory.
///
/// # Model
/// Texels, views and lights are interpolated in the factored domain (for photographs: display-encoded values). The
/// result is linear in the coefficients, so four texels cost one blend of c numbers. The sum is converted to linear
/// light, clamped at zero, and turned into an apparent value by [`AngularStencil::factor`]. At texel centres and
/// sampled directions this equals the decoded image. With [`Blending::Linear`] every texel and pair around a point is evaluated
/// by itself.
///
/// # Limits
/// Interpolation of display-encoded values gives darker mid-points between a dark and a bright sample than
/// interpolation in linear light, which is several times slower.
#[derive(Debug)]
pub struct FactoredMaterial {
    lookup: Lookup,
    linearizer: Linearizer,
    factors: Factors,
    blending: Blending,
    /// Whether the fast loops do not apply: to linear light, and to a BTF with its own list of pairs.
    is_special: bool,
}

#[derive(Debug)]
enum Factors {
    /// Rearranged, in stored precision.
    Table(Numbers, Table),
    /// Shared with the decoder.
    Compact(Arc<Compact>),
}

/// Texel-centre queries prefetched together.
const BATCH: usize = PLACES;

/// Queries between texels prefetched together: their data must fit the first-level cache.
const FETCHED: usize = 8;

impl FactoredMaterial {
    /// Prepares the evaluation.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the scheme of the interpolation; [`crate::Error::Io`] if
    /// memory runs out.
    pub fn new(btf: &FactoredBtf, Interpolation { scheme, blending }: Interpolation) -> Result<Self> {
        let meta = btf.meta();
        let factors = match btf.compact() {
            Some(factors) => Factors::Compact(factors),
            None => {
                let factors: Vec<ViewFactors> = (0..meta.views.len()).map(|view| btf.factors(view)).collect();
                let blocks = &factors[..if btf.per_view() { factors.len() } else { 1 }];
                Factors::Table(
                    Numbers::new(blocks, meta.texels(), btf.components())?,
                    Table::new(&factors, meta, btf.components(), btf.per_view())?,
                )
            }
        };
        let lookup = Lookup::new(meta, scheme)?;
        Ok(Self {
            is_special: lookup.angles.is_listed() || blending == Blending::Linear,
            linearizer: Linearizer::new(btf.domain(), meta.encoding),
            lookup,
            factors,
            blending,
        })
    }

    /// Apparent values at the centres of at most [`BATCH`] texels, from sums over the whole batch.
    fn texel_values(
        &self,
        views: &[&Stencil],
        lights: &[LightStencil; BATCH],
        texels: &[usize; BATCH],
        values: &mut [Vec3],
    ) {
        let mut sums = [[0.0; 3]; BATCH];
        let mut stencils = [AngularStencil::new(&Stencil::NONE, &LightStencil::NONE); BATCH];
        for ((stencil, view), light) in stencils.iter_mut().zip(views).zip(lights) {
            *stencil = AngularStencil::new(view, light);
        }
        let count = views.len();
        let (stencils, sums) = (&stencils[..count], &mut sums[..count]);
        self.texel_sums(stencils, &texels[..count], sums);
        for ((sum, stencil), value) in sums.iter().zip(stencils).zip(values) {
            *value = self.apparent_of(*sum, stencil);
        }
    }

    /// Apparent values between at most [`BATCH`] texels.
    fn blended_values(&self, points: &[&TexelPoint], places: &Places, wi: &[Vec3], values: &mut [Vec3]) {
        let (mut lights, mut footprints) = ([LightStencil::NONE; FETCHED], [Footprint::NONE; FETCHED]);
        for (first, values) in (0..).step_by(FETCHED).zip(values.chunks_mut(FETCHED)) {
            let (points, wi) = (&points[first..first + values.len()], &wi[first..first + values.len()]);
            for (k, ((light, footprint), (point, wi))) in
                lights.iter_mut().zip(&mut footprints).zip(points.iter().zip(wi)).enumerate()
            {
                *footprint = places.footprint(first + k);
                self.lookup.angles.find_lights(*wi, light);
                self.prefetch(&footprint.texel, &point.view);
                if let Factors::Compact(factors) = &self.factors {
                    factors.prefetch_pairs(&AngularStencil::new(&point.view, light), self.lookup.meta.lights.len());
                }
            }
            for (((footprint, light), point), value) in footprints.iter().zip(&lights).zip(points).zip(values) {
                *value = self.blended(&AngularStencil::new(&point.view, light), footprint);
            }
        }
    }

    #[inline(always)]
    fn prefetch_texel(&self, texel: usize, views: &Stencil) {
        // prefetch held factors one query at a time: those of a whole batch exceed the first-level cache
        let Factors::Table(values, table) = &self.factors else { return };
        // the table of pairs is small and stays in the second-level cache, so prefetch coefficients only
        for &view in &views.index[..(views.count as usize).min(4)] {
            let place = table.coefficients(texel, view as usize);
            match values {
                Numbers::F32(values) => prefetch(values, place),
                Numbers::F16(values) => prefetch(values, place),
                Numbers::U8(values) => prefetch(values, place),
            }
        }
    }

    /// The apparent value where the fast loops do not apply.
    #[cold]
    fn special_value(&self, point: &TexelPoint, wi: Vec3) -> Vec3 {
        let mut light = LightStencil::NONE;
        let Some(stencil) = self.lookup.angles.lit(&point.view, wi, point.wo, &mut light) else { return Vec3::ZERO };
        let footprint = self.lookup.footprint(point);
        match self.blending {
            Blending::Linear => stencil.averaged(&footprint, |pair, texel| {
                let mut sum = [[0.0; 3]];
                self.texel_sums(from_ref(pair), &texel.texel[..1], &mut sum);
                self.apparent_of(sum[0], pair)
            }),
            _ => self.blended(&stencil, &footprint),
        }
    }

    /// Prefetches the coefficients of texels.
    #[inline]
    fn prefetch(&self, texels: &[usize], view: &Stencil) {
        for &texel in texels {
            match &self.factors {
                Factors::Table(..) => self.prefetch_texel(texel, view),
                Factors::Compact(factors) => factors.prefetch_texel(texel),
            }
        }
    }

    /// The apparent value between texels.
    #[inline]
    fn blended(&self, stencil: &AngularStencil, &Footprint { texel, weight }: &Footprint) -> Vec3 {
        let rgb = match &self.factors {
            Factors::Table(Numbers::F32(values), table) => table.sum(values, stencil, texel, weight),
            Factors::Table(Numbers::F16(values), table) => table.sum(values, stencil, texel, weight),
            Factors::Table(Numbers::U8(values), table) => table.sum(values, stencil, texel, weight),
            Factors::Compact(factors) => factors.sum(stencil, self.lookup.meta.lights.len(), texel, weight),
        };
        self.apparent_of(rgb, stencil)
    }

    /// The sums of one texel for each stencil.
    #[inline]
    fn texel_sums(&self, stencils: &[AngularStencil], texels: &[usize], sums: &mut [[f32; 3]]) {
        match &self.factors {
            Factors::Table(Numbers::F32(numbers), table) => table.sums(numbers, stencils, texels, sums),
            Factors::Table(Numbers::F16(numbers), table) => table.sums(numbers, stencils, texels, sums),
            Factors::Table(Numbers::U8(numbers), table) => table.sums(numbers, stencils, texels, sums),
            Factors::Compact(factors) => factors.sums(stencils, self.lookup.meta.lights.len(), texels, sums),
        }
    }

    #[inline(always)]
    fn apparent_of(&self, [r, g, b]: [f32; 3], stencil: &AngularStencil) -> Vec3 {
        let linear = |v| self.linearizer.linear(v);
        Vec3::new(linear(r), linear(g), linear(b)) * stencil.factor
    }
}

wide! {
    /// Looks up views and lights, and prefetches the coefficients.
    fn locate_once(
        material: &FactoredMaterial,
        points: &[Point],
        texels: &[usize],
        wi: &[Vec3],
        views: &mut [Stencil],
        lights: &mut [LightStencil],
    ) {
        let angles = &material.lookup.angles;
        for ((((point, &texel), wi), view), light) in points.iter().zip(texels).zip(wi).zip(views).zip(lights) {
            if point.wo.z > 0.0 {
                angles.find_views(point.wo, view);
            } else {
                *view = Stencil::NONE;
            }
            material.prefetch_texel(texel, view);
            angles.find_lights(*wi, light);
        }
    }
}

wide! {
    /// Looks up the lights and prefetches the coefficients.
    fn locate(
        material: &FactoredMaterial,
        points: &[&TexelPoint],
        texels: &[usize],
        wi: &[Vec3],
        lights: &mut [LightStencil],
    ) {
        for (((point, &texel), wi), light) in points.iter().zip(texels).zip(wi).zip(lights) {
            material.prefetch_texel(texel, &point.view);
            material.lookup.angles.find_lights(*wi, light);
        }
    }
}

wide! {
    fn places(lookup: &Lookup, points: &[&TexelPoint]) -> Places {
        lookup.places(points.iter().map(|point| point.uv))
    }
}

wide! {
    /// Numbers of the texels at whose centres the points are; false if one is elsewhere.
    fn centres(lookup: &Lookup, points: &[Point], texels: &mut [usize; BATCH]) -> bool {
        let places = lookup.places(points.iter().map(|point| point.uv));
        for (k, texel) in texels.iter_mut().enumerate() {
            *texel = places.texel(k);
        }
        places.are_centres(points.len())
    }
}

impl TexelMaterial for FactoredMaterial {
    fn lookup(&self) -> &Lookup {
        &self.lookup
    }

    fn value(&self, point: &TexelPoint, wi: Vec3) -> Vec3 {
        if self.is_special {
            return self.special_value(point, wi);
        }
        // Prefetch the coefficients, then look up the lights
        let footprint = self.lookup.footprint(point);
        let is_texel = footprint.is_texel();
        self.prefetch(&footprint.texel[..if is_texel { 1 } else { 4 }], &point.view);
        let mut light = LightStencil::NONE;
        self.lookup.angles.find_lights(wi, &mut light);
        let stencil = AngularStencil::new(&point.view, &light);
        if is_texel {
            let mut sum = [[0.0; 3]];
            self.texel_sums(from_ref(&stencil), &footprint.texel[..1], &mut sum);
            return self.apparent_of(sum[0], &stencil);
        }
        self.blended(&stencil, &footprint)
    }

    fn values(&self, points: &[&TexelPoint], wi: &[Vec3], values: &mut [Vec3]) {
        if self.is_special {
            let each = values.iter_mut().zip(points).zip(wi);
            return each.for_each(|((value, point), &wi)| *value = self.special_value(point, wi));
        }
        let (mut views, mut lights) = ([&Stencil::NONE; BATCH], [LightStencil::NONE; BATCH]);
        for ((points, wi), values) in points.chunks(BATCH).zip(wi.chunks(BATCH)).zip(values.chunks_mut(BATCH)) {
            let places = places(&self.lookup, points);
            if !places.are_centres(points.len()) {
                self.blended_values(points, &places, wi, values);
                continue;
            }
            let texels = std::array::from_fn(|k| places.texel(k));
            locate(self, points, &texels, wi, &mut lights);
            views.iter_mut().zip(points).for_each(|(view, point)| *view = &point.view);
            self.texel_values(&views[..points.len()], &lights, &texels, values);
        }
    }

    fn values_once(&self, points: &[Point], wi: &[Vec3], values: &mut [Vec3]) {
        let (mut views, mut lights) = ([Stencil::NONE; BATCH], [LightStencil::NONE; BATCH]);
        let (mut texels, mut found) = ([0; BATCH], [TexelPoint::NONE; BATCH]);
        for ((points, wi), values) in points.chunks(BATCH).zip(wi.chunks(BATCH)).zip(values.chunks_mut(BATCH)) {
            if !self.is_special && centres(&self.lookup, points, &mut texels) {
                // look up views while the coefficients of others are fetched
                locate_once(self, points, &texels, wi, &mut views, &mut lights);
                self.texel_values(&views.each_ref()[..points.len()], &lights, &texels, values);
            } else {
                self.lookup.find_all(points, &mut found);
                self.values(&found.each_ref()[..points.len()], wi, values);
            }
        }
    }
}
