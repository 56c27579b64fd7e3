//! Tables over the unit square, and the warp that samples points by one.

use glam::{Vec2, Vec4};

use super::super::possible;
use super::guide::{Guide, MAX_NODES, lower};
use crate::simd::prefetch;
use crate::{Error, Result};

/// Tables to interpolate between, and their weights.
pub(super) type Stencil<const N: usize> = [Pair; N];

/// Two adjacent tables. The second may be past the end if its weight is 0.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pair {
    pub(super) first: usize,
    pub(super) weights: [f32; 2],
}

/// A position in a table: the cell, and the fractions along x and y.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cell {
    node: u32,
    x: f32,
    y: f32,
}

impl Cell {
    #[inline(always)]
    fn new(p: Vec2, [rows, columns]: [usize; 2]) -> Self {
        let ((x, fx), (y, fy)) = (cell(p.x, columns), cell(p.y, rows));
        Self { node: y * columns as u32 + x, x: fx, y: fy }
    }
}

/// Number of positions looked up together.
pub(super) const BLOCK: usize = 64;

/// A number for each position of a block.
pub(super) type Lane = [f32; BLOCK];

/// A block of cells.
pub(super) struct Cells {
    node: [u32; BLOCK],
    x: Lane,
    y: Lane,
}

impl Cells {
    #[inline(always)]
    fn new([px, py]: &[Lane; 2], size: [usize; 2]) -> Self {
        let mut cells = Self { node: [0; BLOCK], x: [0.0; BLOCK], y: [0.0; BLOCK] };
        for k in 0..BLOCK {
            Cell { node: cells.node[k], x: cells.x[k], y: cells.y[k] } = Cell::new(Vec2::new(px[k], py[k]), size);
        }
        cells
    }

    #[inline(always)]
    pub(super) fn get(&self, k: usize) -> Cell {
        Cell { node: self.node[k], x: self.x[k], y: self.y[k] }
    }
}

/// Tables of one size, bilinear between nodes; the first and last nodes are at 0 and 1.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    rows: usize,
    columns: usize,
    values: Vec<f32>,
}

impl Grid {
    /// `values` holds `count` tables of shape `[rows, columns]`.
    pub(super) fn new(name: &str, [rows, columns]: [usize; 2], count: usize, values: Vec<f32>) -> Result<Self> {
        if rows < 2 || columns < 2 || rows.max(columns) > MAX_NODES || values.len() != rows * columns * count {
            let problem = format!(
                "{} numbers, expected {count} tables of {rows} x {columns}, at least 2 x 2 and at most {MAX_NODES} along a side",
                values.len()
            );
            return Err(Error::parameter(name, problem));
        }
        if let Some(i) = values.iter().position(|v| v.is_nan()) {
            return Err(Error::parameter(name, format!("number {i} is not a number")));
        }
        possible(name, values.iter().copied())?;
        Ok(Self { rows, columns, values })
    }

    /// A single table computed by this program.
    pub(super) fn unchecked([rows, columns]: [usize; 2], values: Vec<f32>) -> Self {
        Self { rows, columns, values }
    }

    #[inline(always)]
    pub(super) fn at(&self, table: usize, p: Vec2) -> f32 {
        self.at_cell(table, Cell::new(p, [self.rows, self.columns]))
    }

    #[inline(always)]
    pub(super) fn cells(&self, places: &[Lane; 2]) -> Cells {
        Cells::new(places, [self.rows, self.columns])
    }

    #[inline(always)]
    pub(super) fn at_cell(&self, table: usize, Cell { node, x, y }: Cell) -> f32 {
        let from = table * self.rows * self.columns + node as usize;
        let values = &self.values[from..from + self.columns + 2];
        let (low, high) = (&values[..2], &values[self.columns..]);
        (low[0] * (1.0 - x) + low[1] * x) * (1.0 - y) + (high[0] * (1.0 - x) + high[1] * x) * y
    }
}

