//! The simulated measurement: path tracing of every texel for every pair of directions.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::random::Spread;
use super::reflect::{LANES, Lights};
use super::relief::Relief;
use super::solid::Tile;
use super::specimen::{Geometry, Specimen};
use crate::btf::{BtfMeta, Cosine, MemoryBtf, SampleType, Texels};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::params::Params;
use crate::progress::{Progress, Task};
use crate::random::{Stream, hash};
use crate::{Error, Result};

/// Smallest accepted cosine of a direction: cos(89 degrees).
const MIN_COSINE: f32 = 0.0174;

/// Number of reflections after which paths are terminated by Russian roulette.
const ROULETTE_AFTER: u32 = 4;

crate::params! {
    /// How a sample is measured.
    #[derive(Copy, Eq)]
    pub struct Options {
        /// Texels per side of every image.
        pub size: usize [1..=4096, "texels"] = 64,
        /// Paths per texel and view; each path serves all lights.
        pub spp: u32 [1..=65_536] = 32,
        /// Longest path: reflections between light and viewer; 1 is direct light alone.
        pub depth: u32 [1..=1000] = 4,
        /// Seed of the random numbers; the same seed gives the same images.
        pub seed: u64 [0..=i64::MAX] = 0,
    }
}

/// Measures a sample for every pair of directions and passes the images to `sink`, view by view in order: the index of
/// the view, and linear apparent values rho = pi L_out / E_perp of shape (light, y, x, rgb).
///
/// # Model
/// The camera is orthographic. Its pixels are the texels of the rectified sample: squares in the plane at the mean
/// height that cover one period, row 0 at the top. Parts above that plane are displaced along the view direction, as on
/// a rectified photograph. Through holes nothing is seen, which is black. Paths start at the camera. At each vertex, the light from all directions in `lights` is
/// added, with a shadow ray each, and one direction is sampled to continue the path. So one path serves all lights;
/// every image is unbiased, and the noise of the images of one view is correlated. The random numbers of a path depend
/// only on seed, view, texel and sample.
///
/// # Limits
/// There is no translucency.
///
/// # Errors
/// [`Error::Parameter`] for a direction more than 89 degrees from the normal or an option out of range;
/// [`Error::Cancelled`]; errors of `sink`.
///
/// # References
/// kajiya1986
pub fn acquire<'a>(
    sample: impl Into<Specimen<'a>>,
    views: &DirectionSet,
    lights: &DirectionSet,
    options: &Options,
    progress: &dyn Progress,
    sink: &mut dyn FnMut(usize, Vec<f32>) -> Result<()>,
) -> Result<()> {
    check(views, lights, options)?;
    let task = Task::new(progress, "acquire", (views.len() * options.size) as u64);
    let mut all = |rig: &dyn Measuring| {
        let mut views = views.directions().iter().enumerate();
        views.try_for_each(|(v, &wo)| sink(v, rig.rectified(v, wo, &task)?))
    };
    match sample.into() {
        Specimen::Field(field) => all(&Rig::new(Relief::new(field, lights), lights, *options)),
        Specimen::Solid(solid) => all(&Rig::new(Tile::new(solid, lights), lights, *options)),
    }
}

/// Measures what fraction of each texel the sample covers, for every view: images of shape (y, x, rgb) with values from 0
/// (a hole) to 1, passed to `sink` view by view. The same paths are followed as in [`acquire`], so values divided by this
/// are those of the sample without its holes.
///
/// # Errors
/// As [`acquire`].
pub fn coverage<'a>(
    sample: impl Into<Specimen<'a>>,
    views: &DirectionSet,
    options: &Options,
    progress: &dyn Progress,
    sink: &mut dyn FnMut(usize, Vec<f32>) -> Result<()>,
) -> Result<()> {
    let lights = DirectionSet::from_degrees(vec![[0.0, 0.0]])?;
    check(views, &lights, options)?;
    let task = Task::new(progress, "coverage", views.len() as u64);
    let mut all = |rig: &dyn Measuring| {
        let mut views = views.directions().iter().enumerate();
        views.try_for_each(|(v, &wo)| sink(v, rig.covered(v, wo, &task)?))
    };
    match sample.into() {
        Specimen::Field(field) => all(&Rig::new(Relief::new(field, &lights), &lights, *options)),
        Specimen::Solid(solid) => all(&Rig::new(Tile::new(solid, &lights), &lights, *options)),
    }
}

