//! The variables of a fit: which parameters vary, on which scale, and the residuals they give.

use std::cell::RefCell;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::Options;
use super::data::{Data, Metric, Point};
use super::levenberg::minimise;
use super::linear::{bounded, shared};
use crate::model::{Analytic, Costly, MAX_TERMS, Model, Shape, Terms};
use crate::params::{Field, Kind, Value, Values};
use crate::{Error, Result};

/// Step of a finite difference, on the scale 0..1 of a variable.
const STEP: f64 = 1e-6;

/// A parameter that varies, scaled to 0..1.
#[derive(Debug, Clone, Copy)]
pub(super) struct Variable {
    pub(super) name: &'static str,
    pub(super) min: f64,
    pub(super) max: f64,
    /// Offset added before taking the logarithm; `None` for a linear scale.
    log: Option<f64>,
}

impl Variable {
    /// Uses a logarithmic scale for a range that spans orders of magnitude; from zero, it starts well below the
    /// default.
    fn new(name: &'static str, (min, max): (f64, f64), default: f64) -> Self {
        let log = match () {
            () if min > 0.0 && max / min >= 20.0 => Some(0.0),
            () if min == 0.0 && max >= 1000.0 => Some(1.0),
            () if min == 0.0 && default > 0.0 && max / default >= 20.0 => Some(0.1 * default),
            () => None,
        };
        Self { name, min, max, log }
    }

    fn value(self, t: f64) -> f64 {
        let value = match self.log {
            Some(offset) => ((self.min + offset).ln() * (1.0 - t) + (self.max + offset).ln() * t).exp() - offset,
            None => self.min * (1.0 - t) + self.max * t,
        };
        value.clamp(self.min, self.max)
    }

    /// The value of the variable among the parameters.
    pub(super) fn read(self, model: &dyn Model, values: &Values) -> Result<f64> {
        match model.params().iter().find(|p| p.name == self.name).map(|p| p.kind) {
            Some(Kind::Color { .. }) => Ok(values.get::<[f64; 3]>(self.name)?[0]),
            _ => values.get(self.name),
        }
    }

    fn position(self, value: f64) -> f64 {
        match self.log {
            Some(o) => ((value + o) / (self.min + o)).ln() / ((self.max + o) / (self.min + o)).ln(),
            None => (value - self.min) / (self.max - self.min),
        }
    }
}

/// A point in the space of all variables, with its best factors.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    /// One number per variable, 0..1.
    shape: Vec<f64>,
    factors: Terms,
    /// Sum of squared residuals under the metric of the fit.
    pub(super) cost: f64,
}

/// The parameters that vary: numbers that belong to lobes in use and are not tied to another parameter, and the
/// refractive index unless a metal fixes it.
pub(super) fn variables(
    model: &dyn Model,
    fixed: &Values,
    ties: &[(&'static str, &'static str)],
    lobes: usize,
) -> Vec<Variable> {
    let custom = fixed.iter().all(|(name, text)| name != "metal" || text == "custom");
    let unused = |name: &str| (2..=3).any(|lobe| lobe > lobes && name.ends_with(&format!("-{lobe}")));
    let mut variables = Vec::new();
    for param in model.params() {
        let tied = ties.iter().any(|(which, _)| *which == param.name);
        if tied || model.colors().contains(&param.name) || unused(param.name) {
            continue;
        }
        match param.kind {
            Kind::Real { min, max } => {
                // a default that is not a number depends on other parameters
                let default = param.default.parse().unwrap_or(0.0);
                variables.push(Variable::new(param.name, (min, max), default));
            }
            Kind::Color { min, max } if custom => variables.push(Variable::new(param.name, (min, max), 0.0)),
            _ => {}
        }
    }
    variables
}

