//! Chained matrix factorisation: what one factorisation leaves is factored again in other directions.

use glam::{Vec2, Vec3};

use super::matrix::Matrix;
use super::tables::{Factored, Grid, Projection, Step};
use super::{Factorisation, RESOLUTION, TERMS};
use crate::Result;
use crate::material::Material;
use crate::params::{Kind, Param, Values};
use crate::progress::Progress;

/// # Model
/// f = F1(H, D) F2(light, view) F3(H, D) ..., each a sum of products of two tables. F1 is the closest sum of products
/// to f; F2 the closest to f / F1, evaluated at light and view; and so on. With an odd number of factors the first
/// step is a table of H alone, the mean over D: three factors are g(H) p(light) q(view).
///
/// # Limits
/// Where the product so far is less than a thousandth of its mean, the quotient is taken with that floor.
///
/// # References
/// suykens2003 (section 4)
pub(super) struct Cmf;

const FACTORS: Param = Param {
    name: "factors",
    unit: "",
    kind: Kind::Integer { min: 2, max: 8 },
    default: "4",
    doc: "Tables in the chain, for one term.",
};

impl Factorisation for Cmf {
    fn name(&self) -> &'static str {
        "cmf"
    }

    fn doc(&self) -> &'static str {
        "Chained matrix factorisation, alternately over half and difference vectors and over light and view."
    }

    fn params(&self) -> &'static [Param] {
        &[RESOLUTION, TERMS, FACTORS]
    }

    fn factor(&self, brdf: &dyn Material, values: &Values, progress: &dyn Progress) -> Result<Factored> {
        let size = values.integer("resolution") as usize;
        let (terms, factors) = (values.integer("terms") as usize, values.integer("factors") as usize);
        let mut steps: Vec<Step> = Vec::new();
        for k in 0..factors.div_ceil(2) {
            let projections = match k % 2 {
                0 => [Projection::Half, Projection::Difference],
                _ => [Projection::Light, Projection::View],
            };
            let floor = floor(&steps);
            let rest = |wi: Vec3, wo: Vec3| {
                let known: Vec3 = steps.iter().map(|step| step.value(wi, wo)).product();
                brdf.eval(Vec2::ZERO, wi, wo) / known.max(floor)
            };
            let matrix = Matrix::from_values(rest, projections, size, progress)?;
            let alone = k == 0 && factors % 2 == 1;
            steps.push(if alone { mean_over_columns(&matrix) } else { matrix.singular(terms)? });
        }
        Ok(Factored::Product(steps))
    }
}

/// A thousandth of the mean of the product so far; with no steps the product is 1.
fn floor(steps: &[Step]) -> Vec3 {
    let count = 2000;
    let value = |(wi, wo)| steps.iter().map(|step| step.value(wi, wo)).product::<Vec3>().max(Vec3::ZERO);
    (super::pairs(count).map(value).sum::<Vec3>() / count as f32 * 1e-3).max(Vec3::splat(1e-12))
}

/// A table of the first projection only.
fn mean_over_columns(matrix: &Matrix) -> Step {
    let n = matrix.size * matrix.size;
    let mean = |c: usize, row: usize| matrix.channels[c][row * n..(row + 1) * n].iter().sum::<f32>() / n as f32;
    let texels = (0..n).map(|row| Vec3::new(mean(0, row), mean(1, row), mean(2, row))).collect();
    // two texels a side are the least that can be interpolated
    let one = Grid::filled(2, Vec3::ONE);
    Step { projections: matrix.projections, terms: vec![[Grid { size: matrix.size, texels }, one]] }
}
