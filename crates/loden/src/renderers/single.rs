//! BRDFs as materials of one texel, which every exporter takes.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::Result;
use crate::btf::{BtfMeta, Cosine, SampleType};
use crate::codec::parts::{Axis, Curve, Expr, MemoryParts, Numbers, PlaneSpec, Recipe, TableSpec};
use crate::color::Encoding;
use crate::direction::{DirectionSet, cosine_hemisphere};
use crate::fit::{Free, Options};
use crate::material::{Brdf, Material};
use crate::model::Analytic;
use crate::progress::{Progress, Task};
use crate::random::Stream;

/// Views, and lights, of a tabulated BRDF: 3.5 degrees from one to the next.
const DIRECTIONS: usize = 1500;

/// Polar angle of the lowest of them, degrees.
const LOWEST: f64 = 88.0;

/// Points at which the difference of materials is measured.
const PAIRS: usize = 20_000;

/// What [`Curve::Log`] adds before the logarithm.
const FLOOR: f32 = 0.001;

/// An analytic BRDF by its parameters: nothing is lost but digits beyond single precision. `None` if a parameter cannot be kept: one
/// that fits hold constant, or a value outside the range of fits.
///
/// # Errors
/// [`crate::Error::Parameter`] if the values do not belong to the model.
pub fn of_model(brdf: &Analytic) -> Result<Option<MemoryParts>> {
    let (model, values) = (brdf.model(), brdf.values());
    let has_lobes = model.params().iter().any(|param| param.name == "lobes");
    let lobes = if has_lobes { values.get("lobes")? } else { 1 };
    let free = Free::new(model, &Options { lobes, anisotropic: true, ..Options::default() })?;
    let numbers = free.numbers(values)?;
    let kept = Analytic::new(model, free.values(&numbers)?)?;
    let mut random = Stream::new(1);
    let mut is_kept = || {
        let [wi, wo] = [(); 2].map(|()| cosine_hemisphere(Vec2::new(random.next(), random.next())).as_dvec3());
        let (found, expected) = (kept.brdf(wi, wo), brdf.brdf(wi, wo));
        (found - expected).abs().max_element() <= 1e-4 * expected.max_element().max(1e-3)
    };
    if !(0..64).all(|_| is_kept()) {
        return Ok(None);
    }
    let plane = PlaneSpec::numbers("parameters", free.count(), SampleType::F32);
    let value = Expr::Model { name: model.name().into(), lobes, grain: true, plane: 0 };
    let recipe = Recipe { planes: vec![plane], tables: Vec::new(), value, curve: Curve::Brdf };
    let directions = DirectionSet::bonn81();
    MemoryParts::new(meta(&directions), recipe, vec![Numbers::F32(numbers.into())], Vec::new()).map(Some)
}

/// Any BRDF as a table over directions, spread evenly over the hemisphere; logarithms are interpolated between them.
///
/// # Errors
/// Errors of the BRDF; [`crate::Error::Cancelled`].
pub fn tabulated(brdf: &dyn Brdf, progress: &dyn Progress) -> Result<MemoryParts> {
    let set = spread(DIRECTIONS)?;
    let (directions, task) = (set.directions(), Task::new(progress, "tabulate", DIRECTIONS as u64));
    let row = |wo: &Vec3| {
        task.advance(1)?;
        let value = |wi: &Vec3| PI * brdf.eval(Vec2::splat(0.5), *wi, *wo).max(Vec3::ZERO);
        Ok(directions.iter().flat_map(|wi| (value(wi) + FLOOR).to_array().map(f32::ln)).collect::<Vec<f32>>())
    };
    let rows = directions.par_iter().map(row).collect::<Result<Vec<_>>>()?;
    brdf.check()?;
    let spec = TableSpec::new("brdf", &[Axis::View, Axis::Light, Axis::Channel], SampleType::F32);
    let recipe = Recipe { planes: Vec::new(), tables: vec![spec], value: Expr::table(0), curve: Curve::Log };
    MemoryParts::new(meta(&set), recipe, Vec::new(), vec![Numbers::F32(rows.concat().into())])
}

