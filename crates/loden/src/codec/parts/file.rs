//! Parts of a file whose tensors are the planes and tables of its recipe.

use super::memory::check_index;
use super::{Numbers, Parts, PlaneKind, PlaneSpec, Recipe, item, plane_of};
use crate::btf::{BtfMeta, Rect, SampleType};
use crate::codec::container::{Container, TensorSpec};
use crate::{Error, Result};

/// The parts of an open file; numbers stay in its memory map.
#[derive(Debug)]
pub struct FileParts {
    meta: BtfMeta,
    recipe: Recipe,
    /// One view after the other if each has its own numbers; indices as integers.
    planes: Vec<Numbers>,
    tables: Vec<Numbers>,
}

impl FileParts {
    /// Checks the tensors of an open file against a recipe. A table may have fewer rows than the recipe states.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the file, and the tensor or the field of the recipe.
    pub fn new(container: &Container, recipe: Recipe) -> Result<Self> {
        let meta = decoded_meta(container);
        let recipe = recipe.with_rows(|table| {
            let place = table.axes.iter().position(|axis| matches!(axis, super::Axis::Row(_)))?;
            container.shape(&table.name)?.get(place).copied()
        });
        opened(container, "recipe", recipe.check(&meta))?;
        // in file order, so that the error names the first tensor that does not match
        let stored = recipe.tensors(&meta).into_iter().map(|spec| Ok((container.numbers(&spec)?, spec)));
        let stored: Vec<(Numbers, TensorSpec)> = stored.collect::<Result<_>>()?;
        let find = |name: &str| {
            let missing = || Error::invalid(container.path(), format!("tensor {name}"), "it is missing");
            stored.iter().find(|(_, spec)| spec.name == name).ok_or_else(missing)
        };
        let tables = recipe.tables.iter().map(|table| Ok(find(&table.name)?.0.clone())).collect::<Result<_>>()?;
        let plane = |plane: &PlaneSpec| {
            let (numbers, spec) = find(&plane.name)?;
            match plane.kind {
                PlaneKind::Index { rows } => index(container, spec, numbers, rows),
                PlaneKind::Numbers { .. } => Ok(numbers.clone()),
            }
        };
        let planes = recipe.planes.iter().map(plane).collect::<Result<_>>()?;
        Ok(Self { meta, recipe, planes, tables })
    }
}

/// Description of a file's decoded images, which are in single precision.
pub fn decoded_meta(container: &Container) -> BtfMeta {
    BtfMeta { sample_type: SampleType::F32, ..container.meta().clone() }
}

/// Turns a parameter error into an error about a field of a file.
///
/// # Errors
/// [`Error::Invalid`] for a parameter error; other errors unchanged.
pub fn opened<T>(container: &Container, field: &str, result: Result<T>) -> Result<T> {
    result.map_err(|error| match error {
        Error::Parameter { name, problem } => Error::invalid(container.path(), field, format!("{name}: {problem}")),
        other => other,
    })
}

/// Parses stored row indices and checks that all are below `rows`.
fn index(container: &Container, spec: &TensorSpec, stored: &Numbers, rows: usize) -> Result<Numbers> {
    let Numbers::U8(bytes) = stored else { return Ok(stored.clone()) };
    let bytes = bytes.chunks_exact(spec.shape.last().copied().unwrap_or(1).max(1));
    let number = |b: &[u8]| b.iter().rev().fold(0, |number, &byte| number << 8 | u16::from(byte));
    let numbers = Numbers::Index(bytes.map(number).collect::<Vec<u16>>().into());
    let field = format!("tensor {}", spec.name);
    check_index(&numbers, rows).map_err(|problem| Error::invalid(container.path(), field, problem))?;
    Ok(numbers)
}

impl Parts for FileParts {
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
