//! The recipe: which planes and tables a compressed BTF consists of, and the formula that makes values of them.
//!
//! # Model
//! The value of a texel seen from `view` under `light` is an expression ([`Expr`]) over
//!
//! - **planes**, which have one or more numbers for every texel: coefficients, model parameters, or the number of a table's
//!   row ([`PlaneKind::Index`]);
//! - **tables** over directions, rows, components and channels: means, bases, clusters.
//!
//! A [`Curve`] turns the three channels of the result into linear light. Between sampled directions each table is
//! interpolated, then the expression is evaluated; between texels the results are interpolated, before the curve.
//! `codec::interpret` is this paragraph as code.
//!
//! The recipe is also the layout of the file: its planes and tables are the file's tensors ([`Recipe::tensors`]).

use serde::{Deserialize, Serialize};

use crate::btf::{BtfMeta, SampleType};
use crate::codec::container::TensorSpec;
use crate::color::domain::Domain;

/// The planes and tables of a compressed BTF, and how its values follow from them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Numbers of every texel.
    pub planes: Vec<PlaneSpec>,
    /// Numbers of directions, rows, components and channels.
    pub tables: Vec<TableSpec>,
    /// The value of a texel for a view and a light.
    pub value: Expr,
    /// From the three channels of `value` to linear light.
    pub curve: Curve,
}

/// A plane: numbers of every texel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneSpec {
    /// Its name, also of the tensor.
    pub name: String,
    /// What it holds.
    pub kind: PlaneKind,
}

/// What a plane holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum PlaneKind {
    /// The row of one or more tables that each texel uses. Shape (y, x, bytes): a whole number of 1 byte for up to 256
    /// rows, else 2, the low byte first.
    Index {
        /// Rows of the tables: all indices are smaller.
        rows: usize,
    },
    /// As many numbers for each texel. Shape (y, x, count) behind what `views` says.
    Numbers {
        /// Numbers of a texel.
        count: usize,
        /// Whether they depend on the view.
        views: Views,
        /// Their type.
        sample_type: SampleType,
        /// The table of offsets and scales that the stored numbers are to be turned into values with.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        range: Option<usize>,
    },
}

/// Whether the numbers of a plane depend on the view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Views {
    /// They do not: no dimension in the file.
    None,
    /// They do not: a dimension of length 1 in the file.
    Shared,
    /// Every view has its own.
    Each,
}

/// A table: numbers of directions, rows, components and channels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableSpec {
    /// Its name, also of the tensor.
    pub name: String,
    /// Its dimensions, slowest first.
    pub axes: Vec<Axis>,
    /// The type of its numbers.
    pub sample_type: SampleType,
    /// The table of offsets and scales that the stored numbers are to be turned into values with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<usize>,
}

/// A dimension of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Sampled view directions.
    View,
    /// Sampled light directions.
    Light,
    /// The half vector on a square grid of so many nodes a side, stored row by row: by Lambert's equal-area projection to
    /// the unit disk, from there to the square by the concentric map ([`crate::separable::Grid`]). Looked up bilinearly.
    Half(usize),
    /// Rows that an index plane chooses from.
    Row(usize),
    /// Components that a dot product sums over.
    Component(usize),
    /// Red, green and blue, or what the [`Curve`] makes them of. A table without this axis is the same in all three.
    Channel,
    /// Offset and scale: a stored number n stands for offset + scale n. Only of tables that others name as their range.
    Range,
    /// A dimension of length 1, where a plane has [`Views::Shared`].
    Shared,
}

/// The value at a texel, a view and a light, in three channels. Numbers are places in the recipe's lists.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Expr {
    /// The number of a table.
    Table {
        /// The table.
        table: usize,
        /// The index plane that chooses the row, for a table with rows.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        row: Option<usize>,
    },
    /// The sum over components of a plane's numbers times those of a table.
    Dot {
        /// A plane of as many numbers as the table has components.
        plane: usize,
        /// A table with components.
        table: usize,
        /// The index plane that chooses the row, for a table with rows.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        row: Option<usize>,
    },
    /// Pi times an analytic BRDF, 0 below the surface.
    Model {
        /// A model of [`crate::model::MODELS`].
        name: String,
        /// Lobes of a model that may have several.
        lobes: usize,
        /// Whether it may reflect differently along and across.
        grain: bool,
        /// The parameters that are free, in the order of [`crate::fit::Free`].
        plane: usize,
    },
    /// The sum of at least one.
    Sum(Vec<Expr>),
    /// The product of at least one.
    Product(Vec<Expr>),
    /// Each channel by an expression of its own.
    Channels(Box<[Expr; 3]>),
}

