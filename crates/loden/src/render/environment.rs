//! Environments: light from all directions, none, constant or from a latitude-longitude image.

mod distribution;

use std::f32::consts::{PI, TAU};
use std::path::Path;

use glam::{Vec2, Vec3};

use crate::color::luminance;
use crate::picture::Picture;
use crate::{Error, Result};
use distribution::Distribution;

/// Maximum size of the sampling distribution; more detail does not reduce noise further.
const MAX_CELLS: [usize; 2] = [1024, 512];

/// The radiance of rays that hit nothing.
#[derive(Debug, Clone)]
pub enum Environment {
    /// No light.
    Dark,
    /// Constant radiance; sampled through the material only.
    Constant(Vec3),
    /// A latitude-longitude image, also sampled by luminance.
    Map(Box<EnvironmentMap>),
}

impl Environment {
    /// The radiance from the direction of the unit vector `direction`.
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match self {
            Self::Dark => Vec3::ZERO,
            Self::Constant(radiance) => *radiance,
            Self::Map(map) => map.radiance(direction),
        }
    }
}

/// A latitude-longitude image: the top row is +y, the middle column -z, and +x is to the right of it.
#[derive(Debug, Clone)]
pub struct EnvironmentMap {
    picture: Picture,
    distribution: Distribution,
    /// Clockwise rotation in turns.
    rotation: f32,
}

impl EnvironmentMap {
    /// An environment map, rotated counter-clockwise about the up axis +y as seen from above, like a shape under
    /// `rotate = [rotation_degrees, 0, 1, 0]`: at 90 degrees, what was ahead at -z is on the left at -x.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the image is smaller than 2 x 1, black, or has a value that is negative or not finite.
    pub fn new(picture: Picture, rotation_degrees: f32) -> Result<Self> {
        let (width, height) = (picture.width, picture.height);
        let bad = |problem: String| Error::parameter("env", problem);
        if width < 2 || height < 1 || picture.rgb.len() != width * height {
            return Err(bad(format!("found an image of {width} x {height} pixels, expected at least 2 x 1")));
        }
        if let Some(i) = picture.rgb.iter().position(|c| !c.is_finite() || c.min_element() < 0.0) {
            let (x, y) = (i % width, i / width);
            return Err(bad(format!("pixel ({x}, {y}) is {}, expected finite values of at least 0", picture.rgb[i])));
        }
        if !rotation_degrees.is_finite() {
            return Err(bad(format!("found a rotation of {rotation_degrees} degrees")));
        }
        let distribution = weights(&picture).ok_or_else(|| bad("the image is black".into()))?;
        Ok(Self { picture, distribution, rotation: -rotation_degrees / 360.0 })
    }

    /// Reads an environment map, rotated like that of [`EnvironmentMap::new`]. What the file says but is not applied is
    /// added to `warnings`; negative values become 0 with a warning.
    ///
    /// # Errors
    /// As [`Picture::read`]; [`Error::Invalid`] where [`EnvironmentMap::new`] fails.
    pub fn read(path: impl AsRef<Path>, rotation_degrees: f32, warnings: &mut Vec<String>) -> Result<Self> {
        let path = path.as_ref();
        let picture = Picture::read_light(path, warnings)?;
        Self::new(picture, rotation_degrees).map_err(|error| match error {
            Error::Parameter { problem, .. } => Error::invalid(path, "environment", problem),
            other => other,
        })
    }

    /// The radiance from the direction of the unit vector `direction`, interpolated bilinearly.
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let Picture { width, height, rgb } = &self.picture;
        let uv = self.uv(direction);
        let x = uv.x * *width as f32 - 0.5;
        let y = (uv.y * *height as f32 - 0.5).clamp(0.0, (*height - 1) as f32);
        let (x0, y0) = (x.floor(), y.floor());
        let column = |x: f32| (x as i64).rem_euclid(*width as i64) as usize;
        let (left, right) = (column(x0), column(x0 + 1.0));
        let (top, bottom) = (y0 as usize * width, ((y0 as usize) + 1).min(height - 1) * width);
        let (s, t) = (x - x0, y - y0);
        rgb[top + left].lerp(rgb[top + right], s).lerp(rgb[bottom + left].lerp(rgb[bottom + right], s), t)
    }

    /// Draws a direction in proportion to luminance. Returns it with its density, 1/sr; `None` at the poles.
    #[inline]
    pub(crate) fn sample(&self, random: Vec2) -> Option<(Vec3, f32)> {
        let (uv, density) = self.distribution.sample(random);
        let (sin_theta, cos_theta) = (PI * uv.y).sin_cos();
        let (sin_phi, cos_phi) = (TAU * (uv.x + self.rotation - 0.5)).sin_cos();
        let direction = Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi);
        (sin_theta > 1e-6).then(|| (direction, density / (2.0 * PI * PI * sin_theta)))
    }

    /// The density of [`EnvironmentMap::sample`] at a direction, 1/sr.
    #[inline]
    pub(crate) fn pdf(&self, direction: Vec3) -> f32 {
        let sin_theta = Vec2::new(direction.x, direction.z).length();
        if sin_theta <= 1e-6 {
            return 0.0;
        }
        self.distribution.pdf(self.uv(direction)) / (2.0 * PI * PI * sin_theta)
    }

    #[inline]
    fn uv(&self, direction: Vec3) -> Vec2 {
        let u = 0.5 + direction.x.atan2(-direction.z) / TAU - self.rotation;
        let theta = Vec2::new(direction.x, direction.z).length().atan2(direction.y);
        Vec2::new(u - u.floor(), theta / PI)
    }
}

