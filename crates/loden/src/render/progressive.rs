//! Progressive rendering: time limit, error target, checkpoints.

mod checkpoint;

use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::bvh::RAYS;
use super::camera::Rays;
use super::filter::{Pixel, tent};
use super::integrator::{self, PATHS, Paths};
use super::ray::Ray;
use super::sampler::Sampler;
use super::scene::Scene;
use super::settings::Settings;
use super::tracer::Tracer;
use crate::color::luminance;
use crate::picture::Picture;
use crate::progress::{Progress, Task};
use crate::simd::many::Many;
use crate::{Error, Result};

/// Side of a tile, in pixels; threads work on one tile at a time.
const TILE: usize = 16;

/// Minimum time between two checkpoints.
const SHORTEST: Duration = Duration::from_millis(100);

/// Minimum number of samples for an estimate of a tile's error.
const LEAST_SAMPLES: u32 = 16;

/// Stopping conditions and checkpoint.
#[derive(Debug, Clone, Default)]
pub struct Effort {
    /// Time limit. No tile is begun after it, but every pixel gets at least one sample.
    pub time_limit: Option<Duration>,
    /// Target for the relative standard error of each tile; [`Settings::spp`] is then the maximum.
    pub relative_error: Option<f32>,
    /// Checkpoint file.
    pub checkpoint: Option<Checkpoint>,
}

/// Checkpoint of an interrupted rendering.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    /// The file. If it exists, rendering continues from it. It is written at intervals and at the end.
    pub path: PathBuf,
    /// A description of everything that the picture depends on, besides size, depth and seed. A checkpoint with
    /// another description is rejected.
    pub scene: String,
    /// Maximum time between two checkpoints; they are more frequent at first.
    pub every: Duration,
}

/// A picture and its cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// Mean of the samples of each pixel.
    pub picture: Picture,
    /// Variance of the luminance of each pixel, taken for a mean of independent samples; 0 for a single one.
    pub variance: Vec<f32>,
    /// Mean number of samples per pixel, including those of the checkpoint.
    pub samples_per_pixel: f64,
    /// Samples taken in this run.
    pub samples: u64,
    /// Whether all samples were taken or the error target was reached.
    pub complete: bool,
}

/// The samples of a tile so far.
#[derive(Debug, Clone, PartialEq)]
struct Tile {
    /// Samples of each pixel.
    count: u32,
    /// Sum of the samples, row by row.
    sum: Vec<Vec3>,
    /// Sum of their squared luminances.
    square: Vec<f32>,
}

impl Tile {
    /// Standard error of a pixel divided by its value, both as root mean squares over the tile.
    fn relative_error(&self) -> f32 {
        let n = self.count as f32;
        let (mut errors, mut values) = (0.0f64, 0.0f64);
        for (sum, square) in self.sum.iter().zip(&self.square) {
            let mean = luminance(sum.to_array()) / n;
            errors += f64::from((square / n - mean * mean).max(0.0) / (n - 1.0));
            values += f64::from(mean * mean);
        }
        if errors > 0.0 { (errors / values.max(1e-12)).sqrt() as f32 } else { 0.0 }
    }
}

/// The tiles of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Grid {
    width: usize,
    height: usize,
}

impl Grid {
    fn len(self) -> usize {
        self.width.div_ceil(TILE) * self.height.div_ceil(TILE)
    }

    /// Left, top, width and height of a tile.
    fn bounds(self, tile: usize) -> [usize; 4] {
        let columns = self.width.div_ceil(TILE);
        let (left, top) = (tile % columns * TILE, tile / columns * TILE);
        [left, top, TILE.min(self.width - left), TILE.min(self.height - top)]
    }

    fn empty(self, tile: usize) -> Tile {
        let [_, _, width, height] = self.bounds(tile);
        Tile { count: 0, sum: vec![Vec3::ZERO; width * height], square: vec![0.0; width * height] }
    }
}

/// Renders a scene. The picture depends only on the scene and the settings.
///
/// # Errors
/// [`Error::Parameter`] for invalid settings or camera, or naming a material whose value is not finite; errors of
/// [`crate::material::Material::check`]; [`Error::Cancelled`].
pub fn render(scene: &Scene, settings: &Settings, progress: &dyn Progress) -> Result<Picture> {
    Ok(render_in_steps(scene, settings, &Effort::default(), progress)?.picture)
}

