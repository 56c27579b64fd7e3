//! How good a synthesis is, without knowing what it should be.
//!
//! No number says that a texture looks right; each of these says where it looks wrong. Compare methods by all of them, and
//! with what random blocks and plain tiling reach.
//!
//! # Model
//! - Seam energy: over boundaries between copied regions, the mean squared difference between neighbours and the texels
//!   that they had beside them in the exemplar, relative to that between neighbours in the exemplar.
//! - Verbatim copies: the side of a square with the area of the region that a texel was copied with, the mean over all
//!   texels. Large regions repeat what was seen; tiling copies the whole exemplar.
//! - Repetition: over all displacements, the largest share of texels that copy the same texel as the one displaced by it.
//!   It is 1 for tiling.
//! - Evenness: the entropy of how often parts of the exemplar are used, as a share of the largest possible.
//! - Patch error: at each scale, the root mean square difference between a patch of the result and the one of the exemplar
//!   that is most like it, which one patch in twenty exceeds: the worst places are what is seen. Patches across bad seams are
//!   like none.
//! - Patch distance: at each scale, the sliced Wasserstein distance between the patches of result and exemplar: sorted
//!   projections onto random directions are compared, as root mean squares relative to the contrast of the exemplar.
//! - Spectrum error: the difference between the logarithms of the power of result and exemplar, averaged over rings and
//!   sectors of frequencies.
//!
//! # Limits
//! Numbers depend on the channels that an exemplar has, and are comparable only between results of the same exemplar. A
//! result that repeats the exemplar has the patches of the exemplar, so patch distance and spectrum alone show neither
//! repetition nor seams. They also differ between two halves of one texture: what is below that is as good as the sample can
//! tell ([`HeldOut`]).
//!
//! # References
//! rabin2011, simakov2008

mod copies;
mod patches;
mod planes;
mod spectrum;

use super::{Exemplar, SourceMap};
pub use copies::seam_energy;
use copies::{copy_length, evenness, repetition};
use patches::{patch_distance, patch_error};
use planes::Planes;
use spectrum::spectrum_error;

/// Scales at which patches are compared, each half as fine as the one before.
pub const SCALES: usize = 3;

/// What the measures say of one result. Smaller is better, except for evenness.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Measures {
    /// Mean squared difference at boundaries between copied regions, relative to that between neighbours in the exemplar.
    pub seam_energy: f64,
    /// Mean side of the regions that texels were copied with, in texels.
    pub copy_length: f64,
    /// The largest share of texels that are copied again at one displacement.
    pub repetition: f64,
    /// Entropy of the use of the exemplar, as a share of the largest possible.
    pub evenness: f64,
    /// Difference of patches from the most similar ones of the exemplar, which one in twenty exceeds, at each scale, the finest
    /// first, relative to the contrast of the exemplar.
    pub patch_error: [f64; SCALES],
    /// Distance of patches at each scale, the finest first, relative to the contrast of the exemplar.
    pub patch_distance: [f64; SCALES],
    /// Error of the power spectrum, in nepers.
    pub spectrum_error: f64,
}

/// Texels per side of what is measured of a large result.
const PART: usize = 1024;

/// The top left corner of a map.
fn part(map: &SourceMap) -> SourceMap {
    SourceMap::from_fn(map.width.min(PART), map.height.min(PART), |x, y| map.at(x, y))
}

impl Measures {
    /// Measures a result, of a large one the top left corner.
    pub fn new(exemplar: &Exemplar, map: &SourceMap) -> Self {
        let map = &part(map);
        let (original, result) = (Planes::of(exemplar), Planes::copied(exemplar, map));
        Self {
            seam_energy: seam_energy(exemplar, map),
            copy_length: copy_length(exemplar, map),
            repetition: repetition(exemplar, map),
            evenness: evenness(exemplar, map),
            patch_error: patch_error(map, &original, &result),
            patch_distance: patch_distance(&original, &result),
            spectrum_error: spectrum_error(&original, &result),
        }
    }
}

/// A result of one half of an exemplar, compared with the other half.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct HeldOut {
    /// Distance of patches between the result and the half that it was not made from, at each scale.
    pub result: [f64; SCALES],
    /// The same between the two halves: what cannot be expected to be smaller.
    pub floor: [f64; SCALES],
    /// Error of the power spectrum between the result and the half that it was not made from.
    pub spectrum: f64,
    /// The same between the two halves.
    pub spectrum_floor: f64,
}

impl HeldOut {
    /// Compares `map`, a synthesis from the left half of the exemplar, with the right half.
    pub fn new(exemplar: &Exemplar, map: &SourceMap) -> Self {
        let [left, right] = halves(exemplar);
        let [made, known, other] = [Planes::copied(&left, map), Planes::of(&left), Planes::of(&right)];
        Self {
            result: patch_distance(&other, &made),
            floor: patch_distance(&other, &known),
            spectrum: spectrum_error(&other, &made),
            spectrum_floor: spectrum_error(&other, &known),
        }
    }
}

/// How much less the patches of another picture of the same size are like those of an exemplar than the patches of its two
/// halves are like each other: the largest ratio of patch distances over all scales.
pub(super) fn likeness(exemplar: &Exemplar, other: &Exemplar) -> f64 {
    let [left, right] = halves(exemplar).map(|half| Planes::of(&half));
    let found = patch_distance(&Planes::of(exemplar), &Planes::of(other));
    let floor = patch_distance(&right, &left);
    let ratio = |(found, floor): (f64, f64)| found / floor.max(1e-3);
    found.into_iter().zip(floor).map(ratio).fold(0.0, f64::max)
}

/// The left and the right half of an exemplar, which are not periodic.
pub fn halves(exemplar: &Exemplar) -> [Exemplar; 2] {
    let middle = exemplar.width.div_ceil(2);
    [0..middle, exemplar.width / 2..exemplar.width].map(|columns| {
        let rows = || (0..exemplar.height).map(|y| y * exemplar.width);
        let values = |row: usize| {
            let from = (row + columns.start) * exemplar.channels;
            &exemplar.values[from..from + columns.len() * exemplar.channels]
        };
        let mask = exemplar
            .mask
            .as_ref()
            .map(|mask| rows().flat_map(|row| mask[row + columns.start..row + columns.end].iter().copied()).collect());
        Exemplar {
            width: columns.len(),
            values: rows().flat_map(values).copied().collect(),
            periodic: false,
            mask,
            weights: None,
            ..exemplar.clone()
        }
    })
}

#[cfg(test)]
mod tests;