/// A distribution of the image's mean luminance times solid angle. Each cell includes the adjacent pixels, because
/// interpolation spreads a bright pixel over its neighbours.
fn weights(picture: &Picture) -> Option<Distribution> {
    let (width, height) = (picture.width, picture.height);
    let (columns, rows) = (width.min(MAX_CELLS[0]), height.min(MAX_CELLS[1]));
    let mut weights = Vec::with_capacity(columns * rows);
    for j in 0..rows {
        let solid_angle = (PI * (j as f32 + 0.5) / rows as f32).sin();
        let (top, bottom) = (j * height / rows, ((j + 1) * height).div_ceil(rows));
        for i in 0..columns {
            let (left, right) = (i * width / columns, ((i + 1) * width).div_ceil(columns));
            let mut sum = 0.0;
            for y in top.saturating_sub(1)..(bottom + 1).min(height) {
                for x in left + width - 1..right + width + 1 {
                    sum += luminance(picture.at(x % width, y).to_array());
                }
            }
            let pixels = (right - left + 2) * ((bottom + 1).min(height) - top.saturating_sub(1));
            weights.push(sum / pixels as f32 * solid_angle);
        }
    }
    Distribution::new(columns, rows, &weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::Frame;

    /// A dim sky with a small bright patch.
    fn map() -> EnvironmentMap {
        let mut picture = Picture::filled(48, 24, Vec3::splat(0.2));
        for (x, y) in [(30, 6), (31, 6), (31, 7), (0, 12)] {
            picture.rgb[y * 48 + x] = Vec3::new(300.0, 200.0, 100.0);
        }
        EnvironmentMap::new(picture, 40.0).unwrap()
    }

    fn sphere_grid(n: usize) -> impl Iterator<Item = Vec3> {
        // Equal-area cells: the mean times 4 pi is the integral.
        (0..n * 2 * n).map(move |i| {
            let z = 1.0 - 2.0 * ((i / (2 * n)) as f32 + 0.5) / n as f32;
            let phi = TAU * ((i % (2 * n)) as f32 + 0.5) / (2 * n) as f32;
            let s = (1.0 - z * z).sqrt();
            Vec3::new(s * phi.cos(), z, s * phi.sin())
        })
    }

    #[test]
    fn density_integrates_to_one() {
        let map = map();
        let n = 720;
        let integral = sphere_grid(n).map(|w| f64::from(map.pdf(w))).sum::<f64>() * 4.0 * std::f64::consts::PI;
        let integral = integral / (2 * n * n) as f64;
        assert!((integral - 1.0).abs() < 0.005, "{integral}");
    }

    #[test]
    fn samples_agree_with_their_density() {
        let map = map();
        let n = 1 << 16;
        let mut estimate = 0.0;
        for i in 0..n {
            let random = Vec2::new(i as f32 / n as f32, (i as u32).reverse_bits() as f32 / 2f32.powi(32));
            let Some((w, pdf)) = map.sample(random.min(Vec2::splat(0.999_999))) else { continue };
            assert!((w.length() - 1.0).abs() < 1e-5);
            let again = map.pdf(w);
            // Rounding may move a direction on the edge of a cell into the next one.
            if (again - pdf).abs() > 1e-2 * pdf {
                let beside = Frame::from_normal(w);
                let near = [beside.tangent, -beside.tangent, beside.bitangent, -beside.bitangent];
                let found = near.iter().any(|d| (map.pdf((w + *d * 1e-4).normalize()) - pdf).abs() < 1e-2 * pdf);
                assert!(found, "{pdf} {again}");
            }
            estimate += f64::from(map.radiance(w).y / pdf);
        }
        let n = 500;
        let integral = sphere_grid(n).map(|w| f64::from(map.radiance(w).y)).sum::<f64>();
        let integral = integral * 4.0 * std::f64::consts::PI / (2 * n * n) as f64;
        let estimate = estimate / f64::from(1 << 16);
        assert!((estimate / integral - 1.0).abs() < 0.01, "{estimate} {integral}");
    }

    #[test]
    fn the_top_row_is_up_and_the_middle_column_is_minus_z() {
        let mut picture = Picture::filled(64, 32, Vec3::ONE);
        picture.rgb[..64].fill(Vec3::new(7.0, 0.0, 0.0));
        for y in 12..20 {
            for x in 0..64 {
                picture.rgb[y * 64 + x] = Vec3::new(0.0, x as f32, 0.0);
            }
        }
        let map = EnvironmentMap::new(picture.clone(), 0.0).unwrap();
        assert_eq!(map.radiance(Vec3::Y).x, 7.0);
        assert!((map.radiance(-Vec3::Z).y - 31.5).abs() < 1e-3);
        assert!((map.radiance(Vec3::X).y - 47.5).abs() < 1e-3);
        let turned = EnvironmentMap::new(picture, 90.0).unwrap();
        assert!((turned.radiance(-Vec3::X).y - 31.5).abs() < 1e-3, "what was ahead is on the left");
    }

    #[test]
    fn invalid_images_are_errors() {
        let mut picture = Picture::filled(4, 2, Vec3::ONE);
        picture.rgb[5].z = f32::INFINITY;
        assert!(EnvironmentMap::new(picture, 0.0).unwrap_err().to_string().contains("(1, 1)"));
        assert!(EnvironmentMap::new(Picture::filled(4, 2, Vec3::ZERO), 0.0).is_err());
        assert!(EnvironmentMap::new(Picture::filled(4, 2, Vec3::NEG_ONE), 0.0).is_err());
    }
}
