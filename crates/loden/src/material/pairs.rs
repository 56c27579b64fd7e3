//! Interpolation between measured pairs of directions, for BTFs that have their own list of pairs.

use glam::Vec3;

use super::measured::scattered::place::Place;
use super::measured::scattered::spline::Spline;
use super::measured::scattered::tree::{NEIGHBOURS, Tree, distance_squared};
use crate::direction::{DirectionSet, Stencil, half};

/// The most pairs that have a smooth function each.
const MOST: usize = 1000;
/// Pairs closer than this are one.
const SAME: f32 = 1e-3;
/// The most that a value is raised because its light is lower.
const MOST_RAISED: f32 = 4.0;
/// Pairs of a stencil.
const USED: usize = 4;

/// Measured pairs of light and view.
///
/// # Model
/// A pair is a point: the projections of light, view and half vector to the surface. Every measured pair has a smooth
/// function, which is 1 there and 0 at all others: radial functions r^(3/2) around all pairs, plus a constant. Of the
/// twelve nearest pairs those four are used whose functions are largest, w_1 to w_4. A function fades out towards the
/// distance of the thirteenth. The weights, w_k - w_5^2 / w_k over the sum, are exact at measured pairs, continuous, and
/// never negative. Of more than a thousand pairs the functions are reciprocal squares of distances.
///
/// [`Stencil::fade`] is the light's cosine over the weighted mean of those of the four, so that what is interpolated of
/// apparent values is their ratio to the light's cosine. The factor is at most 4.
///
/// # Limits
/// Beyond the measured pairs values are those of the nearest. Of pairs that coincide the first is used.
///
/// # References
/// duchon1977, shepard1968
#[derive(Debug, Clone)]
pub(super) struct Pairs {
    /// The distinct points.
    places: Vec<Place>,
    /// The measured pair of each.
    index: Vec<u32>,
    /// Cosine of the light of each.
    cosines: Vec<f32>,
    tree: Tree,
    functions: Option<Spline>,
}

impl Pairs {
    /// The pairs of `lights` and the views that these are seen from.
    pub(super) fn new(lights: &DirectionSet, views: &DirectionSet) -> Self {
        let all: Vec<Place> = lights.directions().iter().zip(views.directions()).map(|(l, v)| place(*l, *v)).collect();
        let index = distinct(&all);
        let places: Vec<Place> = index.iter().map(|&i| all[i as usize]).collect();
        let cosines = index.iter().map(|&i| lights.directions()[i as usize].z).collect();
        let tree = Tree::new(&places, all[0].len());
        let functions = (places.len() <= MOST).then(|| cardinal(&places)).flatten();
        Self { places, index, cosines, tree, functions }
    }

    /// The lights around a direction, from whatever view they are seen, with equal weights.
    pub(super) fn lights_around(&self, wi: Vec3) -> Stencil {
        let distance = |k: &usize| (self.places[*k][0] - wi.x).powi(2) + (self.places[*k][1] - wi.y).powi(2);
        let mut order: Vec<usize> = (0..self.places.len()).collect();
        order.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        let mut weights: Vec<(f32, u32)> = order.into_iter().take(USED).map(|k| (1.0, k as u32)).collect();
        Stencil { fade: 1.0, ..self.stencil_of(&mut weights, 1.0) }
    }

    /// The measured pairs around a pair, with weights.
    pub(super) fn stencil(&self, wi: Vec3, wo: Vec3) -> Stencil {
        let at = place(wi, wo);
        let nearest = self.tree.search(&at);
        let (list, beyond) = nearest.list[..nearest.count].split_at(nearest.count.min(NEIGHBOURS));
        let mut weights = [(0.0, 0); NEIGHBOURS];
        let weights = &mut weights[..list.len()];
        match &self.functions {
            Some(functions) => {
                functions.each(&at, list.iter().map(|near| near.1), weights);
                // Let a function vanish before its pair leaves the list of the nearest
                if let Some(next) = beyond.first() {
                    weights.iter_mut().zip(list).for_each(|(w, near)| w.0 *= taper(near.0 / next.0));
                }
            }
            None => weights.iter_mut().zip(list).for_each(|(w, near)| *w = (1.0 / near.0.max(1e-12), near.1)),
        }
        weights.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        // Let the last weight vanish before another pair takes its place
        let last = weights.get(USED).map_or(0.0, |w| w.0.max(0.0));
        let used = weights.len().min(USED);
        let weights = &mut weights[..used];
        weights.iter_mut().for_each(|w| w.0 = if w.0 > last { w.0 - last * last / w.0 } else { 0.0 });
        if weights.iter().map(|w| w.0).sum::<f32>().is_nan() || weights[0].0 <= 0.0 {
            weights[0] = (1.0, list[0].1);
            weights[1..].iter_mut().for_each(|w| w.0 = 0.0);
        }
        self.stencil_of(weights, wi.z)
    }

    /// The stencil of one to four weights of points, for the cosine of a light.
    fn stencil_of(&self, weights: &mut [(f32, u32)], cosine: f32) -> Stencil {
        let sum: f32 = weights.iter().map(|w| w.0).sum();
        weights.iter_mut().for_each(|w| w.0 /= sum);
        let at = |k: usize| weights.get(k).copied().unwrap_or((0.0, weights[0].1));
        let mean: f32 = weights.iter().map(|w| w.0 * self.cosines[w.1 as usize]).sum();
        Stencil {
            index: std::array::from_fn(|k| self.index[at(k).1 as usize]),
            weight: std::array::from_fn(|k| at(k).0),
            count: weights.len() as u32,
            fade: (cosine.max(0.0) / mean.max(1e-6)).min(MOST_RAISED),
        }
    }
}

