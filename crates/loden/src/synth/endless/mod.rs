//! A surface without end: pieces of the sample blended wherever the material is evaluated; nothing is stored.
//!
//! The method for materials without structure (felt, gravel, grained leather) on surfaces of any size. It takes no time before
//! rendering, and no memory but that of the sample.
//!
//! # Model
//! A few decorrelated coefficients c stand for the ABRDF of a texel: the display value at a pair of directions is a mean plus
//! the sum of c times factors of the pair, found by least squares from all images. Each coefficient is transformed to a
//! Gaussian distribution. The plane is divided into triangles, around each of whose corners a random piece of the sample is laid. A
//! point lies in three pieces; their transformed coefficients are blended with weights w, which fall off
//! towards the far side of the triangles, and divided by the root of the sum of w^2. The result is Gaussian again. Transformed back,
//! coefficients have the distribution of the sample: neither contrast nor mean colour changes.
//!
//! # Limits
//! Structure is lost: threads, bricks, anything larger than the width of a blend. [`Endless::loss`] tells how much. Coefficients mix
//! texels at different heights, so that seen at grazing angles parallax is blurred. Directions are drawn for the
//! nearest piece.
//!
//! # References
//! heitz2018, deliot2019, burley2019

mod histogram;
mod pieces;
mod table;

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::Exemplar;
use super::measure::likeness;
use crate::Result;
use crate::btf::BtfSource;
use crate::color::domain::{Domain, Linearizer};
use crate::direction::{Scheme, Stencil};
use crate::material::angles::{Angles, Footprint, LightStencil, texel_centre};
use crate::material::{Bounce, Material, Point, Prepared, Sample};
use crate::progress::Progress;
use histogram::Histogram;
use pieces::{Piece, Pieces};
use table::Table;

/// Coefficients of a texel.
const CHANNELS: usize = 16;

/// The coefficients of a point.
type Coefficients = [f32; CHANNELS];

/// A material that continues a sample without end.
pub struct Endless {
    /// The sample, whose directions are drawn.
    sample: Arc<dyn Material>,
    /// Its texels along u and v.
    size: [usize; 2],
    pieces: Pieces,
    /// Transformed coefficients of the sample.
    gaussian: Vec<Coefficients>,
    histograms: Vec<Histogram>,
    table: Table,
    angles: Angles,
    linearizer: Linearizer,
    loss: f64,
}

impl Endless {
    /// Continues a BTF; `sample` is its material, and `periodic` says that it continues at its opposite edges.
    ///
    /// # Errors
    /// [`crate::Error::NonFinite`]; [`crate::Error::Parameter`] if the directions do not allow `scheme`; errors of reading the
    /// images; [`crate::Error::Cancelled`].
    pub fn new(
        source: &dyn BtfSource,
        sample: Arc<dyn Material>,
        scheme: Scheme,
        (seed, periodic): (u64, bool),
        progress: &dyn Progress,
    ) -> Result<Self> {
        let meta = source.meta();
        let exemplar = Exemplar { periodic, ..Exemplar::of_btf(source, CHANNELS, progress)? };
        let coefficients: Vec<Coefficients> = (exemplar.values.chunks_exact(exemplar.channels))
            .map(|texel| std::array::from_fn(|k| texel.get(k).copied().unwrap_or(0.0)))
            .collect();
        let table = Table::new(source, &coefficients, progress)?;
        let pieces = Pieces::new([meta.width, meta.height], periodic, seed);
        let use_of_texels = pieces.use_of_texels();
        let of_channel = |k: usize| coefficients.iter().map(move |c| c[k]).collect::<Vec<f32>>();
        let (histograms, planes): (Vec<Histogram>, Vec<Vec<f32>>) =
            (0..CHANNELS).map(|k| Histogram::new(&of_channel(k), &use_of_texels)).unzip();
        let gaussian = (0..meta.texels()).map(|texel| std::array::from_fn(|k| planes[k][texel])).collect();
        let mut endless = Self {
            sample,
            size: [meta.width, meta.height],
            pieces,
            gaussian,
            histograms,
            table,
            angles: Angles::new(meta, scheme)?,
            linearizer: Linearizer::new(Domain::Display, meta.encoding),
            loss: 0.0,
        };
        endless.loss = endless.loss_of(&exemplar);
        Ok(endless)
    }

    /// The loss above which a sample has structure that a blend does not keep.
    pub const LOST: f64 = 2.5;

