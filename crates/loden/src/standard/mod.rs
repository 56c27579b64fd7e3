//! The standard material of renderers, with a value of each parameter per texel, that is closest to another material.
//!
//! # Model
//! With l and v towards light and viewer, n the normal of the texel, and h halfway, the BRDF is that of glTF 2.0: a metal of
//! the base colour b by the share m, else a diffuse base b under a dielectric layer of the weight w,
//!
//! f = (1 - m) (b (1 - w F) / pi + w F D V) + m (b + (1 - b) (1 - h.v)^5) D V,  F = f0 + (1 - f0) (1 - h.v)^5
//!
//! where D and V are those of anisotropic GGX facets whose heights are correlated, and alpha is the square of what renderers
//! call roughness. Where they help, sheen (Charlie's distribution, a power of the sine) and a clear coat about the surface's own
//! normal are added.
//!
//! # Limits
//! Shadows, parallax and light from texel to texel are lost. All texels share f0 and the roughness of sheen and coat. The base
//! loses what the sheen takes by a constant factor, as real-time renderers have it.
//!
//! # References
//! walter2007, heitz2014, burley2012, estevez2017 (sheen), schlick1994

mod closest;
mod evaluate;
mod pairs;
mod smooth;

use glam::{Vec2, Vec3};

use crate::color::Encoding;
use crate::material::Material;
pub use closest::closest;
use evaluate::{Direction, Shared};

/// Number of parameters of a texel.
const COUNT: usize = 14;

/// Indices of the parameters of a texel.
const BASE: usize = 0;
const METALLIC: usize = 3;
const WEIGHT: usize = 4;
const LOG_ALPHA: usize = 5;
const SLOPE: usize = 6;
const GRAIN: usize = 8;
const SHEEN: usize = 10;
const COAT: usize = 13;

/// Reflectance at normal incidence of a refractive index of 1.5.
pub(crate) const USUAL_F0: f64 = 0.04;

/// The parameters of one texel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Texel {
    /// Diffuse albedo of a dielectric, reflectance of a metal; linear RGB, 0 to 1.
    pub base: [f32; 3],
    /// Share of metal, 0 to 1.
    pub metallic: f32,
    /// Weight of the dielectric layer, 0 to 1.
    pub weight: f32,
    /// GGX roughness along the grain and across it.
    pub alpha: [f32; 2],
    /// The direction of the larger roughness, counter-clockwise from u, radians, 0 to pi.
    pub grain: f32,
    /// Normal in the frame of the surface: x where u grows, y where v grows.
    pub normal: [f32; 3],
    /// Colour of the sheen, linear RGB, 0 to 1.
    pub sheen: [f32; 3],
    /// Weight of the clear coat, 0 to 1.
    pub coat: f32,
}

impl Texel {
    fn from_numbers(numbers: &[f64; COUNT]) -> Self {
        let of = |range: [usize; 3]| range.map(|i| numbers[i] as f32);
        let normal = Vec3::new(numbers[SLOPE] as f32, numbers[SLOPE + 1] as f32, 1.0).normalize();
        let (alpha, strength) = (numbers[LOG_ALPHA].exp(), numbers[GRAIN].hypot(numbers[GRAIN + 1]));
        let turn = 0.5 * numbers[GRAIN + 1].atan2(numbers[GRAIN]);
        Self {
            base: of([BASE, BASE + 1, BASE + 2]),
            metallic: numbers[METALLIC] as f32,
            weight: numbers[WEIGHT] as f32,
            alpha: [strength, -strength].map(|s| (alpha * s.exp()).min(1.0) as f32),
            grain: turn.rem_euclid(std::f64::consts::PI) as f32,
            normal: normal.to_array(),
            sheen: of([SHEEN, SHEEN + 1, SHEEN + 2]),
            coat: numbers[COAT] as f32,
        }
    }

