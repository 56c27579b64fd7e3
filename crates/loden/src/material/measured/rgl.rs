//! BRDFs in the adaptive parametrisation of the EPFL goniometer.

mod guide;
mod tabulate;
mod warp;

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3, Vec4};

use super::{Brdf, BrdfSample, Notes, bracket};
use crate::direction::{self, atan2, from_angles, sin_cos_turns, theta};
use crate::material::{Bounce, Material, Point, Prepared, Promises, Sample};
use crate::simd::wide;
use crate::{Error, Result};
use warp::{BLOCK, Between, Colors, Grid, Lane, Pair, Stencil, Warp};

/// The tables of a `.bsdf` file. Images are stored row by row, a row along the polar angle.
#[derive(Debug, Clone, Default)]
pub struct RglData {
    /// Incident azimuths, radians, ascending; one for an isotropic material.
    pub phi_i: Vec<f32>,
    /// Incident polar angles, radians, ascending.
    pub theta_i: Vec<f32>,
    /// Microfacet density over (phi_m, theta_m): rows, columns.
    pub ndf: ([usize; 2], Vec<f32>),
    /// Projected microfacet area over (phi_i, theta_i).
    pub sigma: ([usize; 2], Vec<f32>),
    /// Density of visible microfacets: `[phi_i][theta_i][rows][columns]`.
    pub vndf: ([usize; 2], Vec<f32>),
    /// Density of the remaining sample: `[phi_i][theta_i][rows][columns]`.
    pub luminance: ([usize; 2], Vec<f32>),
    /// The scaled reflectance as linear RGB: `[phi_i][theta_i][3][rows][columns]`, the size of `luminance`.
    pub rgb: Vec<f32>,
    /// Wavelengths of `spectra` in nm; empty for an RGB file.
    pub wavelengths: Vec<f32>,
    /// Like `rgb`, with one image per wavelength.
    pub spectra: Vec<f32>,
}

/// A BRDF stored over warped directions.
///
/// # Model
/// u(theta) = sqrt(2 theta / pi), v(phi) = (phi + pi) / (2 pi). With the half vector at (u_m, v_m), relative to the
/// incident azimuth if the material is isotropic, s = W(u_m, v_m), where W inverts the sampling by the density of
/// visible microfacets: `f_r cos(theta_o) = rgb(s) ndf(u_m, v_m) / (4 sigma(u_i, v_i))`. All tables are interpolated
/// linearly between nodes. Directions are sampled by `luminance`, then by the visible microfacets.
///
/// # Limits
/// The files hold the product with the outgoing cosine, which is divided out here. The incident direction is the
/// light, as measured. The tables are not exactly reciprocal: a path tracer that uses the viewer as incident
/// direction, as Mitsuba 3 does, gets a different picture towards the horizon. Sampling uses the viewer as incident
/// direction: by reciprocity that is a good density, if not an exact one. Where a file covers half or a quarter of
/// the azimuths, the rest follows by symmetry. Negative RGB (colours outside the gamut) is set to 0.
///
/// # References
/// dupuy2018
#[derive(Debug, Clone)]
pub struct RglBrdf {
    phi_i: Vec<f32>,
    theta_i: Vec<f32>,
    isotropic: bool,
    /// Number of equal parts into which symmetry divides the azimuths: 1, 2 or 4.
    parts: u32,
    ndf: Grid,
    sigma: Grid,
    vndf: Warp,
    luminance: Warp,
    rgb: Colors,
    wavelengths: Vec<f32>,
    spectra: Option<Grid>,
    notes: Notes,
}

