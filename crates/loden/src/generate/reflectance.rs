//! The reflectance of a row: its diffuse and its specular part.
//!
//! # Model
//! A row is fitted by an albedo times the cosine of a tilted normal, plus a white highlight about that normal: GGX facets
//! with height-correlated shadowing and Schlick's Fresnel factor. The fit alternates. Per light, a low quantile over all views is free of
//! highlights, and linear least squares give normal and albedo from it. The rest, weighted as below, gives the strength of the
//! highlight for each roughness of a grid, then of a golden-section search.
//!
//! Each value is then separated into s d + h w, where d is the colour of the albedo and w the white of the light: least squares with
//! the fitted highlight as a prior for h. Where d is coloured, the measured colour decides; where it is grey, the fit does. The
//! diffuse part is what h leaves, so both parts add up to the measured value, and neither is negative if that is not.
//!
//! # Limits
//! One highlight per row, isotropic and of the colour of the light. Coloured highlights of metals count as diffuse where
//! their colour says so. A highlight narrower than the spacing of the sampled directions is not found unless a pair hits it.
//!
//! # References
//! shafer1985, woodham1980, walter2007, schlick1994

use glam::{Mat3, Vec3};

use crate::btf::BtfMeta;
use crate::color::luminance;
use crate::direction::half;
use crate::simd::wide;

/// Roughness of the grid that the search starts from.
const GRID: [f32; 10] = [0.04, 0.06, 0.09, 0.13, 0.19, 0.27, 0.38, 0.52, 0.72, 1.0];

/// Steps of the golden-section search.
const STEPS: usize = 6;

/// Rounds of the alternation.
const ROUNDS: usize = 3;

/// The part of the views whose value counts as free of highlights.
const QUANTILE: f32 = 0.4;

/// Weight of the fitted highlight against the measured colours.
const PRIOR: f32 = 0.15;

/// Reflectance at normal incidence that a strength of 1 stands for.
const F0: f32 = 0.04;

/// The directions of the pairs of a BTF.
pub struct Geometry {
    lights: Vec<Vec3>,
    views: Vec<Vec3>,
    /// (component, light)
    light_components: [Vec<f32>; 3],
    /// (component, view, light): half vectors.
    half: [Vec<f32>; 3],
    /// (view, light): Fresnel factors relative to normal incidence.
    fresnel: Vec<f32>,
}

impl Geometry {
    /// The pairs of a BTF.
    pub fn new(meta: &BtfMeta) -> Self {
        let (lights, views) = (meta.lights.directions().to_vec(), meta.views.directions().to_vec());
        let pairs: Vec<[Vec3; 2]> =
            views.iter().flat_map(|&wo| lights.iter().map(move |&wi| [wi, half(wi, wo)])).collect();
        let fresnel = |[wi, wh]: &[Vec3; 2]| {
            let fresnel = F0 + (1.0 - F0) * (1.0 - wi.dot(*wh).clamp(0.0, 1.0)).powi(5);
            fresnel / F0
        };
        let fresnel = pairs.iter().map(fresnel).collect();
        let half = std::array::from_fn(|c| pairs.iter().map(|[_, wh]| wh[c]).collect());
        let light_components = std::array::from_fn(|c| lights.iter().map(|wi| wi[c]).collect());
        Self { lights, views, light_components, half, fresnel }
    }

    /// The lights.
    pub(super) fn lights(&self) -> &[Vec3] {
        &self.lights
    }

    /// The half vector of a pair.
    pub(super) fn half(&self, pair: usize) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|c| self.half[c][pair]))
    }

    /// The light of a pair.
    pub(super) fn light(&self, pair: usize) -> Vec3 {
        self.lights[pair % self.lights.len()]
    }

    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.fresnel.len()
    }

    /// Whether there are no pairs.
    pub fn is_empty(&self) -> bool {
        self.fresnel.is_empty()
    }

    /// The apparent value of the highlight of a dielectric with this roughness in all pairs.
    pub fn highlight(&self, alpha: f32, normal: Vec3) -> Vec<f32> {
        self.highlights(alpha, |_| normal)
    }

    /// The same, with a normal for each view.
    pub(super) fn highlights(&self, alpha: f32, normal: impl Fn(usize) -> Vec3) -> Vec<f32> {
        let lights = self.lights.len();
        let mut values = vec![0.0; self.len()];
        for (view, values) in values.chunks_exact_mut(lights).enumerate() {
            let normal = normal(view);
            let nv = normal.dot(self.views[view]);
            if nv > 0.0 {
                let pairs = view * lights..(view + 1) * lights;
                let half = self.half.each_ref().map(|component| &component[pairs.clone()]);
                let wi = self.light_components.each_ref().map(|component| &component[..]);
                facets(values, wi, half, &self.fresnel[pairs], normal, nv, alpha);
            }
        }
        values
    }
}

