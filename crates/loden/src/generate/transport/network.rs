//! The network simplex method for the transportation problem.
//!
//! # Model
//! A basis is a spanning tree of sources, targets and an artificial root that every node can send to or receive from at a
//! cost that no optimal plan pays. An arc whose reduced cost c_ij + p_i - p_j is negative enters the tree; mass moves around
//! the cycle that it closes until an arc is empty, which leaves. Trees stay strongly feasible (empty arcs point towards the
//! root, because of ties the last blocking arc of the cycle leaves), so the method cannot cycle. Arcs are priced in two steps: a sweep over all
//! adds the best few of each source to a list, then the best of a block of the list enters until none of it improves the plan.
//!
//! # Limits
//! A pivot changes the potentials of a whole subtree.
//!
//! # References
//! cunningham1976, bonneel2011

use rayon::prelude::*;

use super::{Costs, Flow, Plan, UNITS};
use crate::simd::wide;
use crate::{Error, Result};

/// Bytes for each source and target.
pub const NODE_BYTES: u64 = 64;

/// Most candidates of a source in one sweep: the best of each of as many blocks of targets.
const BLOCKS: usize = 4;

/// Bytes for the candidates of a source, which are collected and joined.
pub const CANDIDATE_BYTES: u64 = ((2 * BLOCKS + 2 * KEPT) * size_of::<Arc>()) as u64;

/// Known arcs per source, at most: those of the least reduced costs are kept.
const KEPT: usize = 64;

/// Reduced costs are compared with this part of the largest cost.
const TOLERANCE: f64 = 1e-13;

/// Pivots for each node after which rounding must be to blame.
const MAX_PIVOTS: usize = 20_000;

/// Costs that one thread sweeps over by itself.
const SMALL: usize = 1 << 18;

/// Differences compared at a time.
const LANES: usize = 16;

/// No node.
const NONE: u32 = u32::MAX;

/// An arc from a source to a target.
#[derive(Debug, Clone, Copy)]
struct Arc {
    from: u32,
    to: u32,
    cost: f64,
}

/// A spanning tree: sources, then targets, then the root. Arcs belong to their lower end; they point up from a source and
/// down to a target.
struct Tree {
    sources: usize,
    root: usize,
    parent: Vec<u32>,
    /// The first child, and siblings in a list.
    child: Vec<u32>,
    next: Vec<u32>,
    previous: Vec<u32>,
    depth: Vec<u32>,
    /// Mass on the arc to the parent.
    flow: Vec<i64>,
    /// Cost of the arc to the parent.
    cost: Vec<f64>,
    potential: Vec<f64>,
    /// Nodes to visit.
    stack: Vec<u32>,
}

/// Finds the plan of least cost; masses are in units.
///
/// # Errors
/// [`Error::NotConverged`].
pub fn solve(sources: &[i64], targets: &[i64], costs: &Costs) -> Result<Plan> {
    // Leave nodes without mass out: their arcs would be empty and point away from the root
    let with_mass = |masses: &[i64]| (0..masses.len()).filter(|&k| masses[k] > 0).collect::<Vec<_>>();
    let (from, to) = (with_mass(sources), with_mass(targets));
    let masses = from.iter().map(|&i| sources[i]).chain(to.iter().map(|&j| targets[j]));
    let mut tree = Tree::new(from.len(), masses.collect(), costs.largest);
    let tolerance = TOLERANCE * costs.largest;
    let (mut pivots, mut known) = (0, Vec::new());
    loop {
        // Price all arcs
        tree.refresh();
        let candidates = sweep(&tree, &from, &to, costs, tolerance);
        if candidates.is_empty() {
            break;
        }
        // Pivot until no known arc improves the plan
        known.extend(candidates);
        known.sort_by(|a, b| tree.reduced(a).total_cmp(&tree.reduced(b)));
        known.truncate(KEPT * from.len());
        tree.improve(&known, tolerance, &mut pivots)?;
    }
    Ok(tree.plan(&from, &to, [sources.len(), targets.len()], costs))
}

/// The best arc of each block of targets of each source, if its reduced cost is negative.
fn sweep(tree: &Tree, from: &[usize], to: &[usize], costs: &Costs, tolerance: f64) -> Vec<Arc> {
    // Targets without mass are never worth an arc
    let mut potentials = vec![f64::NEG_INFINITY; costs.targets];
    let mut node_of = vec![NONE; costs.targets];
    for (k, &target) in to.iter().enumerate() {
        potentials[target] = tree.potential[tree.sources + k];
        node_of[target] = (tree.sources + k) as u32;
    }
    let size = costs.targets.div_ceil(BLOCKS);
    let of_source = |buffer: &mut Vec<f64>, (node, &source): (usize, &usize)| {
        let least = -tolerance - tree.potential[node];
        let blocks = costs.row(source, buffer).chunks(size).zip(potentials.chunks(size));
        let best = |(block, (row, potentials)): (usize, (&[f64], &[f64]))| {
            let mut best = f64::INFINITY;
            least_difference(row, potentials, &mut best);
            if best >= least {
                return None;
            }
            let place = row.iter().zip(potentials).position(|(c, p)| c - p == best)?;
            Some(Arc { from: node as u32, to: node_of[block * size + place], cost: row[place] })
        };
        blocks.enumerate().filter_map(best).collect::<Vec<_>>()
    };
    // waking threads takes longer than a small sweep
    if from.len() * to.len() < SMALL {
        let mut buffer = Vec::new();
        return from.iter().enumerate().flat_map(|source| of_source(&mut buffer, source)).collect();
    }
    let all: Vec<Vec<Arc>> = from.par_iter().enumerate().map_init(Vec::new, of_source).collect();
    all.concat()
}

