//! Bilinear interpolation in the quadrilaterals between rings of equal polar angle.

use std::f32::consts::TAU;

use glam::Vec3;

use super::interpolate::Stencil;
use super::set::DirectionSet;
use super::triangles::fade;
use super::{phi, theta};
use crate::{Error, Result};

/// Polar angles that differ by less than this belong to one ring, in degrees.
const TOLERANCE: f64 = 0.05;

#[derive(Debug, Clone)]
pub(super) struct Rings(Vec<Ring>);

#[derive(Debug, Clone)]
struct Ring {
    theta: f32,
    /// (azimuth in [0, 2 pi), index into the set), ordered by azimuth.
    samples: Vec<(f32, u32)>,
}

impl Rings {
    pub(super) fn new(set: &DirectionSet) -> Result<Self> {
        let mut order: Vec<usize> = (0..set.len()).collect();
        order.sort_by(|&a, &b| set.degrees()[a][0].total_cmp(&set.degrees()[b][0]));
        let mut rings: Vec<Ring> = Vec::new();
        let mut ring_theta = f64::NEG_INFINITY;
        for i in order {
            let [t, p] = set.degrees()[i];
            if t - ring_theta > TOLERANCE {
                ring_theta = t;
                rings.push(Ring { theta: t.to_radians() as f32, samples: Vec::new() });
            }
            if let Some(ring) = rings.last_mut() {
                let azimuth = (p.rem_euclid(360.0).to_radians() as f32).min(TAU.next_down());
                ring.samples.push((azimuth, i as u32));
            }
        }
        // fewer than three samples form a ring only at the pole
        if let Some(ring) = rings.iter().find(|r| r.samples.len() < 3 && f64::from(r.theta.to_degrees()) > TOLERANCE) {
            let problem = format!(
                "the directions do not lie on rings: found {} at polar angle {:.2} degrees, expected at least 3",
                ring.samples.len(),
                ring.theta.to_degrees()
            );
            return Err(Error::parameter("interpolation", problem));
        }
        for ring in &mut rings {
            ring.samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        Ok(Self(rings))
    }

    pub(super) fn stencil(&self, w: Vec3) -> Stencil {
        let (t, p) = (theta(w), phi(w));
        let next = self.0.partition_point(|ring| ring.theta <= t);
        let last = self.0.len() - 1;
        let (inner, outer) = (next.saturating_sub(1), next.min(last));
        let (a, b) = (&self.0[inner], &self.0[outer]);
        let blend = if inner == outer { 0.0 } else { (t - a.theta) / (b.theta - a.theta) };
        let ([a0, a1], x) = a.bracket(p);
        let ([b0, b1], y) = b.bracket(p);
        Stencil {
            index: [a0, a1, b0, b1],
            weight: [(1.0 - blend) * (1.0 - x), (1.0 - blend) * x, blend * (1.0 - y), blend * y],
            count: 4,
            fade: if next > last { fade(w.z, self.0[last].theta.cos()) } else { 1.0 },
        }
    }
}

impl Ring {
    /// The two samples around the azimuth `p`, and the weight of the second.
    fn bracket(&self, p: f32) -> ([u32; 2], f32) {
        let n = self.samples.len();
        let next = self.samples.partition_point(|s| s.0 <= p);
        let (a, b) = (self.samples[(next + n - 1) % n], self.samples[next % n]);
        let span = (b.0 - a.0).rem_euclid(TAU);
        let x = if n > 1 && span > 0.0 { ((p - a.0).rem_euclid(TAU) / span).min(1.0) } else { 0.0 };
        ([a.1, b.1], x)
    }
}
