//! Fit an analytic model to measured reflectance.

use loden::direction::from_angles;
use loden::fit::{Data, Options, fit};
use loden::material::BrdfSample;
use loden::model::{self, Analytic};
use loden::params::Values;
use loden::progress::Silent;

fn main() -> loden::Result<()> {
    // samples of a known material, so that the result can be judged; those of a file come from `Brdf::samples`
    let ggx = model::by_name("ggx")?;
    let truth = Analytic::new(ggx, Values::new(ggx.params(), [("alpha-x", "0.2"), ("alpha-y", "0.2")])?)?;
    let mut samples = Vec::new();
    for (i, o, k) in (0..8).flat_map(|i| (0..8).flat_map(move |o| (0..12).map(move |k| (i, o, k)))) {
        let wi = from_angles(0.15 * i as f32, 0.0);
        let wo = from_angles(0.15 * o as f32, 0.5 * k as f32);
        let value = truth.brdf(wi.as_dvec3(), wo.as_dvec3()).as_vec3(); // 1/sr, without the cosine
        samples.push(BrdfSample { wi, wo, value });
    }

    let data = Data::new(&samples)?;
    for name in ["ggx", "ward", "lambert"] {
        let model = model::by_name(name)?;
        let found = fit(model, &Values::defaults(model.params()), &data, &Options::default(), &Silent)?;
        let params: Vec<_> = found.brdf.values().iter().map(|(name, value)| format!("{name} {value}")).collect();
        println!("{name}: relative error {:.4}; {}", found.relative_error, params.join(", "));
    }
    Ok(())
}
