//! Reflection at a smooth interface: exact for metals, Schlick's approximation, and a table of metals.

use glam::{DVec3, Vec3};

/// Optical constants of evaporated films at 617, 549 and 451 nm (red, green, blue): name, n, k.
///
/// # References
/// johnson1972 (copper, silver, gold), johnson1974 (chromium, nickel); read from refractiveindex.info (CC0).
// the k of chromium looks like pi, but is not
#[allow(clippy::approx_constant)]
pub const METALS: &[(&str, [f64; 3], [f64; 3])] = &[
    ("silver", [0.06, 0.06, 0.04], [4.152, 3.586, 2.657]),
    ("gold", [0.21, 0.43, 1.38], [3.272, 2.455, 1.914]),
    ("copper", [0.30, 1.02, 1.24], [3.205, 2.577, 2.397]),
    ("chromium", [3.17, 3.18, 2.33], [3.30, 3.33, 3.14]),
    ("nickel", [1.99, 1.92, 1.73], [4.02, 3.61, 2.95]),
];

crate::words! {
    /// Materials of an interface: the values of --n and --k, a perfect mirror, or a metal of [`METALS`].
    pub(super) enum Metal {
        Custom = "custom",
        Mirror = "mirror",
        Silver = "silver",
        Gold = "gold",
        Copper = "copper",
        Chromium = "chromium",
        Nickel = "nickel",
    }
}

crate::params! {
    /// The parameters of [`Fresnel`].
    pub(super) struct Interface {
        /// Material of the facets: a metal, a perfect mirror, or custom with the refractive index of --n and --k.
        metal: Metal = "custom",
        /// Real part of the refractive index, if the metal is custom.
        n: [f64; 3] [0.01..=20.0] = 1.5,
        /// Imaginary part of the refractive index, if the metal is custom.
        k: [f64; 3] [0.0..=20.0] = 0,
    }
}

impl Interface {
    pub(super) fn fresnel(&self) -> Fresnel {
        let metal = METALS.iter().find(|metal| metal.0 == self.metal.name());
        let (n, k) = metal.map_or((self.n, self.k), |metal| (metal.1, metal.2));
        if self.metal == Metal::Mirror { Fresnel::Mirror } else { Fresnel::Conductor { n: n.into(), k: k.into() } }
    }
}

/// Unpolarised reflectance of an interface to air, per channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fresnel {
    /// A perfect mirror.
    Mirror,
    /// Complex refractive index n + ik.
    Conductor {
        /// Real part.
        n: DVec3,
        /// Imaginary part.
        k: DVec3,
    },
}

impl Fresnel {
    /// The reflectance at an angle of incidence with this cosine.
    pub fn reflectance(&self, cosine: f64) -> DVec3 {
        match self {
            Self::Mirror => DVec3::ONE,
            Self::Conductor { n, k } if n.x == n.y && n.y == n.z && k.x == k.y && k.y == k.z => {
                DVec3::splat(conductor(cosine, n.x, k.x))
            }
            Self::Conductor { n, k } => DVec3::from_array([0, 1, 2].map(|c| conductor(cosine, n[c], k[c]))),
        }
    }
}

impl Fresnel {
    /// [`Fresnel::reflectance`] in single precision, branch-free for each kind.
    #[inline(always)]
    pub(super) fn reflectance_single(&self, cosine: f32) -> Vec3 {
        match self {
            Self::Mirror => Vec3::ONE,
            Self::Conductor { n, k } => {
                let (n, k) = (n.as_vec3(), k.as_vec3());
                Vec3::new(
                    conductor_single(cosine, n.x, k.x),
                    conductor_single(cosine, n.y, k.y),
                    conductor_single(cosine, n.z, k.z),
                )
            }
        }
    }
}

/// Defines the reflectance of a conductor for a type of number.
macro_rules! conductor {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($number:ty)) => {
        $(#[$doc])*
        #[inline(always)]
        $vis fn $name(cosine: $number, n: $number, k: $number) -> $number {
            let c = cosine.clamp(0.0, 1.0);
            let c2 = c * c;
            let s2 = 1.0 - c2;
            let t = n * n - k * k - s2;
            let both = (t * t + 4.0 * n * n * k * k).sqrt();
            let a = (0.5 * (both + t)).max(0.0).sqrt();
            let rs = (both + c2 - 2.0 * a * c) / (both + c2 + 2.0 * a * c);
            let (even, odd) = (c2 * both + s2 * s2, 2.0 * a * c * s2);
            // at the Brewster angle of a dielectric the difference can round below zero
            let rp = if even > 0.0 { rs * ((even - odd) / (even + odd)).max(0.0) } else { rs };
            0.5 * (rs + rp)
        }
    };
}

conductor! {
    /// Unpolarised reflectance at an interface from air to the index n + ik.
    ///
    /// # Model
    /// With a^2 + b^2 = |(n + ik)^2 - sin^2| and 2 a^2 = a^2 + b^2 + n^2 - k^2 - sin^2:
    /// Rs = (a^2 + b^2 - 2 a c + c^2) / (a^2 + b^2 + 2 a c + c^2),
    /// Rp = Rs (c^2 (a^2 + b^2) - 2 a c s^2 + s^4) / (c^2 (a^2 + b^2) + 2 a c s^2 + s^4); the mean of both.
    ///
    /// # References
    /// cook1982 (appendix)
    pub fn conductor(f64)
}

conductor! {
    /// [`conductor()`] in single precision.
    fn conductor_single(f32)
}

/// Schlick's weight between normal and grazing reflectance: (1 - cos)^5.
///
/// # References
/// schlick1994 (eq. 15)
pub fn schlick_weight(cosine: f64) -> f64 {
    (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Snell's law and the amplitude coefficients in complex numbers, written out.
    fn by_amplitudes(c: f64, n: f64, k: f64) -> f64 {
        type Complex = (f64, f64);
        let mul = |a: Complex, b: Complex| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
        let root = |a: Complex| {
            let (r, phi) = (a.0.hypot(a.1).sqrt(), 0.5 * a.1.atan2(a.0));
            (r * phi.cos(), r * phi.sin())
        };
        let ratio = |a: Complex, b: Complex| (a.0 * a.0 + a.1 * a.1) / (b.0 * b.0 + b.1 * b.1);
        let n2 = mul((n, k), (n, k));
        // n2 cos(theta_t)
        let q = root((n2.0 - (1.0 - c * c), n2.1));
        let s = ratio((c - q.0, -q.1), (c + q.0, q.1));
        let p = ratio((n2.0 * c - q.0, n2.1 * c - q.1), (n2.0 * c + q.0, n2.1 * c + q.1));
        0.5 * (s + p)
    }

    #[test]
    fn equals_the_amplitude_coefficients() {
        for (n, k) in [(1.5, 0.0), (0.2, 3.3), (3.2, 3.3), (1.0, 0.0), (0.05, 4.0)] {
            for i in 0..=90 {
                let c = f64::from(i).to_radians().cos();
                let (found, expected) = (conductor(c, n, k), by_amplitudes(c, n, k));
                assert!((found - expected).abs() < 1e-12, "{n} {k} {i}: {found} {expected}");
            }
        }
    }

    #[test]
    fn metals_are_known_by_the_parameter() {
        let names: Vec<_> = METALS.iter().map(|metal| metal.0).collect();
        assert_eq!(Metal::ALL[2..].iter().map(|metal| metal.name()).collect::<Vec<_>>(), names);
    }
}