/// Renders a scene like [`render`], in steps.
///
/// # Model
/// The picture depends only on the samples of each pixel, and these only on the scene and the settings: interrupting
/// and continuing gives the same picture. The error of a tile of 16 x 16 pixels is estimated when it has 16, 32, 64,
/// ... samples.
///
/// # Limits
/// The error is estimated as for independent samples; stratified samples are better. Stopping by error darkens a tile
/// slightly on average.
///
/// # Errors
/// As [`super::render`]; errors of reading and writing the checkpoint, and [`Error::Invalid`] if it belongs to
/// another scene. After [`Error::Cancelled`] the checkpoint holds the finished samples.
pub fn render_in_steps(
    scene: &Scene,
    settings: &Settings,
    effort: &Effort,
    progress: &dyn Progress,
) -> Result<Rendered> {
    // Check the parameters
    settings.check()?;
    scene.bodies.iter().try_for_each(|body| body.texture.check())?;
    if let Some(error) = effort.relative_error.filter(|e| !(1e-6..=10.0).contains(e)) {
        return Err(Error::parameter("relative error", format!("found {error}, expected 0.000001 to 10")));
    }
    // Resume from the checkpoint
    let grid = Grid { width: settings.width, height: settings.height };
    let rays = scene.camera.prepare(settings.width, settings.height)?;
    let tiles = match &effort.checkpoint {
        Some(checkpoint) => checkpoint.read(grid, settings)?,
        None => None,
    };
    let tiles = tiles.unwrap_or_else(|| (0..grid.len()).map(|tile| grid.empty(tile)).collect());
    let before: u64 = tiles.iter().map(samples).sum();
    // Render the tiles
    let tracer = Tracer::new(scene);
    tracer.build_samplers()?;
    let work = Work {
        tracer: &tracer,
        rays: &rays,
        settings,
        effort,
        grid,
        tiles: tiles.into_iter().map(Mutex::new).collect(),
        start: Instant::now(),
    };
    work.run(progress)?;
    // Assemble the picture
    let tiles: Vec<Tile> =
        work.tiles.into_iter().map(|tile| tile.into_inner().unwrap_or_else(PoisonError::into_inner)).collect();
    let after: u64 = tiles.iter().map(samples).sum();
    Ok(Rendered {
        picture: assemble(grid, &tiles),
        variance: variance(grid, &tiles),
        samples_per_pixel: after as f64 / (grid.width * grid.height) as f64,
        samples: after - before,
        complete: tiles.iter().all(|tile| next_stop(tile, settings, effort).is_none()),
    })
}

fn samples(tile: &Tile) -> u64 {
    u64::from(tile.count) * tile.sum.len() as u64
}

/// The number of samples after which a tile is examined next; `None` if it is done.
fn next_stop(tile: &Tile, settings: &Settings, effort: &Effort) -> Option<u32> {
    if tile.count >= settings.spp {
        return None;
    }
    let Some(target) = effort.relative_error else { return Some(settings.spp) };
    if tile.count >= LEAST_SAMPLES && tile.count.is_power_of_two() && tile.relative_error() <= target {
        return None;
    }
    Some((tile.count + 1).next_power_of_two().max(LEAST_SAMPLES).min(settings.spp))
}

fn assemble(grid: Grid, tiles: &[Tile]) -> Picture {
    let mut picture = Picture::filled(grid.width, grid.height, Vec3::ZERO);
    for (index, tile) in tiles.iter().enumerate() {
        let [left, top, width, _] = grid.bounds(index);
        for (row, line) in tile.sum.chunks_exact(width).enumerate() {
            let out = &mut picture.rgb[(top + row) * grid.width + left..][..width];
            out.iter_mut().zip(line).for_each(|(out, sum)| *out = *sum / tile.count.max(1) as f32);
        }
    }
    picture
}

fn variance(grid: Grid, tiles: &[Tile]) -> Vec<f32> {
    let mut variance = vec![0.0; grid.width * grid.height];
    for (index, tile) in tiles.iter().enumerate() {
        let ([left, top, width, _], n) = (grid.bounds(index), tile.count as f32);
        for (k, (sum, square)) in tile.sum.iter().zip(&tile.square).enumerate() {
            let mean = luminance(sum.to_array()) / n.max(1.0);
            let at = (top + k / width) * grid.width + left + k % width;
            variance[at] = (square / n.max(1.0) - mean * mean).max(0.0) / (n - 1.0).max(1.0);
        }
    }
    variance
}