/// The interval of `nodes` equally spaced nodes on 0..1 that contains `x`, and the fraction within it.
#[inline(always)]
fn cell(x: f32, nodes: usize) -> (u32, f32) {
    let x = x.clamp(0.0, 1.0) * (nodes - 1) as f32;
    let cell = (x as i32).min(nodes as i32 - 2);
    (cell as u32, x - cell as f32)
}

/// Colours over the unit square in several tables, arranged so that one look-up reads contiguous memory.
#[derive(Debug, Clone)]
pub(super) struct Colors {
    rows: usize,
    columns: usize,
    tables: usize,
    /// `[row][column][table]`, plus one padding entry.
    values: Vec<Vec4>,
}

impl Colors {
    /// `values` holds `tables` times three images, one per channel.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub(super) fn new(name: &str, size: [usize; 2], tables: usize, values: Vec<f32>) -> Result<Self> {
        let Grid { rows, columns, values } = Grid::new(name, size, 3 * tables, values)?;
        let place = |i: usize| (i % tables * 3 * rows * columns) + i / tables;
        let channel = |i: usize, c: usize| values[place(i) + c * rows * columns];
        let color = |i| Vec4::new(channel(i, 0), channel(i, 1), channel(i, 2), 0.0);
        let values = (0..rows * columns * tables).map(color).chain([Vec4::ZERO]).collect();
        Ok(Self { rows, columns, tables, values })
    }

    #[inline(always)]
    pub(super) fn at<const N: usize>(&self, stencil: &Stencil<N>, p: Vec2) -> Vec4 {
        self.at_cell(stencil, Cell::new(p, [self.rows, self.columns]))
    }

    #[inline(always)]
    pub(super) fn cells(&self, places: &[Lane; 2]) -> Cells {
        Cells::new(places, [self.rows, self.columns])
    }

    #[inline(always)]
    pub(super) fn at_cell<const N: usize>(&self, stencil: &Stencil<N>, Cell { node, x, y }: Cell) -> Vec4 {
        let (from, next) = (node as usize * self.tables, self.columns * self.tables);
        let mut sum = Vec4::ZERO;
        for pair in stencil {
            let from = from + pair.first;
            let corner = |from: usize| {
                let two = &self.values[from..from + 2];
                two[0] * pair.weights[0] + two[1] * pair.weights[1]
            };
            let low = corner(from) * (1.0 - x) + corner(from + self.tables) * x;
            let high = corner(from + next) * (1.0 - x) + corner(from + next + self.tables) * x;
            sum += low * (1.0 - y) + high * y;
        }
        sum
    }
}

/// Densities over the unit square, bilinear between nodes, with the integrals that sampling needs, arranged so that
/// one look-up reads contiguous memory.
#[derive(Debug, Clone)]
pub(super) struct Warp {
    rows: usize,
    columns: usize,
    tables: usize,
    /// `[row][column][table]`: the density, and the integral of the row up to here; plus one padding entry.
    nodes: Vec<Vec2>,
    /// `[row][table]`: the integral of all rows up to this one, and that of this row; plus one padding entry.
    sums: Vec<Vec2>,
    /// Search guide for rows.
    rows_guide: Guide,
    /// Search guides for columns, one per row.
    columns_guide: Vec<Guide>,
}

/// A sampled position between two rows, and the target along them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Between {
    y: usize,
    fy: f32,
    /// The target integral along the row.
    target: f32,
    /// The nodes between which the target is reached.
    around: [usize; 2],
}

impl Warp {
    /// Scales each table to integral 1; a table that is zero everywhere becomes uniform.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the table if its size is wrong, or a value is negative, too large or not a number.
    pub(super) fn new(name: &str, size: [usize; 2], count: usize, values: Vec<f32>) -> Result<Self> {
        let values = Grid::new(name, size, count, values)?.values;
        if let Some(i) = values.iter().position(|v| *v < 0.0) {
            return Err(Error::parameter(name, format!("number {i} is negative, but a density cannot be")));
        }
        Ok(Self::unchecked(size, values))
    }