impl RglBrdf {
    /// Creates a BRDF from the tables of a file.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the table whose size, order or values are invalid.
    pub fn new(data: RglData, notes: Notes) -> Result<Self> {
        let RglData { phi_i, theta_i, ndf, sigma, vndf, luminance, rgb, wavelengths, spectra } = data;
        for (name, axis) in [("phi_i", &phi_i), ("theta_i", &theta_i)] {
            if axis.is_empty() || !axis.is_sorted_by(|a, b| a < b) {
                return Err(Error::parameter(name, "the angles are not ascending"));
            }
        }
        let nodes = phi_i.len() * theta_i.len();
        let isotropic = phi_i.len() <= 2;
        let parts = match (TAU / (phi_i[phi_i.len() - 1] - phi_i[0])).round() {
            2.0 if !isotropic => 2,
            4.0 if !isotropic => 4,
            _ => 1,
        };
        let spectra = match wavelengths.len() {
            0 => None,
            bands => Some(Grid::new("spectra", luminance.0, nodes * bands, spectra)?),
        };
        Ok(Self {
            isotropic,
            parts,
            ndf: Grid::new("ndf", ndf.0, 1, ndf.1)?,
            sigma: Grid::new("sigma", sigma.0, 1, sigma.1)?,
            vndf: Warp::new("vndf", vndf.0, nodes, vndf.1)?,
            rgb: Colors::new("rgb", luminance.0, nodes, rgb)?,
            luminance: Warp::new("luminance", luminance.0, nodes, luminance.1)?,
            phi_i,
            theta_i,
            wavelengths,
            spectra,
            notes,
        })
    }

    /// The tables around an incident direction, and their weights.
    fn stencil(&self, incident: Vec3) -> Stencil<2> {
        self.stencil_at(theta(incident), azimuth(incident))
    }

    /// Like [`RglBrdf::stencil`]; an isotropic material needs one azimuth only.
    #[inline(always)]
    fn stencil_at<const N: usize>(&self, theta: f32, phi: f32) -> Stencil<N> {
        let (p0, p1, tp) = if N > 1 { bracket(&self.phi_i, phi) } else { (0, 0, 0.0) };
        let (t, _, tt) = bracket(&self.theta_i, theta);
        let all = [(p0, 1.0 - tp), (p1, tp)];
        std::array::from_fn(|i| {
            let (p, w) = all[i];
            Pair { first: p * self.theta_i.len() + t, weights: [w * (1.0 - tt), w * tt] }
        })
    }

    /// The equivalent pair within the measured azimuths.
    #[inline(always)]
    fn fold(&self, a: Vec3, b: Vec3) -> (Vec3, Vec3) {
        let flip = |positive: bool| if positive { -1.0 } else { 1.0 };
        let signs = match self.parts {
            2 => Vec3::new(flip(a.y > 0.0), flip(a.y > 0.0), 1.0),
            4 => Vec3::new(flip(a.x > 0.0), flip(a.y > 0.0), 1.0),
            _ => Vec3::ONE,
        };
        (a * signs, b * signs)
    }

    /// The tables around the light, the position in them, and the factor of their values.
    #[inline(always)]
    fn locate<const N: usize>(&self, at: Angles, cosine_o: f32) -> (Stencil<N>, Vec2, f32) {
        let stencil = self.stencil_at(at.theta_i, at.phi_i);
        let (half, incident) = (at.half_square(), square(at.theta_i, at.phi_i));
        let factor = factor(self.ndf.at(0, half), self.sigma.at(0, incident), cosine_o);
        (stencil, self.vndf.invert(&stencil, half), factor)
    }

    #[inline(always)]
    fn value<const N: usize>(&self, at: Angles, cosine_o: f32) -> Vec3 {
        let (stencil, s, factor) = self.locate::<N>(at, cosine_o);
        color(self.rgb.at(&stencil, s), factor)
    }

    /// The angles at which the tables are looked up.
    fn angles(&self, wi: Vec3, wo: Vec3) -> Angles {
        let find = if self.isotropic { Angles::new::<true> } else { Angles::new::<false> };
        find(wi.to_array(), wo.to_array())
    }

