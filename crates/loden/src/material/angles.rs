//! The sampled directions and the texels around a point of a material, with their weights.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};

use super::pairs::Pairs;
use crate::Result;
use crate::btf::{BtfMeta, Cosine};
use crate::direction::{Interpolator, Scheme, Stencil};

/// Interpolation over the view and light directions of a BTF.
#[derive(Debug, Clone)]
pub struct Angles {
    views: Arc<Interpolator>,
    /// The same as `views` for equal directions, so that the cache holds one table.
    lights: Arc<Interpolator>,
    /// The pairs of a BTF with its own list of them; its views and lights are not interpolated each for itself.
    pairs: Option<Arc<Pairs>>,
    cosine: Cosine,
}

/// The sampled lights around a light direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightStencil {
    /// The lights; none if the direction is below the surface.
    pub lights: Stencil,
    /// Factor that converts the interpolated stored value, in linear light, to an apparent value: the light's cosine if
    /// stored values exclude it, otherwise the fade below the last measured light; 0 if there are no lights.
    pub factor: f32,
}

impl LightStencil {
    /// No lights: the apparent value is zero.
    pub const NONE: Self = Self { lights: Stencil::NONE, factor: 0.0 };
}

/// The sampled pairs around a pair of directions: weights multiply.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngularStencil<'a> {
    /// Sampled views around the view direction.
    pub view: &'a Stencil,
    /// Sampled lights around the light direction.
    pub light: &'a Stencil,
    /// [`LightStencil::factor`]; 0 if there are no views.
    pub factor: f32,
}

impl<'a> AngularStencil<'a> {
    /// Pairs of these views and lights.
    #[inline(always)]
    pub fn new(view: &'a Stencil, light: &'a LightStencil) -> Self {
        Self { view, light: &light.lights, factor: if view.count > 0 { light.factor } else { 0.0 } }
    }

    /// The mean of values that are not interpolated: `value` is asked for each sampled pair and texel around a point.
    pub(crate) fn averaged(
        &self,
        footprint: &Footprint,
        mut value: impl FnMut(&AngularStencil, &Footprint) -> Vec3,
    ) -> Vec3 {
        let mut mean = Vec3::ZERO;
        for (view, view_weight) in self.view.iter() {
            for (light, light_weight) in self.light.iter() {
                let (view, light) = (Stencil::one(view), Stencil::one(light));
                let pair = AngularStencil { view: &view, light: &light, factor: self.factor };
                for (texel, texel_weight) in footprint.texel.into_iter().zip(footprint.weight) {
                    let weight = view_weight * light_weight * texel_weight;
                    if weight > 0.0 {
                        mean += weight * value(&pair, &Footprint { texel: [texel; 4], weight: [1.0, 0.0, 0.0, 0.0] });
                    }
                }
            }
        }
        mean
    }
}

impl Angles {
    /// Prepares interpolation between the directions of `meta`.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if `scheme` is rings and a direction set has none.
    pub fn new(meta: &BtfMeta, scheme: Scheme) -> Result<Self> {
        let pairs = meta.lights.seen_from().map(|views| Arc::new(Pairs::new(&meta.lights, views)));
        let views = Arc::new(Interpolator::new(&meta.views, scheme)?);
        let lights = match meta.lights == meta.views || pairs.is_some() {
            true => views.clone(),
            false => Arc::new(Interpolator::new(&meta.lights, scheme)?),
        };
        Ok(Self { views, lights, pairs, cosine: meta.cosine })
    }

    /// Whether the BTF has its own list of pairs; then only [`Angles::lit`] finds lights, which depend on the viewer.
    #[inline(always)]
    pub(crate) fn is_listed(&self) -> bool {
        self.pairs.is_some()
    }

    /// Writes the sampled views around a view direction to `stencil`.
    #[inline(always)]
    pub(crate) fn find_views(&self, wo: Vec3, stencil: &mut Stencil) {
        self.views.find(wo, stencil);
    }

    /// The sampled views around a view direction; none if it is below the surface.
    #[inline]
    pub fn views_around(&self, wo: Vec3) -> Stencil {
        let mut stencil = Stencil::NONE;
        if wo.z > 0.0 {
            self.find_views(wo, &mut stencil);
        }
        stencil
    }

