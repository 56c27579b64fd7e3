//! Exemplars of the relief of a sample, from its shading.
//!
//! # Model
//! Seen from the front, a texel with normal n and albedo a has the value a n . l under the light l. The vector a n that fits
//! best in least squares, over lights between 15 and 65 degrees from the normal, gives the slopes; the height is the one
//! whose differences fit the slopes best, by successive over-relaxation. A method that compares heights and copies texels
//! synthesises a height field and dresses it with what was measured at each of its points.
//!
//! # Limits
//! Highlights, shadows and interreflection tilt the normals. Waves longer than about a hundred texels are lost.
//!
//! # References
//! liu2001, woodham1980

use glam::{DMat3, DVec3};

use super::Exemplar;
use crate::btf::{BtfSource, Cosine};
use crate::color::luminance;
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// Angles of the lights from the normal, in degrees: steeper ones make highlights, flatter ones shadows.
const LIGHTS: std::ops::RangeInclusive<f32> = 15.0..=65.0;

/// Views of a list of pairs that count as frontal: degrees from the normal.
const FRONTAL: f32 = 30.0;

/// Steepest slope that is integrated.
const STEEPEST: f32 = 3.0;

/// Sweeps of the relaxation, and its factor.
const SWEEPS: usize = 300;
const RELAXATION: f32 = 1.9;

/// A height field with its slopes, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Relief {
    /// Texels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Height above the mean, in texels.
    pub heights: Vec<f32>,
    /// Rise per texel to the right, and per row downwards.
    pub slopes: Vec<[f32; 2]>,
}

impl Relief {
    /// The relief of a BTF.
    ///
    /// # Errors
    /// [`Error::Parameter`] if fewer than three lights (of a list of pairs, seen from the front) are between 15 and 65 degrees from the normal, or all in one plane;
    /// errors of reading the images; [`Error::Cancelled`].
    pub fn of_btf(source: &dyn BtfSource, progress: &dyn Progress) -> Result<Self> {
        let meta = source.meta();
        let views = meta.views.directions();
        let view = (0..views.len()).fold(0, |best, k| if views[k].z > views[best].z { k } else { best });
        let degrees = |w: glam::Vec3| w.z.acos().to_degrees();
        let is_between = |&light: &usize| {
            let (wi, wo) = meta.pair(view, light);
            LIGHTS.contains(&degrees(wi)) && (!meta.is_listed() || degrees(wo) < FRONTAL)
        };
        let lights: Vec<usize> = (0..meta.lights.len()).filter(is_between).collect();
        let task = Task::new(progress, "read the relief", lights.len() as u64);
        // Sum up the normal equations, image by image
        let (mut matrix, mut sides) = (DMat3::ZERO, vec![DVec3::ZERO; meta.texels()]);
        for light in lights {
            let w = meta.lights.directions()[light].as_dvec3();
            matrix += DMat3::from_cols(w * w.x, w * w.y, w * w.z);
            let cosine = if meta.cosine == Cosine::Excluded { w.z } else { 1.0 };
            let image = source.image(view, light)?.to_f32().into_owned();
            for (side, rgb) in sides.iter_mut().zip(image.as_chunks::<3>().0) {
                *side += w * cosine * f64::from(luminance(rgb.map(|v| meta.encoding.decode(v))));
            }
            task.advance(1)?;
        }
        if matrix.determinant().abs() < 1e-6 {
            let problem = "too few for the relief: three or more are needed at 15 to 65 degrees from the normal";
            return Err(Error::parameter("lights", problem));
        }
        let inverse = matrix.inverse();
        let slope = |side: &DVec3| {
            let normal = (inverse * *side).as_vec3();
            // image rows go down, against the bitangent
            let along = |v: f32| if normal.z > 0.0 { (v / normal.z).clamp(-STEEPEST, STEEPEST) } else { 0.0 };
            [along(-normal.x), along(normal.y)]
        };
        Ok(Self::of_slopes(meta.width, meta.height, sides.iter().map(slope).collect()))
    }

    /// Integrates slopes.
    fn of_slopes(width: usize, height: usize, slopes: Vec<[f32; 2]>) -> Self {
        let mut heights = vec![0.0f32; width * height];
        // what a neighbour says the height of a texel is: its own height and the mean slope between both
        let step = |from: usize, to: usize, axis: usize| 0.5 * (slopes[from][axis] + slopes[to][axis]);
        for _ in 0..SWEEPS {
            for texel in 0..width * height {
                let (x, y) = (texel % width, texel / width);
                let (mut sum, mut count) = (0.0, 0.0);
                let mut say = |is_there: bool, other: usize, sign: f32, axis: usize| {
                    if is_there {
                        sum += heights[other] + sign * step(texel, other, axis);
                        count += 1.0;
                    }
                };
                say(x > 0, texel.wrapping_sub(1), 1.0, 0);
                say(x + 1 < width, texel + 1, -1.0, 0);
                say(y > 0, texel.wrapping_sub(width), 1.0, 1);
                say(y + 1 < height, texel + width, -1.0, 1);
                if count > 0.0 {
                    heights[texel] += RELAXATION * (sum / count - heights[texel]);
                }
            }
        }
        let mean = heights.iter().map(|&h| f64::from(h)).sum::<f64>() / heights.len() as f64;
        heights.iter_mut().for_each(|h| *h -= mean as f32);
        Self { width, height, heights, slopes }
    }
}

