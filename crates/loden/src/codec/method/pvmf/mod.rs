//! PVMF: principal component analysis of the images of each view.
//!
//! # Model
//! For view v the matrix M has a row per texel and a column per light and channel. The file stores its mean over
//! texels mu, the c eigenvectors B of the scatter matrix with the largest eigenvalues, and the coefficients A = (M -
//! 1 mu^T) B. The decoded matrix M' = 1 mu^T + A B^T is the best rank-c approximation around the mean in the
//! least-squares sense. The thesis does not subtract the mean (72, 74, 75); we do, since it costs one row and saves
//! most of a component.
//!
//! # Limits
//! c is at most the rank, the smaller of 3 x lights and texels - 1. Views are independent: what they have in common
//! is stored in each, and the size grows with views x texels x c.
//!
//! # References
//! sattler2003
//! mueller2004

mod encode;
#[cfg(test)]
mod tests;

pub(in crate::codec) use encode::Views;

use std::path::Path;

use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::codec::form::factored::{self, Sharing, Stored};
use crate::codec::parts::Recipe;
use crate::codec::{Codec, EncodeInStages, EncodeSummary, budget};
use crate::params::{Param, Params as _, Values};
use crate::progress::Progress;
use crate::stages::Local;

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pvmf;

crate::params! {
    struct Settings {
        /// Number of components per view; at most the rank, the smaller of 3 x lights and texels - 1.
        components: usize [1..=65535] = 4,
        stored: Stored,
    }
}

impl Codec for Pvmf {
    fn name(&self) -> &'static str {
        "pvmf"
    }

    fn doc(&self) -> &'static str {
        "Principal components of the images of each view: fast to encode and decode, good at every angle."
    }

    fn params(&self) -> &'static [Param] {
        Settings::TABLE
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        encode::encode(&Local::new(source), params, path, progress)
    }

    fn in_stages(&self) -> Option<EncodeInStages> {
        Some(encode::encode)
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("components", crate::codec::count(place, Sharing::PerView.rank(meta)))]
    }

    fn limits(&self, meta: &BtfMeta, _params: &Values) -> Result<Vec<(&'static str, usize)>> {
        Ok(vec![("components", Sharing::PerView.rank(meta))])
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        let components = Settings::from_values(params).ok()?.components;
        Some(budget::source(meta, threads) + encode::memory(meta, components, threads))
    }

    fn recipe(&self, meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Settings { components, stored } = Settings::from_values(params)?;
        factored::recipe(meta, components, &stored, Sharing::PerView)
    }
}