    /// The sampled lights around a light direction, from whatever view they are seen.
    #[inline]
    pub(crate) fn lights_around(&self, wi: Vec3) -> Stencil {
        self.pairs.as_ref().map_or_else(|| self.lights.stencil(wi), |pairs| pairs.lights_around(wi))
    }

    /// The pairs of the sampled views around a viewer `wo` and the lights around `wi`, which are written to `light`; `None`
    /// if there are none.
    #[inline(always)]
    pub fn lit<'a>(
        &self,
        view: &'a Stencil,
        wi: Vec3,
        wo: Vec3,
        light: &'a mut LightStencil,
    ) -> Option<AngularStencil<'a>> {
        if view.count == 0 || wi.z.is_nan() || wi.z <= 0.0 {
            return None;
        }
        match &self.pairs {
            None => self.find_lights(wi, light),
            Some(pairs) => self.find_pairs(pairs, wi, wo, light),
        }
        Some(AngularStencil::new(view, light))
    }

    #[cold]
    fn find_pairs(&self, pairs: &Pairs, wi: Vec3, wo: Vec3, light: &mut LightStencil) {
        light.lights = pairs.stencil(wi, wo);
        light.factor = match self.cosine {
            Cosine::Included => light.lights.fade,
            Cosine::Excluded => wi.z,
        };
    }

    /// Writes the sampled lights around a light direction to `light`: [`LightStencil::NONE`] below the surface. Not for a
    /// BTF with its own list of pairs.
    #[inline(always)]
    pub(crate) fn find_lights(&self, wi: Vec3, light: &mut LightStencil) {
        if wi.z.is_nan() || wi.z <= 0.0 {
            *light = LightStencil::NONE;
            return;
        }
        self.lights.find(wi, &mut light.lights);
        light.factor = match self.cosine {
            Cosine::Included => light.lights.fade,
            Cosine::Excluded => wi.z,
        };
    }
}

/// Number of places found together.
pub(crate) const PLACES: usize = 32;

/// The places of texture coordinates in an image: for each the texel whose centre is at or before it, from the top left,
/// and the fractions of the way to the next along both axes.
pub(crate) struct Places {
    /// Width and height of the image.
    size: [usize; 2],
    /// Columns and rows.
    texel: [[u32; PLACES]; 2],
    fraction: [[f32; PLACES]; 2],
}

impl Places {
    /// Of periodic coordinates, by loops that vectorise. A fraction that is NaN becomes 0.
    #[inline(always)]
    pub(crate) fn new(uv: &[[f32; PLACES]; 2], width: usize, height: usize) -> Self {
        let mut places = Self { size: [width, height], texel: [[0; PLACES]; 2], fraction: [[0.0; PLACES]; 2] };
        for (axis, uv) in uv.iter().enumerate() {
            let size = places.size[axis];
            for (k, &at) in uv.iter().enumerate() {
                // v grows upwards
                let at = if axis == 0 { at } else { 1.0 - at };
                let at = (at - at.floor()) * size as f32 - 0.5;
                let cell = at.floor();
                places.texel[axis][k] = index(cell, size as u32);
                places.fraction[axis][k] = finite(at - cell);
            }
        }
        places
    }

    /// Number of the texel, row by row from the top.
    #[inline(always)]
    pub(crate) fn texel(&self, k: usize) -> usize {
        self.texel[1][k] as usize * self.size[0] + self.texel[0][k] as usize
    }

    /// Whether all of the first places are the centres of texels, up to rounding.
    #[inline(always)]
    pub(crate) fn are_centres(&self, count: usize) -> bool {
        let [x, y] = &self.fraction;
        x[..count].iter().zip(&y[..count]).all(|(x, y)| (1.0 - x) * (1.0 - y) == 1.0)
    }

    #[inline(always)]
    pub(crate) fn footprint(&self, k: usize) -> Footprint {
        Footprint::between(self.texel.map(|t| t[k]), self.fraction.map(|f| f[k]), self.size)
    }
}

/// The texel of a rounded coordinate from -1 to `size` along an axis; rounding can give `size` itself. NaN becomes 0.
#[inline(always)]
fn index(cell: f32, size: u32) -> u32 {
    // The mantissa of a sum that has no room for a fraction, which is cheaper than a conversion
    const MAGIC: f32 = (1 << 23) as f32;
    let last = size - 1;
    let index = (cell.max(0.0) + MAGIC).to_bits() - MAGIC.to_bits();
    if cell < 0.0 { last } else { index.min(last) }
}

