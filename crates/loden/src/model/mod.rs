//! Analytic BRDFs, one file each, in [`MODELS`].
//!
//! A model is a sum of terms whose shape depends on its parameters, each multiplied by a colour. This lets
//! [`crate::fit`] solve for the colours directly. Everything is computed in double precision.

mod analytic;
mod ashikhmin_shirley;
mod beckmann;
mod blinn_phong;
mod cook_torrance;
pub(crate) mod fresnel;
mod ggx;
mod he_torrance;
mod lafortune;
mod lambert;
mod lobe;
pub(crate) mod microfacet;
mod oren_nayar;
mod phong;
mod schlick;
#[cfg(test)]
mod tests;
mod ward;

pub use lambert::Lambert;

use std::fmt::Debug;

use glam::{DVec2, DVec3};

pub use analytic::Analytic;

use crate::material::{Material, Promises};
use crate::params::{Kind, Param, Values};
use crate::{Error, Result};

/// Every model, simplest first.
pub const MODELS: &[&dyn Model] = &[
    &lambert::LambertModel,
    &oren_nayar::OrenNayarModel,
    &phong::PhongModel,
    &blinn_phong::BlinnPhongModel,
    &lafortune::LafortuneModel,
    &ward::WardModel,
    &ashikhmin_shirley::AshikhminShirleyModel,
    &schlick::SchlickModel,
    &cook_torrance::CookTorranceModel,
    &beckmann::BeckmannModel,
    &ggx::GgxModel,
    &he_torrance::HeTorranceModel,
];

/// Maximum number of terms of a model.
pub const MAX_TERMS: usize = 5;

/// One value per term and channel, 1/sr; unused terms are zero.
pub type Terms = [DVec3; MAX_TERMS];

/// A family of reflectance functions with named parameters.
pub trait Model: Sync {
    /// Name of the model on the command line.
    fn name(&self) -> &'static str;

    /// One sentence for the reference page.
    fn doc(&self) -> &'static str;

    /// Its parameters.
    fn params(&self) -> &'static [Param];

    /// The parameters that are colours of terms, in the order of [`Model::coefficients`].
    fn colors(&self) -> &'static [&'static str];

    /// The terms for these parameters; colours are ignored.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `values` do not belong to the table [`Model::params`].
    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>>;

    /// The values of [`Model::colors`].
    ///
    /// # Errors
    /// As [`Model::shape`].
    fn color_values(&self, values: &Values) -> Result<Vec<DVec3>> {
        self.colors().iter().map(|name| values.get::<[f64; 3]>(name).map(DVec3::from)).collect()
    }

    /// Parameters that equal another one on an isotropic surface, as (parameter, other). If `other` is empty, the
    /// parameter keeps its default.
    fn ties(&self) -> &'static [(&'static str, &'static str)] {
        &[]
    }

    /// Groups of parameters whose common factor only scales a term. A fit keeps the largest of each group at 1 and
    /// puts the scale into the term's colour.
    fn homogeneous(&self) -> &'static [&'static [&'static str]] {
        &[]
    }

    /// The only parameters that affect [`Shape::costly`].
    fn costly(&self) -> &'static [&'static str] {
        &[]
    }

    /// The factor of each term, computed from the colours. By default the colours themselves.
    fn coefficients(&self, colors: &[DVec3]) -> Terms {
        let mut factors = [DVec3::ZERO; MAX_TERMS];
        factors[..colors.len()].copy_from_slice(colors);
        factors
    }

    /// Whether the second of two colours is a coat over the first, so that their factors sum to at most 1.
    fn is_coated(&self) -> bool {
        false
    }

    /// Colours from the factors of the terms: the inverse of [`Model::coefficients`], as far as it exists.
    fn colors_of(&self, factors: &Terms) -> Vec<DVec3> {
        factors[..self.colors().len()].to_vec()
    }
}

/// Intermediate results of a shape for one pair of directions.
pub type Costly = [DVec3; 2];

/// The terms of a model for fixed parameters.
pub trait Shape: Debug + Send + Sync {
    /// Number of terms in use.
    fn count(&self) -> usize;

    /// The terms for a pair of unit vectors above the surface, without the cosine.
    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms;

    /// The expensive part of the terms, which depends only on the parameters [`Model::costly`]. A fit that varies
    /// other parameters reuses it.
    fn costly(&self, _wi: DVec3, _wo: DVec3) -> Costly {
        [DVec3::ZERO; 2]
    }

    /// [`Shape::terms`] from the result of [`Shape::costly`].
    fn terms_from(&self, _costly: &Costly, wi: DVec3, wo: DVec3) -> Terms {
        self.terms(wi, wo)
    }

    /// Draws a light direction with a density similar to `term` times the cosine; `None` if it is below the surface.
    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3>;

    /// The density of [`Shape::sample`], 1/sr.
    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64;

    /// Approximate albedo of the term with factor 1; used for sampling only.
    fn importance(&self, _term: usize) -> f64 {
        1.0
    }

    /// The material with these factors and sampling fractions of the terms in single precision, which is several
    /// times as fast; `None` if that is not accurate enough.
    fn single(&self, _factors: &Terms, _shares: &[f64; MAX_TERMS]) -> Option<Box<dyn Material>> {
        None
    }

    /// Properties for colours whose sum is at most 1.
    fn promises(&self) -> Promises;
}

/// The model named `name`.
///
/// # Errors
/// [`Error::Parameter`] listing the known names.
pub fn by_name(name: &str) -> Result<&'static dyn Model> {
    MODELS.iter().copied().find(|model| model.name() == name).ok_or_else(|| {
        let names: Vec<_> = MODELS.iter().map(|model| model.name()).collect();
        Error::parameter("model", format!("found {name:?}, expected one of {}", names.join(", ")))
    })
}

const fn color(name: &'static str, max: f64, default: &'static str, doc: &'static str) -> Param {
    Param { name, unit: "", kind: Kind::Color { min: 0.0, max }, default, doc }
}

const KD: Param = color("kd", 1.0, "0.3", "Diffuse albedo.");
const KS: Param = color("ks", 10.0, "0.5", "Factor of the specular lobe.");
