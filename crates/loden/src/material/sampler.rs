//! Importance sampling of any tabulated BRDF: half vectors from a histogram, mixed with the cosine distribution.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec2, Vec3};

use super::Sample;
use crate::color::luminance;
use crate::direction::{HalfDifference, cosine_hemisphere, from_angles, phi, sin_cos_turns, theta};

/// Rings of half vectors, narrower near the normal, where lobes are.
const RINGS: usize = 90;
/// Sectors of a ring, for an anisotropic table.
const SECTORS: usize = 36;
/// Lobes with less energy than this are ignored, because their density cannot be normalised.
const DARK: f32 = 1e-30;

/// Draws light directions for any viewer.
///
/// # Model
/// With probability q a half vector h is drawn, with a density per solid angle that is constant in each cell of
/// a histogram over its polar angle (and azimuth, if the table is anisotropic), and the viewer is reflected about it.
/// Otherwise the light is cosine-distributed: pdf = q p(h) / (4 wo.h) + (1 - q) cos(theta_i) / pi. The histogram is the
/// mean of the BRDF over difference angles above its lower quartile, times cos(theta_h); q is its share of the whole.
///
/// # Limits
/// The density of half vectors is the same for every viewer.
#[derive(Debug, Clone)]
pub(super) struct HalfSampler {
    sectors: usize,
    /// Cumulative probability of the cells, ring by ring, from 0 to 1.
    cumulated: Vec<f32>,
    /// Density of each cell, 1/sr.
    density: Vec<f32>,
    lobe_share: f32,
}

impl HalfSampler {
    pub(super) fn new(isotropic: bool, value: impl Fn(Vec3, Vec3) -> Vec3) -> Self {
        let sectors = if isotropic { 1 } else { SECTORS };
        let cell = |i: usize| {
            let (ring, sector) = (i / sectors, i % sectors);
            let h = from_angles(angle(ring as f32 + 0.5), (sector as f32 + 0.5) / sectors as f32 * TAU);
            mean_around(h, &value)
        };
        let means: Vec<f32> = (0..RINGS * sectors).map(cell).collect();
        let mut sorted = means.clone();
        sorted.sort_by(f32::total_cmp);
        let floor = sorted[sorted.len() / 4];
        let solid = |i: usize| solid_angle(i / sectors) / sectors as f32;
        let cosine = |i: usize| angle((i / sectors) as f32 + 0.5).cos();
        let mass: Vec<f32> = (0..means.len()).map(|i| (means[i] - floor).max(0.0) * cosine(i) * solid(i)).collect();
        let lobe: f32 = mass.iter().sum();
        let total = lobe + floor * FRAC_PI_2;
        // Always mix both kinds: the histogram may miss a lobe
        let lobe_share = if lobe > DARK && total.is_finite() { (lobe / total).clamp(0.1, 0.9) } else { 0.0 };
        let scale = if lobe_share > 0.0 { 1.0 / lobe } else { 0.0 };
        let mut cumulated = vec![0.0];
        let mut sum = 0.0;
        for m in &mass {
            sum += f64::from(*m);
            cumulated.push((sum * f64::from(scale)) as f32);
        }
        let density = mass.iter().enumerate().map(|(i, m)| m * scale / solid(i)).collect();
        Self { sectors, cumulated, density, lobe_share }
    }

    pub(super) fn sample(&self, wo: Vec3, random: Vec2) -> Option<Sample> {
        if wo.z.is_nan() || wo.z <= 0.0 {
            return None;
        }
        let wi = if random.x < self.lobe_share {
            let h = self.half(Vec2::new(random.x / self.lobe_share, random.y));
            2.0 * wo.dot(h) * h - wo
        } else {
            cosine_hemisphere(Vec2::new((random.x - self.lobe_share) / (1.0 - self.lobe_share), random.y))
        };
        let pdf = self.pdf(wi, wo);
        (pdf > 0.0).then_some(Sample { wi, pdf })
    }

