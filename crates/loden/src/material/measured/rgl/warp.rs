//! Tables over the unit square, and the map that draws points by one.

use glam::{Vec2, Vec4};

use crate::{Error, Result};

/// Some tables and their weights.
pub(super) type Stencil<const N: usize> = [(usize, f32); N];

/// Several tables of one size, linear between their nodes; the first and last nodes are at 0 and 1.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    rows: usize,
    columns: usize,
    values: Vec<f32>,
}

impl Grid {
    /// `values` holds `count` tables of `[rows, columns]`.
    pub(super) fn new(name: &str, [rows, columns]: [usize; 2], count: usize, values: Vec<f32>) -> Result<Self> {
        if rows < 2 || columns < 2 || values.len() != rows * columns * count {
            let problem = format!("{} numbers, expected {count} tables of {rows} x {columns} >= 2 x 2", values.len());
            return Err(Error::parameter(name, problem));
        }
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::parameter(name, format!("number {i} is not finite")));
        }
        Ok(Self { rows, columns, values })
    }

    /// One table of the program's own.
    pub(super) fn unchecked([rows, columns]: [usize; 2], values: Vec<f32>) -> Self {
        Self { rows, columns, values }
    }

    #[inline(always)]
    pub(super) fn at(&self, table: usize, p: Vec2) -> f32 {
        let ((x, fx), (y, fy)) = (cell(p.x, self.columns), cell(p.y, self.rows));
        let from = (table * self.rows + y) * self.columns + x;
        let values = &self.values[from..from + self.columns + 2];
        let (low, high) = (&values[..2], &values[self.columns..]);
        (low[0] * (1.0 - fx) + low[1] * fx) * (1.0 - fy) + (high[0] * (1.0 - fx) + high[1] * fx) * fy
    }
}

/// The interval of `nodes` equally spaced nodes on 0..1 that holds `x`, and the way through it.
#[inline(always)]
fn cell(x: f32, nodes: usize) -> (usize, f32) {
    let x = x.clamp(0.0, 1.0) * (nodes - 1) as f32;
    let cell = (x as usize).min(nodes - 2);
    (cell, x - cell as f32)
}

/// Colours over the unit square in several tables; what is read together lies together.
#[derive(Debug, Clone)]
pub(super) struct Colors {
    rows: usize,
    columns: usize,
    tables: usize,
    /// `[row][column][table]`
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
        Ok(Self { rows, columns, tables, values: (0..rows * columns * tables).map(color).collect() })
    }

    #[inline(always)]
    pub(super) fn at<const N: usize>(&self, stencil: &Stencil<N>, p: Vec2) -> Vec4 {
        let ((x, fx), (y, fy)) = (cell(p.x, self.columns), cell(p.y, self.rows));
        let low = self.node(stencil, x, y) * (1.0 - fx) + self.node(stencil, x + 1, y) * fx;
        let high = self.node(stencil, x, y + 1) * (1.0 - fx) + self.node(stencil, x + 1, y + 1) * fx;
        low * (1.0 - fy) + high * fy
    }

    #[inline(always)]
    fn node<const N: usize>(&self, stencil: &Stencil<N>, x: usize, y: usize) -> Vec4 {
        let values = &self.values[(y * self.columns + x) * self.tables..][..self.tables];
        stencil.iter().fold(Vec4::ZERO, |sum, &(table, w)| sum + values[table] * w)
    }
}

/// Densities over the unit square, bilinear between nodes, with the integrals that drawing by them needs; what is read
/// together lies together.
#[derive(Debug, Clone)]
pub(super) struct Warp {
    rows: usize,
    columns: usize,
    tables: usize,
    /// `[row][column][table]`: the density, and the integral of the row from its start.
    nodes: Vec<Vec2>,
    /// `[row][table]`: the integral of all rows from the first to this, and that of this row.
    sums: Vec<Vec2>,
}

impl Warp {
    /// Every table is scaled to integral 1; one without any weight becomes uniform.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the table if it has the wrong size or a value that is negative or not finite.
    pub(super) fn new(name: &str, size: [usize; 2], count: usize, values: Vec<f32>) -> Result<Self> {
        let values = Grid::new(name, size, count, values)?.values;
        if let Some(i) = values.iter().position(|v| *v < 0.0) {
            return Err(Error::parameter(name, format!("number {i} is negative, which a density cannot be")));
        }
        Ok(Self::unchecked(size, values))
    }

    /// As [`Warp::new`] of the program's own tables.
    pub(super) fn unchecked([rows, columns]: [usize; 2], mut values: Vec<f32>) -> Self {
        let cells = rows * columns;
        let tables = values.len() / cells;
        let (mut nodes, mut sums) = (vec![Vec2::ZERO; values.len()], vec![Vec2::ZERO; rows * tables]);
        for (t, table) in values.chunks_exact_mut(cells).enumerate() {
            let Integrals { along, marginal, .. } = normalise(table, columns);
            (0..cells).for_each(|i| nodes[i * tables + t] = Vec2::new(table[i], along[i]));
            (0..rows).for_each(|y| sums[y * tables + t] = Vec2::new(marginal[y], along[(y + 1) * columns - 1]));
        }
        Self { rows, columns, tables, nodes, sums }
    }

    pub(super) fn size(&self) -> [usize; 2] {
        [self.rows, self.columns]
    }

