//! Checks a recipe before anything is read or allocated for it.

use super::recipe::{Axis, Expr, MAX_ROWS, PlaneKind, PlaneSpec, Recipe, TableSpec, Views};
use crate::btf::{BtfMeta, SampleType};
use crate::codec::container::TensorSpec;
use crate::codec::network::layers::ANGLES;
use crate::fit::{Free, Options};
use crate::model;
use crate::{Error, Result};

/// Maximum nesting of expressions.
const MAX_DEPTH: usize = 8;

/// Maximum number of planes, of tables, and of expressions.
const MAX_PARTS: usize = 256;

/// Maximum length of a name.
const MAX_NAME: usize = 64;

/// Maximum nodes per side of a table over half vectors.
const MAX_SIDE: usize = 4096;

/// Maximum outputs of a layer of a network, and maximum number of layers.
const MAX_OUTPUTS: usize = 1024;
const MAX_LAYERS: usize = 8;

/// Maximum numbers in a plane or table.
const MAX_NUMBERS: u64 = 1 << 36;

impl Recipe {
    /// Checks every name, index, shape and limit for a BTF with the description `meta`.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the field of the recipe, such as `recipe.value.sum[1].dot.table`.
    pub fn check(&self, meta: &BtfMeta) -> Result<()> {
        for (field, count) in [("recipe.planes", self.planes.len()), ("recipe.tables", self.tables.len())] {
            expect(count <= MAX_PARTS, field, || format!("found {count}, expected at most {MAX_PARTS}"))?;
        }
        let planes = self.planes.iter().map(|plane| ("planes", plane.tensor(meta)));
        let tables = self.tables.iter().map(|table| ("tables", table.tensor(meta)));
        let tensors: Vec<(&str, TensorSpec)> = planes.chain(tables).collect();
        for (i, (list, tensor)) in tensors.iter().enumerate() {
            check_tensor(&format!("recipe.{list}.{}", tensor.name), tensor)?;
            let twice = tensors[..i].iter().any(|(_, other)| other.name == tensor.name);
            expect(!twice, &format!("recipe.{list}"), || format!("the name {:?} occurs twice", tensor.name))?;
        }
        self.planes.iter().try_for_each(|plane| self.check_plane(plane))?;
        self.tables.iter().try_for_each(|table| self.check_table(table))?;
        let (planes, tables) = (vec![false; self.planes.len()], vec![false; self.tables.len()]);
        let mut check = Check { recipe: self, planes, tables, count: 0 };
        check.expr(&self.value, "recipe.value", 0)?;
        check.all_used()
    }

    fn check_plane(&self, plane: &PlaneSpec) -> Result<()> {
        let field = format!("recipe.planes.{}", plane.name);
        match plane.kind {
            PlaneKind::Index { rows } => expect((1..=MAX_ROWS).contains(&rows), &field, || {
                format!("found {rows} rows, expected 1 to {MAX_ROWS}")
            }),
            PlaneKind::Numbers { count, views, range, .. } => {
                let own: &[Axis] = match views {
                    Views::Each => &[Axis::View],
                    Views::Shared => &[Axis::Shared],
                    Views::None => &[],
                };
                let own: Vec<Axis> = own.iter().copied().chain([Axis::Component(count)]).collect();
                range.map_or(Ok(()), |range| self.check_range(&field, &own, range))
            }
        }
    }

    fn check_table(&self, table: &TableSpec) -> Result<()> {
        let field = format!("recipe.tables.{}", table.name);
        let same = |a: &Axis, b: &Axis| std::mem::discriminant(a) == std::mem::discriminant(b);
        for (i, axis) in table.axes.iter().enumerate() {
            let twice = table.axes[..i].iter().any(|other| same(other, axis));
            expect(!twice, &field, || format!("the axis {axis:?} occurs twice"))?;
            match *axis {
                Axis::Row(rows) => expect((1..=MAX_ROWS).contains(&rows), &field, || {
                    format!("found {rows} rows, expected 1 to {MAX_ROWS}")
                })?,
                Axis::Half(side) | Axis::Difference(side) => expect((2..=MAX_SIDE).contains(&side), &field, || {
                    format!("found {side} nodes per side, expected 2 to {MAX_SIDE}")
                })?,
                _ => {}
            }
        }
        let grids = table.axes.iter().filter(|axis| matches!(axis, Axis::Half(_) | Axis::Difference(_))).count();
        expect(grids < 2, &field, || "the axes half and difference occur together".into())?;
        table.range.map_or(Ok(()), |range| self.check_range(&field, &table.axes, range))
    }