    /// How much less patches of the result are like those of the sample than its two halves are like each other; compare
    /// [`Endless::LOST`].
    pub fn loss(&self) -> f64 {
        self.loss
    }

    fn loss_of(&self, exemplar: &Exemplar) -> f64 {
        let (width, height) = (exemplar.width, exemplar.height);
        let centre = |texel: usize| texel_centre(texel, width, height);
        let values = (0..width * height)
            .flat_map(|texel| self.coefficients(&self.pieces.around(centre(texel))).into_iter().take(exemplar.channels))
            .collect();
        let made = Exemplar::new(width, height, exemplar.channels, values);
        likeness(exemplar, &made)
    }

    /// The coefficients of a point, from the pieces around it. The four texels around it are blended, then interpolated as
    /// those of the sample are: interpolated numbers are less spread, so a blend of them would not have the sample's colours.
    fn coefficients(&self, pieces: &[Piece; 3]) -> Coefficients {
        let [width, height] = self.size;
        let norm = pieces.iter().map(|piece| piece.weight * piece.weight).sum::<f32>().sqrt();
        let footprints = pieces.map(|piece| Footprint::new(piece.uv, width, height));
        let mut mean = [0.0f32; CHANNELS];
        for corner in 0..4 {
            let mut sums = [0.0f32; CHANNELS];
            for (piece, footprint) in pieces.iter().zip(&footprints).filter(|(piece, _)| piece.weight > 0.0) {
                let numbers = &self.gaussian[footprint.texel[corner]];
                sums.iter_mut().zip(numbers).for_each(|(sum, v)| *sum += piece.weight * v);
            }
            let weight = footprints[0].weight[corner];
            let blended = self.histograms.iter().zip(sums).map(|(histogram, sum)| histogram.value(sum / norm));
            mean.iter_mut().zip(blended).for_each(|(mean, v)| *mean += weight * v);
        }
        mean
    }

    fn found(&self, uv: Vec2, wo: Vec3) -> Found {
        let pieces = self.pieces.around(uv);
        let nearest =
            pieces.iter().fold(pieces[0], |best, piece| if piece.weight > best.weight { *piece } else { best });
        let view = if wo.z > 0.0 { self.angles.views_around(wo) } else { Stencil::NONE };
        Found { coefficients: self.coefficients(&pieces), view, wo, nearest: nearest.uv }
    }

    fn value(&self, found: &Found, wi: Vec3) -> Vec3 {
        let mut light = LightStencil::NONE;
        let Some(stencil) = self.angles.lit(&found.view, wi, found.wo, &mut light) else { return Vec3::ZERO };
        let display = self.table.display(&stencil, &found.coefficients);
        Vec3::from_array(display.map(|v| self.linearizer.linear(v))) * stencil.factor
    }
}

/// What is known of a point.
struct Found {
    coefficients: Coefficients,
    /// The sampled views around the viewer.
    view: Stencil,
    wo: Vec3,
    /// The point of the sample that has the largest weight.
    nearest: Vec2,
}

impl Material for Endless {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.value(&self.found(uv, wo), wi)
    }

    fn texels(&self) -> Option<[usize; 2]> {
        Some(self.size)
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.sample.sample(self.found(uv, wo).nearest, wo, random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.sample.pdf(self.found(uv, wo).nearest, wi, wo)
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        let found: Vec<Found> = points.iter().map(|point| self.found(point.uv, point.wo)).collect();
        let nearest = points.iter().zip(&found).map(|(point, found)| Point { uv: found.nearest, ..*point }).collect();
        Box::new(EndlessPoints { material: self, found, nearest })
    }

    fn check(&self) -> Result<()> {
        self.sample.check()
    }
}

/// Prepared points.
struct EndlessPoints<'a> {
    material: &'a Endless,
    found: Vec<Found>,
    /// The points of the sample that directions are drawn at.
    nearest: Vec<Point>,
}

impl Prepared for EndlessPoints<'_> {
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        for ((value, &index), &wi) in values.iter_mut().zip(index).zip(wi) {
            *value = self.material.value(&self.found[index as usize], wi);
        }
    }

    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        self.material.sample.prepare(&self.nearest).scatter(index, random, bounces);
        for (bounce, &index) in bounces.iter_mut().zip(index).filter(|(bounce, _)| bounce.pdf > 0.0) {
            bounce.value = self.material.value(&self.found[index as usize], bounce.wi);
        }
    }

    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]) {
        self.material.sample.prepare(&self.nearest).pdf(index, wi, densities);
    }
}

#[cfg(test)]
mod tests;
