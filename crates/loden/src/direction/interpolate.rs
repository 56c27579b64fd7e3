//! Interpolation between sampled directions.

use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::rings::Rings;
use super::set::DirectionSet;
use super::triangles::{TriangleTables, Triangles};
use crate::Result;

/// The scheme of interpolation between sampled directions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scheme {
    /// Barycentric weights in a spherical Delaunay triangulation; for any list of directions.
    #[default]
    Triangles,
    /// Bilinear weights in quadrilaterals between rings of equal polar angle.
    Rings,
}

/// The sampled directions around a direction, with weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stencil {
    /// Indices into the direction set. Unused entries repeat a used one and have weight 0.
    pub index: [u32; 4],
    /// Non-negative weights that sum to 1.
    pub weight: [f32; 4],
    /// Number of entries in use.
    pub count: u32,
    /// For directions below the measured region, cos(theta) divided by the cosine at its edge; else 1.
    pub fade: f32,
}

impl Stencil {
    /// No directions: every weighted sum is zero.
    pub const NONE: Self = Self { index: [0; 4], weight: [0.0; 4], count: 0, fade: 0.0 };

    /// A sampled direction itself.
    pub fn one(index: usize) -> Self {
        Self { index: [index as u32; 4], weight: [1.0, 0.0, 0.0, 0.0], count: 1, fade: 1.0 }
    }

    /// The entries in use: (index, weight).
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        self.index.iter().zip(&self.weight).take(self.count as usize).map(|(&i, &w)| (i as usize, w))
    }
}

/// Interpolates between the directions of a set.
///
/// # Model
/// Triangles: the weights of the point where the ray along `w` pierces the plane of its spherical Delaunay triangle.
/// Rings: linear in theta between the two rings, linear in phi on each, with the azimuth wrapped. Below the last ring
/// (outside the triangulation), the value at the edge of the measured region on the same meridian is used.
/// [`Stencil::fade`] is the factor by which the cosine is smaller there than at the edge, where it is interpolated: an
/// apparent value, which contains the cosine of the light, is multiplied by the fade of the light, so it reaches zero
/// at the horizon; along the view it stays constant. If the set does not surround the normal, the nearest point of its
/// edge is used.
///
/// # Limits
/// With fewer than three directions, or directions on one great circle, the nearest one is used.
#[derive(Debug, Clone)]
pub struct Interpolator(Kind);

#[derive(Debug, Clone)]
enum Kind {
    // shared by clones, since two copies of the tables would not fit the first-level cache together
    Triangles(Arc<Triangles>),
    Rings(Rings),
}

impl Interpolator {
    /// Prepares interpolation in `set`.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] for [`Scheme::Rings`] if the directions do not lie on rings.
    pub fn new(set: &DirectionSet, scheme: Scheme) -> Result<Self> {
        Ok(Self(match scheme {
            Scheme::Triangles => Kind::Triangles(Arc::new(Triangles::new(set.directions()))),
            Scheme::Rings => Kind::Rings(Rings::new(set)?),
        }))
    }

    /// The triangulation as tables; `None` for rings, and if the samples do not surround the normal.
    pub(crate) fn tables(&self) -> Option<TriangleTables> {
        match &self.0 {
            Kind::Triangles(triangles) => triangles.tables(),
            Kind::Rings(_) => None,
        }
    }

    /// The sampled directions around the unit vector `w` of the upper hemisphere, with weights.
    // called a hundred million times per picture: when inlined, the result stays in registers
    #[inline(always)]
    pub fn stencil(&self, w: Vec3) -> Stencil {
        let mut stencil = Stencil::NONE;
        self.find(w, &mut stencil);
        stencil
    }