/// Minimum distance between starting points, as a fraction of the range of at least one variable: the best ones often
/// lead to the same minimum, which need not be the deepest.
const APART: f64 = 0.2;
/// Minima whose costs differ by a smaller factor count as equal, since some variables have no influence there.
const SAME_MINIMUM: f64 = 1.03;
/// Number of quasi-random candidates judged per starting point.
const CANDIDATES: usize = 4;
/// Iterations of a full search, and of a first attempt.
const ITERATIONS: usize = 150;
const FIRST_ITERATIONS: usize = 8;
/// Positions within its range to which a variable is moved to leave a minimum.
const DISPLACEMENTS: [f64; 5] = [0.05, 0.2, 0.4, 0.6, 0.8];

/// The cache of a search: the values of the variables in [`Model::costly`], and the results for these values.
type Cache = RefCell<(Vec<f64>, Vec<Costly>)>;

pub(super) struct Search<'a> {
    model: &'static dyn Model,
    fixed: Values,
    data: &'a Data,
    metric: Metric,
    variables: Vec<Variable>,
    /// Parameters tied to another, as (parameter, other).
    ties: Vec<(&'static str, &'static str)>,
    /// Number of factors that are solved for; the terms after them have constant factors.
    free: usize,
    constant: Terms,
    highest: Vec<f64>,
    evaluations: AtomicUsize,
}