    /// The axes of a range: some of the axes `own` of its numbers, then [`Axis::Range`].
    fn check_range(&self, field: &str, own: &[Axis], range: usize) -> Result<()> {
        let field = format!("{field}.range");
        let table = lookup(&self.tables, range, &field, "tables")?;
        let (last, others) = table.axes.split_last().unwrap_or((&Axis::Channel, &[]));
        let fits = *last == Axis::Range && others.iter().all(|axis| own.contains(axis));
        expect(fits, &field, || {
            format!("the axes of {} are {:?}, expected some of {own:?} and Range", table.name, table.axes)
        })?;
        expect(table.sample_type == SampleType::F32 && table.range.is_none(), &field, || {
            format!("{} does not have plain single-precision numbers", table.name)
        })
    }
}

fn check_tensor(field: &str, tensor: &TensorSpec) -> Result<()> {
    let name = &tensor.name;
    let letters = name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_');
    expect(letters && (1..=MAX_NAME).contains(&name.len()), field, || {
        format!("a name of 1 to {MAX_NAME} characters of a-z, 0-9 and _ is expected, found {name:?}")
    })?;
    let numbers = tensor.shape.iter().try_fold(1u64, |product, &n| product.checked_mul(n as u64));
    let numbers = numbers.unwrap_or(u64::MAX);
    expect((1..=MAX_NUMBERS).contains(&numbers), field, || {
        format!("the shape {:?} has {numbers} numbers, expected 1 to {MAX_NUMBERS}", tensor.shape)
    })
}

/// State of checking an expression.
struct Check<'a> {
    recipe: &'a Recipe,
    /// Planes and tables named so far.
    planes: Vec<bool>,
    tables: Vec<bool>,
    count: usize,
}

impl<'a> Check<'a> {
    fn expr(&mut self, expr: &Expr, field: &str, depth: usize) -> Result<()> {
        self.count += 1;
        expect(depth < MAX_DEPTH, field, || format!("expressions are nested deeper than {MAX_DEPTH}"))?;
        expect(self.count <= MAX_PARTS, field, || format!("there are more than {MAX_PARTS} expressions"))?;
        match expr {
            Expr::Table { table, row } => {
                let field = format!("{field}.table");
                let table = self.values(&field, *table, *row)?;
                let plain = table.components().is_none();
                expect(plain, &field, || format!("{} has components, which only a dot product sums", table.name))
            }
            Expr::Dot { plane, table, row } => {
                let field = format!("{field}.dot");
                let (table, plane) = (self.values(&field, *table, *row)?, self.numbers(&field, *plane)?);
                expect(table.components() == Some(plane.count()), &field, || {
                    let found = table.components().unwrap_or(0);
                    format!("{} has {found} components, but {} has {} numbers", table.name, plane.name, plane.count())
                })
            }
            Expr::Model { name, lobes, grain, plane } => {
                self.model(&format!("{field}.model"), name, *lobes, *grain, *plane)
            }
            Expr::Network { plane, layers, most } => {
                let field = format!("{field}.network");
                expect(most.is_finite(), &format!("{field}.most"), || format!("found {most}, expected a number"))?;
                self.network(&field, *plane, layers)
            }
            Expr::Shift { height, value, .. } => {
                let field = format!("{field}.shift");
                let plane = self.numbers(&field, *height)?;
                expect(plane.count() == 1 && !plane.per_view(), &field, || {
                    format!("{} does not have one number for each texel", plane.name)
                })?;
                self.expr(value, &format!("{field}.value"), depth + 1)
            }
            Expr::Sum(terms) => self.all(terms, &format!("{field}.sum"), depth),
            Expr::Product(terms) => self.all(terms, &format!("{field}.product"), depth),
            Expr::Channels(channels) => self.all(&channels[..], &format!("{field}.channels"), depth),
        }
    }

    fn all(&mut self, terms: &[Expr], field: &str, depth: usize) -> Result<()> {
        expect(!terms.is_empty(), field, || "it is empty".into())?;
        terms.iter().enumerate().try_for_each(|(i, term)| self.expr(term, &format!("{field}[{i}]"), depth + 1))
    }

