//! Physical optics of a Gaussian rough surface.

use std::f64::consts::PI;
use std::sync::LazyLock;

use glam::{DVec2, DVec3};

use super::analytic::{diffuse_pdf, diffuse_sample};
use super::fresnel::{Fresnel, Interface};
use super::lambert::diffuse_term;
use super::lobe::{half, mirror, power_pdf, power_sample, reflect};
use super::microfacet::{Roughness, beckmann, beckmann_sample};
use super::{Costly, KD, KS, Model, Shape, Terms};
use crate::Result;
use crate::material::Promises;
use crate::params::{Param, Params, Values};
use crate::simd::{self, wide};

/// # Model
/// Heights have standard deviation s0 and a Gaussian correlation of length tau; each channel has the wavelength l of
/// red, green or blue light (610, 550, 465 nm). Let g = (2 pi s / l (c_i + c_o))^2, where s <= s0 is the roughness
/// visible to light and view; S = S(wi) S(wo) the shadowing; and |F|^2 the exact reflectance at half the angle
/// between light and view. Then f = kd/pi + ks |F|^2 S (specular + directional-diffuse): specular = e^-g / (c dw) in
/// the mirror direction; directional-diffuse = G D / (pi c_i c_o) with D = (pi tau / (2 l))^2 sum over m of g^m e^-g
/// / (m! m) exp(-(v_xy tau)^2 / (4 m)), G = (v.v / v_z)^2, and v the difference of the wave vectors in units of 2 pi
/// / l. The uniform diffuse part is kd.
///
/// # Limits
/// Unpolarised light only. In the paper the specular part is a perfect mirror, seen through the solid angle of the
/// instrument; here that solid angle is a cosine power of half width `aperture`, so that it has a finite value. It is
/// divided by the larger of both cosines, which keeps it reciprocal. Energy is not conserved exactly at grazing
/// angles.
///
/// # References
/// he1991 (eq. 66-83). For unpolarised light the paper's quotient of polarisation products in G is 1: both axes of
/// polarisation are perpendicular to their ray.
pub(super) struct HeTorranceModel;

/// Wavelengths of red, green and blue light in micrometres.
const WAVELENGTH: [f64; 3] = [0.610, 0.550, 0.465];

crate::params! {
    struct Options {
        kd: [f64; 3] => KD,
        ks: [f64; 3] => KS,
        /// Standard deviation of the heights.
        sigma: f64 [0.0..=20.0, "micrometres"] = 0.3,
        /// Correlation length of the heights.
        tau: f64 [0.05..=200.0, "micrometres"] = 2.5,
        /// Half the angle that the mirror image of a point subtends.
        aperture: f64 [0.1..=20.0, "degrees"] = 3,
        interface: Interface,
    }
}

impl Model for HeTorranceModel {
    fn name(&self) -> &'static str {
        "he-torrance"
    }

    fn doc(&self) -> &'static str {
        "Physical optics of a Gaussian rough surface: specular, directional-diffuse and uniform-diffuse."
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn colors(&self) -> &'static [&'static str] {
        &["kd", "ks"]
    }

    fn costly(&self) -> &'static [&'static str] {
        &["sigma", "tau"]
    }

    fn shape(&self, values: &Values) -> Result<Box<dyn Shape>> {
        let Options { sigma, tau, aperture, interface, .. } = Options::from_values(values)?;
        let exponent = 0.5f64.ln() / aperture.to_radians().cos().ln();
        Ok(Box::new(HeTorrance { sigma, tau, exponent, fresnel: interface.fresnel() }))
    }
}

#[derive(Debug)]
struct HeTorrance {
    sigma: f64,
    tau: f64,
    /// Exponent of the lobe that stands for the mirror direction.
    exponent: f64,
    fresnel: Fresnel,
}

impl HeTorrance {
    /// tau cot(theta) / (2 s0).
    fn steepness(&self, w: DVec3) -> f64 {
        let sin = w.truncate().length();
        if sin > 0.0 { self.tau * w.z / (2.0 * self.sigma * sin) } else { f64::INFINITY }
    }

    /// The fraction of the surface that does not shadow itself from `w`, and the effective slope of `w` below the
    /// tops: tan(theta) erfc(steepness).
    fn shadowing(&self, w: DVec3) -> (f64, f64) {
        let a = self.steepness(w);
        if self.sigma == 0.0 || a > 6.0 {
            return (1.0, 0.0);
        }
        let beyond = libm::erfc(a);
        let lambda = 0.5 * ((-a * a).exp() / (PI.sqrt() * a) - beyond);
        ((1.0 - 0.5 * beyond) / (lambda.max(0.0) + 1.0), w.truncate().length() / w.z * beyond)
    }

