//! Short searches in tables of integrals.

use super::warp::Stencil;

/// The most nodes along a side: guides count them in 16 bits.
pub(super) const MAX_NODES: usize = 1 << 16;

/// Between which nodes a part of an integral is reached.
///
/// # Model
/// The integral of a mixture of densities reaches a part of its whole between the first and the last place where one of
/// them does.
///
/// # References
/// chen1974
#[derive(Debug, Clone)]
pub(super) struct Guide {
    tables: usize,
    /// `[step][table]`: the last node but one up to which the integral is at most this step of its whole; and one more.
    nodes: Vec<u16>,
}

impl Guide {
    /// Steps from none to the whole.
    const STEPS: usize = 128;

    /// Of integrals that ascend from 0: `integral(node, table)`.
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

    /// The first and the last node around a part of the whole, 0 to 1, of a mixture of tables.
    #[inline(always)]
    pub(super) fn around<const N: usize>(&self, stencil: &Stencil<N>, part: f32) -> [usize; 2] {
        let step = ((part * Self::STEPS as f32) as usize).min(Self::STEPS - 1);
        let (low, high) = self.nodes[step * self.tables..].split_at(self.tables);
        let [mut first, mut last] = [u16::MAX, 0];
        for pair in stencil {
            // a table without weight makes the interval no smaller
            for table in [pair.first, (pair.first + 1).min(self.tables - 1)] {
                first = first.min(low[table]);
                last = last.max(high[table]);
            }
        }
        [first.into(), usize::from(last) + 1]
    }
}

/// The last node between two, but for the second, whose ascending value is not above `target`.
#[inline(always)]
pub(super) fn lower([mut low, mut high]: [usize; 2], target: f32, value: impl Fn(usize) -> f32) -> usize {
    while high - low > 1 {
        let middle = (low + high) / 2;
        let is_below = value(middle) <= target;
        (low, high) = (if is_below { middle } else { low }, if is_below { high } else { middle });
    }
    low
}
