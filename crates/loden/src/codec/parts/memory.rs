//! Parts in memory.

use super::{Numbers, Parts, PlaneKind, Recipe, item, plane_of, whole_plane};
use crate::btf::{BtfMeta, Rect};
use crate::{Error, Result};

/// Parts in memory: new ones, or copies of other parts with some of them replaced.
///
/// ```
/// use loden::codec::parts::{MemoryParts, Parts};
///
/// /// The texels of one material with the tables of another.
/// fn dressed(texels: &dyn Parts, tables: &dyn Parts) -> loden::Result<MemoryParts> {
///     let mut parts = MemoryParts::copy(texels)?;
///     for table in 0..tables.recipe().tables.len() {
///         parts.set_table(table, tables.table(table)?)?;
///     }
///     Ok(parts)
/// }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryParts {
    meta: BtfMeta,
    recipe: Recipe,
    /// One view after the other if each has its own numbers.
    planes: Vec<Numbers>,
    tables: Vec<Numbers>,
}

impl MemoryParts {
    /// Parts from the numbers of all planes, shape (y, x, number), or (view, y, x, number) if each view has its own,
    /// and of all tables, in the shape of their axes.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the field of the recipe, or the plane or table whose type, length or values are
    /// wrong.
    pub fn new(meta: BtfMeta, recipe: Recipe, planes: Vec<Numbers>, tables: Vec<Numbers>) -> Result<Self> {
        recipe.check(&meta)?;
        for (name, found, expected) in
            [("planes", planes.len(), recipe.planes.len()), ("tables", tables.len(), recipe.tables.len())]
        {
            if found != expected {
                return Err(Error::parameter(name, format!("found {found}, expected {expected} as in the recipe")));
            }
        }
        let parts = Self { meta, recipe, planes, tables };
        parts.planes.iter().enumerate().try_for_each(|(plane, numbers)| parts.check_plane(plane, numbers))?;
        parts.tables.iter().enumerate().try_for_each(|(table, numbers)| parts.check_table(table, numbers))?;
        Ok(parts)
    }

    /// Copies other parts. Numbers in memory or in the map of a file are shared, not copied.
    ///
    /// # Errors
    /// Errors of reading the parts.
    pub fn copy(parts: &dyn Parts) -> Result<Self> {
        let (meta, recipe) = (parts.meta().clone(), parts.recipe().clone());
        let planes = (0..recipe.planes.len()).map(|plane| whole_plane(parts, plane)).collect::<Result<_>>()?;
        let tables = (0..recipe.tables.len()).map(|table| parts.table(table)).collect::<Result<_>>()?;
        Ok(Self { meta, recipe, planes, tables })
    }

    /// Replaces the numbers of a plane, in the shape of [`MemoryParts::new`].
    ///
    /// # Errors
    /// [`Error::Parameter`] if the plane does not exist, or type, length or values are wrong.
    pub fn set_plane(&mut self, plane: usize, numbers: Numbers) -> Result<()> {
        self.check_plane(plane, &numbers)?;
        self.planes[plane] = numbers;
        Ok(())
    }

    /// Replaces the numbers of a table, in the shape of its axes.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the table does not exist, or type, length or values are wrong.
    pub fn set_table(&mut self, table: usize, numbers: Numbers) -> Result<()> {
        self.check_table(table, &numbers)?;
        self.tables[table] = numbers;
        Ok(())
    }

    fn check_plane(&self, plane: usize, numbers: &Numbers) -> Result<()> {
        let spec = item("plane", &self.recipe.planes, plane)?;
        let blocks = if spec.per_view() { self.meta.views.len() } else { 1 };
        let expected = blocks * self.meta.texels() * spec.count();
        match spec.kind {
            PlaneKind::Index { rows } => {
                numbers.check(&spec.name, None, expected)?;
                check_index(numbers, rows).map_err(|problem| Error::parameter(&spec.name, problem))
            }
            PlaneKind::Numbers { sample_type, .. } => numbers.check(&spec.name, Some(sample_type), expected),
        }
    }

    fn check_table(&self, table: usize, numbers: &Numbers) -> Result<()> {
        let spec = item("table", &self.recipe.tables, table)?;
        let expected = spec.axes.iter().map(|axis| axis.len(&self.meta)).product();
        numbers.check(&spec.name, Some(spec.sample_type), expected)
    }
}

/// Checks that all indices are valid rows; the error describes the first that is not.
pub(super) fn check_index(numbers: &Numbers, rows: usize) -> std::result::Result<(), String> {
    let Numbers::Index(index) = numbers else { return Ok(()) };
    match index.iter().position(|&row| usize::from(row) >= rows) {
        Some(texel) => Err(format!("texel {texel} has row {}, expected less than {rows}", index[texel])),
        None => Ok(()),
    }
}

impl Parts for MemoryParts {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    fn plane(&self, plane: usize, view: usize, texels: Rect) -> Result<Numbers> {
        plane_of(self, &self.planes, plane, view, texels)
    }

    fn table(&self, table: usize) -> Result<Numbers> {
        item("table", &self.tables, table).cloned()
    }
}