    /// The roughness visible to light and view, given s0 and the sum `k` of both slopes; at grazing angles only the
    /// tops.
    fn effective_sigma(&self, k: f64) -> f64 {
        if k < 1e-12 {
            return self.sigma;
        }
        // x = z0 / s0 solves sqrt(pi/2) x = k/4 exp(-x^2 / 2); Newton's method from below, starting without the
        // exponential
        let mut x = k / (8.0 * PI).sqrt();
        x /= 1.0 + x;
        for _ in 0..20 {
            let right = 0.25 * k * (-0.5 * x * x).exp();
            let step = ((0.5 * PI).sqrt() * x - right) / ((0.5 * PI).sqrt() + x * right);
            x -= step;
            if step.abs() < 1e-13 * x {
                break;
            }
        }
        self.sigma / (1.0 + x * x).sqrt()
    }
}

/// Terms of the series computed together.
const LANES: usize = 8;
/// Below this, the series is summed term by term.
const LARGE: f64 = 40.0;
/// Sums with a smaller logarithm count as zero.
const NOTHING: f64 = -80.0;
/// ln(m! m) for m = 1, 2, ...
static FACTORIALS: LazyLock<[[f64; LANES]; 16]> = LazyLock::new(|| {
    let at = |row: usize, lane: usize| (row * LANES + lane + 1) as f64;
    std::array::from_fn(|row| std::array::from_fn(|lane| libm::lgamma(at(row, lane) + 1.0) + at(row, lane).ln()))
});

wide! {
    /// Sum over m >= 1 of g^m e^-g / (m! m) exp(-b / m), to a relative error of 1e-9; zero where it is below 1e-27.
    fn roughness_series(g: f64, b: f64) -> f64 {
        let (mut sums, mut m) = ([0.0; LANES], std::array::from_fn::<f64, LANES, _>(|lane| (lane + 1) as f64));
        let log_g = g.max(f64::MIN_POSITIVE).ln();
        // the largest term solves b = m^2 ln(m / g) >= m (m - g): Newton's method from above
        let mut top = 0.5 * (g + (g * g + 4.0 * b).sqrt());
        if b > -NOTHING {
            for _ in 0..2 {
                let log = top.ln() - log_g;
                top -= (top * top * log - b) / (top * (2.0 * log + 1.0));
            }
            if top * (1.0 - 2.0 * (top.ln() - log_g)) - g < NOTHING {
                return 0.0;
            }
        }
        if g < LARGE {
            let last = top + 7.0 * top.sqrt() + 9.0;
            let rows = (last / LANES as f64) as usize + 1;
            for factorials in FACTORIALS.iter().take(rows) {
                for lane in 0..LANES {
                    sums[lane] += simd::exp(m[lane] * log_g - g - factorials[lane] - b / m[lane]);
                    m[lane] += LANES as f64;
                }
            }
            return sums.iter().sum();
        }
        // a sum over a bell at steps of 0.87 of its width is exact to 1e-9: take strided terms, m! by Stirling's
        // series
        let step = 0.87 * (top.powi(3) / (top * top + 2.0 * b)).sqrt();
        for _ in 0..2 {
            for lane in 0..LANES {
                let place = top + (m[lane] - LANES as f64) * step;
                let at = place.max(1.0);
                let (log, inverse) = (simd::ln(at / g), 1.0 / at);
                let stirling = inverse * (1.0 / 12.0 - inverse * inverse * (1.0 / 360.0));
                let term = simd::exp(at - g - at * log - stirling - 1.5 * (log + log_g) - b * inverse);
                sums[lane] += if place >= 1.0 { term } else { 0.0 };
                m[lane] += LANES as f64;
            }
        }
        step / (2.0 * PI).sqrt() * sums.iter().sum::<f64>()
    }
}

impl Shape for HeTorrance {
    fn count(&self) -> usize {
        2
    }

    fn terms(&self, wi: DVec3, wo: DVec3) -> Terms {
        self.terms_from(&self.costly(wi, wo), wi, wo)
    }

    /// Factor of the lobe about the mirror direction, and the directional-diffuse part, both without |F|^2.
    fn costly(&self, wi: DVec3, wo: DVec3) -> Costly {
        let ((lit, slope_i), (seen, slope_o)) = (self.shadowing(wi), self.shadowing(wo));
        let sigma = self.effective_sigma(slope_i + slope_o);
        let v = wi + wo;
        let geometry = (v.length_squared() / v.z).powi(2);
        let along2 = v.truncate().length_squared();
        let (mut mirrored, mut spread) = (DVec3::ZERO, DVec3::ZERO);
        for (channel, wavelength) in WAVELENGTH.into_iter().enumerate() {
            let wave = 2.0 * PI / wavelength;
            let g = (wave * sigma * v.z).powi(2);
            let b = (wave * self.tau).powi(2) * along2 / 4.0;
            let d = (PI * self.tau / (2.0 * wavelength)).powi(2) * roughness_series(g, b);
            mirrored[channel] = (-g).exp() / wi.z.max(wo.z);
            spread[channel] = geometry * d / (PI * wi.z * wo.z);
        }
        [lit * seen * mirrored, lit * seen * spread]
    }