wide! {
    /// The highlight seen from one direction, whose cosine with the normal is `nv`, for each light.
    fn facets(out: &mut [f32], wi: [&[f32]; 3], wh: [&[f32]; 3], fresnel: &[f32], normal: Vec3, nv: f32, alpha: f32) {
        let (count, a2) = (out.len(), alpha * alpha);
        let root = |cos: f32| (cos * cos * (1.0 - a2) + a2).sqrt();
        let (rv, fresnel) = (root(nv), &fresnel[..count]);
        let ([lx, ly, lz], [hx, hy, hz]) = (wi.map(|v| &v[..count]), wh.map(|v| &v[..count]));
        for i in 0..count {
            let nl = normal.x * lx[i] + normal.y * ly[i] + normal.z * lz[i];
            let nh = normal.x * hx[i] + normal.y * hy[i] + normal.z * hz[i];
            let slope = nh * nh * (a2 - 1.0) + 1.0;
            // pi times D times G / (4 nl nv) times nl times F
            let visible = 0.5 / (nl * rv + nv * root(nl)).max(1e-6);
            let value = F0 * fresnel[i] * a2 / (slope * slope) * visible * nl;
            out[i] = if nl > 0.0 { value } else { 0.0 };
        }
    }
}

/// What a row is made of, as far as its directions tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflectance {
    /// Diffuse albedo, which includes the mean shadowing of the row.
    pub albedo: Vec3,
    /// Strength of the highlight; 1 is that of a dielectric with a reflectance of 0.04 at normal incidence.
    pub strength: f32,
    /// GGX roughness of the highlight.
    pub alpha: f32,
    /// The mean normal.
    pub normal: Vec3,
}

/// A row in two parts.
#[derive(Debug, Clone, PartialEq)]
pub struct Separated {
    /// The fit.
    pub fit: Reflectance,
    /// The diffuse part in all pairs.
    pub diffuse: Vec<Vec3>,
    /// The highlight in all pairs, of the colour of the light.
    pub specular: Vec<f32>,
}

impl Reflectance {
    /// Fits the apparent values of a row, shape (view, light).
    pub fn fit(geometry: &Geometry, values: &[Vec3]) -> Self {
        let mut specular = vec![0.0; values.len()];
        let mut fit = Self { albedo: Vec3::ZERO, strength: 0.0, alpha: 0.3, normal: Vec3::Z };
        for _ in 0..ROUNDS {
            let rest: Vec<Vec3> = values.iter().zip(&specular).map(|(v, s)| *v - *s).collect();
            fit.fit_diffuse(geometry, &rest);
            fit.fit_highlight(geometry, values);
            specular = geometry.highlight(fit.alpha, fit.normal);
            specular.iter_mut().for_each(|s| *s *= fit.strength);
        }
        fit
    }

    /// The diffuse value for a light.
    fn shading(&self, wi: Vec3) -> f32 {
        self.normal.dot(wi).max(0.0)
    }

    fn fit_diffuse(&mut self, geometry: &Geometry, rest: &[Vec3]) {
        let lights = geometry.lights.len();
        let low = |light: usize| {
            let channel = |c: usize| {
                let mut values: Vec<f32> = rest[light..].iter().step_by(lights).map(|v| v[c]).collect();
                let place = (QUANTILE * (values.len() - 1) as f32).round() as usize;
                *values.select_nth_unstable_by(place, f32::total_cmp).1
            };
            Vec3::new(channel(0), channel(1), channel(2))
        };
        let low: Vec<Vec3> = (0..lights).map(low).collect();
        // Fit the normal
        let (mut matrix, mut vector) = (Mat3::ZERO, Vec3::ZERO);
        for (wi, value) in geometry.lights.iter().zip(&low) {
            matrix += Mat3::from_cols(*wi * wi.x, *wi * wi.y, *wi * wi.z);
            vector += *wi * luminance(value.to_array());
        }
        let normal = if matrix.determinant() > 1e-4 { matrix.inverse() * vector } else { Vec3::Z };
        let normal = normal.try_normalize().unwrap_or(Vec3::Z);
        self.normal = normal.with_z(normal.z.max(0.5)).normalize();
        // Fit the albedo
        let weights = geometry.lights.iter().map(|wi| self.shading(*wi));
        let (mut sum, mut squares) = (Vec3::ZERO, 0.0);
        for (weight, value) in weights.zip(&low) {
            (sum, squares) = (sum + *value * weight, squares + weight * weight);
        }
        self.albedo = (sum / squares.max(1e-6)).max(Vec3::ZERO);
    }

    fn fit_highlight(&mut self, geometry: &Geometry, values: &[Vec3]) {
        let rest = self.rest(geometry, values);
        (self.alpha, self.strength) = search(|alpha| geometry.highlight(alpha, self.normal), &rest);
    }

