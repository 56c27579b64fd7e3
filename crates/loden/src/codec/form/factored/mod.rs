//! What the methods share whose texels are a mean plus components times coefficients: the stored form, decoding,
//! evaluation.

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

crate::params! {
    /// What the methods have in common.
    pub struct Stored {
        /// Numbers of the coefficients: single or half precision, or 8 bits with a range per view and component.
        pub precision: SampleType = "f16",
        /// Numbers that are factored: display values (as stored in photographs), linear light, or its logarithm.
        pub domain: Domain => DOMAIN,
    }
}

/// What the files of a method hold: `count` components of each texel.
///
/// # Errors
/// [`Error::Parameter`] if there are more components than the rank.
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
    // 8 bits are for the bulk; the basis is small and a half-precision one adds no visible error
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
