//! Materials that are plain arithmetic, sixteen values at a time.

use glam::{Vec2, Vec3};

use super::{Bounce, Seen};
use crate::simd::many::{LANES, Many};

/// A material without texture that is plain arithmetic: both functions are inlined, and without branches, so that loops over
/// them vectorise.
pub(crate) trait Plain {
    /// [`crate::material::Material::apparent`].
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3;

    /// A direction drawn for a viewer.
    fn draw(&self, wo: Vec3, random: Vec2) -> Bounce;
}

/// [`crate::material::Material::apparent_many`].
#[inline(always)]
pub(crate) fn apparent(material: &impl Plain, seen: &[&Seen], wi: &[Vec3], values: &mut [Vec3]) {
    let (mut viewers, mut lights, mut found) = (Many::<Vec3, 3>::ZERO, Many::<Vec3, 3>::ZERO, Many::<Vec3, 3>::ZERO);
    for ((values, seen), wi) in values.chunks_mut(LANES).zip(seen.chunks(LANES)).zip(wi.chunks(LANES)) {
        for (lane, (seen, wi)) in seen.iter().zip(wi).enumerate() {
            viewers.set(lane, seen.wo);
            lights.set(lane, *wi);
        }
        for lane in 0..LANES {
            found.set(lane, material.value(lights.get(lane), viewers.get(lane)));
        }
        values.iter_mut().enumerate().for_each(|(lane, value)| *value = found.get(lane));
    }
}

/// [`crate::material::Material::scatter_many`].
#[inline(always)]
pub(crate) fn scatter(material: &impl Plain, seen: &[&Seen], random: &[Vec2], bounces: &mut [Bounce]) {
    let (mut viewers, mut numbers, mut drawn) = (Many::<Vec3, 3>::ZERO, Many::<Vec2, 2>::ZERO, Many::<Bounce, 7>::ZERO);
    for ((bounces, seen), random) in bounces.chunks_mut(LANES).zip(seen.chunks(LANES)).zip(random.chunks(LANES)) {
        for (lane, (seen, random)) in seen.iter().zip(random).enumerate() {
            viewers.set(lane, seen.wo);
            numbers.set(lane, *random);
        }
        for lane in 0..LANES {
            drawn.set(lane, material.draw(viewers.get(lane), numbers.get(lane)));
        }
        bounces.iter_mut().enumerate().for_each(|(lane, bounce)| *bounce = drawn.get(lane));
    }
}
