//! Error metrics: differences of BTFs, BRDFs and images.
//!
//! # Choosing a metric
//! [`compare`] gives the error of a compressed BTF over all of its values: mean, maximum, PSNR and SSIM. [`detail()`]
//! shows in which views, lights and texels the error is, and how visible it is. [`round_trip()`] gives the error of a
//! BRDF at its measured samples. Use `pictures` for rendered images. PSNR suits comparisons with the literature; SSIM
//! and [`flip()`] are closer to what people see, and [`ciede2000()`] measures colour alone.

mod ciede2000;
mod detail;
mod flip;
#[cfg(feature = "picture")]
mod picture;
mod round_trip;
mod ssim;

use std::borrow::Cow;
use std::collections::HashSet;

use rayon::prelude::*;
use serde::{Deserialize, Deserializer, Serialize};

pub use ciede2000::{ciede2000, lab};
pub use detail::{Detail, detail};
pub use flip::flip;
#[cfg(feature = "picture")]
pub use picture::{PictureReport, difference, pictures};
pub use ssim::ssim;

pub use round_trip::{RoundTrip, round_trip};

use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::color::Encoding;
use crate::progress::{Progress, Task};
use crate::simd::wide;
use crate::{Error, Result};

/// Differences of two BTFs in display-encoded values of 0..1; 0.01 is 2.55 grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Mean absolute difference over all texels, channels and measured pairs.
    pub mean_abs_error: f64,
    /// Largest absolute difference.
    pub max_abs_error: f64,
    /// Root mean squared difference.
    pub rmse: f64,
    /// Peak signal-to-noise ratio for peak 1, dB; infinite (null in JSON) for identical images.
    #[serde(deserialize_with = "or_infinite")]
    pub psnr_db: f64,
    /// Structural similarity of the luma, mean over images; see [`ssim()`].
    pub ssim: f64,
}

/// Reads null as infinity, which JSON cannot represent.
fn or_infinite<'a, D: Deserializer<'a>>(deserializer: D) -> std::result::Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    absolute: f64,
    squared: f64,
    largest: f32,
}

/// Compares `test` with `reference`, image by image, in the display encoding of the reference.
///
/// Values are clamped to 0..1 but not rounded. Pairs that are missing in the reference are skipped. Results do not
/// depend on the number of threads.
///
/// # Errors
/// [`Error::Parameter`] if sizes, directions or cosine conventions differ, or no pair was measured; errors of the
/// sources; [`Error::Cancelled`].
pub fn compare(reference: &dyn BtfSource, test: &dyn BtfSource, progress: &dyn Progress) -> Result<Report> {
    compare_views(reference, test, 1, progress)
}

/// As [`compare`], of the first view and every view `step` after it.
///
/// # Errors
/// As [`compare`].
pub fn compare_views(
    reference: &dyn BtfSource,
    test: &dyn BtfSource,
    step: usize,
    progress: &dyn Progress,
) -> Result<Report> {
    let meta = reference.meta();
    let views = (0..meta.views.len()).step_by(step);
    let task = Task::new(progress, "compare", (views.len() * meta.lights.len()) as u64);
    let mut total = Total::default();
    for view in views {
        total.add(&view_sums(reference, test, view, &task)?);
    }
    total.report(meta)
}

/// Sums of the differences of each measured pair of a view, in the order of lights: absolute, squared, largest, SSIM.
/// Advances `task` by the number of lights.
///
/// # Errors
/// As [`compare`].
pub fn view_sums(reference: &dyn BtfSource, test: &dyn BtfSource, view: usize, task: &Task) -> Result<Vec<[f64; 4]>> {
    let (meta, other) = (reference.meta(), test.meta());
    check(meta, other)?;
    let display = meta.encoding.display();
    let missing: HashSet<usize> = reference.missing().iter().filter(|p| p.0 == view).map(|p| p.1).collect();
    let lights: Vec<usize> = (0..meta.lights.len()).filter(|l| !missing.contains(l)).collect();
    let sums: Result<Vec<[f64; 4]>> = lights
        .par_iter()
        .map_init(Buffers::default, |buffers, &light| {
            task.advance(1)?;
            let images = [(reference, &mut buffers.reference), (test, &mut buffers.test)];
            for (source, out) in images {
                let meta = source.meta();
                displayed(&source.image(view, light)?, meta, display, out)?;
            }
            let sums = differences(&buffers.reference, &buffers.test);
            let ssim = ssim::luma_ssim(&buffers.reference, &buffers.test, meta.width, meta.height, &mut buffers.ssim);
            Ok([sums.absolute, sums.squared, f64::from(sums.largest), ssim])
        })
        .collect();
    task.advance((meta.lights.len() - lights.len()) as u64)?;
    reference.release(view);
    test.release(view);
    sums
}

