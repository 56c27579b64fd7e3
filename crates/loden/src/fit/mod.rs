//! Fits of analytic models to measured BRDFs: [`fit`] searches all parameters, [`refit`] starts from known ones.

mod data;
mod free;
mod levenberg;
mod linear;
mod search;

pub use data::{Data, MAX_SAMPLES, Metric};
pub use free::Free;
#[cfg(feature = "renderers")]
pub(crate) use free::Layout;
pub(crate) use levenberg::minimise;

use std::time::Instant;

use rayon::prelude::*;

use crate::model::{Analytic, Model};
use crate::params::Values;
use crate::progress::{Progress, Task};
use crate::{Error, Result};
use search::{Candidate, Search, distinct_minima};

/// Number of candidates improved by a few steps, for each start and each minimum wanted.
const CANDIDATES_PER_START: usize = 4;
/// Rounds of the search for deeper minima.
const ROUNDS: usize = 3;
/// Candidates are first judged on one in this many samples, but on at least [`SCOUT_SAMPLES`].
const SCOUT_FRACTION: usize = 4;
const SCOUT_SAMPLES: usize = 256;

/// Options of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The error that is minimised.
    pub metric: Metric,
    /// Minimum number of starting points.
    pub starts: usize,
    /// Seed of the starting points.
    pub seed: u64,
    /// Number of lobes, for models that can have several.
    pub lobes: usize,
    /// Whether the surface may be anisotropic. If not, parameters along tangent and bitangent are kept equal.
    pub anisotropic: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { metric: Metric::Cosine, starts: 12, seed: 0, lobes: 1, anisotropic: false }
    }
}

/// A model fitted to data.
#[derive(Debug)]
pub struct Fit {
    /// The model with its parameters.
    pub brdf: Analytic,
    /// Value of the metric.
    pub error: f64,
    /// Value of the metric, relative to that of a black material.
    pub relative_error: f64,
    /// Number of evaluations of the model over all data.
    pub evaluations: usize,
    /// Duration in seconds.
    pub seconds: f64,
}

