//! The overview picture of a factorisation: original, factors, reconstruction, difference, and the steps of a chain.

use glam::{Vec2, Vec3};

use super::tables::{Factored, Grid, ProductSum, from_half_difference, raised};
use crate::direction::from_angles;
use crate::material::Material;
use crate::picture::{CELL, Picture};

/// Gap between the parts, in pixels.
const GAP: usize = 8;

/// Height of the names above the parts, in pixels.
const HEAD: usize = 2 * CELL[1] + 4;

/// Parts in a row.
const COLUMNS: usize = 4;

/// Amplification of the difference.
const GAIN: f32 = 4.0;

/// Quotient that is shown as white.
const WHITE_QUOTIENT: f32 = 4.0;

/// A named square of pixels.
type Part = (String, Vec<Vec3>);

/// Squares of `size` pixels under their names: original, factors, reconstruction, and four times the difference. All but
/// the factors are matrices: the polar angle of the light runs down from 0 to 85 degrees in each of four azimuths, that
/// of the view across. They show the square root of the BRDF relative to its largest value; each factor is shown
/// relative to its own largest value.
///
/// Of a chain of several steps a second row comes before the reconstruction: the original over half and difference
/// vectors, which take the place of light and view, the first step over these, the first step over light and view, and what
/// is left for the steps after it, the original divided by the first step (grey where that is 1).
///
/// # References
/// suykens2003 (the steps)
pub fn panel(original: &dyn Material, factored: &Factored, size: usize) -> Picture {
    let of = |brdf: &dyn Material, pair: fn(Vec3, Vec3) -> (Vec3, Vec3)| {
        matrix(size, pair, |wi, wo| brdf.eval(Vec2::ZERO, wi, wo))
    };
    let (a, b) = (of(original, in_out), of(factored, in_out));
    let most = largest(&a);
    let tone = |v: Vec3| (v.abs() / most).powf(0.5);
    let toned = |matrix: &[Vec3]| matrix.iter().map(|v| tone(*v)).collect::<Vec<_>>();
    let difference: Vec<Vec3> = a.iter().zip(&b).map(|(a, b)| tone(GAIN * (*a - *b))).collect();
    let mut parts: Vec<Part> = vec![("original".into(), toned(&a)), ("factors".into(), factors(factored, size))];
    if let Factored::Product(steps) = factored
        && let [first, _, ..] = &steps[..]
    {
        parts.extend(chain(first, &a, &of(original, from_half_difference), size));
    }
    parts.push(("reconstruction".into(), toned(&b)));
    parts.push((format!("difference x {GAIN}"), difference));
    arranged(&parts, size)
}

/// The steps of a chain, given the original over light and view and over half and difference vectors.
fn chain(first: &ProductSum, in_out_matrix: &[Vec3], half_difference: &[Vec3], size: usize) -> [Part; 4] {
    let value = |wi: Vec3, wo: Vec3| first.value(raised(wi), raised(wo));
    let (over_half, over_light) = (matrix(size, from_half_difference, value), matrix(size, in_out, value));
    // the first step knows nothing of the scale: each matrix is relative to its own largest value
    let own = |matrix: &[Vec3]| {
        let most = largest(matrix);
        matrix.iter().map(|v| (v.abs() / most).powf(0.5)).collect::<Vec<_>>()
    };
    let quotient = |(a, b): (&Vec3, &Vec3)| {
        let ratio = |c: usize| if b[c].abs() > 0.0 { a[c] / b[c] / WHITE_QUOTIENT } else { 0.0 };
        Vec3::new(ratio(0), ratio(1), ratio(2)).clamp(Vec3::ZERO, Vec3::ONE).powf(0.5)
    };
    [
        ("original, half x diff.".into(), own(half_difference)),
        ("step 1, half x diff.".into(), own(&over_half)),
        ("step 1, light x view".into(), own(&over_light)),
        ("original / step 1".into(), in_out_matrix.iter().zip(&over_light).map(quotient).collect()),
    ]
}

/// The parts side by side, [`COLUMNS`] in a row.
fn arranged(parts: &[Part], size: usize) -> Picture {
    let (columns, rows) = (COLUMNS.min(parts.len()), parts.len().div_ceil(COLUMNS));
    let mut picture =
        Picture::filled(columns * size + (columns - 1) * GAP, rows * (HEAD + size) + (rows - 1) * GAP, Vec3::ONE);
    for (k, (name, part)) in parts.iter().enumerate() {
        let (left, top) = (k % COLUMNS * (size + GAP), k / COLUMNS * (HEAD + size + GAP));
        let scale = if size < 200 { 1 } else { 2 };
        picture.write_centred([left, top], size, name, Vec3::ZERO, scale);
        for (y, row) in part.chunks_exact(size).enumerate() {
            let start = (top + HEAD + y) * picture.width + left;
            picture.rgb[start..start + size].copy_from_slice(row);
        }
    }
    picture
}