/// Sums over images, added in the order of views and lights.
#[derive(Debug, Clone, Copy, Default)]
pub struct Total {
    sums: [f64; 4],
    images: u64,
}

impl Total {
    /// Adds the images of a view: [`view_sums`].
    pub fn add(&mut self, images: &[[f64; 4]]) {
        for [absolute, squared, largest, ssim] in images {
            self.sums[0] += absolute;
            self.sums[1] += squared;
            self.sums[2] = self.sums[2].max(*largest);
            self.sums[3] += ssim;
            self.images += 1;
        }
    }

    /// The report for images of a BTF with the description `meta`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if no pair was measured.
    pub fn report(&self, meta: &BtfMeta) -> Result<Report> {
        if self.images == 0 {
            return Err(Error::parameter("reference", "no pair of view and light was measured"));
        }
        let [absolute, squared, largest, ssim] = self.sums;
        let numbers = self.images as f64 * meta.image_len() as f64;
        let mse = squared / numbers;
        Ok(Report {
            mean_abs_error: absolute / numbers,
            max_abs_error: largest,
            rmse: mse.sqrt(),
            psnr_db: -10.0 * mse.log10(),
            ssim: ssim / self.images as f64,
        })
    }
}

#[derive(Debug, Default)]
struct Buffers {
    reference: Vec<f32>,
    test: Vec<f32>,
    ssim: ssim::Buffers,
}

fn check(a: &BtfMeta, b: &BtfMeta) -> Result<()> {
    let differ = |what: &str, a: String, b: String| {
        Err(Error::parameter("compare", format!("{what} differ: {a} in the reference, {b} in the other BTF")))
    };
    if (a.width, a.height) != (b.width, b.height) {
        let size = |m: &BtfMeta| format!("{} x {}", m.width, m.height);
        return differ("image sizes", size(a), size(b));
    }
    if a.cosine != b.cosine {
        return differ("cosine conventions", format!("{:?}", a.cosine), format!("{:?}", b.cosine));
    }
    let listed = [a, b].map(|meta| meta.lights.seen_from());
    if listed[0].is_some() != listed[1].is_some() {
        let pairs = |listed: bool| if listed { "a list of its own" } else { "every view with every light" }.to_owned();
        return differ("pairs", pairs(listed[0].is_some()), pairs(listed[1].is_some()));
    }
    let [of_a, of_b] = listed.map(|set| set.unwrap_or(&a.views));
    for (what, a, b) in [("views", &a.views, &b.views), ("lights", &a.lights, &b.lights), ("views", of_a, of_b)] {
        if a.len() != b.len() {
            return differ(what, format!("{} directions", a.len()), format!("{} directions", b.len()));
        }
        if let Some(i) = (0..a.len()).find(|&i| a.directions()[i].distance(b.directions()[i]) > 1e-3) {
            return differ(what, format!("direction {i} is {:?}", a.degrees()[i]), format!("{:?}", b.degrees()[i]));
        }
    }
    Ok(())
}

