//! Converts any material to the tables of a `.bsdf` file.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::warp::{Grid, Pair, Stencil, Warp};
use super::{RglData, azimuth};
use crate::color::luminance;
use crate::direction::from_angles;
use crate::material::Material;
use crate::material::sampler::mean_around;

/// Number of incident polar angles.
const THETAS: usize = 16;
/// Number of incident azimuths for an anisotropic material; the first and last coincide.
const PHIS: usize = 17;
/// Side of the tables of microfacets.
const FACETS: usize = 128;
/// Side of the tables of reflectance.
const SIDE: usize = 64;
/// Integration steps over half vectors: polar angle, azimuth.
const STEPS: [usize; 2] = [256, 32];

impl RglData {
    /// Tabulates a material.
    ///
    /// # Model
    /// The density of microfacets is the mean reflectance over difference angles for each half vector; sigma and the
    /// density of visible microfacets follow from it. The reflectance is evaluated at the nodes of the warped square
    /// and divided by the factors that a reader multiplies by, so that nodes are exact.
    pub fn tabulate(material: &dyn Material) -> Self {
        let isotropic = material.promises().isotropic;
        let value = |wi: Vec3, wo: Vec3| material.eval(Vec2::ZERO, wi, wo);
        let phi_i: Vec<f32> =
            if isotropic { vec![0.0] } else { (0..PHIS).map(|i| i as f32 / (PHIS - 1) as f32 * TAU - PI).collect() };
        // exactly grazing light has no reflectance
        let theta_i: Vec<f32> = (0..THETAS).map(|i| i as f32 / (THETAS - 1) as f32 * 89.5f32.to_radians()).collect();
        let rows = if isotropic { 2 } else { FACETS };
        let ndf = density(isotropic, rows, &value);
        let facets = Facets::new(isotropic, Grid::unchecked([rows, FACETS], ndf.clone()));
        let sigma_at = |i: usize| {
            let (x, y) = (i % FACETS, i / FACETS);
            let theta = (x as f32 / (FACETS - 1) as f32).powi(2) * FRAC_PI_2;
            facets.projected(from_angles(theta.min(89.9f32.to_radians()), TAU * y as f32 / (rows - 1) as f32 - PI))
        };
        let sigma: Vec<f32> = (0..rows * FACETS).into_par_iter().map(sigma_at).collect();
        let nodes: Vec<Vec3> = phi_i.iter().flat_map(|&p| theta_i.iter().map(move |&t| from_angles(t, p))).collect();
        let vndf: Vec<f32> = nodes.par_iter().flat_map_iter(|&wi| facets.visible(wi)).collect();
        let mut data = Self {
            phi_i,
            theta_i,
            ndf: ([rows, FACETS], ndf),
            sigma: ([rows, FACETS], sigma),
            vndf: ([FACETS, FACETS], vndf),
            ..Self::default()
        };
        data.reflectance(&facets, &nodes, &value);
        data
    }

    fn reflectance(&mut self, facets: &Facets, nodes: &[Vec3], value: &(impl Fn(Vec3, Vec3) -> Vec3 + Sync)) {
        let sigma = Grid::unchecked(self.sigma.0, self.sigma.1.clone());
        let tables = nodes.par_iter().enumerate().map(|(node, &wi)| {
            let count = FACETS * FACETS;
            let warp = Warp::unchecked([FACETS, FACETS], self.vndf.1[node * count..(node + 1) * count].to_vec());
            let own: Stencil<1> = [Pair { first: 0, weights: [1.0, 0.0] }];
            let incident = Vec2::new((crate::direction::theta(wi) * 2.0 / PI).sqrt(), (azimuth(wi) + PI) / TAU);
            let at = |i: usize| {
                let s = Vec2::new((i % SIDE) as f32, (i / SIDE) as f32) / (SIDE - 1) as f32;
                let (place, _) = warp.warp(&own, s);
                let half = facets.half(wi, place);
                let wo = 2.0 * wi.dot(half) * half - wi;
                let factor = 4.0 * sigma.at(0, incident) / facets.grid.at(0, place).max(1e-12);
                if wo.z > 0.0 { value(wi, wo).max(Vec3::ZERO) * (wo.z * factor) } else { Vec3::ZERO }
            };
            (0..SIDE * SIDE).map(at).collect::<Vec<Vec3>>()
        });
        let tables: Vec<Vec<Vec3>> = tables.collect();
        self.luminance.0 = [SIDE, SIDE];
        for table in &tables {
            self.luminance.1.extend(table.iter().map(|v| luminance(v.to_array())));
            (0..3).for_each(|channel| self.rgb.extend(table.iter().map(|v| v[channel])));
        }
        // store densities normalised to integral 1
        for (values, size) in [(&mut self.vndf.1, FACETS * FACETS), (&mut self.luminance.1, SIDE * SIDE)] {
            for table in values.chunks_exact_mut(size) {
                let side = if size == SIDE * SIDE { SIDE } else { FACETS };
                super::warp::normalise(table, side);
            }
        }
    }
}

