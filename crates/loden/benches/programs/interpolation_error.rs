//! Measures how well triangles and rings predict measured images that are left out: a ring of views or lights at a
//! time, or one direction at a time.
//!
//! Usage: `interpolation_error FILE...`, where files are BTFs whose directions lie on rings, or BRDFs, which are
//! evaluated at the 81 directions of the Bonn goniometer. Prints a Markdown table of the mean absolute difference
//! divided by the mean value, in linear light. The last column is by triangles between stored values, which are
//! converted to linear light after the interpolation; the others interpolate linear light.

use glam::Vec2;
use loden::btf::{BtfMeta, BtfSource, Texels};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Interpolator, Scheme};
use loden::import;
use loden::material::Brdf;

/// Stored values per pair: (view, light, texel, channel).
struct Images {
    views: DirectionSet,
    lights: DirectionSet,
    encoding: Encoding,
    /// Width and height in texels, and in blocks, whose means are compared.
    size: [usize; 2],
    blocks: [usize; 2],
    values: Vec<f32>,
}

/// Texels per side of a block. The mean of a block has less noise.
const BLOCK: usize = 4;

/// How a direction is predicted from others.
#[derive(Clone, Copy)]
struct Prediction {
    scheme: Scheme,
    /// Interpolate stored values, instead of linear light.
    stored: bool,
}

const PREDICTIONS: [Prediction; 3] = [
    Prediction { scheme: Scheme::Triangles, stored: false },
    Prediction { scheme: Scheme::Rings, stored: false },
    Prediction { scheme: Scheme::Triangles, stored: true },
];

impl Images {
    fn read(path: &str) -> loden::Result<Self> {
        match import::open_named(path, &Default::default())?.1.images() {
            Ok(source) => Self::of_btf(source.as_ref()),
            Err(brdf) => Ok(Self::of_brdf(brdf.as_ref())),
        }
    }

    /// Apparent values, one block per pair.
    fn of_brdf(brdf: &dyn Brdf) -> Self {
        let (views, lights) = (DirectionSet::bonn81(), DirectionSet::bonn81());
        let pairs = views.directions().iter().flat_map(|&wo| lights.directions().iter().map(move |&wi| (wi, wo)));
        let values = pairs.flat_map(|(wi, wo)| brdf.apparent(Vec2::ZERO, wi, wo).to_array()).collect();
        Self { views, lights, encoding: Encoding::Linear, size: [1, 1], blocks: [1, 1], values }
    }

    fn of_btf(source: &dyn BtfSource) -> loden::Result<Self> {
        let BtfMeta { views, lights, encoding, width, height, .. } = source.meta().clone();
        let mut values = Vec::with_capacity(views.len() * source.meta().view_len());
        for view in 0..views.len() {
            let texels: Texels = source.view(view)?;
            values.extend_from_slice(&texels.to_f32());
        }
        let blocks = [width / BLOCK, height / BLOCK];
        Ok(Self { views, lights, encoding, size: [width, height], blocks, values })
    }

    fn at(&self, view: usize, light: usize) -> &[f32] {
        let image = self.size[0] * self.size[1] * 3;
        &self.values[(view * self.lights.len() + light) * image..][..image]
    }

    /// Means of blocks of linear light.
    fn means(&self, linear: &[f32]) -> Vec<f32> {
        if self.size == self.blocks {
            return linear.to_vec();
        }
        let ([width, _], [columns, rows]) = (self.size, self.blocks);
        let mean = |i: usize| {
            let (block, channel) = (i / 3, i % 3);
            let corner = (block / columns * width + block % columns) * BLOCK;
            let texel = |k: usize| linear[3 * (corner + k / BLOCK * width + k % BLOCK) + channel];
            (0..BLOCK * BLOCK).map(texel).sum::<f32>() / (BLOCK * BLOCK) as f32
        };
        (0..columns * rows * 3).map(mean).collect()
    }

    /// The difference of the images of the directions `out` from their prediction from the others, and their sum.
    fn error(&self, of_views: bool, out: &[usize], how: Prediction) -> loden::Result<(f64, f64)> {
        let set = if of_views { &self.views } else { &self.lights };
        let kept: Vec<usize> = (0..set.len()).filter(|i| !out.contains(i)).collect();
        let reduced = DirectionSet::from_degrees(kept.iter().map(|&i| set.degrees()[i]).collect())?;
        let interpolator = Interpolator::new(&reduced, how.scheme)?;
        let others = if of_views { self.lights.len() } else { self.views.len() };
        let decode = |v: &f32| self.encoding.decode(*v);
        let (mut difference, mut whole) = (0.0f64, 0.0f64);
        for &left in out {
            let stencil = interpolator.stencil(set.directions()[left]);
            for other in 0..others {
                let image = |i: usize| if of_views { self.at(i, other) } else { self.at(other, i) };
                let mut found = vec![0.0f32; image(left).len()];
                for (i, weight) in stencil.iter() {
                    for (found, value) in found.iter_mut().zip(image(kept[i])) {
                        *found += weight * if how.stored { *value } else { decode(value) };
                    }
                }
                if how.stored {
                    found.iter_mut().for_each(|v| *v = decode(v));
                }
                let truth: Vec<f32> = image(left).iter().map(decode).collect();
                for (found, truth) in self.means(&found).iter().zip(self.means(&truth)) {
                    difference += f64::from((found - truth).abs());
                    whole += f64::from(truth);
                }
            }
        }
        Ok((difference, whole))
    }
}

/// The rings between the pole and the last ring, as lists of directions.
fn inner_rings(set: &DirectionSet) -> Vec<Vec<usize>> {
    let mut angles: Vec<f64> = set.degrees().iter().map(|d| d[0]).collect();
    angles.sort_by(f64::total_cmp);
    angles.dedup();
    let inner = angles.get(1..angles.len().saturating_sub(1)).unwrap_or_default();
    let ring = |t: &f64| (0..set.len()).filter(|&i| set.degrees()[i][0] == *t).collect();
    inner.iter().map(ring).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("| material | left out | of | triangles | rings | triangles, stored values |\n|---|---|---|---|---|---|");
    for path in std::env::args().skip(1) {
        let images = Images::read(&path)?;
        let name = std::path::Path::new(&path).file_stem().map_or(path.clone(), |s| s.to_string_lossy().into_owned());
        for of_views in [true, false] {
            let set = if of_views { &images.views } else { &images.lights };
            let rings = inner_rings(set);
            let singles: Vec<Vec<usize>> = rings.iter().flatten().map(|&i| vec![i]).collect();
            for (what, lists) in [("a ring", &rings), ("a direction", &singles)] {
                let mut cells = Vec::new();
                for how in PREDICTIONS {
                    let mut sums = (0.0, 0.0);
                    for out in lists {
                        let (difference, whole) = images.error(of_views, out, how)?;
                        sums = (sums.0 + difference, sums.1 + whole);
                    }
                    cells.push(format!("{:.2} %", 100.0 * sums.0 / sums.1));
                }
                let of = if of_views { "views" } else { "lights" };
                println!("| {name} | {what} | {of} | {} |", cells.join(" | "));
            }
        }
    }
    Ok(())
}
