//! Importance sampling of BTFs: histograms over light directions for each sampled view and cluster of texels.

use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::sync::OnceLock;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::angles::Angles;
use super::sampler::{below_pole, height};
use super::texels::TexelPoint;
use super::{Bounce, Failure};
use crate::Result;
use crate::btf::BtfMeta;
use crate::direction::{Stencil, cosine_hemisphere, from_angles, phi};
use crate::factor::kmeans::{Points, Start, kmeans};
use crate::simd::many::{LANES, Many};
use crate::simd::{prefetch, wide};

/// Rings of light directions, equally wide in polar angle.
const RINGS: usize = 18;
/// Sectors of each ring.
const SECTORS: usize = 36;
const CELLS: usize = RINGS * SECTORS;
/// Clusters of texels.
const CLUSTERS: usize = 32;
/// Texels of a cluster that are averaged into its histograms.
const MEMBERS: usize = 16;
/// Maximum number of texels along a side that are clustered; beyond it, neighbours share a cluster.
const SIDE: usize = 256;
/// Number of lights, and angles of the views, at which texels are compared.
const COMPARED_LIGHTS: usize = 16;
const COMPARED_VIEWS: [[f32; 2]; 3] = [[0.0, 0.0], [50.0, 0.0], [50.0, 180.0]];
const ITERATIONS: usize = 8;
/// Fraction of directions drawn from the cosine distribution, since single texels differ from their cluster.
const COSINE_SHARE: f32 = 0.1;

/// Luminances of apparent values at sampled pairs of one view, (light, texel), for the indices of the view, the lights
/// and the texels.
pub(crate) type Values<'a> = dyn Fn(usize, &[usize], &[usize]) -> Result<Vec<f32>> + Sync + 'a;

/// Draws light directions for a texel and a viewer.
///
/// # Model
/// Texels are clustered by the shape of their ABRDFs (square root of luminance over its mean, at some pairs). For each
/// cluster and sampled view a histogram over light directions, constant per solid angle in each cell, holds the mean
/// apparent value of some of the texels. The density is the mean of the histograms of the views around the viewer, with
/// the material's own interpolation weights, mixed with a cosine.
///
/// # Limits
/// Cells are 5 by 10 degrees. Highlights that are much narrower than the spacing of measured directions do not exist
/// in a BTF.
#[derive(Debug, Default)]
pub(crate) struct BtfSampler(OnceLock<Lobes>);

#[derive(Debug)]
pub(crate) struct Lobes {
    columns: usize,
    rows: usize,
    views: usize,
    /// Cluster of each texel, or of each square of texels.
    index: Vec<u8>,
    /// Cumulative probability of the cells: (cluster, view, cell).
    cumulated: Vec<f32>,
    /// Cumulative probability of the rings: (cluster, view).
    rings: Vec<[f32; RINGS]>,
    /// Cosine at the lower edge of each ring.
    cosines: [f32; RINGS],
    /// 1 - cos at the edges of the rings.
    heights: [f32; RINGS + 1],
    /// Reciprocal solid angle of a cell of each ring.
    per_solid_angle: [f32; RINGS],
}

impl BtfSampler {
    /// The lobes, built by the first call, which reads some pairs of all texels and all pairs of some texels. `None`
    /// after a failure, which is kept.
    pub(crate) fn lobes(&self, failure: &Failure, build: impl FnOnce() -> Result<Lobes>) -> Option<&Lobes> {
        if self.0.get().is_none() {
            failure.check().ok()?;
            // not inside the lock: a thread waiting for others may steal work that also draws
            let _ = self.0.set(failure.ok(build())?);
        }
        self.0.get()
    }
}

impl Lobes {
    /// Draws a direction for each of `bounces`; leaves their values unchanged.
    pub(crate) fn sample_many(&self, points: &[&TexelPoint], random: &[Vec2], bounces: &mut [Bounce]) {
        for ((points, random), bounces) in points.chunks(LANES).zip(random.chunks(LANES)).zip(bounces.chunks_mut(LANES))
        {
            draw(self, points, random, bounces);
        }
    }

    /// The density of a direction, 1/sr.
    pub(crate) fn pdf(&self, point: &TexelPoint, wi: Vec3) -> f32 {
        if wi.z > 0.0 && point.wo.z > 0.0 {
            self.density(point, self.cluster(point.uv), wi, self.cell(wi))
        } else {
            0.0
        }
    }

