//! Plausible variants of one material.
//!
//! # Model
//! A Latin hypercube: the range of each property of an edit is cut into as many strata as there are variants, and every
//! variant gets one stratum of each, at random. So each property is spread evenly over its range, however few variants
//! there are.
//!
//! # Limits
//! Ranges are chosen by eye. A grey material has no hue to turn: its variants differ in lightness, gloss and contrast.
//!
//! # References
//! mckay1979

use super::{Edit, Recolor};
use crate::random::{Stream, hash};
use crate::{Error, Result};

/// The most variants.
pub const MAX_VARIANTS: usize = 999;

/// The largest spread.
const MAX_SPREAD: f32 = 2.0;

/// Largest changes at a spread of 1: of hue in degrees and of lightness in CIE Lab.
const HUE: f32 = 90.0;
const LIGHTNESS: f32 = 10.0;

/// Largest factors at a spread of 1: of saturation, gloss, highlights and contrast.
const FACTORS: [f32; 4] = [1.4, 1.6, 1.5, 1.3];

/// Draws the edits of `count` variants. A `spread` of 1 keeps them plausible, 0 changes nothing, 2 squares the factors. The same seed
/// gives the same edits. Numbers are rounded to what a user would type.
///
/// # Errors
/// [`Error::Parameter`] if a number is out of range.
pub fn family(count: usize, seed: u64, spread: f32) -> Result<Vec<Edit>> {
    if !(1..=MAX_VARIANTS).contains(&count) {
        return Err(Error::parameter("count", format!("found {count}, expected 1 to {MAX_VARIANTS}")));
    }
    if !(0.0..=MAX_SPREAD).contains(&spread) {
        return Err(Error::parameter("spread", format!("found {spread}, expected 0 to {MAX_SPREAD}")));
    }
    let [hues, lightnesses] = [0, 1].map(|property| places(count, hash(&[seed, property])));
    let factors = [2, 3, 4, 5].map(|property| places(count, hash(&[seed, property])));
    let variant = |k: usize| {
        let factor = |p: usize| (100.0 * FACTORS[p].powf(spread * factors[p][k])).round() / 100.0;
        // without a negative zero
        let whole = |change: f32| (spread * change).round() + 0.0;
        let [hue, lightness] = [HUE * hues[k], LIGHTNESS * lightnesses[k]].map(whole);
        let recolor = Some(Recolor::Turn { hue, saturation: factor(0), lightness });
        Edit { recolor, gloss: factor(1), highlights: factor(2), contrast: factor(3), ..Edit::default() }
    };
    Ok((0..count).map(variant).collect())
}

/// A place in each of as many strata of -1 to 1, in random order.
fn places(count: usize, seed: u64) -> Vec<f32> {
    let mut random = Stream::new(seed);
    let mut places: Vec<f32> = (0..count).map(|k| 2.0 * (k as f32 + random.next()) / count as f32 - 1.0).collect();
    for k in (1..count).rev() {
        places.swap(k, random.below(k + 1));
    }
    places
}
