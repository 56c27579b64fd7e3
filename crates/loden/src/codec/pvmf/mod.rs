//! PVMF: a principal component analysis of the images of each view.
//!
//! # Model
//! For view v the matrix M has a row per texel and a column per light and channel. Its mean over texels mu and the c
//! eigenvectors B of the scatter matrix with the largest eigenvalues are stored, with the coefficients
//! A = (M - 1 mu^T) B; decoded is M' = 1 mu^T + A B^T, the best approximation of rank c around the mean in the
//! least-squares sense. The thesis does not remove the mean (72, 74, 75); we do, since it costs one row and saves most
//! of a component.
//!
//! # Limits
//! c is at most the rank, the smaller of 3 x lights and texels - 1. Each view stands alone: what views share is
//! stored again in each, and the number of bytes grows with views x texels x c.
//!
//! # References
//! sattler2003
//! mueller2004

mod decode;
mod encode;
mod material;
mod table;
#[cfg(test)]
mod tests;

use std::path::Path;
use std::sync::Arc;

pub use decode::PvmfBtf;
pub use material::{PvmfMaterial, TexelQuery};

use super::container::{Container, TensorSpec};
use super::domain::DOMAIN;
use super::{Codec, CompressedBtf, EncodeSummary};
use crate::Result;
use crate::btf::{BtfMeta, BtfSource, SampleType};
use crate::params::{Kind, Param, Values};
use crate::progress::Progress;

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pvmf;

const PARAMS: &[Param] = &[
    Param {
        name: "components",
        unit: "",
        kind: Kind::Integer { min: 1, max: 65535 },
        default: "4",
        doc: "Components per view; at most the rank, the smaller of 3 x lights and texels - 1.",
    },
    Param {
        name: "precision",
        unit: "",
        kind: Kind::Choice(&["f32", "f16", "u8"]),
        default: "f16",
        doc: "Numbers of the coefficients: single or half precision, or 8 bits with a range per view and component.",
    },
    DOMAIN,
];

impl Codec for Pvmf {
    fn name(&self) -> &'static str {
        "pvmf"
    }

    fn doc(&self) -> &'static str {
        "Principal components of the images of each view: fast to make and to decode, good at every angle."
    }

    fn params(&self) -> &'static [Param] {
        PARAMS
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        encode::encode(source, params, path, progress)
    }

    fn open(&self, container: Container) -> Result<Arc<dyn CompressedBtf>> {
        Ok(Arc::new(PvmfBtf::new(container)?))
    }
}

/// The largest number of components that means anything: the rank of a view's matrix with its mean removed.
fn rank(meta: &BtfMeta) -> usize {
    (3 * meta.lights.len()).min(meta.texels() - 1).max(1)
}

fn precision(params: &Values) -> SampleType {
    match params.text("precision") {
        "f32" => SampleType::F32,
        "u8" => SampleType::U8,
        _ => SampleType::F16,
    }
}

/// The tensors of a file, in order, numbers of more bytes first.
fn layout(meta: &BtfMeta, c: usize, precision: SampleType) -> Vec<TensorSpec> {
    let (views, lights) = (meta.views.len(), meta.lights.len());
    // 8 bits are for the bulk; the basis is small and a half-precision one adds no visible error
    let basis = if precision == SampleType::F32 { SampleType::F32 } else { SampleType::F16 };
    let range = TensorSpec { name: "coefficients_range", dtype: SampleType::F32, shape: vec![views, c, 2] };
    let coefficients =
        TensorSpec { name: "coefficients", dtype: precision, shape: vec![views, meta.height, meta.width, c] };
    let mut tensors = vec![TensorSpec { name: "mean", dtype: SampleType::F32, shape: vec![views, lights, 3] }];
    tensors.extend((precision == SampleType::U8).then_some(range));
    tensors.push(TensorSpec { name: "basis", dtype: basis, shape: vec![views, c, lights, 3] });
    tensors.push(coefficients);
    tensors
}
