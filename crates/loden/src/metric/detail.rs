//! Distribution of the compression error over views, lights and texels.

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

use super::ciede2000::{ciede2000, lab};
use super::flip::flip;
use super::{Buffers, check, displayed};
use crate::btf::{BtfMeta, BtfSource};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// Mean absolute errors of parts of a BTF, in display-encoded values of 0..1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Detail {
    /// Errors by polar angle of the view: (degrees, error).
    pub by_view: Vec<(f64, f64)>,
    /// Errors by polar angle of the light: (degrees, error).
    pub by_light: Vec<(f64, f64)>,
    /// The pair with the largest error: (view, light).
    pub worst_pair: (usize, usize),
    /// Error of the worst pair.
    pub worst_pair_error: f64,
    /// The texel with the largest error: (x, y) from the upper left.
    pub worst_texel: (usize, usize),
    /// Error of the worst texel.
    pub worst_texel_error: f64,
    /// [`ciede2000`], mean over the texels of the selected images.
    pub ciede2000: f64,
    /// [`flip()`], mean over the selected images.
    pub flip: f64,
}

/// Compares all images like [`super::compare`], including missing pairs; perceptual metrics only for the pairs (view,
/// light) `seen`.
///
/// # Errors
/// See [`super::compare`].
pub fn detail(
    reference: &dyn BtfSource,
    test: &dyn BtfSource,
    seen: &[(usize, usize)],
    progress: &dyn Progress,
) -> Result<Detail> {
    let meta = reference.meta();
    check(meta, test.meta())?;
    let display = meta.encoding.display();
    let task = Task::new(progress, "compare", meta.pairs() as u64);
    let mut errors = Vec::with_capacity(meta.pairs());
    let mut texels = vec![0.0f64; meta.texels()];
    let (mut seen_sums, mut images) = ([0.0; 2], 0usize);
    for view in 0..meta.views.len() {
        // Compare all lights of the view
        let compare_pair = |buffers: &mut Buffers, light: usize| -> Result<(f64, Vec<f32>, Option<[f64; 2]>)> {
            task.advance(1)?;
            for (source, out) in [(reference, &mut buffers.reference), (test, &mut buffers.test)] {
                displayed(&source.image(view, light)?, source.meta(), display, out)?;
            }
            let rows = buffers.reference.chunks_exact(3).zip(buffers.test.chunks_exact(3));
            let texel = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / 3.0;
            let of_texels: Vec<f32> = rows.map(texel).collect();
            let mean = of_texels.iter().map(|&e| f64::from(e)).sum::<f64>() / meta.texels() as f64;
            let perceptual = seen.contains(&(view, light)).then(|| perceptual_errors(buffers, display, meta));
            Ok((mean, of_texels, perceptual))
        };
        let lights = (0..meta.lights.len()).into_par_iter();
        let found: Result<Vec<_>> = lights.map_init(Buffers::default, compare_pair).collect();
        // Accumulate in order, independent of the threads
        for (error, of_texels, perceptual) in found? {
            errors.push(error);
            texels.iter_mut().zip(of_texels).for_each(|(sum, error)| *sum += f64::from(error));
            seen_sums.iter_mut().zip(perceptual.unwrap_or_default()).for_each(|(sum, value)| *sum += value);
            images += usize::from(perceptual.is_some());
        }
        reference.release(view);
        test.release(view);
    }
    // Summarise by angle and find the largest errors
    let (pair, texel) = (largest(&errors)?, largest(&texels)?);
    let lights = meta.lights.len();
    Ok(Detail {
        by_view: match meta.lights.seen_from() {
            Some(views) => by_angle(views, |pair| errors[pair]),
            None => by_angle(&meta.views, |view| errors[view * lights..][..lights].iter().sum::<f64>() / lights as f64),
        },
        by_light: by_angle(&meta.lights, |light| {
            errors.iter().skip(light).step_by(lights).sum::<f64>() / meta.views.len() as f64
        }),
        worst_pair: (pair / lights, pair % lights),
        worst_pair_error: errors[pair],
        worst_texel: (texel % meta.width, texel / meta.width),
        worst_texel_error: texels[texel] / meta.pairs() as f64,
        ciede2000: seen_sums[0] / images.max(1) as f64,
        flip: seen_sums[1] / images.max(1) as f64,
    })
}