/// The pairs that do not coincide with one before them.
fn distinct(places: &[Place]) -> Vec<u32> {
    let at = |i: u32| &places[i as usize];
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    order.sort_by(|a, b| at(*a)[0].total_cmp(&at(*b)[0]).then(a.cmp(b)));
    let is_first = |k: &usize| {
        let i = order[*k];
        // pairs are in order of their first coordinate
        let near = |other: &&u32| (at(**other)[0] - at(i)[0]).abs() < SAME;
        let (before, after) = (order[..*k].iter().rev().take_while(near), order[k + 1..].iter().take_while(near));
        !before.chain(after).any(|&other| other < i && distance_squared(at(other), at(i)) < SAME * SAME)
    };
    let mut found: Vec<u32> = (0..order.len()).filter(is_first).map(|k| order[k]).collect();
    found.sort_unstable();
    found
}

/// The functions that are 1 at one place and 0 at the others.
fn cardinal(places: &[Place]) -> Option<Spline> {
    let n = places.len();
    let mut values = vec![0.0; n * n];
    (0..n).for_each(|k| values[k * n + k] = 1.0);
    Spline::new(places, places[0].len(), &values)
}

/// 1 up to a ratio of squared distances of a half, then smoothly down to 0 at 1.
fn taper(ratio: f32) -> f32 {
    let t = (2.0 - 2.0 * ratio).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn place(wi: Vec3, wo: Vec3) -> Place {
    let h = half(wi, wo);
    [wi.x, wi.y, wo.x, wo.y, h.x, h.y]
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

    /// Evenly spread in four dimensions (the R4 sequence).
    const R: f64 = 0.856_674_883_854_502_9;

    fn scattered(count: usize) -> Vec<[f64; 4]> {
        let angle = |i: usize, step: f64, most: f64| (i as f64 * step).fract() * most;
        let pair =
            |i| [angle(i, R, 80.0), angle(i, R * R, 360.0), angle(i, R * R * R, 75.0), angle(i, R * R * R * R, 360.0)];
        (1..=count).map(pair).collect()
    }

    #[test]
    fn measured_pairs_are_reproduced() {
        for count in [1, 2, 4, 5, 16, 100, MOST + 1] {
            let (set, pairs) = pairs(&scattered(count));
            assert_eq!(pairs.functions.is_some(), count <= MOST, "{count}");
            for i in 0..count {
                let stencil = pairs.stencil(set.directions()[i], set.seen_from().unwrap().directions()[i]);
                let weight: f32 = stencil.iter().filter(|(k, _)| *k == i).map(|(_, weight)| weight).sum();
                assert!((weight - 1.0).abs() < 1e-3 && (stencil.fade - 1.0).abs() < 1e-3, "{count} {i}: {stencil:?}");
            }
        }
    }

    #[test]
    fn values_do_not_jump_where_a_pair_leaves_the_list_of_the_nearest() {
        let (_, pairs) = pairs(&scattered(37));
        let at = |[a, b, c, d]: [f32; 4]| pairs.stencil(from_angles(a, 4.0 * b), from_angles(c, 4.0 * d));
        let steps = 400;
        let mut before = [0.0; 37];
        for k in 0..=steps {
            let t = 2.0 * k as f32 / steps as f32 - 1.0;
            let stencil = at([1.06 - 6e-2 * t, 0.62 - 2e-2 * t, 1.42, 1.41 + 1e-2 * t]);
            let mut weights = [0.0; 37];
            stencil.iter().for_each(|(i, weight)| weights[i] += weight);
            let moved = weights.iter().zip(&before).map(|(a, b): (&f32, &f32)| (a - b).abs()).fold(0.0, f32::max);
            assert!(k == 0 || moved < 0.02, "step {k}: {moved}");
            before = weights;
        }
    }

    #[test]
    fn the_first_of_pairs_that_coincide_counts() {
        for count in [1, 7, 40] {
            let mut list = vec![[20.0, 10.0, 40.0, 50.0]; count];
            list.push([20.0, 100.0, 40.0, 50.0]);
            let (set, pairs) = pairs(&list);
            assert_eq!(pairs.index, [0, count as u32]);
            let stencil = pairs.stencil(set.directions()[0], set.seen_from().unwrap().directions()[0]);
            assert!(stencil.index[0] == 0 && (stencil.weight[0] - 1.0).abs() < 1e-4, "{stencil:?}");
        }
    }

    #[test]
    fn smooth_values_are_closer_than_those_of_the_nearest_pair() {
        let value = |wi: Vec3, wo: Vec3| 1.0 + 0.5 * wi.x + 0.3 * wo.y + half(wi, wo).z.powi(4);
        let (set, pairs) = pairs(&scattered(300));
        let views = set.seen_from().unwrap().directions();
        let known: Vec<f32> = set.directions().iter().zip(views).map(|(wi, wo)| value(*wi, *wo)).collect();
        let (mut smooth, mut stepped) = (0.0, 0.0);
        for [tl, pl, tv, pv] in scattered(800).into_iter().skip(300) {
            let w = |theta: f64, phi: f64| from_angles(theta.to_radians() as f32, phi.to_radians() as f32);
            let (wi, wo) = (w(tl, pl), w(tv, pv));
            let found: f32 = pairs.stencil(wi, wo).iter().map(|(i, weight)| weight * known[i]).sum();
            let at = place(wi, wo);
            let distance = |k: &usize| distance_squared(&pairs.places[*k], &at);
            let nearest = (0..300).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            smooth += (found - value(wi, wo)).abs();
            stepped += (known[nearest] - value(wi, wo)).abs();
        }
        assert!(smooth < 0.7 * stepped, "{smooth} {stepped}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
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
