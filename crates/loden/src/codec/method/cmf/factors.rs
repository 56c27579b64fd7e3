//! The factors of a texel, fitted jointly.

use glam::Vec3;

use crate::btf::BtfMeta;
use crate::direction::half;
use crate::separable::Grid;

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

/// The kinds of factors: light, half vector and view.
pub(super) fn kinds(meta: &BtfMeta, resolution: usize) -> Vec<Kind> {
    let (views, lights) = (meta.views.directions(), meta.lights.directions());
    let pairs = || views.iter().flat_map(|&wo| lights.iter().map(move |&wi| (wi, wo)));
    let (light, view) = (0..views.len() * lights.len(), 0..views.len() * lights.len());
    vec![
        Kind::sampled("light", lights.len(), light.map(|pair| pair % lights.len())),
        Kind::on_grid("half", resolution, pairs().map(|(wi, wo)| half(wi, wo))),
        Kind::sampled("view", views.len(), view.map(|pair| pair / lights.len())),
    ]
}

/// Position of the half vector among the kinds: it carries the scale.
pub(super) const SCALED: usize = 1;

/// Rounds over all factors of a texel.
const ROUNDS: usize = 40;
/// Relative decrease of the squared error in a round, below which the fit ends.
const SETTLED: f32 = 1e-3;

/// The factors of one channel of a texel: for each kind (term, node). All but the half vector's have a mean square of 1.
pub(super) fn factor(kinds: &[Kind], terms: usize, f: &[f32]) -> Vec<Vec<f32>> {
    let mut tables: Vec<Vec<f32>> = kinds.iter().map(|kind| Vec::with_capacity(terms * kind.nodes)).collect();
    let scale = f.iter().map(|v| v.abs()).sum::<f32>() / f.len() as f32;
    let scale = if scale.is_normal() { scale } else { 1.0 };
    let mut residual: Vec<f32> = f.iter().map(|v| v / scale).collect();
    for term in 0..terms {
        // Begin with the mean over the pairs of each half vector
        for (table, kind) in tables.iter_mut().zip(kinds) {
            let ripple = |i: usize| 1.0 + 0.5 * term.min(1) as f32 * ((i * (term + 1)) as f32 * 0.7).sin();
            table.extend((0..kind.nodes).map(|i| if kind.is_sampled() { ripple(i) } else { 0.0 }));
        }
        improve(kinds, [term, terms], SCALED, &mut tables, &mut residual);
        let mut error = squares(&residual);
        for _ in 0..ROUNDS {
            for term in 0..=term {
                (0..kinds.len()).for_each(|kind| improve(kinds, [term, terms], kind, &mut tables, &mut residual));
            }
            let before = std::mem::replace(&mut error, squares(&residual));
            if error >= (1.0 - SETTLED) * before {
                break;
            }
        }
    }
    for term in 0..terms {
        normalise(kinds, term, scale, &mut tables);
    }
    tables
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