/// The mean difference of two materials' apparent values, relative to the mean of the first, over 20000 random texture coordinates with a
/// pair of cosine-distributed directions each. The same points are used each time.
pub fn difference(original: &dyn Material, other: &dyn Material) -> f32 {
    let (mut random, mut sum, mut whole) = (Stream::new(2), 0.0f64, 0.0f64);
    for _ in 0..PAIRS {
        let mut direction = || cosine_hemisphere(random.next2());
        let (wi, wo) = (direction(), direction());
        let uv = random.next2();
        let [a, b] = [original, other].map(|material| material.apparent(uv, wi, wo));
        sum += f64::from((a - b).abs().element_sum());
        whole += f64::from(a.abs().element_sum());
    }
    (sum / whole.max(1e-30)) as f32
}

/// One texel.
fn meta(directions: &DirectionSet) -> BtfMeta {
    BtfMeta {
        width: 1,
        height: 1,
        views: directions.clone(),
        lights: directions.clone(),
        encoding: Encoding::Linear,
        cosine: Cosine::Excluded,
        sample_type: SampleType::F32,
    }
}

/// The normal, and a spiral of equal areas around it.
fn spread(count: usize) -> Result<DirectionSet> {
    let golden = 180.0 * (3.0 - 5.0f64.sqrt());
    let lowest = LOWEST.to_radians().cos();
    let on_spiral = |k: usize| {
        let z = 1.0 - (1.0 - lowest) * k as f64 / (count - 1) as f64;
        [z.acos().to_degrees(), (golden * k as f64) % 360.0]
    };
    DirectionSet::from_degrees((0..count).map(on_spiral).collect())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::model_in;
    use super::*;
    use crate::codec::Decoded;
    use crate::codec::parts::Parts as _;
    use crate::direction::Scheme;
    use crate::material::TabulatedBrdf;
    use crate::model::by_name;
    use crate::params::Values;
    use crate::progress::Silent;

    fn analytic(name: &str, given: &[(&str, &str)]) -> Analytic {
        let model = by_name(name).unwrap();
        Analytic::new(model, Values::new(model.params(), given.iter().copied()).unwrap()).unwrap()
    }

    fn material(parts: MemoryParts) -> Arc<dyn Material> {
        Decoded::new(Arc::new(parts)).unwrap().material(Scheme::Triangles).unwrap()
    }

    #[test]
    fn a_model_is_kept_exactly() {
        let ward = analytic("ward", &[("alpha-x", "0.15"), ("alpha-y", "0.5"), ("kd", "0.2,0.1,0"), ("ks", "0.3")]);
        let parts = of_model(&ward).unwrap().unwrap();
        assert_eq!(model_in(&parts.recipe().value), Some("ward"));
        assert!(difference(&ward, &*material(parts)) < 1e-5);
        let lafortune = analytic("lafortune", &[("lobes", "2"), ("exponent-2", "7"), ("ks-2", "0.1,0.2,0.3")]);
        assert!(difference(&lafortune, &*material(of_model(&lafortune).unwrap().unwrap())) < 1e-5);
    }

    #[test]
    fn a_table_resolves_a_broad_lobe_and_states_what_it_loses_of_a_narrow_one() {
        let loss = |alpha: &str| {
            let ward = analytic("ward", &[("alpha-x", alpha), ("alpha-y", alpha), ("kd", "0.2"), ("ks", "0.3")]);
            difference(&ward, &*material(tabulated(&ward, &Silent).unwrap()))
        };
        let (broad, narrow) = (loss("0.4"), loss("0.05"));
        assert!(broad < 0.02 && narrow > 2.0 * broad, "{broad} {narrow}");
        let table =
            TabulatedBrdf::new(&meta(&DirectionSet::bonn81()), vec![Vec3::splat(0.3); 81 * 81], Scheme::Triangles);
        let table = table.unwrap();
        assert!(difference(&table, &*material(tabulated(&table, &Silent).unwrap())) < 1e-3);
    }
}
