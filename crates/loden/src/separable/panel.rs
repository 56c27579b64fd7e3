//! The overview picture of a factorisation: original, factors, reconstruction, difference.

use glam::{Vec2, Vec3};

use super::tables::{Factored, Grid};
use crate::direction::from_angles;
use crate::material::Material;
use crate::picture::{CELL, Picture};

/// Gap between the four parts, in pixels.
const GAP: usize = 8;

/// Height of the names above the parts, in pixels.
const HEAD: usize = 2 * CELL[1] + 4;

/// Amplification of the difference.
const GAIN: f32 = 4.0;

/// Four squares of `size` pixels side by side under their names: original, factors, reconstruction, and four times the difference. All
/// but the factors are matrices: the polar angle of the light runs down from 0 to 85 degrees in each of four azimuths,
/// that of the view across. They show the square root of the BRDF relative to its largest value; each factor is shown
/// relative to its own largest value.
pub fn panel(original: &dyn Material, factored: &Factored, size: usize) -> Picture {
    let (a, b) = (matrix(original, size), matrix(factored, size));
    let most = a.iter().map(|v| v.max_element()).fold(1e-9, f32::max);
    let tone = |v: Vec3| (v.abs() / most).powf(0.5);
    let difference = a.iter().zip(&b).map(|(a, b)| tone(GAIN * (*a - *b))).collect::<Vec<_>>();
    let parts = [
        a.iter().map(|v| tone(*v)).collect(),
        factors(factored, size),
        b.iter().map(|v| tone(*v)).collect::<Vec<_>>(),
        difference,
    ];
    let names = ["original", "factors", "reconstruction", &format!("difference x {GAIN}")];
    let mut picture = Picture::filled(4 * size + 3 * GAP, HEAD + size, Vec3::ONE);
    for (k, (part, name)) in parts.iter().zip(names).enumerate() {
        let left = k * (size + GAP);
        let scale = if size < 200 { 1 } else { 2 };
        picture.write_centred([left, 0], size, name, Vec3::ZERO, scale);
        for (y, row) in part.chunks_exact(size).enumerate() {
            let start = (HEAD + y) * picture.width + left;
            picture.rgb[start..start + size].copy_from_slice(row);
        }
    }
    picture
}

fn matrix(brdf: &dyn Material, size: usize) -> Vec<Vec3> {
    let direction = |i: usize| {
        let at = i as f32 * 4.0 / size as f32;
        let theta = 85f32.to_radians() * at.fract();
        from_angles(theta, at.floor() * std::f32::consts::FRAC_PI_2)
    };
    (0..size * size).map(|i| brdf.eval(Vec2::ZERO, direction(i / size), direction(i % size))).collect()
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
    use crate::separable::{ProductSum, Projection};

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
}
