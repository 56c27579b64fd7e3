//! Chained matrix factorisation: the remainder of one factorisation is factored again over other directions, then all
//! tables are fitted jointly.

use glam::Vec3;
use rayon::prelude::*;

use super::joint::{Fit, Samples, Step};
use super::matrix::{Matrix, row_means, singular_pair};
use super::tables::{Factored, Grid, ProductSum, Projection};
use super::{Factorisation, METRIC, Metric, RESOLUTION, TERMS};
use crate::Result;
use crate::material::Material;
use crate::params::{Param, Params, Values};
use crate::progress::{Progress, Task};

/// # Model
/// f = F1(H, D) F2(light, view) F3(H, D) ..., each a sum of products of two tables. F1 is the singular value
/// decomposition of f, F2 that of the quotient f / F1 over light and view, and so on. Of three factors the first step is
/// a table of H alone, the mean over D: g(H) p(light) q(view). With an odd number above, the last step is a single table.
///
/// That chain is where the fit begins: a quotient knows nothing of what later steps can do, and those of dark pairs
/// dominate it. In turn every table is set to the least-squares solution of all samples for given other tables (alternating
/// least squares), until the error settles. The fit also begins at the best chains with one term less and with fewer
/// factors, so that a further term or factor never makes the error larger; only three factors may be worse than two, as
/// they leave D out.
///
/// # Limits
/// Finds a local minimum. Tables may be negative in places. With one term, tables over the same direction merge, so that
/// more than four factors need several terms to be of use.
///
/// # References
/// suykens2003 (section 4)
pub(super) struct Cmf;

crate::params! {
    struct Options {
        resolution: usize => RESOLUTION,
        terms: usize => TERMS,
        /// Number of tables in the chain, for one term.
        factors: usize [2..=8] = 4,
        metric: Metric => METRIC,
    }
}

impl Factorisation for Cmf {
    fn name(&self) -> &'static str {
        "cmf"
    }

    fn doc(&self) -> &'static str {
        "Chained matrix factorisation, over half and difference vectors and over light and view in turn, fitted jointly."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        let Options { resolution: size, terms, factors, metric } = Options::from_values(values)?;
        let samples = Samples::of(brdf, size, factors * terms * size * size)?;
        let matrices = Matrices::of(brdf, size, progress)?;
        let plans = plans(factors);
        let task = Task::new(progress, "factor", (3 * terms * plans.len()) as u64);
        let channel = |channel: usize| {
            let search = Search { fit: samples.channel(channel, metric), size, task: &task };
            let published = |factors| matrices.published(factors, channel, samples.scale[channel]);
            Ok(search.best(&plans, terms, &published)?.pop().unwrap_or_default().1)
        };
        let chains: Vec<Vec<Step>> = (0..3).into_par_iter().map(channel).collect::<Result<_>>()?;
        Ok(Factored::Product(assembled(&chains, size, samples.scale)))
    }
}

/// The projections of each step for a number of factors; a step of one factor has one table.
fn steps(factors: usize) -> Vec<([Projection; 2], bool)> {
    let pair = |k: usize| match k % 2 {
        0 => [Projection::Half, Projection::Difference],
        _ => [Projection::Light, Projection::View],
    };
    match factors {
        3 => vec![(pair(0), true), (pair(1), false)],
        _ => (0..factors.div_ceil(2)).map(|k| (pair(k), 2 * k + 1 == factors)).collect(),
    }
}

/// The numbers of factors that lead to `factors`, which are last, and are contained in those after them.
fn plans(factors: usize) -> Vec<usize> {
    match factors {
        2 | 3 => vec![factors],
        _ => (2..=factors).collect(),
    }
}

/// The search for the chain of one channel.
struct Search<'a> {
    fit: Fit<'a>,
    size: usize,
    task: &'a Task<'a>,
}

/// A chain and its squared error.
type Chain = (f64, Vec<Step>);

impl Search<'_> {
    /// The best chain for each number of factors and this number of terms. `published` is the chain of the literature, of
    /// one term.
    fn best(
        &self,
        plans: &[usize],
        terms: usize,
        published: &(dyn Fn(usize) -> Result<Vec<Step>> + Sync),
    ) -> Result<Vec<Chain>> {
        // the best chains with one term less
        let mut known: Vec<Chain> = Vec::new();
        for terms in 1..=terms {
            let mut found: Vec<Chain> = Vec::new();
            for (k, &factors) in plans.iter().enumerate() {
                let mut starts = if terms == 1 { vec![published(factors)?] } else { Vec::new() };
                starts.extend(known.get(k).map(|(_, chain)| self.with_term(chain)));
                for (before, (_, chain)) in plans.iter().zip(&found) {
                    starts.extend(self.extended(chain, *before, factors, terms));
                }
                let improved = starts.into_iter().map(|mut chain| {
                    let error = self.fit.improve(&mut chain, self.task)?;
                    Ok((error, chain))
                });
                let improved = improved.collect::<Result<Vec<Chain>>>()?;
                found.extend(improved.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)));
                self.task.advance(1)?;
            }
            known = found;
        }
        Ok(known)
    }

    /// The same chain with one more term in every sum, which is 0.
    fn with_term(&self, chain: &[Step]) -> Vec<Step> {
        let mut chain = chain.to_vec();
        chain.iter_mut().filter(|step| !step.is_single()).for_each(|step| step.add_term(self.size));
        chain
    }

    /// The same chain with more factors, those added being 1; `None` if it is not contained in them.
    fn extended(&self, chain: &[Step], before: usize, factors: usize, terms: usize) -> Option<Vec<Step>> {
        let contained = before + 1 == factors && before != 2 || (before, factors) == (2, 4);
        let plan = contained.then(|| steps(factors))?;
        let step = |(k, (projections, single)): (usize, ([Projection; 2], bool))| match chain.get(k) {
            Some(step) if step.is_single() && !single => {
                let mut pair = Step::one(projections, self.size, terms);
                pair.tables[0][..step.tables[0].len()].copy_from_slice(&step.tables[0]);
                pair
            }
            Some(step) => step.clone(),
            None if single => Step::single(projections[0], self.size),
            None => Step::one(projections, self.size, terms),
        };
        Some(plan.into_iter().enumerate().map(step).collect())
    }
}

