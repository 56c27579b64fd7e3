//! The pattern of one material with the reflectance of another.
//!
//! # Model
//! Without [`Keep::Shading`], the rows of one material replace those of the other as they are: shadows included.
//!
//! With it, a row of the pattern keeps what its texels do to light, and only its reflectance changes. A row is taken as
//! albedo times shading plus a highlight times shading. The albedo, strength and roughness of a row are those of its
//! neighbourhood in chromaticity: means over all rows, weighted by population and by how alike their chromaticities are. So
//! rows of one material that differ only because they lie in shadow have one albedo, and their shading stays different.
//! The diffuse part is multiplied by the ratio of the albedos of both materials, the highlight changes by the difference of their models.
//!
//! # Limits
//! Shading includes interreflection, which changes with the albedo; here it does not. Albedos that differ in
//! brightness alone are taken for shading.
//!
//! # References
//! mueller2007

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use super::reflectance::{Geometry, Reflectance, Separated};
use super::{Matching, Rows};
use crate::Result;
use crate::codec::parts::MemoryParts;

/// Difference of chromaticities that counts as another reflectance.
const NEIGHBOURHOOD: f32 = 0.03;

crate::words! {
    /// What the pattern keeps besides itself.
    pub enum Keep {
        /// Shadowing, masking and interreflection.
        Shading = "shading",
        /// Nothing.
        Nothing = "nothing",
    }
}

/// Puts rows of `reflectance` on the pattern of `structure`. The result has the size of `structure`; without shading it has
/// the directions and the encoding of `reflectance`, with shading those of `structure`.
///
/// # Errors
/// As [`Rows::with_pattern`] and [`Rows::rebuilt`].
pub fn exchange(structure: &Rows, reflectance: &Rows, matching: &Matching, keep: Keep) -> Result<MemoryParts> {
    let meta = structure.meta();
    if keep == Keep::Nothing {
        let index = structure.index().iter().map(|row| matching.rows[usize::from(*row)] as u16).collect();
        return reflectance.with_pattern([meta.width, meta.height], index);
    }
    let geometry = Geometry::new(meta);
    let separate = |row: usize| Separated::new(&geometry, &structure.values(row));
    let own: Vec<Separated> = (0..structure.count()).into_par_iter().map(separate).collect();
    let fits: Vec<Reflectance> = own.iter().map(|row| row.fit).collect();
    let [old, new] =
        [smoothed(&fits, &structure.populations()), smoothed(&fitted(reflectance), &reflectance.populations())];
    let changed = |row: usize| {
        let (old, new, fit) = (&old[row], &new[matching.rows[row]], &own[row].fit);
        if old == new {
            return None;
        }
        let albedo = fit.albedo * new.albedo / old.albedo.max(Vec3::splat(1e-4));
        Some((row, own[row].with(&geometry, albedo, new.strength, new.alpha)))
    };
    let changed: BTreeMap<usize, Vec<Vec3>> = (0..structure.count()).into_par_iter().filter_map(changed).collect();
    if changed.is_empty() {
        return MemoryParts::copy(&**structure.parts());
    }
    let origin: Vec<usize> = (0..structure.count()).collect();
    structure.rebuilt(structure.index().to_vec().into(), &origin, &changed)
}

fn fitted(rows: &Rows) -> Vec<Reflectance> {
    let geometry = Geometry::new(rows.meta());
    (0..rows.count()).into_par_iter().map(|row| Reflectance::fit(&geometry, &rows.values(row))).collect()
}

/// Reflectances as means over rows of alike chromaticity.
fn smoothed(rows: &[Reflectance], populations: &[f64]) -> Vec<Reflectance> {
    let chromaticity = |row: &Reflectance| row.albedo / row.albedo.element_sum().max(1e-6);
    let mean = |row: &Reflectance| {
        let (mut albedo, mut strength, mut alpha, mut mass, mut shine) = (Vec3::ZERO, 0.0, 0.0, 0.0, 1e-9);
        for (other, population) in rows.iter().zip(populations) {
            let apart = (chromaticity(row) - chromaticity(other)).length_squared() / NEIGHBOURHOOD.powi(2);
            let weight = *population as f32 * (-0.5 * apart).exp();
            albedo += weight * other.albedo;
            strength += weight * other.strength;
            // a row without a highlight says nothing of its width
            alpha += weight * other.strength * other.alpha.ln();
            (mass, shine) = (mass + weight, shine + weight * other.strength);
        }
        let mass = mass.max(1e-9);
        let alpha = if shine > 1e-6 { (alpha / shine).exp() } else { row.alpha };
        Reflectance { albedo: albedo / mass, strength: strength / mass, alpha, normal: row.normal }
    };
    rows.par_iter().map(mean).map(|row| Reflectance { normal: Vec3::Z, ..row }).collect()
}
