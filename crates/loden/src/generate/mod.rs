//! New materials from old ones: exchanged, recoloured, made glossier, mixed.
//!
//! Everything here works on [`Rows`]: an index image and the ABRDF of each row, as the clustering codecs store them.
//! [`transport`] says which row of one material corresponds to which of another, [`matching`] which is taken, [`exchange()`]
//! puts the reflectance of one on the pattern of another, [`blend()`] mixes both, [`edit()`] changes chosen rows, and [`family()`]
//! draws edits at random. Blends and edits rest on [`reflectance`], which separates the diffuse part of a row from its highlight.

mod blend;
mod descriptor;
mod edit;
mod exchange;
mod facets;
mod family;
pub mod matching;
pub mod reflectance;
mod rows;
mod select;
mod spread;
pub mod transport;

pub use blend::{blend, resampling_error};
pub use descriptor::{Descriptor, descriptors};
pub use edit::{Edit, Recolor, color, edit, edited_row};
pub use exchange::{Keep, exchange};
pub use family::{MAX_VARIANTS, family};
pub use matching::{Match, Matching};
pub use rows::Rows;
pub use select::Selection;