    fn density<const N: usize>(&self, wi: Vec3, wo: Vec3) -> f32 {
        let (incident, out) = self.fold(wo, wi);
        let at = self.angles(incident, out);
        let (stencil, place) = (self.stencil_at::<N>(at.theta_i, at.phi_i), at.half_square());
        let s = self.vndf.invert(&stencil, place);
        let square = self.vndf.density(&stencil, place) * self.luminance.density(&stencil, s);
        density_of(square, place, (incident + out).normalize(), incident)
    }

    /// Draws directions for at most [`BLOCK`] viewers, with their densities.
    #[inline(always)]
    fn draw<const N: usize>(&self, viewers: &[Vec3], random: &[Vec2], bounces: &mut [Bounce]) {
        let count = bounces.len().min(BLOCK);
        // Fold the viewers into the measured azimuths
        let mut incident = [[0.0; BLOCK]; 3];
        for k in 0..count {
            [incident[0][k], incident[1][k], incident[2][k]] = self.fold(viewers[k], viewers[k]).0.to_array();
        }
        let incident = |k: usize| Vec3::new(incident[0][k], incident[1][k], incident[2][k]);
        let [mut theta, mut phi] = [[0.0; BLOCK]; 2];
        for k in 0..BLOCK {
            theta[k] = direction::theta(incident(k));
            phi[k] = if N > 1 { azimuth(incident(k)) } else { 0.0 };
        }
        // Sample by luminance, then by visible microfacets
        let mut between = [([Pair::default(); N], Between::default()); BLOCK];
        let [mut density, mut u, mut v] = [[0.0; BLOCK]; 3];
        for k in 0..count {
            let stencil = self.stencil_at::<N>(theta[k], phi[k]);
            let s;
            (s, density[k]) = self.luminance.warp(&stencil, random[k]);
            between[k] = (stencil, self.vndf.between_rows(&stencil, s));
        }
        for k in 0..count {
            let (place, visible) = self.vndf.along(&between[k].0, between[k].1);
            [u[k], v[k]] = place.to_array();
            density[k] *= visible;
        }
        // Reflect the viewers at the half vectors
        let [mut x, mut y, mut z, mut pdf] = [[0.0; BLOCK]; 4];
        for k in 0..BLOCK {
            let (place, incident) = (Vec2::new(u[k], v[k]), incident(k));
            let half = self.half_at(place, incident);
            let out = 2.0 * incident.dot(half) * half - incident;
            [x[k], y[k], z[k]] = out.to_array();
            let density = density_of(density[k], place, half, incident);
            let is_above = incident.z > 0.0 && out.z > 0.0 && incident.dot(half) > 0.0;
            pdf[k] = if is_above && density < f32::INFINITY { density } else { 0.0 };
        }
        for k in 0..count {
            let wo = viewers[k];
            let signs = Vec3::new(sign(wo.x, incident(k).x), sign(wo.y, incident(k).y), 1.0);
            (bounces[k].wi, bounces[k].pdf) = (Vec3::new(x[k], y[k], z[k]) * signs, pdf[k]);
        }
    }

