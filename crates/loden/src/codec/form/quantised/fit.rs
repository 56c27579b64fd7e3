//! Means and components of clusters, fitted to all values of a view.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::Result;
use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::codec::budget;
use crate::codec::values::view_texels;
use crate::color::domain::Domain;
use crate::factor::kmeans::Partition;
use crate::simd::wide;
use crate::stages::{Each, Kernel, Known, Piece, Site, Stage, settings};

/// Means and components of clusters: a unit is a view.
pub struct Components;

#[derive(Serialize, Deserialize)]
struct Settings {
    clusters: usize,
    components: usize,
    domain: Domain,
}

impl Components {
    /// The stage for these clusters and their coefficients (texel, component).
    pub fn stage<'a>(
        partition: &'a Partition,
        coefficients: &'a [f32],
        components: usize,
        domain: Domain,
        views: usize,
    ) -> Result<Stage<'a>> {
        let known = Known {
            settings: settings(&Settings { clusters: partition.clusters, components, domain })?,
            floats: vec![coefficients.into()],
            indices: vec![partition.index.as_slice().into()],
            ..Known::default()
        };
        Ok(Stage { kernel: &Self, known, units: views, steps: views as u64 })
    }
}

impl Kernel for Components {
    fn name(&self) -> &'static str {
        "components"
    }

    fn memory(&self, meta: &BtfMeta, known: &Known, _units: Range<usize>, threads: usize) -> u64 {
        let Ok(Settings { clusters, components, .. }) = known.settings() else { return u64::MAX };
        // members with factors, and rows of a view, held by light and then by cluster
        let rows = 6 * clusters * (1 + components) * meta.lights.len();
        let factors = meta.texels() * (2 + (1 + components).next_multiple_of(LANES));
        budget::source(meta, threads) + budget::singles(rows + factors + threads * clusters * components * 64)
    }

    fn run(&self, site: &Site, known: &Known, units: Range<usize>, each: Each) -> Result<()> {
        let Settings { clusters, components, domain } = known.settings()?;
        let partition = Partition { index: known.index(0)?.to_vec(), clusters };
        let fit = Fit::new(&partition, known.float(0)?, components);
        for view in units {
            let floats = fit.view(site.source, view, domain)?;
            site.source.release(view);
            each(view, Piece { floats, ..Piece::default() })?;
            site.task.advance(1)?;
        }
        Ok(())
    }
}

/// Texels by cluster, with the factors of the least-squares fit.
struct Fit {
    members: Vec<Vec<u32>>,
    /// Factors of each member: groups of [`LANES`], a 1 followed by the coefficients.
    factors: Vec<Vec<[f32; LANES]>>,
    /// (cluster, 1 + component): factor of a sum of products.
    scale: Vec<Vec<f64>>,
    rows: usize,
}

/// Factors multiplied together.
const LANES: usize = 8;

/// Length of the single-precision sums that are added up in double precision.
const RUN: usize = 256;

impl Fit {
    fn new(partition: &Partition, coefficients: &[f32], c: usize) -> Self {
        let members = partition.members();
        let groups = (1 + c).div_ceil(LANES);
        let row = |p: u32, k: usize| match k {
            0 => 1.0,
            _ => coefficients.get(p as usize * c + k - 1).copied().filter(|_| k <= c).unwrap_or(0.0),
        };
        let of_member = |p: u32| (0..groups).map(move |g| std::array::from_fn(|i| row(p, g * LANES + i)));
        let factors = members.iter().map(|m| m.iter().flat_map(|&p| of_member(p)).collect()).collect();
        let scale = |m: &Vec<u32>, k: usize| {
            let squares: f64 = m.iter().map(|&p| f64::from(row(p, k)).powi(2)).sum();
            if squares > 0.0 { 1.0 / squares } else { 0.0 }
        };
        let scale = members.iter().map(|m| (0..=c).map(|k| scale(m, k)).collect()).collect();
        Self { members, factors, scale, rows: 1 + c }
    }

    /// Means and components of a view, shape (cluster, 1 + component, light, rgb).
    fn view(&self, source: &dyn BtfSource, view: usize, domain: Domain) -> Result<Vec<f32>> {
        let meta = source.meta();
        let texels = view_texels(source, view)?;
        let lights = meta.lights.len();
        let of_light = |light: usize| {
            let image = texels.part(light * meta.image_len()..(light + 1) * meta.image_len());
            let image = in_domain(&image, meta, domain);
            let of_cluster = |k: usize| self.rows_of(k, &image);
            (0..self.members.len()).flat_map(of_cluster).collect::<Vec<[f32; 3]>>()
        };
        let images: Vec<Vec<[f32; 3]>> = (0..lights).into_par_iter().map(of_light).collect();
        let rows = 0..self.members.len() * self.rows;
        Ok(rows.flat_map(|row| images.iter().flat_map(move |image| image[row])).collect())
    }

    /// Mean and components of a cluster in one image.
    fn rows_of(&self, cluster: usize, image: &[f32]) -> Vec<[f32; 3]> {
        let groups = self.rows.div_ceil(LANES);
        let mut sums = vec![[[0.0f64; LANES]; 3]; groups];
        let members = self.members[cluster].chunks(RUN);
        for (members, factors) in members.zip(self.factors[cluster].chunks(RUN * groups)) {
            let mut part = vec![[[0.0f32; LANES]; 3]; groups];
            add_products(image, members, factors, &mut part);
            for (sum, part) in sums.iter_mut().flatten().flatten().zip(part.iter().flatten().flatten()) {
                *sum += f64::from(*part);
            }
        }
        let scale = |k: usize| self.scale[cluster][k];
        let value = |k: usize, channel: usize| (sums[k / LANES][channel][k % LANES] * scale(k)) as f32;
        (0..self.rows).map(|k| std::array::from_fn(|channel| value(k, channel))).collect()
    }
}

wide! {
    /// Adds the products of texels and their factors.
    fn add_products(image: &[f32], texels: &[u32], factors: &[[f32; LANES]], sums: &mut [[[f32; LANES]; 3]]) {
        for (&texel, factors) in texels.iter().zip(factors.chunks_exact(sums.len())) {
            let Some(rgb) = image.get(3 * texel as usize..3 * texel as usize + 3) else { continue };
            for (sums, factors) in sums.iter_mut().zip(factors) {
                for channel in 0..3 {
                    for i in 0..LANES {
                        sums[channel][i] += rgb[channel] * factors[i];
                    }
                }
            }
        }
    }
}

/// The values of an image in the domain.
fn in_domain<'a>(image: &'a Texels, meta: &BtfMeta, domain: Domain) -> Cow<'a, [f32]> {
    let curve = |value: f32| domain.from_stored(meta.encoding, value);
    match image {
        Texels::U8(values) => {
            let of_byte: [f32; 256] = std::array::from_fn(|i| curve(i as f32 / 255.0));
            values.iter().map(|&v| of_byte[usize::from(v)]).collect()
        }
        Texels::F16(values) => values.iter().map(|v| curve(v.to_f32())).collect(),
        Texels::F32(values) if domain.is_stored(meta.encoding) => Cow::Borrowed(values),
        Texels::F32(values) => values.iter().map(|&v| curve(v)).collect(),
    }
}
