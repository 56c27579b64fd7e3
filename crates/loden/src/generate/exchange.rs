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

use super::facets::Facets;
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
    let texels = matching.texels(structure, reflectance);
    if keep == Keep::Nothing {
        return reflectance.with_pattern([meta.width, meta.height], texels);
    }
    let [own, other] = [structure, reflectance].map(separated);
    let smoothed = |rows: &[(Separated, Facets)], populations: &[f64]| {
        smoothed(&rows.iter().map(|(_, facets)| facets.fit).collect::<Vec<_>>(), populations)
    };
    let (old, new) = (smoothed(&own, &structure.populations()), smoothed(&other, &reflectance.populations()));
    // a new row for each row and each that takes its place
    let pairs: Vec<(usize, usize)> =
        matching.shares.iter().enumerate().flat_map(|(row, shares)| shares.iter().map(move |to| (row, to.0))).collect();
    let geometry = Geometry::new(meta);
    let changed = |(k, (row, to)): (usize, &(usize, usize))| {
        let (old, new, (separated, facets)) = (&old[*row], &new[*to], &own[*row]);
        if old == new {
            return None;
        }
        let albedo = separated.fit.albedo * new.albedo / old.albedo.max(Vec3::splat(1e-4));
        let specular = facets.changed(&geometry, &separated.specular, new.strength, new.alpha);
        Some((k, separated.with(albedo, &specular)))
    };
    let changed: BTreeMap<usize, Vec<Vec3>> = pairs.par_iter().enumerate().filter_map(changed).collect();
    if changed.is_empty() {
        return MemoryParts::copy(&**structure.parts());
    }
    let numbers: BTreeMap<(usize, usize), u16> = pairs.iter().enumerate().map(|(k, pair)| (*pair, k as u16)).collect();
    let number = |(row, to): (&u16, &u16)| numbers[&(usize::from(*row), usize::from(*to))];
    let index: Vec<u16> = structure.index().iter().zip(&texels).map(number).collect();
    let origin: Vec<usize> = pairs.iter().map(|(row, _)| *row).collect();
    structure.rebuilt(index.into(), &origin, &changed)
}

/// All rows in two parts, and what each view sees of them.
fn separated(rows: &Rows) -> Vec<(Separated, Facets)> {
    let geometry = Geometry::new(rows.meta());
    let separate = |row: usize| {
        let separated = Separated::new(&geometry, &rows.values(row));
        let facets = Facets::new(&geometry, &separated);
        (separated, facets)
    };
    (0..rows.count()).into_par_iter().map(separate).collect()
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
