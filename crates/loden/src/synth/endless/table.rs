//! What coefficients stand for at every pair of directions.

use rayon::prelude::*;

use super::{CHANNELS, Coefficients};
use crate::Result;
use crate::btf::BtfSource;
use crate::color::domain::Domain;
use crate::material::angles::AngularStencil;
use crate::progress::{Progress, Task};

/// Numbers of a channel of a colour: its mean, and a factor for each coefficient.
const NUMBERS: usize = CHANNELS + 1;

/// Root mean square of a coefficient, as a display value, below which it is left out.
const LEAST: f64 = 1e-4;

/// Means and factors of display values, shape (view, light, rgb, number).
pub(super) struct Table {
    lights: usize,
    numbers: Vec<[[f32; NUMBERS]; 3]>,
}

impl Table {
    /// Fits all images by least squares. Coefficients have mean zero and are not correlated.
    ///
    /// # Errors
    /// Errors of reading the images; [`crate::Error::Cancelled`].
    pub(super) fn new(source: &dyn BtfSource, coefficients: &[Coefficients], progress: &dyn Progress) -> Result<Self> {
        let meta = source.meta();
        let lights = meta.lights.len();
        let task = Task::new(progress, "read the sample", meta.views.len() as u64);
        let mut squares = [0.0f64; CHANNELS];
        for texel in coefficients {
            squares.iter_mut().zip(texel).for_each(|(sum, c)| *sum += f64::from(c * c));
        }
        // what varies less than rounding stands for nothing
        let least = LEAST * LEAST * coefficients.len() as f64;
        let inverse = squares.map(|sum| if sum > least { 1.0 / sum } else { 0.0 });
        let view = |view: usize| {
            let images = source.view(view)?;
            let stored = images.to_f32();
            let of = |image: &[f32]| {
                fitted(image, coefficients, &inverse, |v| Domain::Display.from_stored(meta.encoding, v))
            };
            let rows: Vec<_> = stored.chunks_exact(meta.image_len()).map(of).collect();
            source.release(view);
            task.advance(1)?;
            Ok(rows)
        };
        let views = (0..meta.views.len()).into_par_iter().map(view).collect::<Result<Vec<_>>>()?;
        Ok(Self { lights, numbers: views.concat() })
    }

    /// The display value of coefficients.
    #[inline(always)]
    pub(super) fn display(&self, stencil: &AngularStencil, coefficients: &Coefficients) -> [f32; 3] {
        let mut sums = [[0.0f32; NUMBERS]; 3];
        for (view, of_view) in stencil.view.iter() {
            for (light, of_light) in stencil.light.iter() {
                let weight = of_view * of_light;
                let row = &self.numbers[view * self.lights + light];
                for (sums, row) in sums.iter_mut().zip(row) {
                    sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += weight * v);
                }
            }
        }
        sums.map(|[mean, factors @ ..]| mean + factors.iter().zip(coefficients).map(|(a, b)| a * b).sum::<f32>())
    }
}

/// Means and factors of an image.
fn fitted(
    image: &[f32],
    coefficients: &[Coefficients],
    inverse: &[f64; CHANNELS],
    display: impl Fn(f32) -> f32,
) -> [[f32; NUMBERS]; 3] {
    let (mut means, mut products) = ([0.0f64; 3], [[0.0f64; CHANNELS]; 3]);
    // Short sums in single precision
    for (texels, coefficients) in image.chunks(3 * 256).zip(coefficients.chunks(256)) {
        let (mut mean, mut product) = ([0.0f32; 3], [[0.0f32; CHANNELS]; 3]);
        for (rgb, c) in texels.as_chunks::<3>().0.iter().zip(coefficients) {
            for k in 0..3 {
                let value = display(rgb[k]);
                mean[k] += value;
                product[k].iter_mut().zip(c).for_each(|(sum, c)| *sum += value * c);
            }
        }
        means.iter_mut().zip(mean).for_each(|(sum, v)| *sum += f64::from(v));
        for (sums, product) in products.iter_mut().zip(product) {
            sums.iter_mut().zip(product).for_each(|(sum, v)| *sum += f64::from(v));
        }
    }
    std::array::from_fn(|k| {
        std::array::from_fn(|n| match n {
            0 => (means[k] / coefficients.len() as f64) as f32,
            n => (products[k][n - 1] * inverse[n - 1]) as f32,
        })
    })
}
