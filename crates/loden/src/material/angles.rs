//! The sampled directions and the texels around a point of a material, with their weights.

use glam::{Vec2, Vec3, Vec4};

use crate::Result;
use crate::btf::{BtfMeta, Cosine};
use crate::direction::{Interpolator, Scheme, Stencil};

/// Interpolation over the view and light directions of a BTF.
#[derive(Debug, Clone)]
pub struct Angles {
    views: Interpolator,
    lights: Interpolator,
    cosine: Cosine,
}

/// The sampled pairs around a pair of directions: weights multiply.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngularStencil {
    /// Sampled views around the view direction.
    pub view: Stencil,
    /// Sampled lights around the light direction.
    pub light: Stencil,
    /// Factor that converts the interpolated stored value, in linear light, to an apparent value: the light's cosine if
    /// stored values exclude it, otherwise the fade below the last measured light.
    pub factor: f32,
}

impl AngularStencil {
    /// No pairs: any sum over it is zero.
    pub const NONE: Self = { Self { view: Stencil::NONE, light: Stencil::NONE, factor: 0.0 } };
}

impl Angles {
    /// Prepares interpolation between the directions of `meta`.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if `scheme` is rings and a direction set has none.
    pub fn new(meta: &BtfMeta, scheme: Scheme) -> Result<Self> {
        let views = Interpolator::new(&meta.views, scheme)?;
        let lights = if meta.lights == meta.views { views.clone() } else { Interpolator::new(&meta.lights, scheme)? };
        Ok(Self { views, lights, cosine: meta.cosine })
    }

    /// Writes the sampled views around a view direction to `stencil`.
    #[inline(always)]
    pub(crate) fn find_views(&self, wo: Vec3, stencil: &mut Stencil) {
        self.views.find(wo, stencil);
    }

    /// The sampled lights around a light direction.
    #[inline]
    pub(crate) fn lights_around(&self, wi: Vec3) -> Stencil {
        self.lights.stencil(wi)
    }

    /// The pairs around (`wi`, `wo`); `None` if either is below the surface.
    #[inline]
    pub fn stencil(&self, wi: Vec3, wo: Vec3) -> Option<AngularStencil> {
        // This form of the condition also rejects NaN
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return None;
        }
        let mut stencil = AngularStencil::NONE;
        self.views.find(wo, &mut stencil.view);
        self.light(wi, &mut stencil);
        Some(stencil)
    }

    /// The pairs of the sampled views around a viewer and the lights around `wi`; `None` if there are none.
    #[inline(always)]
    pub(crate) fn lit(&self, view: &Stencil, wi: Vec3) -> Option<AngularStencil> {
        let mut stencil = AngularStencil::NONE;
        self.find_lit(view, wi, &mut stencil);
        (stencil.view.count > 0).then_some(stencil)
    }

    /// Like [`Angles::lit`], but writes to `stencil`: [`AngularStencil::NONE`] if there are no pairs.
    #[inline(always)]
    pub(crate) fn find_lit(&self, view: &Stencil, wi: Vec3, stencil: &mut AngularStencil) {
        if view.count == 0 || wi.z.is_nan() || wi.z <= 0.0 {
            *stencil = AngularStencil::NONE;
            return;
        }
        stencil.view = *view;
        self.light(wi, stencil);
    }

    #[inline(always)]
    fn light(&self, wi: Vec3, stencil: &mut AngularStencil) {
        self.lights.find(wi, &mut stencil.light);
        stencil.factor = match self.cosine {
            Cosine::Included => stencil.light.fade,
            Cosine::Excluded => wi.z,
        };
    }
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
    pub const NONE: Self = Self { texel: [0; 4], weight: [0.0; 4] };

    /// The texel of this number alone.
    #[inline]
    pub fn texel(texel: usize) -> Self {
        Self { texel: [texel; 4], weight: [1.0, 0.0, 0.0, 0.0] }
    }

    /// Whether the first texel has all the weight: the point is at its centre.
    #[inline]
    pub fn is_texel(&self) -> bool {
        self.weight[0] == 1.0
    }

    /// Around the periodic coordinate `uv` of an image of `width` x `height` texels.
    #[inline(always)]
    pub fn new(uv: Vec2, width: usize, height: usize) -> Self {
        let ([x, y], [fx, fy]) = split(uv, [width, height]);
        let (x1, y1) = (if x + 1 == width { 0 } else { x + 1 }, if y + 1 == height { 0 } else { y + 1 });
        let (row, row1) = (y * width, y1 * width);
        Self {
            texel: [row + x, row + x1, row1 + x, row1 + x1],
            weight: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
        }
    }
}

/// The texture coordinate of the centre of a texel of an image.
pub fn texel_centre(texel: usize, width: usize, height: usize) -> Vec2 {
    let centre = |i: usize, size: usize| (i as f32 + 0.5) / size as f32;
    Vec2::new(centre(texel % width, width), 1.0 - centre(texel / width, height))
}

/// The texel whose centre is at or before a periodic coordinate, from the top left, and the fractions of the way to the
/// next along both axes. NaN becomes 0.
#[inline(always)]
fn split(uv: Vec2, size: [usize; 2]) -> ([usize; 2], [f32; 2]) {
    // Vectors of four need no library call to be rounded
    let at = Vec4::new(uv.x, 1.0 - uv.y, 0.0, 0.0);
    let at = (at - at.floor()) * Vec4::new(size[0] as f32, size[1] as f32, 0.0, 0.0) - 0.5;
    let cell = at.floor();
    let fraction = at - cell;
    let index = |axis: usize| match cell[axis] {
        cell if cell < 0.0 => size[axis] - 1,
        // Rounding can give `size` itself
        cell => (cell as usize).min(size[axis] - 1),
    };
    let fraction = |axis: usize| if fraction[axis].is_nan() { 0.0 } else { fraction[axis] };
    ([index(0), index(1)], [fraction(0), fraction(1)])
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
    }

    #[test]
    fn the_image_wraps() {
        let f = Footprint::new(Vec2::new(0.0, 1.0), 4, 4);
        assert_eq!((f.texel, f.weight), ([15, 12, 3, 0], [0.25; 4]));
    }
}
