//! Mirror facets with Beckmann slopes and V-shaped grooves.

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::fresnel::{Fresnel, Interface};
use super::lambert::diffuse_term;
use super::lobe::{half, reflect};
use super::microfacet::{Roughness, beckmann, beckmann_sample, grooves};
use super::{KD, KS, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};

/// # Model
/// f = kd/pi + sum over lobes of ks F D G / (4 (n.wi) (n.wo)), D = exp(-tan^2 a / m^2) / (pi m^2 cos^4 a),
/// G = min(1, 2 (n.h)(n.wi) / (h.wo), 2 (n.h)(n.wo) / (h.wo)), F exact for the index n + ik.
///
/// # Limits
/// Up to three distributions. G has a kink, visible as a line on smooth objects of rough metal.
///
/// # References
/// cook1982. The paper has 1/pi and a D without 1/pi; with D normalised to projected area 1 the factor is 1/4.
pub(super) struct CookTorranceModel;

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        /// Number of distributions in use.
        lobes: usize [1..=3] = 1,
        ks: [f64; 3] => KS,
        /// Root mean square slope of the first distribution.
        m: f64 [0.005..=2.0] = 0.25,
        /// Factor of the second distribution.
        ks_2: [f64; 3] [0.0..=10.0] = 0.2,
        /// Root mean square slope of the second distribution.
        m_2: f64 [0.005..=2.0] = 0.5,
        /// Factor of the third distribution.
        ks_3: [f64; 3] [0.0..=10.0] = 0.1,
        /// Root mean square slope of the third distribution.
        m_3: f64 [0.005..=2.0] = 0.1,
        interface: Interface,
    }
}

impl Model for CookTorranceModel {
    fn name(&self) -> &'static str {
        "cook-torrance"
    }

    fn doc(&self) -> &'static str {
        "Mirror facets with Beckmann slopes and V-shaped grooves; sums of distributions."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks", "ks-2", "ks-3"]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let Options { lobes, m, m_2, m_3, interface, .. } = Options::from_values(values)?;
        let lobes = [m, m_2, m_3].into_iter().take(lobes).map(|m| Roughness { x: m, y: m }).collect();
        Ok(Box::new(CookTorrance { fresnel: interface.fresnel(), lobes }))
    }
}

#[derive(Debug)]
struct CookTorrance {
    fresnel: Fresnel,
    lobes: Vec<Roughness>,
}

impl Shape for CookTorrance {
    fn count(&self) -> usize {
        1 + self.lobes.len()
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        let mut terms = diffuse_term();
        let wh = half(wi, wo);
        let common = self.fresnel.reflectance(wo.dot(wh)) * (grooves(wi, wo, wh) / (4.0 * wi.z * wo.z));
        for (term, lobe) in terms[1..].iter_mut().zip(&self.lobes) {
            *term = common * beckmann(wh, *lobe);
        }
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        match term {
            0 => Some(diffuse_sample(random)),
            _ => reflect(wo, beckmann_sample(self.lobes[term - 1], random)),
        }
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        let wh = half(wi, wo);
        beckmann(wh, self.lobes[term - 1]) * wh.z / (4.0 * wo.dot(wh))
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: true, isotropic: true }
    }
}