    /// # Errors
    /// Errors of `values`.
    pub(crate) fn new(meta: &BtfMeta, angles: &Angles, values: &Values) -> Result<Self> {
        let (columns, rows) = (meta.width.min(SIDE), meta.height.min(SIDE));
        // Cluster the texels
        let texels: Vec<usize> = (0..columns * rows)
            .map(|i| {
                let (x, y) = (i % columns, i / columns);
                (2 * y + 1) * meta.height / (2 * rows) * meta.width + (2 * x + 1) * meta.width / (2 * columns)
            })
            .collect();
        let index = clusters(meta, &texels, values)?;
        let mut members = vec![Vec::new(); 1 + index.iter().copied().max().unwrap_or(0) as usize];
        for (&cluster, &texel) in index.iter().zip(&texels) {
            members[cluster as usize].push(texel);
        }
        // Choose the texels that represent each cluster
        for members in &mut members {
            let (n, k) = (members.len(), members.len().min(MEMBERS));
            *members = (0..k).map(|i| members[(2 * i + 1) * n / (2 * k)]).collect();
        }
        // Build the histograms, view by view
        let views = meta.views.len();
        let around: Vec<Stencil> = (0..CELLS).map(|cell| angles.lights_around(middle(cell))).collect();
        let tables: Vec<Vec<f32>> = (0..views)
            .into_par_iter()
            .map(|view| histograms(meta, &around, view, &members, values))
            .collect::<Result<_>>()?;
        // Rearrange them by cluster
        let mut cumulated = Vec::with_capacity(members.len() * views * CELLS);
        for cluster in 0..members.len() {
            tables.iter().for_each(|table| cumulated.extend(&table[cluster * CELLS..][..CELLS]));
        }
        let last_of_rings = |histogram: &[f32]| std::array::from_fn(|ring| histogram[(ring + 1) * SECTORS - 1]);
        Ok(Self {
            columns,
            rows,
            views,
            index: index.into_iter().map(|k| k as u8).collect(),
            rings: cumulated.chunks_exact(CELLS).map(last_of_rings).collect(),
            cumulated,
            cosines: std::array::from_fn(|ring| edge(ring + 1).cos()),
            heights: std::array::from_fn(|ring| height(edge(ring))),
            per_solid_angle: std::array::from_fn(|ring| 1.0 / solid_angle(ring)),
        })
    }

    /// Columns and rows of the clusters' index, the index, row by row from the top, and the cumulative probabilities of the
    /// cells: (cluster, view, ring x sector).
    pub(crate) fn tables(&self) -> ([usize; 2], &[u8], &[f32]) {
        ([self.columns, self.rows], &self.index, &self.cumulated)
    }

    fn histogram(&self, cluster: usize, view: usize) -> &[f32] {
        &self.cumulated[(cluster * self.views + view) * CELLS..][..CELLS]
    }

    fn cluster(&self, uv: Vec2) -> usize {
        let place = |u: f32, size: usize| (((u - u.floor()) * size as f32) as usize).min(size - 1);
        let (x, y) = (place(uv.x, self.columns), place(1.0 - uv.y, self.rows));
        usize::from(self.index[y * self.columns + x])
    }

    /// Chooses one of the views around the viewer by weight. Returns its histogram, and the remaining random number.
    #[inline(always)]
    fn choose(&self, point: &TexelPoint, cluster: usize, mut x: f32) -> (usize, f32) {
        let mut view = 0;
        for (index, weight) in point.view.iter().filter(|s| s.1 > 0.0) {
            view = index;
            if x < weight {
                x /= weight;
                break;
            }
            x -= weight;
        }
        (cluster * self.views + view, x)
    }

    /// The ring of a direction.
    #[inline(always)]
    fn ring(&self, wi: Vec3) -> usize {
        self.cosines.iter().filter(|&&c| wi.z < c).count().min(RINGS - 1)
    }

    /// The cell of a direction.
    #[inline]
    fn cell(&self, wi: Vec3) -> usize {
        self.ring(wi) * SECTORS + sector(wi) as usize
    }

