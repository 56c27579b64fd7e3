//! Collapses a binary tree: chooses the subtrees that become nodes with eight children, and the packets of triangles.

use super::build::Binary;
use super::{PACKET, WIDTH};

/// Cost of testing eight boxes, and of testing four triangles, used or not.
const NODE_COST: f32 = 1.0;
const PACKET_COST: f32 = 1.0;

/// The cheapest wide tree that a binary tree can be collapsed into.
///
/// # Model
/// The cost of a tree is the sum over its nodes and packets of surface area times test cost. From the bottom up, the
/// minimum cost of each binary subtree is computed as a forest of at most 1, 2, ... 7 trees. A single tree is a
/// packet, if it has at most four triangles, or a node over the cheapest forest of eight; more trees are divided
/// between both children.
///
/// # References
/// ylitie2017 section 4.1
pub(super) struct Collapse<'a> {
    binary: &'a [Binary],
    plans: Vec<Plan>,
}

/// The cheapest ways to turn a binary subtree into trees.
#[derive(Clone, Copy)]
struct Plan {
    /// Number of triangles in the subtree.
    count: u32,
    /// Cost of a forest of at most 1, 2, ... trees.
    cost: [f32; WIDTH - 1],
    /// How many of these trees come from the first child; 0 if one tree fewer costs no more.
    first: [u8; WIDTH],
    /// Whether a single tree is a packet.
    packet: bool,
}

const UNKNOWN: Plan = Plan { count: 0, cost: [0.0; WIDTH - 1], first: [0; WIDTH], packet: false };

impl<'a> Collapse<'a> {
    pub(super) fn new(binary: &'a [Binary]) -> Self {
        let mut order = vec![0u32];
        let mut next = 0;
        while next < order.len() {
            let node = &binary[order[next] as usize];
            if node.count == 0 {
                order.extend([node.first, node.first + 1]);
            }
            next += 1;
        }
        let mut plans = vec![UNKNOWN; binary.len()];
        for &index in order.iter().rev() {
            let node = &binary[index as usize];
            let area = node.aabb.half_area();
            plans[index as usize] = if node.count > 0 {
                Plan { count: node.count, cost: [PACKET_COST * area; WIDTH - 1], packet: true, ..UNKNOWN }
            } else {
                Plan::over(&plans[node.first as usize], &plans[node.first as usize + 1], area)
            };
        }
        Self { binary, plans }
    }

    /// Whether the subtree is a packet as a single tree.
    pub(super) fn is_packet(&self, index: u32) -> bool {
        self.plans[index as usize].packet
    }

    /// The subtrees that become the children of a subtree's wide node. For the root, which is always a node, this can
    /// be the subtree itself, as a packet.
    pub(super) fn children(&self, root: u32) -> Vec<u32> {
        if self.is_packet(root) {
            return vec![root];
        }
        let mut list = Vec::with_capacity(WIDTH);
        let mut open = vec![(root, WIDTH)];
        while let Some((index, mut trees)) = open.pop() {
            let plan = &self.plans[index as usize];
            while trees > 1 && plan.first[trees - 1] == 0 {
                trees -= 1;
            }
            if trees == 1 {
                list.push(index);
                continue;
            }
            let (child, first) = (self.binary[index as usize].first, plan.first[trees - 1] as usize);
            open.extend([(child + 1, trees - first), (child, first)]);
        }
        list
    }

    /// The leaves of a subtree.
    pub(super) fn leaves(&self, root: u32) -> impl Iterator<Item = &'a Binary> + use<'a> {
        let (binary, mut open) = (self.binary, vec![root]);
        std::iter::from_fn(move || {
            loop {
                let node = &binary[open.pop()? as usize];
                if node.count > 0 {
                    return Some(node);
                }
                open.extend([node.first + 1, node.first]);
            }
        })
    }
}

impl Plan {
    /// The costs of a node with this surface area over two subtrees.
    fn over(a: &Self, b: &Self, area: f32) -> Self {
        let shared = |trees: usize| {
            let split = |first: usize| (a.cost[first - 1] + b.cost[trees - first - 1], first as u8);
            (1..trees).map(split).min_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or((f32::INFINITY, 0))
        };
        let mut plan = Self { count: a.count + b.count, ..UNKNOWN };
        let (below, first) = shared(WIDTH);
        plan.first[WIDTH - 1] = first;
        plan.cost[0] = below + NODE_COST * area;
        if plan.count as usize <= PACKET && PACKET_COST * area <= plan.cost[0] {
            plan.cost[0] = PACKET_COST * area;
            plan.packet = true;
        }
        for trees in 2..WIDTH {
            let (cost, first) = shared(trees);
            let fewer = plan.cost[trees - 2];
            (plan.cost[trees - 1], plan.first[trees - 1]) = if cost < fewer { (cost, first) } else { (fewer, 0) };
        }
        plan
    }
}
