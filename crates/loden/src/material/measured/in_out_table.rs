//! A table over the polar angles and azimuths of light and view.

use std::f32::consts::TAU;

use glam::Vec3;

use super::{BrdfSample, Table, bracket, possible};
use crate::direction::{from_angles, phi, theta};
use crate::material::Promises;
use crate::{Error, Result};

/// The equally spaced azimuths of an [`InOutTable`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Azimuths {
    /// Number of azimuths of the light.
    pub light: usize,
    /// Number of azimuths of the view.
    pub view: usize,
    /// The first azimuth, in steps from 0: 0.5 for centres of bins.
    pub first: f32,
    /// Whether azimuths of the view are relative to that of the light.
    pub view_is_relative: bool,
}

/// An anisotropic BRDF over (theta_i, phi_i, theta_o, phi_o), the azimuths equally spaced from 0 to 360 degrees.
///
/// # Model
/// Linear in each of the four angles. Polar angles are clamped at the ends, azimuths are periodic. Nodes without a
/// measurement are left out; where all sixteen are missing, the value is 0.
#[derive(Debug, Clone)]
pub struct InOutTable {
    theta_i: Vec<f32>,
    theta_o: Vec<f32>,
    phis: Azimuths,
    /// `[theta_i][phi_i][theta_o][phi_o]`; NaN where nothing was measured
    values: Vec<Vec3>,
}

impl InOutTable {
    /// Creates a table from ascending polar angles in radians, the azimuths, and values in 1/sr in the order
    /// `[theta_i][phi_i][theta_o][phi_o]`, NaN where nothing was measured.
    ///
    /// # Errors
    /// [`Error::Parameter`] if an axis is empty or not ascending, the number of values is not the product of the
    /// axes, or a value exceeds the largest possible measurement.
    pub fn new(theta_i: Vec<f32>, theta_o: Vec<f32>, phis: Azimuths, values: Vec<Vec3>) -> Result<Self> {
        for (name, axis) in [("theta_i", &theta_i), ("theta_o", &theta_o)] {
            if axis.is_empty() || !axis.is_sorted_by(|a, b| a < b) {
                return Err(Error::parameter(name, "the angles are not ascending"));
            }
        }
        let expected = theta_i.len() * phis.light * theta_o.len() * phis.view;
        if values.len() != expected || expected == 0 {
            return Err(Error::parameter("values", format!("found {}, expected {expected}", values.len())));
        }
        possible("values", values.iter().flat_map(Vec3::to_array))?;
        Ok(Self { theta_i, theta_o, phis, values })
    }

    fn index(&self, ti: usize, pi: usize, to: usize, po: usize) -> usize {
        ((ti * self.phis.light + pi) * self.theta_o.len() + to) * self.phis.view + po
    }
}

/// As [`bracket`] for `count` equal steps of a full turn.
fn around(count: usize, first: f32, phi: f32) -> [(usize, f32); 2] {
    let x = (phi / TAU * count as f32 - first).rem_euclid(count as f32);
    let cell = (x as usize).min(count - 1);
    let t = (x - cell as f32).clamp(0.0, 1.0);
    [(cell, 1.0 - t), ((cell + 1) % count, t)]
}

fn along(nodes: &[f32], theta: f32) -> [(usize, f32); 2] {
    let (a, b, t) = bracket(nodes, theta);
    [(a, 1.0 - t), (b, t)]
}

impl Table for InOutTable {
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3 {
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        let (tis, tos) = (along(&self.theta_i, theta(wi)), along(&self.theta_o, theta(wo)));
        let turned = if self.phis.view_is_relative { phi(wo) - phi(wi) } else { phi(wo) };
        let first = self.phis.first;
        let (pis, pos) = (around(self.phis.light, first, phi(wi)), around(self.phis.view, first, turned));
        for (ti, wti) in tis {
            for (pi, wpi) in pis {
                for (to, wto) in tos {
                    for (po, wpo) in pos {
                        let (weight, value) = (wti * wpi * wto * wpo, self.values[self.index(ti, pi, to, po)]);
                        if weight > 0.0 && !value.is_nan() {
                            sum += weight * value;
                            weights += weight;
                        }
                    }
                }
            }
        }
        if weights > 0.0 { sum / weights } else { Vec3::ZERO }
    }

    fn samples(&self) -> Vec<BrdfSample> {
        let mut samples = Vec::with_capacity(self.values.len());
        for (ti, &theta_i) in self.theta_i.iter().enumerate() {
            for pi in 0..self.phis.light {
                let phi_i = (pi as f32 + self.phis.first) / self.phis.light as f32 * TAU;
                let wi = from_angles(theta_i, phi_i);
                for (to, &theta_o) in self.theta_o.iter().enumerate() {
                    for po in 0..self.phis.view {
                        let phi_o = (po as f32 + self.phis.first) / self.phis.view as f32 * TAU;
                        let base = if self.phis.view_is_relative { phi_i } else { 0.0 };
                        let wo = from_angles(theta_o, phi_o + base);
                        let value = self.values[self.index(ti, pi, to, po)];
                        if !value.is_nan() && wi.z > 0.0 && wo.z > 0.0 {
                            samples.push(BrdfSample { wi, wo, value });
                        }
                    }
                }
            }
        }
        samples
    }

    fn promises(&self) -> Promises {
        Promises::default()
    }
}
