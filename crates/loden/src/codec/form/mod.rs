//! Fast decoders and materials, one file or folder for each form of recipe, in `FORMS`.
//!
//! A form is chosen by the recipe alone, never by the codec. What it decodes and evaluates is what the
//! [interpreter](super::interpret) does, but for rounding; `tests/parts.rs` compares them for every codec. A recipe that has
//! none of these forms is left to the interpreter.

mod channels;
pub mod factored;
mod product;
pub mod quantised;
mod texel_models;

use std::sync::Arc;

use super::decoder::Decoder;
use super::parts::Parts;
use crate::Result;

/// Makes a decoder of parts whose recipe has a certain form; `None` for others.
pub(super) type Form = fn(&Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>>;

/// All forms.
pub(super) const FORMS: &[Form] = &[factored::form, quantised::form, product::form, channels::form, texel_models::form];