/// Measures a sample for every pair of `directions` and keeps the images in memory.
///
/// # Errors
/// As [`acquire`].
pub fn measure<'a>(
    sample: impl Into<Specimen<'a>>,
    directions: &DirectionSet,
    options: &Options,
    progress: &dyn Progress,
) -> Result<MemoryBtf> {
    let meta = BtfMeta {
        width: options.size,
        height: options.size,
        views: directions.clone(),
        lights: directions.clone(),
        encoding: Encoding::Linear,
        cosine: Cosine::Included,
        sample_type: SampleType::F32,
    };
    let mut texels = Vec::new();
    acquire(sample, directions, directions, options, progress, &mut |_, view| {
        texels.extend(view);
        Ok(())
    })?;
    MemoryBtf::new(meta, Texels::F32(texels.into()))
}

/// A camera above the plane at the mean height of the sample.
pub(super) trait Camera: Sync {
    /// Width and height in pixels.
    fn size(&self) -> [usize; 2];

    /// The point of the plane, in the units of the sample, that is seen at `offset` within a pixel (0..1, y upwards),
    /// and the unit vector from there to the camera. Pixels are (column, row from the top).
    fn look(&self, pixel: [usize; 2], offset: Vec2) -> (Vec2, Vec3);

    /// The albedo of an object that covers the sample at a point of the plane, if there is one. It is flat and
    /// unshadowed.
    fn cover(&self, _at: Vec2) -> Option<f32> {
        None
    }

    /// Number of paths for a pixel, where `spp` are enough for the sample itself.
    fn paths(&self, _pixel: [usize; 2], spp: u32) -> u32 {
        spp
    }
}

/// An orthographic camera whose pixels are the texels of the rectified sample.
struct Orthographic {
    size: usize,
    /// Units per texel.
    scale: f32,
    wo: Vec3,
}

impl Camera for Orthographic {
    fn size(&self) -> [usize; 2] {
        [self.size; 2]
    }

    #[inline(always)]
    fn look(&self, pixel: [usize; 2], offset: Vec2) -> (Vec2, Vec3) {
        let corner = Vec2::new(pixel[0] as f32, (self.size - 1 - pixel[1]) as f32);
        ((corner + offset) * self.scale, self.wo)
    }
}

pub(super) fn check(views: &DirectionSet, lights: &DirectionSet, options: &Options) -> Result<()> {
    for (name, set) in [("views", views), ("lights", lights)] {
        if let Some(w) = set.directions().iter().find(|w| w.z < MIN_COSINE) {
            let theta = crate::direction::theta(*w).to_degrees();
            return Err(Error::parameter(name, format!("found a polar angle of {theta} degrees, expected at most 89")));
        }
    }
    options.check()
}

/// The sample, the lights and everything derived from them: constant during a measurement.
pub(super) struct Rig<G> {
    geometry: G,
    options: Options,
    lights: Lights,
    /// Number of lights, without padding.
    count: usize,
    wide: bool,
}

/// What [`Rig`] does for a sample of any kind.
trait Measuring {
    /// The images of one view of the rectified sample: (light, y, x, rgb).
    fn rectified(&self, view: usize, wo: Vec3, task: &Task) -> Result<Vec<f32>>;

    /// The fraction of each texel that the sample covers in one view: (y, x, rgb).
    fn covered(&self, view: usize, wo: Vec3, task: &Task) -> Result<Vec<f32>>;
}

impl<G: Geometry> Measuring for Rig<G> {
    fn rectified(&self, view: usize, wo: Vec3, task: &Task) -> Result<Vec<f32>> {
        self.view(view, &self.orthographic(wo), task)
    }

    fn covered(&self, view: usize, wo: Vec3, task: &Task) -> Result<Vec<f32>> {
        let (camera, size) = (self.orthographic(wo), self.options.size);
        let texel = |k: usize| {
            let spread = Spread::new(self.seed(view, k));
            let seen = (0..self.options.spp).filter(|&sample| {
                let (at, wo) = camera.look([k % size, k / size], spread.point(sample).0);
                self.geometry.seen(at, wo).is_some()
            });
            seen.count() as f32 / self.options.spp as f32
        };
        let image = (0..size * size).into_par_iter().map(texel).flat_map_iter(|covered| [covered; 3]).collect();
        task.advance(1)?;
        Ok(image)
    }
}

impl<G: Geometry> Rig<G> {
    pub(super) fn new(geometry: G, lights: &DirectionSet, options: Options) -> Self {
        let directions = lights.directions();
        let padded = directions.len().next_multiple_of(LANES);
        // padding lights are below every surface
        let axis = |k: usize| (0..padded).map(|l| directions.get(l).unwrap_or(&Vec3::NEG_Z)[k]).collect();
        let lights = Lights { x: axis(0), y: axis(1), z: axis(2) };
        Self { geometry, options, lights, count: directions.len(), wide: wide() }
    }

    /// The side of the tile, in the units of the sample.
    pub(super) fn side(&self) -> f32 {
        self.geometry.side()
    }

    fn orthographic(&self, wo: Vec3) -> Orthographic {
        Orthographic { size: self.options.size, scale: self.side() / self.options.size as f32, wo }
    }

