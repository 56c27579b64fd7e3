//! Interpolation between the pixels of a picture.

use glam::{DVec2, Vec3};

/// The colour at a place in pixels, of pixels row by row from the top, where pixel (0, 0) covers 0..1: Catmull-Rom
/// interpolation; the edge is repeated. It can be negative beside a bright edge.
///
/// # References
/// keys1981 (a = -1/2)
pub(crate) fn at(pixels: &[Vec3], [width, height]: [usize; 2], place: DVec2) -> Vec3 {
    let (x, y) = (place.x - 0.5, place.y - 0.5);
    let (i, j) = (x.floor(), y.floor());
    let (wx, wy) = (weights((x - i) as f32), weights((y - j) as f32));
    let clamp = |v: f64, k: usize, n: usize| (v as isize + k as isize - 1).clamp(0, n as isize - 1) as usize;
    let columns = [0, 1, 2, 3].map(|k| clamp(i, k, width));
    let mut sum = Vec3::ZERO;
    for (k, wy) in wy.into_iter().enumerate() {
        let row = &pixels[clamp(j, k, height) * width..][..width];
        let across =
            wx[0] * row[columns[0]] + wx[1] * row[columns[1]] + wx[2] * row[columns[2]] + wx[3] * row[columns[3]];
        sum += wy * across;
    }
    sum
}

fn weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}