/// What turns the three channels of an expression into linear light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// They are display values: those of the BTF's encoding, sRGB if that is linear.
    Display,
    /// They are linear light.
    Linear,
    /// They are ln(linear light + 0.001).
    Log,
    /// They are ln(Y + 0.00001), U / (Y + 0.00001) and V / (Y + 0.00001) of linear light.
    LogYuv,
    /// They are pi times the BRDF: the light's cosine is multiplied in.
    Brdf,
}

impl From<Domain> for Curve {
    fn from(domain: Domain) -> Self {
        match domain {
            Domain::Display => Self::Display,
            Domain::Linear => Self::Linear,
            Domain::Log => Self::Log,
        }
    }
}

impl Curve {
    /// The domain that the channels are in, if each is turned into light by itself.
    pub fn domain(self) -> Option<Domain> {
        match self {
            Self::Display => Some(Domain::Display),
            Self::Linear => Some(Domain::Linear),
            Self::Log => Some(Domain::Log),
            Self::LogYuv | Self::Brdf => None,
        }
    }
}

impl PlaneSpec {
    /// An index plane that chooses one of `rows`.
    pub fn index(name: &str, rows: usize) -> Self {
        Self { name: name.into(), kind: PlaneKind::Index { rows } }
    }

    /// `count` numbers for each texel, the same in all views.
    pub fn numbers(name: &str, count: usize, sample_type: SampleType) -> Self {
        let kind = PlaneKind::Numbers { count, views: Views::None, sample_type, range: None };
        Self { name: name.into(), kind }
    }

    /// Numbers of a texel in a view.
    pub fn count(&self) -> usize {
        match self.kind {
            PlaneKind::Index { .. } => 1,
            PlaneKind::Numbers { count, .. } => count,
        }
    }

    /// The type of its numbers; `None` for indices.
    pub fn sample_type(&self) -> Option<SampleType> {
        match self.kind {
            PlaneKind::Index { .. } => None,
            PlaneKind::Numbers { sample_type, .. } => Some(sample_type),
        }
    }

    /// The table of offsets and scales of its numbers.
    pub fn range(&self) -> Option<usize> {
        match self.kind {
            PlaneKind::Index { .. } => None,
            PlaneKind::Numbers { range, .. } => range,
        }
    }

    /// Whether every view has numbers of its own.
    pub fn per_view(&self) -> bool {
        matches!(self.kind, PlaneKind::Numbers { views: Views::Each, .. })
    }

    /// The tensor of the file.
    pub fn tensor(&self, meta: &BtfMeta) -> TensorSpec {
        let mut shape = match self.kind {
            PlaneKind::Numbers { views: Views::Each, .. } => vec![meta.views.len()],
            PlaneKind::Numbers { views: Views::Shared, .. } => vec![1],
            _ => Vec::new(),
        };
        let (sample_type, numbers) = match self.kind {
            PlaneKind::Index { rows } => (SampleType::U8, index_bytes(rows)),
            PlaneKind::Numbers { count, sample_type, .. } => (sample_type, count),
        };
        shape.extend([meta.height, meta.width, numbers]);
        TensorSpec { name: self.name.clone(), sample_type, shape }
    }
}

impl TableSpec {
    /// A table of numbers that are stored as they are.
    pub fn new(name: &str, axes: &[Axis], sample_type: SampleType) -> Self {
        Self { name: name.into(), axes: axes.to_vec(), sample_type, range: None }
    }

    /// The tensor of the file.
    pub fn tensor(&self, meta: &BtfMeta) -> TensorSpec {
        let shape = self.axes.iter().map(|axis| axis.len(meta)).collect();
        TensorSpec { name: self.name.clone(), sample_type: self.sample_type, shape }
    }

    /// The length of the axis of rows, if there is one.
    pub fn rows(&self) -> Option<usize> {
        self.axes.iter().find_map(|axis| if let Axis::Row(rows) = axis { Some(*rows) } else { None })
    }

    /// The length of the axis of components, if there is one.
    pub fn components(&self) -> Option<usize> {
        self.axes.iter().find_map(|axis| if let Axis::Component(count) = axis { Some(*count) } else { None })
    }
}

