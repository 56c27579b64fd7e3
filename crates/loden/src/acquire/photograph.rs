//! Raw photographs of a sample in a marker frame, as taken by the camera of a goniometer.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use glam::{DVec2, Vec2, Vec3};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;

use super::goniometer::{self, Camera as RayCamera, Rig};
use super::relief::Relief;
use super::solid::Tile;
use super::specimen::{Geometry, Specimen};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::output::{OutputDir, failed};
use crate::params::Params;
use crate::progress::{Progress, Task};
use crate::random::{hash, mix};
use crate::rectify::detect::Frame;
use crate::rectify::manifest::Manifest;
use crate::rectify::projection::{Distortion, Lens};
use crate::{Error, Result};

crate::params! {
    /// The camera.
    #[derive(Copy)]
    pub struct Camera {
        /// Pixels per side of a photograph; the sample covers up to two thirds of them.
        pub pixels: usize [32..=8192] = 320,
        /// Distance from the middle of the sample to the camera.
        pub distance: f64 [3.0..=1e4, "sample sides"] = 20,
        /// Radial distortion k1 of the lens.
        pub distortion: f64 [-0.2..=0.2] = -0.05,
        /// Photographs of each pair of directions, each exposed four times as long as the one before.
        pub exposures: u32 [1..=6] = 2,
        /// Bits of the sensor.
        pub bits: u32 [8..=16] = 12,
        /// Electrons that a pixel holds: fewer are noisier.
        pub electrons: u32 [100..=1_000_000_000] = 20000,
    }
}

impl Camera {
    fn lens_distortion(&self) -> Distortion {
        Distortion { k1: self.distortion, k2: 0.0 }
    }
}

/// Exposure at which an apparent value of 2 saturates a pixel.
const SHORTEST_EXPOSURE: f64 = 0.5;
/// Exposure of the white frame.
const WHITE_EXPOSURE: f64 = 0.9;
/// Relative sensitivity of the channels.
const CHANNELS: [f32; 3] = [0.9, 1.0, 0.8];
/// Signal without light, as a fraction of full scale.
const DARK: f32 = 0.02;
/// Read noise in electrons.
const READ_NOISE: f32 = 8.0;
/// Paths per pixel that shows the frame.
const FRAME_PATHS: u32 = 16;
/// Albedo of the white ring of the frame and of its black parts.
const RING: [f32; 2] = [0.85, 0.03];
/// File name of the manifest in the folder.
pub const MANIFEST: &str = "photographs.toml";

/// Photographs a sample for every pair of directions into the folder `output`, with a dark frame, a white frame and the
/// manifest [`MANIFEST`] that `loden rectify` reads. Returns the number of photographs.
///
/// # Model
/// A pinhole camera with a distorting lens looks at the centre of the sample from each view direction, rotated about
/// its axis so that the frame fills the picture. The marker frame surrounds the unit square of the sample in the plane
/// of its mean height. Paths are those of [`super::acquire`]. A pixel integrates light times exposure, channel
/// sensitivity and vignetting; the dark signal, photon noise (Gaussian) and read noise are added, and the sum is
/// clamped and rounded.
///
/// # Limits
/// The frame neither casts nor receives shadows. The noise of all exposures is independent. There is no blur other than
/// that of the pixel area.
///
/// # Errors
/// Errors of [`super::acquire`], and [`Error::Io`]. After an error the folder is removed.
pub fn photograph<'a>(
    sample: impl Into<Specimen<'a>>,
    directions: [&DirectionSet; 2],
    options: &super::Options,
    camera: &Camera,
    output: &Path,
    progress: &dyn Progress,
) -> Result<usize> {
    let [views, lights] = directions;
    goniometer::check(views, lights, options)?;
    camera.check()?;
    let folder = OutputDir::create(output)?;
    // Write the dark and white frames
    let sensor = Sensor::new(camera, options.seed);
    sensor.write(&folder.folder().join("dark.png"), None, 0.0)?;
    let white = vec![1.0; camera.pixels * camera.pixels * 3];
    sensor.write(&folder.folder().join("white.png"), Some((&white, None)), WHITE_EXPOSURE)?;
    // Photograph view by view
    let exposures: Vec<f64> = (0..camera.exposures).map(|k| SHORTEST_EXPOSURE * 4f64.powi(k as i32)).collect();
    let task = Task::new(progress, "photograph", (views.len() * camera.pixels) as u64);
    let focal = Pinhole::focal(views, camera);
    let size = camera.pixels * camera.pixels * 3;
    let mut write = |v: usize, images: Vec<f32>| {
        let below = folder.folder().join(format!("v{v:02}"));
        std::fs::create_dir(&below).map_err(failed(&below))?;
        images.par_chunks(size).enumerate().try_for_each(|(l, image)| {
            exposures.iter().enumerate().try_for_each(|(e, exposure)| {
                let seed = hash(&[options.seed, v as u64, l as u64, e as u64]);
                sensor.write(&below.join(format!("l{l:02}_e{e}.png")), Some((image, Some(seed))), *exposure)
            })
        })
    };
    match sample.into() {
        Specimen::Field(field) => {
            let rig = Rig::new(Relief::new(field, lights), lights, *options);
            all_views(&rig, views, camera, focal, &task, &mut write)?;
        }
        Specimen::Solid(solid) => {
            let rig = Rig::new(Tile::new(solid, lights), lights, *options);
            all_views(&rig, views, camera, focal, &task, &mut write)?;
        }
    }
    drop(task);
    let count = views.len() * lights.len() * exposures.len();
    manifest(views, lights, camera, exposures, &folder.folder().join(MANIFEST))?;
    folder.commit()?;
    Ok(count)
}

