//! Builds a binary tree of triangles and converts it to nodes with eight children.

use std::time::Duration;

use glam::{Vec3, Vec4};
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::triangle::Triangle;
use obvhs::{BvhBuildParams, aabb::Aabb};

use super::collapse::Collapse;
use super::{LEAF, Node, PACKET, Packet, STACK, WIDTH};

/// A node of the binary tree: `count` triangles of the order, beginning with `first`, or the children `first` and
/// `first + 1`.
#[derive(Clone, Copy)]
pub(super) struct Binary {
    pub aabb: Aabb,
    pub first: u32,
    pub count: u32,
}

/// Maximum number of equal triangles given to clustering, whose time grows with their square.
const MAX_COPIES: usize = 200;

const EMPTY: Node = Node {
    bounds: [
        [f32::INFINITY; WIDTH],
        [f32::INFINITY; WIDTH],
        [f32::INFINITY; WIDTH],
        [f32::NEG_INFINITY; WIDTH],
        [f32::NEG_INFINITY; WIDTH],
        [f32::NEG_INFINITY; WIDTH],
    ],
    child: [0; WIDTH],
};

pub(super) fn build(triangles: &[[Vec3; 3]]) -> (Vec<Node>, Vec<Packet>) {
    if triangles.is_empty() {
        return (vec![EMPTY], Vec::new());
    }
    if most_copies(triangles) <= MAX_COPIES {
        let (nodes, order) = clustered(triangles);
        let wide = Wide::new(triangles, &nodes, &order);
        if wide.stack_need() <= STACK {
            return (wide.nodes, wide.packets);
        }
    }
    let (nodes, order) = balanced(triangles);
    let wide = Wide::new(triangles, &nodes, &order);
    (wide.nodes, wide.packets)
}

/// The largest number of triangles with the same first corner and box.
fn most_copies(triangles: &[[Vec3; 3]]) -> usize {
    let key = |&[a, b, c]: &[Vec3; 3]| [a, a.min(b).min(c), a.max(b).max(c)].map(|p| p.to_array().map(f32::to_bits));
    let mut keys: Vec<_> = triangles.iter().map(key).collect();
    keys.sort_unstable();
    keys.chunk_by(|a, b| a == b).map(<[_]>::len).max().unwrap_or(0)
}

/// The best tree, by locally-ordered clustering with re-insertion.
fn clustered(triangles: &[[Vec3; 3]]) -> (Vec<Binary>, Vec<u32>) {
    let list: Vec<Triangle> =
        triangles.iter().map(|t| Triangle { v0: t[0].into(), v1: t[1].into(), v2: t[2].into() }).collect();
    let config = BvhBuildParams {
        pre_split: false,
        reinsertion_batch_ratio: 0.1,
        // packets are chosen later, together with the wide nodes
        max_prims_per_leaf: 1,
        ..BvhBuildParams::medium_build()
    };
    let tree = build_bvh2_from_tris(&list, config, &mut Duration::default());
    let nodes =
        tree.nodes.iter().map(|n| Binary { aabb: *n.aabb(), first: n.first_index, count: n.prim_count }).collect();
    (nodes, tree.primitive_indices)
}

/// A tree of minimum depth, split in the middle of the longest axis, for input on which clustering degenerates.
fn balanced(triangles: &[[Vec3; 3]]) -> (Vec<Binary>, Vec<u32>) {
    let centre = |t: u32| triangles[t as usize].iter().sum::<Vec3>();
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut nodes = vec![Binary { aabb: Aabb::empty(), first: 0, count: order.len() as u32 }];
    let mut next = 0;
    while next < nodes.len() {
        let Binary { first, count, .. } = nodes[next];
        let part = &mut order[first as usize..][..count as usize];
        let mut aabb = Aabb::empty();
        for p in part.iter().flat_map(|&t| triangles[t as usize]) {
            aabb.extend(p.into());
        }
        nodes[next].aabb = aabb;
        if count as usize > PACKET {
            let axis = aabb.largest_axis();
            part.sort_by(|&a, &b| centre(a)[axis].total_cmp(&centre(b)[axis]));
            let half = count / 2;
            nodes[next] = Binary { aabb, first: nodes.len() as u32, count: 0 };
            nodes.push(Binary { aabb, first, count: half });
            nodes.push(Binary { aabb, first: first + half, count: count - half });
        }
        next += 1;
    }
    (nodes, order)
}

