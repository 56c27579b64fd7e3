//! Places between texels, shifted by a height along the view direction.

use glam::{Vec2, Vec3};

/// The four texels around a place and their bilinear weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corners {
    /// Texel numbers: left and right of the upper row, left and right of the lower.
    pub texel: [usize; 4],
    /// The place as fractions of the way to the right and down.
    pub fraction: [f32; 2],
}

impl Corners {
    /// Around a place in texels, whose centres are whole numbers; x to the right and y down, periodic.
    #[inline(always)]
    pub fn new(place: Vec2, [width, height]: [usize; 2]) -> Self {
        let cell = place.floor();
        let ([x, x1], [y, y1]) = (pair(cell.x, width), pair(cell.y, height));
        let texel = [y * width + x, y * width + x1, y1 * width + x, y1 * width + x1];
        Self { texel, fraction: [finite(place.x - cell.x), finite(place.y - cell.y)] }
    }

    /// Weights of sum 1.
    #[inline(always)]
    pub fn weights(&self) -> [f32; 4] {
        let [x, y] = self.fraction;
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }
}

/// A fraction, or 0 for a place that is no number or infinite.
#[inline(always)]
fn finite(fraction: f32) -> f32 {
    if fraction.is_nan() { 0.0 } else { fraction }
}

/// A whole number and the next, within a period.
#[inline(always)]
fn pair(cell: f32, size: usize) -> [usize; 2] {
    let (first, size) = (cell as i32, size as i32);
    let first = if (0..size).contains(&first) { first } else { first.rem_euclid(size) };
    [first as usize, if first + 1 == size { 0 } else { first as usize + 1 }]
}

/// The place of a texture coordinate.
#[inline(always)]
pub fn texel_place(uv: Vec2, [width, height]: [usize; 2]) -> Vec2 {
    // v grows upwards
    let at = Vec2::new(uv.x, 1.0 - uv.y);
    (at - at.floor()) * Vec2::new(width as f32, height as f32) - 0.5
}

/// The lowest view whose parallax is followed: the slope ends here.
const LOWEST: f32 = 0.1;

/// How far a place moves per unit of height, in texels to the right and down, seen from `wo`. `mirror` reverses the
/// vertical part.
#[inline(always)]
pub fn slope(wo: Vec3, mirror: bool) -> Vec2 {
    let slope = Vec2::new(wo.x, if mirror { wo.y } else { -wo.y });
    slope / wo.z.max(LOWEST)
}

/// Where the ray of a viewer through `place` meets a surface of this height, and the step before: two steps of a fixed-point
/// iteration from the height at the place itself.
#[inline(always)]
pub fn shifted(place: Vec2, slope: Vec2, surface: &impl Surface) -> [Vec2; 2] {
    let first = place + slope * surface.height(place);
    [first, place + slope * surface.height(first)]
}

/// Heights between texels.
pub trait Surface {
    /// The height at a place, in texels; must be inlined.
    fn height(&self, place: Vec2) -> f32;
}
