//! Mirror facets with GGX slopes.

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::fresnel::{Fresnel, K, METAL, N};
use super::lambert::diffuse_term;
use super::lobe::{half, reflect};
use super::microfacet::{Roughness, ggx, ggx_lambda, ggx_visible_sample};
use super::{KD, KS, Model, Shape, Terms, choice, real};
use crate::material::Promises;
use crate::params::{Param, Values};

/// # Model
/// f = kd/pi + ks F D G / (4 (n.wi) (n.wo)) with the anisotropic GGX distribution, F exact for the index n + ik,
/// G = 1 / (1 + L(wi) + L(wo)) (heights correlated) or 1 / ((1 + L(wi)) (1 + L(wo))) (separable). Sampled by the
/// normals that `wo` sees.
///
/// # Limits
/// Light scattered between facets is lost.
///
/// # References
/// walter2007 (eq. 20, 33, 34), heitz2014 (eq. 72, 99), dupuy2023 (sampling), burley2012 (anisotropic form)
pub(super) struct Entry;

const PARAMS: &[Param] = &[
    KD,
    KS,
    real("alpha-x", 0.001, 2.0, "0.25", "Roughness along the tangent."),
    real("alpha-y", 0.001, 2.0, "0.25", "Roughness along the bitangent."),
    METAL,
    N,
    K,
    choice(
        "shadowing",
        &["correlated", "separable"],
        "correlated",
        "Whether shadowing and masking know of each other.",
    ),
];

impl Model for Entry {
    fn name(&self) -> &'static str {
        "ggx"
    }

    fn doc(&self) -> &'static str {
        "Mirror facets with GGX slopes and Smith's shadowing, anisotropic."
    }

    fn params(&self) -> &'static [Param] {
        PARAMS
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks"]
    }

    fn ties(&self) -> &'static [(&'static str, &'static str)] {
        &[("alpha-y", "alpha-x")]
    }

    fn shape(&self, values: &Values) -> Box<dyn Shape> {
        let roughness = Roughness { x: values.real("alpha-x"), y: values.real("alpha-y") };
        let separable = values.text("shadowing") == "separable";
        Box::new(Ggx { roughness, fresnel: Fresnel::new(values), separable })
    }
}

#[derive(Debug)]
struct Ggx {
    roughness: Roughness,
    fresnel: Fresnel,
    separable: bool,
}

impl Shape for Ggx {
    fn count(&self) -> usize {
        2
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let mut terms = diffuse_term();
        let wh = half(wi, wo);
        let (li, lo) = (ggx_lambda(wi, self.roughness), ggx_lambda(wo, self.roughness));
        let g = if self.separable { 1.0 / ((1.0 + li) * (1.0 + lo)) } else { 1.0 / (1.0 + li + lo) };
        terms[1] = self.fresnel.reflectance(wo.dot(wh)) * (ggx(wh, self.roughness) * g / (4.0 * wi.z * wo.z));
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        if term == 0 {
            return Some(diffuse_sample(random));
        }
        reflect(wo, ggx_visible_sample(wo, self.roughness, random))
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        // G1 D (h.wo) / (n.wo), over the Jacobian 4 (h.wo)
        ggx(half(wi, wo), self.roughness) / (4.0 * wo.z * (1.0 + ggx_lambda(wo, self.roughness)))
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: true, isotropic: self.roughness.x == self.roughness.y }
    }
}