/// A picture in progress.
struct Work<'a> {
    tracer: &'a Tracer<'a>,
    rays: &'a Rays,
    settings: &'a Settings,
    effort: &'a Effort,
    grid: Grid,
    tiles: Vec<Mutex<Tile>>,
    start: Instant,
}

impl Work<'_> {
    /// Passes over the tiles until all are done or time is up.
    fn run(&self, progress: &dyn Progress) -> Result<()> {
        let per_tile = u64::from(self.settings.spp);
        let task = Task::new(progress, "render", self.grid.len() as u64 * per_tile);
        let mut written = Instant::now();
        // One pass is enough if there is no reason to stop in between
        let (mut step, stepwise) = (1, self.effort.time_limit.is_some() || self.effort.checkpoint.is_some());
        loop {
            let begun = Instant::now();
            let done = self.pass(if stepwise { step } else { u32::MAX }, &task);
            let complete = match &done {
                Ok(finished) => *finished || (self.is_late() && self.has_all_pixels()),
                Err(_) => true,
            };
            if let Some(checkpoint) = &self.effort.checkpoint
                && (complete || written.elapsed() >= checkpoint.every.min(self.start.elapsed() / 4).max(SHORTEST))
            {
                checkpoint.write(self.grid, self.settings, self.tiles.iter().map(|tile| lock(tile)))?;
                written = Instant::now();
            }
            if complete {
                return done.map(drop);
            }
            // Passes of a few seconds: an interruption loses at most one
            if begun.elapsed() < Duration::from_secs(2) {
                step = step.saturating_mul(2);
            }
        }
    }

    fn is_late(&self) -> bool {
        self.effort.time_limit.is_some_and(|limit| self.start.elapsed() >= limit)
    }

    fn has_all_pixels(&self) -> bool {
        self.tiles.iter().all(|tile| lock(tile).count > 0)
    }

    /// Adds up to `step` samples to every tile that needs them. Returns whether all tiles are done.
    fn pass(&self, step: u32, task: &Task) -> Result<bool> {
        let advance = |paths: &mut Paths, (index, place): (usize, &Mutex<Tile>)| {
            let old = lock(place).clone();
            let Some(stop) = next_stop(&old, self.settings, self.effort) else { return Ok(true) };
            if old.count > 0 && self.is_late() {
                return Ok(false);
            }
            let before = old.count;
            let tile = self.traced(paths, index, old, stop.min(before.saturating_add(step)))?;
            self.tracer.check_materials()?;
            let added = tile.count - before;
            let finished = next_stop(&tile, self.settings, self.effort).is_none();
            *lock(place) = tile;
            task.advance(added.into())?;
            Ok(finished)
        };
        // one state for many tiles, as fresh memory is slow
        let paths = || Paths::new(self.tracer, self.settings.depth);
        let tiles = self.tiles.par_iter().enumerate();
        let finished: Vec<bool> = tiles.map_init(paths, advance).collect::<Result<_>>()?;
        Ok(finished.into_iter().all(|finished| finished))
    }

    /// Traces samples of a tile until it has `count`.
    fn traced(&self, paths: &mut Paths, index: usize, tile: Tile, count: u32) -> Result<Tile> {
        #[cfg(target_arch = "x86_64")]
        if crate::simd::has_avx512() {
            // SAFETY: the processor has AVX-512.
            return unsafe { self.traced_by_avx512(paths, index, tile, count) };
        } else if crate::simd::has_avx2() {
            // SAFETY: the processor has AVX2.
            return unsafe { self.traced_by_avx2(paths, index, tile, count) };
        }
        self.traced_by_any(paths, index, tile, count)
    }

    /// Compiled for AVX-512; gives the same bits, since nothing is contracted.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn traced_by_avx512(&self, paths: &mut Paths, index: usize, tile: Tile, count: u32) -> Result<Tile> {
        self.traced_by_any(paths, index, tile, count)
    }

    /// Compiled for AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn traced_by_avx2(&self, paths: &mut Paths, index: usize, tile: Tile, count: u32) -> Result<Tile> {
        self.traced_by_any(paths, index, tile, count)
    }

    #[inline(always)]
    fn traced_by_any(&self, paths: &mut Paths, index: usize, mut tile: Tile, count: u32) -> Result<Tile> {
        let [left, top, width, height] = self.grid.bounds(index);
        // Order pixels along a curve, so that paths traced together are close
        let mut pixels: Vec<[usize; 2]> = (0..width * height).map(|k| [k % width, k / width]).collect();
        pixels.sort_by_key(|&[x, y]| morton(x, y));
        let mut values = vec![Vec3::ZERO; PATHS];
        let (first, each) = (tile.count, (count - tile.count) as usize);
        for from in (0..pixels.len() * each).step_by(PATHS) {
            let values = &mut values[..PATHS.min(pixels.len() * each - from)];
            let samples = Samples { work: self, corner: [left, top], pixels: &pixels, first, each, from };
            paths.radiance(&samples, values)?;
            for (k, value) in (from..).zip(values) {
                let [x, y] = pixels[k / each];
                let luminance = luminance(value.to_array());
                tile.sum[y * width + x] += *value;
                tile.square[y * width + x] += luminance * luminance;
            }
        }
        tile.count = count;
        Ok(tile)
    }
}

