//! Resampling of photographs to texels.

use glam::{DVec2, Vec3};

use super::projection::{Homography, Lens};
use crate::picture::cubic;

/// Sample points per pixel of a texel's extent in the photograph.
const POINTS_PER_PIXEL: f64 = 2.0;
/// Maximum number of sample points along a side of a texel.
const MAX_POINTS: usize = 32;

/// A photograph in linear light, row by row from the top; pixel (0, 0) covers 0..1.
pub struct Photograph {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Apparent values.
    pub rgb: Vec<Vec3>,
}

impl Photograph {
    fn at(&self, p: DVec2) -> Vec3 {
        cubic::at(&self.rgb, [self.width, self.height], p)
    }
}

/// Resamples the sample to `columns` x `rows` texels, row 0 at the top, shape (y, x, rgb).
///
/// # Model
/// A texel is the mean of the interpolated photograph over the texel's square in the sample plane, by the midpoint rule
/// with at least two points per pixel of the footprint in each direction. The points are uniform in the plane, so every
/// part counts by its area in the plane, not in the photograph.
pub fn resample(
    photograph: &Photograph,
    homography: &Homography,
    lens: &Lens,
    [columns, rows]: [usize; 2],
) -> Vec<f32> {
    let seen =
        |x: f64, y: f64| lens.distort(homography.apply(DVec2::new(x, y) / DVec2::new(columns as f64, rows as f64)));
    let mut texels = Vec::with_capacity(columns * rows * 3);
    for row in 0..rows {
        for column in 0..columns {
            let (x, y) = (column as f64, row as f64);
            let corner = seen(x, y);
            let count =
                |other: DVec2| ((POINTS_PER_PIXEL * corner.distance(other)).ceil() as usize).clamp(2, MAX_POINTS);
            let (nx, ny) = (count(seen(x + 1.0, y)), count(seen(x, y + 1.0)));
            let mut sum = Vec3::ZERO;
            for j in 0..ny {
                for i in 0..nx {
                    let (s, t) = ((i as f64 + 0.5) / nx as f64, (j as f64 + 0.5) / ny as f64);
                    sum += photograph.at(seen(x + s, y + t));
                }
            }
            texels.extend((sum / (nx * ny) as f32).to_array());
        }
    }
    texels
}
