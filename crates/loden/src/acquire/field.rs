//! The periodic height field that the goniometer measures: heights and finishes on a square grid.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

use crate::{Error, Result};

/// Reflection of a grid point: a diffuse base under a GGX coat, or a metal if the albedo is black.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Finish {
    /// Diffuse albedo, linear RGB in 0..=1.
    pub albedo: [f32; 3],
    /// GGX roughness alpha, 0.02..=1.
    pub roughness: f32,
    /// Specular reflectance at normal incidence, linear RGB in 0..=1; black means no coat.
    pub f0: [f32; 3],
    /// Pads the struct to eight numbers; unused.
    pub padding: f32,
}

impl Finish {
    /// A diffuse finish without a coat.
    pub fn matt(albedo: Vec3) -> Self {
        Self::coated(albedo, 0.0, 1.0)
    }

    /// A diffuse finish with a colourless coat.
    pub fn coated(albedo: Vec3, f0: f32, roughness: f32) -> Self {
        Self { albedo: albedo.to_array(), roughness, f0: [f0; 3], padding: 0.0 }
    }

    /// A finish that only reflects specularly.
    pub fn metal(f0: Vec3, roughness: f32) -> Self {
        Self { albedo: [0.0; 3], roughness, f0: f0.to_array(), padding: 0.0 }
    }

    fn is_valid(&self) -> bool {
        let fraction = |v: f32| (0.0..=1.0).contains(&v);
        self.albedo.iter().chain(&self.f0).all(|&v| fraction(v)) && (0.02..=1.0).contains(&self.roughness)
    }
}

/// Smallest and largest number of grid points per side.
pub const GRID_RANGE: std::ops::RangeInclusive<usize> = 4..=4096;

/// A surface z = h(x, y) over the unit square, periodic in x and y. The unit of length is the period.
///
/// # Model
/// Grid point (column i, row j) is at x = (i + 1/2) / n, y = (j + 1/2) / n, so rows count upwards. Each cell consists
/// of two triangles, split from the lower right to the upper left corner, with face normals; the finish is interpolated
/// linearly within each triangle.
#[derive(Debug, Clone)]
pub struct HeightField {
    n: usize,
    heights: Vec<f32>,
    finish: Vec<Finish>,
}

impl HeightField {
    /// A field of `n` x `n` grid points, row by row from the bottom.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `n` is not a power of two in [`GRID_RANGE`], a length is not `n * n`, a height is not
    /// finite or outside -1..=1 periods, or a finish is out of range.
    pub fn new(n: usize, heights: Vec<f32>, finish: Vec<Finish>) -> Result<Self> {
        if !n.is_power_of_two() || !GRID_RANGE.contains(&n) {
            let (min, max) = (GRID_RANGE.start(), GRID_RANGE.end());
            return Err(Error::parameter("grid", format!("found {n}, expected a power of two from {min} to {max}")));
        }
        let (points, found) = (n * n, (heights.len(), finish.len()));
        if found != (points, points) {
            return Err(Error::parameter("grid", format!("found {found:?} heights and finishes, expected {points}")));
        }
        if let Some(h) = heights.iter().find(|h| !(-1.0..=1.0).contains(*h)) {
            return Err(Error::parameter("height", format!("found {h}, expected -1 to 1 periods")));
        }
        if let Some(bad) = finish.iter().find(|f| !f.is_valid()) {
            return Err(Error::parameter("finish", format!("out of range: {bad:?}")));
        }
        Ok(Self { n, heights, finish })
    }

    /// A field from a function of the position in 0..1 (x right, y up), which returns the height in periods and the
    /// finish.
    ///
    /// # Errors
    /// Errors of [`HeightField::new`].
    pub fn from_fn(n: usize, point: impl Fn(f32, f32) -> (f32, Finish) + Sync) -> Result<Self> {
        let at = |k: usize| (k as f32 + 0.5) / n as f32;
        let (heights, finish) = (0..n * n).into_par_iter().map(|k| point(at(k % n), at(k / n))).unzip();
        Self::new(n, heights, finish)
    }

    /// Grid points per side.
    pub fn grid(&self) -> usize {
        self.n
    }

    /// Heights in periods, row by row from the bottom.
    pub fn heights(&self) -> &[f32] {
        &self.heights
    }

    /// Finishes, in the order of the heights.
    pub fn finish(&self) -> &[Finish] {
        &self.finish
    }

    /// The mean height, at which the image plane of a rectified measurement lies.
    pub fn mean_height(&self) -> f32 {
        let sum: f64 = self.heights.iter().map(|&h| f64::from(h)).sum();
        (sum / self.heights.len() as f64) as f32
    }
}