/// The density of microfacets over (phi_m, theta_m), normalised to a projected area of 1.
fn density(isotropic: bool, rows: usize, value: &(impl Fn(Vec3, Vec3) -> Vec3 + Sync)) -> Vec<f32> {
    let at = |i: usize| {
        let (x, y) = (i % FACETS, i / FACETS);
        // stay half a step away from the pole, which may be an isolated peak
        let u = (x as f32).max(0.25) / (FACETS - 1) as f32;
        let phi = if isotropic { 0.0 } else { TAU * y as f32 / (rows - 1) as f32 - PI };
        mean_around(from_angles((u * u * FRAC_PI_2).min(89.5f32.to_radians()), phi), value)
    };
    let mut ndf: Vec<f32> = (0..rows * FACETS).into_par_iter().map(at).collect();
    // keep the density positive where nothing was seen, so that the table reaches there
    let largest = ndf.iter().copied().fold(0.0, f32::max);
    let floor = if largest > 0.0 { 1e-4 * largest } else { 1.0 };
    ndf.iter_mut().for_each(|v| *v = v.max(floor));
    let grid = Grid::unchecked([rows, FACETS], ndf.clone());
    let whole = Facets::new(isotropic, grid).projected(Vec3::Z);
    ndf.iter_mut().for_each(|v| *v /= whole);
    ndf
}

struct Facets {
    isotropic: bool,
    grid: Grid,
    /// Half vectors and the microfacet area around them, for incident azimuth 0 if isotropic.
    points: Vec<(Vec3, f32)>,
}

impl Facets {
    fn new(isotropic: bool, grid: Grid) -> Self {
        let [thetas, phis] = STEPS;
        let point = |i: usize| {
            let place =
                Vec2::new(((i % thetas) as f32 + 0.5) / thetas as f32, ((i / thetas) as f32 + 0.5) / phis as f32);
            let half = from_angles(place.x * place.x * FRAC_PI_2, TAU * place.y - PI);
            let jacobian = 2.0 * PI * PI * place.x * half.truncate().length();
            (half, grid.at(0, place) * jacobian / (thetas * phis) as f32)
        };
        let points = (0..thetas * phis).map(point).collect();
        Self { isotropic, grid, points }
    }

    /// The half vector at a point of the unit square.
    fn half(&self, wi: Vec3, place: Vec2) -> Vec3 {
        let base = if self.isotropic { azimuth(wi) } else { 0.0 };
        from_angles(place.x * place.x * FRAC_PI_2, TAU * place.y - PI + base)
    }

    /// The microfacet area seen from `wi`.
    fn projected(&self, wi: Vec3) -> f32 {
        let wi = if self.isotropic { from_angles(crate::direction::theta(wi), 0.0) } else { wi };
        self.points.iter().map(|&(half, area)| f64::from(wi.dot(half).max(0.0) * area)).sum::<f64>() as f32
    }

    fn visible_at(&self, wi: Vec3, place: Vec2) -> f32 {
        let half = self.half(wi, place);
        let jacobian = 2.0 * PI * PI * place.x * half.truncate().length();
        self.grid.at(0, place) * wi.dot(half).max(0.0) * jacobian
    }

    /// The density of visible microfacets over the square, not normalised.
    fn visible(&self, wi: Vec3) -> impl Iterator<Item = f32> + '_ {
        (0..FACETS * FACETS).map(move |i| {
            let place = Vec2::new((i % FACETS) as f32, (i / FACETS) as f32) / (FACETS - 1) as f32;
            self.visible_at(wi, place)
        })
    }
}