    /// The seed of a pixel in a view.
    fn seed(&self, view: usize, pixel: usize) -> u64 {
        hash(&[self.options.seed, view as u64, pixel as u64])
    }

    /// The images of one view: (light, y, x, rgb).
    pub(super) fn view(&self, view: usize, camera: &impl Camera, task: &Task) -> Result<Vec<f32>> {
        let [width, height] = camera.size();
        let rows: Vec<Vec<f32>> = (0..height)
            .into_par_iter()
            .map(|row| {
                task.advance(1)?;
                Ok(self.row(view, camera, row))
            })
            .collect::<Result<_>>()?;
        let (count, padded) = (self.count, self.lights.x.len());
        let mut images = vec![0.0; count * width * height * 3];
        images.par_chunks_mut(width * height * 3).enumerate().for_each(|(light, image)| {
            for (texel, rgb) in image.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let first = texel % width * 3 * padded + light;
                *rgb = [0, 1, 2].map(|c| rows[texel / width][first + c * padded]);
            }
        });
        Ok(images)
    }

    /// One row of texels: (x, rgb, light), with lights padded to a multiple of [`LANES`].
    fn row(&self, view: usize, camera: &impl Camera, row: usize) -> Vec<f32> {
        let width = camera.size()[0];
        let mut sums = vec![0.0; width * 3 * self.lights.x.len()];
        let mut scratch = vec![0.0; self.lights.x.len()];
        for (column, sum) in sums.chunks_exact_mut(3 * self.lights.x.len()).enumerate() {
            let seed = self.seed(view, row * width + column);
            #[cfg(target_arch = "x86_64")]
            if self.wide {
                // SAFETY: `wide` is set only if the processor has AVX2 and FMA.
                unsafe { self.texel_avx2([column, row], camera, seed, &mut scratch, sum) };
                continue;
            }
            self.texel([column, row], camera, seed, &mut scratch, sum);
        }
        sums
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn texel_avx2(&self, texel: [usize; 2], camera: &impl Camera, seed: u64, lit: &mut [f32], sum: &mut [f32]) {
        self.texel(texel, camera, seed, lit, sum);
    }

    /// The mean over all paths of a texel, for every light: `sum` is (rgb, light).
    #[inline(always)]
    fn texel(&self, texel: [usize; 2], camera: &impl Camera, seed: u64, lit: &mut [f32], sum: &mut [f32]) {
        let spread = Spread::new(seed);
        let paths = camera.paths(texel, self.options.spp);
        for sample in 0..paths {
            let (offset, first) = spread.point(sample);
            let (at, wo) = camera.look(texel, offset);
            if let Some(albedo) = camera.cover(at) {
                let (z, padded) = (&self.lights.z, self.lights.z.len());
                sum.iter_mut().enumerate().for_each(|(i, sum)| *sum += albedo * z[i % padded].max(0.0));
                continue;
            }
            if let Some(point) = self.geometry.seen(at, wo) {
                self.path(point, wo, first, Stream::new(hash(&[seed, u64::from(sample)])), lit, sum);
            }
        }
        let scale = 1.0 / paths as f32;
        sum.iter_mut().for_each(|v| *v *= scale);
    }

    /// Adds the light from all directions along one path.
    #[inline(always)]
    fn path(
        &self,
        mut point: G::Point,
        mut wo: Vec3,
        first: Vec2,
        mut random: Stream,
        lit: &mut [f32],
        sum: &mut [f32],
    ) {
        let padded = self.lights.x.len();
        let mut throughput = Vec3::ONE;
        for depth in 1..=self.options.depth {
            // Add the light that arrives from all visible lights
            let reflector = self.geometry.reflector(&point, wo);
            self.geometry.visibility(&point, reflector.normal(), &self.lights, lit);
            let (red, rest) = sum.split_at_mut(padded);
            let (green, blue) = rest.split_at_mut(padded);
            reflector.add_lights(&self.lights, lit, throughput, [red, green, blue]);
            if depth == self.options.depth {
                return;
            }
            // Sample a direction to continue the path
            let uniform = if depth == 1 { first } else { random.next2() };
            let Some((wi, weight)) = reflector.sample(uniform, random.next()) else { return };
            throughput *= weight;
            // Terminate the path by Russian roulette
            if depth >= ROULETTE_AFTER {
                let survive = throughput.max_element().min(1.0);
                if random.next() >= survive {
                    return;
                }
                throughput /= survive;
            }
            let Some(next) = self.geometry.next(&point, wi) else { return };
            (point, wo) = (next, -wi);
        }
    }
}

#[cfg(target_arch = "x86_64")]
fn wide() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
}

#[cfg(not(target_arch = "x86_64"))]
fn wide() -> bool {
    false
}