    /// The apparent values for at most [`BLOCK`] lights and as many viewers.
    fn apparent_block(&self, lights: &[Vec3], viewers: &[Vec3], found: &mut [Vec3]) {
        let (mut wi, mut wo) = ([[0.0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
        for (k, (&i, &o)) in lights.iter().zip(viewers).enumerate() {
            let (i, o) = self.fold(i, o);
            (0..3).for_each(|axis| (wi[axis][k], wo[axis][k]) = (i[axis], o[axis]));
        }
        if self.isotropic {
            values::<1>(self, &wi, &wo, found)
        } else {
            values::<2>(self, &wi, &wo, found)
        }
        for ((value, wi), wo) in found.iter_mut().zip(lights).zip(viewers) {
            // This form of the condition also rejects NaN
            let is_above = wi.z > 0.0 && wo.z > 0.0;
            *value = if is_above { *value * (PI * wi.z) } else { Vec3::ZERO };
        }
    }

    /// The half vector at a position in the tables, for an incident direction.
    #[inline(always)]
    fn half_at(&self, place: Vec2, incident: Vec3) -> Vec3 {
        let (sin, cos) = sin_cos_turns(0.25 * place.x * place.x);
        let (sp, cp) = sin_cos_turns(place.y);
        // azimuths count from -pi
        let around = Vec2::new(-cp, -sp);
        let base = if self.isotropic { incident.truncate().normalize_or(Vec2::X) } else { Vec2::X };
        (base.rotate(around) * sin).extend(cos)
    }

    /// The pair of directions at a node of the warped table.
    fn node_directions(&self, node: usize, s: Vec2) -> Option<(Vec3, Vec3)> {
        let wi = from_angles(self.theta_i[node % self.theta_i.len()], self.phi_i[node / self.theta_i.len()]);
        let (place, _) = self.vndf.warp(&self.stencil(wi), s);
        let half = self.half_at(place, wi);
        let wo = 2.0 * wi.dot(half) * half - wi;
        // Near the horizon, dividing by the cosine amplifies noise
        (wi.z > 0.01 && wo.z > 0.01).then_some((wi, wo))
    }
}

/// Angles at which the tables are looked up, radians.
#[derive(Debug, Clone, Copy, Default)]
struct Angles {
    theta_m: f32,
    /// Azimuth of the half vector, relative to the incident direction if the material is isotropic.
    phi_m: f32,
    theta_i: f32,
    /// 0 if the material is isotropic.
    phi_i: f32,
}

impl Angles {
    #[inline(always)]
    fn new<const ISOTROPIC: bool>(i: [f32; 3], o: [f32; 3]) -> Self {
        // the angles do not depend on the length of the half vector
        let m = [i[0] + o[0], i[1] + o[1], i[2] + o[2]];
        let theta = |w: [f32; 3]| atan2((w[0] * w[0] + w[1] * w[1]).sqrt(), w[2]);
        let (phi_m, phi_i) = if ISOTROPIC {
            // at the pole the azimuth is 0
            let x = if i[0] == 0.0 && i[1] == 0.0 { 1.0 } else { i[0] };
            (atan2(m[1] * x - m[0] * i[1], m[0] * x + m[1] * i[1]), 0.0)
        } else {
            (atan2(m[1], m[0]), atan2(i[1], i[0]))
        };
        Self { theta_m: theta(m), phi_m, theta_i: theta(i), phi_i }
    }

    #[inline(always)]
    fn half_square(self) -> Vec2 {
        square(self.theta_m, self.phi_m)
    }
}

/// A direction in the unit square.
#[inline(always)]
fn square(theta: f32, phi: f32) -> Vec2 {
    Vec2::new((theta * (2.0 / PI)).sqrt(), (phi + PI) * (1.0 / TAU))
}

wide! {
    /// The BRDF at a block of pairs, coordinates `[axis][pair]`.
    fn values<const N: usize>(brdf: &RglBrdf, wi: &[Lane; 3], wo: &[Lane; 3], values: &mut [Vec3]) {
        let zero = [0.0; BLOCK];
        let (mut half, mut incident, [mut theta_i, mut phi_i]) = ([zero; 2], [zero; 2], [zero; 2]);
        for k in 0..BLOCK {
            let (i, o) = ([wi[0][k], wi[1][k], wi[2][k]], [wo[0][k], wo[1][k], wo[2][k]]);
            let angles = if N == 1 { Angles::new::<true>(i, o) } else { Angles::new::<false>(i, o) };
            [half[0][k], half[1][k]] = angles.half_square().to_array();
            [incident[0][k], incident[1][k]] = square(angles.theta_i, angles.phi_i).to_array();
            (theta_i[k], phi_i[k]) = (angles.theta_i, angles.phi_i);
        }
        // Find the tables and prefetch them
        let cells = brdf.vndf.cells(&half);
        let mut stencils = [[Pair::default(); N]; BLOCK];
        for k in 0..BLOCK {
            stencils[k] = brdf.stencil_at(theta_i[k], phi_i[k]);
            brdf.vndf.prefetch(&stencils[k], cells.get(k));
        }
        let (facets, shadows) = (brdf.ndf.cells(&half), brdf.sigma.cells(&incident));
        let [mut ndf, mut sigma] = [zero; 2];
        for k in 0..BLOCK {
            (ndf[k], sigma[k]) = (brdf.ndf.at_cell(0, facets.get(k)), brdf.sigma.at_cell(0, shadows.get(k)));
        }
        let mut factor = zero;
        for k in 0..BLOCK {
            factor[k] = self::factor(ndf[k], sigma[k], wo[2][k]);
        }
        // Map half vectors to the square of the reflectance
        let mut around = [(Vec4::ZERO, Vec4::ZERO); BLOCK];
        for k in 0..BLOCK {
            around[k] = brdf.vndf.around(&stencils[k], cells.get(k));
        }
        let mut places = [zero; 2];
        for k in 0..BLOCK {
            let (sides, rows) = around[k];
            [places[0][k], places[1][k]] = brdf.vndf.integrate(sides, rows, cells.get(k), half[0][k]).to_array();
        }
        let cells = brdf.rgb.cells(&places);
        for (k, value) in values.iter_mut().enumerate().take(BLOCK) {
            *value = color(brdf.rgb.at_cell(&stencils[k], cells.get(k)), factor[k]);
        }
    }
}

wide! {
    /// Draws directions for at most [`BLOCK`] viewers.
    fn draw_block(brdf: &RglBrdf, viewers: &[Vec3], random: &[Vec2], bounces: &mut [Bounce]) {
        if brdf.isotropic {
            brdf.draw::<1>(viewers, random, bounces);
        } else {
            brdf.draw::<2>(viewers, random, bounces);
        }
    }
}

/// The factor of the tabulated colours.
#[inline(always)]
fn factor(ndf: f32, sigma: f32, cosine_o: f32) -> f32 {
    ndf / (4.0 * sigma * cosine_o.max(1e-4)).max(1e-12)
}

#[inline(always)]
fn color(rgb: Vec4, factor: f32) -> Vec3 {
    (rgb.max(Vec4::ZERO) * factor).truncate()
}

/// atan2, in (-pi, pi], as the files count it.
#[inline(always)]
fn azimuth(w: Vec3) -> f32 {
    atan2(w.y, w.x)
}

impl Material for RglBrdf {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.eval(uv, wi, wo) * (PI * wi.z.max(0.0))
    }

    fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        // This form of the condition also rejects NaN
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return Vec3::ZERO;
        }
        let (wi, wo) = self.fold(wi, wo);
        let angles = self.angles(wi, wo);
        if self.isotropic { self.value::<1>(angles, wo.z) } else { self.value::<2>(angles, wo.z) }
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: false, energy_conserving: false, isotropic: self.isotropic }
    }

    fn sample(&self, _uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        let mut bounce = [Bounce::NONE];
        draw_block(self, &[wo], &[random], &mut bounce);
        let [Bounce { wi, pdf, .. }] = bounce;
        (pdf > 0.0).then_some(Sample { wi, pdf })
    }

    fn pdf(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        match wi.z > 0.0 && wo.z > 0.0 {
            true if self.isotropic => self.density::<1>(wi, wo),
            true => self.density::<2>(wi, wo),
            false => 0.0,
        }
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        Box::new(RglPoints { brdf: self, points })
    }
}