    /// The density of a direction in a cell, combining histograms and cosine.
    #[inline(always)]
    fn density(&self, point: &TexelPoint, cluster: usize, wi: Vec3, cell: usize) -> f32 {
        let mut mean = 0.0;
        for (view, weight) in point.view.iter() {
            let histogram = self.histogram(cluster, view);
            mean += weight * (histogram[cell] - if cell > 0 { histogram[cell - 1] } else { 0.0 });
        }
        COSINE_SHARE * wi.z / PI + (1.0 - COSINE_SHARE) * mean * self.per_solid_angle[cell / SECTORS]
    }
}

wide! {
    /// Draws directions for at most [`LANES`] points. All points take each step together, so that memory prefetched for
    /// one arrives while the others are computed.
    fn draw(lobes: &Lobes, points: &[&TexelPoint], random: &[Vec2], bounces: &mut [Bounce]) {
        let count = bounces.len().min(LANES);
        // Choose the histograms
        let (mut clusters, mut histograms, mut numbers) = ([0; LANES], [0; LANES], [0.0; LANES]);
        for k in 0..count {
            clusters[k] = lobes.cluster(points[k].uv);
        }
        for k in 0..count {
            let x = (random[k].x - COSINE_SHARE) / (1.0 - COSINE_SHARE);
            (histograms[k], numbers[k]) = lobes.choose(points[k], clusters[k], x);
            prefetch(&lobes.rings, histograms[k]);
        }
        // Draw rings; of a histogram that is not in the cache few lines are read
        let mut rings = [0; LANES];
        for k in 0..count {
            rings[k] = lobes.rings[histograms[k]].iter().filter(|&&c| c <= numbers[k]).count().min(RINGS - 1);
            let first = histograms[k] * CELLS + rings[k] * SECTORS;
            [0, 16, 32, SECTORS - 1].iter().for_each(|line| prefetch(&lobes.cumulated, first + line));
        }
        // Draw sectors, and places in the cells
        let mut places = Many::<Vec2, 2>::ZERO;
        for k in 0..count {
            let (ring, x) = (rings[k], numbers[k]);
            let sectors = &lobes.cumulated[histograms[k] * CELLS + ring * SECTORS..][..SECTORS];
            let sector = sectors.iter().filter(|&&c| c <= x).count().min(SECTORS - 1);
            let before = if ring > 0 { lobes.rings[histograms[k]][ring - 1] } else { 0.0 };
            let (low, high) = (if sector > 0 { sectors[sector - 1] } else { before }, sectors[sector]);
            let within = if high > low { ((x - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 };
            let [top, bottom] = [lobes.heights[ring], lobes.heights[ring + 1]];
            let turns = (sector as f32 + random[k].y) / SECTORS as f32;
            places.set(k, Vec2::new(top + within * (bottom - top), turns));
        }
        // Turn places into directions
        let (mut drawn, mut sectors) = (Many::<Vec3, 3>::ZERO, Many::<f32, 1>::ZERO);
        for k in 0..LANES {
            let place = places.get(k);
            drawn.set(k, below_pole(place.x, place.y));
        }
        for (k, random) in random.iter().enumerate().take(count).filter(|(_, random)| random.x < COSINE_SHARE) {
            drawn.set(k, cosine_hemisphere(Vec2::new(random.x / COSINE_SHARE, random.y)));
        }
        for k in 0..LANES {
            sectors.set(k, sector(drawn.get(k)));
        }
        // Compute the densities; at the edge of a cell a direction may be found in its neighbour
        let mut cells = [0; LANES];
        for k in 0..count {
            cells[k] = lobes.ring(drawn.get(k)) * SECTORS + sectors.get(k) as usize;
            points[k].view.iter().for_each(|(view, _)| prefetch(lobes.histogram(clusters[k], view), cells[k]));
        }
        for k in 0..count {
            let wi = drawn.get(k);
            let is_above = wi.z > 0.0 && points[k].wo.z > 0.0;
            let pdf = if is_above { lobes.density(points[k], clusters[k], wi, cells[k]) } else { 0.0 };
            (bounces[k].wi, bounces[k].pdf) = (wi, pdf);
        }
    }
}

/// The sector of a direction.
#[inline(always)]
fn sector(wi: Vec3) -> f32 {
    (phi(wi) / TAU * SECTORS as f32).min(SECTORS as f32 - 1.0)
}

/// The polar angle at the upper edge of a ring.
fn edge(ring: usize) -> f32 {
    ring as f32 / RINGS as f32 * FRAC_PI_2
}

/// The solid angle of a cell.
fn solid_angle(ring: usize) -> f32 {
    let (low, high) = (edge(ring), edge(ring + 1));
    TAU / SECTORS as f32 * (low.cos() - high.cos())
}

/// The cluster of each of `texels`.
fn clusters(meta: &BtfMeta, texels: &[usize], values: &Values) -> Result<Vec<u32>> {
    let step = meta.lights.len().div_ceil(COMPARED_LIGHTS);
    let lights: Vec<usize> = (0..meta.lights.len()).step_by(step).collect();
    let nearest = |[theta, phi]: [f32; 2]| {
        let w = from_angles(theta.to_radians(), phi.to_radians());
        let views = meta.views.directions().iter().enumerate();
        views.max_by(|a, b| a.1.dot(w).total_cmp(&b.1.dot(w))).map_or(0, |(view, _)| view)
    };
    let parts: Vec<Vec<f32>> =
        COMPARED_VIEWS.into_par_iter().map(|view| values(nearest(view), &lights, texels)).collect::<Result<_>>()?;
    let dimensions = lights.len() * parts.len();
    let mut shapes = vec![0.0; texels.len() * dimensions];
    for (texel, shape) in shapes.chunks_exact_mut(dimensions).enumerate() {
        let of_texel = parts.iter().flat_map(|part| part.iter().skip(texel).step_by(texels.len()));
        shape.iter_mut().zip(of_texel).for_each(|(shape, v)| *shape = if v.is_finite() { v.max(0.0) } else { 0.0 });
        let mean = shape.iter().sum::<f32>() / dimensions as f32;
        shape.iter_mut().for_each(|v| *v = (*v / mean.max(1e-9)).sqrt());
    }
    Ok(kmeans(&Points::new(&shapes, dimensions), CLUSTERS, Start::Regular, ITERATIONS, &|| Ok(()))?.index)
}

/// Cumulative probabilities of light directions seen from `view`: (cluster, cell).
fn histograms(
    meta: &BtfMeta,
    around: &[Stencil],
    view: usize,
    members: &[Vec<usize>],
    values: &Values,
) -> Result<Vec<f32>> {
    let lights: Vec<usize> = (0..meta.lights.len()).collect();
    let texels: Vec<usize> = members.concat();
    let found = values(view, &lights, &texels)?;
    let mut cumulated = Vec::with_capacity(members.len() * CELLS);
    let mut first = 0;
    for members in members {
        let mean = |light: usize| {
            let of_cluster = &found[light * texels.len() + first..][..members.len()];
            of_cluster.iter().filter(|v| v.is_finite()).map(|v| v.max(0.0)).sum::<f32>()
        };
        let means: Vec<f32> = lights.iter().map(|&light| mean(light)).collect();
        cumulated.extend(cumulate(around, &means));
        first += members.len();
    }
    Ok(cumulated)
}

/// The direction at the centre of a cell.
fn middle(cell: usize) -> Vec3 {
    let (ring, sector) = (cell / SECTORS, cell % SECTORS);
    from_angles(0.5 * (edge(ring) + edge(ring + 1)), (sector as f32 + 0.5) / SECTORS as f32 * TAU)
}

/// Cumulative probabilities of the cells, from a value for each sampled light and the lights around the centre of each
/// cell. If all values are 0, those of the cosine distribution.
fn cumulate(around: &[Stencil], values: &[f32]) -> [f32; CELLS] {
    let value = |cell: usize| {
        let stencil = &around[cell];
        stencil.fade * stencil.iter().map(|(light, weight)| weight * values[light]).sum::<f32>()
    };
    let mut mass: [f32; CELLS] = std::array::from_fn(|cell| value(cell) * solid_angle(cell / SECTORS));
    let mut total: f32 = mass.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        mass = std::array::from_fn(|cell| middle(cell).z * solid_angle(cell / SECTORS));
        total = mass.iter().sum();
    }
    let mut sum = 0.0f64;
    let mut cumulated = mass.map(|m| {
        sum += f64::from(m / total);
        sum.min(1.0) as f32
    });
    // Close the gap that rounding leaves at the end
    let last = mass.iter().rposition(|&m| m > 0.0).unwrap_or(0);
    cumulated[last..].fill(1.0);
    cumulated
}
