//! Rounds that improve a basis: subspace iteration, and a block Krylov space.

use super::products::Scope;
use super::{Global, Passes, within_span};
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
pub(super) fn improve<P: Passes>(
    few: &Scope<P>,
    mut basis: Vec<f64>,
    count: usize,
    rounds: usize,
) -> Result<Option<Vec<f64>>> {
    let columns = few.offset.len();
    for _ in 0..rounds {
        let (products, moments) = few.project(&basis, true)?;
        let image = few.image(&products)?;
        products.forget(few.passes);
        let Some(ritz) = Ritz::new(&basis, &image, columns) else { return Ok(None) };
        let (_, energy) = moments.mean_and_energy(few.offset, few.texels(), few.centred);
        let converged = ritz.converged(SUBSAMPLE_TOLERANCE, count, columns, 2, energy);
        basis = ritz.next_basis(columns);
        if converged {
            break;
        }
    }
    Ok(Some(basis))
}

/// Subspace iteration over all texels: each round replaces the basis by its image.
pub(super) fn subspace<P: Passes>(all: &Scope<P>, mut basis: Vec<f64>, count: usize) -> Result<Option<Global>> {
    let (columns, texels) = (all.offset.len(), all.texels());
    let width = basis.len() / columns;
    let mut gathered = None;
    let mut rounds = SUBSPACE_ROUNDS;
    loop {
        let (products, moments) = all.project(&basis, gathered.is_none())?;
        let (mean, energy) = gathered.get_or_insert_with(|| moments.mean_and_energy(all.offset, texels, all.centred));
        let image = all.image(&products)?;
        let Some(ritz) = Ritz::new(&basis, &image, columns) else { return Ok(None) };
        // a basis of full rank cannot be improved
        let done = width == columns.min(texels) || ritz.converged(TOLERANCE, count, columns, 1, *energy);
        rounds -= 1;
        if done || rounds == 0 {
            let moments = (std::mem::take(mean), *energy);
            let inner = products.inner(all.passes)?;
            return match products.triplets(&inner, &image, columns, count) {
                Some((basis, rotation)) => products.finish(all.passes, basis, rotation, moments).map(Some),
                None => {
                    products.forget(all.passes);
                    within_span(all, &ritz.into_vectors(), count)
                }
            };
        }
        products.forget(all.passes);
        basis = ritz.next_basis(columns);
    }
}

/// A block Krylov space over all texels: each round adds the images of the leading Ritz vectors to the basis.
pub(super) fn krylov<P: Passes>(all: &Scope<P>, mut basis: Vec<f64>, count: usize) -> Result<Option<Global>> {
    let (columns, texels) = (all.offset.len(), all.texels());
    let block = basis.len() / columns;
    let (mut products, moments) = all.project(&basis, true)?;
    let (mean, energy) = moments.mean_and_energy(all.offset, texels, all.centred);
    let mut images = all.image(&products)?;
    for round in 1.. {
        let Some(ritz) = Ritz::largest(&basis, &images, columns, block) else { return Ok(None) };
        // a basis of full rank cannot be improved
        let room = (columns.min(texels) - basis.len() / columns).min(block);
        let done =
            room == 0 || round == KRYLOV_ROUNDS || ritz.components_converged(KRYLOV_TOLERANCES, count, columns, energy);
        let next = if done { None } else { orthonormal_to(&basis, &ritz.images[..room * columns], columns) };
        let Some(next) = next else {
            let inner = products.inner(all.passes)?;
            return match products.triplets(&inner, &images, columns, count) {
                Some((basis, rotation)) => products.finish(all.passes, basis, rotation, (mean, energy)).map(Some),
                None => {
                    products.forget(all.passes);
                    within_span(all, &ritz.into_vectors(), count)
                }
            };
        };
        let (more, _) = all.project(&next, false)?;
        images.extend(all.image(&more)?);
        products.append(more);
        basis.extend(next);
    }
    Ok(None)
}
