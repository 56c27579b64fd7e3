//! What a compression cost: errors over all texels, channels and pairs.

mod ssim;

use std::borrow::Cow;
use std::collections::HashSet;

use rayon::prelude::*;
use serde::Serialize;

pub use ssim::ssim;

use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::color::Encoding;
use crate::factor::simd::wide;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// Differences of two BTFs in display-encoded values of 0..1, so 0.01 is 2.55 grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Report {
    /// Mean of the absolute differences over all texels, channels and measured pairs.
    pub mean_abs_error: f64,
    /// The largest absolute difference.
    pub max_abs_error: f64,
    /// Root of the mean squared difference.
    pub rmse: f64,
    /// Peak signal-to-noise ratio for peak 1, dB; infinite (null in JSON) for equal images.
    pub psnr_db: f64,
    /// Mean over images of the structural similarity of their luma, see [`ssim()`].
    pub ssim: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    absolute: f64,
    squared: f64,
    largest: f32,
    ssim: f64,
}

/// Compares `test` with `reference`, image by image, in the display encoding of the reference.
///
/// Both are clamped to 0..1 and not rounded. Pairs that the reference misses are left out. Results do not depend on
/// the number of threads.
///
/// # Errors
/// [`Error::Parameter`] if sizes, directions or cosine conventions differ, or no pair was measured; what the sources
/// return; [`Error::Cancelled`].
pub fn compare(reference: &dyn BtfSource, test: &dyn BtfSource, progress: &dyn Progress) -> Result<Report> {
    let (meta, other) = (reference.meta(), test.meta());
    check(meta, other)?;
    let display = meta.encoding.display();
    let task = Task::new(progress, "compare", meta.pairs() as u64);
    let mut total = Sums::default();
    let mut images = 0u64;
    for view in 0..meta.views.len() {
        let missing: HashSet<usize> = reference.missing().iter().filter(|p| p.0 == view).map(|p| p.1).collect();
        let lights: Vec<usize> = (0..meta.lights.len()).filter(|l| !missing.contains(l)).collect();
        let sums: Result<Vec<Sums>> = lights
            .par_iter()
            .map_init(Buffers::default, |buffers, &light| {
                task.advance(1)?;
                let images = [(reference, &mut buffers.reference), (test, &mut buffers.test)];
                for (source, out) in images {
                    let meta = source.meta();
                    displayed(&source.image(view, light)?, meta, display, out)?;
                }
                let mut sums = differences(&buffers.reference, &buffers.test);
                sums.ssim =
                    ssim::of_images(&buffers.reference, &buffers.test, meta.width, meta.height, &mut buffers.ssim);
                Ok(sums)
            })
            .collect();
        for sums in sums? {
            total.absolute += sums.absolute;
            total.squared += sums.squared;
            total.largest = total.largest.max(sums.largest);
            total.ssim += sums.ssim;
            images += 1;
        }
        task.advance((meta.lights.len() - lights.len()) as u64)?;
        reference.release(view);
        test.release(view);
    }
    if images == 0 {
        return Err(Error::parameter("reference", "no pair of view and light was measured"));
    }
    let numbers = images as f64 * meta.image_len() as f64;
    let mse = total.squared / numbers;
    Ok(Report {
        mean_abs_error: total.absolute / numbers,
        max_abs_error: f64::from(total.largest),
        rmse: mse.sqrt(),
        psnr_db: -10.0 * mse.log10(),
        ssim: total.ssim / images as f64,
    })
}

#[derive(Debug, Default)]
struct Buffers {
    reference: Vec<f32>,
    test: Vec<f32>,
    ssim: ssim::Buffers,
}

fn check(a: &BtfMeta, b: &BtfMeta) -> Result<()> {
    let differ = |what: &str, a: String, b: String| {
        Err(Error::parameter("compare", format!("{what} differ: {a} in the reference, {b} in the other")))
    };
    if (a.width, a.height) != (b.width, b.height) {
        let size = |m: &BtfMeta| format!("{} x {}", m.width, m.height);
        return differ("image sizes", size(a), size(b));
    }
    if a.cosine != b.cosine {
        return differ("cosine conventions", format!("{:?}", a.cosine), format!("{:?}", b.cosine));
    }
    for (what, a, b) in [("views", &a.views, &b.views), ("lights", &a.lights, &b.lights)] {
        if a.len() != b.len() {
            return differ(what, format!("{} directions", a.len()), format!("{} directions", b.len()));
        }
        if let Some(i) = (0..a.len()).find(|&i| a.directions()[i].distance(b.directions()[i]) > 1e-3) {
            return differ(what, format!("direction {i} is {:?}", a.degrees()[i]), format!("{:?}", b.degrees()[i]));
        }
    }
    Ok(())
}

/// Display-encoded values of 0..1.
fn displayed(texels: &Texels, meta: &BtfMeta, display: Encoding, out: &mut Vec<f32>) -> Result<()> {
    if texels.len() != meta.image_len() {
        let problem = format!("an image has {} numbers, expected {}", texels.len(), meta.image_len());
        return Err(Error::parameter("compare", problem));
    }
    out.resize(texels.len(), 0.0);
    let curve = |value: f32| display.encode(meta.encoding.decode(value)).clamp(0.0, 1.0);
    let same = meta.encoding == display;
    match texels {
        Texels::U8(values) => {
            let of_byte: [f32; 256] = std::array::from_fn(|i| {
                let value = i as f32 / 255.0;
                if same { value } else { curve(value) }
            });
            out.iter_mut().zip(values.iter()).for_each(|(o, &v)| *o = of_byte[usize::from(v)]);
        }
        _ => {
            let values: Cow<[f32]> = texels.to_f32();
            let convert = |v: f32| if same { v.clamp(0.0, 1.0) } else { curve(v) };
            out.iter_mut().zip(values.iter()).for_each(|(o, &v)| *o = convert(v));
        }
    }
    // NaN survives a clamp: it counts as black, which is a large error and not a silent one
    out.iter_mut().for_each(|v| *v = if v.is_nan() { 0.0 } else { *v });
    Ok(())
}

/// Numbers summed in single precision before double precision takes over.
const RUN: usize = 512;
const LANES: usize = 16;

wide! {
    /// Sums of absolute and squared differences, and the largest.
    fn differences(a: &[f32], b: &[f32]) -> Sums {
        let mut sums = Sums::default();
        for (a, b) in a.chunks(RUN).zip(b.chunks(RUN)) {
            let (mut absolute, mut squared, mut largest) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
            let (a_lanes, a_rest) = a.as_chunks::<LANES>();
            let (b_lanes, b_rest) = b.as_chunks::<LANES>();
            for (a, b) in a_lanes.iter().zip(b_lanes) {
                for i in 0..LANES {
                    let d = (a[i] - b[i]).abs();
                    absolute[i] += d;
                    squared[i] += d * d;
                    largest[i] = if d > largest[i] { d } else { largest[i] };
                }
            }
            for (i, (a, b)) in a_rest.iter().zip(b_rest).enumerate() {
                let d = (a - b).abs();
                absolute[i] += d;
                squared[i] += d * d;
                largest[i] = largest[i].max(d);
            }
            sums.absolute += absolute.iter().map(|&v| f64::from(v)).sum::<f64>();
            sums.squared += squared.iter().map(|&v| f64::from(v)).sum::<f64>();
            sums.largest = largest.iter().fold(sums.largest, |m, &v| m.max(v));
        }
        sums
    }
}
