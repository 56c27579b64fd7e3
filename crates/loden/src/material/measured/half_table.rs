//! A table over half and difference angles.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::{BrdfSample, Table, bracket, possible};
use crate::direction::{HalfDifference, from_angles, phi, theta};
use crate::material::Promises;
use crate::{Error, Result};

/// Period of the azimuth of the difference vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Period {
    /// 180 degrees: light and view can be exchanged.
    Half,
    /// 360 degrees.
    Full,
}

/// An isotropic BRDF over (theta_h, theta_d, phi_d).
///
/// # Model
/// Trilinear between the nodes. Polar angles are clamped at the ends, phi_d is periodic. Nodes without a measurement
/// are left out; where all eight are missing, the value is 0.
///
/// # References
/// rusinkiewicz1998
#[derive(Debug, Clone)]
pub struct HalfTable {
    theta_h: Vec<f32>,
    theta_d: Vec<f32>,
    phi_d: Vec<f32>,
    period: Period,
    /// `[theta_h][theta_d][phi_d]`; NaN where nothing was measured
    values: Vec<Vec3>,
    /// In nm, ascending; empty for RGB values alone.
    wavelengths: Vec<f32>,
    /// `[theta_h][theta_d][phi_d][wavelength]`
    spectra: Vec<f32>,
}

impl HalfTable {
    /// Creates a table from ascending nodes in radians and values in 1/sr in the order `[theta_h][theta_d][phi_d]`, NaN
    /// where nothing was measured. `phi_d` lies within one period.
    ///
    /// # Errors
    /// [`Error::Parameter`] if an axis is empty or not ascending, the number of values is not the product of the
    /// axes, or a value exceeds the largest possible measurement.
    pub fn new(axes: [Vec<f32>; 3], period: Period, values: Vec<Vec3>) -> Result<Self> {
        for (name, axis) in ["theta_h", "theta_d", "phi_d"].into_iter().zip(&axes) {
            if axis.is_empty() || !axis.is_sorted_by(|a, b| a < b) || !axis.iter().all(|a| a.is_finite()) {
                return Err(Error::parameter(name, "the angles are not ascending"));
            }
        }
        let [theta_h, theta_d, phi_d] = axes;
        let expected = theta_h.len() * theta_d.len() * phi_d.len();
        if values.len() != expected {
            return Err(Error::parameter("values", format!("found {}, expected {expected}", values.len())));
        }
        possible("values", values.iter().flat_map(Vec3::to_array))?;
        Ok(Self { theta_h, theta_d, phi_d, period, values, wavelengths: Vec::new(), spectra: Vec::new() })
    }

    /// Adds the spectrum of each node, in the order `[theta_h][theta_d][phi_d][wavelength]`; wavelengths in nm.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is not one number for each node and wavelength.
    pub fn with_spectra(self, wavelengths: Vec<f32>, spectra: Vec<f32>) -> Result<Self> {
        let expected = self.values.len() * wavelengths.len();
        if spectra.len() != expected {
            return Err(Error::parameter("spectra", format!("found {} numbers, expected {expected}", spectra.len())));
        }
        Ok(Self { wavelengths, spectra, ..self })
    }

    /// The nodes around a pair of directions, their weights, and the sum of these; nodes that were not measured have
    /// weight 0.
    #[inline]
    fn stencil(&self, wi: Vec3, wo: Vec3) -> ([(usize, f32); 8], f32) {
        let HalfDifference { wh, wd } = HalfDifference::new(wi, wo);
        let (h0, h1, th) = bracket(&self.theta_h, theta(wh));
        let (d0, d1, td) = bracket(&self.theta_d, theta(wd));
        let (p0, p1, tp) = self.phi_bracket(phi(wd));
        let (mut nodes, mut weights) = ([(0, 0.0f32); 8], 0.0);
        for (k, node) in nodes.iter_mut().enumerate() {
            let (h, wh) = [(h0, 1.0 - th), (h1, th)][k >> 2];
            let (d, wd) = [(d0, 1.0 - td), (d1, td)][k >> 1 & 1];
            let (p, wp) = [(p0, 1.0 - tp), (p1, tp)][k & 1];
            let (index, weight) = ((h * self.theta_d.len() + d) * self.phi_d.len() + p, wh * wd * wp);
            if weight > 0.0 && !self.values[index].is_nan() {
                *node = (index, weight);
                weights += weight;
            }
        }
        (nodes, weights)
    }

    fn phi_bracket(&self, phi: f32) -> (usize, usize, f32) {
        let period = match self.period {
            Period::Half => PI,
            Period::Full => TAU,
        };
        let (first, last) = (self.phi_d[0], self.phi_d.len() - 1);
        let x = first + (phi - first).rem_euclid(period);
        // Between the last node and the first of the next period
        if x >= self.phi_d[last] {
            let gap = first + period - self.phi_d[last];
            let t = if gap > 1e-4 { ((x - self.phi_d[last]) / gap).min(1.0) } else { 0.0 };
            return (last, 0, t);
        }
        bracket(&self.phi_d, x)
    }
}

impl Table for HalfTable {
    fn value(&self, wi: Vec3, wo: Vec3) -> Vec3 {
        let (nodes, weights) = self.stencil(wi, wo);
        let measured = nodes.into_iter().filter(|(_, weight)| *weight > 0.0);
        let sum: Vec3 = measured.map(|(node, weight)| weight * self.values[node]).sum();
        if weights > 0.0 { sum / weights } else { Vec3::ZERO }
    }

    fn wavelengths(&self) -> &[f32] {
        &self.wavelengths
    }

    fn spectrum(&self, wi: Vec3, wo: Vec3) -> Vec<f32> {
        let bands = self.wavelengths.len();
        let mut spectrum = vec![0.0; bands];
        let (nodes, weights) = self.stencil(wi, wo);
        for (node, weight) in nodes.into_iter().filter(|(_, weight)| *weight > 0.0) {
            let of_node = &self.spectra[node * bands..][..bands];
            spectrum.iter_mut().zip(of_node).for_each(|(sum, value)| *sum += weight / weights * value);
        }
        spectrum
    }

    fn samples(&self) -> Vec<BrdfSample> {
        let (nd, np) = (self.theta_d.len(), self.phi_d.len());
        let sample = |(i, &value): (usize, &Vec3)| {
            let (h, d, p) = (i / (nd * np), i / np % nd, i % np);
            let (wh, wd) = (from_angles(self.theta_h[h], 0.0), from_angles(self.theta_d[d], self.phi_d[p]));
            let (wi, wo) = HalfDifference { wh, wd }.directions();
            // Leave out nodes below the surface, such as most of the table's far corner
            (!value.is_nan() && wi.z > 0.0 && wo.z > 0.0).then_some(BrdfSample { wi, wo, value })
        };
        self.values.iter().enumerate().filter_map(sample).collect()
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: self.period == Period::Half, energy_conserving: false, isotropic: true }
    }
}