impl<'a> Search<'a> {
    pub(super) fn new(model: &'static dyn Model, fixed: &Values, data: &'a Data, options: &Options) -> Result<Self> {
        let mut fixed = fixed.clone();
        if model.params().iter().any(|param| param.name == "lobes") {
            options.lobes.write("lobes", &mut fixed)?;
        } else if options.lobes != 1 {
            return Err(Error::parameter(
                "lobes",
                format!("found {}, but {} has one lobe", options.lobes, model.name()),
            ));
        }
        let ties: Vec<_> = if options.anisotropic { Vec::new() } else { model.ties().to_vec() };
        let variables = variables(model, &fixed, &ties, options.lobes);
        let count = model.shape(&fixed)?.count();
        let free = model.colors().len().min(count);
        let highest = |name: &&'static str| match model.params().iter().find(|p| p.name == *name).map(|p| p.kind) {
            Some(Kind::Color { max, .. }) => max,
            _ => 1.0,
        };
        let highest = model.colors().iter().take(free).map(highest).collect();
        let constant = model.coefficients(&vec![DVec3::ZERO; model.colors().len()]);
        Ok(Self {
            model,
            fixed,
            data,
            metric: options.metric,
            variables,
            ties,
            free,
            constant,
            highest,
            evaluations: AtomicUsize::new(0),
        })
    }

    /// Number of parameters that are searched; a group of which only the ratios matter counts one less.
    pub(super) fn dimensions(&self) -> usize {
        let searched = |group: &&&[&'static str]| self.variables.iter().any(|v| group.contains(&v.name));
        self.variables.len() - self.model.homogeneous().iter().filter(searched).count()
    }

    pub(super) fn evaluations(&self) -> usize {
        self.evaluations.load(Ordering::Relaxed)
    }

    /// Starting points: the default parameters, and the best of many quasi-random candidates, no two of them close to
    /// each other.
    pub(super) fn candidates(&self, starts: usize, seed: u64) -> Result<Vec<Candidate>> {
        let n = self.variables.len();
        let mut candidates = vec![self.shape_of(&self.fixed)?];
        // additive recurrence, evenly spread in any dimension: 1 / r^k with r^(n+1) = r + 1
        let ratio = (0..60).fold(1.5f64, |r, _| (1.0 + r).powf(1.0 / (n as f64 + 1.0)));
        for i in 0..if n == 0 { 0 } else { CANDIDATES * starts } {
            let shift = (seed as f64 * 0.754_877_666).fract();
            let t = |k: usize| (0.5 + shift + (i as f64 + 1.0) * ratio.powi(-(k as i32) - 1)).fract();
            candidates.push((0..n).map(t).collect());
        }
        let mut judged: Vec<Candidate> = candidates.into_par_iter().map(|shape| self.solved(shape)).collect();
        let others = judged.split_off(1);
        Ok(judged.into_iter().chain(choose(others, starts - 1)).collect())
    }

    /// `candidate` with one variable moved, for every variable and every position in [`DISPLACEMENTS`].
    pub(super) fn displaced(&self, candidate: &Candidate) -> Vec<Candidate> {
        let moved = |k: usize, t: f64| {
            let mut shape = candidate.shape.clone();
            shape[k] = t;
            Candidate { shape, ..*candidate }
        };
        (0..self.variables.len()).flat_map(|k| DISPLACEMENTS.map(|t| moved(k, t))).collect()
    }

    /// A candidate of this shape with its best factors.
    fn solved(&self, shape: Vec<f64>) -> Candidate {
        let terms = self.terms(&shape, &Cache::default());
        let factors = self.solve(&terms);
        let cost = self.residuals(&terms, &factors, self.metric).iter().map(|r| r * r).sum();
        Candidate { shape, factors, cost }
    }

    /// Improves a candidate by a few steps under the cosine-weighted metric.
    pub(super) fn approach(&self, candidate: Candidate) -> Candidate {
        self.projected(candidate.shape, FIRST_ITERATIONS)
    }

    /// The variables for given parameters.
    fn shape_of(&self, values: &Values) -> Result<Vec<f64>> {
        let position = |v: &Variable| Ok(v.position(v.read(self.model, values)?).clamp(0.0, 1.0));
        self.variables.iter().map(position).collect()
    }

    /// The candidate for given parameters, with the best colours.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `values` are not of the model's table.
    pub(super) fn candidate(&self, values: &Values) -> Result<Candidate> {
        Ok(self.solved(self.shape_of(values)?))
    }

    /// The minimum that is reached from a candidate.
    pub(super) fn improve(&self, candidate: Candidate) -> Candidate {
        let start = candidate.shape.clone();
        let end = self.projected(candidate.shape, ITERATIONS);
        if self.metric == Metric::Cosine {
            return end;
        }
        // the minimum under another metric may be far away: continue from both ends and keep the better
        let [a, b] = [end, self.solved(start)].map(|candidate| self.improve_all(candidate));
        if b.cost < a.cost { b } else { a }
    }

    /// Minimises the cosine-weighted metric from `shape`; the factors are solved for at every step.
    fn projected(&self, shape: Vec<f64>, iterations: usize) -> Candidate {
        let n = self.variables.len();
        let (low, high) = (vec![0.0; n], vec![1.0; n]);
        let cache = Cache::default();
        let reduced = |shape: &[f64]| {
            let terms = self.terms(shape, &cache);
            self.residuals(&terms, &self.solve(&terms), Metric::Cosine)
        };
        let derivatives = |shape: &[f64], here: &[f64]| self.differences(shape, here, reduced);
        self.solved(minimise(shape, (&low, &high), iterations, reduced, derivatives))
    }

    /// Minimises the metric of the fit over all variables at once, colours included.
    fn improve_all(&self, candidate: Candidate) -> Candidate {
        let n = self.variables.len();
        let all = n + 3 * self.free;
        let low = vec![0.0; all];
        let mut high = vec![1.0; n];
        high.extend((0..3 * self.free).map(|i| self.highest[i / 3]));
        let colors = |x: &[f64]| {
            let mut colors = vec![DVec3::ZERO; self.model.colors().len()];
            colors.iter_mut().zip(x[n..].chunks_exact(3)).for_each(|(color, x)| *color = DVec3::from_slice(x));
            colors
        };
        let unpack = |x: &[f64]| self.model.coefficients(&colors(x));
        let cache = Cache::default();
        let residuals = |x: &[f64]| self.residuals(&self.terms(&x[..n], &cache), &unpack(x), self.metric);
        let derivatives = |x: &[f64], here: &[f64]| {
            let (terms, factors) = (self.terms(&x[..n], &cache), unpack(x));
            let of_shape = |shape: &[f64]| self.residuals(&self.terms(shape, &cache), &factors, self.metric);
            let mut columns = self.differences(&x[..n], here, of_shape);
            let value = |terms: &Terms, c: usize| terms.iter().zip(&factors).map(|(t, f)| t[c] * f[c]).sum::<f64>();
            // the factors are linear in each colour: differentiate them by a step of 1
            let colors = colors(x);
            for k in 0..self.free {
                let mut moved = colors.clone();
                moved[k] += DVec3::ONE;
                let moved = self.model.coefficients(&moved);
                for channel in 0..3 {
                    let change = |terms: &Terms| {
                        let one = |k: usize| terms[k][channel] * (moved[k] - factors[k])[channel];
                        (0..MAX_TERMS).map(one).sum::<f64>()
                    };
                    let mut column = vec![0.0; here.len()];
                    for (slope, terms) in column[channel..].iter_mut().step_by(3).zip(&terms) {
                        *slope = self.metric.slope(value(terms, channel)) * change(terms);
                    }
                    columns.push(column);
                }
            }
            columns
        };
        let mut start = candidate.shape;
        let most = |k: usize| DVec3::splat(self.highest[k]);
        let given = self.model.colors_of(&candidate.factors);
        (0..self.free).for_each(|k| start.extend(given[k].clamp(DVec3::ZERO, most(k)).to_array()));
        let x = minimise(start, (&low, &high), ITERATIONS, residuals, derivatives);
        let cost = residuals(&x).iter().map(|r| r * r).sum();
        Candidate { factors: unpack(&x), shape: x[..n].to_vec(), cost }
    }

    /// The derivatives of `residuals` with respect to each variable.
    fn differences(&self, x: &[f64], here: &[f64], residuals: impl Fn(&[f64]) -> Vec<f64>) -> Vec<Vec<f64>> {
        let mut columns = vec![Vec::new(); self.variables.len()];
        // move costly variables last, so that the cache serves all others
        let costly = |k: &usize| self.model.costly().contains(&self.variables[*k].name);
        let (last, first): (Vec<usize>, Vec<usize>) = (0..columns.len()).partition(costly);
        for k in first.into_iter().chain(last) {
            columns[k] = difference(x, k, here, &residuals);
        }
        columns
    }

    fn values(&self, shape: &[f64]) -> Result<Values> {
        let mut values = self.fixed.clone();
        for (variable, &t) in self.variables.iter().zip(shape) {
            values.set_value(variable.name, Value::Real(variable.value(t)))?;
        }
        tie(&mut values, &self.ties)?;
        for group in self.model.homogeneous() {
            let numbers = group.iter().map(|name| values.get(name)).collect::<Result<Vec<f64>>>()?;
            let largest = numbers.iter().fold(0.0f64, |largest, v| largest.max(v.abs()));
            for (name, number) in group.iter().zip(&numbers).filter(|_| largest > 0.0) {
                values.set_value(name, Value::Real(number / largest))?;
            }
        }
        Ok(values)
    }

    /// The model with the parameters of a candidate.
    pub(super) fn material(&self, candidate: &Candidate) -> Result<Analytic> {
        let mut values = self.values(&candidate.shape)?;
        for (k, (name, color)) in self.model.colors().iter().zip(self.model.colors_of(&candidate.factors)).enumerate() {
            let most = self.highest.get(k).copied().unwrap_or(0.0);
            let c = color.clamp(DVec3::ZERO, DVec3::splat(most));
            values.set_value(name, Value::Color(c.to_array()))?;
        }
        Analytic::new(self.model, values)
    }

    /// The terms of the model times the weights, per sample.
    fn terms(&self, shape: &[f64], cache: &Cache) -> Vec<Terms> {
        self.evaluations.fetch_add(1, Ordering::Relaxed);
        let points = &self.data.points;
        let costly = |(variable, t): (&Variable, &f64)| self.model.costly().contains(&variable.name).then_some(*t);
        let key: Vec<f64> = self.variables.iter().zip(shape).filter_map(costly).collect();
        // all values are within the bounds of the table, so this cannot fail
        let shape: Box<dyn Shape> = match self.values(shape).and_then(|values| self.model.shape(&values)) {
            Ok(shape) => shape,
            Err(_) => return vec![[DVec3::ZERO; MAX_TERMS]; self.data.len()],
        };
        if self.model.costly().is_empty() {
            return points.iter().map(|p| shape.terms(p.wi, p.wo).map(|t| t * p.weight)).collect();
        }
        let (last, costly) = &mut *cache.borrow_mut();
        if *last != key || costly.is_empty() {
            *costly = points.iter().map(|p| shape.costly(p.wi, p.wo)).collect();
            *last = key;
        }
        let weighted = |(p, costly): (&Point, &Costly)| shape.terms_from(costly, p.wi, p.wo).map(|t| t * p.weight);
        points.iter().zip(costly.iter()).map(weighted).collect()
    }

    /// The factors with the least cosine-weighted error, channel by channel.
    fn solve(&self, terms: &[Terms]) -> Terms {
        let n = self.free;
        let (mut gram, mut right) = ([[DVec3::ZERO; MAX_TERMS]; MAX_TERMS], [DVec3::ZERO; MAX_TERMS]);
        for (terms, point) in terms.iter().zip(&self.data.points) {
            let given: DVec3 = (n..MAX_TERMS).map(|k| self.constant[k] * terms[k]).sum();
            for i in 0..n {
                right[i] += terms[i] * (point.value - given);
                (0..=i).for_each(|j| gram[i][j] += terms[i] * terms[j]);
            }
        }
        let mut factors = self.constant;
        for channel in 0..3 {
            let of_channel = (0..n * n).map(|k| gram[(k / n).max(k % n)][(k / n).min(k % n)][channel]);
            let right: Vec<f64> = right[..n].iter().map(|r| r[channel]).collect();
            let gram: Vec<f64> = of_channel.collect();
            let found =
                if self.model.is_coated() { shared(&gram, &right) } else { bounded(&gram, &right, &self.highest) };
            for (k, value) in found.into_iter().enumerate() {
                factors[k][channel] = value;
            }
        }
        factors
    }

    /// The residuals, channel by channel within sample by sample.
    fn residuals(&self, terms: &[Terms], factors: &Terms, metric: Metric) -> Vec<f64> {
        let mut residuals = Vec::with_capacity(3 * terms.len());
        for (terms, point) in terms.iter().zip(&self.data.points) {
            let value: DVec3 = terms.iter().zip(factors).map(|(t, f)| *t * *f).sum();
            for c in 0..3 {
                residuals.push(metric.compress(value[c].max(0.0)) - metric.compress(point.value[c]));
            }
        }
        residuals
    }
}

