//! BTFs whose texels are a mean plus components times coefficients: stored form, decoding and evaluation, shared by
//! several methods.

mod compact;
mod decode;
mod material;
mod store;
mod table;

pub use compact::{Compact, Plane};
pub use decode::FactoredBtf;
pub(in crate::codec) use decode::form;
pub use material::FactoredMaterial;
pub use store::FactorWriter;

use crate::btf::{BtfMeta, SampleType};
use crate::codec::parts::{Axis, Expr, PlaneKind, PlaneSpec, Recipe, TableSpec, Views};
use crate::color::domain::{DOMAIN, Domain};
use crate::{Error, Result};

/// How views share coefficients and mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharing {
    /// Each view has its own coefficients.
    PerView,
    /// All views share the coefficients.
    AllViews,
    /// All views share the coefficients, and there is no mean.
    AllViewsNoMean,
}

impl Sharing {
    fn has_mean(self) -> bool {
        self != Self::AllViewsNoMean
    }

    /// The largest useful number of components: the rank of the factored matrix, after the mean is removed if there
    /// is one.
    pub fn rank(self, meta: &BtfMeta) -> usize {
        let columns = match self {
            Self::PerView => 3 * meta.lights.len(),
            Self::AllViews | Self::AllViewsNoMean => 3 * meta.pairs(),
        };
        columns.min(meta.texels() - usize::from(self.has_mean())).max(1)
    }
}

crate::params! {
    /// Parameters that the factored methods share.
    pub struct Stored {
        /// Number type of the coefficients: single or half precision, or 8 bits with a range per view and component.
        pub precision: SampleType = "f16",
        /// Values that are factored: display values (as stored in photographs), linear light, or its logarithm.
        pub domain: Domain => DOMAIN,
    }
}

/// The recipe of a factored method with `count` components per texel.
///
/// # Errors
/// [`Error::Parameter`] if `count` exceeds the rank.
pub fn recipe(meta: &BtfMeta, count: usize, stored: &Stored, sharing: Sharing) -> Result<Recipe> {
    let rank = sharing.rank(meta);
    if count > rank {
        let columns = match sharing {
            Sharing::PerView => format!("{} lights", meta.lights.len()),
            Sharing::AllViews | Sharing::AllViewsNoMean => format!("{} pairs", meta.pairs()),
        };
        let texels = meta.texels();
        let problem =
            format!("found {count}, expected at most {rank} (the rank: {columns} x 3 channels, {texels} texels)");
        return Err(Error::parameter("components", problem));
    }
    let sample_type = stored.precision;
    let (views, view) = match sharing {
        Sharing::PerView => (Views::Each, Axis::View),
        Sharing::AllViews | Sharing::AllViewsNoMean => (Views::Shared, Axis::Shared),
    };
    let mut tables = Vec::new();
    let mut add = |name: &str, axes: &[Axis], sample_type| {
        tables.push(TableSpec::new(name, axes, sample_type));
        tables.len() - 1
    };
    let mean = sharing.has_mean().then(|| add("mean", &[Axis::View, Axis::Light, Axis::Channel], SampleType::F32));
    let range = (sample_type == SampleType::U8)
        .then(|| add("coefficients_range", &[view, Axis::Component(count), Axis::Range], SampleType::F32));
    // 8 bits suit the coefficients, which are the bulk; a half-precision basis is small and adds no visible error
    let of_basis = if sample_type == SampleType::F32 { SampleType::F32 } else { SampleType::F16 };
    let basis = add("basis", &[Axis::View, Axis::Component(count), Axis::Light, Axis::Channel], of_basis);
    let kind = PlaneKind::Numbers { count, views, sample_type, range };
    let sum: Vec<Expr> = mean.map(Expr::table).into_iter().chain([Expr::dot(0, basis)]).collect();
    Ok(Recipe {
        planes: vec![PlaneSpec { name: "coefficients".into(), kind }],
        tables,
        value: Expr::Sum(sum),
        curve: stored.domain.into(),
    })
}
