//! Optimal transport between two weighted sets: which mass goes where, so that the total cost is least.
//!
//! Choose [`plan`]; it is exact. [`regularised`] spreads mass over similar targets, for those who want a soft plan.
//!
//! # Model
//! Minimise the sum of f_ij c_ij over flows f_ij >= 0 whose row sums are the masses of the sources and whose column sums
//! are those of the targets. Both sets of masses are normalised to 1 first. The potentials u and v of the plan prove that
//! it is optimal: u_i + v_j <= c_ij everywhere, with equality wherever mass flows.
//!
//! # Limits
//! Masses are rounded to multiples of 2^-52 of their sum, so that sums of flows are exact. [`memory`] says what a plan takes.
//!
//! # References
//! peyre2019

mod network;
mod sinkhorn;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use crate::{Error, Result};

pub use sinkhorn::regularised;

/// The largest number of sources or targets: as many as an index image can distinguish.
pub const MAX_NODES: usize = 1 << 16;

/// Costs are kept in memory up to this many bytes, and computed again whenever they are needed beyond.
const KEPT_BYTES: u64 = 640 << 20;

/// Units that masses are rounded to.
const UNITS: f64 = (1u64 << 52) as f64;

/// The cost of moving a unit of mass from a source to a target.
pub type Cost<'a> = &'a (dyn Fn(usize, usize) -> f64 + Sync);

/// Mass that moves from a source to a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flow {
    /// The source.
    pub from: usize,
    /// The target.
    pub to: usize,
    /// The mass, where all sources together have 1.
    pub mass: f64,
}

/// A transport plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Positive flows, by source and then by target.
    pub flows: Vec<Flow>,
    /// The total cost.
    pub cost: f64,
    /// The potentials of the sources and of the targets.
    pub potentials: [Vec<f64>; 2],
}

impl Plan {
    /// The target that most of the mass of each source goes to, the first of several equal ones; `None` for a source without
    /// mass.
    pub fn largest(&self, sources: usize) -> Vec<Option<usize>> {
        let mut best: Vec<Option<Flow>> = vec![None; sources];
        for flow in &self.flows {
            let best = &mut best[flow.from];
            if best.is_none_or(|best| flow.mass > best.mass) {
                *best = Some(*flow);
            }
        }
        best.into_iter().map(|best| best.map(|flow| flow.to)).collect()
    }
}

/// Memory of [`plan`] in bytes for this many sources and targets, apart from the program itself.
pub fn memory(sources: usize, targets: usize) -> u64 {
    let (n, m) = (sources as u64, targets as u64);
    let kept = if kept(sources, targets) { 8 * n * m } else { 8 * m * rayon::current_num_threads() as u64 };
    kept + network::NODE_BYTES * (n + m) + network::CANDIDATE_BYTES * n
}

/// Whether the costs are kept in memory.
fn kept(sources: usize, targets: usize) -> bool {
    8 * sources as u64 * targets as u64 <= KEPT_BYTES
}

/// The plan of least cost between sources and targets of these masses. Where several are best, the numbers of rows decide,
/// so the same arguments give the same plan, for any number of threads.
///
/// # Errors
/// [`Error::Parameter`] if there are no or too many masses, one is negative or not finite, all are zero, or a cost is not
/// finite; [`Error::NotConverged`] if rounding prevents the end.
pub fn plan(sources: &[f64], targets: &[f64], cost: Cost) -> Result<Plan> {
    let units = [("sources", sources), ("targets", targets)].map(|(name, masses)| units(name, masses));
    let [sources, targets] = units;
    let costs = Costs::new(sources.as_ref().map_or(0, Vec::len), targets.as_ref().map_or(0, Vec::len), cost);
    network::solve(&sources?, &targets?, &costs?)
}

/// Masses as whole numbers of units, which add up to [`UNITS`]: differences of rounded sums.
fn units(name: &str, masses: &[f64]) -> Result<Vec<i64>> {
    let wrong = |problem: String| Err(Error::parameter(name, problem));
    if !(1..=MAX_NODES).contains(&masses.len()) {
        return wrong(format!("found {} masses, expected 1 to {MAX_NODES}", masses.len()));
    }
    if let Some(at) = masses.iter().position(|mass| !(0.0..f64::INFINITY).contains(mass)) {
        return wrong(format!("mass {at} is {}, expected a finite number of at least 0", masses[at]));
    }
    let sum: f64 = masses.iter().sum();
    if !(sum > 0.0 && sum.is_finite()) {
        return wrong(format!("the masses add up to {sum}"));
    }
    let (mut so_far, mut before) = (0.0, 0);
    Ok(masses
        .iter()
        .map(|mass| {
            so_far += mass;
            let rounded = (so_far / sum * UNITS).round() as i64;
            rounded - std::mem::replace(&mut before, rounded)
        })
        .collect())
}

/// The costs, row by row.
struct Costs<'a> {
    cost: Cost<'a>,
    targets: usize,
    /// (source, target), if they are kept.
    all: Option<Vec<f64>>,
    /// The largest magnitude.
    largest: f64,
}

impl<'a> Costs<'a> {
    fn new(sources: usize, targets: usize, cost: Cost<'a>) -> Result<Self> {
        let fill = |source: usize, row: &mut [f64]| {
            row.iter_mut().enumerate().for_each(|(target, out)| *out = cost(source, target));
            // the maximum of IEEE skips what is not a number
            row.iter().fold(0.0f64, |most, c| if c.is_finite() { most.max(c.abs()) } else { f64::INFINITY })
        };
        let (all, most) = if kept(sources, targets) {
            let mut all = vec![0.0; sources * targets];
            let rows = all.par_chunks_exact_mut(targets.max(1)).enumerate();
            let most: Vec<f64> = rows.map(|(source, row)| fill(source, row)).collect();
            (Some(all), most)
        } else {
            let row = |row: &mut Vec<f64>, source: usize| fill(source, row);
            (None, (0..sources).into_par_iter().map_init(|| vec![0.0; targets], row).collect())
        };
        match most.iter().position(|most| !most.is_finite()) {
            Some(source) => Err(Error::parameter("cost", format!("a cost of source {source} is not finite"))),
            None => Ok(Self { cost, targets, all, largest: most.into_iter().fold(0.0, f64::max) }),
        }
    }

    /// The costs of a source; `buffer` has room for them if they are not kept.
    fn row<'b>(&'b self, source: usize, buffer: &'b mut Vec<f64>) -> &'b [f64] {
        if let Some(all) = &self.all {
            return &all[source * self.targets..][..self.targets];
        }
        buffer.clear();
        buffer.extend((0..self.targets).map(|target| (self.cost)(source, target)));
        buffer
    }
}
