//! Exemplars of materials and of pictures.

use rayon::prelude::*;

use super::Exemplar;
use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::color::domain::Domain;
use crate::factor::linalg::largest_eigenpairs;
use crate::picture::Picture;
use crate::progress::{Progress, Task};
use crate::separable::pairs;
use crate::{Error, Result};

/// Pairs of directions at which the texels of a BTF are compared.
const PAIRS: usize = 24;

/// Limit on the numbers of all images at these pairs.
const MAX_NUMBERS: usize = 1 << 27;

impl Exemplar {
    /// Texels of a BTF, compressed by any codec or not.
    ///
    /// # Model
    /// The images of 24 pairs of directions, spread evenly up to 80 degrees from the normal, as display values. The squared
    /// distance of two texels is the mean over the pairs of the squared difference of their colours: a sample of the distance
    /// of their ABRDFs. Of the vectors of all pairs, the `channels` largest principal components are kept, not scaled, which
    /// keeps distances as well as that many numbers can.
    ///
    /// # Errors
    /// [`Error::NonFinite`]; errors of reading the images; [`Error::Cancelled`].
    pub fn of_btf(source: &dyn BtfSource, channels: usize, progress: &dyn Progress) -> Result<Self> {
        let meta = source.meta();
        let chosen = chosen(meta, (MAX_NUMBERS / meta.image_len()).clamp(1, PAIRS));
        let task = Task::new(progress, "read the sample", chosen.len() as u64);
        let image = |&(view, light): &(usize, usize)| {
            task.advance(1)?;
            Ok(displayed(meta, &source.image(view, light)?))
        };
        let images = chosen.par_iter().map(image).collect::<Result<Vec<_>>>()?;
        let values = components(&images, meta.texels(), channels).ok_or_else(|| Error::non_finite("the sample"))?;
        Ok(Self::new(meta.width, meta.height, values.len() / meta.texels(), values))
    }

    /// Texels of a picture, compared by their sRGB values, 0 to 1.
    pub fn of_picture(picture: &Picture) -> Self {
        let stored = |c: &glam::Vec3| c.to_array().map(|v| crate::color::Encoding::Srgb.encode(v));
        Self::new(picture.width, picture.height, 3, picture.rgb.iter().flat_map(stored).collect())
    }
}