/// Passes the images of every view to `write`.
fn all_views<G: Geometry>(
    rig: &Rig<G>,
    views: &DirectionSet,
    camera: &Camera,
    focal: f32,
    task: &Task,
    write: &mut dyn FnMut(usize, Vec<f32>) -> Result<()>,
) -> Result<()> {
    let images = |v, wo| rig.view(v, &Pinhole::new(wo, camera, focal, rig.side()), task);
    views.directions().iter().enumerate().try_for_each(|(v, &wo)| write(v, images(v, wo)?))
}

fn manifest(
    views: &DirectionSet,
    lights: &DirectionSet,
    camera: &Camera,
    exposures: Vec<f64>,
    path: &PathBuf,
) -> Result<()> {
    let manifest = Manifest {
        loden_photographs: 1,
        files: "v{view}/l{light}_e{exposure}.png".into(),
        views: Some(views.clone()),
        lights: Some(lights.clone()),
        pairs: None,
        count_from: 0,
        exposures,
        bits: Some(camera.bits),
        encoding: Encoding::Linear,
        dark: Some("dark.png".into()),
        white: Some("white.png".into()),
        white_exposure: WHITE_EXPOSURE,
        white_value: 1.0,
        distortion: camera.lens_distortion(),
        frame: Frame::default(),
        outline: None,
        corners: None,
    };
    let text = toml::to_string(&manifest).map_err(|e| Error::invalid(path, "manifest", e.to_string()))?;
    crate::output::write_file(path, |file| file.write_all(text.as_bytes()))
}

/// A pinhole camera that looks at the centre of the sample, which is the origin. Lengths are in sides of the sample.
struct Pinhole {
    eye: Vec3,
    /// Right, up and forward.
    axes: [Vec3; 3],
    /// Focal length in pixels.
    focal: f32,
    lens: Lens,
    pixels: usize,
    /// Units of the sample per side.
    side: f32,
}

impl Pinhole {
    fn new(wo: Vec3, camera: &Camera, focal: f32, side: f32) -> Self {
        let lens = Lens::new(camera.lens_distortion(), camera.pixels, camera.pixels);
        let (axes, _) = Self::rotated_axes(wo, camera.distance as f32);
        let eye = wo * camera.distance as f32;
        Self { eye, axes, focal, lens, pixels: camera.pixels, side }
    }

    /// The focal length in pixels with which the frame fits into all photographs.
    fn focal(views: &DirectionSet, camera: &Camera) -> f32 {
        let extents = views.directions().iter().map(|wo| Self::rotated_axes(*wo, camera.distance as f32).1);
        let swollen = 1.0 + 2.0 * camera.distortion.max(0.0) as f32;
        0.47 * camera.pixels as f32 / (extents.fold(0.0, f32::max) * swollen)
    }

    /// The axes of the camera, rotated so that the frame extends least from the centre, and that extent at a focal
    /// length of 1.
    fn rotated_axes(wo: Vec3, distance: f32) -> ([Vec3; 3], f32) {
        let forward = -wo;
        let across = if wo.z < 0.999 { Vec3::Z.cross(wo).normalize() } else { Vec3::X };
        let above = wo.cross(across);
        let half = 0.5 + Frame::default().outer as f32;
        let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
        let turn = |step: u32| {
            let (sin, cos) = (step as f32).to_radians().sin_cos();
            let (right, up) = (cos * across + sin * above, cos * above - sin * across);
            let extent = corners.iter().map(|[x, y]| {
                let d = Vec3::new(*x, *y, 0.0) - wo * distance;
                (right.dot(d).abs().max(up.dot(d).abs())) / forward.dot(d)
            });
            ([right, up, forward], extent.fold(0.0, f32::max))
        };
        (0..90).map(turn).min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_else(|| turn(0))
    }