/// Converts an image to display-encoded values of 0..1.
fn displayed(texels: &Texels, meta: &BtfMeta, display: Encoding, out: &mut Vec<f32>) -> Result<()> {
    if texels.len() != meta.image_len() {
        let problem = format!("an image has {} values, expected {}", texels.len(), meta.image_len());
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
    // NaN survives a clamp; treat it as black, so that it counts as an error.
    out.iter_mut().for_each(|v| *v = if v.is_nan() { 0.0 } else { *v });
    Ok(())
}

/// Values summed in single precision before the sum continues in double precision.
const RUN: usize = 512;
const LANES: usize = 16;

wide! {
    /// Sums of absolute and squared differences, and the largest difference.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, MemoryBtf, SampleType};
    use crate::direction::DirectionSet;
    use crate::progress::Silent;

    fn btf(width: usize, height: usize, encoding: Encoding, value: impl Fn(usize) -> f32) -> MemoryBtf {
        let set = |n: usize| DirectionSet::from_degrees((0..n).map(|i| [10.0 * i as f64, 0.0]).collect()).unwrap();
        let meta = BtfMeta {
            width,
            height,
            views: set(2),
            lights: set(3),
            encoding,
            cosine: Cosine::Included,
            sample_type: SampleType::F32,
        };
        let values = (0..2 * meta.view_len()).map(value).collect();
        MemoryBtf::new(meta, Texels::F32(Cow::Owned(values))).unwrap()
    }

    fn wave(i: usize) -> f32 {
        0.5 + 0.4 * (i as f32 * 0.37).sin()
    }

    fn disturbed(i: usize) -> f32 {
        wave(i) + 0.3 * (i as f32 * 1.7).cos()
    }

    /// The same metrics by their definitions, in double precision.
    fn brute_force(a: &MemoryBtf, b: &MemoryBtf) -> Report {
        let meta = a.meta();
        let (mut sum, mut squares, mut largest, mut ssim) = (0.0, 0.0, 0.0f64, 0.0);
        for (view, light) in (0..2).flat_map(|v| (0..3).map(move |l| (v, l))) {
            let numbers = |btf: &MemoryBtf| -> Vec<f64> {
                let image = btf.image(view, light).unwrap();
                let encode = |v: f32| meta.encoding.display().encode(meta.encoding.decode(v)).clamp(0.0, 1.0);
                image.to_f32().iter().map(|&v| f64::from(encode(v))).collect()
            };
            let (x, y) = (numbers(a), numbers(b));
            for (x, y) in x.iter().zip(&y) {
                let d = (x - y).abs();
                sum += d;
                squares += d * d;
                largest = largest.max(d);
            }
            let luma = |v: &[f64]| -> Vec<f64> {
                v.chunks(3).map(|c| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]).collect()
            };
            ssim += ssim_by_definition(&luma(&x), &luma(&y), meta.width, meta.height);
        }
        let n = (2 * meta.view_len()) as f64;
        let mse = squares / n;
        Report {
            mean_abs_error: sum / n,
            max_abs_error: largest,
            rmse: mse.sqrt(),
            psnr_db: 10.0 * (1.0 / mse).log10(),
            ssim: ssim / 6.0,
        }
    }

    fn ssim_by_definition(x: &[f64], y: &[f64], width: usize, height: usize) -> f64 {
        let size = if width < 11 || height < 11 { None } else { Some(11) };
        let (window_width, window_height) = (size.unwrap_or(width), size.unwrap_or(height));
        let weight = |i: usize, j: usize| match size {
            Some(_) => (-((i as f64 - 5.0).powi(2) + (j as f64 - 5.0).powi(2)) / (2.0 * 1.5 * 1.5)).exp(),
            None => 1.0,
        };
        let (mut total, mut places) = (0.0, 0.0);
        for top in 0..=height - window_height {
            for left in 0..=width - window_width {
                let mean = |f: &dyn Fn(f64, f64) -> f64| {
                    let (mut sum, mut weights) = (0.0, 0.0);
                    for (i, j) in (0..window_height).flat_map(|i| (0..window_width).map(move |j| (i, j))) {
                        let at = (top + i) * width + left + j;
                        sum += weight(i, j) * f(x[at], y[at]);
                        weights += weight(i, j);
                    }
                    sum / weights
                };
                let (mx, my) = (mean(&|x, _| x), mean(&|_, y| y));
                let (vx, vy) = (mean(&|x, _| (x - mx).powi(2)), mean(&|_, y| (y - my).powi(2)));
                let covariance = mean(&|x, y| (x - mx) * (y - my));
                let (c1, c2) = (0.0001, 0.0009);
                total += (2.0 * mx * my + c1) * (2.0 * covariance + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2));
                places += 1.0;
            }
        }
        total / places
    }

    fn close(a: &Report, b: &Report) {
        let pairs = [
            (a.mean_abs_error, b.mean_abs_error, 1e-6),
            (a.max_abs_error, b.max_abs_error, 1e-6),
            (a.rmse, b.rmse, 1e-6),
            (a.psnr_db, b.psnr_db, 1e-4),
            (a.ssim, b.ssim, 1e-5),
        ];
        assert!(pairs.iter().all(|(a, b, tolerance)| (a - b).abs() < *tolerance), "{a:?}\n{b:?}");
    }

    #[test]
    fn metrics_follow_their_definitions() {
        for (width, height) in [(11, 11), (12, 30), (43, 15), (10, 20), (27, 12), (1, 1)] {
            for encoding in [Encoding::Srgb, Encoding::Linear, Encoding::Gamma(2.2)] {
                let (a, b) = (btf(width, height, encoding, wave), btf(width, height, encoding, disturbed));
                let report = compare(&a, &b, &Silent).unwrap();
                close(&report, &brute_force(&a, &b));
                let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
                assert_eq!(one.install(|| compare(&a, &b, &Silent)).unwrap(), report);
            }
        }
    }

    #[test]
    fn vectors_and_scalars_sum_the_same() {
        let (a, b): (Vec<f32>, Vec<f32>) = (0..5003).map(|i| (wave(i), disturbed(i))).unzip();
        let figures = |s: Sums| (s.absolute, s.squared, s.largest);
        let fast = figures(differences(&a, &b));
        assert_eq!(crate::simd::portable(|| figures(differences(&a, &b))), fast);
        let fast = ssim(&a[..5000], &b[..5000], 100, 50);
        assert_eq!(crate::simd::portable(|| ssim(&a[..5000], &b[..5000], 100, 50)), fast);
    }

    #[test]
    fn identical_images_have_infinite_psnr_and_json_round_trips() {
        let a = btf(12, 12, Encoding::Srgb, wave);
        let report = compare(&a, &a, &Silent).unwrap();
        let json = serde_json::to_string(&report).unwrap();
        let expected = r#"{"mean_abs_error":0.0,"max_abs_error":0.0,"rmse":0.0,"psnr_db":null,"ssim":1.0}"#;
        assert_eq!(json, expected);
        assert_eq!(serde_json::from_str::<Report>(&json).unwrap(), report);
    }

    #[test]
    fn btfs_of_different_shape_are_refused() {
        let a = btf(12, 12, Encoding::Srgb, wave);
        let error = compare(&a, &btf(12, 11, Encoding::Srgb, wave), &Silent).unwrap_err().to_string();
        assert!(error.contains("12 x 12") && error.contains("12 x 11"), "{error}");
    }

    #[test]
    fn missing_pairs_do_not_count() {
        struct Gaps(MemoryBtf);
        impl BtfSource for Gaps {
            fn meta(&self) -> &BtfMeta {
                self.0.meta()
            }
            fn view(&self, view: usize) -> Result<Texels<'_>> {
                self.0.view(view)
            }
            fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
                self.0.image(view, light)
            }
            fn source_bytes(&self) -> u64 {
                0
            }
            fn missing(&self) -> &[(usize, usize)] {
                &[(1, 2), (0, 0)]
            }
        }
        let image = 3 * 12 * 12;
        // Images 0 and 5 differ, the others are identical.
        let b = btf(12, 12, Encoding::Srgb, |i| if [0, 5].contains(&(i / image)) { 0.0 } else { wave(i) });
        let report = compare(&Gaps(btf(12, 12, Encoding::Srgb, wave)), &b, &Silent).unwrap();
        assert_eq!(report.max_abs_error, 0.0);
    }
}
