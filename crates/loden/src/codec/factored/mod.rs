//! What the methods share whose texels are a mean plus components times coefficients: the stored form, decoding,
//! evaluation.

mod compact;
mod decode;
mod material;
mod store;
mod table;

pub use compact::{Compact, Plane};
pub use decode::FactoredBtf;
pub use material::FactoredMaterial;
pub use store::FactorWriter;

use super::container::TensorSpec;
use crate::btf::{BtfMeta, SampleType};
use crate::params::{Kind, Param, Values};

/// Which coefficients a texel has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharing {
    /// Other ones in each view.
    PerView,
    /// The same in all views.
    AllViews,
    /// The same in all views, and no mean is added.
    AllViewsNoMean,
}

impl Sharing {
    /// Blocks of coefficients.
    fn blocks(self, meta: &BtfMeta) -> usize {
        match self {
            Self::PerView => meta.views.len(),
            Self::AllViews | Self::AllViewsNoMean => 1,
        }
    }

    fn has_mean(self) -> bool {
        self != Self::AllViewsNoMean
    }

    /// The largest number of components that means anything: the rank of the matrix that is factored, with its mean
    /// removed if it has one.
    pub fn rank(self, meta: &BtfMeta) -> usize {
        let columns = match self {
            Self::PerView => 3 * meta.lights.len(),
            Self::AllViews | Self::AllViewsNoMean => 3 * meta.pairs(),
        };
        columns.min(meta.texels() - usize::from(self.has_mean())).max(1)
    }
}

/// The parameter of the stored numbers.
pub const PRECISION: Param = Param {
    name: "precision",
    unit: "",
    kind: Kind::Choice(&["f32", "f16", "u8"]),
    default: "f16",
    doc: "Numbers of the coefficients: single or half precision, or 8 bits with a range per view and component.",
};

fn precision(params: &Values) -> SampleType {
    match params.text("precision") {
        "f32" => SampleType::F32,
        "u8" => SampleType::U8,
        _ => SampleType::F16,
    }
}

/// The tensors of a file, in order, numbers of more bytes first.
fn layout(meta: &BtfMeta, c: usize, precision: SampleType, sharing: Sharing) -> Vec<TensorSpec> {
    let (views, lights) = (meta.views.len(), meta.lights.len());
    let blocks = sharing.blocks(meta);
    // 8 bits are for the bulk; the basis is small and a half-precision one adds no visible error
    let basis = if precision == SampleType::F32 { SampleType::F32 } else { SampleType::F16 };
    let range =
        TensorSpec { name: "coefficients_range".into(), sample_type: SampleType::F32, shape: vec![blocks, c, 2] };
    let coefficients = TensorSpec {
        name: "coefficients".into(),
        sample_type: precision,
        shape: vec![blocks, meta.height, meta.width, c],
    };
    let mean = TensorSpec { name: "mean".into(), sample_type: SampleType::F32, shape: vec![views, lights, 3] };
    let mut tensors: Vec<TensorSpec> = sharing.has_mean().then_some(mean).into_iter().collect();
    tensors.extend((precision == SampleType::U8).then_some(range));
    tensors.push(TensorSpec { name: "basis".into(), sample_type: basis, shape: vec![views, c, lights, 3] });
    tensors.push(coefficients);
    tensors
}