impl Exemplar {
    /// Texels compared by height and slopes, each with unit variance.
    pub fn of_relief(relief: &Relief) -> Self {
        let Relief { width, height, heights, slopes } = relief;
        let triples = heights.iter().zip(slopes).flat_map(|(h, [p, q])| [*h, *p, *q]);
        let mut values: Vec<f32> = triples.collect();
        for channel in 0..3 {
            let of_channel = || values[channel..].iter().step_by(3).map(|&v| f64::from(v));
            let mean = of_channel().sum::<f64>() / heights.len() as f64;
            let variance = of_channel().map(|v| (v - mean).powi(2)).sum::<f64>() / heights.len() as f64;
            // a flat channel says nothing
            let scale = if variance > 1e-9 { 1.0 / variance.sqrt() } else { 0.0 };
            values[channel..].iter_mut().step_by(3).for_each(|v| *v = ((f64::from(*v) - mean) * scale) as f32);
        }
        Self::new(*width, *height, 3, values)
    }

    /// Texels compared by the channels of this exemplar and of another one of the same texels, which is scaled to the same
    /// variance.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the sizes differ.
    pub fn with(self, other: &Self) -> Result<Self> {
        if (self.width, self.height) != (other.width, other.height) {
            let problem =
                format!("found {} x {}, expected {} x {}", other.width, other.height, self.width, self.height);
            return Err(Error::parameter("exemplar", problem));
        }
        let scale = match (self.variance(), other.variance()) {
            (own, others) if own > 0.0 && others > 0.0 => (own / others).sqrt() as f32,
            _ => 1.0,
        };
        let own = self.values.chunks_exact(self.channels).zip(other.values.chunks_exact(other.channels));
        let values = own.flat_map(|(a, b)| a.iter().copied().chain(b.iter().map(move |v| scale * v))).collect();
        Ok(Self { channels: self.channels + other.channels, values, ..self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{BtfMeta, MemoryBtf, SampleType, Texels};
    use crate::color::Encoding;
    use crate::direction::DirectionSet;
    use crate::progress::Silent;

    /// Hills, and the images of a diffuse material with stripes of two albedos on them.
    fn hills() -> (Vec<f32>, MemoryBtf) {
        let (width, height) = (40, 30);
        let at = |x: f32, y: f32| 2.0 * (x * 0.5).sin() * (y * 0.4).cos();
        let heights: Vec<f32> = (0..width * height).map(|i| at((i % width) as f32, (i / width) as f32)).collect();
        let (views, lights) = (DirectionSet::bonn81(), DirectionSet::bonn81());
        let (encoding, cosine) = (Encoding::Linear, Cosine::Included);
        let meta = BtfMeta { width, height, views, lights, encoding, cosine, sample_type: SampleType::F32 };
        let mut texels = Vec::new();
        for _ in 0..meta.views.len() {
            for light in meta.lights.directions() {
                for i in 0..width * height {
                    let (x, y) = ((i % width) as f32, (i / width) as f32);
                    let across = at(x + 0.5, y) - at(x - 0.5, y);
                    let down = at(x, y + 0.5) - at(x, y - 0.5);
                    let normal = glam::Vec3::new(-across, down, 1.0).normalize();
                    let albedo = if i % 7 < 3 { 0.8 } else { 0.3 };
                    texels.extend([albedo * normal.dot(*light).max(0.0); 3]);
                }
            }
        }
        (heights, MemoryBtf::new(meta, Texels::F32(texels.into())).unwrap())
    }

    #[test]
    fn hills_are_found_whatever_their_colour() {
        let (heights, btf) = hills();
        let relief = Relief::of_btf(&btf, &Silent).unwrap();
        let mean = heights.iter().sum::<f32>() / heights.len() as f32;
        let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let truth: Vec<f32> = heights.iter().map(|h| h - mean).collect();
        let correlation = product(&truth, &relief.heights)
            / (product(&truth, &truth) * product(&relief.heights, &relief.heights)).sqrt();
        assert!(correlation > 0.98, "{correlation}");
        let size = product(&relief.heights, &relief.heights) / product(&truth, &truth);
        assert!((0.8..1.2).contains(&size), "{size}");
        let exemplar = Exemplar::of_relief(&relief);
        assert!((exemplar.variance() - 3.0).abs() < 1e-3);
        exemplar.check().unwrap();
    }

    #[test]
    fn exemplars_are_joined_with_equal_weight() {
        let a = Exemplar::new(2, 1, 1, vec![0.0, 4.0]);
        let b = Exemplar::new(2, 1, 2, vec![1.0, 0.0, 3.0, 0.0]);
        let joined = a.clone().with(&b).unwrap();
        assert_eq!((joined.channels, &joined.values[..]), (3, &[0.0, 2.0, 0.0, 4.0, 6.0, 0.0][..]));
        let flat = Exemplar::new(2, 1, 1, vec![1.0; 2]);
        assert_eq!(a.clone().with(&flat).unwrap().values, [0.0, 1.0, 4.0, 1.0]);
        assert!(a.with(&Exemplar::new(1, 1, 1, vec![0.0])).is_err());
    }
}
