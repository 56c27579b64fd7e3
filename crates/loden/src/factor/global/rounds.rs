//! Rounds that improve a basis: subspace iteration, and a block Krylov space.

use super::passes::{image, project};
use super::{Global, Shards, within_span};
use crate::Result;
use crate::factor::linalg::orthonormal_to;
use crate::factor::principal::Ritz;

/// Maximum number of rounds of [`subspace`].
pub(super) const SUBSPACE_ROUNDS: usize = 3;

/// Maximum number of rounds of [`krylov`].
pub(super) const KRYLOV_ROUNDS: usize = 6;

/// Energy that a further round may gain, as a fraction of the energy left out.
pub(super) const TOLERANCE: f64 = 1e-3;

/// The same for rounds over a subsample.
const SUBSAMPLE_TOLERANCE: f64 = 5e-3;

/// Energy that a further round of [`krylov`] may gain, as a fraction of the energy left out, and for each component as a
/// fraction of its own, which is twice the relative error of its singular value.
const KRYLOV_TOLERANCES: [f64; 2] = [TOLERANCE, 1e-3];

/// The basis after at most `rounds` rounds of subspace iteration; `None` if a number is not finite.
pub(super) fn improve<S: Shards>(
    shards: &S,
    offset: &[f64],
    mut basis: Vec<f64>,
    count: usize,
    rounds: usize,
    centred: bool,
) -> Result<Option<Vec<f64>>> {
    let columns = offset.len();
    for _ in 0..rounds {
        let (products, moments) = project(shards, offset, &basis, true, centred)?;
        let image = image(shards, offset, &products, basis.len() / columns)?;
        let Some(ritz) = Ritz::new(&basis, &image, columns) else { return Ok(None) };
        let (_, energy) = moments.mean_and_energy(offset, shards.texels(), centred);
        let converged = ritz.converged(SUBSAMPLE_TOLERANCE, count, columns, 2, energy);
        basis = ritz.next_basis(columns);
        if converged {
            break;
        }
    }
    Ok(Some(basis))
}

/// Subspace iteration over all texels: each round replaces the basis by its image.
pub(super) fn subspace<S: Shards>(
    shards: &S,
    offset: &[f64],
    mut basis: Vec<f64>,
    count: usize,
    centred: bool,
) -> Result<Option<Global>> {
    let (columns, texels) = (offset.len(), shards.texels());
    let width = basis.len() / columns;
    let mut gathered = None;
    let mut rounds = SUBSPACE_ROUNDS;
    loop {
        let (products, moments) = project(shards, offset, &basis, gathered.is_none(), centred)?;
        let (mean, energy) = gathered.get_or_insert_with(|| moments.mean_and_energy(offset, texels, centred));
        let image = image(shards, offset, &products, width)?;
        let Some(ritz) = Ritz::new(&basis, &image, columns) else { return Ok(None) };
        // a basis of full rank cannot be improved
        let done = width == columns.min(texels) || ritz.converged(TOLERANCE, count, columns, 1, *energy);
        rounds -= 1;
        if done || rounds == 0 {
            let (mean, energy) = (std::mem::take(mean), *energy);
            return match products.triplets(&image, columns, count, texels) {
                Some((basis, coefficients)) => Ok(Some(Global { mean, basis, coefficients, energy })),
                None => within_span(shards, offset, &ritz.into_vectors(), count, centred),
            };
        }
        basis = ritz.next_basis(columns);
    }
}

/// A block Krylov space over all texels: each round adds the images of the leading Ritz vectors to the basis.
pub(super) fn krylov<S: Shards>(
    shards: &S,
    offset: &[f64],
    mut basis: Vec<f64>,
    count: usize,
    centred: bool,
) -> Result<Option<Global>> {
    let (columns, texels) = (offset.len(), shards.texels());
    let block = basis.len() / columns;
    let (mut products, moments) = project(shards, offset, &basis, true, centred)?;
    let (mean, energy) = moments.mean_and_energy(offset, texels, centred);
    let mut images = image(shards, offset, &products, block)?;
    for round in 1.. {
        let Some(ritz) = Ritz::largest(&basis, &images, columns, block) else { return Ok(None) };
        // a basis of full rank cannot be improved
        let room = (columns.min(texels) - basis.len() / columns).min(block);
        let done =
            room == 0 || round == KRYLOV_ROUNDS || ritz.components_converged(KRYLOV_TOLERANCES, count, columns, energy);
        let next = if done { None } else { orthonormal_to(&basis, &ritz.images[..room * columns], columns) };
        let Some(next) = next else {
            return match products.triplets(&images, columns, count, texels) {
                Some((basis, coefficients)) => Ok(Some(Global { mean, basis, coefficients, energy })),
                None => within_span(shards, offset, &ritz.into_vectors(), count, centred),
            };
        };
        let (more, _) = project(shards, offset, &next, false, centred)?;
        images.extend(image(shards, offset, &more, room)?);
        products.append(more);
        basis.extend(next);
    }
    Ok(None)
}
