//! SVD: singular value decomposition of the whole BTF.
//!
//! # Model
//! The matrix M has a row per texel and a column per view, light and channel. The c largest singular values of M = U
//! S V^T are kept: B = V is stored as components and A = U S as coefficients; the decoded matrix is A B^T. This is
//! [`super::Pca`] without a mean: the first component takes its place.
//!
//! # Limits
//! As of [`super::Pca`]. With the same number of components the error is slightly larger, but no mean is stored.
//!
//! # References
//! koudelka2003, halko2011

use std::path::Path;

use super::pca;
use crate::Result;
use crate::btf::{BtfMeta, BtfSource};
use crate::codec::form::factored::{self, Sharing, Stored};
use crate::codec::parts::Recipe;
use crate::codec::{Codec, EncodeInStages, EncodeSummary};
use crate::factor::global;
use crate::params::{Param, Params as _, Values};
use crate::progress::Progress;
use crate::stages::Local;

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Svd;

crate::params! {
    struct Settings {
        /// Number of singular values to keep; at most the rank, the smaller of 3 x pairs and texels.
        components: usize [1..=65535] = 16,
        stored: Stored,
    }
}

impl Codec for Svd {
    fn name(&self) -> &'static str {
        "svd"
    }

    fn doc(&self) -> &'static str {
        "Singular value decomposition of the whole BTF: like pca, without a mean."
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
        pca::encode(self, &Local::new(source), params, path, progress, Sharing::AllViewsNoMean)
    }

    fn in_stages(&self) -> Option<EncodeInStages> {
        Some(|stages, params, path, progress| {
            pca::encode(&Svd, stages, params, path, progress, Sharing::AllViewsNoMean)
        })
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("components", crate::codec::count(place, Sharing::AllViewsNoMean.rank(meta).min(1024)))]
    }

    fn limits(&self, meta: &BtfMeta, _params: &Values) -> Result<Vec<(&'static str, usize)>> {
        Ok(vec![("components", Sharing::AllViewsNoMean.rank(meta))])
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        Some(pca::memory(meta, Settings::from_values(params).ok()?.components, threads, global::memory))
    }

    fn recipe(&self, meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Settings { components, stored } = Settings::from_values(params)?;
        factored::recipe(meta, components, &stored, Sharing::AllViewsNoMean)
    }
}