struct Wide<'a> {
    triangles: &'a [[Vec3; 3]],
    order: &'a [u32],
    collapse: Collapse<'a>,
    nodes: Vec<Node>,
    packets: Vec<Packet>,
}

impl<'a> Wide<'a> {
    fn new(triangles: &'a [[Vec3; 3]], binary: &'a [Binary], order: &'a [u32]) -> Self {
        let collapse = Collapse::new(binary);
        let mut wide = Self { triangles, order, collapse, nodes: vec![EMPTY], packets: Vec::new() };
        // (binary node, wide node it becomes), depth first, so that subtrees are contiguous in memory
        let mut open = vec![(0u32, 0u32)];
        while let Some((source, target)) = open.pop() {
            for (lane, &child) in wide.collapse.children(source).iter().enumerate() {
                let aabb = binary[child as usize].aabb;
                let packet = wide.collapse.is_packet(child);
                let index = if packet { wide.push_packet(child) } else { wide.push_node() };
                if !packet {
                    open.push((child, index));
                }
                let node = &mut wide.nodes[target as usize];
                for axis in 0..3 {
                    node.bounds[axis][lane] = aabb.min[axis];
                    node.bounds[3 + axis][lane] = aabb.max[axis];
                }
                node.child[lane] = if packet { index | LEAF } else { index };
            }
        }
        wide
    }

    fn push_node(&mut self) -> u32 {
        self.nodes.push(EMPTY);
        self.nodes.len() as u32 - 1
    }

    fn push_packet(&mut self, root: u32) -> u32 {
        let mut packet = Packet { corner: [[Vec4::ZERO; 3]; 3], triangle: [u32::MAX; PACKET] };
        let order = self.order;
        let triangles = self.collapse.leaves(root).flat_map(|b| &order[b.first as usize..][..b.count as usize]);
        for (lane, &t) in triangles.enumerate() {
            for (corner, position) in packet.corner.iter_mut().zip(self.triangles[t as usize]) {
                for axis in 0..3 {
                    corner[axis][lane] = position[axis];
                }
            }
            packet.triangle[lane] = t;
        }
        self.packets.push(packet);
        self.packets.len() as u32 - 1
    }

    /// Maximum number of entries on the traversal stack: seven siblings per level.
    fn stack_need(&self) -> usize {
        let mut need = 0;
        let mut open = vec![(0u32, 1usize)];
        while let Some((node, level)) = open.pop() {
            need = need.max(level * (WIDTH - 1) + 1);
            let node = &self.nodes[node as usize];
            let used = (0..WIDTH).filter(|&k| node.bounds[0][k] <= node.bounds[3][k] && node.child[k] & LEAF == 0);
            open.extend(used.map(|k| (node.child[k], level + 1)));
        }
        need
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_balanced_tree_is_shallow_and_holds_every_triangle_once() {
        // nested triangles of decreasing size, on which clustering gives long chains
        let triangle = |k: i32| [Vec3::ZERO, Vec3::X * 0.9f32.powi(k), Vec3::Y * 0.9f32.powi(k)];
        let triangles: Vec<_> = (0..5000).map(triangle).collect();
        let (binary, order) = balanced(&triangles);
        let wide = Wide::new(&triangles, &binary, &order);
        let mut found: Vec<u32> = wide.packets.iter().flat_map(|p| p.triangle).filter(|&t| t != u32::MAX).collect();
        found.sort_unstable();
        assert!(found.iter().copied().eq(0..5000));
        assert!(wide.stack_need() <= 7 * 12 + 1, "{}", wide.stack_need());
        for (node, lane) in wide.nodes.iter().flat_map(|n| (0..WIDTH).map(move |lane| (n, lane))) {
            if node.child[lane] & LEAF != 0 {
                let packet = &wide.packets[(node.child[lane] & !LEAF) as usize];
                for &t in packet.triangle.iter().filter(|&&t| t != u32::MAX) {
                    for (p, axis) in triangles[t as usize].iter().flat_map(|p| (0..3).map(move |axis| (p, axis))) {
                        assert!((node.bounds[axis][lane]..=node.bounds[3 + axis][lane]).contains(&p[axis]));
                    }
                }
            }
        }
    }
}
