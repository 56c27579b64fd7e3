//! The factors of a texel, fitted jointly.

use glam::Vec3;

use crate::btf::BtfMeta;
use crate::separable::{Grid, Projection};

/// One kind of factor: a table over some directions.
pub(super) struct Kind {
    /// Name of its table.
    pub name: &'static str,
    /// Numbers in a table, per term and channel.
    pub nodes: usize,
    /// The nodes around each pair (view, light) and their weights, of sum 1.
    stencils: Vec<(u32, f32)>,
    /// Nodes per pair.
    width: usize,
    /// For each node the sum of the weights of all pairs.
    near: Vec<f32>,
}

impl Kind {
    fn sampled(name: &'static str, nodes: usize, node: impl Iterator<Item = usize>) -> Self {
        Self::new(name, nodes, node.map(|node| (node as u32, 1.0)).collect(), 1)
    }

    fn on_grid(name: &'static str, side: usize, directions: impl Iterator<Item = Vec3>) -> Self {
        let stencils = directions.flat_map(|w| Grid::stencil(side, w).map(|(node, weight)| (node as u32, weight)));
        Self::new(name, side * side, stencils.collect(), 4)
    }

    fn new(name: &'static str, nodes: usize, stencils: Vec<(u32, f32)>, width: usize) -> Self {
        let mut near = vec![0.0; nodes];
        stencils.iter().for_each(|&(node, weight)| near[node as usize] += weight);
        Self { name, nodes, stencils, width, near }
    }

    /// Whether every pair has a node of its own, so that the error of a table is a sum over its nodes.
    pub fn is_sampled(&self) -> bool {
        self.width == 1
    }

    /// Number of pairs.
    pub fn pairs(&self) -> usize {
        self.stencils.len() / self.width
    }

    /// Multiplies `out` by the table, pair by pair.
    pub fn multiply(&self, table: &[f32], out: &mut [f32]) {
        if self.width == 1 {
            out.iter_mut().zip(&self.stencils).for_each(|(out, (node, _))| *out *= table[*node as usize]);
            return;
        }
        for (out, stencil) in out.iter_mut().zip(self.stencils.chunks_exact(self.width)) {
            *out *= stencil.iter().map(|&(node, weight)| weight * table[node as usize]).sum::<f32>();
        }
    }

    /// Adds the values of all pairs to their nodes.
    pub fn add_to_nodes(&self, values: impl Iterator<Item = f32>, nodes: &mut [f32]) {
        for (value, stencil) in values.zip(self.stencils.chunks_exact(self.width)) {
            stencil.iter().for_each(|&(node, weight)| nodes[node as usize] += weight * value);
        }
    }
}

/// The kinds of factors: light, half vector and view, and the difference vector if there are four.
pub(super) fn kinds(meta: &BtfMeta, resolution: usize, factors: usize) -> Vec<Kind> {
    let (views, lights) = (meta.views.directions(), meta.lights.directions());
    let pairs = || views.iter().flat_map(|&wo| lights.iter().map(move |&wi| (wi, wo)));
    let (light, view) = (0..views.len() * lights.len(), 0..views.len() * lights.len());
    let over = |name, projection: Projection| {
        Kind::on_grid(name, resolution, pairs().map(move |(wi, wo)| projection.of(wi, wo)))
    };
    let mut kinds = vec![
        Kind::sampled("light", lights.len(), light.map(|pair| pair % lights.len())),
        over("half", Projection::Half),
        Kind::sampled("view", views.len(), view.map(|pair| pair / lights.len())),
    ];
    if factors > BASIC {
        kinds.push(over("difference", Projection::Difference));
    }
    kinds
}

/// Position of the half vector among the kinds: it carries the scale.
pub(super) const SCALED: usize = 1;

/// Rounds over all factors of a texel.
const ROUNDS: usize = 40;
/// Relative decrease of the squared error in a round, below which the fit ends.
const SETTLED: f32 = 1e-3;

