//! Materials that are interpolated between texels and sampled directions.

use glam::{Vec2, Vec3};

use super::angles::{Angles, Footprint, PLACES, Places, texel_centre};
use super::lobes::{BtfSampler, Lobes};
use super::{Bounce, Failure, Material, Point, Prepared, Sample};
use crate::Result;
use crate::btf::BtfMeta;
use crate::color::luminance;
use crate::direction::{Scheme, Stencil};
use crate::simd::wide;

/// A [`Point`] with the sampled views around it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TexelPoint {
    pub uv: Vec2,
    pub wo: Vec3,
    /// The sampled views around the viewer; none if it is below the surface.
    pub view: Stencil,
}

impl TexelPoint {
    pub(crate) const NONE: Self = Self { uv: Vec2::ZERO, wo: Vec3::ZERO, view: Stencil::NONE };
}

/// Shared state of all materials of texels: their directions, the sampler, and the first failure.
#[derive(Debug)]
pub(crate) struct Lookup {
    pub meta: BtfMeta,
    pub angles: Angles,
    pub sampler: BtfSampler,
    pub failure: Failure,
}

impl Lookup {
    /// # Errors
    /// [`crate::Error::Parameter`] if the directions do not allow the interpolation `scheme`.
    pub(crate) fn new(meta: &BtfMeta, scheme: Scheme) -> Result<Self> {
        let (sampler, failure) = (BtfSampler::default(), Failure::default());
        Ok(Self { meta: meta.clone(), angles: Angles::new(meta, scheme)?, sampler, failure })
    }

    /// Finds what is around a point. Overwrites `found`: moving the result would cost as much as finding it.
    #[inline(always)]
    fn find(&self, &Point { uv, wo }: &Point, found: &mut TexelPoint) {
        (found.uv, found.wo) = (uv, wo);
        if wo.z > 0.0 {
            self.angles.find_views(wo, &mut found.view);
        } else {
            found.view = Stencil::NONE;
        }
    }

    /// Finds what is around as many points as `found` has room for.
    pub(crate) fn find_all(&self, points: &[Point], found: &mut [TexelPoint]) {
        find_all(self, points, found);
    }

    fn found(&self, uv: Vec2, wo: Vec3) -> TexelPoint {
        let mut found = TexelPoint::NONE;
        self.find(&Point { uv, wo }, &mut found);
        found
    }

    /// The texels around a point and their weights.
    #[inline(always)]
    pub(crate) fn footprint(&self, point: &TexelPoint) -> Footprint {
        Footprint::new(point.uv, self.meta.width, self.meta.height)
    }

    /// The places of at most [`PLACES`] texture coordinates.
    #[inline(always)]
    pub(crate) fn places(&self, coordinates: impl Iterator<Item = Vec2>) -> Places {
        let mut uv = [[0.0; PLACES]; 2];
        for (k, at) in coordinates.enumerate() {
            (uv[0][k], uv[1][k]) = (at.x, at.y);
        }
        Places::new(&uv, self.meta.width, self.meta.height)
    }
}

wide! {
    fn find_all(lookup: &Lookup, points: &[Point], found: &mut [TexelPoint]) {
        for (point, found) in points.iter().zip(found) {
            lookup.find(point, found);
        }
    }
}

/// A material of texels. [`Material`] is implemented from this.
pub(crate) trait TexelMaterial: Send + Sync {
    fn lookup(&self) -> &Lookup;

    /// The apparent value.
    fn value(&self, point: &TexelPoint, wi: Vec3) -> Vec3;

    /// The apparent values for equally many points and directions.
    fn values(&self, points: &[&TexelPoint], wi: &[Vec3], values: &mut [Vec3]) {
        for ((value, point), wi) in values.iter_mut().zip(points).zip(wi) {
            *value = self.value(point, *wi);
        }
    }

    /// [`Material::apparent_many`].
    fn values_once(&self, points: &[Point], wi: &[Vec3], values: &mut [Vec3]) {
        let mut found = [TexelPoint::NONE; GATHERED];
        for ((points, wi), values) in points.chunks(GATHERED).zip(wi.chunks(GATHERED)).zip(values.chunks_mut(GATHERED))
        {
            self.lookup().find_all(points, &mut found);
            self.values(&found.each_ref()[..points.len()], wi, values);
        }
    }

    /// Fails if a value could not be evaluated, apart from what [`Lookup::failure`] keeps.
    fn check_values(&self) -> Result<()> {
        Ok(())
    }

