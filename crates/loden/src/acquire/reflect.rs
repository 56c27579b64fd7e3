//! Reflection at a surface point: a diffuse base under a GGX coat, which may be that of fibres.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::field::Finish;
use crate::direction::{Frame, cosine_hemisphere};

/// Lights per block, so that loops over a block vectorise.
pub(super) const LANES: usize = 8;

/// # Model
/// f = albedo/pi (1 - F(n.wi)) (1 - F(n.wo)) + D G F(h.wi) / (4 (n.wi) (n.wo)) with the GGX distribution D, Smith's G =
/// G1(wi) G1(wo) and Schlick's F = f0 + (f90 - f0) (1 - cos)^5, where f90 = min(1, 25 max f0), so a black f0 leaves
/// only the diffuse base. Reciprocal and energy-conserving.
///
/// # Limits
/// Multiple scattering between microfacets is missing, so rough metals are too dark.
///
/// # References
/// walter2007 (eq. 20, 33, 34), schlick1994 (eq. 15), ashikhmin2000 (the idea of the diffuse factor)
#[derive(Debug, Clone, Copy)]
pub(super) struct Reflector<F = Isotropic> {
    n: Vec3,
    wo: Vec3,
    no: f32,
    albedo: Vec3,
    f0: Vec3,
    f90: f32,
    facets: F,
}

/// The distribution of microfacets around a normal n: directions are given by their components along n and along two axes
/// of the surface.
pub(super) trait Facets: Copy {
    /// The axes.
    fn axes(&self) -> [Vec3; 2];

    /// c + sqrt(c^2 + alpha^2 (1 - c^2)) for a direction with the component c along n, where alpha is the roughness in its
    /// azimuth; Smith's G1 is 2 c divided by this.
    fn smith(&self, c: f32, axes: [f32; 2]) -> f32;

    /// The density of facets, 1/sr.
    fn distribution(&self, c: f32, axes: [f32; 2]) -> f32;

    /// Samples a normal that is visible from `wo`.
    fn visible_normal(&self, n: Vec3, wo: Vec3, random: Vec2) -> Vec3;
}

/// Facets that are equally rough in all directions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Isotropic {
    /// Squared roughness alpha.
    a2: f32,
}

impl Facets for Isotropic {
    #[inline(always)]
    fn axes(&self) -> [Vec3; 2] {
        [Vec3::ZERO; 2]
    }

    #[inline(always)]
    fn smith(&self, c: f32, _axes: [f32; 2]) -> f32 {
        c + (self.a2 + (1.0 - self.a2) * c * c).sqrt()
    }

    #[inline(always)]
    fn distribution(&self, c: f32, _axes: [f32; 2]) -> f32 {
        let d = c * c * (self.a2 - 1.0) + 1.0;
        self.a2 / (PI * d * d)
    }

    #[inline(always)]
    fn visible_normal(&self, n: Vec3, wo: Vec3, random: Vec2) -> Vec3 {
        let frame = Frame::from_normal(n);
        frame.world(visible_normal(frame.local(wo), [self.a2.sqrt(); 2], random))
    }
}

/// Facets of fibres, which lie along a tangent: their normals spread across it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fibrous {
    axes: [Vec3; 2],
    /// Roughness alpha along and across.
    alpha: [f32; 2],
}

impl Fibrous {
    /// Facets around the unit normal `n` with the tangent of any length; a tangent along the normal is replaced.
    #[inline(always)]
    pub(super) fn new(n: Vec3, tangent: Vec3, alpha: [f32; 2]) -> Self {
        let frame = Frame::from_normal_tangent(n, tangent);
        Self { axes: [frame.tangent, frame.bitangent], alpha }
    }
}

impl Facets for Fibrous {
    #[inline(always)]
    fn axes(&self) -> [Vec3; 2] {
        self.axes
    }

    #[inline(always)]
    fn smith(&self, c: f32, [x, y]: [f32; 2]) -> f32 {
        let (x, y) = (self.alpha[0] * x, self.alpha[1] * y);
        c + (c * c + x * x + y * y).sqrt()
    }

    #[inline(always)]
    fn distribution(&self, c: f32, [x, y]: [f32; 2]) -> f32 {
        let (x, y) = (x / self.alpha[0], y / self.alpha[1]);
        let d = c * c + x * x + y * y;
        1.0 / (PI * self.alpha[0] * self.alpha[1] * d * d)
    }

