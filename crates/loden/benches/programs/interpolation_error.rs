//! Measures how well triangles and rings predict measured images that are left out: a ring of views or lights at a
//! time, or one direction at a time.
//!
//! Usage: `interpolation_error FILE...`, where files are BTFs whose directions lie on rings, or BRDFs, which are
//! evaluated at the 81 directions of the Bonn goniometer. Prints a Markdown table of the mean absolute difference
//! divided by the mean value, in linear light.

use glam::Vec2;
use loden::btf::{BtfSource, Texels};
use loden::direction::{DirectionSet, Interpolator, Scheme};
use loden::import;
use loden::material::Brdf;

/// Linear values per pair, averaged over blocks of texels: (view, light, value).
struct Images {
    views: DirectionSet,
    lights: DirectionSet,
    per_image: usize,
    values: Vec<f32>,
}

/// Texels per side of a block.
const BLOCK: usize = 4;

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
        Self { views, lights, per_image: 3, values }
    }

    fn of_btf(source: &dyn BtfSource) -> loden::Result<Self> {
        let meta = source.meta();
        let (columns, rows) = (meta.width / BLOCK, meta.height / BLOCK);
        let per_image = columns * rows * 3;
        let mut values = Vec::with_capacity(meta.pairs() * per_image);
        for view in 0..meta.views.len() {
            for light in 0..meta.lights.len() {
                let texels: Texels = source.image(view, light)?;
                let linear: Vec<f32> = texels.to_f32().iter().map(|v| meta.encoding.decode(*v)).collect();
                for i in 0..per_image {
                    let (block, channel) = (i / 3, i % 3);
                    let corner = (block / columns * meta.width + block % columns) * BLOCK;
                    let texel = |k: usize| linear[3 * (corner + k / BLOCK * meta.width + k % BLOCK) + channel];
                    values.push((0..BLOCK * BLOCK).map(texel).sum::<f32>() / (BLOCK * BLOCK) as f32);
                }
            }
        }
        Ok(Self { views: meta.views.clone(), lights: meta.lights.clone(), per_image, values })
    }

    fn at(&self, view: usize, light: usize) -> &[f32] {
        &self.values[(view * self.lights.len() + light) * self.per_image..][..self.per_image]
    }

    /// The relative error of the images of the directions `out`, predicted from the others.
    fn error(&self, of_views: bool, out: &[usize], scheme: Scheme) -> loden::Result<(f64, f64)> {
        let set = if of_views { &self.views } else { &self.lights };
        let kept: Vec<usize> = (0..set.len()).filter(|i| !out.contains(i)).collect();
        let reduced = DirectionSet::from_degrees(kept.iter().map(|&i| set.degrees()[i]).collect())?;
        let interpolator = Interpolator::new(&reduced, scheme)?;
        let others = if of_views { self.lights.len() } else { self.views.len() };
        let (mut difference, mut whole) = (0.0f64, 0.0f64);
        for &left in out {
            let stencil = interpolator.stencil(set.directions()[left]);
            for other in 0..others {
                let image = |i: usize| if of_views { self.at(i, other) } else { self.at(other, i) };
                for (k, truth) in image(left).iter().enumerate() {
                    let found: f32 = stencil.iter().map(|(i, w)| w * image(kept[i])[k]).sum();
                    difference += f64::from((found - truth).abs());
                    whole += f64::from(*truth);
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
    println!("| material | left out | of | triangles | rings |\n|---|---|---|---|---|");
    for path in std::env::args().skip(1) {
        let images = Images::read(&path)?;
        let name = std::path::Path::new(&path).file_stem().map_or(path.clone(), |s| s.to_string_lossy().into_owned());
        for of_views in [true, false] {
            let set = if of_views { &images.views } else { &images.lights };
            let rings = inner_rings(set);
            let singles: Vec<Vec<usize>> = rings.iter().flatten().map(|&i| vec![i]).collect();
            for (what, lists) in [("a ring", &rings), ("a direction", &singles)] {
                let mut cells = Vec::new();
                for scheme in [Scheme::Triangles, Scheme::Rings] {
                    let mut sums = (0.0, 0.0);
                    for out in lists {
                        let (difference, whole) = images.error(of_views, out, scheme)?;
                        sums = (sums.0 + difference, sums.1 + whole);
                    }
                    cells.push(format!("{:.2} %", 100.0 * sums.0 / sums.1));
                }
                let of = if of_views { "views" } else { "lights" };
                println!("| {name} | {what} | {of} | {} | {} |", cells[0], cells[1]);
            }
        }
    }
    Ok(())
}