    /// Luminances of apparent values at sampled pairs, (light, texel), without interpolation between texels.
    fn luminances(&self, view: usize, lights: &[usize], texels: &[usize]) -> Result<Vec<f32>> {
        let Lookup { meta, angles, failure, .. } = self.lookup();
        let points_seen_from = |wo: Vec3| -> Vec<TexelPoint> {
            let mut view = Stencil::NONE;
            angles.find_views(wo, &mut view);
            let uv = |texel: usize| texel_centre(texel, meta.width, meta.height);
            texels.iter().map(|&texel| TexelPoint { uv: uv(texel), wo, view }).collect()
        };
        let mut points: Vec<TexelPoint> = Vec::new();
        let mut values = vec![Vec3::ZERO; texels.len()];
        let mut found = Vec::with_capacity(lights.len() * texels.len());
        for &light in lights {
            let (wi, wo) = meta.pair(view, light);
            if points.first().is_none_or(|point| point.wo != wo) {
                points = points_seen_from(wo);
            }
            self.values(&points.iter().collect::<Vec<_>>(), &vec![wi; texels.len()], &mut values);
            found.extend(values.iter().map(|value| luminance(value.to_array())));
        }
        failure.check()?;
        self.check_values()?;
        Ok(found)
    }

    /// The histograms for sampling directions, built by the first call; `None` after a failure.
    fn lobes(&self) -> Option<&Lobes> {
        let values = |view: usize, lights: &[usize], texels: &[usize]| self.luminances(view, lights, texels);
        let Lookup { meta, angles, sampler, failure } = self.lookup();
        sampler.lobes(failure, || Lobes::new(meta, angles, &values))
    }
}

impl<M: TexelMaterial> Material for M {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return Vec3::ZERO;
        }
        let mut point = TexelPoint::NONE;
        self.lookup().find(&Point { uv, wo }, &mut point);
        self.value(&point, wi)
    }

    fn texels(&self) -> Option<[usize; 2]> {
        let Lookup { meta, .. } = self.lookup();
        Some([meta.width, meta.height])
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        let mut bounce = [Bounce::NONE];
        self.lobes()?.sample_many(&[&self.lookup().found(uv, wo)], &[random], &mut bounce);
        let [Bounce { wi, pdf, .. }] = bounce;
        (pdf > 0.0).then_some(Sample { wi, pdf })
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.lobes().map_or(0.0, |lobes| lobes.pdf(&self.lookup().found(uv, wo), wi))
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        let mut found = vec![TexelPoint::NONE; points.len()];
        self.lookup().find_all(points, &mut found);
        Box::new(TexelPoints { material: self, points: found })
    }

    fn apparent_many(&self, points: &[Point], wi: &[Vec3], values: &mut [Vec3]) {
        self.values_once(points, wi, values);
    }

    fn check(&self) -> Result<()> {
        self.lookup().failure.check()?;
        self.check_values()
    }
}

/// Prepared points.
struct TexelPoints<'a, M: TexelMaterial> {
    material: &'a M,
    points: Vec<TexelPoint>,
}

/// Number of points gathered at a time.
const GATHERED: usize = 32;

impl<M: TexelMaterial> TexelPoints<'_, M> {
    /// Calls `f` with groups of at most [`GATHERED`] points and the index of their first point.
    #[inline]
    fn gather(&self, index: &[u32], mut f: impl FnMut(usize, &[&TexelPoint])) {
        let Some(&first) = index.first() else { return };
        let mut points = [&self.points[first as usize]; GATHERED];
        for (part, index) in index.chunks(GATHERED).enumerate() {
            points.iter_mut().zip(index).for_each(|(point, &index)| *point = &self.points[index as usize]);
            f(part * GATHERED, &points[..index.len()]);
        }
    }
}

impl<M: TexelMaterial> Prepared for TexelPoints<'_, M> {
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        self.gather(index, |first, points| {
            let range = first..first + points.len();
            self.material.values(points, &wi[range.clone()], &mut values[range]);
        });
    }

    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        let Some(lobes) = self.material.lobes() else { return bounces.fill(Bounce::NONE) };
        let (mut wi, mut values) = ([Vec3::ZERO; GATHERED], [Vec3::ZERO; GATHERED]);
        self.gather(index, |first, points| {
            let count = points.len();
            let bounces = &mut bounces[first..first + count];
            lobes.sample_many(points, &random[first..first + count], bounces);
            wi.iter_mut().zip(&*bounces).for_each(|(wi, bounce)| *wi = bounce.wi);
            self.material.values(points, &wi[..count], &mut values[..count]);
            bounces.iter_mut().zip(values).for_each(|(bounce, value)| bounce.value = value);
        });
    }

    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]) {
        let Some(lobes) = self.material.lobes() else { return densities.fill(0.0) };
        for ((density, &index), &wi) in densities.iter_mut().zip(index).zip(wi) {
            *density = lobes.pdf(&self.points[index as usize], wi);
        }
    }
}
