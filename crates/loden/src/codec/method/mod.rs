//! The compression methods, one file each, in [`CODECS`].

mod analytic;
mod cmf;
mod dfmf;
mod klt;
mod kmeans;
mod median_cut;
mod neural;
mod pca;
mod pcmf;
mod pvmf;
mod svd;
mod tsvq;

pub use analytic::Analytic;
pub use cmf::Cmf;
pub use dfmf::Dfmf;
pub use klt::Klt;
pub use kmeans::KMeans;
pub use median_cut::MedianCut;
pub(super) use median_cut::ReadPages;
pub use neural::Neural;
pub use pca::Pca;
pub use pcmf::Pcmf;
pub use pvmf::Pvmf;
pub(super) use pvmf::Views;
pub use svd::Svd;
pub use tsvq::Tsvq;

use super::Codec;

/// All compression methods.
pub const CODECS: &[&dyn Codec] = &[
    &Pvmf, //
    &Pca, &Svd, &Klt, &Neural, &KMeans, &MedianCut, &Tsvq, &Pcmf, &Cmf, &Dfmf, &Analytic,
];
