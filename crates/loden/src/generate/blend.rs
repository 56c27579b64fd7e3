//! Mixtures of two materials, on the pattern of the first.
//!
//! # Model
//! Each row moves towards the row it is matched with: diffuse parts are mixed linearly; strength and normal of the fitted
//! highlights linearly and their roughness logarithmically, so one highlight moves instead of two that fade; what the fits do not explain
//! is mixed linearly. At 0 the first material is left as it is; at 1 the result is the exchange of [`super::exchange()`].
//!
//! A mask gives each texel an amount of its own. The file then holds, for each row, the first material and two components
//! whose coefficients are the amount and its square: a parabola through both ends and the middle.
//!
//! # Limits
//! Rows of other directions are interpolated at those of the first material first; [`resampling_error`] says what that costs.
//!
//! # References
//! bonneel2011

use std::collections::BTreeMap;

use glam::Vec3;
use half::f16;
use rayon::prelude::*;

use super::exchange::{Keep, exchange};
use super::reflectance::{Geometry, Reflectance, Separated};
use super::{Matching, Rows};
use crate::btf::{BtfMeta, SampleType};
use crate::codec::parts::{Axis, Curve, Expr, MemoryParts, Numbers, PlaneSpec, Recipe, TableSpec};
use crate::color::Encoding;
use crate::color::domain::Domain;
use crate::direction::{DirectionSet, Interpolator, Scheme, Stencil};
use crate::{Error, Result};

/// A highlight weaker than this has no place and width of its own.
const FAINT: f32 = 1e-3;

/// Rows that are compared for [`resampling_error`], at most.
const COMPARED: usize = 64;

/// Mixes two materials: `amount` of the second, 0 to 1, everywhere, or times a mask of shape (y, x).
///
/// # Errors
/// [`Error::Parameter`] for an amount out of range or a mask of another size; as [`Rows::rebuilt`].
pub fn blend(a: &Rows, b: &Rows, matching: &Matching, amount: f32, mask: Option<&[f32]>) -> Result<MemoryParts> {
    if !(0.0..=1.0).contains(&amount) {
        return Err(Error::parameter("amount", format!("found {amount}, expected 0 to 1")));
    }
    let texels = a.index().len();
    if let Some(mask) = mask.filter(|mask| mask.len() != texels) {
        return Err(Error::parameter("mask", format!("found {} texels, expected {texels}", mask.len())));
    }
    if amount == 0.0 || mask.is_some_and(|mask| mask.iter().all(|v| *v == 0.0)) {
        return MemoryParts::copy(&**a.parts());
    }
    let Some(mask) = mask else {
        if amount == 1.0 {
            return exchange(a, b, matching, Keep::Nothing);
        }
        let mixed = mixtures(a, b, matching, &[amount])?;
        let changed: BTreeMap<usize, Vec<Vec3>> = mixed.into_iter().flatten().enumerate().collect();
        let origin: Vec<usize> = (0..a.count()).collect();
        return a.rebuilt(a.index().to_vec().into(), &origin, &changed);
    };
    masked(a, &mixtures(a, b, matching, &[0.5 * amount, amount])?, mask)
}

/// For each row its values at each amount.
fn mixtures(a: &Rows, b: &Rows, matching: &Matching, amounts: &[f32]) -> Result<Vec<Vec<Vec<Vec3>>>> {
    let geometry = Geometry::new(a.meta());
    let resampler = Resampler::new(b.meta(), a.meta())?;
    let of_row = |row: usize| {
        let first = Separated::new(&geometry, &a.values(row));
        let second = Separated::new(&geometry, &resampler.values(&b.values(matching.rows[row])));
        amounts.iter().map(|amount| mixture(&geometry, &first, &second, *amount)).collect()
    };
    Ok((0..a.count()).into_par_iter().map(of_row).collect())
}

fn mixture(geometry: &Geometry, a: &Separated, b: &Separated, t: f32) -> Vec<Vec3> {
    let model = |fit: &Reflectance| {
        let mut model = geometry.highlight(fit.alpha, fit.normal);
        model.iter_mut().for_each(|v| *v *= fit.strength);
        model
    };
    // a highlight that is not there is taken to be where the other one is
    let place = |own: &Reflectance, other: &Reflectance| if own.strength < FAINT { *other } else { *own };
    let (from, to) = (place(&a.fit, &b.fit), place(&b.fit, &a.fit));
    let between = Reflectance {
        albedo: Vec3::ZERO,
        strength: a.fit.strength + t * (b.fit.strength - a.fit.strength),
        alpha: (from.alpha.ln() + t * (to.alpha.ln() - from.alpha.ln())).exp(),
        normal: from.normal.lerp(to.normal, t).normalize(),
    };
    let (old, new, model) = (model(&a.fit), model(&b.fit), model(&between));
    let value = |pair: usize| {
        let diffuse = a.diffuse[pair].lerp(b.diffuse[pair], t);
        let rest = (1.0 - t) * (a.specular[pair] - old[pair]) + t * (b.specular[pair] - new[pair]);
        diffuse + (model[pair] + rest).max(0.0)
    };
    (0..geometry.len()).map(value).collect()
}