    fn numbers(&self) -> [f64; COUNT] {
        let mut numbers = [0.0; COUNT];
        let mut put = |at: usize, values: &[f32]| {
            values.iter().enumerate().for_each(|(i, value)| numbers[at + i] = f64::from(*value));
        };
        let [x, y, z] = self.normal;
        let [along, across] = self.alpha;
        let strength = 0.5 * (along / across).ln();
        let (sin, cos) = (2.0 * self.grain).sin_cos();
        put(BASE, &self.base);
        put(METALLIC, &[self.metallic, self.weight, 0.5 * (along * across).ln()]);
        put(SLOPE, &[x / z, y / z, strength * cos, strength * sin]);
        put(SHEEN, &self.sheen);
        put(COAT, &[self.coat]);
        numbers
    }

    /// With the precision of 8-bit textures: colours by sRGB, roughness instead of its square.
    fn rounded(&self) -> Self {
        let whole = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() / 255.0;
        let color = |rgb: [f32; 3]| rgb.map(|v| Encoding::Srgb.decode(whole(Encoding::Srgb.encode(v.clamp(0.0, 1.0)))));
        let normal = Vec3::from(self.normal.map(|v| 2.0 * whole(0.5 * v + 0.5) - 1.0));
        Self {
            base: color(self.base),
            metallic: whole(self.metallic),
            weight: whole(self.weight),
            alpha: self.alpha.map(|alpha| whole(alpha.sqrt()).max(1.0 / 255.0).powi(2)),
            grain: self.grain,
            normal: normal.normalize().to_array(),
            sheen: color(self.sheen),
            coat: whole(self.coat),
        }
    }
}

/// What is beside the base, with what all texels have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layers {
    /// Reflectance of the dielectric layer at normal incidence.
    pub f0: f32,
    /// Whether roughness depends on the direction.
    pub grain: bool,
    /// Roughness of the sheen as renderers have it, the square root of alpha, if there is one.
    pub sheen: Option<f32>,
    /// Roughness of the clear coat in the same sense, if there is one.
    pub coat: Option<f32>,
}

impl Layers {
    /// Refractive index of the dielectric layer.
    pub fn ior(&self) -> f32 {
        let root = self.f0.sqrt();
        (1.0 + root) / (1.0 - root)
    }
}

/// A standard material with a value of each parameter per texel, with the precision of 8-bit textures.
pub struct Standard {
    width: usize,
    height: usize,
    shared: Shared,
    texels: Vec<Texel>,
    numbers: Vec<[f64; COUNT]>,
}

impl Standard {
    fn new(width: usize, height: usize, shared: Shared, numbers: &[[f64; COUNT]]) -> Self {
        let texels: Vec<Texel> = numbers.iter().map(|numbers| Texel::from_numbers(numbers).rounded()).collect();
        let numbers = texels.iter().map(Texel::numbers).collect();
        Self { width, height, shared, texels, numbers }
    }

    /// Texels per row, and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The texels row by row; row 0 is the top.
    pub fn rows(&self) -> &[Texel] {
        &self.texels
    }

    /// What all texels have in common.
    pub fn layers(&self) -> Layers {
        self.shared.layers()
    }
}

impl Material for Standard {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return Vec3::ZERO;
        }
        // bilinear interpolation of the parameters, periodic
        let place = |at: f32, count: usize| {
            let x = (at - at.floor()) * count as f32 - 0.5;
            let first = x.floor();
            let index = |k: f32| (k as isize).rem_euclid(count as isize) as usize;
            ([index(first), index(first + 1.0)], f64::from(x - first))
        };
        let ((xs, x), (ys, y)) = (place(uv.x, self.width), place(1.0 - uv.y, self.height));
        let mut numbers = [0.0; COUNT];
        for (row, of_row) in [(ys[0], 1.0 - y), (ys[1], y)] {
            for (column, of_column) in [(xs[0], 1.0 - x), (xs[1], x)] {
                let texel = &self.numbers[row * self.width + column];
                numbers.iter_mut().zip(texel).for_each(|(sum, value)| *sum += of_row * of_column * value);
            }
        }
        let pair = [Direction::new(wi.as_dvec3(), wo.as_dvec3(), &self.shared)];
        let values = self.shared.values(&self.shared.shapes(&pair, &numbers), &pair, &numbers);
        Vec3::from_array([0, 1, 2].map(|c| values[c] as f32))
    }

    fn texels(&self) -> Option<[usize; 2]> {
        Some([self.width, self.height])
    }
}
