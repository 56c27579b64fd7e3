//! Tables over the hemisphere, and the material that is evaluated from them.

use std::f32::consts::{FRAC_PI_4, PI};

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::direction::{Frame, concentric_disk, half, mirror};
use crate::material::Material;

/// The direction that a table depends on, derived from a pair of light and view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Projection {
    /// Towards the light.
    Light,
    /// Towards the viewer.
    View,
    /// The half vector.
    Half,
    /// The light direction in the frame of the half vector; the tangent of that frame is the surface tangent,
    /// orthogonalised by Gram-Schmidt.
    Difference,
}

impl Projection {
    /// The direction for a pair of light and view. It is in the upper hemisphere if both of them are.
    pub fn of(self, wi: Vec3, wo: Vec3) -> Vec3 {
        match self {
            Self::Light => wi,
            Self::View => wo,
            Self::Half => half(wi, wo),
            Self::Difference => half_frame(half(wi, wo)).local(wi),
        }
    }
}

/// The frame with the half vector as normal and the orthogonalised surface tangent as tangent.
///
/// # References
/// kautz1999 (section 4)
fn half_frame(wh: Vec3) -> Frame {
    Frame::from_normal_tangent(wh, Vec3::X)
}

/// The cosine of 80 degrees, the largest polar angle in the tables. Beyond it many BRDFs grow without bound, which
/// would outweigh everything else, and measurements end. Directions below take the values at 80 degrees.
const MIN_COSINE: f32 = 0.173_648_18;

/// `w`, raised to 80 degrees from the normal if it is lower.
pub(super) fn raised(w: Vec3) -> Vec3 {
    if w.z >= MIN_COSINE {
        return w;
    }
    (w.truncate().normalize_or(Vec2::X) * (1.0 - MIN_COSINE * MIN_COSINE).sqrt()).extend(MIN_COSINE)
}

/// The pair of light and view for a half and a difference vector.
pub(super) fn from_half_difference(wh: Vec3, wd: Vec3) -> (Vec3, Vec3) {
    let frame = half_frame(wh);
    (raised(frame.world(wd)), raised(frame.world(mirror(wd))))
}

/// A square table over the upper hemisphere; all texels cover the same solid angle.
///
/// # References
/// shirley1997
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Texels per side.
    pub size: usize,
    /// Row by row.
    pub texels: Vec<Vec3>,
}

/// Maps the unit square to the hemisphere; the squared radius in the disk is 1 - z.
fn to_hemisphere(at: Vec2) -> Vec3 {
    let disk = concentric_disk(at);
    let r2 = disk.length_squared().min(1.0);
    (disk * (2.0 - r2).sqrt()).extend(1.0 - r2)
}

/// The inverse of [`to_hemisphere`].
fn to_square(w: Vec3) -> Vec2 {
    let r = (1.0 - w.z).clamp(0.0, 1.0).sqrt();
    let (x, y) = (w.x.abs(), w.y.abs());
    let (major, minor) = (x.max(y), x.min(y));
    let along = if major > 0.0 { r * (minor / major).atan() / FRAC_PI_4 } else { 0.0 };
    let (u, v) = if x > y { (r, along) } else { (along, r) };
    (Vec2::new(u.copysign(w.x), v.copysign(w.y)) + Vec2::ONE) * 0.5
}

impl Grid {
    /// A table with one value everywhere.
    pub fn filled(size: usize, value: Vec3) -> Self {
        Self { size, texels: vec![value; size * size] }
    }

    /// The direction at the centre of a texel.
    pub fn direction(size: usize, texel: usize) -> Vec3 {
        let centre = Vec2::new((texel % size) as f32 + 0.5, (texel / size) as f32 + 0.5) / size as f32;
        to_hemisphere(centre)
    }

    /// The four texels around a direction, with bilinear weights.
    pub(crate) fn stencil(size: usize, w: Vec3) -> [(usize, f32); 4] {
        let last = (size - 1) as f32;
        let at = (to_square(w) * size as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(last));
        let corner = at.floor().min(Vec2::splat(last - 1.0));
        let f = at - corner;
        let texel = corner.y as usize * size + corner.x as usize;
        [
            (texel, (1.0 - f.x) * (1.0 - f.y)),
            (texel + 1, f.x * (1.0 - f.y)),
            (texel + size, (1.0 - f.x) * f.y),
            (texel + size + 1, f.x * f.y),
        ]
    }

    /// The value at a direction, bilinear between texels.
    pub fn at(&self, w: Vec3) -> Vec3 {
        Self::stencil(self.size, w).iter().map(|&(texel, weight)| self.texels[texel] * weight).sum()
    }
}

