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
/// The half vector is H = (wi + wo) / |wi + wo|; the frame {t, s, H} follows from the tangent of the surface by
/// Gram-Schmidt, and the difference vector is D = (wi.t, wi.s, wi.H). The normalised decomposition of f over H and D
/// gives f = A(H) B(D).
///
/// # Limits
/// Pairs of H and D whose light or view is below the horizon, or more than 80 degrees from the normal, take the value
/// at 80 degrees.
///
/// # References
/// kautz1999 (section 4)
pub(super) struct Gshd;

impl Factorisation for Gshd {
    fn name(&self) -> &'static str {
        "gshd"
    }

    fn doc(&self) -> &'static str {
        "Normalised decomposition over half and difference vectors (Gram-Schmidt frame)."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        normalised(brdf, [Projection::Half, Projection::Difference], values, progress)
    }
}