    #[inline(always)]
    fn visible_normal(&self, n: Vec3, wo: Vec3, random: Vec2) -> Vec3 {
        let [x, y] = self.axes;
        let h = visible_normal(Vec3::new(x.dot(wo), y.dot(wo), n.dot(wo)), self.alpha, random);
        x * h.x + y * h.y + n * h.z
    }
}

/// Light directions by component, padded to a multiple of [`LANES`].
#[derive(Debug, Clone, Default)]
pub(super) struct Lights {
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub z: Vec<f32>,
}

#[inline(always)]
fn fifth(cosine: f32) -> f32 {
    let m = 1.0 - cosine;
    let m2 = m * m;
    m2 * m2 * m
}

impl Reflector {
    #[inline(always)]
    pub(super) fn new(n: Vec3, wo: Vec3, finish: &Finish) -> Self {
        let facets = Isotropic { a2: finish.roughness * finish.roughness };
        Self::with(n, wo, [finish.albedo, finish.f0].map(Vec3::from), facets)
    }
}

impl<F: Facets> Reflector<F> {
    /// A base of some albedo under a coat with the reflectance f0.
    #[inline(always)]
    pub(super) fn with(n: Vec3, wo: Vec3, [albedo, f0]: [Vec3; 2], facets: F) -> Self {
        let f90 = (25.0 * f0.max_element()).min(1.0);
        Self { n, wo, no: n.dot(wo).max(1e-4), albedo, f0, f90, facets }
    }

    /// The unit normal.
    #[inline(always)]
    pub(super) fn normal(&self) -> Vec3 {
        self.n
    }

    #[inline(always)]
    fn along(&self, w: Vec3) -> [f32; 2] {
        self.facets.axes().map(|axis| axis.dot(w))
    }

    #[inline(always)]
    fn smith_o(&self) -> f32 {
        self.facets.smith(self.no, self.along(self.wo))
    }

    #[inline(always)]
    fn fresnel(&self, channel: usize, fifth: f32) -> f32 {
        self.f0[channel] + (self.f90 - self.f0[channel]) * fifth
    }

    /// f times the cosine of `wi`.
    #[inline(always)]
    pub(super) fn eval(&self, wi: Vec3) -> Vec3 {
        let ni = self.n.dot(wi);
        if ni <= 0.0 {
            return Vec3::ZERO;
        }
        let h = (wi + self.wo).normalize();
        let (fi, fo, fh) = (fifth(ni), fifth(self.no), fifth(h.dot(wi).clamp(0.0, 1.0)));
        let smith = self.facets.smith(ni, self.along(wi)) * self.smith_o();
        let lobe = self.facets.distribution(self.n.dot(h), self.along(h)) * ni / smith;
        let value = |k: usize| {
            let diffuse = self.albedo[k] / PI * (1.0 - self.fresnel(k, fi)) * (1.0 - self.fresnel(k, fo)) * ni;
            diffuse + lobe * self.fresnel(k, fh)
        };
        Vec3::new(value(0), value(1), value(2))
    }

    /// Probability of sampling the coat.
    #[inline(always)]
    fn coat_share(&self) -> f32 {
        let fo = fifth(self.no);
        let coat: f32 = (0..3).map(|k| self.fresnel(k, fo)).sum();
        let base: f32 = (0..3).map(|k| self.albedo[k] * (1.0 - self.fresnel(k, fo))).sum();
        if coat > 0.0 { coat / (coat + base) } else { 0.0 }
    }

    /// Density of [`Reflector::sample`] in 1/sr.
    #[inline(always)]
    pub(super) fn pdf(&self, wi: Vec3) -> f32 {
        let ni = self.n.dot(wi);
        if ni <= 0.0 {
            return 0.0;
        }
        let share = self.coat_share();
        let base = (1.0 - share) * ni / PI;
        if share == 0.0 {
            return base;
        }
        let h = (wi + self.wo).normalize();
        // visible normals: G1(wo) D (h.wo) / (n.wo), divided by the Jacobian 4 (h.wo)
        base + share * self.facets.distribution(self.n.dot(h), self.along(h)) / (2.0 * self.smith_o())
    }

    /// Samples the direction of the incident light: the direction, and f cos / pdf.
    #[inline(always)]
    pub(super) fn sample(&self, random: Vec2, choice: f32) -> Option<(Vec3, Vec3)> {
        let share = self.coat_share();
        let wi = if choice < share {
            let h = self.facets.visible_normal(self.n, self.wo, random);
            2.0 * self.wo.dot(h) * h - self.wo
        } else {
            Frame::from_normal(self.n).world(cosine_hemisphere(random))
        };
        let cosine = self.n.dot(wi);
        if cosine.is_nan() || cosine <= 1e-6 {
            return None;
        }
        let weight = if share == 0.0 { self.albedo } else { self.eval(wi) / self.pdf(wi) };
        Some((wi, weight))
    }