    /// What is white beside the colour of the albedo, and what is more than diffuse, by how well each can be told.
    pub(super) fn rest(&self, geometry: &Geometry, values: &[Vec3]) -> Vec<f32> {
        let albedo = luminance(self.albedo.to_array());
        let light = geometry.lights.len();
        let diffuse: Vec<f32> = geometry.lights.iter().map(|wi| albedo * self.shading(*wi)).collect();
        let white = White::new(self.albedo);
        let rest = |(pair, v): (usize, &Vec3)| {
            let brighter = luminance(v.to_array()) - diffuse[pair % light];
            (white.found(*v) + PRIOR * brighter) / (white.told + PRIOR)
        };
        values.iter().enumerate().map(rest).collect()
    }
}

/// The roughness and the strength of the highlight that explains most of the rest; `highlight` gives that of strength 1.
pub(super) fn search(highlight: impl Fn(f32) -> Vec<f32>, rest: &[f32]) -> (f32, f32) {
    // The squared error that a roughness saves, and the strength for that
    let saved = |alpha: f32| {
        let shape = highlight(alpha);
        let (product, square) = shape
            .iter()
            .zip(rest)
            .fold((0.0f64, 1e-12f64), |(p, s), (g, r)| (p + f64::from(g * r), s + f64::from(g * g)));
        let strength = (product / square).max(0.0);
        (strength * product.max(0.0), strength as f32)
    };
    let errors = GRID.map(|alpha| saved(alpha).0);
    let best = (0..GRID.len()).fold(0, |best, k| if errors[k] > errors[best] { k } else { best });
    let (mut low, mut high) = (GRID[best.saturating_sub(1)].ln(), GRID[(best + 1).min(GRID.len() - 1)].ln());
    for _ in 0..STEPS {
        let [a, b] = [0.382, 0.618].map(|share| low + share * (high - low));
        if saved(a.exp()).0 >= saved(b.exp()).0 { high = b } else { low = a }
    }
    let alpha = (0.5 * (low + high)).exp();
    (alpha, saved(alpha).1)
}

/// The white of the light beside a colour.
struct White {
    /// What of white the colour cannot explain.
    across: Vec3,
    /// Its squared length: 0 if the colour is grey.
    told: f32,
}

impl White {
    fn new(albedo: Vec3) -> Self {
        let colour = albedo.try_normalize().unwrap_or(Vec3::ONE.normalize());
        let across = Vec3::ONE - colour * colour.dot(Vec3::ONE);
        Self { across, told: across.length_squared() }
    }

    /// The white in a value, times how well it can be told.
    fn found(&self, value: Vec3) -> f32 {
        self.across.dot(value)
    }
}

impl Separated {
    /// Separates the apparent values of a row, shape (view, light).
    pub fn new(geometry: &Geometry, values: &[Vec3]) -> Self {
        let fit = Reflectance::fit(geometry, values);
        let prior = geometry.highlight(fit.alpha, fit.normal);
        let white = White::new(fit.albedo);
        let specular = |(value, prior): (&Vec3, &f32)| {
            let h = (white.found(*value) + PRIOR * fit.strength * prior) / (white.told + PRIOR);
            h.clamp(0.0, value.min_element().max(0.0))
        };
        let specular: Vec<f32> = values.iter().zip(&prior).map(specular).collect();
        let diffuse = values.iter().zip(&specular).map(|(value, h)| *value - *h).collect();
        Self { fit, diffuse, specular }
    }

    /// The measured values.
    pub(super) fn values(&self) -> Vec<Vec3> {
        self.diffuse.iter().zip(&self.specular).map(|(diffuse, h)| *diffuse + *h).collect()
    }

    /// The row with another albedo and other highlights; shadows and interreflection stay.
    pub(super) fn with(&self, albedo: Vec3, specular: &[f32]) -> Vec<Vec3> {
        let diffuse = recoloured(&self.diffuse, self.fit.albedo, albedo);
        diffuse.into_iter().zip(specular).map(|(d, s)| d + *s).collect()
    }
}

/// Diffuse values of a surface whose albedo changes.
///
/// # Model
/// The part along the colour of the old albedo, which is light reflected once, gets the new colour. The rest is
/// interreflection and mixed colours; it keeps its place and loses what the new albedo reflects less of.
fn recoloured(diffuse: &[Vec3], old: Vec3, new: Vec3) -> Vec<Vec3> {
    if old == new {
        return diffuse.to_vec();
    }
    let colour = old.try_normalize().unwrap_or(Vec3::ONE.normalize());
    let target = new / old.length().max(1e-6);
    let rest = (new / old.max(Vec3::splat(1e-4))).min(Vec3::ONE);
    let value = |v: &Vec3| {
        let along = colour.dot(*v);
        (target * along + (*v - colour * along) * rest).max(Vec3::ZERO)
    };
    diffuse.iter().map(value).collect()
}
