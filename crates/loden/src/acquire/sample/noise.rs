//! Periodic noise over the unit square.

use glam::{IVec2, Vec2};

use crate::random::{Stream, hash};

fn seed_of(cell: IVec2, period: IVec2, seed: u64) -> u64 {
    let wrapped = cell.rem_euclid(period);
    hash(&[seed, wrapped.x as u64, wrapped.y as u64])
}

/// Gradient noise in about -1..1, on a lattice of `period` cells over the unit square.
///
/// # References
/// perlin2002
pub(super) fn gradient(p: Vec2, period: [i32; 2], seed: u64) -> f32 {
    let period = IVec2::from(period);
    let q = p * period.as_vec2();
    let (cell, f) = (q.floor().as_ivec2(), q - q.floor());
    let corner = |dx: i32, dy: i32| {
        let angle = Stream::new(seed_of(cell + IVec2::new(dx, dy), period, seed)).range(0.0, std::f32::consts::TAU);
        Vec2::from_angle(angle).dot(f - Vec2::new(dx as f32, dy as f32))
    };
    let fade = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let low = mix(corner(0, 0), corner(1, 0), fade.x);
    let high = mix(corner(0, 1), corner(1, 1), fade.x);
    1.5 * mix(low, high, fade.y)
}

/// Fractal gradient noise in about -1..1: each octave has twice the frequency and half the amplitude of the one before.
pub(super) fn octaves(p: Vec2, period: [i32; 2], count: u32, seed: u64) -> f32 {
    let octave = |k: u32| gradient(p, period.map(|c| c << k), seed ^ u64::from(k)) / (1u32 << k) as f32;
    (0..count).map(octave).sum::<f32>() / (2.0 - 2.0 / (1u32 << count) as f32)
}

/// The nearest point of a jittered lattice; lengths are in cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    /// Distance to the nearest point.
    pub first: f32,
    /// Distance to the border with the second nearest point.
    pub border: f32,
    /// Identifies the nearest point; used as a seed of its properties.
    pub id: u64,
}

/// Cellular noise: one point in each of `period` x `period` cells, offset from the centre of its cell by `jitter`
/// (0..=1).
///
/// # References
/// worley1996
pub(super) fn cellular(p: Vec2, period: i32, jitter: f32, seed: u64) -> Nearest {
    let q = p * period as f32;
    let cell = q.floor().as_ivec2();
    let around = (-2..=2).flat_map(|y| (-2..=2).map(move |x| IVec2::new(x, y)));
    let points = around.map(|d| {
        let id = seed_of(cell + d, IVec2::splat(period), seed);
        let mut random = Stream::new(id);
        let offset = (random.next2() - Vec2::splat(0.5)) * jitter + Vec2::splat(0.5);
        ((cell + d).as_vec2() + offset - q, id)
    });
    let points: [_; 25] = {
        let mut all = [(Vec2::ZERO, 0); 25];
        all.iter_mut().zip(points).for_each(|(slot, point)| *slot = point);
        all
    };
    let mut nearest = points[0];
    for point in points {
        if point.0.length_squared() < nearest.0.length_squared() {
            nearest = point;
        }
    }
    let mut border = f32::MAX;
    for (d, id) in points {
        let across = d - nearest.0;
        if id != nearest.1 && across.length_squared() > 0.0 {
            border = border.min((0.5 * (d + nearest.0)).dot(across.normalize()));
        }
    }
    Nearest { first: nearest.0.length(), border, id: nearest.1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_repeats_after_one_period() {
        let mut random = Stream::new(1);
        for _ in 0..200 {
            let (p, shift) = (random.next2(), Vec2::new(1.0, -2.0));
            assert!((octaves(p, [4, 7], 3, 5) - octaves(p + shift, [4, 7], 3, 5)).abs() < 1e-3);
            let (a, b) = (cellular(p, 6, 1.0, 5), cellular(p + shift, 6, 1.0, 5));
            assert!((a.first - b.first).abs() < 1e-3 && (a.border - b.border).abs() < 1e-3);
        }
    }
}
