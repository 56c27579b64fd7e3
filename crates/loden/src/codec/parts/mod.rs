//! The parts of a compressed BTF: planes over texels, tables over directions, and the recipe that turns them into
//! values.
//!
//! Every codec stores such parts ([`recipe`]). Parts can be decoded and evaluated ([`crate::codec::Decoded`]), stored
//! ([`store()`]), rearranged and exchanged ([`MemoryParts`]), and written as files that other programs can open
//! ([`folder`]), all without knowing which codec made them.

#[cfg(feature = "picture")]
pub mod carrier;
mod check;
mod file;
#[cfg(feature = "picture")]
pub mod folder;
mod memory;
#[cfg(feature = "picture")]
pub(crate) mod npy;
mod numbers;
pub mod recipe;
mod store;

pub(in crate::codec) use check::free_of;
#[cfg(feature = "renderers")]
pub(crate) use check::model_layout;
pub(in crate::codec) use file::{FileParts, opened};
pub use memory::MemoryParts;
pub(in crate::codec) use numbers::Memory;
pub use numbers::{Numbers, Shared};
pub use recipe::{Axis, Curve, Expr, PlaneKind, PlaneSpec, Recipe, TableSpec, Views};
pub(in crate::codec) use store::history;
pub use store::{Provenance, store};

use crate::btf::{BtfMeta, Rect};
use crate::{Error, Result};

/// The parts of a compressed BTF, in a file or in memory.
///
/// Parts are valid: the recipe has been checked ([`Recipe::check`]), the types and shapes of all numbers match it,
/// numbers are finite, and indices are below the number of rows.
pub trait Parts: Send + Sync {
    /// Size, directions and conventions of the BTF.
    fn meta(&self) -> &BtfMeta;

    /// The recipe: which parts there are, and how values follow from them.
    fn recipe(&self) -> &Recipe;

    /// The stored numbers of a plane in a rectangle of texels, shape (y, x, number); [`Numbers::Index`] for an index
    /// plane. `view` is ignored unless each view has its own numbers.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the plane, view or texels do not exist; errors of computing the numbers.
    fn plane(&self, plane: usize, view: usize, texels: Rect) -> Result<Numbers>;

    /// The stored numbers of a table, in the shape of its axes.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the table does not exist; errors of computing the numbers.
    fn table(&self, table: usize) -> Result<Numbers>;
}

/// The numbers of a plane in all texels, shape (y, x, number), or (view, y, x, number) if each view has its own.
///
/// # Errors
/// As [`Parts::plane`].
pub fn whole_plane(parts: &dyn Parts, plane: usize) -> Result<Numbers> {
    let (meta, spec) = (parts.meta(), item("plane", &parts.recipe().planes, plane)?);
    let views = if spec.per_view() { meta.views.len() } else { 1 };
    let of_view = (0..views).map(|view| parts.plane(plane, view, Rect::whole(meta)));
    let all = of_view.collect::<Result<Vec<_>>>()?;
    Numbers::concat(&all).ok_or_else(|| Error::parameter(&spec.name, "its views have different types"))
}

/// Item `place` of a list.
///
/// # Errors
/// [`Error::Parameter`] if it does not exist.
fn item<'a, T>(name: &str, list: &'a [T], place: usize) -> Result<&'a T> {
    let missing = || Error::parameter(name, format!("found {place}, expected less than {}", list.len()));
    list.get(place).ok_or_else(missing)
}

/// Checks the arguments of [`Parts::plane`] and returns the plane.
///
/// # Errors
/// [`Error::Parameter`] if the plane, view or texels do not exist.
pub(in crate::codec) fn check_plane(parts: &dyn Parts, plane: usize, view: usize, texels: Rect) -> Result<&PlaneSpec> {
    let spec = item("plane", &parts.recipe().planes, plane)?;
    item("view", parts.meta().views.directions(), view)?;
    texels.check(parts.meta())?;
    Ok(spec)
}

/// The result of [`Parts::plane`], cut from all numbers of the plane.
///
/// # Errors
/// As [`check_plane`].
fn plane_of(parts: &dyn Parts, planes: &[Numbers], plane: usize, view: usize, texels: Rect) -> Result<Numbers> {
    let (meta, spec) = (parts.meta(), check_plane(parts, plane, view, texels)?);
    let block = meta.texels() * spec.count();
    let first = if spec.per_view() { view * block } else { 0 };
    Ok(planes[plane].part(first..first + block).cut(meta, texels, spec.count()))
}
