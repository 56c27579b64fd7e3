//! Normalised decomposition: one product of two positive tables, from norms and averages.

use super::matrix::Matrix;
use super::tables::{Factored, Projection};
use super::{Factorisation, RESOLUTION};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values};
use crate::progress::Progress;

/// # Model
/// The matrix of f has a row per light and a column per view. H holds the p-norms of the rows, G the average of the
/// rows divided by their norms: f = H(light) G(view). With p = 1 the mean over all pairs is preserved; with p = 2 the
/// product is too dark where rows differ in shape, since their average has a norm below 1.
///
/// # Limits
/// One product of light and view cannot represent a highlight, which moves with both.
///
/// # References
/// kautz1999 (section 3)
pub(super) struct Nd;

crate::params! {
    /// The parameters of normalised decompositions.
    pub(super) struct Options {
        resolution: usize => RESOLUTION,
        /// Exponent p of the p-norm that the rows are divided by.
        norm: i32 [1..=8] = 2,
    }
}

impl Factorisation for Nd {
    fn name(&self) -> &'static str {
        "nd"
    }

    fn doc(&self) -> &'static str {
        "Normalised decomposition over light and view: row norms times the average of normalised rows."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        normalised(brdf, [Projection::Light, Projection::View], values, progress)
    }
}

/// The normalised decomposition over any two projections.
pub(super) fn normalised(
    brdf: &dyn Material,
    projections: [Projection; 2],
    values: &Values,
    progress: &dyn Progress,
) -> Result<Factored> {
    let Options { resolution, norm } = Options::from_values(values)?;
    let matrix = Matrix::of(brdf, projections, resolution, progress)?;
    let channels = [0, 1, 2].map(|c| vec![norms_and_mean(&matrix.channels[c], matrix.size * matrix.size, norm)]);
    Ok(Factored::Product(vec![matrix.step(channels)]))
}

fn norms_and_mean(matrix: &[f32], n: usize, p: i32) -> [Vec<f32>; 2] {
    let (mut norms, mut mean) = (Vec::with_capacity(n), vec![0.0f64; n]);
    for row in matrix.chunks_exact(n) {
        let norm = row.iter().map(|v| f64::from(*v).abs().powi(p)).sum::<f64>().powf(1.0 / f64::from(p));
        norms.push(norm as f32);
        if norm > 0.0 {
            mean.iter_mut().zip(row).for_each(|(m, v)| *m += f64::from(*v) / norm / n as f64);
        }
    }
    [norms, mean.into_iter().map(|m| m as f32).collect()]
}