/// Points evaluated in blocks; nothing is prepared.
struct RglPoints<'a> {
    brdf: &'a RglBrdf,
    points: &'a [Point],
}

impl RglPoints<'_> {
    fn viewer(&self, index: u32) -> Vec3 {
        self.points[index as usize].wo
    }
}

impl Prepared for RglPoints<'_> {
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        let mut viewers = [Vec3::Z; BLOCK];
        for ((index, wi), values) in index.chunks(BLOCK).zip(wi.chunks(BLOCK)).zip(values.chunks_mut(BLOCK)) {
            viewers.iter_mut().zip(index).for_each(|(viewer, &index)| *viewer = self.viewer(index));
            self.brdf.apparent_block(wi, &viewers, values);
        }
    }

    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        let (mut viewers, mut wi, mut values) = ([Vec3::Z; BLOCK], [Vec3::Z; BLOCK], [Vec3::ZERO; BLOCK]);
        for ((index, random), bounces) in index.chunks(BLOCK).zip(random.chunks(BLOCK)).zip(bounces.chunks_mut(BLOCK)) {
            viewers.iter_mut().zip(index).for_each(|(viewer, &index)| *viewer = self.viewer(index));
            draw_block(self.brdf, &viewers, random, bounces);
            wi.iter_mut().zip(&*bounces).for_each(|(wi, bounce)| *wi = bounce.wi);
            self.brdf.apparent_block(&wi[..bounces.len()], &viewers, &mut values[..bounces.len()]);
            bounces.iter_mut().zip(values).for_each(|(bounce, value)| bounce.value = value);
        }
    }

    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]) {
        for ((density, &index), &wi) in densities.iter_mut().zip(index).zip(wi) {
            *density = self.brdf.pdf(Vec2::ZERO, wi, self.viewer(index));
        }
    }
}