fn largest(matrix: &[Vec3]) -> f32 {
    matrix.iter().map(|v| v.max_element()).fold(1e-9, f32::max)
}

fn in_out(x: Vec3, y: Vec3) -> (Vec3, Vec3) {
    (x, y)
}

/// A function of light and view at all pairs that `pair` makes of two directions, one down, one across.
fn matrix(size: usize, pair: fn(Vec3, Vec3) -> (Vec3, Vec3), value: impl Fn(Vec3, Vec3) -> Vec3) -> Vec<Vec3> {
    let direction = |i: usize| {
        let at = i as f32 * 4.0 / size as f32;
        let theta = 85f32.to_radians() * at.fract();
        from_angles(theta, at.floor() * std::f32::consts::FRAC_PI_2)
    };
    let at = |i: usize| {
        let (wi, wo) = pair(direction(i / size), direction(i % size));
        value(wi, wo)
    };
    (0..size * size).map(at).collect()
}

fn factors(factored: &Factored, size: usize) -> Vec<Vec3> {
    let tables = factored.tables();
    let side = (1..).find(|s| s * s >= tables.len()).unwrap_or(1);
    let cell = (size / side).max(1);
    let shown = |grid: &Grid, x: usize, y: usize| {
        let most = grid.texels.iter().map(|v| v.abs().max_element()).fold(1e-9, f32::max);
        let texel = (y * grid.size / cell).min(grid.size - 1) * grid.size + (x * grid.size / cell).min(grid.size - 1);
        (grid.texels[texel].abs() / most).powf(0.5)
    };
    let mut part = vec![Vec3::splat(0.2); size * size];
    for (i, pixel) in part.iter_mut().enumerate() {
        let (x, y) = (i % size, i / size);
        let (column, row) = (x / cell, y / cell);
        // leave a line of background between tables
        if column < side
            && x % cell != 0
            && y % cell != 0
            && let Some(grid) = tables.get(row * side + column)
        {
            *pixel = shown(grid, x % cell, y % cell);
        }
    }
    part
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Lambert;
    use crate::separable::Projection;

    #[test]
    fn an_exact_factorisation_has_a_black_difference() {
        let grey = Lambert { albedo: Vec3::splat(0.5) };
        let constant = [Grid::filled(4, Vec3::splat(0.5 / std::f32::consts::PI)), Grid::filled(4, Vec3::ONE)];
        let step = ProductSum { projections: [Projection::Light, Projection::View], terms: vec![constant] };
        let picture = panel(&grey, &Factored::Product(vec![step]), 64);
        assert_eq!((picture.width, picture.height), (4 * 64 + 24, HEAD + 64));
        assert!((picture.at(10, HEAD + 10) - Vec3::ONE).abs().max_element() < 1e-3);
        assert!(picture.at(4 * 64 + 10, HEAD + 30).max_element() < 1e-2);
    }

    #[test]
    fn a_chain_shows_what_each_step_leaves() {
        let grey = Lambert { albedo: Vec3::splat(0.5) };
        // the first step is half of the original
        let step = |projections, value: f32| ProductSum {
            projections,
            terms: vec![[Grid::filled(4, Vec3::splat(value)), Grid::filled(4, Vec3::ONE)]],
        };
        let first = step([Projection::Half, Projection::Difference], 0.25 / std::f32::consts::PI);
        let second = step([Projection::Light, Projection::View], 2.0);
        let picture = panel(&grey, &Factored::Product(vec![first, second]), 64);
        assert_eq!((picture.width, picture.height), (4 * 64 + 24, 2 * (HEAD + 64) + GAP));
        let at =
            |column: usize, row: usize| picture.at(column * (64 + GAP) + 10, row * (HEAD + 64 + GAP) + HEAD + 30).x;
        // original over half and difference vectors; the quotient of 2; reconstruction; difference
        let found = [at(2, 0), at(1, 1), at(2, 1), at(3, 1)];
        let expected = [1.0, 0.5f32.sqrt(), 1.0, 0.0];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-2), "{found:?}");
    }
}
