//! Normalised decomposition: one product of two positive tables, by norms and averages.

use super::matrix::Matrix;
use super::tables::{Factored, Projection};
use super::{Factorisation, RESOLUTION};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values};
use crate::progress::Progress;

/// # Model
/// The rows of the matrix of f over light and view: H = their p-norms, G = the mean of the rows over their norms;
/// f = H(light) G(view). With p = 1 the mean over all pairs is kept; with p = 2 rows of different shape average to a
/// shorter one, and the product is too dark.
///
/// # Limits
/// One product of light and view cannot hold a highlight that moves with both.
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
        "Normalised decomposition over light and view: norms of rows times their normalised average."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        normalised(brdf, [Projection::Light, Projection::View], values, progress)
    }
}

/// The normalised decomposition in any parametrisation.
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