wide! {
    /// The least difference of a cost and a potential.
    fn least_difference(costs: &[f64], potentials: &[f64], least: &mut f64) {
        let mut lanes = [f64::INFINITY; LANES];
        let (costs, rest) = costs.as_chunks::<LANES>();
        let (potentials, last) = potentials.as_chunks::<LANES>();
        for (costs, potentials) in costs.iter().zip(potentials) {
            for k in 0..LANES {
                let difference = costs[k] - potentials[k];
                lanes[k] = if difference < lanes[k] { difference } else { lanes[k] };
            }
        }
        for (cost, potential) in rest.iter().zip(last) {
            lanes[0] = if cost - potential < lanes[0] { cost - potential } else { lanes[0] };
        }
        *least = lanes.into_iter().fold(f64::INFINITY, f64::min);
    }
}

impl Tree {
    /// All mass passes through the root, at more than any cost.
    fn new(sources: usize, flow: Vec<i64>, largest: f64) -> Self {
        let root = flow.len();
        let mut tree = Self {
            sources,
            root,
            parent: vec![NONE; root + 1],
            child: vec![NONE; root + 1],
            next: vec![NONE; root + 1],
            previous: vec![NONE; root + 1],
            depth: vec![0; root + 1],
            cost: vec![largest.max(f64::MIN_POSITIVE); root],
            potential: vec![0.0; root + 1],
            flow,
            stack: Vec::new(),
        };
        (0..root).rev().for_each(|node| tree.attach(node as u32, root as u32));
        tree
    }

    fn attach(&mut self, node: u32, parent: u32) {
        let first = std::mem::replace(&mut self.child[parent as usize], node);
        (self.parent[node as usize], self.next[node as usize], self.previous[node as usize]) = (parent, first, NONE);
        if first != NONE {
            self.previous[first as usize] = node;
        }
    }

    fn detach(&mut self, node: u32) {
        let (next, previous) = (self.next[node as usize], self.previous[node as usize]);
        match previous {
            NONE => self.child[self.parent[node as usize] as usize] = next,
            _ => self.next[previous as usize] = next,
        }
        if next != NONE {
            self.previous[next as usize] = previous;
        }
    }

    fn is_source(&self, node: u32) -> bool {
        (node as usize) < self.sources
    }

    /// The reduced cost of an arc.
    #[inline]
    fn reduced(&self, arc: &Arc) -> f64 {
        arc.cost + self.potential[arc.from as usize] - self.potential[arc.to as usize]
    }

    /// Computes all potentials and depths from the tree, without the rounding of many changes.
    fn refresh(&mut self) {
        self.potential[self.root] = 0.0;
        let children = |tree: &mut Self, node: u32| {
            let mut child = tree.child[node as usize];
            while child != NONE {
                let (cost, up) = (tree.cost[child as usize], tree.potential[node as usize]);
                tree.potential[child as usize] = if tree.is_source(child) { up - cost } else { up + cost };
                tree.depth[child as usize] = tree.depth[node as usize] + 1;
                tree.stack.push(child);
                child = tree.next[child as usize];
            }
        };
        children(self, self.root as u32);
        while let Some(node) = self.stack.pop() {
            children(self, node);
        }
    }

    /// The node that the paths from two nodes to the root share first.
    fn join(&self, mut a: u32, mut b: u32) -> u32 {
        while a != b {
            if self.depth[a as usize] >= self.depth[b as usize] {
                a = self.parent[a as usize];
            } else {
                b = self.parent[b as usize];
            }
        }
        a
    }

    /// Brings arcs of a list into the tree, the best of a block at a time, until none has a negative reduced cost.
    fn improve(&mut self, arcs: &[Arc], tolerance: f64, pivots: &mut usize) -> Result<()> {
        let block = (4.0 * (arcs.len() as f64).sqrt()) as usize + 16;
        let (mut at, mut idle) = (0, 0);
        while idle < arcs.len() {
            let end = (at + block).min(arcs.len());
            let all = arcs[at..end].iter().map(|arc| (self.reduced(arc), arc));
            let best = all.fold((-tolerance, None), |best, (r, arc)| if r < best.0 { (r, Some(arc)) } else { best });
            idle += end - at;
            if let (reduced, Some(arc)) = best {
                self.pivot(arc, reduced);
                (idle, *pivots) = (0, *pivots + 1);
            }
            at = if end == arcs.len() { 0 } else { end };
            if *pivots > MAX_PIVOTS * self.root {
                return Err(Error::not_converged("the transport plan"));
            }
        }
        Ok(())
    }