/// The factors of one channel of a texel: for each kind (term, node). All but the half vector's have a mean square of 1.
/// A further term, and the difference vector beside the [`BASIC`] kinds, begin at what is known without them, so that
/// neither makes the error larger.
pub(super) fn factor(kinds: &[Kind], terms: usize, f: &[f32]) -> Vec<Vec<f32>> {
    let scale = f.iter().map(|v| v.abs()).sum::<f32>() / f.len() as f32;
    let scale = if scale.is_normal() { scale } else { 1.0 };
    let mut short = Fit::new(kinds, terms, f.iter().map(|v| v / scale).collect());
    let mut long: Option<Fit> = None;
    for _ in 0..terms {
        short.add_term();
        short.improve(BASIC);
        if kinds.len() > BASIC {
            let mut grown = short.clone();
            grown.improve(kinds.len());
            let extended = long.take().map(|mut long| {
                long.add_term();
                long.improve(kinds.len());
                long
            });
            long = Some(match extended {
                Some(extended) if extended.error() < grown.error() => extended,
                _ => grown,
            });
        }
    }
    let mut tables = long.unwrap_or(short).tables;
    for term in 0..terms {
        normalise(kinds, term, scale, &mut tables);
    }
    tables
}

/// Number of kinds without the difference vector.
pub(super) const BASIC: usize = 3;

/// The search for the factors of one channel of a texel.
#[derive(Clone)]
struct Fit<'a> {
    kinds: &'a [Kind],
    /// Terms in the end.
    terms: usize,
    /// Terms so far.
    known: usize,
    /// For each kind (term, node).
    tables: Vec<Vec<f32>>,
    residual: Vec<f32>,
}

impl<'a> Fit<'a> {
    fn new(kinds: &'a [Kind], terms: usize, values: Vec<f32>) -> Self {
        let tables = kinds.iter().map(|kind| Vec::with_capacity(terms * kind.nodes)).collect();
        Self { kinds, terms, known: 0, tables, residual: values }
    }

    fn error(&self) -> f32 {
        squares(&self.residual)
    }

    /// Appends a term that begins with the mean over the pairs of each half vector.
    fn add_term(&mut self) {
        let term = self.known;
        for (k, (table, kind)) in self.tables.iter_mut().zip(self.kinds).enumerate() {
            // terms have to be told apart
            let ripple = |i: usize| 1.0 + 0.5 * term.min(1) as f32 * ((i * (term + 1)) as f32 * 0.7).sin();
            let start = |i: usize| match k {
                SCALED => 0.0,
                _ if kind.is_sampled() => ripple(i),
                _ => 1.0,
            };
            table.extend((0..kind.nodes).map(start));
        }
        self.known += 1;
        improve(self.kinds, [term, self.terms], SCALED, &mut self.tables, &mut self.residual);
    }

    /// Improves the first kinds of all terms in turn until the error settles.
    fn improve(&mut self, kinds: usize) {
        let mut error = self.error();
        for _ in 0..ROUNDS {
            for term in 0..self.known {
                for kind in 0..kinds {
                    improve(self.kinds, [term, self.terms], kind, &mut self.tables, &mut self.residual);
                }
            }
            let before = std::mem::replace(&mut error, self.error());
            if error >= (1.0 - SETTLED) * before {
                break;
            }
        }
    }
}

/// Moves the scale of a term to the half vector's table, times `scale`, and continues that table where no pair is near.
fn normalise(kinds: &[Kind], term: usize, scale: f32, tables: &mut [Vec<f32>]) {
    let part = |kind: usize| term * kinds[kind].nodes..(term + 1) * kinds[kind].nodes;
    let mut scale = scale;
    for kind in (0..kinds.len()).filter(|kind| *kind != SCALED) {
        let table = &mut tables[kind][part(kind)];
        let norm = (squares(table) / table.len() as f32).sqrt();
        if norm.is_normal() {
            table.iter_mut().for_each(|v| *v /= norm);
            scale *= norm;
        }
    }
    tables[SCALED][part(SCALED)].iter_mut().for_each(|v| *v *= scale);
    for kind in (0..kinds.len()).filter(|kind| !kinds[*kind].is_sampled()) {
        let near = &kinds[kind].near;
        let table = &mut tables[kind][part(kind)];
        let sum: f32 = table.iter().zip(near).map(|(v, near)| v * near).sum();
        let mean = sum / near.iter().sum::<f32>();
        table.iter_mut().zip(near).filter(|(_, near)| **near < NEAR).for_each(|(v, _)| *v = mean);
    }
}

/// Sum of weights below which no pair is near a node.
const NEAR: f32 = 1e-3;

/// The value nearest to `value` that a factor may have. Only the half vector's may be negative, and only in a sum:
/// between sampled directions, products of negative factors would be anything.
pub(super) fn allowed(value: f32, kind: usize, terms: usize) -> f32 {
    if terms > 1 && kind == SCALED { value } else { value.max(0.0) }
}