    /// The point of the plane that is seen at a position in pixels, in sides of the sample from its lower left corner,
    /// and the direction to the camera.
    #[inline(always)]
    fn plane(&self, at: Vec2) -> (Vec2, Vec3) {
        let ideal = self.lens.undistort(DVec2::new(f64::from(at.x), f64::from(at.y))).as_vec2();
        let middle = self.pixels as f32 / 2.0;
        let [right, up, forward] = self.axes;
        let d = forward + ((ideal.x - middle) * right - (ideal.y - middle) * up) / self.focal;
        let hit = self.eye - d * (self.eye.z / d.z);
        (hit.truncate() + 0.5, -d.normalize())
    }
}

fn is_sample(at: Vec2) -> bool {
    (at - 0.5).abs().max_element() <= 0.5
}

impl RayCamera for Pinhole {
    fn size(&self) -> [usize; 2] {
        [self.pixels; 2]
    }

    #[inline(always)]
    fn look(&self, pixel: [usize; 2], offset: Vec2) -> (Vec2, Vec3) {
        let (at, wo) = self.plane(Vec2::new(pixel[0] as f32 + offset.x, (pixel[1] + 1) as f32 - offset.y));
        (at * self.side, wo)
    }

    #[inline(always)]
    fn cover(&self, at: Vec2) -> Option<f32> {
        let at = at / self.side;
        let white = || Frame::default().is_white(DVec2::new(f64::from(at.x), 1.0 - f64::from(at.y)));
        if is_sample(at) { None } else { Some(if white() { RING[0] } else { RING[1] }) }
    }

    fn paths(&self, pixel: [usize; 2], spp: u32) -> u32 {
        let corners = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
        let sample = corners.iter().all(|c| is_sample(self.plane(Vec2::new(pixel[0] as f32, pixel[1] as f32) + c).0));
        if sample { spp } else { spp.max(FRAME_PATHS) }
    }
}

/// The sensor, which converts light to numbers.
struct Sensor {
    pixels: usize,
    bits: u32,
    electrons: f32,
    /// Dark signal per number.
    dark: Vec<f32>,
    /// Vignetting times sensitivity, per number.
    flat: Vec<f32>,
}

impl Sensor {
    fn new(camera: &Camera, seed: u64) -> Self {
        let n = camera.pixels;
        let pattern = |i: usize| DARK * (1.0 + 0.2 * normal(hash(&[seed, i as u64])));
        let flat = |i: usize| {
            let middle = n as f32 / 2.0;
            let (x, y) = ((i / 3 % n) as f32 + 0.5 - middle, (i / 3 / n) as f32 + 0.5 - middle);
            CHANNELS[i % 3] * (1.0 - 0.15 * (x * x + y * y) / (middle * middle))
        };
        Self {
            pixels: n,
            bits: camera.bits,
            electrons: camera.electrons as f32,
            dark: (0..n * n * 3).map(pattern).collect(),
            flat: (0..n * n * 3).map(flat).collect(),
        }
    }

    /// Writes one photograph. `light` holds apparent values, and the seed of the noise if there is any.
    fn write(&self, path: &Path, light: Option<(&[f32], Option<u64>)>, exposure: f64) -> Result<()> {
        let full = ((1u32 << self.bits) - 1) as f32;
        let read = READ_NOISE / self.electrons;
        let number = |i: usize| {
            let signal = light.map_or(0.0, |(values, _)| values[i] * exposure as f32 * self.flat[i]);
            let noise = light.and_then(|(_, seed)| seed).map_or(0.0, |seed| {
                (signal / self.electrons + read * read).sqrt() * normal(mix(seed.wrapping_add(i as u64)))
            });
            ((signal + self.dark[i] + noise).clamp(0.0, 1.0) * full).round() as u16
        };
        let numbers: Vec<u16> = (0..self.dark.len()).map(number).collect();
        let mut bytes = Cursor::new(Vec::new());
        let side = self.pixels as u32;
        PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Up)
            .write_image(bytemuck::cast_slice(&numbers), side, side, ExtendedColorType::Rgb16)
            .map_err(|e| Error::invalid(path, "PNG", e.to_string()))?;
        std::fs::write(path, bytes.get_ref()).map_err(failed(path))
    }
}

/// An approximately normal number with mean 0 and standard deviation 1: the sum of four uniform ones.
fn normal(bits: u64) -> f32 {
    let sum: u64 = (0..4).map(|k| bits >> (16 * k) & 0xffff).sum();
    (sum as f32 / 65_535.0 - 2.0) * 3f32.sqrt()
}
