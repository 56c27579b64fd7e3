//! Interpolation between measured pairs of directions, for BTFs that have their own list of pairs.

use glam::Vec3;

use super::{DirectionSet, Stencil, half};
use crate::simd::wide;

/// Pairs compared at a time.
const LANES: usize = 16;
/// Coordinates of a pair.
const AXES: usize = 6;
/// Pairs of a stencil.
const NEAREST: usize = 4;
/// The most that a value is raised because its light is lower.
const MOST_RAISED: f32 = 4.0;

/// Measured pairs of light and view.
///
/// # Model
/// A pair is a point: the projections of light, view and half vector to the surface. The four nearest measured pairs have the
/// weights ((R - d) / (R d))^2, where R is the distance of the fifth (modified Shepard): continuous, and exact at
/// measured pairs. [`Stencil::fade`] is the light's cosine over the mean of those of the four, so that what is
/// interpolated of apparent values is their ratio to the light's cosine.
///
/// # Limits
/// Every evaluation looks at all pairs.
///
/// # References
/// shepard1968
#[derive(Debug, Clone)]
pub struct Pairs {
    /// (block, axis, pair of the block)
    places: Vec<[f32; LANES]>,
    /// Cosine of each light.
    cosines: Vec<f32>,
}

impl Pairs {
    /// The pairs of `lights` and the views that these are seen from.
    pub fn new(lights: &DirectionSet, views: &DirectionSet) -> Self {
        let (lights, views) = (lights.directions(), views.directions());
        let blocks = lights.len().div_ceil(LANES);
        // unused places are far from everything
        let mut places = vec![[FAR; LANES]; blocks * AXES];
        for (i, (wi, wo)) in lights.iter().zip(views).enumerate() {
            for (axis, value) in place(*wi, *wo).into_iter().enumerate() {
                places[i / LANES * AXES + axis][i % LANES] = value;
            }
        }
        Self { places, cosines: lights.iter().map(|wi| wi.z).collect() }
    }

    /// The lights around a direction, from whatever view they are seen, with equal weights.
    pub fn lights_around(&self, wi: Vec3) -> Stencil {
        let distance = |i: u32| {
            let axis = |axis: usize| self.places[i as usize / LANES * AXES + axis][i as usize % LANES];
            (axis(0) - wi.x).powi(2) + (axis(1) - wi.y).powi(2)
        };
        let mut order: Vec<u32> = (0..self.cosines.len() as u32).collect();
        order.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        let count = order.len().min(NEAREST);
        let weight = std::array::from_fn(|k| if k < count { 1.0 / count as f32 } else { 0.0 });
        Stencil { index: std::array::from_fn(|k| order[k % count]), weight, count: count as u32, fade: 1.0 }
    }

    /// The measured pairs around a pair, with weights.
    pub fn stencil(&self, wi: Vec3, wo: Vec3) -> Stencil {
        let mut nearest = [(f32::INFINITY, 0); NEAREST + 1];
        search(&self.places, &place(wi, wo), &mut nearest);
        let count = self.cosines.len().min(NEAREST);
        let radius = nearest[NEAREST].0.sqrt();
        let mut weight = [0.0; NEAREST];
        for (weight, (square, _)) in weight.iter_mut().zip(&nearest[..count]) {
            let distance = square.sqrt().max(1e-6);
            // with fewer pairs no distance is known at which the last weight should vanish
            let fade = if radius.is_finite() { (radius - distance).max(1e-6) / radius.max(1e-6) } else { 1.0 };
            *weight = (fade / distance).powi(2);
        }
        let sum: f32 = weight.iter().sum();
        weight.iter_mut().for_each(|w| *w /= sum);
        let index = std::array::from_fn(|k| nearest[if k < count { k } else { 0 }].1);
        let cosine: f32 = (0..count).map(|k| weight[k] * self.cosines[index[k] as usize]).sum();
        let fade = (wi.z.max(0.0) / cosine.max(1e-6)).min(MOST_RAISED);
        Stencil { index, weight, count: count as u32, fade }
    }
}

/// A coordinate of no pair.
const FAR: f32 = 1e9;

fn place(wi: Vec3, wo: Vec3) -> [f32; AXES] {
    let h = half(wi, wo);
    [wi.x, wi.y, wo.x, wo.y, h.x, h.y]
}

