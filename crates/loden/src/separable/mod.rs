//! Separable approximations of BRDFs: products and sums of small tables, one file per method, listed in
//! [`FACTORISATIONS`]. `loden factor` makes them and stores each as one file, which is a material like any other.
//!
//! Choose them for hardware that looks up textures but cannot evaluate a model or a full table: a measured BRDF becomes
//! two or three textures of a few kilobytes. `cmf`, which chains products of tables, is the most accurate for its size;
//! `hf` is nearly as accurate with one table less, and always positive; `svd` and `nmf` take more terms for more accuracy;
//! `nd` and `gshd` are the fastest to compute and the least accurate. `codec` has the methods that compress a whole BTF.
//!
//! # Model
//! A table T depends on one direction that is derived from the pair of light and view, its [`Projection`]: light, view,
//! half vector or difference vector. Products are f(wi, wo) = product over k of the sum over j of A_kj(x_k) B_kj(y_k),
//! where x_k and y_k are two projections of the pair; the exponential form of `hf` is f = exp(sum over k of
//! T_k(x_k)). Each table covers the hemisphere by an equal-area map.
//!
//! # Limits
//! Isotropic or anisotropic, but not spatially varying: one BRDF at a time. Directions more than 80 degrees from the
//! normal take the values at 80 degrees.
//!
//! # References
//! kautz1999, mccool2001, suykens2003

mod cmf;
mod gshd;
mod hf;
mod joint;
mod matrix;
mod nd;
mod nmf;
#[cfg(feature = "picture")]
mod panel;
mod sparse;
mod stored;
mod svd;
mod tables;

use std::fmt::Debug;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

#[cfg(feature = "picture")]
pub use panel::panel;
pub use stored::{MARK, Making, read, write};
pub use tables::{Factored, Grid, ProductSum, Projection};

use crate::material::Material;
use crate::params::{Kind, Param, Values};
use crate::progress::Progress;
use crate::{Error, Result};

/// All factorisations.
pub const FACTORISATIONS: &[&dyn Factorisation] = &[&nd::Nd, &gshd::Gshd, &svd::Svd, &hf::Hf, &cmf::Cmf, &nmf::Nmf];

/// A method that turns a BRDF into tables.
pub trait Factorisation: Sync {
    /// Name on the command line.
    fn name(&self) -> &'static str;

    /// One sentence for the reference page.
    fn doc(&self) -> &'static str;

    /// Its parameters.
    fn params(&self) -> &'static [Param];

    /// Factors a BRDF, evaluated at the centres of `resolution` x `resolution` texels per table.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `values` are not those of [`Factorisation::params`]; [`Error::NonFinite`] if the BRDF is
    /// not finite; [`Error::NotConverged`]; [`Error::Cancelled`].
    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored>;
}

/// The factorisation of this name.
///
/// # Errors
/// [`Error::Parameter`] listing the known names.
pub fn by_name(name: &str) -> Result<&'static dyn Factorisation> {
    FACTORISATIONS.iter().copied().find(|f| f.name() == name).ok_or_else(|| {
        let names: Vec<_> = FACTORISATIONS.iter().map(|f| f.name()).collect();
        Error::parameter("method", format!("found {name:?}, expected one of {}", names.join(", ")))
    })
}

const RESOLUTION: Param = Param {
    name: "resolution",
    unit: "",
    kind: Kind::Integer { min: 4, max: 48 },
    default: "16",
    doc: "Texels per side of a table.",
};

const TERMS: Param = Param {
    name: "terms",
    unit: "",
    kind: Kind::Integer { min: 1, max: 32 },
    default: "1",
    doc: "Number of products in the sum.",
};

/// Values below this fraction of the mean are noise, whose logarithm means nothing.
const NOISE: f32 = 0.01;

crate::words! {
    /// The error that a fit of tables minimises.
    enum Metric { Linear = "linear", Log = "log" }
}

const METRIC: Param = Param {
    name: "metric",
    unit: "",
    kind: Kind::Choice(&["linear", "log"]),
    default: "linear",
    doc: "Error that is minimised: the squared difference of f cos, or of its logarithm, in which dark directions count as \
          much as highlights.",
};

crate::words! {
    enum Parametrisation { HalfDifference = "half-difference", InOut = "in-out" }
}

impl Parametrisation {
    /// The directions that the two tables of a product depend on.
    fn projections(self) -> [Projection; 2] {
        match self {
            Self::HalfDifference => [Projection::Half, Projection::Difference],
            Self::InOut => [Projection::Light, Projection::View],
        }
    }
}

crate::params! {
    /// The parameters of sums of products of two tables.
    struct Sum {
        resolution: usize => RESOLUTION,
        terms: usize => TERMS,
        /// Directions that the two tables of a product depend on: half and difference vector, or light and view.
        parametrisation: Parametrisation = "half-difference",
    }
}

