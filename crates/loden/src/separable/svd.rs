//! Singular value decomposition: the closest sum of products.

use super::matrix::Matrix;
use super::tables::Factored;
use super::{Factorisation, Sum};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values};
use crate::progress::Progress;

/// # Model
/// F = U S V' of the matrix of f over either parametrisation, per channel; f = sum over terms of U(x) SV(y).
///
/// # Limits
/// Tables beyond the first have both signs; negative sums count as zero. Singular vectors come from the eigenvectors
/// of F F', so terms below a thousandth of the first are noise.
///
/// # References
/// kautz1999 (section 3)
pub(super) struct Svd;

impl Factorisation for Svd {
    fn name(&self) -> &'static str {
        "svd"
    }

    fn doc(&self) -> &'static str {
        "Singular value decomposition: the closest sum of products of two tables."
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