impl Axis {
    /// How many places it has.
    pub fn len(self, meta: &BtfMeta) -> usize {
        match self {
            Self::View => meta.views.len(),
            Self::Light => meta.lights.len(),
            Self::Half(side) => side.saturating_mul(side),
            Self::Row(count) | Self::Component(count) => count,
            Self::Channel => 3,
            Self::Range => 2,
            Self::Shared => 1,
        }
    }
}

impl Expr {
    /// A table without rows.
    pub fn table(table: usize) -> Self {
        Self::Table { table, row: None }
    }

    /// A plane's numbers times the components of a table without rows.
    pub fn dot(plane: usize, table: usize) -> Self {
        Self::Dot { plane, table, row: None }
    }

    /// Calls `visit` with this expression and all inside it, in the order in which they are written.
    pub(in crate::codec) fn visit<'a>(&'a self, visit: &mut impl FnMut(&'a Expr)) {
        visit(self);
        match self {
            Self::Table { .. } | Self::Dot { .. } | Self::Model { .. } => {}
            Self::Sum(terms) | Self::Product(terms) => terms.iter().for_each(|term| term.visit(visit)),
            Self::Channels(channels) => channels.iter().for_each(|channel| channel.visit(visit)),
        }
    }
}

/// A plane or a table by its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A place in [`Recipe::planes`].
    Plane(usize),
    /// A place in [`Recipe::tables`].
    Table(usize),
}

impl Recipe {
    /// Planes and tables in the order of the file: in that in which the expression first names them (of a dot product the
    /// ranges, the table, the plane), those with numbers of more bytes first. So all are aligned.
    ///
    /// # Panics
    /// If [`Recipe::check`] would fail.
    pub fn order(&self) -> Vec<Part> {
        let mut order = Vec::new();
        let mut name = |part: Part| {
            if !order.contains(&part) {
                order.push(part);
            }
        };
        self.value.visit(&mut |expr| {
            let (plane, table, row) = match *expr {
                Expr::Table { table, row } => (None, Some(table), row),
                Expr::Dot { plane, table, row } => (Some(plane), Some(table), row),
                Expr::Model { plane, .. } => (Some(plane), None, None),
                _ => return,
            };
            let ranges =
                [plane.and_then(|plane| self.planes[plane].range()), table.and_then(|table| self.tables[table].range)];
            ranges.into_iter().flatten().chain(table).for_each(|table| name(Part::Table(table)));
            plane.into_iter().chain(row).for_each(|plane| name(Part::Plane(plane)));
        });
        let bytes = |part: &Part| match *part {
            Part::Table(table) => self.tables[table].sample_type.bytes(),
            Part::Plane(plane) => self.planes[plane].sample_type().map_or(1, SampleType::bytes),
        };
        order.sort_by_key(|part| std::cmp::Reverse(bytes(part)));
        order
    }

    /// The tensors of the file, in order.
    ///
    /// # Panics
    /// If [`Recipe::check`] would fail.
    pub fn tensors(&self, meta: &BtfMeta) -> Vec<TensorSpec> {
        let tensor = |part: Part| match part {
            Part::Plane(plane) => self.planes[plane].tensor(meta),
            Part::Table(table) => self.tables[table].tensor(meta),
        };
        self.order().into_iter().map(tensor).collect()
    }

    /// Gives tables as many rows as `rows` says by their names, if these are fewer than there may be, and the index planes
    /// that choose from them as many.
    pub fn with_rows(mut self, rows: impl Fn(&TableSpec) -> Option<usize>) -> Self {
        for table in &mut self.tables {
            let found = rows(table);
            for axis in &mut table.axes {
                if let Axis::Row(most) = axis {
                    *most = found.filter(|found| (1..=*most).contains(found)).unwrap_or(*most);
                }
            }
        }
        let mut chosen = Vec::new();
        self.value.visit(&mut |expr| {
            if let Expr::Table { table, row: Some(row) } | Expr::Dot { table, row: Some(row), .. } = expr {
                chosen.push((*row, self.tables.get(*table).and_then(TableSpec::rows)));
            }
        });
        for (plane, found) in chosen {
            if let (Some(PlaneSpec { kind: PlaneKind::Index { rows }, .. }), Some(found)) =
                (self.planes.get_mut(plane), found)
            {
                *rows = found;
            }
        }
        self
    }
}

/// The largest number of rows that an index plane chooses from: what 16 bits tell apart.
pub const MAX_ROWS: usize = 1 << 16;

/// Bytes of a stored index.
pub fn index_bytes(rows: usize) -> usize {
    if rows <= 256 { 1 } else { 2 }
}