    /// Adds `throughput` times pi f cos for every light to `sum` (red, green, blue). `lit` holds the visibility of each
    /// light, 0 or 1.
    #[inline(always)]
    pub(super) fn add_lights(&self, lights: &Lights, lit: &[f32], throughput: Vec3, sum: [&mut [f32]; 3]) {
        let [red, green, blue] = sum;
        let (x, _) = lights.x.as_chunks::<LANES>();
        let (y, _) = lights.y.as_chunks::<LANES>();
        let (z, _) = lights.z.as_chunks::<LANES>();
        let (lit, _) = lit.as_chunks::<LANES>();
        let ((red, _), (green, _)) = (red.as_chunks_mut::<LANES>(), green.as_chunks_mut::<LANES>());
        let (blue, _) = blue.as_chunks_mut::<LANES>();
        let matt = self.f90 == 0.0;
        for k in 0..x.len().min(lit.len()).min(red.len()).min(green.len()).min(blue.len()) {
            let ni: [f32; LANES] = std::array::from_fn(|i| {
                (self.n.x * x[k][i] + self.n.y * y[k][i] + self.n.z * z[k][i]).max(0.0) * lit[k][i]
            });
            let sums = [&mut red[k], &mut green[k], &mut blue[k]];
            if matt {
                for (c, sum) in sums.into_iter().enumerate() {
                    let scale = throughput[c] * self.albedo[c];
                    (0..LANES).for_each(|i| sum[i] += scale * ni[i]);
                }
            } else {
                self.add_coated([&x[k], &y[k], &z[k]], &ni, throughput, sums);
            }
        }
    }

    #[inline(always)]
    fn add_coated(&self, w: [&[f32; LANES]; 3], ni: &[f32; LANES], throughput: Vec3, sums: [&mut [f32; LANES]; 3]) {
        let Self { n, wo, no, facets, .. } = *self;
        let (smith_o, axes, of_wo) = (self.smith_o(), facets.axes(), self.along(wo));
        let (mut fi, mut fh, mut lobe) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let nl = n.x * w[0][i] + n.y * w[1][i] + n.z * w[2][i];
            let half = ((wo.x * w[0][i] + wo.y * w[1][i] + wo.z * w[2][i]) * 0.5 + 0.5).max(1e-12);
            // |wi + wo| is twice the cosine at the half vector
            let cos_h = half.sqrt();
            let nh = (nl + no) / (2.0 * cos_h);
            let of_wi = axes.map(|axis| axis.x * w[0][i] + axis.y * w[1][i] + axis.z * w[2][i]);
            let of_h = [0, 1].map(|k| (of_wi[k] + of_wo[k]) / (2.0 * cos_h));
            fi[i] = fifth(ni[i]);
            fh[i] = fifth(cos_h);
            lobe[i] = PI * facets.distribution(nh, of_h) * ni[i] / (facets.smith(ni[i], of_wi) * smith_o);
        }
        let fo = fifth(no);
        for (c, sum) in sums.into_iter().enumerate() {
            let (f0, rise) = (self.f0[c], self.f90 - self.f0[c]);
            let base = throughput[c] * self.albedo[c] * (1.0 - f0 - rise * fo);
            for i in 0..LANES {
                sum[i] += base * (1.0 - f0 - rise * fi[i]) * ni[i] + throughput[c] * lobe[i] * (f0 + rise * fh[i]);
            }
        }
    }
}

/// Samples a visible normal of the GGX distribution for `wo`, both in the local frame.
///
/// # References
/// dupuy2023 (listing 3)
#[inline(always)]
fn visible_normal(wo: Vec3, [x, y]: [f32; 2], random: Vec2) -> Vec3 {
    let stretched = Vec3::new(wo.x * x, wo.y * y, wo.z).normalize();
    let (sin, cos) = (2.0 * PI * random.x).sin_cos();
    let z = (1.0 - random.y) * (1.0 + stretched.z) - stretched.z;
    let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let h = Vec3::new(r * cos, r * sin, z) + stretched;
    Vec3::new(h.x * x, h.y * y, h.z.max(1e-6)).normalize()
}