/// The first material plus the amount times one component plus its square times another.
fn masked(a: &Rows, mixed: &[Vec<Vec<Vec3>>], mask: &[f32]) -> Result<MemoryParts> {
    let rows = a.count();
    let (mut block, mut components) = (Vec::new(), Vec::new());
    for (row, mixed) in mixed.iter().enumerate() {
        let numbers = [&a.values(row), &mixed[0], &mixed[1]].map(|values| a.coded_in(values, Domain::Linear));
        let [start, middle, end] = &numbers;
        let each = |number: &dyn Fn(f32, f32, f32) -> f32| {
            let all = start.iter().zip(middle).zip(end);
            all.map(|((s, m), e)| f16::from_f32(number(*s, *m, *e))).collect::<Vec<f16>>()
        };
        block.extend(each(&|s, _, _| s));
        components.extend(each(&|s, m, e| 4.0 * m - 3.0 * s - e));
        components.extend(each(&|s, m, e| 2.0 * s - 4.0 * m + 2.0 * e));
    }
    let coefficients: Vec<f16> = mask.iter().flat_map(|w| [*w, w * w].map(f16::from_f32)).collect();
    let pair = [Axis::View, Axis::Light, Axis::Channel];
    let recipe = Recipe {
        planes: vec![PlaneSpec::index("index", rows), PlaneSpec::numbers("coefficients", 2, SampleType::F16)],
        tables: vec![
            TableSpec::new("block", &[&[Axis::Row(rows)], &pair[..]].concat(), SampleType::F16),
            TableSpec::new(
                "components",
                &[&[Axis::Row(rows), Axis::Component(2)], &pair[..]].concat(),
                SampleType::F16,
            ),
        ],
        value: Expr::Sum(vec![Expr::Table { table: 0, row: Some(0) }, Expr::Dot { plane: 1, table: 1, row: Some(0) }]),
        curve: Curve::Linear,
    };
    let planes = vec![Numbers::Index(a.index().to_vec().into()), Numbers::F16(coefficients.into())];
    MemoryParts::new(
        a.meta().clone(),
        recipe,
        planes,
        vec![Numbers::F16(block.into()), Numbers::F16(components.into())],
    )
}

/// Interpolates rows of one material at the directions of another.
struct Resampler {
    lights: Vec<Stencil>,
    views: Vec<Stencil>,
    /// Lights of the rows.
    count: usize,
    same: bool,
}

impl Resampler {
    fn new(from: &BtfMeta, to: &BtfMeta) -> Result<Self> {
        let stencils = |from: &DirectionSet, to: &DirectionSet| -> Result<Vec<Stencil>> {
            let interpolator = Interpolator::new(from, Scheme::Triangles)?;
            Ok(to.directions().iter().map(|w| interpolator.stencil(*w)).collect())
        };
        Ok(Self {
            lights: stencils(&from.lights, &to.lights)?,
            views: stencils(&from.views, &to.views)?,
            count: from.lights.len(),
            same: from.lights == to.lights && from.views == to.views,
        })
    }

    fn values(&self, values: &[Vec3]) -> Vec<Vec3> {
        if self.same {
            return values.to_vec();
        }
        let at = |view: &Stencil, light: &Stencil| -> Vec3 {
            let of_view = |(v, weight): (usize, f32)| -> Vec3 {
                weight * light.iter().map(|(l, weight)| values[v * self.count + l] * weight).sum::<Vec3>()
            };
            view.iter().map(of_view).sum::<Vec3>() * light.fade
        };
        self.views.iter().flat_map(|view| self.lights.iter().map(move |light| at(view, light))).collect()
    }
}

/// The mean difference, in display values, between rows of a material and the same interpolated at other directions and back; 0
/// if the directions are the same.
///
/// # Errors
/// [`Error::Parameter`] if the directions cannot be interpolated.
pub fn resampling_error(rows: &Rows, to: &BtfMeta) -> Result<f64> {
    let (there, back) = (Resampler::new(rows.meta(), to)?, Resampler::new(to, rows.meta())?);
    if there.same {
        return Ok(0.0);
    }
    let shown = |v: f32| Encoding::Srgb.encode(v.clamp(0.0, 1.0));
    let step = rows.count().div_ceil(COMPARED);
    let (mut sum, mut count) = (0.0, 0.0);
    for row in (0..rows.count()).step_by(step) {
        let values = rows.values(row);
        for (a, b) in values.iter().zip(back.values(&there.values(&values))) {
            sum += f64::from((a.map(shown) - b.map(shown)).abs().element_sum());
            count += 3.0;
        }
    }
    Ok(sum / count)
}