wide! {
    /// Finds the nearest places: the squares of their distances and their numbers, nearest first.
    fn search(places: &[[f32; LANES]], at: &[f32; AXES], nearest: &mut [(f32, u32); NEAREST + 1]) {
        for (block, axes) in places.chunks_exact(AXES).enumerate() {
            let mut square = [0.0f32; LANES];
            for (axis, at) in axes.iter().zip(at) {
                for i in 0..LANES {
                    square[i] += (axis[i] - at) * (axis[i] - at);
                }
            }
            for (i, &square) in square.iter().enumerate() {
                if square < nearest[NEAREST].0 && square < FAR {
                    let at = nearest.partition_point(|known| known.0 <= square);
                    nearest[at..].rotate_right(1);
                    nearest[at] = (square, (block * LANES + i) as u32);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::from_angles;
    use proptest::prelude::*;

    fn pairs(degrees: &[[f64; 4]]) -> (DirectionSet, Pairs) {
        let set = DirectionSet::of_pairs(degrees).unwrap();
        let pairs = Pairs::new(&set, set.seen_from().unwrap());
        (set, pairs)
    }

    fn scattered(count: usize) -> Vec<[f64; 4]> {
        let angle = |i: usize, step: f64, most: f64| (i as f64 * step).fract() * most;
        let pair = |i| [angle(i, 0.618, 80.0), angle(i, 0.755, 360.0), angle(i, 0.57, 75.0), angle(i, 0.349, 360.0)];
        (1..=count).map(pair).collect()
    }

    #[test]
    fn measured_pairs_are_reproduced() {
        for count in [1, 2, 4, 5, 16, 17, 100] {
            let (set, pairs) = pairs(&scattered(count));
            for i in 0..count {
                let stencil = pairs.stencil(set.directions()[i], set.seen_from().unwrap().directions()[i]);
                let weight: f32 = stencil.iter().filter(|(k, _)| *k == i).map(|(_, weight)| weight).sum();
                assert!((weight - 1.0).abs() < 1e-5 && (stencil.fade - 1.0).abs() < 1e-4, "{count} {i}: {stencil:?}");
            }
        }
    }

    #[test]
    fn the_nearest_pairs_are_found() {
        let (set, pairs) = pairs(&scattered(100));
        let views = set.seen_from().unwrap().directions();
        let (wi, wo) = (from_angles(0.7, 2.0), from_angles(0.4, 5.0));
        let distance = |i: &usize| {
            let h = half(wi, wo) - half(set.directions()[*i], views[*i]);
            let [a, b] = [wi - set.directions()[*i], wo - views[*i]];
            [a, b, h].map(|v| v.truncate().length_squared()).iter().sum::<f32>()
        };
        let mut order: Vec<usize> = (0..100).collect();
        order.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        assert_eq!(pairs.stencil(wi, wo).index.map(|i| i as usize), order[..4]);
    }

    #[test]
    fn pairs_measured_several_times_are_averaged() {
        let (set, pairs) = pairs(&[[20.0, 10.0, 40.0, 50.0]; 7]);
        for (wi, wo) in [(set.directions()[0], set.seen_from().unwrap().directions()[0]), (Vec3::Z, Vec3::Z)] {
            let stencil = pairs.stencil(wi, wo);
            assert!(stencil.weight.iter().all(|w| (w - 0.25).abs() < 1e-4), "{stencil:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn weights_are_convex_and_continuous(
            angles in proptest::array::uniform4(0.0f32..1.5),
            count in 1usize..40,
            step in proptest::array::uniform4(-1e-4f32..1e-4),
        ) {
            let (_, pairs) = pairs(&scattered(count));
            let at = |[a, b, c, d]: [f32; 4]| pairs.stencil(from_angles(a, 4.0 * b), from_angles(c, 4.0 * d));
            let value = |stencil: &Stencil| stencil.iter().map(|(i, w)| w * (i as f32 * 0.7).sin()).sum::<f32>();
            let stencil = at(angles);
            prop_assert!((stencil.weight.iter().sum::<f32>() - 1.0).abs() < 1e-4);
            prop_assert!(stencil.weight.iter().all(|w| (0.0..=1.0001).contains(w)), "{:?}", stencil);
            prop_assert!((0.0..=MOST_RAISED).contains(&stencil.fade), "{:?}", stencil);
            let moved = at(std::array::from_fn(|k| angles[k] + step[k]));
            prop_assert!((value(&stencil) - value(&moved)).abs() < 0.05, "{:?} {:?}", stencil, moved);
        }
    }
}