    /// Density, and integral of the row `y` up to here.
    #[inline(always)]
    fn node<const N: usize>(&self, stencil: &Stencil<N>, x: usize, y: usize) -> Vec2 {
        let values = &self.nodes[(y * self.columns + x) * self.tables..][..self.tables];
        stencil.iter().fold(Vec2::ZERO, |sum, &(table, w)| sum + values[table] * w)
    }

    /// Integral of all rows up to `y`, and of this row.
    #[inline(always)]
    fn row<const N: usize>(&self, stencil: &Stencil<N>, y: usize) -> Vec2 {
        let values = &self.sums[y * self.tables..][..self.tables];
        stencil.iter().fold(Vec2::ZERO, |sum, &(table, w)| sum + values[table] * w)
    }

    /// [`Warp::node`] at the way `fy` from row `y` to the next.
    #[inline(always)]
    fn between<const N: usize>(&self, stencil: &Stencil<N>, x: usize, (y, fy): (usize, f32)) -> Vec2 {
        (1.0 - fy) * self.node(stencil, x, y) + fy * self.node(stencil, x, y + 1)
    }

    pub(super) fn density<const N: usize>(&self, stencil: &Stencil<N>, p: Vec2) -> f32 {
        let ((x, fx), (y, fy)) = (cell(p.x, self.columns), cell(p.y, self.rows));
        let row = |y| self.node(stencil, x, y).x * (1.0 - fx) + self.node(stencil, x + 1, y).x * fx;
        row(y) * (1.0 - fy) + row(y + 1) * fy
    }

    /// Maps uniform points of the square to points of the density.
    pub(super) fn warp<const N: usize>(&self, stencil: &Stencil<N>, u: Vec2) -> Vec2 {
        let [rows, columns] = self.size();
        let last = columns - 1;
        // Choose the row interval, then the place in it: the marginal density is linear there
        let y = lower(rows, u.y, |y| self.row(stencil, y).x);
        let (a, b) = (self.row(stencil, y), self.row(stencil, y + 1));
        let fy = invert_linear(a.y, b.y, (u.y - a.x) * (rows - 1) as f32);
        // The same along the row between the two
        let mix = |x: usize| self.between(stencil, x, (y, fy));
        let target = u.x * mix(last).y;
        let x = lower(columns, target, |x| mix(x).y);
        let (left, right) = (mix(x), mix(x + 1));
        let fx = invert_linear(left.x, right.x, (target - left.y) * last as f32);
        Vec2::new((x as f32 + fx) / last as f32, (y as f32 + fy) / (rows - 1) as f32)
    }

    /// The inverse of [`Warp::warp`].
    #[inline(always)]
    pub(super) fn invert<const N: usize>(&self, stencil: &Stencil<N>, p: Vec2) -> Vec2 {
        let [rows, columns] = self.size();
        let ((x, fx), (y, fy)) = (cell(p.x, columns), cell(p.y, rows));
        let (a, b) = (self.row(stencil, y), self.row(stencil, y + 1));
        let v = a.x + integral(a.y, b.y, fy) / (rows - 1) as f32;
        let (left, right) = (self.between(stencil, x, (y, fy)), self.between(stencil, x + 1, (y, fy)));
        let whole = (1.0 - fy) * a.y + fy * b.y;
        let u = left.y + integral(left.x, right.x, fx) / (columns - 1) as f32;
        Vec2::new(if whole > 0.0 { u / whole } else { p.x }, v).clamp(Vec2::ZERO, Vec2::ONE)
    }
}

pub(super) struct Integrals {
    along: Vec<f32>,
    marginal: Vec<f32>,
    total: f64,
}

/// Scales a density to the integral 1; one without any weight becomes uniform.
pub(super) fn normalise(table: &mut [f32], columns: usize) -> Integrals {
    let mut integrals = integrate(table, columns);
    if integrals.total > 0.0 {
        let scale = (1.0 / integrals.total) as f32;
        table.iter_mut().chain(&mut integrals.along).chain(&mut integrals.marginal).for_each(|v| *v *= scale);
        return integrals;
    }
    table.fill(1.0);
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
            sum += 0.5 * f64::from(pair[0] + pair[1]) / (columns - 1) as f64;
            along.push(sum as f32);
        }
        total += previous.map_or(0.0, |previous: f64| 0.5 * (previous + sum) / (rows - 1) as f64);
        previous = Some(sum);
        marginal.push(total as f32);
    }
    Integrals { along, marginal, total }
}

/// The last node but one whose ascending value is not above `target`.
fn lower(nodes: usize, target: f32, value: impl Fn(usize) -> f32) -> usize {
    let (mut low, mut high) = (0, nodes - 1);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if value(middle) <= target {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// The integral from 0 to `t` of a density linear from `a` to `b`.
#[inline(always)]
fn integral(a: f32, b: f32, t: f32) -> f32 {
    t * (a + 0.5 * t * (b - a))
}

/// The place t in 0..1 up to which a density linear from `a` to `b` has the integral `target`.
fn invert_linear(a: f32, b: f32, target: f32) -> f32 {
    let root = (a * a + 2.0 * target.max(0.0) * (b - a)).max(0.0).sqrt();
    let t = if a + root > 0.0 { 2.0 * target.max(0.0) / (a + root) } else { 0.0 };
    t.clamp(0.0, 1.0)
}
