//! Resampling of photographs to texels.

use glam::{DVec2, Vec3};

use super::projection::{Homography, Lens};

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
    /// Catmull-Rom interpolation.
    ///
    /// # References
    /// keys1981 (a = -1/2)
    fn at(&self, p: DVec2) -> Vec3 {
        let (x, y) = (p.x - 0.5, p.y - 0.5);
        let (i, j) = (x.floor(), y.floor());
        let (wx, wy) = (weights((x - i) as f32), weights((y - j) as f32));
        let clamp = |v: f64, k: usize, n: usize| (v as isize + k as isize - 1).clamp(0, n as isize - 1) as usize;
        let columns = [0, 1, 2, 3].map(|k| clamp(i, k, self.width));
        let mut sum = Vec3::ZERO;
        for (k, wy) in wy.into_iter().enumerate() {
            let row = &self.rgb[clamp(j, k, self.height) * self.width..][..self.width];
            let across =
                wx[0] * row[columns[0]] + wx[1] * row[columns[1]] + wx[2] * row[columns[2]] + wx[3] * row[columns[3]];
            sum += wy * across;
        }
        sum
    }
}

fn weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}

/// Resamples the sample to `size` x `size` texels, row 0 at the top, shape (y, x, rgb).
///
/// # Model
/// A texel is the mean of the interpolated photograph over the texel's square in the sample plane, by the midpoint rule
/// with at least two points per pixel of the footprint in each direction. The points are uniform in the plane, so every
/// part counts by its area in the plane, not in the photograph.
pub fn resample(photograph: &Photograph, homography: &Homography, lens: &Lens, size: usize) -> Vec<f32> {
    let seen = |x: f64, y: f64| lens.distort(homography.apply(DVec2::new(x, y) / size as f64));
    let mut texels = Vec::with_capacity(size * size * 3);
    for row in 0..size {
        for column in 0..size {
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