/// The BRDF at the centres of all pairs of texels, in both parametrisations.
struct Matrices {
    half_difference: Matrix,
    in_out: Matrix,
}

impl Matrices {
    fn of(brdf: &dyn Material, size: usize, progress: &dyn Progress) -> Result<Self> {
        let matrix = |projections| Matrix::of(brdf, projections, size, progress);
        Ok(Self {
            half_difference: matrix([Projection::Half, Projection::Difference])?,
            in_out: matrix([Projection::Light, Projection::View])?,
        })
    }

    /// The chain of the literature in one channel, for values relative to `scale`: each step is factored from the quotient
    /// of f and the steps before it.
    fn published(&self, factors: usize, channel: usize, scale: f32) -> Result<Vec<Step>> {
        let mut chain: Vec<Step> = Vec::new();
        let mut known: Vec<ProductSum> = Vec::new();
        let n = self.in_out.size.pow(2);
        for (projections, single) in steps(factors) {
            let matrix = if projections[0] == Projection::Half { &self.half_difference } else { &self.in_out };
            let so_far = |wi, wo| known.iter().map(|step| step.value(wi, wo).x).product();
            let quotient = matrix.quotient(channel, scale, so_far);
            let tables = if single { [row_means(&quotient, n), Vec::new()] } else { singular_pair(&quotient, n)? };
            let step = Step { projections, tables };
            known.push(product_sum([&step; 3], matrix.size));
            chain.push(step);
        }
        Ok(chain)
    }
}

/// The chains of three channels; the first table takes their scale.
fn assembled(chains: &[Vec<Step>], size: usize, scale: Vec3) -> Vec<ProductSum> {
    let steps = chains.iter().map(Vec::len).min().unwrap_or(0);
    let mut sums: Vec<ProductSum> =
        (0..steps).map(|k| product_sum([0, 1, 2].map(|channel| &chains[channel][k]), size)).collect();
    if let Some(first) = sums.first_mut() {
        first.terms.iter_mut().flat_map(|[left, _]| &mut left.texels).for_each(|texel| *texel *= scale);
    }
    sums
}

/// A step with the tables of three channels.
fn product_sum(channels: [&Step; 3], size: usize) -> ProductSum {
    let texels = size * size;
    let grid = |side: usize, term: usize| {
        let value = |channel: usize, i: usize| channels[channel].tables[side][term * texels + i];
        Grid { size, texels: (0..texels).map(|i| Vec3::new(value(0, i), value(1, i), value(2, i))).collect() }
    };
    let terms = channels[0].tables[0].len() / texels;
    // interpolation needs at least two texels per side
    let right = |term| if channels[0].is_single() { Grid::filled(2, Vec3::ONE) } else { grid(1, term) };
    ProductSum { projections: channels[0].projections, terms: (0..terms).map(|t| [grid(0, t), right(t)]).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Analytic, by_name};
    use crate::progress::Silent;

    #[test]
    fn no_further_factor_or_term_makes_a_chain_worse() {
        let model = by_name("ward").unwrap();
        let given = [("alpha-x", "0.25"), ("alpha-y", "0.5"), ("kd", "0.3,0.2,0.1"), ("ks", "0.4")];
        let brdf = Analytic::new(model, Values::new(model.params(), given).unwrap()).unwrap();
        let size = 6;
        let samples = Samples::at(&brdf, size, 3000).unwrap();
        let matrices = Matrices::of(&brdf, size, &Silent).unwrap();
        let published = |factors| matrices.published(factors, 0, samples.scale[0]);
        let plans = [2, 3, 4, 5, 6];
        for metric in [Metric::Linear, Metric::Log] {
            let task = Task::new(&Silent, "factor", 100);
            let search = Search { fit: samples.channel(0, metric), size, task: &task };
            let errors = |terms: usize| -> Vec<f64> {
                search.best(&plans, terms, &published).unwrap().into_iter().map(|(error, _)| error).collect()
            };
            let table = [errors(1), errors(2), errors(3)];
            println!("{metric}: {table:.4?}");
            for errors in &table {
                assert!(errors[1..].is_sorted_by(|a, b| b <= a) && errors[2] <= errors[0], "{metric}: {errors:?}");
            }
            for k in 0..plans.len() {
                assert!(table.is_sorted_by(|a, b| b[k] <= a[k]), "{metric}, {} factors: {table:?}", plans[k]);
            }
            // a step of the literature can be worse than nothing; every chain here is better than its first step
            assert!(table[0][2] < 0.95 * table[0][0] && table[2][2] < 0.7 * table[0][2], "{metric}: {table:?}");
        }
    }
}