    /// Checks a table of values, which has no axes of a network.
    fn values(&mut self, field: &str, table: usize, row: Option<usize>) -> Result<&'a TableSpec> {
        let spec = self.table(field, table, row)?;
        let weights = spec.axes.iter().any(|axis| matches!(axis, Axis::Output(_) | Axis::Input(_)));
        expect(!weights, field, || format!("{} has weights of a network", spec.name))?;
        Ok(spec)
    }

    /// Checks that each layer has the inputs that the one before gives.
    fn network(&mut self, field: &str, plane: usize, layers: &[usize]) -> Result<()> {
        let features = self.numbers(field, plane)?;
        expect(!features.per_view(), field, || format!("{} differs from view to view", features.name))?;
        expect((2..=MAX_LAYERS).contains(&layers.len()), &format!("{field}.layers"), || {
            format!("found {} layers, expected 2 to {MAX_LAYERS}", layers.len())
        })?;
        let mut inputs = features.count() + ANGLES + 1;
        for (place, &layer) in layers.iter().enumerate() {
            let field = format!("{field}.layers[{place}]");
            let table = self.table(&field, layer, None)?;
            let last = place + 1 == layers.len();
            let outputs = match (&table.axes[..], table.range) {
                ([Axis::Channel, Axis::Input(found)], None) if last && *found == inputs => 3,
                ([Axis::Output(outputs), Axis::Input(found)], None) if !last && *found == inputs => *outputs,
                _ => {
                    let first = if last { "channel" } else { "output" };
                    let problem =
                        format!("{} has the axes {:?}, expected {first}, input({inputs})", table.name, table.axes);
                    return Err(Error::parameter(field, problem));
                }
            };
            expect((1..=MAX_OUTPUTS).contains(&outputs), &field, || {
                format!("{} has {outputs} outputs, expected 1 to {MAX_OUTPUTS}", table.name)
            })?;
            inputs = outputs + 1;
        }
        Ok(())
    }

    /// Checks a table: if it has rows, an index plane must choose from exactly as many.
    fn table(&mut self, field: &str, table: usize, row: Option<usize>) -> Result<&'a TableSpec> {
        let spec = lookup(&self.recipe.tables, table, &format!("{field}.table"), "tables")?;
        for used in spec.range.into_iter().chain([table]) {
            self.tables[used] = true;
        }
        expect(!spec.axes.contains(&Axis::Range), field, || format!("{} is a table of ranges", spec.name))?;
        let field = format!("{field}.row");
        let rows = match row {
            Some(row) => match self.plane(&field, row)?.kind {
                PlaneKind::Index { rows } => Some(rows),
                PlaneKind::Numbers { .. } => {
                    return Err(Error::parameter(field, format!("plane {row} is not an index plane")));
                }
            },
            None => None,
        };
        expect(spec.rows() == rows, &field, || match (spec.rows(), rows) {
            (Some(_), None) => format!("{} has rows, but no index plane is named", spec.name),
            (None, _) => format!("{} has no rows", spec.name),
            (Some(found), Some(rows)) => {
                format!("{} has {found} rows, but the index plane chooses from {rows}", spec.name)
            }
        })?;
        Ok(spec)
    }

    fn plane(&mut self, field: &str, plane: usize) -> Result<&'a PlaneSpec> {
        let spec = lookup(&self.recipe.planes, plane, field, "planes")?;
        self.planes[plane] = true;
        Ok(spec)
    }

    /// Checks a plane that must not hold indices.
    fn numbers(&mut self, field: &str, plane: usize) -> Result<&'a PlaneSpec> {
        let field = format!("{field}.plane");
        let spec = self.plane(&field, plane)?;
        match spec.kind {
            PlaneKind::Index { .. } => Err(Error::parameter(field, format!("{} is an index plane", spec.name))),
            PlaneKind::Numbers { range, .. } => {
                range.into_iter().for_each(|range| self.tables[range] = true);
                Ok(spec)
            }
        }
    }

    fn model(&mut self, field: &str, name: &str, lobes: usize, grain: bool, plane: usize) -> Result<()> {
        let plane = self.numbers(field, plane)?;
        expect(!plane.per_view(), field, || format!("{} differs from view to view", plane.name))?;
        let problem = |e: Error| Error::parameter(field, e.to_string());
        let free = free_of(name, lobes, grain).map_err(problem)?;
        expect(free.count() == plane.count(), field, || {
            format!("{name} has {} free parameters, but {} has {} numbers", free.count(), plane.name, plane.count())
        })
    }

    fn all_used(&self) -> Result<()> {
        let planes = self.recipe.planes.iter().map(|plane| &plane.name).zip(&self.planes);
        let tables = self.recipe.tables.iter().map(|table| &table.name).zip(&self.tables);
        match planes.chain(tables).find(|(_, used)| !**used) {
            Some((name, _)) => Err(Error::parameter("recipe.value", format!("{name} does not occur in it"))),
            None => Ok(()),
        }
    }
}

/// The free parameters of a model in a recipe.
///
/// # Errors
/// [`Error::Parameter`] for an unknown model or too many lobes.
pub(in crate::codec) fn free_of(name: &str, lobes: usize, grain: bool) -> Result<Free> {
    let model = model::by_name(name)?;
    Free::new(model, &Options { lobes, anisotropic: grain, ..Options::default() })
}

/// What the numbers of a model in a recipe are.
///
/// # Errors
/// As [`free_of`].
#[cfg(feature = "renderers")]
pub(crate) fn model_layout(name: &str, lobes: usize, grain: bool) -> Result<crate::fit::Layout> {
    Ok(free_of(name, lobes, grain)?.layout())
}

fn lookup<'a, T>(list: &'a [T], place: usize, field: &str, name: &str) -> Result<&'a T> {
    let missing = || Error::parameter(field, format!("found {place}, but there are {} {name}", list.len()));
    list.get(place).ok_or_else(missing)
}

fn expect(holds: bool, field: &str, problem: impl FnOnce() -> String) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::parameter(field, problem())) }
}
