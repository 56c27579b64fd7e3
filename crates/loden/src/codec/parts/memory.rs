//! Parts in memory.

use super::{Numbers, Parts, PlaneKind, Recipe, checked, cut};
use crate::btf::{BtfMeta, Rect};
use crate::{Error, Result};

/// Parts in memory: new ones, or a copy of others that may be changed.
///
/// ```
/// # use loden::codec::parts::{MemoryParts, Parts};
/// /// The texels of one material with the tables of another.
/// fn dressed(texels: &dyn Parts, tables: &dyn Parts) -> loden::Result<MemoryParts> {
///     let mut parts = MemoryParts::copy(texels)?;
///     for table in 0..tables.recipe().tables.len() {
///         parts.set_table(table, tables.table(table)?.into_owned())?;
///     }
///     Ok(parts)
/// }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryParts {
    meta: BtfMeta,
    recipe: Recipe,
    /// View after view where each has its own.
    planes: Vec<Numbers<'static>>,
    tables: Vec<Numbers<'static>>,
}

impl MemoryParts {
    /// Parts from the numbers of all planes, shape (y, x, number), or (view, y, x, number) where each view has its own, and
    /// of all tables, in the shape of their axes.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the field of the recipe, or the plane or table whose type, number or values are wrong.
    pub fn new(
        meta: BtfMeta,
        recipe: Recipe,
        planes: Vec<Numbers<'static>>,
        tables: Vec<Numbers<'static>>,
    ) -> Result<Self> {
        recipe.check(&meta)?;
        for (name, found, expected) in
            [("planes", planes.len(), recipe.planes.len()), ("tables", tables.len(), recipe.tables.len())]
        {
            if found != expected {
                return Err(Error::parameter(name, format!("found {found}, the recipe has {expected}")));
            }
        }
        let parts = Self { meta, recipe, planes, tables };
        parts.planes.iter().enumerate().try_for_each(|(plane, numbers)| parts.check_plane(plane, numbers))?;
        parts.tables.iter().enumerate().try_for_each(|(table, numbers)| parts.check_table(table, numbers))?;
        Ok(parts)
    }

    /// A copy of other parts.
    ///
    /// # Errors
    /// What reading them gives.
    pub fn copy(parts: &dyn Parts) -> Result<Self> {
        let (meta, recipe) = (parts.meta().clone(), parts.recipe().clone());
        let planes = (0..recipe.planes.len()).map(|plane| whole_plane(parts, plane)).collect::<Result<_>>()?;
        let tables = (0..recipe.tables.len()).map(|table| Ok(parts.table(table)?.into_owned()));
        let tables = tables.collect::<Result<_>>()?;
        Ok(Self { meta, recipe, planes, tables })
    }

    /// Replaces the numbers of a plane, in the shape that [`MemoryParts::new`] wants.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such plane, or their type, number or values are wrong.
    pub fn set_plane(&mut self, plane: usize, numbers: Numbers<'static>) -> Result<()> {
        self.check_plane(plane, &numbers)?;
        self.planes[plane] = numbers;
        Ok(())
    }

    /// Replaces the numbers of a table, in the shape of its axes.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is no such table, or their type, number or values are wrong.
    pub fn set_table(&mut self, table: usize, numbers: Numbers<'static>) -> Result<()> {
        self.check_table(table, &numbers)?;
        self.tables[table] = numbers;
        Ok(())
    }

    fn check_plane(&self, plane: usize, numbers: &Numbers) -> Result<()> {
        let count = self.recipe.planes.len();
        let spec = self.recipe.planes.get(plane);
        let spec =
            spec.ok_or_else(|| Error::parameter("plane", format!("found {plane}, expected less than {count}")))?;
        let blocks = if spec.per_view() { self.meta.views.len() } else { 1 };
        let expected = blocks * self.meta.texels() * spec.count();
        match spec.kind {
            PlaneKind::Index { rows } => check_index(&spec.name, numbers, expected, rows),
            PlaneKind::Numbers { sample_type, .. } => numbers.check(&spec.name, Some(sample_type), expected),
        }
    }

    fn check_table(&self, table: usize, numbers: &Numbers) -> Result<()> {
        let count = self.recipe.tables.len();
        let spec = self.recipe.tables.get(table);
        let spec =
            spec.ok_or_else(|| Error::parameter("table", format!("found {table}, expected less than {count}")))?;
        let expected = spec.axes.iter().map(|axis| axis.len(&self.meta)).product();
        numbers.check(&spec.name, Some(spec.sample_type), expected)
    }
}

fn check_index(name: &str, numbers: &Numbers, expected: usize, rows: usize) -> Result<()> {
    numbers.check(name, None, expected)?;
    let Numbers::Index(index) = numbers else { return Ok(()) };
    match index.iter().position(|&row| usize::from(row) >= rows) {
        Some(texel) => {
            let problem = format!("texel {texel} is of row {}, expected less than {rows}", index[texel]);
            Err(Error::parameter(name, problem))
        }
        None => Ok(()),
    }
}

/// The numbers of a plane in all texels, of all views in turn where each has its own.
///
/// # Errors
/// What reading them gives.
pub(in crate::codec) fn whole_plane(parts: &dyn Parts, plane: usize) -> Result<Numbers<'static>> {
    let (meta, spec) = (parts.meta(), &parts.recipe().planes[plane]);
    let views = if spec.per_view() { meta.views.len() } else { 1 };
    let mut all = parts.plane(plane, 0, Rect::whole(meta))?.into_owned();
    for view in 1..views {
        all.extend(&parts.plane(plane, view, Rect::whole(meta))?);
    }
    Ok(all)
}

impl Parts for MemoryParts {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    fn plane(&self, plane: usize, view: usize, texels: Rect) -> Result<Numbers<'_>> {
        let spec = checked(&self.recipe, &self.meta, plane, view, texels)?;
        let block = self.meta.texels() * spec.count();
        let first = if spec.per_view() { view * block } else { 0 };
        Ok(cut(self.planes[plane].part(first..first + block), self.meta.width, texels, spec.count()))
    }

    fn table(&self, table: usize) -> Result<Numbers<'_>> {
        let missing = || Error::parameter("table", format!("found {table}, expected less than {}", self.tables.len()));
        let numbers = self.tables.get(table).ok_or_else(missing)?;
        Ok(numbers.part(0..numbers.len()))
    }
}