    /// As [`Warp::new`], for tables computed by this program.
    pub(super) fn unchecked([rows, columns]: [usize; 2], mut values: Vec<f32>) -> Self {
        let cells = rows * columns;
        let tables = values.len() / cells;
        let (mut nodes, mut sums) = (vec![Vec2::ZERO; values.len() + 1], vec![Vec2::ZERO; rows * tables + 1]);
        for (t, table) in values.chunks_exact_mut(cells).enumerate() {
            let Integrals { along, marginal, .. } = normalise(table, columns);
            (0..cells).for_each(|i| nodes[i * tables + t] = Vec2::new(table[i], along[i]));
            (0..rows).for_each(|y| sums[y * tables + t] = Vec2::new(marginal[y], along[(y + 1) * columns - 1]));
        }
        let rows_guide = Guide::new(rows, tables, |y, t| sums[y * tables + t].x);
        let row_guide = |y: usize| Guide::new(columns, tables, |x, t| nodes[(y * columns + x) * tables + t].y);
        let columns_guide = (0..rows).map(row_guide).collect();
        Self { rows, columns, tables, nodes, sums, rows_guide, columns_guide }
    }

    pub(super) fn size(&self) -> [usize; 2] {
        [self.rows, self.columns]
    }

    /// Density, and integral of row `y` up to this node.
    #[inline(always)]
    fn node<const N: usize>(&self, stencil: &Stencil<N>, x: usize, y: usize) -> Vec2 {
        blend(&self.nodes[(y * self.columns + x) * self.tables..], stencil)
    }

    /// Integral of all rows up to `y`, and of row `y`.
    #[inline(always)]
    fn row<const N: usize>(&self, stencil: &Stencil<N>, y: usize) -> Vec2 {
        blend(&self.sums[y * self.tables..], stencil)
    }

    /// [`Warp::node`] at the fraction `fy` from row `y` to the next.
    #[inline(always)]
    fn between<const N: usize>(&self, stencil: &Stencil<N>, x: usize, (y, fy): (usize, f32)) -> Vec2 {
        (1.0 - fy) * self.node(stencil, x, y) + fy * self.node(stencil, x, y + 1)
    }

    #[inline(always)]
    pub(super) fn density<const N: usize>(&self, stencil: &Stencil<N>, p: Vec2) -> f32 {
        let ((x, fx), (y, fy)) = (cell(p.x, self.columns), cell(p.y, self.rows));
        let (x, y) = (x as usize, y as usize);
        let row = |y| self.node(stencil, x, y).x * (1.0 - fx) + self.node(stencil, x + 1, y).x * fx;
        row(y) * (1.0 - fy) + row(y + 1) * fy
    }

    /// Maps uniform points of the square to points distributed by the density, and returns the density there.
    #[inline(always)]
    pub(super) fn warp<const N: usize>(&self, stencil: &Stencil<N>, u: Vec2) -> (Vec2, f32) {
        self.along(stencil, self.between_rows(stencil, u))
    }

    /// First half of [`Warp::warp`]; prefetches what the second half reads first.
    #[inline(always)]
    pub(super) fn between_rows<const N: usize>(&self, stencil: &Stencil<N>, u: Vec2) -> Between {
        // Choose the row interval, then the position in it: the marginal density is linear there
        let y = lower(self.rows_guide.around(stencil, u.y), u.y, |y| self.row(stencil, y).x);
        let (a, b) = (self.row(stencil, y), self.row(stencil, y + 1));
        let fy = invert_linear(a.y, b.y, (u.y - a.x) * (self.rows - 1) as f32);
        let target = u.x * ((1.0 - fy) * a.y + fy * b.y);
        let below = self.columns_guide[y].around(stencil, u.x);
        let above = self.columns_guide[y + 1].around(stencil, u.x);
        let around = [below[0].min(above[0]), below[1].max(above[1])];
        let middle = (around[0] + around[1]) / 2;
        for pair in stencil {
            for y in [y, y + 1] {
                prefetch(&self.nodes, (y * self.columns + middle) * self.tables + pair.first);
            }
        }
        Between { y, fy, target, around }
    }