    /// As [`Interpolator::stencil`], written in place: moving the result would cost as much as finding it.
    #[inline(always)]
    pub(crate) fn find(&self, w: Vec3, stencil: &mut Stencil) {
        match &self.0 {
            Kind::Triangles(triangles) => triangles.find(w, stencil),
            Kind::Rings(rings) => *stencil = rings.stencil(w),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::from_angles;
    use proptest::prelude::*;
    use std::f32::consts::{FRAC_PI_2, TAU};

    fn interpolators() -> Vec<(DirectionSet, Interpolator)> {
        let mut all = Vec::new();
        for set in [DirectionSet::bonn81(), DirectionSet::ubo2014()] {
            for scheme in [Scheme::Triangles, Scheme::Rings] {
                all.push((set.clone(), Interpolator::new(&set, scheme).unwrap()));
            }
        }
        all
    }

    fn interpolate(set: &DirectionSet, stencil: &Stencil, f: impl Fn(Vec3) -> f32) -> f32 {
        stencil.iter().map(|(i, w)| w * f(set.directions()[i])).sum()
    }

    #[test]
    fn samples_are_reproduced() {
        for (set, interpolator) in interpolators() {
            for (i, &w) in set.directions().iter().enumerate() {
                let stencil = interpolator.stencil(w);
                let weight: f32 = stencil.iter().filter(|s| s.0 == i).map(|s| s.1).sum();
                assert!((weight - 1.0).abs() < 1e-4, "{i}: {stencil:?}");
                assert!((stencil.fade - 1.0).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn any_small_or_degenerate_set_still_interpolates() {
        let lists: [&[[f64; 2]]; 4] = [
            &[[20.0, 10.0]],
            &[[0.0, 0.0], [45.0, 90.0]],
            &[[0.0, 0.0], [30.0, 0.0], [60.0, 0.0], [30.0, 180.0]],
            &[[10.0, 0.0], [40.0, 10.0], [40.0, 60.0]],
        ];
        for list in lists {
            let set = DirectionSet::from_degrees(list.to_vec()).unwrap();
            let interpolator = Interpolator::new(&set, Scheme::Triangles).unwrap();
            for k in 0..100 {
                let s = interpolator.stencil(from_angles(k as f32 * 0.0157, k as f32 * 0.7));
                assert!((s.weight.iter().sum::<f32>() - 1.0).abs() < 1e-4, "{list:?} {s:?}");
                assert!(s.weight.iter().all(|w| *w >= 0.0) && (0.0..=1.0).contains(&s.fade));
            }
        }
    }

    #[test]
    fn rings_refuse_a_set_without_rings() {
        let set = DirectionSet::from_degrees(vec![[10.0, 0.0], [20.0, 30.0], [30.0, 77.0]]).unwrap();
        let error = Interpolator::new(&set, Scheme::Rings).unwrap_err().to_string();
        assert!(error.contains("ring"), "{error}");
    }

    #[test]
    fn constants_stay_constant_down_to_the_lowest_ring() {
        for steps in [3, 6, 24] {
            let ring = |theta: f64| (0..steps).map(move |k| [theta, f64::from(k) * 360.0 / f64::from(steps)]);
            let degrees = [[0.0, 0.0]].into_iter().chain(ring(37.5)).chain(ring(75.0)).collect();
            let set = DirectionSet::from_degrees(degrees).unwrap();
            for scheme in [Scheme::Triangles, Scheme::Rings] {
                let interpolator = Interpolator::new(&set, scheme).unwrap();
                for (theta, phi) in (0..15).flat_map(|t| (0..72).map(move |p| (5.0 * t as f32, 5.0 * p as f32))) {
                    let stencil = interpolator.stencil(from_angles(theta.to_radians(), phi.to_radians()));
                    assert!(stencil.fade > 0.9999, "{steps} {scheme:?} {theta} {phi}: {stencil:?}");
                }
                let below = interpolator.stencil(from_angles(80f32.to_radians(), 0.4));
                let expected = 80f32.to_radians().cos() / 75f32.to_radians().cos();
                assert!((below.fade - expected).abs() < 1e-4);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn weights_are_convex_and_nearby(theta in 0.0f32..FRAC_PI_2, phi in 0.0f32..TAU) {
            let w = from_angles(theta, phi);
            for (set, interpolator) in interpolators_cached() {
                let s = interpolator.stencil(w);
                prop_assert!((s.weight.iter().sum::<f32>() - 1.0).abs() < 1e-4);
                prop_assert!(s.weight.iter().all(|w| (0.0..=1.0001).contains(w)), "{:?}", s);
                prop_assert!(s.iter().all(|(i, _)| set.directions()[i].dot(w) > 0.75), "{:?}", s);
                // a smooth function is interpolated closely inside the measured region
                let f = |d: Vec3| d.x + 0.5 * d.y * d.y;
                if theta < 1.3 {
                    prop_assert!((interpolate(set, &s, f) - f(w)).abs() < 0.08);
                }
                // the cosine of the light vanishes at the horizon and is continuous
                let cosine = s.fade * interpolate(set, &s, |d| d.z);
                prop_assert!((cosine - w.z).abs() < 0.04, "{} {}", cosine, w.z);
            }
        }

        #[test]
        fn weights_are_continuous(theta in 0.0f32..1.55, phi in 0.0f32..TAU, dt in -1e-4f32..1e-4, dp in -1e-4f32..1e-4) {
            let (a, b) = (from_angles(theta, phi), from_angles((theta + dt).max(0.0), phi + dp));
            for (set, interpolator) in interpolators_cached() {
                let g = |s: &Stencil| s.fade * interpolate(set, s, |d| (9.0 * d.x).sin() + (7.0 * d.y).cos());
                let (x, y) = (g(&interpolator.stencil(a)), g(&interpolator.stencil(b)));
                prop_assert!((x - y).abs() < 0.02, "{} {}", x, y);
            }
        }
    }

    fn interpolators_cached() -> &'static [(DirectionSet, Interpolator)] {
        static CACHE: std::sync::OnceLock<Vec<(DirectionSet, Interpolator)>> = std::sync::OnceLock::new();
        CACHE.get_or_init(interpolators)
    }
}
