//! Materials that are plain arithmetic, evaluated sixteen at a time.

use glam::{Vec2, Vec3};

use super::{Bounce, Point, Prepared};
use crate::simd::many::{LANES, Many};
use crate::simd::wide;

/// A material without texture that is plain arithmetic: all functions are inlined and free of branches, so that loops
/// over them vectorise.
pub(crate) trait Plain: Sync {
    /// [`crate::material::Material::apparent`].
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3;

    /// Samples a direction for a viewer.
    fn draw(&self, wo: Vec3, random: Vec2) -> Bounce;

    /// [`crate::material::Material::pdf`].
    fn density(&self, wi: Vec3, wo: Vec3) -> f32;
}

/// Points on a plain material, which need no preparation.
pub(crate) struct PlainPoints<'a, M> {
    pub material: &'a M,
    pub points: &'a [Point],
}

impl<M: Plain> Prepared for PlainPoints<'_, M> {
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        apparent(self.material, self.points, index, wi, values);
    }

    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        scatter(self.material, self.points, index, random, bounces);
    }

    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]) {
        for ((density, &index), &wi) in densities.iter_mut().zip(index).zip(wi) {
            *density = self.material.density(wi, self.points[index as usize].wo);
        }
    }
}

wide! {
    fn apparent<M: Plain>(material: &M, points: &[Point], index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        let [mut viewers, mut lights, mut found] = [const { Many::<Vec3, 3>::ZERO }; 3];
        for ((values, index), wi) in values.chunks_mut(LANES).zip(index.chunks(LANES)).zip(wi.chunks(LANES)) {
            for (lane, (&index, wi)) in index.iter().zip(wi).enumerate() {
                viewers.set(lane, points[index as usize].wo);
                lights.set(lane, *wi);
            }
            for lane in 0..LANES {
                found.set(lane, material.value(lights.get(lane), viewers.get(lane)));
            }
            values.iter_mut().enumerate().for_each(|(lane, value)| *value = found.get(lane));
        }
    }
}

wide! {
    fn scatter<M: Plain>(material: &M, points: &[Point], index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        let (mut viewers, mut numbers) = (Many::<Vec3, 3>::ZERO, Many::<Vec2, 2>::ZERO);
        let mut drawn = Many::<Bounce, 7>::ZERO;
        for ((bounces, index), random) in bounces.chunks_mut(LANES).zip(index.chunks(LANES)).zip(random.chunks(LANES)) {
            for (lane, (&index, random)) in index.iter().zip(random).enumerate() {
                viewers.set(lane, points[index as usize].wo);
                numbers.set(lane, *random);
            }
            for lane in 0..LANES {
                drawn.set(lane, material.draw(viewers.get(lane), numbers.get(lane)));
            }
            bounces.iter_mut().enumerate().for_each(|(lane, bounce)| *bounce = drawn.get(lane));
        }
    }
}