/// Error of a factored BRDF over a fixed set of pairs of directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Sum of |difference| cos, divided by the sum of f cos.
    pub mean_rel_error: f64,
    /// Root mean square of the difference times cos, in 1/sr.
    pub rmse: f64,
}

/// Pairs of directions, spread evenly over both hemispheres up to 80 degrees from the normal.
pub(crate) fn pairs(count: usize) -> impl Iterator<Item = (Vec3, Vec3)> {
    // additive recurrence in four dimensions: 2^32 / phi^k with phi^5 = phi + 1
    const STEP: [u32; 4] = [3_679_390_609, 3_152_041_523, 2_700_274_806, 2_313_257_605];
    let lowest = 80f32.to_radians().cos();
    (0..count as u32).map(move |i| {
        let u = STEP.map(|s| (i.wrapping_mul(s) >> 8) as f32 / (1u32 << 24) as f32);
        let direction = |u: f32, v: f32| {
            let z = 1.0 - u * (1.0 - lowest);
            let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            Vec3::new(r * cos, r * sin, z)
        };
        (direction(u[0], u[1]), direction(u[2], u[3]))
    })
}

/// A BRDF at evenly spread pairs of directions.
struct Evaluated {
    /// (light, view)
    pairs: Vec<(Vec3, Vec3)>,
    /// The mean of each channel, without negative values.
    scale: Vec3,
    /// The values relative to `scale`; 0 where they are negative.
    relative: Vec<Vec3>,
}

impl Evaluated {
    /// Evaluates `count` pairs, none of which [`compare`] looks at: what is fitted to samples is closer there than elsewhere.
    ///
    /// # Errors
    /// [`Error::NonFinite`].
    fn at(brdf: &dyn Material, count: usize) -> Result<Self> {
        let pairs: Vec<(Vec3, Vec3)> = pairs(COMPARED + count).skip(COMPARED).collect();
        let values: Vec<Vec3> = pairs.par_iter().map(|&(wi, wo)| brdf.eval(Vec2::ZERO, wi, wo)).collect();
        if values.iter().any(|v| !v.is_finite()) {
            return Err(Error::non_finite("the BRDF"));
        }
        let sum: DVec3 = values.iter().map(|v| v.as_dvec3().max(DVec3::ZERO)).sum();
        let scale = (sum / count as f64).as_vec3();
        let relative = |v: Vec3| Vec3::from([0, 1, 2].map(|c| relative(v[c].max(0.0), scale[c])));
        Ok(Self { pairs, scale, relative: values.into_iter().map(relative).collect() })
    }
}

/// A value in units of `scale`; 0 if that is 0.
fn relative(value: f32, scale: f32) -> f32 {
    if scale.is_normal() { value / scale } else { 0.0 }
}

/// Number of pairs at which BRDFs are compared.
const COMPARED: usize = 20_000;