    /// Second half of [`Warp::warp`].
    #[inline(always)]
    pub(super) fn along<const N: usize>(&self, stencil: &Stencil<N>, at: Between) -> (Vec2, f32) {
        let (Between { y, fy, target, around }, last) = (at, self.columns - 1);
        let mix = |x: usize| self.between(stencil, x, (y, fy));
        let x = lower(around, target, |x| mix(x).y);
        let (left, right) = (mix(x), mix(x + 1));
        let fx = invert_linear(left.x, right.x, (target - left.y) * last as f32);
        let place = Vec2::new((x as f32 + fx) / last as f32, (y as f32 + fy) / (self.rows - 1) as f32);
        (place, left.x * (1.0 - fx) + right.x * fx)
    }

    /// The inverse of [`Warp::warp`].
    #[inline(always)]
    pub(super) fn invert<const N: usize>(&self, stencil: &Stencil<N>, p: Vec2) -> Vec2 {
        let cell = Cell::new(p, self.size());
        let (sides, rows) = self.around(stencil, cell);
        self.integrate(sides, rows, cell, p.x)
    }

    #[inline(always)]
    pub(super) fn cells(&self, places: &[Lane; 2]) -> Cells {
        Cells::new(places, self.size())
    }

    /// Prefetches what [`Warp::around`] reads.
    #[inline(always)]
    pub(super) fn prefetch<const N: usize>(&self, stencil: &Stencil<N>, cell: Cell) {
        let (from, next) = (cell.node as usize * self.tables, self.columns * self.tables);
        for pair in stencil {
            for start in [from, from + self.tables, from + next, from + next + self.tables] {
                prefetch(&self.nodes, start + pair.first);
            }
        }
    }

    /// The inputs of [`Warp::integrate`]: density and integral at the left and right of a position, integral and sum
    /// of the rows below and above.
    #[inline(always)]
    pub(super) fn around<const N: usize>(&self, stencil: &Stencil<N>, cell: Cell) -> (Vec4, Vec4) {
        let (columns, tables) = (self.columns, self.tables);
        let (from, next) = (cell.node as usize * tables, columns * tables);
        let row = cell.node as usize / columns * tables;
        let across = |from: usize| two(&self.nodes, from) * (1.0 - cell.y) + two(&self.nodes, from + next) * cell.y;
        let [mut left, mut right, mut a, mut b] = [Vec4::ZERO; 4];
        for pair in stencil {
            let weights = pair.four();
            left += across(from + pair.first) * weights;
            right += across(from + tables + pair.first) * weights;
            a += two(&self.sums, row + pair.first) * weights;
            b += two(&self.sums, row + tables + pair.first) * weights;
        }
        (both(left, right), both(a, b))
    }

    /// The integrals up to the position `x` of a cell.
    #[inline(always)]
    pub(super) fn integrate(&self, sides: Vec4, rows: Vec4, cell: Cell, x: f32) -> Vec2 {
        let v = rows.x + integral(rows.y, rows.w, cell.y) * (1.0 / (self.rows - 1) as f32);
        let whole = (1.0 - cell.y) * rows.y + cell.y * rows.w;
        let u = sides.y + integral(sides.x, sides.z, cell.x) * (1.0 / (self.columns - 1) as f32);
        Vec2::new(if whole > 0.0 { u / whole } else { x }.clamp(0.0, 1.0), v.clamp(0.0, 1.0))
    }
}