/// The density per solid angle of a light, from the density of the half vector in the unit square.
#[inline(always)]
fn density_of(square: f32, place: Vec2, half: Vec3, incident: Vec3) -> f32 {
    let sin = half.truncate().length();
    square / ((2.0 * PI * PI * place.x * sin).max(1e-6) * 4.0 * incident.dot(half).max(1e-6))
}

/// -1 if folding changed the sign of a coordinate, otherwise 1.
#[inline(always)]
fn sign(before: f32, after: f32) -> f32 {
    if before == after { 1.0 } else { -1.0 }
}

impl Brdf for RglBrdf {
    fn samples(&self) -> Vec<BrdfSample> {
        let [rows, columns] = self.luminance.size();
        let mut samples = Vec::new();
        for node in 0..self.phi_i.len() * self.theta_i.len() {
            for i in 0..rows * columns {
                let s =
                    Vec2::new((i % columns) as f32 / (columns - 1) as f32, (i / columns) as f32 / (rows - 1) as f32);
                if let Some((wi, wo)) = self.node_directions(node, s) {
                    samples.push(BrdfSample { wi, wo, value: self.eval(Vec2::ZERO, wi, wo) });
                }
            }
        }
        samples
    }

    fn notes(&self) -> &Notes {
        &self.notes
    }

    fn wavelengths(&self) -> &[f32] {
        &self.wavelengths
    }

    fn spectrum(&self, wi: Vec3, wo: Vec3) -> Vec<f32> {
        let bands = self.wavelengths.len();
        let Some(spectra) = self.spectra.as_ref().filter(|_| wi.z > 0.0 && wo.z > 0.0) else { return vec![0.0; bands] };
        let (wi, wo) = self.fold(wi, wo);
        let (stencil, s, factor) = self.locate::<2>(self.angles(wi, wo), wo.z);
        let nodes = stencil.iter().flat_map(|pair| [(pair.first, pair.weights[0]), (pair.first + 1, pair.weights[1])]);
        let nodes: Vec<_> = nodes.filter(|&(_, weight)| weight > 0.0).collect();
        let at = |band: usize| nodes.iter().map(|&(node, w)| w * spectra.at(node * bands + band, s)).sum::<f32>();
        let band = |band| at(band).max(0.0) * factor;
        (0..bands).map(band).collect()
    }
}