/// Compares two BRDFs at 20 000 pairs of directions.
pub fn compare(original: &dyn Material, other: &dyn Material) -> Report {
    let (mut absolute, mut squares, mut whole, mut count) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
    for (wi, wo) in pairs(COMPARED) {
        let (a, b) = (original.eval(Vec2::ZERO, wi, wo) * wi.z, other.eval(Vec2::ZERO, wi, wo) * wi.z);
        for c in 0..3 {
            let difference = f64::from(a[c] - b[c]);
            absolute += difference.abs();
            squares += difference * difference;
            whole += f64::from(a[c]);
            count += 1.0;
        }
    }
    Report { mean_rel_error: absolute / whole.max(f64::MIN_POSITIVE), rmse: (squares / count).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Lambert;
    use crate::model::{Analytic, by_name as model};
    use crate::progress::Silent;

    fn ward() -> Analytic {
        let model = model("ward").unwrap();
        let given = [("alpha-x", "0.25"), ("alpha-y", "0.5"), ("kd", "0.3,0.2,0.1"), ("ks", "0.4")];
        Analytic::new(model, Values::new(model.params(), given).unwrap()).unwrap()
    }

    fn run(name: &str, given: &[(&str, &str)], brdf: &dyn Material) -> (Factored, Report) {
        let method = by_name(name).unwrap();
        let values = Values::new(method.params(), given.iter().copied()).unwrap();
        let factored = method.factor(brdf, &values, &Silent).unwrap();
        let report = compare(brdf, &factored);
        println!("{name} {given:?}: {:.4} {:.4} {}", report.mean_rel_error, report.rmse, factored.bytes());
        (factored, report)
    }

    #[test]
    fn a_diffuse_brdf_is_exact_in_every_factorisation() {
        let grey = Lambert { albedo: Vec3::new(0.8, 0.5, 0.2) };
        for method in FACTORISATIONS {
            let (factored, report) = run(method.name(), &[("resolution", "8")], &grey);
            assert!(report.mean_rel_error < 1e-3, "{}: {report:?}", method.name());
            assert_eq!(factored.eval(Vec2::ZERO, Vec3::NEG_Z, Vec3::Z), Vec3::ZERO);
        }
    }

    #[test]
    fn every_factorisation_is_close_and_small_and_not_negative() {
        let brdf = ward();
        let black = compare(&brdf, &Lambert { albedo: Vec3::ZERO });
        assert!((black.mean_rel_error - 1.0).abs() < 1e-6);
        for method in FACTORISATIONS {
            let (factored, report) = run(method.name(), &[], &brdf);
            // one product of norms and averages cannot represent a highlight on a diffuse base
            let most = if ["nd", "gshd"].contains(&method.name()) { 0.9 } else { 0.35 };
            assert!(report.mean_rel_error < most, "{}: {report:?}", method.name());
            assert!(factored.ratio() > 20.0 && factored.bytes() > 0);
            for (wi, wo) in pairs(2000) {
                let value = factored.eval(Vec2::ZERO, wi, wo);
                assert!(value.is_finite() && value.min_element() >= 0.0, "{}: {value}", method.name());
            }
        }
    }

    #[test]
    fn more_terms_and_texels_are_closer() {
        let model = model("ward").unwrap();
        let given = [("alpha-x", "0.5"), ("alpha-y", "0.8"), ("kd", "0.3,0.2,0.1"), ("ks", "0.4")];
        let brdf = Analytic::new(model, Values::new(model.params(), given).unwrap()).unwrap();
        for name in ["svd", "nmf"] {
            // between the nodes, a single additional term need not help
            let [one, six] = ["1", "6"].map(|terms| run(name, &[("terms", terms)], &brdf).1);
            assert!(
                six.rmse < 0.9 * one.rmse && six.mean_rel_error < 0.9 * one.mean_rel_error,
                "{name}: {one:?} {six:?}"
            );
        }
        let runs =
            |metric| ["8", "16", "32"].map(|size| run("hf", &[("resolution", size), ("metric", metric)], &brdf).1);
        // each by the error that it minimises
        let errors = [runs("log").map(|report| report.mean_rel_error), runs("linear").map(|report| report.rmse)];
        assert!(errors.iter().all(|e| e[1] < e[0] && e[2] < e[0]), "{errors:?}");
        // in linear light 32 x 32 is no better than 16 x 16
        assert!(errors[0][2] < errors[0][1], "{errors:?}");
    }

    #[test]
    fn the_homomorphic_factorisation_is_never_worse_than_the_mean() {
        /// A narrow highlight on noise around 0, which has red below that.
        #[derive(Debug)]
        struct Paint;
        impl Material for Paint {
            fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
                self.eval(uv, wi, wo) * std::f32::consts::PI * wi.z
            }
            fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
                let h = (wi + wo).normalize();
                let noise = 0.5 + 0.5 * (731.0 * wi.x + 517.0 * wo.y).sin();
                Vec3::new(1e-7 * noise.powi(8), 0.01 * noise, 0.05) + Vec3::new(2.0, 2.0, 2.5) * h.z.powi(300)
            }
        }
        struct Mean(Vec3);
        impl Material for Mean {
            fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
                self.eval(uv, wi, wo) * std::f32::consts::PI * wi.z
            }
            fn eval(&self, _uv: Vec2, _wi: Vec3, _wo: Vec3) -> Vec3 {
                self.0
            }
        }
        let mean = compare(&Paint, &Mean(Evaluated::at(&Paint, 20_000).unwrap().scale));
        for (projections, all) in [
            ("light-half-view", &["0", "0.05", "10"][..]),
            ("light-view", &["0.05"]),
            ("half-difference", &["0.05"]),
            ("light-half-difference-view", &["0"]),
        ] {
            for &smoothness in all {
                let given = [("projections", projections), ("smoothness", smoothness), ("resolution", "8")];
                let (_, found) = run("hf", &given, &Paint);
                assert!(
                    found.rmse <= 1.0001 * mean.rmse,
                    "{projections} {smoothness}: {found:?}, of the mean {mean:?}"
                );
            }
        }
    }

    #[test]
    fn a_brdf_of_the_form_of_a_factorisation_is_recovered() {
        // f = p(L) g(H) p(V), smooth enough for the tables
        #[derive(Debug)]
        struct Product;
        impl Material for Product {
            fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
                self.eval(uv, wi, wo) * std::f32::consts::PI * wi.z
            }
            fn eval(&self, _uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
                let h = (wi + wo).normalize();
                let p = |w: Vec3| 0.3 + w.z + 0.2 * w.x;
                Vec3::new(1.0, 0.5, 0.2) * p(wi) * p(wo) * (1.5 * h.z + 0.3 * h.y).exp()
            }
        }
        let (_, hf) = run("hf", &[], &Product);
        let (_, nd) = run("nd", &[], &Product);
        assert!(hf.mean_rel_error < 0.01 && hf.mean_rel_error < 0.2 * nd.mean_rel_error, "{hf:?} {nd:?}");
    }
}