impl Pair {
    #[inline(always)]
    fn four(&self) -> Vec4 {
        let [a, b] = self.weights;
        Vec4::new(a, a, b, b)
    }
}

/// Two numbers from two tables.
#[inline(always)]
fn two(values: &[Vec2], from: usize) -> Vec4 {
    let two = &values[from..from + 2];
    Vec4::new(two[0].x, two[0].y, two[1].x, two[1].y)
}

/// The sums of the halves of `a` and of `b`.
#[inline(always)]
fn both(a: Vec4, b: Vec4) -> Vec4 {
    Vec4::new(a.x, a.y, b.x, b.y) + Vec4::new(a.z, a.w, b.z, b.w)
}

/// The weighted sum over the tables at the start of `values`.
#[inline(always)]
fn blend<const N: usize>(values: &[Vec2], stencil: &Stencil<N>) -> Vec2 {
    let sum = stencil.iter().fold(Vec4::ZERO, |sum, pair| sum + two(values, pair.first) * pair.four());
    Vec2::new(sum.x + sum.z, sum.y + sum.w)
}

pub(super) struct Integrals {
    along: Vec<f32>,
    marginal: Vec<f32>,
    total: f64,
}

/// Scales a density to integral 1; a density that is zero everywhere becomes uniform.
pub(super) fn normalise(table: &mut [f32], columns: usize) -> Integrals {
    let total = integrate(table, columns).total;
    if total > 0.0 {
        // in double precision, so that extreme numbers in a file do not become zero or infinite
        table.iter_mut().for_each(|v| *v = (f64::from(*v) / total) as f32);
    } else {
        table.fill(1.0);
    }
    integrate(table, columns)
}

fn integrate(table: &[f32], columns: usize) -> Integrals {
    let rows = table.len() / columns;
    let mut along = Vec::with_capacity(table.len());
    let mut marginal = Vec::with_capacity(rows);
    let (mut total, mut previous) = (0.0f64, None);
    for row in table.chunks_exact(columns) {
        let mut sum = 0.0f64;
        along.push(0.0);
        for pair in row.windows(2) {
            sum += 0.5 * (f64::from(pair[0]) + f64::from(pair[1])) / (columns - 1) as f64;
            along.push(sum as f32);
        }
        total += previous.map_or(0.0, |previous: f64| 0.5 * (previous + sum) / (rows - 1) as f64);
        previous = Some(sum);
        marginal.push(total as f32);
    }
    Integrals { along, marginal, total }
}

/// The integral from 0 to `t` of a density linear from `a` to `b`.
#[inline(always)]
fn integral(a: f32, b: f32, t: f32) -> f32 {
    t * (a + 0.5 * t * (b - a))
}

/// The position t in 0..1 up to which a density linear from `a` to `b` has the integral `target`.
#[inline(always)]
fn invert_linear(a: f32, b: f32, target: f32) -> f32 {
    let root = (a * a + 2.0 * target.max(0.0) * (b - a)).max(0.0).sqrt();
    let t = if a + root > 0.0 { 2.0 * target.max(0.0) / (a + root) } else { 0.0 };
    t.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::{Grid, normalise};

    #[test]
    fn impossible_numbers_are_named() {
        for value in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e13] {
            let error = Grid::new("ndf", [2, 2], 1, vec![1.0, 1e12, value, 0.0]).unwrap_err().to_string();
            assert!(error.contains("ndf") && error.contains("number 2"), "{error}");
        }
    }

    #[test]
    fn densities_of_any_magnitude_are_scaled() {
        for value in [2e-41f32, 1.0, 3e38] {
            let mut table = [value; 12];
            let integrals = normalise(&mut table, 4);
            assert!((integrals.total - 1.0).abs() < 1e-6, "{value}: {}", integrals.total);
            assert!(table.iter().all(|v| (v - 1.0).abs() < 1e-6), "{value}: {table:?}");
        }
    }
}
