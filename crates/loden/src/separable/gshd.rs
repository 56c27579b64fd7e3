//! Normalised decomposition over half and difference vectors.

use super::Factorisation;
use super::nd::Options;
use super::nd::normalised;
use super::tables::{Factored, Projection};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values};
use crate::progress::Progress;

/// # Model
/// The half vector H = (wi + wo) / |wi + wo|; {t, s, H} orthonormal by Gram-Schmidt from the surface's tangent;
/// D = (wi.t, wi.s, wi.H). The normalised decomposition of f over H and D: f = A(H) B(D).
///
/// # Limits
/// Pairs of H and D whose light or view is flatter than 80 degrees, or below the horizon, are filled from there.
///
/// # References
/// kautz1999 (section 4)
pub(super) struct Gshd;

impl Factorisation for Gshd {
    fn name(&self) -> &'static str {
        "gshd"
    }

    fn doc(&self) -> &'static str {
        "Normalised decomposition over half and difference vectors in a Gram-Schmidt frame."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        normalised(brdf, [Projection::Half, Projection::Difference], values, progress)
    }
}