/// Measured pairs (view, light) near evenly spread ones, each once.
fn chosen(meta: &BtfMeta, count: usize) -> Vec<(usize, usize)> {
    let nearest = |directions: &[glam::Vec3], w: glam::Vec3| {
        (0..directions.len()).fold(0, |best, k| if directions[k].dot(w) > directions[best].dot(w) { k } else { best })
    };
    let (views, lights) = (meta.views.directions(), meta.lights.directions());
    let of_pair = |(wi, wo)| match meta.is_listed() {
        true => meta.nearest_pair(wi, wo),
        false => (nearest(views, wo), nearest(lights, wi)),
    };
    let mut chosen: Vec<_> = pairs(count).map(of_pair).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

fn displayed(meta: &BtfMeta, image: &Texels) -> Vec<f32> {
    image.to_f32().iter().map(|&v| Domain::Display.from_stored(meta.encoding, v)).collect()
}

/// Texels summed at a time.
const CHUNK: usize = 4096;

/// The largest principal components of the vectors that texels have in all images, shape (texel, component); `None` if a number
/// is not finite.
fn components(images: &[Vec<f32>], texels: usize, channels: usize) -> Option<Vec<f32>> {
    let n = 3 * images.len();
    let scale = 1.0 / (images.len() as f64).sqrt();
    let value = |texel: usize, k: usize| f64::from(images[k / 3][3 * texel + k % 3]) * scale;
    let starts: Vec<usize> = (0..texels).step_by(CHUNK).collect();
    let sums = |&first: &usize| {
        let (mut sum, mut products) = (vec![0.0; n], vec![0.0; n * n]);
        for texel in first..texels.min(first + CHUNK) {
            let vector: Vec<f64> = (0..n).map(|k| value(texel, k)).collect();
            for (i, a) in vector.iter().enumerate() {
                sum[i] += a;
                products[i * n..][..n].iter_mut().zip(&vector).for_each(|(product, b)| *product += a * b);
            }
        }
        (sum, products)
    };
    // Add up in the order of the texels
    let (mut mean, mut scatter) = (vec![0.0; n], vec![0.0; n * n]);
    for (sum, products) in starts.par_iter().map(sums).collect::<Vec<_>>() {
        mean.iter_mut().zip(sum).for_each(|(mean, v)| *mean += v / texels as f64);
        scatter.iter_mut().zip(products).for_each(|(scatter, v)| *scatter += v / texels as f64);
    }
    (0..n * n).for_each(|i| scatter[i] -= mean[i / n] * mean[i % n]);
    let channels = channels.clamp(1, n);
    let basis = largest_eigenpairs(&scatter, n, channels)?.vectors;
    let project = |texel: usize| {
        let centred: Vec<f64> = (0..n).map(|k| value(texel, k) - mean[k]).collect();
        let dot = |vector: &[f64]| vector.iter().zip(&centred).map(|(a, b)| a * b).sum::<f64>() as f32;
        basis.chunks_exact(n).map(dot).collect::<Vec<_>>()
    };
    Some((0..texels).into_par_iter().flat_map_iter(project).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{Cosine, MemoryBtf, SampleType};
    use crate::color::Encoding;
    use crate::direction::DirectionSet;
    use crate::progress::Silent;
    use crate::random::{hash, unit};

    /// A BTF whose texels have a dark half, a diffuse and a shiny one.
    fn btf() -> MemoryBtf {
        let (views, lights) = (DirectionSet::bonn81(), DirectionSet::bonn81());
        let (encoding, cosine) = (Encoding::Srgb, Cosine::Included);
        let meta = BtfMeta { width: 9, height: 6, views, lights, encoding, cosine, sample_type: SampleType::U8 };
        let mut texels = vec![];
        for wo in meta.views.directions() {
            for wi in meta.lights.directions() {
                for texel in 0..54u64 {
                    let diffuse = unit(hash(&[texel])) * wi.z;
                    let shine = unit(hash(&[texel, 1])) * (wi + wo).normalize_or_zero().z.powi(30);
                    texels.extend([diffuse, 0.5 * (diffuse + shine), shine].map(|v| (255.0 * v) as u8));
                }
            }
        }
        MemoryBtf::new(meta, Texels::U8(texels.into())).unwrap()
    }

    #[test]
    fn distances_are_those_of_the_images() {
        let btf = btf();
        let exemplar = Exemplar::of_btf(&btf, 8, &Silent).unwrap();
        assert_eq!((exemplar.width, exemplar.height, exemplar.channels), (9, 6, 8));
        exemplar.check().unwrap();
        let chosen = chosen(btf.meta(), PAIRS);
        assert!(chosen.len() > 20, "{}", chosen.len());
        let images: Vec<_> = chosen.iter().map(|&(v, l)| btf.image(v, l).unwrap().to_f32().into_owned()).collect();
        for (a, b) in [(0, 1), (5, 40), (17, 53)] {
            let difference =
                |image: &Vec<f32>| (0..3).map(|k| (image[3 * a + k] - image[3 * b + k]).powi(2)).sum::<f32>();
            let expected = images.iter().map(difference).sum::<f32>() / images.len() as f32;
            let source = |texel: usize| super::super::Source::new(texel % 9, texel / 9);
            let found = exemplar.distance(source(a), source(b));
            // two numbers describe a texel, but not linearly once they are rounded
            assert!((found - expected).abs() < 0.01 * expected, "{a} {b}: {found} {expected}");
        }
        // one component still tells the most different texels apart
        assert_eq!(Exemplar::of_btf(&btf, 1, &Silent).unwrap().channels, 1);
    }

    #[test]
    fn constant_materials_and_pictures_are_exemplars() {
        let meta = BtfMeta { width: 2, height: 3, ..btf().meta().clone() };
        let texels = vec![77; meta.pairs() * meta.image_len()];
        let constant = MemoryBtf::new(meta, Texels::U8(texels.into())).unwrap();
        let exemplar = Exemplar::of_btf(&constant, 4, &Silent).unwrap();
        assert!(exemplar.values.iter().all(|v| v.abs() < 1e-6), "{:?}", exemplar.values);
        let picture = Exemplar::of_picture(&Picture::filled(3, 2, glam::Vec3::new(0.0, 0.214_041_14, 1.0)));
        assert_eq!((picture.width, picture.height, picture.channels), (3, 2, 3));
        assert!((picture.texel(2, 1)[1] - 0.5).abs() < 1e-4 && (picture.texel(0, 0)[2] - 1.0).abs() < 1e-4);
    }
}