    fn terms_from(&self, [mirrored, spread]: &Costly, wi: DVec3, wo: DVec3) -> Terms {
        let lobe = (self.exponent + 1.0) / (2.0 * PI) * mirror(wi).dot(wo).max(0.0).powf(self.exponent);
        let mut terms = diffuse_term();
        terms[1] = self.fresnel.reflectance(wo.dot(half(wi, wo))) * (mirrored * lobe + spread);
        terms
    }

    fn sample(&self, term: usize, wo: DVec3, random: DVec2) -> Option<DVec3> {
        if term == 0 {
            return Some(diffuse_sample(random));
        }
        let (share, roughness) = self.lobes(wo);
        if random.x < share {
            let random = DVec2::new((random.x / share).min(1.0 - f64::EPSILON), random.y);
            return Some(power_sample(mirror(wo), self.exponent, random));
        }
        let random = DVec2::new(((random.x - share) / (1.0 - share)).clamp(0.0, 1.0 - f64::EPSILON), random.y);
        reflect(wo, beckmann_sample(roughness, random))
    }

    fn pdf(&self, term: usize, wi: DVec3, wo: DVec3) -> f64 {
        if term == 0 {
            return diffuse_pdf(wi);
        }
        let (share, roughness) = self.lobes(wo);
        let wh = half(wi, wo);
        let facets = beckmann(wh, roughness) * wh.z / (4.0 * wo.dot(wh));
        share * power_pdf(mirror(wo).dot(wi), self.exponent) + (1.0 - share) * facets
    }

    fn promises(&self) -> Promises {
        Promises { reciprocal: true, energy_conserving: false, isotropic: true }
    }
}