fn squares(values: &[f32]) -> f32 {
    values.iter().map(|v| v * v).sum()
}

/// Improves one term of one kind for given others. On a grid, where the nodes of a pair share its error, the step is that
/// of an upper bound of the error, which lowers the error itself.
fn improve(kinds: &[Kind], [term, terms]: [usize; 2], kind: usize, tables: &mut [Vec<f32>], residual: &mut [f32]) {
    let part = |kind: usize| term * kinds[kind].nodes..(term + 1) * kinds[kind].nodes;
    let mut others = vec![1.0; residual.len()];
    for k in (0..kinds.len()).filter(|k| *k != kind) {
        kinds[k].multiply(&tables[k][part(k)], &mut others);
    }
    let (mut up, mut down) = (vec![0.0; kinds[kind].nodes], vec![0.0; kinds[kind].nodes]);
    kinds[kind].add_to_nodes(others.iter().map(|g| g * g), &mut down);
    for _ in 0..if kinds[kind].is_sampled() { 1 } else { GRID_STEPS } {
        up.fill(0.0);
        kinds[kind].add_to_nodes(others.iter().zip(&*residual).map(|(g, e)| g * e), &mut up);
        // nodes that no pair is near stay as they are
        let change: Vec<f32> =
            up.iter().zip(&down).map(|(u, d)| if *d > f32::MIN_POSITIVE { u / d } else { 0.0 }).collect();
        let change: Vec<f32> = tables[kind][part(kind)]
            .iter_mut()
            .zip(change)
            .map(|(value, change)| {
                let before = *value;
                *value = allowed(before + change, kind, terms);
                *value - before
            })
            .collect();
        let mut changed = others.clone();
        kinds[kind].multiply(&change, &mut changed);
        residual.iter_mut().zip(&changed).for_each(|(e, change)| *e -= change);
    }
}

/// Steps of a table on a grid at a time.
const GRID_STEPS: usize = 3;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, SampleType};
    use crate::color::Encoding;
    use crate::direction::DirectionSet;

    /// Values of one channel that are no product.
    fn values(meta: &BtfMeta) -> Vec<f32> {
        let pairs =
            meta.views.directions().iter().flat_map(|wo| meta.lights.directions().iter().map(move |wi| (wi, wo)));
        pairs
            .enumerate()
            .map(|(i, (wi, wo))| {
                let gloss = (*wi + *wo).normalize().z.powi(30);
                0.2 * wi.z + 0.5 * gloss + 0.1 * wi.dot(*wo).max(0.0) + 0.05 * ((i * 7 % 13) as f32 / 13.0)
            })
            .collect()
    }

    fn error(kinds: &[Kind], tables: &[Vec<f32>], terms: usize, f: &[f32]) -> f32 {
        let mut left = f.to_vec();
        for term in 0..terms {
            let mut product = vec![1.0; f.len()];
            for (kind, table) in kinds.iter().zip(tables) {
                kind.multiply(&table[term * kind.nodes..][..kind.nodes], &mut product);
            }
            left.iter_mut().zip(product).for_each(|(left, v)| *left -= v);
        }
        squares(&left).sqrt()
    }

    #[test]
    fn no_further_factor_or_term_makes_the_error_larger() {
        let degrees = (0..16).map(|i| [5.0 * f64::from(i), 77.0 * f64::from(i)]).collect();
        let set = DirectionSet::from_degrees(degrees).unwrap();
        let (encoding, cosine, sample_type) = (Encoding::Srgb, Cosine::Included, SampleType::F32);
        let meta = BtfMeta { width: 1, height: 1, views: set.clone(), lights: set, encoding, cosine, sample_type };
        let f = values(&meta);
        let errors = [3, 4].map(|factors| {
            let kinds = kinds(&meta, 5, factors);
            [1, 2, 3].map(|terms| error(&kinds, &factor(&kinds, terms, &f), terms, &f))
        });
        println!("{errors:?}");
        for ((a, b), k) in errors[0].iter().zip(errors[1]).zip(0..) {
            assert!(b <= *a, "{} terms: {errors:?}", k + 1);
        }
        assert!(errors.iter().all(|e| e.is_sorted_by(|a, b| b <= a)), "{errors:?}");
        assert!(errors[1][0] < 0.98 * errors[0][0] && errors[0][1] < 0.95 * errors[0][0], "{errors:?}");
    }
}
