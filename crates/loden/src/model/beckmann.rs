//! Mirror facets with Beckmann slopes and Smith's shadowing.

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::fresnel::{Fresnel, Interface};
use super::lambert::diffuse_term;
use super::lobe::{half, reflect};
use super::microfacet::{Roughness, beckmann, beckmann_g1, beckmann_sample};
use super::{KD, KS, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};

/// # Model
/// f = kd/pi + ks F D G1(wi) G1(wo) / (4 (n.wi) (n.wo)) with the anisotropic Beckmann distribution, F exact for
/// the index n + ik.
///
/// # Limits
/// Multiple scattering between facets is ignored. G1 is the paper's rational function, within 0.35 per cent of the
/// exact one.
///
/// # References
/// walter2007 (eq. 20, 25, 27), cook1982 (F)
pub(super) struct BeckmannModel;

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        ks: [f64; 3] => KS,
        /// Roughness along the tangent.
        alpha_x: f64 [0.001..=2.0] = 0.25,
        /// Roughness along the bitangent.
        alpha_y: f64 [0.001..=2.0] = 0.25,
        interface: Interface,
    }
}

impl Model for BeckmannModel {
    fn name(&self) -> &'static str {
        "beckmann"
    }

    fn doc(&self) -> &'static str {
        "Mirror facets with Beckmann slopes and Smith's shadowing, anisotropic."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks"]
    }

    fn ties(&self) -> &'static [(&'static str, &'static str)] {
        &[("alpha-y", "alpha-x")]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let Options { alpha_x, alpha_y, interface, .. } = Options::from_values(values)?;
        Ok(Box::new(Beckmann { roughness: Roughness { x: alpha_x, y: alpha_y }, fresnel: interface.fresnel() }))
    }
}

#[derive(Debug)]
struct Beckmann {
    roughness: Roughness,
    fresnel: Fresnel,
}

impl Shape for Beckmann {
    fn count(&self) -> usize {
        2
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let mut terms = diffuse_term();
        let wh = half(wi, wo);
        let g = beckmann_g1(wi, self.roughness) * beckmann_g1(wo, self.roughness);
        let lobe = beckmann(wh, self.roughness) * g / (4.0 * wi.z * wo.z);
        terms[1] = self.fresnel.reflectance(wo.dot(wh)) * lobe;
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        if term == 0 { Some(diffuse_sample(random)) } else { reflect(wo, beckmann_sample(self.roughness, random)) }
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        let wh = half(wi, wo);
        beckmann(wh, self.roughness) * wh.z / (4.0 * wo.dot(wh))
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: true, isotropic: self.roughness.x == self.roughness.y }
    }
}