/// Fits a model to data.
///
/// # Model
/// Multistart Levenberg-Marquardt. The default parameters and quasi-random starting points are judged on a quarter of
/// the samples. The best of them are improved there by a few steps within the bounds of the parameter table, and the
/// best of these are then improved on all samples until they converge. From the best minima, one parameter at a time is
/// moved elsewhere and the search repeated, as long as it finds a deeper minimum. For the cosine-weighted metric, the
/// colours, in which the model is linear, are solved for exactly at every step (variable projection); for the other
/// metrics, they are searched with the other parameters, from that solution.
///
/// # Limits
/// A refractive index is the same for all channels. At most [`MAX_SAMPLES`] samples are used, spread evenly.
///
/// # References
/// golub1973, marquardt1963, ngan2005 (the metric)
///
/// # Errors
/// [`Error::Parameter`] if no sample is usable or an option is out of range; [`Error::Cancelled`].
pub fn fit(
    model: &'static dyn Model,
    fixed: &Values,
    data: &Data,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Fit> {
    if options.starts == 0 {
        return Err(Error::parameter("starts", "found 0, expected at least 1"));
    }
    let start = Instant::now();
    let search = Search::new(model, fixed, data, options)?;
    let few = data.thinned((data.len() / SCOUT_FRACTION).max(SCOUT_SAMPLES));
    let scout = Search::new(model, fixed, &few, options)?;
    let each = |candidates: Vec<Candidate>, work: &(dyn Fn(Candidate) -> Candidate + Sync)| -> Result<Vec<Candidate>> {
        let task = Task::new(progress, model.name(), candidates.len() as u64);
        let one = |candidate| task.advance(1).map(|()| work(candidate));
        candidates.into_par_iter().map(one).collect()
    };
    // a few starts suffice for one or two parameters; further parameters bring more minima
    let beyond = search.dimensions().saturating_sub(2);
    let count = beyond * (beyond + 1) / 2;
    let candidates = scout.candidates(CANDIDATES_PER_START * options.starts * count.max(1), options.seed)?;
    let near = distinct_minima(each(candidates, &|candidate| scout.approach(candidate))?, options.starts + 2 * count);
    // sorting is stable, so the number of threads does not change the result
    let mut known = distinct_minima(each(near, &|candidate| search.improve(candidate))?, count.max(1));
    let mut best = known.first().cloned().ok_or_else(|| Error::not_converged("the search for a minimum"))?;
    for _ in 0..if count > 0 { ROUNDS } else { 0 } {
        let aside = known.iter().flat_map(|candidate| search.displaced(candidate)).collect();
        let near = distinct_minima(each(aside, &|candidate| scout.approach(candidate))?, 2 * count);
        known = distinct_minima(each(near, &|candidate| search.improve(candidate))?, count);
        known.retain(|candidate| candidate.cost < 0.999 * best.cost);
        let Some(deeper) = known.first() else { break };
        best = deeper.clone();
    }
    let evaluations = search.evaluations() + scout.evaluations() * few.len() / data.len();
    let brdf = search.material(&best)?;
    let error = data.error(&brdf, options.metric);
    let scale = data.scale(options.metric).max(f64::MIN_POSITIVE);
    Ok(Fit { brdf, error, relative_error: error / scale, evaluations, seconds: start.elapsed().as_secs_f64() })
}

/// As [`fit`], but starts from the best of the given parameters instead of searching for starting points.
///
/// # Errors
/// [`Error::Parameter`] if `starts` is empty or an option is out of range.
pub fn refit(model: &'static dyn Model, data: &Data, options: &Options, starts: &[&Values]) -> Result<Analytic> {
    let first = starts.first().ok_or_else(|| Error::parameter("starts", "found 0, expected at least 1"))?;
    let search = Search::new(model, first, data, options)?;
    let candidates = starts.iter().map(|values| search.candidate(values)).collect::<Result<Vec<_>>>()?;
    let best = candidates
        .into_iter()
        .min_by(|a, b| a.cost.total_cmp(&b.cost))
        .ok_or_else(|| Error::parameter("starts", "found 0, expected at least 1"))?;
    search.material(&search.improve(best))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::{Brdf, BrdfSample};
    use crate::model::{MODELS, by_name};
    use crate::progress::Silent;

    fn noisy(samples: Vec<BrdfSample>, noise: f32) -> Vec<BrdfSample> {
        let mut state = 1u32;
        let jitter = |mut s: BrdfSample| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            s.value *= 1.0 + noise * ((state >> 8) as f32 / (1u32 << 23) as f32 - 1.0);
            s
        };
        samples.into_iter().map(jitter).collect()
    }

    fn truth(name: &str, given: &[(&str, &str)]) -> Analytic {
        let model = by_name(name).unwrap();
        Analytic::new(model, Values::new(model.params(), given.iter().copied()).unwrap()).unwrap()
    }

    #[test]
    fn every_model_recovers_its_own_parameters() {
        for model in MODELS {
            let brdf = Analytic::new(*model, Values::defaults(model.params())).unwrap();
            let few: Vec<_> = brdf.samples().into_iter().step_by(7).collect();
            let data = Data::new(&few).unwrap();
            for &metric in Metric::ALL {
                let options = Options { metric, seed: 3, starts: 2, ..Options::default() };
                let fit = fit(*model, &Values::defaults(model.params()), &data, &options, &Silent).unwrap();
                println!("{} {metric:?}: {:.2e} in {} evaluations", model.name(), fit.relative_error, fit.evaluations);
                // the refractive index and the factor of a Fresnel term are almost interchangeable
                assert!(fit.relative_error < 1e-3, "{} {metric:?}: {}", model.name(), fit.relative_error);
            }
        }
    }

    #[test]
    fn parameters_are_recovered_from_noise() {
        let brdf =
            truth("ward", &[("alpha-x", "0.12"), ("alpha-y", "0.3"), ("kd", "0.3,0.2,0.05"), ("ks", "0.2,0.25,0.3")]);
        let data = Data::new(&noisy(brdf.samples(), 0.1)).unwrap();
        let options = Options { anisotropic: true, ..Options::default() };
        let model = by_name("ward").unwrap();
        let fit = fit(model, &Values::defaults(model.params()), &data, &options, &Silent).unwrap();
        let values = fit.brdf.values();
        for (name, expected) in [("alpha-x", 0.12), ("alpha-y", 0.3)] {
            let found: f64 = values.get(name).unwrap();
            assert!((found / expected - 1.0).abs() < 0.02, "{name}: {found}");
        }
        for (name, expected) in [("kd", [0.3, 0.2, 0.05]), ("ks", [0.2, 0.25, 0.3])] {
            let found: [f64; 3] = values.get(name).unwrap();
            let worst = (0..3).map(|c: usize| (found[c] - expected[c]).abs()).fold(0.0, f64::max);
            assert!(worst < 0.01, "{name}: {found:?}");
        }
    }

    #[test]
    fn the_right_model_ranks_first() {
        let brdf = truth("ggx", &[("alpha-x", "0.2"), ("alpha-y", "0.2"), ("kd", "0.1"), ("metal", "copper")]);
        let data = Data::new(&noisy(brdf.samples(), 0.02)).unwrap();
        let error = |name: &str| {
            let model = by_name(name).unwrap();
            fit(model, &Values::defaults(model.params()), &data, &Options::default(), &Silent).unwrap().relative_error
        };
        let (right, wrong, worst) = (error("ggx"), error("ward"), error("lambert"));
        assert!(right < 0.05 && right < 0.7 * wrong && wrong < worst, "{right} {wrong} {worst}");
    }

    #[test]
    fn threads_do_not_change_the_result() {
        let brdf = truth("ashikhmin-shirley", &[("nu", "40"), ("nv", "40")]);
        let data = Data::new(&noisy(brdf.samples(), 0.2)).unwrap();
        let model = by_name("phong").unwrap();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| fit(model, &Values::defaults(model.params()), &data, &Options::default(), &Silent).unwrap())
        };
        let (one, two) = (run(1), run(2));
        assert_eq!(one.brdf.values(), two.brdf.values());
        assert_eq!(one.error, two.error);
    }

    #[test]
    fn unusable_data_are_refused() {
        assert!(Data::new(&[]).unwrap_err().to_string().contains("samples"));
        let below = BrdfSample { wi: glam::Vec3::NEG_Z, wo: glam::Vec3::Z, value: glam::Vec3::ONE };
        assert!(Data::new(&[below]).is_err());
    }
}
