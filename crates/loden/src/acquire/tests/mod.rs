mod physics;
mod rays;
mod samples;
mod solids;

use glam::Vec3;

use super::{Finish, HeightField, Options, acquire};
use crate::Result;
use crate::direction::DirectionSet;
use crate::progress::Silent;

fn directions(degrees: &[[f64; 2]]) -> DirectionSet {
    DirectionSet::from_degrees(degrees.to_vec()).unwrap()
}

/// All images, shape (view, light, y, x, rgb).
fn measure(field: &HeightField, views: &DirectionSet, lights: &DirectionSet, options: &Options) -> Vec<f32> {
    let mut all = Vec::new();
    let mut sink = |view: usize, images: Vec<f32>| {
        assert_eq!(view * images.len(), all.len(), "views come in order");
        all.extend(images);
        Ok(())
    };
    acquire(field, views, lights, options, &Silent, &mut sink).unwrap();
    all
}

fn mean(values: &[f32]) -> f64 {
    values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64
}

/// Directions that cover equal solid angles of the hemisphere.
fn dense(rings: usize, per_ring: usize) -> DirectionSet {
    let at = |k: usize| {
        let z = ((k / per_ring) as f64 + 0.5) / rings as f64;
        // rings are rotated relative to each other
        let phi = 360.0 * ((k % per_ring) as f64 + 0.618 * (k / per_ring) as f64) / per_ring as f64;
        [z.acos().to_degrees(), phi % 360.0]
    };
    DirectionSet::from_degrees((0..rings * per_ring).map(at).collect()).unwrap()
}

fn flat(n: usize, finish: Finish) -> Result<HeightField> {
    HeightField::from_fn(n, |_, _| (0.1, finish))
}

/// Smooth hills whose steepest slope is about 2.
fn hills(n: usize, finish: Finish) -> HeightField {
    let tau = std::f32::consts::TAU;
    let height = |x: f32, y: f32| 0.1 * (tau * x).sin() * (2.0 * tau * y).cos() + 0.1 * (tau * (x + y)).sin();
    HeightField::from_fn(n, |x, y| (height(x, y), finish)).unwrap()
}

const WHITE: Finish = Finish { albedo: [1.0; 3], roughness: 1.0, f0: [0.0; 3], padding: 0.0 };

fn glossy() -> Finish {
    Finish::coated(Vec3::new(0.6, 0.5, 0.3), 0.2, 0.3)
}
