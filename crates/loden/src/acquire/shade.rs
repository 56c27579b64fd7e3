//! Bounds of the shadows of every light, which save most shadow rays.

use glam::Vec3;
use rayon::prelude::*;

use super::reflect::LANES;

/// Memory limit of the bounds in bytes; larger fields get coarser bounds. Coarse bounds in the cache answer faster than
/// sharp ones in main memory.
const BUDGET: usize = 8 << 20;

/// Tolerance in cells, far above the rounding errors of rays and bounds.
const SLACK: f32 = 2e-3;

/// Length of the sweep before the recorded period, in periods, at most.
const LEAD_IN: usize = 2;

/// # Model
/// The shadow height of a light above a point is the height at which a vertical line leaves the shadow: points below it
/// are dark, points above it are lit. For every light and every block of cells, an upper and a lower bound of that
/// height are stored. They are computed by a sweep away from the light, line by line of the grid, over strips one cell
/// wide that run along the azimuth of the light. From one line to the next, the shadow sinks by the slope of the light
/// and rises to the highest (upper bound) or lowest (lower bound) points of the surface in the strip. The sweep starts
/// at least one length of the longest shadow before the recorded period, or with everything undecided.
///
/// # Limits
/// The bounds decide most points but not all: points near the edge of a shadow need a ray.
///
/// # References
/// timonen2010 (the sweep along an azimuth, there for sampled shadows instead of bounds)
#[derive(Debug)]
pub(super) struct Shade {
    /// Blocks are 2^shift cells wide.
    shift: u32,
    /// log2 of the number of blocks per side.
    log: u32,
    lowest: f32,
    /// Cells per quantisation step.
    step: f32,
    groups: usize,
    /// Upper and lower bounds: (block, group of lights).
    bounds: Vec<Bounds>,
}

/// Bounds for a group of lights above one block, in quantisation steps.
#[derive(Debug, Clone, Copy, Default)]
struct Bounds {
    above: [u16; LANES],
    below: [u16; LANES],
}

/// Heights above which all points of a block are lit, and below which all are dark.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range {
    pub block: usize,
    pub above: f32,
    pub below: f32,
}

impl Shade {
    /// Bounds for `lights` over `n` x `n` heights in cells, as fine as [`BUDGET`] allows.
    pub(super) fn new(n: usize, heights: &[f32], lights: &[Vec3]) -> Self {
        let bytes = |shift: u32| lights.len().div_ceil(LANES) * (n >> shift).pow(2) * size_of::<Bounds>();
        let log = n.trailing_zeros();
        Self::with_blocks((0..log).find(|&shift| bytes(shift) <= BUDGET).unwrap_or(log), n, heights, lights)
    }

    /// As [`Shade::new`], for blocks of 2^`shift` cells.
    pub(super) fn with_blocks(shift: u32, n: usize, heights: &[f32], lights: &[Vec3]) -> Self {
        let groups = lights.len().div_ceil(LANES);
        let lowest = heights.iter().copied().fold(f32::MAX, f32::min);
        let highest = heights.iter().copied().fold(f32::MIN, f32::max);
        let scale = 65_000.0 / (highest - lowest + 4.0 * SLACK);
        let turned: Vec<f32> = (0..n * n).map(|k| heights[k % n * n + k / n]).collect();
        let blocks = (n >> shift) * (n >> shift);
        let mut by_group = vec![Bounds::default(); groups * blocks];
        by_group.par_chunks_mut(blocks).zip(lights.par_chunks(LANES)).for_each(|(bounds, lights)| {
            for (lane, &light) in lights.iter().enumerate() {
                let across = light.x.abs() >= light.y.abs();
                let lines = if across { &turned } else { heights };
                let sweep = Sweep::new(n, lines, if across { light } else { Vec3::new(light.y, light.x, light.z) });
                // start from empty bounds
                for block in bounds.iter_mut() {
                    (block.above[lane], block.below[lane]) = (0, u16::MAX);
                }
                sweep.run(lowest, highest, &mut |line, at, above, below| {
                    let cell = if across { at << n.trailing_zeros() | line } else { line << n.trailing_zeros() | at };
                    let (x, y) = ((cell & (n - 1)) >> shift, cell >> n.trailing_zeros() >> shift);
                    let block = &mut bounds[y * (n >> shift) + x];
                    let above = ((above + SLACK - lowest) * scale).ceil() as u16;
                    let below = ((below - SLACK - lowest) * scale) as u16;
                    block.above[lane] = block.above[lane].max(above);
                    block.below[lane] = block.below[lane].min(below);
                });
            }
        });
        // store by block, since a path queries all lights of a few blocks
        let turned = (0..groups * blocks).into_par_iter().map(|k| by_group[k % groups * blocks + k / groups]);
        Self { shift, log: n.trailing_zeros() - shift, lowest, step: 1.0 / scale, groups, bounds: turned.collect() }
    }

    /// The index of the block of a cell, which may be outside the period.
    #[inline(always)]
    pub(super) fn block(&self, [x, y]: [i32; 2]) -> usize {
        let mask = (1i32 << self.log) - 1;
        ((((y >> self.shift) & mask) as usize) << self.log) | ((x >> self.shift) & mask) as usize
    }