#[inline(always)]
fn finite(fraction: f32) -> f32 {
    if fraction.is_nan() { 0.0 } else { fraction }
}

/// The four texels around a texture coordinate and their bilinear weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Texel numbers, row by row from the top.
    pub texel: [usize; 4],
    /// Weights of sum 1.
    pub weight: [f32; 4],
}

impl Footprint {
    /// The first texel, with weight 0.
    pub(crate) const NONE: Self = Self { texel: [0; 4], weight: [0.0; 4] };

    /// Around the periodic coordinate `uv` of an image of `width` x `height` texels.
    #[inline(always)]
    pub fn new(uv: Vec2, width: usize, height: usize) -> Self {
        // Vectors of four need no library call to be rounded
        let at = Vec4::new(uv.x, 1.0 - uv.y, 0.0, 0.0);
        let at = (at - at.floor()) * Vec4::new(width as f32, height as f32, 0.0, 0.0) - 0.5;
        let cell = at.floor();
        let fraction = at - cell;
        let texel = [index(cell.x, width as u32), index(cell.y, height as u32)];
        Self::between(texel, [finite(fraction.x), finite(fraction.y)], [width, height])
    }

    #[inline(always)]
    fn between(texel: [u32; 2], [fx, fy]: [f32; 2], [width, height]: [usize; 2]) -> Self {
        let [x, y] = texel.map(|i| i as usize);
        let (x1, y1) = (if x + 1 == width { 0 } else { x + 1 }, if y + 1 == height { 0 } else { y + 1 });
        let (row, row1) = (y * width, y1 * width);
        Self {
            texel: [row + x, row + x1, row1 + x, row1 + x1],
            weight: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
        }
    }

    /// Whether the first texel has all the weight: the point is at its centre.
    #[inline]
    pub fn is_texel(&self) -> bool {
        self.weight[0] == 1.0
    }
}

/// The texture coordinate of the centre of a texel of an image.
pub fn texel_centre(texel: usize, width: usize, height: usize) -> Vec2 {
    let centre = |i: usize, size: usize| (i as f32 + 0.5) / size as f32;
    Vec2::new(centre(texel % width, width), 1.0 - centre(texel / width, height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn footprints_reproduce_a_linear_ramp(x in 0.5f32..6.5, y in 0.5f32..4.5, wrap in -3i32..3) {
            let (width, height) = (7, 5);
            let uv = Vec2::new(x / width as f32 + wrap as f32, 1.0 - y / height as f32 - wrap as f32);
            let f = Footprint::new(uv, width, height);
            let centre = |t: usize| Vec2::new((t % width) as f32 + 0.5, (t / width) as f32 + 0.5);
            let at: Vec2 = f.texel.iter().zip(f.weight).map(|(&t, w)| centre(t) * w).sum();
            prop_assert!((at - Vec2::new(x, y)).length() < 1e-4, "{:?}", f);
        }

        #[test]
        fn footprints_are_in_range_for_any_number(u in proptest::num::f32::ANY, v in proptest::num::f32::ANY) {
            for (width, height) in [(1, 1), (2, 3), (256, 200)] {
                let f = Footprint::new(Vec2::new(u, v), width, height);
                prop_assert!(f.texel.iter().all(|&t| t < width * height));
                prop_assert!((f.weight.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            }
        }

        #[test]
        fn places_together_are_those_alone(
            u in proptest::collection::vec(proptest::num::f32::ANY, PLACES),
            v in proptest::collection::vec(-3.0f32..3.0, PLACES),
        ) {
            let uv = [u, v].map(|axis| <[f32; PLACES]>::try_from(axis).unwrap());
            for (width, height) in [(1, 1), (2, 3), (256, 200)] {
                let places = Places::new(&uv, width, height);
                for (k, (&u, &v)) in uv[0].iter().zip(&uv[1]).enumerate() {
                    let alone = Footprint::new(Vec2::new(u, v), width, height);
                    prop_assert_eq!(places.footprint(k), alone);
                    prop_assert_eq!(places.texel(k), alone.texel[0]);
                }
            }
        }
    }

    #[test]
    fn the_image_wraps() {
        let f = Footprint::new(Vec2::new(0.0, 1.0), 4, 4);
        assert_eq!((f.texel, f.weight), ([15, 12, 3, 0], [0.25; 4]));
    }
}