/// A sum of products of two tables.
#[derive(Debug, Clone, PartialEq)]
pub struct ProductSum {
    /// The directions that the tables depend on.
    pub projections: [Projection; 2],
    /// Pairs of tables.
    pub terms: Vec<[Grid; 2]>,
}

impl ProductSum {
    pub(super) fn value(&self, wi: Vec3, wo: Vec3) -> Vec3 {
        let [x, y] = self.projections.map(|p| p.of(wi, wo));
        self.terms.iter().map(|[a, b]| a.at(x) * b.at(y)).sum()
    }
}

/// A BRDF represented by tables.
#[derive(Debug, Clone, PartialEq)]
pub enum Factored {
    /// The product of several sums of products.
    Product(Vec<ProductSum>),
    /// `scale` times (exp of the sum of the tables, minus `floor`).
    Exponential {
        /// The mean of the BRDF.
        scale: Vec3,
        /// The constant, relative to the mean, that keeps the logarithm finite.
        floor: f32,
        /// Pairs of a projection and the index of its table; a table may be used twice.
        factors: Vec<(Projection, usize)>,
        /// Logarithms of the factors.
        tables: Vec<Grid>,
    },
}

impl Factored {
    /// All tables, each of them once.
    pub fn tables(&self) -> Vec<&Grid> {
        match self {
            Self::Product(steps) => steps.iter().flat_map(|s| s.terms.iter().flatten()).collect(),
            Self::Exponential { tables, .. } => tables.iter().collect(),
        }
    }

    /// Size of the tables in bytes, as 32-bit numbers. A table of one texel is a constant.
    pub fn bytes(&self) -> usize {
        self.tables().iter().map(|grid| grid.texels.len() * 12).sum()
    }

    /// Size of a full table of all pairs at the same resolution, divided by [`Factored::bytes`].
    pub fn ratio(&self) -> f64 {
        let texels = self.tables().iter().map(|grid| grid.texels.len()).max().unwrap_or(0);
        (texels * texels * 12) as f64 / self.bytes().max(1) as f64
    }
}

impl Material for Factored {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.eval(uv, wi, wo) * (PI * wi.z)
    }

    fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        // also rejects NaN
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return Vec3::ZERO;
        }
        let (wi, wo) = (raised(wi), raised(wo));
        let value = match self {
            Self::Product(steps) => steps.iter().map(|step| step.value(wi, wo)).product(),
            Self::Exponential { scale, floor, factors, tables } => {
                let sum: Vec3 = factors.iter().map(|&(p, k)| tables[k].at(p.of(wi, wo))).sum();
                *scale * (sum.exp() - *floor)
            }
        };
        value.max(Vec3::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::from_angles;
    use proptest::prelude::*;
    use std::f32::consts::TAU;

    proptest! {
        #[test]
        fn the_square_covers_the_hemisphere(theta in 0.0f32..1.57, phi in 0.0f32..TAU) {
            let w = from_angles(theta, phi);
            prop_assert!((to_hemisphere(to_square(w)) - w).length() < 2e-3, "{} {}", w, to_hemisphere(to_square(w)));
        }

        #[test]
        fn a_smooth_function_is_interpolated(theta in 0.0f32..1.5, phi in 0.0f32..TAU) {
            let f = |w: Vec3| Vec3::new(w.z, w.x + 0.5, w.x * w.y);
            let size = 32;
            let texels = (0..size * size).map(|i| f(Grid::direction(size, i))).collect();
            let (grid, w) = (Grid { size, texels }, from_angles(theta, phi));
            prop_assert!((grid.at(w) - f(w)).abs().max_element() < 0.06, "{} {}", grid.at(w), f(w));
        }

        #[test]
        fn half_and_difference_give_the_pair_back(a in 0.0f32..1.39, b in 0.0f32..1.39, p in 0.0f32..TAU, q in 0.0f32..TAU) {
            let (wi, wo) = (from_angles(a, p), from_angles(b, q));
            let (h, d) = (Projection::Half.of(wi, wo), Projection::Difference.of(wi, wo));
            let (i, o) = from_half_difference(h, d);
            prop_assert!((i - wi).length() < 1e-3 && (o - wo).length() < 1e-3);
            prop_assert!(d.z >= 0.0);
        }
    }

    #[test]
    fn texels_have_equal_area() {
        let side = 200;
        let point = |i: usize| Vec2::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5) / side as f32;
        let mean = (0..side * side).map(|i| f64::from(to_hemisphere(point(i)).z)).sum::<f64>() / (side * side) as f64;
        // the mean height of a hemisphere is one half
        assert!((mean - 0.5).abs() < 2e-3, "{mean}");
    }
}
