//! The parts of a compressed BTF: planes over texels, tables over directions, and the recipe that makes values of them.
//!
//! Every codec stores such parts ([`recipe`]). Whoever has them can decode and evaluate them ([`crate::codec::Decoded`]),
//! store them ([`store()`]), rearrange planes and exchange tables ([`MemoryParts`]), write them as files that other programs
//! open ([`folder`]), and need not know which codec made them.

mod check;
mod file;
#[cfg(feature = "picture")]
pub mod folder;
mod memory;
#[cfg(feature = "picture")]
mod npy;
mod numbers;
pub mod recipe;
mod store;

pub(in crate::codec) use check::free_of;
pub(in crate::codec) use file::{FileParts, opened};
pub use memory::MemoryParts;
pub(in crate::codec) use numbers::Memory;
pub use numbers::{Numbers, Shared};
pub use recipe::{Axis, Curve, Expr, PlaneKind, PlaneSpec, Recipe, TableSpec, Views};
pub use store::{Provenance, store};

use crate::btf::{BtfMeta, Rect};
use crate::{Error, Result};

/// The parts of a compressed BTF, in a file or in memory.
///
/// They are valid: the recipe was checked ([`Recipe::check`]), types and shapes of all numbers are those that it says,
/// numbers are finite, and indices less than the number of rows.
pub trait Parts: Send + Sync {
    /// Size, directions and conventions of the BTF.
    fn meta(&self) -> &BtfMeta;

    /// What the parts are, and what is made of them.
    fn recipe(&self) -> &Recipe;

    /// The stored numbers of a plane in some texels, shape (y, x, number); of an index plane [`Numbers::Index`]. `view`
    /// matters only where each view has its own.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such plane, view or texel; what computing them gives.
    fn plane(&self, plane: usize, view: usize, texels: Rect) -> Result<Numbers>;

    /// The stored numbers of a table, in the shape of its axes.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such table; what computing them gives.
    fn table(&self, table: usize) -> Result<Numbers>;
}

/// The numbers of a plane in all texels: view after view where each has its own, shape (view, y, x, number).
///
/// # Errors
/// As [`Parts::plane`].
pub fn whole_plane(parts: &dyn Parts, plane: usize) -> Result<Numbers> {
    let (meta, spec) = (parts.meta(), item("plane", &parts.recipe().planes, plane)?);
    let views = if spec.per_view() { meta.views.len() } else { 1 };
    let of_view = (0..views).map(|view| parts.plane(plane, view, Rect::whole(meta)));
    let all = of_view.collect::<Result<Vec<_>>>()?;
    Numbers::concat(&all).ok_or_else(|| Error::parameter(&spec.name, "its views are of different types"))
}

/// An item of a list.
///
/// # Errors
/// [`Error::Parameter`] if there is none.
fn item<'a, T>(name: &str, list: &'a [T], place: usize) -> Result<&'a T> {
    let missing = || Error::parameter(name, format!("found {place}, expected less than {}", list.len()));
    list.get(place).ok_or_else(missing)
}

/// The plane of these arguments of [`Parts::plane`].
///
/// # Errors
/// [`Error::Parameter`] if there is no such plane, view or texel.
pub(in crate::codec) fn check_plane(parts: &dyn Parts, plane: usize, view: usize, texels: Rect) -> Result<&PlaneSpec> {
    let spec = item("plane", &parts.recipe().planes, plane)?;
    item("view", parts.meta().views.directions(), view)?;
    texels.check(parts.meta())?;
    Ok(spec)
}

/// A plane out of the numbers of all: what [`Parts::plane`] gives.
///
/// # Errors
/// As [`check_plane`].
fn plane_of(parts: &dyn Parts, planes: &[Numbers], plane: usize, view: usize, texels: Rect) -> Result<Numbers> {
    let (meta, spec) = (parts.meta(), check_plane(parts, plane, view, texels)?);
    let block = meta.texels() * spec.count();
    let first = if spec.per_view() { view * block } else { 0 };
    Ok(planes[plane].part(first..first + block).cut(meta, texels, spec.count()))
}