/// Samples of pixels of a tile, pixel by pixel.
struct Samples<'a> {
    work: &'a Work<'a>,
    /// Left and top of the tile.
    corner: [usize; 2],
    pixels: &'a [[usize; 2]],
    /// The first sample of each pixel, and how many there are of each.
    first: u32,
    each: usize,
    /// Number of samples before these.
    from: usize,
}

impl Samples<'_> {
    /// Column, row and number of a sample.
    #[inline(always)]
    fn number(&self, place: usize) -> [u32; 3] {
        let k = self.from + place;
        let ([left, top], [x, y]) = (self.corner, self.pixels[k / self.each]);
        [(left + x) as u32, (top + y) as u32, self.first + (k % self.each) as u32]
    }

    /// Centre of the pixel, offset of a sample from it, and the sampler after the numbers used. Importance-samples a
    /// tent filter that extends one pixel to each side.
    #[inline(always)]
    fn point(&self, [x, y, number]: [u32; 3]) -> (Vec2, Vec2, Sampler) {
        let mut sampler = Sampler::new(self.work.settings.seed, x, y, number);
        (Vec2::new(x as f32 + 0.5, y as f32 + 0.5), tent(sampler.next_2d()), sampler)
    }
}

impl integrator::Camera for Samples<'_> {
    #[inline(always)]
    fn start(&self, places: Range<usize>, rays: &mut Many<Ray, 6>, samplers: &mut Many<Sampler, 3>) {
        let (mut numbers, mut points) = (Many::<[u32; 3], 3>::ZERO, Many::<Vec2, 2>::ZERO);
        let mut lens = Many::<Vec2, 2>::ZERO;
        for (lane, place) in places.enumerate() {
            numbers.set(lane, self.number(place));
        }
        for lane in 0..RAYS {
            let (middle, offset, sampler) = self.point(numbers.get(lane));
            points.set(lane, middle + offset);
            samplers.set(lane, sampler);
        }
        if self.work.rays.has_lens() {
            for lane in 0..RAYS {
                let mut sampler = samplers.get(lane);
                lens.set(lane, sampler.next_2d());
                samplers.set(lane, sampler);
            }
        }
        for lane in 0..RAYS {
            rays.set(lane, self.work.rays.through(points.get(lane), lens.get(lane)));
        }
    }

    fn pixel(&self, place: usize) -> Pixel<'_> {
        let rays = self.work.rays;
        let (middle, offset, mut sampler) = self.point(self.number(place));
        Pixel { rays, middle, offset, lens: if rays.has_lens() { sampler.next_2d() } else { Vec2::ZERO } }
    }
}

/// The index of a pixel on the Z-order curve.
fn morton(x: usize, y: usize) -> usize {
    (0..TILE.ilog2()).fold(0, |sum, bit| sum | (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1))
}

/// Tiles are replaced as a whole, so that a tile is valid even after a panic elsewhere.
fn lock(tile: &Mutex<Tile>) -> MutexGuard<'_, Tile> {
    tile.lock().unwrap_or_else(PoisonError::into_inner)
}