impl HeTorrance {
    /// The fraction of samples about the mirror direction, and the slopes for spreading the others: those of the
    /// surface, or the diffraction by its correlation length if that is wider.
    fn lobes(&self, wo: DVec3) -> (f64, Roughness) {
        let g = (4.0 * PI * self.sigma * wo.z / WAVELENGTH[1]).powi(2);
        let slope = 2.0 * self.sigma / self.tau;
        let diffraction = WAVELENGTH[1] / (PI * self.tau);
        let m = slope.max(diffraction).clamp(0.01, 1.0);
        ((-g).exp().clamp(0.05, 0.95), Roughness { x: m, y: m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::fresnel::conductor;

    fn shape(sigma: f64, tau: f64, metal: &str) -> Box<dyn Shape> {
        let (sigma, tau) = (sigma.to_string(), tau.to_string());
        let given = [("sigma", sigma.as_str()), ("tau", &tau), ("metal", metal), ("aperture", "1")];
        HeTorranceModel.shape(&Values::new(Options::TABLE, given).unwrap()).unwrap()
    }

    fn direction(theta: f64, phi: f64) -> DVec3 {
        let (t, p) = (theta.to_radians(), phi.to_radians());
        DVec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos())
    }

    /// The reflectance for a viewer `wo`, by fine quadrature over the hemisphere.
    fn albedo(shape: &dyn Shape, wo: DVec3) -> DVec3 {
        let (rings, steps) = (720, 360);
        let mut sum = DVec3::ZERO;
        for ring in 0..rings {
            let theta = (f64::from(ring) + 0.5) * 90.0 / f64::from(rings);
            for step in 0..steps {
                let wi = direction(theta, (f64::from(step) + 0.5) * 360.0 / f64::from(steps));
                sum += shape.terms(wi, wo)[1] * wi.z * theta.to_radians().sin();
            }
        }
        sum * (0.5 * PI / f64::from(rings)) * (2.0 * PI / f64::from(steps))
    }

    #[test]
    fn a_smooth_surface_is_a_fresnel_mirror() {
        let shape = shape(0.0, 2.0, "custom");
        for theta in [5.0, 30.0, 55.0, 70.0] {
            let found = albedo(shape.as_ref(), direction(theta, 20.0)).y;
            let expected = conductor(theta.to_radians().cos(), 1.5, 0.0);
            assert!((found / expected - 1.0).abs() < 0.03, "{theta}: {found} {expected}");
        }
    }

    #[test]
    fn a_rough_surface_is_one_of_facets() {
        // roughness of many wavelengths: geometrical optics of slopes m = 2 s0 / tau, here without shadowing
        let (sigma, tau) = (8.0, 80.0);
        let shape = shape(sigma, tau, "mirror");
        let m = 2.0 * sigma / tau;
        for (theta, phi) in [(20.0, 180.0), (30.0, 170.0), (35.0, 180.0), (10.0, 90.0)] {
            let (wi, wo) = (direction(25.0, 0.0), direction(theta, phi));
            let facets = beckmann(half(wi, wo), Roughness { x: m, y: m }) / (4.0 * wi.z * wo.z);
            let found = shape.terms(wi, wo)[1];
            assert!((found / facets - DVec3::ONE).abs().max_element() < 0.01, "{theta} {phi}: {found} {facets}");
        }
    }

    #[test]
    fn the_mirror_image_vanishes_as_the_roughness_grows() {
        // Rayleigh: at 30 degrees e^-g halves with every step of ln 2 in g; longer waves see a smoother surface
        let (wi, wo) = (direction(30.0, 0.0), direction(30.0, 180.0));
        let mut last = f64::INFINITY;
        for sigma in [0.0, 0.02, 0.05, 0.1, 0.2] {
            // a long correlation length avoids shadowing; the narrow Gaussian leaves out the lobe of the facets
            let smooth = shape(sigma, 0.05 + 50.0 * sigma, "mirror");
            let at_mirror = smooth.terms(wi, wo)[1];
            assert!(at_mirror.x >= at_mirror.z && at_mirror.y < last, "{sigma}: {at_mirror} after {last}");
            last = at_mirror.y;
        }
    }

    #[test]
    fn the_series_is_continuous_and_sums_to_its_limits() {
        for b in [0.0, 10.0, 100.0] {
            let (below, above) = (roughness_series(39.999_999, b), roughness_series(40.000_001, b));
            assert!((below / above - 1.0).abs() < 1e-5, "{b}: {below} {above}");
        }
        // the plain sum
        for (g, b) in [
            (0.3, 0.0),
            (2.0, 5.0),
            (2.0, 300.0),
            (14.0, 60.0),
            (39.0, 3.0),
            (41.0, 3.0),
            (41.0, 900.0),
            (120.0, 2000.0),
        ] {
            let term = |m: f64| (m * f64::ln(g) - g - libm::lgamma(m + 1.0) - b / m).exp() / m;
            let (plain, found) = ((1..2000).map(|m| term(f64::from(m))).sum::<f64>(), roughness_series(g, b));
            assert!((found / plain - 1.0).abs() < 1e-9, "{g} {b}: {found} {plain}");
        }
        assert_eq!(roughness_series(0.0, 1.0), 0.0);
        // a single scattering for small g
        assert!((roughness_series(1e-6, 0.5) / (1e-6 * (-0.5f64).exp()) - 1.0).abs() < 1e-5);
        assert!((roughness_series(1e4, 0.0) * 1e4 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn rough_metal_peaks_beyond_the_mirror_direction_at_grazing_light() {
        let shape = shape(1.0, 4.0, "silver");
        let wi = direction(70.0, 0.0);
        let peak = (0..89).max_by(|a, b| {
            let at = |t: &i32| shape.terms(wi, direction(f64::from(*t), 180.0))[1].y;
            at(a).total_cmp(&at(b))
        });
        assert!(peak.unwrap() > 72, "{peak:?}");
    }

    #[test]
    fn a_steep_surface_is_diffuse() {
        // light along the normal; roughness of many wavelengths, with increasing slopes
        let at = |tau: f64, theta: f64| shape(8.0, tau, "mirror").terms(DVec3::Z, direction(theta, 0.0))[1].y;
        let shares = [160.0, 80.0, 40.0, 20.0].map(|tau| at(tau, 60.0) / at(tau, 0.0));
        assert!(shares.is_sorted() && shares[0] < 1e-9 && shares[3] > 0.5, "{shares:?}");
        let level = [0.0, 15.0, 30.0, 45.0, 60.0].map(|theta| at(20.0, theta) / at(20.0, 0.0));
        assert!(level.iter().all(|l| (0.9..2.0).contains(l)), "{level:?}");
    }

    #[test]
    fn a_rough_surface_becomes_a_mirror_towards_grazing_light_and_red_before_blue() {
        // facets alone would give the same value at every angle
        let shape = shape(0.2, 2.0, "mirror");
        let at = |theta: f64| {
            let wi = direction(theta, 0.0);
            shape.terms(wi, direction(theta, 180.0))[1] * wi.z * wi.z
        };
        let (steep, middle, grazing) = (at(10.0), at(60.0), at(75.0));
        assert!((steep.x / steep.z - 1.0).abs() < 0.05, "{steep}");
        assert!(middle.x > 2.0 * middle.z && middle.y > 1.5 * steep.y, "{middle}");
        assert!(grazing.min_element() > 10.0 * steep.max_element(), "{grazing}");
    }
}