    /// The bounds of a block for one light.
    #[inline(always)]
    pub(super) fn range(&self, block: usize, light: usize) -> Range {
        let bounds = &self.bounds[block * self.groups + light / LANES];
        let height = |steps: u16| f32::from(steps) * self.step + self.lowest;
        Range { block, above: height(bounds.above[light % LANES]), below: height(bounds.below[light % LANES]) }
    }

    /// The visibility of a point at height `z` in `cell` for a group of lights: 1 for lit, 0 for dark, -1 for
    /// undecided.
    #[inline(always)]
    pub(super) fn verdicts(&self, cell: [i32; 2], z: f32, group: usize) -> [f32; LANES] {
        let bounds = &self.bounds[self.block(cell) * self.groups + group];
        let z = (z - self.lowest) / self.step;
        std::array::from_fn(|i| {
            let open = if z < f32::from(bounds.below[i]) { 0.0 } else { -1.0 };
            if z > f32::from(bounds.above[i]) { 1.0 } else { open }
        })
    }
}

/// The sweep for one light, whose azimuth is closer to the direction across the lines than to that along them.
struct Sweep<'a> {
    n: usize,
    /// Heights, line by line.
    lines: &'a [f32],
    /// Whether the light is in the direction of increasing line numbers.
    forward: bool,
    /// Shift along a line from one line to the next, towards the light.
    shear: f64,
    /// Distance that a shadow sinks per line.
    sink: f32,
}

impl<'a> Sweep<'a> {
    fn new(n: usize, lines: &'a [f32], light: Vec3) -> Self {
        let across = light.x.abs().max(1e-9);
        let shear = f64::from(light.y) / f64::from(across);
        let sink = light.z / across;
        Self { n, lines, forward: light.x > 0.0, shear, sink }
    }

    /// Line `k`, counted towards the light, shifted: `out[m]` is its point `m + first`.
    fn line(&self, k: i64, first: i64, out: &mut Vec<f32>) {
        let n = self.n as i64;
        let k = if self.forward { k } else { -k }.rem_euclid(n) as usize;
        let line = &self.lines[k * self.n..][..self.n];
        let first = first.rem_euclid(n) as usize;
        out.clear();
        out.extend_from_slice(&line[first..]);
        out.extend_from_slice(&line[..first]);
        out.extend_from_within(..4);
    }

    /// Calls `record` with line, position, upper and lower bound of every cell.
    fn run(&self, lowest: f32, highest: f32, record: &mut impl FnMut(usize, usize, f32, f32)) {
        let n = self.n;
        let reach = ((highest - lowest) / self.sink).ceil().min((LEAD_IN * n) as f32) as i64 + 1;
        let (mut above, mut below) = (vec![highest; n], vec![lowest; n]);
        let (mut far, mut near) = (Vec::new(), Vec::new());
        let (mut upper, mut lower) = (vec![0.0; n + 4], vec![0.0; n + 4]);
        for k in (0..n as i64 + reach).rev() {
            // the part of the column between lines k and k + 1 that strip 0 covers
            let (a, b) = (self.shear * k as f64, self.shear * (k + 1) as f64);
            let (low, high) = (a.min(b) - f64::from(SLACK), a.max(b) + 1.0 + f64::from(SLACK));
            let span = (high.ceil() - low.floor()) as usize;
            self.line(k + 1, low.floor() as i64, &mut far);
            self.line(k, low.floor() as i64, &mut near);
            let most = |line: &[f32], m: usize| line[m..=m + span.min(4)].iter().copied().fold(f32::MIN, f32::max);
            for m in 0..n {
                let (far, near) = (most(&far, m), most(&near, m));
                upper[m] = above[m].max(far).max(near);
                lower[m] = below[m] - self.sink;
                above[m] = (above[m].max(far) - self.sink).max(near);
            }
            let first = (a - f64::from(SLACK)).floor();
            let span = ((a + 1.0 + f64::from(SLACK)).ceil() - first) as usize;
            self.line(k, first as i64, &mut near);
            for m in 0..n {
                let least = near[m..=m + span.min(3)].iter().copied().fold(f32::MAX, f32::min);
                below[m] = lower[m].max(least);
            }
            if k < n as i64 {
                upper.copy_within(..4, n);
                lower.copy_within(..4, n);
                self.cells(k, [low, high], &upper, &lower, record);
            }
        }
    }

    /// Derives the bounds of the cells between lines `k` and `k + 1` from those of the strips.
    fn cells(
        &self,
        k: i64,
        [low, high]: [f64; 2],
        upper: &[f32],
        lower: &[f32],
        record: &mut impl FnMut(usize, usize, f32, f32),
    ) {
        let n = self.n as i64;
        let line = if self.forward { k } else { -k - 1 }.rem_euclid(n) as usize;
        // strip m covers positions m + low to m + high, a cell those from j to j + 1
        let (first, last) = (-high.floor() as i64, (1.0 - low).floor() as i64);
        let count = (last - first) as usize;
        let mut m = first.rem_euclid(n) as usize;
        for j in 0..self.n {
            let above = upper[m..=m + count].iter().copied().fold(f32::MIN, f32::max);
            let below = lower[m..=m + count].iter().copied().fold(f32::MAX, f32::min);
            record(line, j, above, below);
            m = (m + 1) & (self.n - 1);
        }
    }
}