    pub(super) fn pdf(&self, wi: Vec3, wo: Vec3) -> f32 {
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return 0.0;
        }
        let h = (wi + wo).normalize();
        let ring = (ring(theta(h)) as usize).min(RINGS - 1);
        let sector = if self.sectors == 1 { 0 } else { (phi(h) / TAU * self.sectors as f32) as usize };
        let density = self.density[ring * self.sectors + sector.min(self.sectors - 1)];
        self.lobe_share * density / (4.0 * wo.dot(h).max(1e-6)) + (1.0 - self.lobe_share) * wi.z / PI
    }

    fn half(&self, random: Vec2) -> Vec3 {
        let cells = self.density.len();
        let cell = self.cumulated.partition_point(|&c| c <= random.x).clamp(1, cells) - 1;
        let (low, high) = (self.cumulated[cell], self.cumulated[cell + 1]);
        let within = if high > low { ((random.x - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 };
        let (ring, sector) = (cell / self.sectors, cell % self.sectors);
        let turns = (sector as f32 + random.y) / self.sectors as f32;
        in_ring([angle(ring as f32), angle(ring as f32 + 1.0)], within, turns)
    }
}

/// A direction between two polar angles: uniform in solid angle if `within` is uniform in 0..1, at azimuth `turns`.
pub(super) fn in_ring(thetas: [f32; 2], within: f32, turns: f32) -> Vec3 {
    let [low, high] = thetas.map(height);
    below_pole(low + within * (high - low), turns)
}

/// 1 - cos of a polar angle, without cancellation near the pole.
pub(super) fn height(theta: f32) -> f32 {
    2.0 * (0.5 * theta).sin().powi(2)
}

/// The direction at a height below the pole, 1 - z, and an azimuth in turns.
#[inline(always)]
pub(super) fn below_pole(height: f32, turns: f32) -> Vec3 {
    let radius = (height * (2.0 - height)).max(0.0).sqrt();
    let (sin, cos) = sin_cos_turns(turns);
    Vec3::new(radius * cos, radius * sin, 1.0 - height)
}

/// Polar angle of the half vector at a ring coordinate in 0..RINGS.
fn angle(ring: f32) -> f32 {
    (ring / RINGS as f32).powi(2) * FRAC_PI_2
}

fn ring(angle: f32) -> f32 {
    (angle / FRAC_PI_2).sqrt() * RINGS as f32
}

fn solid_angle(ring: usize) -> f32 {
    let (low, high) = (angle(ring as f32), angle(ring as f32 + 1.0));
    // cos(low) - cos(high), without cancellation
    TAU * 2.0 * (0.5 * (low + high)).sin() * (0.5 * (high - low)).sin()
}

/// The mean luminance of the BRDF over difference vectors around the half vector `h`.
pub(super) fn mean_around(h: Vec3, value: &impl Fn(Vec3, Vec3) -> Vec3) -> f32 {
    let mut sum = 0.0;
    let mut count = 0;
    for degrees in [2.0f32, 20.0, 40.0, 60.0, 75.0] {
        for k in 0..8 {
            let wd = from_angles(degrees.to_radians(), (k as f32 + 0.5) * PI / 4.0);
            let (wi, wo) = HalfDifference { wh: h, wd }.directions();
            if wi.z > 0.02 && wo.z > 0.02 {
                let found = luminance(value(wi, wo).max(Vec3::ZERO).to_array());
                sum += if found.is_finite() { found } else { 0.0 };
                count += 1;
            }
        }
    }
    if count > 0 { sum / count as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn next_to_nothing_is_sampled_by_the_cosine() {
        for value in [0.0, 1e-44, 1e-38, 1e-31] {
            let sampler = HalfSampler::new(true, |wi, _| Vec3::splat(if wi.z > 0.9 { value } else { 0.0 }));
            let wo = from_angles(0.4, 1.0);
            for random in [Vec2::new(0.01, 0.3), Vec2::new(0.6, 0.9)] {
                let sample = sampler.sample(wo, random).unwrap();
                assert_eq!(sample.pdf, sample.wi.z / PI, "{value}");
            }
        }
    }
}