/// The best `count` candidates in order, with only one of those that are in the same minimum.
pub(super) fn distinct_minima(mut candidates: Vec<Candidate>, count: usize) -> Vec<Candidate> {
    candidates.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    candidates.dedup_by(|other, known| other.cost < SAME_MINIMUM * known.cost);
    candidates.truncate(count);
    candidates
}

/// The `count` best candidates that differ by [`APART`] in a variable; if they are too few, then the best of the
/// others.
fn choose(mut candidates: Vec<Candidate>, count: usize) -> Vec<Candidate> {
    candidates.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let differ = |a: &Candidate, b: &Candidate| a.shape.iter().zip(&b.shape).any(|(a, b)| (a - b).abs() >= APART);
    let (mut chosen, mut close): (Vec<Candidate>, Vec<Candidate>) = (Vec::new(), Vec::new());
    for candidate in candidates {
        let far = chosen.iter().all(|other| differ(other, &candidate));
        if far { chosen.push(candidate) } else { close.push(candidate) }
    }
    chosen.into_iter().chain(close).take(count).collect()
}

/// Sets the parameters that are tied to another.
pub(super) fn tie(values: &mut Values, ties: &[(&'static str, &'static str)]) -> Result<()> {
    for (which, whom) in ties.iter().filter(|(_, whom)| !whom.is_empty()) {
        let value = values.value(whom)?.clone();
        values.set_value(which, value)?;
    }
    Ok(())
}

/// The derivative of `residuals` with respect to variable `k`, by a finite difference towards the interior of the box.
fn difference(x: &[f64], k: usize, here: &[f64], residuals: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
    let step = if x[k] > 0.5 { -STEP } else { STEP };
    let mut moved = x.to_vec();
    moved[k] += step;
    let there = residuals(&moved);
    there.iter().zip(here).map(|(a, b)| (a - b) / step).collect()
}
