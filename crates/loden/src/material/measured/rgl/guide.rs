//! Guide tables for short searches in cumulative integrals.

use super::warp::Stencil;

/// The largest number of nodes along a side, since guides count nodes in 16 bits.
pub(super) const MAX_NODES: usize = 1 << 16;

/// Bounds the nodes between which an integral reaches a fraction of its total.
///
/// # Model
/// The integral of a mixture of densities reaches a given fraction of its total between the first and the last node
/// where one of the densities does.
///
/// # References
/// chen1974
#[derive(Debug, Clone)]
pub(super) struct Guide {
    tables: usize,
    /// `[step][table]`: the last node but one whose integral is at most this step of the total; and one more.
    nodes: Vec<u16>,
}

impl Guide {
    /// Number of steps from zero to the total.
    const STEPS: usize = 128;

    /// Builds guides for integrals `integral(node, table)` that ascend from 0.
    pub(super) fn new(nodes: usize, tables: usize, integral: impl Fn(usize, usize) -> f32) -> Self {
        let mut found = vec![0; (Self::STEPS + 1) * tables + 1];
        for table in 0..tables {
            let (mut node, whole) = (0, integral(nodes - 1, table));
            for step in 0..=Self::STEPS {
                let target = whole * (step as f32 / Self::STEPS as f32);
                while node + 2 < nodes && integral(node + 1, table) <= target {
                    node += 1;
                }
                found[step * tables + table] = node as u16;
            }
        }
        Self { tables, nodes: found }
    }

    /// The first and last node around a fraction 0..1 of the total, for a mixture of tables.
    #[inline(always)]
    pub(super) fn around<const N: usize>(&self, stencil: &Stencil<N>, part: f32) -> [usize; 2] {
        let step = ((part * Self::STEPS as f32) as usize).min(Self::STEPS - 1);
        let (low, high) = self.nodes[step * self.tables..].split_at(self.tables);
        let [mut first, mut last] = [u16::MAX, 0];
        for pair in stencil {
            // a table without weight does not narrow the interval
            for table in [pair.first, (pair.first + 1).min(self.tables - 1)] {
                first = first.min(low[table]);
                last = last.max(high[table]);
            }
        }
        [first.into(), usize::from(last) + 1]
    }
}

/// The last node between `first` and `last`, excluding `last`, whose ascending value does not exceed `target`.
#[inline(always)]
pub(super) fn lower([mut low, mut high]: [usize; 2], target: f32, value: impl Fn(usize) -> f32) -> usize {
    while high - low > 1 {
        let middle = (low + high) / 2;
        let is_below = value(middle) <= target;
        (low, high) = (if is_below { middle } else { low }, if is_below { high } else { middle });
    }
    low
}
