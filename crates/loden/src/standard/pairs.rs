//! The pairs of directions that texels are fitted at.

use glam::Vec3;

use crate::btf::BtfMeta;
use crate::direction::{cosine_hemisphere, half};
use crate::random::Stream;

/// Number of pairs that are chosen of a BTF.
const PAIRS: usize = 320;

/// Least cosine of a direction that is used: towards the horizon values are nearly 0 and say little.
const LEAST_COSINE: f32 = 0.08;

/// Half of the pairs evenly of all, half by how far their half vector is from the normal, the more the nearer it is: (wi, wo).
/// A material of one texel is evaluated between the sampled directions too, because its highlight may be narrower than their spacing.
pub(super) fn chosen(meta: &BtfMeta) -> Vec<(Vec3, Vec3)> {
    if meta.texels() == 1 {
        return anywhere();
    }
    let lights = meta.lights.len();
    let pair = |k: usize| meta.pair(k / lights, k % lights);
    let seen = |k: &usize| {
        let (wi, wo) = pair(*k);
        wi.z > LEAST_COSINE && wo.z > LEAST_COSINE
    };
    let all: Vec<usize> = (0..meta.pairs()).filter(seen).collect();
    if all.len() <= PAIRS {
        return all.into_iter().map(pair).collect();
    }
    let mut by_half: Vec<(f32, usize)> = all
        .iter()
        .map(|&k| {
            let (wi, wo) = pair(k);
            (1.0 - half(wi, wo).z, k)
        })
        .collect();
    by_half.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // a stride by the golden ratio keeps the views out of step with the lights
    let slot = |i: usize| (i as f64 + (i as f64 * 0.618_033_988_749_895).fract()) / (PAIRS / 2) as f64;
    let place = |at: f64| ((at * all.len() as f64) as usize).min(all.len() - 1);
    let mut chosen: Vec<usize> = (0..PAIRS / 2).map(|i| all[place(slot(i))]).collect();
    chosen.extend((0..PAIRS / 2).map(|i| by_half[place(slot(i).powi(3))].1));
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(pair).collect()
}

/// Cosine-distributed viewers; lights as these, or mirrored at normals that are the nearer to the vertical the more often.
fn anywhere() -> Vec<(Vec3, Vec3)> {
    let mut random = Stream::new(3);
    let mut found = Vec::new();
    while found.len() < 3 * PAIRS {
        let wo = cosine_hemisphere(random.next2());
        let tilt = random.next().powi(3);
        let wh = cosine_hemisphere(random.next2());
        let wh = (Vec3::Z + tilt * (wh - Vec3::Z)).normalize();
        let wi = if found.len() % 3 == 0 { cosine_hemisphere(random.next2()) } else { 2.0 * wo.dot(wh) * wh - wo };
        if wi.z > LEAST_COSINE && wo.z > LEAST_COSINE {
            found.push((wi, wo));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, SampleType};
    use crate::color::Encoding;
    use crate::direction::DirectionSet;

    #[test]
    fn pairs_are_different_and_many_are_near_the_mirror_direction() {
        let directions = DirectionSet::bonn81();
        let (views, lights) = (directions.clone(), directions);
        let (encoding, cosine, sample_type) = (Encoding::Linear, Cosine::Included, SampleType::F32);
        let meta = BtfMeta { width: 2, height: 2, views, lights, encoding, cosine, sample_type };
        let near = |pairs: &[(Vec3, Vec3)]| {
            pairs.iter().filter(|(wi, wo)| half(*wi, *wo).z > 0.985).count() as f64 / pairs.len() as f64
        };
        let all: Vec<_> = (0..meta.pairs()).map(|k| meta.pair(k / meta.lights.len(), k % meta.lights.len())).collect();
        for meta in [BtfMeta { width: 1, height: 1, ..meta.clone() }, meta] {
            let pairs = chosen(&meta);
            assert!(pairs.len() > 300 && near(&pairs) > 3.0 * near(&all), "{} {}", near(&pairs), near(&all));
            for (i, pair) in pairs.iter().enumerate() {
                assert!(pairs[..i].iter().all(|other| other != pair));
            }
        }
    }
}