    /// Brings an arc into the tree.
    fn pivot(&mut self, arc: &Arc, reduced: f64) {
        let join = self.join(arc.from, arc.to);
        // Determine the last blocking arc of the cycle, which runs from the join down to the source and up from the target
        let (mut delta, mut leaving, mut below_source) = (i64::MAX, NONE, true);
        let mut node = arc.from;
        while node != join {
            if self.is_source(node) && self.flow[node as usize] < delta {
                (delta, leaving) = (self.flow[node as usize], node);
            }
            node = self.parent[node as usize];
        }
        node = arc.to;
        while node != join {
            if !self.is_source(node) && self.flow[node as usize] <= delta {
                (delta, leaving, below_source) = (self.flow[node as usize], node, false);
            }
            node = self.parent[node as usize];
        }
        // Move mass around the cycle
        if delta > 0 {
            for (start, sign) in [(arc.from, -delta), (arc.to, delta)] {
                node = start;
                while node != join {
                    self.flow[node as usize] += if self.is_source(node) { sign } else { -sign };
                    node = self.parent[node as usize];
                }
            }
        }
        // Hang the part that was cut off on the other end of the arc
        let (inside, outside) = if below_source { (arc.from, arc.to) } else { (arc.to, arc.from) };
        self.hang(inside, outside, leaving, (delta, arc.cost));
        self.shift(inside, if below_source { -reduced } else { reduced });
    }

    /// Makes `top` the root of the subtree of `leaving`, and `parent` its parent, over an arc with this flow and cost.
    fn hang(&mut self, top: u32, parent: u32, leaving: u32, arc: (i64, f64)) {
        let (mut node, mut parent, mut arc) = (top, parent, arc);
        loop {
            let (above, place) = (self.parent[node as usize], node as usize);
            self.detach(node);
            self.attach(node, parent);
            arc = (std::mem::replace(&mut self.flow[place], arc.0), std::mem::replace(&mut self.cost[place], arc.1));
            if node == leaving {
                break;
            }
            (parent, node) = (node, above);
        }
    }

    /// Adds to the potentials of a subtree, and computes its depths.
    fn shift(&mut self, top: u32, by: f64) {
        self.stack.push(top);
        while let Some(node) = self.stack.pop() {
            let place = node as usize;
            self.potential[place] += by;
            self.depth[place] = self.depth[self.parent[place] as usize] + 1;
            let mut child = self.child[place];
            while child != NONE {
                self.stack.push(child);
                child = self.next[child as usize];
            }
        }
    }

    /// The plan; `from` and `to` are the numbers of the nodes that have mass.
    fn plan(&self, from: &[usize], to: &[usize], [sources, targets]: [usize; 2], costs: &Costs) -> Plan {
        let mut flows = Vec::new();
        let mut total = Vec::new();
        for node in 0..self.root {
            let (parent, flow) = (self.parent[node] as usize, self.flow[node]);
            if parent == self.root || flow == 0 {
                continue;
            }
            let (i, j) = if node < self.sources { (node, parent) } else { (parent, node) };
            let mass = flow as f64 / UNITS;
            total.push(mass * self.cost[node]);
            flows.push(Flow { from: from[i], to: to[j - self.sources], mass });
        }
        flows.sort_by_key(|flow| (flow.from, flow.to));
        let mut potentials = [vec![f64::INFINITY; sources], vec![f64::INFINITY; targets]];
        from.iter().enumerate().for_each(|(node, &i)| potentials[0][i] = -self.potential[node]);
        to.iter().enumerate().for_each(|(node, &j)| potentials[1][j] = self.potential[self.sources + node]);
        complete(&mut potentials, costs);
        Plan { flows, cost: total.iter().sum(), potentials }
    }
}

/// Gives nodes without mass the largest potentials that the others allow: targets first.
fn complete([sources, targets]: &mut [Vec<f64>; 2], costs: &Costs) {
    let mut buffer = Vec::new();
    let open: Vec<usize> = (0..targets.len()).filter(|&j| targets[j].is_infinite()).collect();
    if !open.is_empty() {
        for (i, u) in sources.iter().enumerate().filter(|(_, u)| u.is_finite()) {
            let row = costs.row(i, &mut buffer);
            open.iter().for_each(|&j| targets[j] = targets[j].min(row[j] - u));
        }
    }
    for (i, u) in sources.iter_mut().enumerate().filter(|(_, u)| u.is_infinite()) {
        let row = costs.row(i, &mut buffer);
        *u = row.iter().zip(targets.iter()).fold(f64::INFINITY, |least, (c, v)| least.min(c - v));
    }
}