/// Perceptual differences of two images: mean CIEDE2000, and FLIP.
fn perceptual_errors(buffers: &Buffers, display: Encoding, meta: &BtfMeta) -> [f64; 2] {
    let [a, b] = [&buffers.reference, &buffers.test].map(|image| -> Vec<Vec3> {
        image.as_chunks::<3>().0.iter().map(|rgb| Vec3::from_array(rgb.map(|v| display.decode(v)))).collect()
    });
    let of = |rgb: &Vec3| lab(rgb.to_array().map(f64::from));
    let colours = a.iter().zip(&b).map(|(a, b)| ciede2000(of(a), of(b))).sum::<f64>();
    [colours / meta.texels() as f64, flip(&a, &b, meta.width)]
}

fn largest(values: &[f64]) -> Result<usize> {
    let largest = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b]));
    largest.ok_or_else(|| Error::parameter("reference", "the BTF is empty"))
}

/// Mean errors over directions of the same polar angle, in ascending order.
fn by_angle(set: &DirectionSet, error: impl Fn(usize) -> f64) -> Vec<(f64, f64)> {
    let mut rings: Vec<(f64, f64, usize)> = Vec::new();
    for (i, &[theta, _]) in set.degrees().iter().enumerate() {
        match rings.iter_mut().find(|ring| (ring.0 - theta).abs() < 0.5) {
            Some(ring) => (ring.1, ring.2) = (ring.1 + error(i), ring.2 + 1),
            None => rings.push((theta, error(i), 1)),
        }
    }
    rings.sort_by(|a, b| a.0.total_cmp(&b.0));
    rings.into_iter().map(|(theta, sum, count)| (theta, sum / count as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, MemoryBtf, SampleType, Texels};
    use crate::progress::Silent;

    fn btf(value: impl Fn(usize) -> f32) -> MemoryBtf {
        let views = DirectionSet::from_degrees(vec![[0.0, 0.0], [30.0, 0.0], [30.0, 180.0]]).unwrap();
        let (cosine, sample_type) = (Cosine::Included, SampleType::F32);
        let meta = BtfMeta {
            width: 3,
            height: 2,
            lights: views.clone(),
            views,
            encoding: Encoding::Srgb,
            cosine,
            sample_type,
        };
        let values: Vec<f32> = (0..3 * meta.view_len()).map(value).collect();
        MemoryBtf::new(meta, Texels::F32(values.into())).unwrap()
    }

    #[test]
    fn errors_are_located() {
        let (image, texel) = (18, 3);
        // Image 7 is view 2, light 1; texel 4 is (1, 1).
        let wrong = |i: usize| if i / image == 7 { 0.1 } else { 0.0 } + if i % image / texel == 4 { 0.02 } else { 0.0 };
        let found = detail(&btf(|_| 0.5), &btf(|i| 0.5 + wrong(i)), &[(2, 1)], &Silent).unwrap();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-6;
        let everywhere = 0.02 / 6.0;
        assert_eq!((found.worst_pair, found.worst_texel), ((2, 1), (1, 1)));
        assert!(close(found.worst_pair_error, 0.1 + everywhere), "{found:?}");
        assert!(close(found.worst_texel_error, 0.02 + 0.1 / 9.0), "{found:?}");
        for (rings, share) in [(&found.by_view, 6.0), (&found.by_light, 6.0)] {
            assert_eq!(rings.iter().map(|ring| ring.0.round()).collect::<Vec<_>>(), [0.0, 30.0]);
            assert!(close(rings[0].1, everywhere) && close(rings[1].1, everywhere + 0.1 / share), "{found:?}");
        }
        // A grey of 0.6 is about ten units of lightness above a grey of 0.5.
        assert!((5.0..15.0).contains(&found.ciede2000), "{found:?}");
        assert!((0.05..0.5).contains(&found.flip), "{found:?}");
        let whole = super::super::compare(&btf(|_| 0.5), &btf(|i| 0.5 + wrong(i)), &Silent).unwrap();
        let mean = found.by_view[0].1 / 3.0 + found.by_view[1].1 * 2.0 / 3.0;
        assert!(close(mean, whole.mean_abs_error), "{mean} {whole:?}");
    }
}
