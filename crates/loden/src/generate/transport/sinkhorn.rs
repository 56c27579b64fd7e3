//! Regularised transport by Sinkhorn's iteration in the log domain.

use rayon::prelude::*;

use super::{Cost, Costs, Flow, Plan, UNITS, units};
use crate::{Error, Result};

/// Iterations after which the sums of the plan must be right.
const ITERATIONS: usize = 20_000;

/// Largest sum of the differences between the masses of the targets and those of the plan.
const CLOSE: f64 = 1e-9;

/// Flows below this part of all mass are left out.
const LEAST: f64 = 1e-15;

/// The plan that minimises the cost minus `epsilon` times the entropy of the flows. It blurs: mass goes to all targets whose
/// cost is within a few `epsilon` of the best.
///
/// # Model
/// f_ij = exp((u_i + v_j - c_ij) / epsilon); u and v are fitted in turn to the masses of the sources and of the targets, as
/// logarithms of sums of exponentials, which neither overflow nor vanish.
///
/// # Limits
/// The costs are kept in memory. The iteration is slow where `epsilon` is below about a thousandth of the costs.
///
/// # Errors
/// As [`super::plan`]; [`Error::Parameter`] if `epsilon` is not positive; [`Error::NotConverged`].
///
/// # References
/// cuturi2013, peyre2019
pub fn regularised(sources: &[f64], targets: &[f64], cost: Cost, epsilon: f64) -> Result<Plan> {
    if !(epsilon > 0.0 && epsilon.is_finite()) {
        return Err(Error::parameter("epsilon", format!("found {epsilon}, expected a number above 0")));
    }
    let [a, b] = [units("sources", sources)?, units("targets", targets)?];
    let [a, b] = [a, b].map(|units| units.iter().map(|&m| (m as f64 / UNITS).ln()).collect::<Vec<f64>>());
    let costs = Costs::new(a.len(), b.len(), cost)?;
    let all: Vec<f64> = (0..a.len()).flat_map(|i| costs.row(i, &mut Vec::new()).to_vec()).collect();
    let turned: Vec<f64> = (0..b.len()).flat_map(|j| all[j..].iter().step_by(b.len()).copied()).collect();
    // one half of an iteration: the potentials for which the sums over the other side are right
    let fit = |costs: &[f64], masses: &[f64], others: &[f64]| -> Vec<f64> {
        let of_row = |(row, mass): (&[f64], &f64)| match mass.is_finite() {
            true => epsilon * (mass - log_sum(row.iter().zip(others).map(|(c, v)| (v - c) / epsilon))),
            false => f64::NEG_INFINITY,
        };
        costs.par_chunks_exact(others.len()).zip(masses).map(of_row).collect()
    };
    let mut v = vec![0.0; b.len()];
    v.iter_mut().zip(&b).filter(|(_, b)| b.is_infinite()).for_each(|(v, _)| *v = f64::NEG_INFINITY);
    for _ in 0..ITERATIONS {
        let u = fit(&all, &a, &v);
        let next = fit(&turned, &b, &u);
        // column sums of the plan of u and the old v are b exp((v - next) / epsilon)
        let wrong = |((b, v), next): ((&f64, &f64), &f64)| match b.is_finite() {
            true => (b.exp() * ((v - next) / epsilon).exp_m1()).abs(),
            false => 0.0,
        };
        let off: f64 = b.iter().zip(&v).zip(&next).map(wrong).sum();
        if off <= CLOSE {
            return Ok(collected(&all, u, v, epsilon));
        }
        v = next;
    }
    Err(Error::not_converged("the regularised transport plan"))
}

/// ln of the sum of exponentials.
fn log_sum(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = values.clone().fold(f64::NEG_INFINITY, f64::max);
    most + values.map(|v| (v - most).exp()).sum::<f64>().ln()
}

fn collected(all: &[f64], u: Vec<f64>, v: Vec<f64>, epsilon: f64) -> Plan {
    let (mut flows, mut cost) = (Vec::new(), 0.0);
    for (from, row) in all.chunks_exact(v.len()).enumerate() {
        for (to, c) in row.iter().enumerate() {
            let mass = ((u[from] + v[to] - c) / epsilon).exp();
            if mass > LEAST {
                cost += mass * c;
                flows.push(Flow { from, to, mass });
            }
        }
    }
    Plan { flows, cost, potentials: [u, v] }
}
