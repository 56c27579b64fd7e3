//! Singular value decomposition: the sum of products with the least squared error.

use super::matrix::Matrix;
use super::tables::Factored;
use super::{Factorisation, Sum};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values};
use crate::progress::Progress;

/// # Model
/// Per channel, the matrix of f over either parametrisation is F = U S V^T; f is the sum over terms of U(x) SV(y).
///
/// # Limits
/// Tables after the first have both signs; negative sums are clamped to zero. Singular vectors are computed as
/// eigenvectors of F F^T, so terms below a thousandth of the first are noise.
///
/// # References
/// kautz1999 (section 3)
pub(super) struct Svd;

impl Factorisation for Svd {
    fn name(&self) -> &'static str {
        "svd"
    }

    fn doc(&self) -> &'static str {
        "Singular value decomposition: the sum of products of two tables with the least squared error."
    }

    fn params(&self) -> &'static [Param] {
        Sum::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        let Sum { resolution, terms, parametrisation } = Sum::from_values(values)?;
        let matrix = Matrix::of(brdf, parametrisation.projections(), resolution, progress)?;
        Ok(Factored::Product(vec![matrix.singular(terms)?]))
    }
}
