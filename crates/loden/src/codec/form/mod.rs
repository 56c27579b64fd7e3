//! Fast decoders and materials, one file or folder per form of recipe, listed in `FORMS`.
//!
//! A form is chosen by the recipe alone, never by the codec. It decodes and evaluates what the
//! [interpreter](super::interpret) would, up to rounding; `tests/parts` compares them for every codec. Recipes of
//! no known form are left to the interpreter.

mod channels;
pub mod factored;
mod neural;
mod product;
pub mod quantised;
mod texel_models;

use std::sync::Arc;

use super::decoder::Decoder;
use super::parts::Parts;
use crate::Result;

pub(super) use quantised::{Components, Means};

/// Makes a decoder of parts whose recipe has this form; `None` for other recipes.
pub(super) type Form = fn(&Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>>;

/// All forms, tried in order.
pub(super) const FORMS: &[Form] =
    &[factored::form, quantised::form, product::form, channels::form, texel_models::form, neural::form];
