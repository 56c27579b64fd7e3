//! The parts of a compressed BTF: planes over texels, tables over directions, and the recipe that makes values of them.
//!
//! Every codec stores such parts ([`recipe`]). Whoever has them can decode and evaluate them ,
//! store them , rearrange the planes, or exchange the tables ([`MemoryParts`]), and need not know
//! which codec made them.

mod check;
mod memory;
mod numbers;
pub mod recipe;

use std::borrow::Cow;

pub use memory::MemoryParts;
pub use numbers::Numbers;
pub use recipe::{Axis, Curve, Expr, PlaneKind, PlaneSpec, Recipe, TableSpec, Views};

use crate::Result;
use crate::btf::{BtfMeta, Rect};

/// The parts of a compressed BTF, in a file or in memory. They are valid: types, numbers and shapes are those of the
/// recipe, numbers are finite, and indices less than the number of rows.
pub trait Parts: Send + Sync {
    /// Size, directions and conventions of the BTF.
    fn meta(&self) -> &BtfMeta;

    /// What the parts are, and what is made of them.
    fn recipe(&self) -> &Recipe;

    /// The stored numbers of a plane in some texels, shape (y, x, number); of an index plane [`Numbers::Index`]. `view`
    /// matters only where each view has its own.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if there is no such plane, view or texel.
    fn plane(&self, plane: usize, view: usize, texels: Rect) -> Result<Numbers<'_>>;

    /// The stored numbers of a table, in the shape of its axes.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if there is no such table.
    fn table(&self, table: usize) -> Result<Numbers<'_>>;
}

/// The numbers of some texels out of those of a whole plane, `count` for each texel.
pub(in crate::codec) fn cut<'a>(all: Numbers<'a>, width: usize, texels: Rect, count: usize) -> Numbers<'a> {
    fn rows<T: Copy>(all: &[T], width: usize, texels: Rect, count: usize) -> Vec<T> {
        let row = |y: usize| &all[count * (y * width + texels.x)..][..count * texels.width];
        (texels.y..texels.y + texels.height).flat_map(|y| row(y).iter().copied()).collect()
    }
    if texels.width * texels.height * count == all.len() {
        return all;
    }
    match all {
        Numbers::U8(values) => Numbers::U8(Cow::Owned(rows(&values, width, texels, count))),
        Numbers::Index(values) => Numbers::Index(Cow::Owned(rows(&values, width, texels, count))),
        Numbers::F16(values) => Numbers::F16(Cow::Owned(rows(&values, width, texels, count))),
        Numbers::F32(values) => Numbers::F32(Cow::Owned(rows(&values, width, texels, count))),
    }
}

/// The plane of this place, after the arguments of [`Parts::plane`] were checked.
///
/// # Errors
/// [`crate::Error::Parameter`] if there is no such plane, view or texel.
pub(in crate::codec) fn checked<'a>(
    recipe: &'a Recipe,
    meta: &BtfMeta,
    plane: usize,
    view: usize,
    texels: Rect,
) -> Result<&'a PlaneSpec> {
    let below = |name: &str, found: usize, count: usize| {
        let problem = || crate::Error::parameter(name, format!("found {found}, expected less than {count}"));
        if found < count { Ok(()) } else { Err(problem()) }
    };
    below("plane", plane, recipe.planes.len())?;
    below("view", view, meta.views.len())?;
    texels.check(meta)?;
    Ok(&recipe.planes[plane])
}
