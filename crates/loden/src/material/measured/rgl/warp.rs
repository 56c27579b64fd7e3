//! Tables over the unit square, and the map that draws points by one.

use glam::Vec2;

use crate::{Error, Result};

/// Four tables and their weights.
pub(super) type Stencil = [(usize, f32); 4];

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

    pub(super) fn at(&self, table: usize, p: Vec2) -> f32 {
        let ((x, fx), (y, fy)) = (cell(p.x, self.columns), cell(p.y, self.rows));
        let i = (table * self.rows + y) * self.columns + x;
        let row = |i: usize| self.values[i] * (1.0 - fx) + self.values[i + 1] * fx;
        row(i) * (1.0 - fy) + row(i + self.columns) * fy
    }
}

/// The interval of `nodes` equally spaced nodes on 0..1 that holds `x`, and the way through it.
fn cell(x: f32, nodes: usize) -> (usize, f32) {
    let x = x.clamp(0.0, 1.0) * (nodes - 1) as f32;
    let cell = (x as usize).min(nodes - 2);
    (cell, x - cell as f32)
}

/// Densities over the unit square, bilinear between nodes, with the integrals that drawing by them needs.
#[derive(Debug, Clone)]
pub(super) struct Warp {
    density: Grid,
    /// Integral of each row from its start to each column, `[table][row][column]`.
    along: Vec<f32>,
    /// Integral of the whole rows from the first to each, `[table][row]`.
    marginal: Vec<f32>,
}

impl Warp {
    /// Every table is scaled to integral 1; one without any weight becomes uniform.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the table if it has the wrong size or a value that is negative or not finite.
    pub(super) fn new(name: &str, size: [usize; 2], count: usize, values: Vec<f32>) -> Result<Self> {
        let density = Grid::new(name, size, count, values)?;
        if let Some(i) = density.values.iter().position(|v| *v < 0.0) {
            return Err(Error::parameter(name, format!("number {i} is negative, which a density cannot be")));
        }
        Ok(Self::unchecked(size, density.values))
    }

    /// As [`Warp::new`] of the program's own tables.
    pub(super) fn unchecked([rows, columns]: [usize; 2], mut values: Vec<f32>) -> Self {
        let mut along = Vec::with_capacity(values.len());
        let mut marginal = Vec::new();
        for table in values.chunks_exact_mut(rows * columns) {
            let mut integrals = normalise(table, columns);
            along.append(&mut integrals.along);
            marginal.append(&mut integrals.marginal);
        }
        Self { density: Grid { rows, columns, values }, along, marginal }
    }

    pub(super) fn size(&self) -> [usize; 2] {
        [self.density.rows, self.density.columns]
    }

    pub(super) fn density(&self, stencil: &Stencil, p: Vec2) -> f32 {
        stencil.iter().filter(|n| n.1 > 0.0).map(|&(table, w)| w * self.density.at(table, p)).sum()
    }

    fn sum(values: &[f32], stencil: &Stencil, size: usize, at: usize) -> f32 {
        stencil.iter().filter(|n| n.1 > 0.0).map(|&(table, w)| w * values[table * size + at]).sum()
    }

    /// The integral of row `y` up to column `x`.
    fn row(&self, stencil: &Stencil, y: usize, x: usize) -> f32 {
        Self::sum(&self.along, stencil, self.density.rows * self.density.columns, y * self.density.columns + x)
    }

    fn node(&self, stencil: &Stencil, y: usize, x: usize) -> f32 {
        Self::sum(&self.density.values, stencil, self.density.rows * self.density.columns, y * self.density.columns + x)
    }

    fn below(&self, stencil: &Stencil, y: usize) -> f32 {
        Self::sum(&self.marginal, stencil, self.density.rows, y)
    }

    /// Maps uniform points of the square to points of the density.
    pub(super) fn warp(&self, stencil: &Stencil, u: Vec2) -> Vec2 {
        let [rows, columns] = self.size();
        let last = columns - 1;
        // Choose the row interval, then the place in it: the marginal density is linear there
        let y = lower(rows, u.y, |y| self.below(stencil, y));
        let (a, b) = (self.row(stencil, y, last), self.row(stencil, y + 1, last));
        let fy = invert_linear(a, b, (u.y - self.below(stencil, y)) * (rows - 1) as f32);
        // The same along the row between the two
        let mix = |x: usize| (1.0 - fy) * self.row(stencil, y, x) + fy * self.row(stencil, y + 1, x);
        let target = u.x * mix(last);
        let x = lower(columns, target, mix);
        let node = |x: usize| (1.0 - fy) * self.node(stencil, y, x) + fy * self.node(stencil, y + 1, x);
        let fx = invert_linear(node(x), node(x + 1), (target - mix(x)) * last as f32);
        Vec2::new((x as f32 + fx) / last as f32, (y as f32 + fy) / (rows - 1) as f32)
    }

    /// The inverse of [`Warp::warp`].
    pub(super) fn invert(&self, stencil: &Stencil, p: Vec2) -> Vec2 {
        let [rows, columns] = self.size();
        let last = columns - 1;
        let ((x, fx), (y, fy)) = (cell(p.x, columns), cell(p.y, rows));
        let linear = |a: f32, b: f32, t: f32| t * (a + 0.5 * t * (b - a));
        let (a, b) = (self.row(stencil, y, last), self.row(stencil, y + 1, last));
        let v = self.below(stencil, y) + linear(a, b, fy) / (rows - 1) as f32;
        let node = |x: usize| (1.0 - fy) * self.node(stencil, y, x) + fy * self.node(stencil, y + 1, x);
        let part = (1.0 - fy) * self.row(stencil, y, x) + fy * self.row(stencil, y + 1, x);
        let whole = (1.0 - fy) * a + fy * b;
        let u = part + linear(node(x), node(x + 1), fx) / last as f32;
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

/// The place t in 0..1 up to which a density linear from `a` to `b` has the integral `target`.
fn invert_linear(a: f32, b: f32, target: f32) -> f32 {
    let root = (a * a + 2.0 * target.max(0.0) * (b - a)).max(0.0).sqrt();
    let t = if a + root > 0.0 { 2.0 * target.max(0.0) / (a + root) } else { 0.0 };
    t.clamp(0.0, 1.0)
}
