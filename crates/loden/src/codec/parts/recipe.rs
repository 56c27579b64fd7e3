//! The recipe: the planes and tables of a compressed BTF, and the formula that turns them into values.
//!
//! # Model
//! The value of a texel seen from `view` under `light` is an expression ([`Expr`]) of
//!
//! - **planes**, which have one or more numbers per texel: coefficients, model parameters, or the row of a table
//!   ([`PlaneKind::Index`]);
//! - **tables** over directions, rows, components and channels: means, bases, clusters.
//!
//! A [`Curve`] converts the three channels of the result to linear light. Around a point the expression and the curve are
//! evaluated at every texel and sampled pair of directions, and averaged ([`Blending::Linear`]); or the tables are interpolated
//! between sampled directions before the expression is evaluated, and its values between texels before the curve
//! ([`Blending::Stored`]). [`Recipe::blending`] is the default. `codec::interpret` implements exactly this paragraph.
//!
//! The recipe is also the layout of the file: its planes and tables are the file's tensors ([`Recipe::tensors`]).

use serde::{Deserialize, Serialize};

use crate::btf::{BtfMeta, SampleType};
use crate::codec::container::TensorSpec;
use crate::color::domain::Domain;
use crate::material::Blending;

/// The planes and tables of a compressed BTF, and the formula of its values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The planes: numbers per texel.
    pub planes: Vec<PlaneSpec>,
    /// The tables: numbers over directions, rows, components and channels.
    pub tables: Vec<TableSpec>,
    /// The value of a texel for a view and a light.
    pub value: Expr,
    /// Converts the three channels of `value` to linear light.
    pub curve: Curve,
}

/// A plane: numbers for every texel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneSpec {
    /// Its name, which is also that of the tensor.
    pub name: String,
    /// Its content.
    pub kind: PlaneKind,
}

/// Content of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum PlaneKind {
    /// The row of one or more tables that each texel uses. Shape (y, x, bytes): an integer of 1 byte for up to 256
    /// rows, else 2, low byte first.
    Index {
        /// Number of rows of the tables; all indices are below it.
        rows: usize,
    },
    /// A fixed count of numbers per texel. Shape (y, x, count), after the dimension that `views` adds.
    Numbers {
        /// Numbers per texel.
        count: usize,
        /// Whether they depend on the view.
        views: Views,
        /// Their type.
        sample_type: SampleType,
        /// The table of offsets and scales that converts stored numbers to values.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        range: Option<usize>,
    },
}

/// Whether the numbers of a plane depend on the view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Views {
    /// They do not, and the file has no dimension for views.
    None,
    /// They do not, and the file has a dimension of length 1.
    Shared,
    /// They do: every view has its own numbers.
    Each,
}

/// A table: numbers over directions, rows, components and channels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableSpec {
    /// Its name, which is also that of the tensor.
    pub name: String,
    /// Its dimensions, slowest first.
    pub axes: Vec<Axis>,
    /// The type of its numbers.
    pub sample_type: SampleType,
    /// The table of offsets and scales that converts stored numbers to values.
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
    /// The half vector on a square grid with this many nodes per side, stored row by row: Lambert's equal-area
    /// projection to the unit disk, then the concentric map to the square ([`crate::separable::Grid`]). Interpolated
    /// bilinearly.
    Half(usize),
    /// The difference vector, the light in the frame of the half vector ([`crate::separable::Projection::Difference`]), on a
    /// grid as of [`Axis::Half`]. A table has one of the two at most.
    Difference(usize),
    /// Rows, from which an index plane chooses.
    Row(usize),
    /// Components, which a dot product sums over.
    Component(usize),
    /// Red, green and blue, or other channels if the [`Curve`] says so. A table without this axis is the same in all
    /// three.
    Channel,
    /// Outputs of a layer of a network.
    Output(usize),
    /// Inputs of a layer of a network, and at the end one that is always 1.
    Input(usize),
    /// Offset and scale: a stored number n means offset + scale n. Only in tables that others name as their range.
    Range,
    /// A dimension of length 1, for planes with [`Views::Shared`].
    Shared,
}

/// The value at a texel, view and light, in three channels. Planes and tables are named by their index in the recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Expr {
    /// A table's value.
    Table {
        /// The table.
        table: usize,
        /// The index plane that chooses the row, if the table has rows.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        row: Option<usize>,
    },
    /// The dot product of a plane's numbers with the components of a table.
    Dot {
        /// A plane with as many numbers as the table has components.
        plane: usize,
        /// A table with components.
        table: usize,
        /// The index plane that chooses the row, if the table has rows.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        row: Option<usize>,
    },
    /// Pi times an analytic BRDF; 0 below the surface.
    Model {
        /// A model of [`crate::model::MODELS`].
        name: String,
        /// Number of lobes, for models that may have several.
        lobes: usize,
        /// Whether the model is anisotropic.
        grain: bool,
        /// The plane of the free parameters, in the order of [`crate::fit::Free`].
        plane: usize,
    },
    /// A small neural network: its first layer sees the numbers of a plane, interpolated between texels, and numbers that follow
    /// from the two directions; negative outputs of all layers but the last become 0. It is a function of the directions
    /// themselves, which are raised to the lowest sampled ones, and knows nothing of sampled views and lights.
    Network {
        /// The plane.
        plane: usize,
        /// The tables of weights, first layer first, with the axes [`Axis::Output`] and [`Axis::Input`]; the last has
        /// [`Axis::Channel`] for its outputs.
        layers: Vec<usize>,
        /// The largest output: what was measured, so that no value between the measured directions is far beyond.
        most: f32,
    },
    /// An expression at another place: where the ray of the viewer meets a surface that is a height above the texels.
    Shift {
        /// A plane of heights in texels.
        height: usize,
        /// Whether azimuths run clockwise in the picture, as in data whose pictures are upside down.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        mirror: bool,
        /// What is evaluated there.
        value: Box<Expr>,
    },
    /// The sum of one or more expressions.
    Sum(Vec<Expr>),
    /// The product of one or more expressions.
    Product(Vec<Expr>),
    /// Red, green and blue by separate expressions.
    Channels(Box<[Expr; 3]>),
}

/// Conversion of the three channels of an expression to linear light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// Display values: in the BTF's encoding, or sRGB if that is linear.
    Display,
    /// Linear light.
    Linear,
    /// ln(linear light + 0.001).
    Log,
    /// ln(Y + 0.00001), U / (Y + 0.00001) and V / (Y + 0.00001) of linear light.
    LogYuv,
    /// Pi times the BRDF, to be multiplied by the cosine of the light.
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
    /// The domain of the channels, if each is converted separately.
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

    /// `count` numbers per texel, the same in all views.
    pub fn numbers(name: &str, count: usize, sample_type: SampleType) -> Self {
        let kind = PlaneKind::Numbers { count, views: Views::None, sample_type, range: None };
        Self { name: name.into(), kind }
    }

    /// Numbers per texel in one view.
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

    /// The tensor that stores the plane.
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
    /// A table whose numbers are stored as they are.
    pub fn new(name: &str, axes: &[Axis], sample_type: SampleType) -> Self {
        Self { name: name.into(), axes: axes.to_vec(), sample_type, range: None }
    }

    /// The tensor that stores the table.
    pub fn tensor(&self, meta: &BtfMeta) -> TensorSpec {
        let shape = self.axes.iter().map(|axis| axis.len(meta)).collect();
        TensorSpec { name: self.name.clone(), sample_type: self.sample_type, shape }
    }

    /// The number of rows, if the table has an axis of rows.
    pub fn rows(&self) -> Option<usize> {
        self.axes.iter().find_map(|axis| if let Axis::Row(rows) = axis { Some(*rows) } else { None })
    }

    /// The number of components, if the table has an axis of components.
    pub fn components(&self) -> Option<usize> {
        self.axes.iter().find_map(|axis| if let Axis::Component(count) = axis { Some(*count) } else { None })
    }
}

impl Axis {
    /// Length of the axis.
    pub fn len(self, meta: &BtfMeta) -> usize {
        match self {
            Self::View => meta.views.len(),
            Self::Light => meta.lights.len(),
            Self::Half(side) | Self::Difference(side) => side.saturating_mul(side),
            Self::Row(count) | Self::Component(count) | Self::Output(count) | Self::Input(count) => count,
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

    /// The dot product of a plane with a table without rows.
    pub fn dot(plane: usize, table: usize) -> Self {
        Self::Dot { plane, table, row: None }
    }

    /// Calls `visit` with this expression and all nested ones, in written order.
    pub(in crate::codec) fn visit<'a>(&'a self, visit: &mut impl FnMut(&'a Expr)) {
        visit(self);
        match self {
            Self::Table { .. } | Self::Dot { .. } | Self::Model { .. } | Self::Network { .. } => {}
            Self::Shift { value, .. } => value.visit(visit),
            Self::Sum(terms) | Self::Product(terms) => terms.iter().for_each(|term| term.visit(visit)),
            Self::Channels(channels) => channels.iter().for_each(|channel| channel.visit(visit)),
        }
    }
}

/// Index of a plane or a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A place in [`Recipe::planes`].
    Plane(usize),
    /// A place in [`Recipe::tables`].
    Table(usize),
}

impl Recipe {
    /// What a choice of [`Blending`] means for this recipe: never [`Blending::Auto`]. Values that are linear light already
    /// are averaged as they are.
    pub fn blending(&self, chosen: Blending) -> Blending {
        let (mut has_rows, mut has_network) = (false, false);
        self.value.visit(&mut |expr| match expr {
            Expr::Table { table, row: Some(_) } => {
                let axes = &self.tables[*table].axes;
                has_rows |= axes.contains(&Axis::View) && axes.contains(&Axis::Light);
            }
            Expr::Network { .. } => has_network = true,
            _ => {}
        });
        match chosen {
            // a network is not a mean of values at texels and sampled directions
            _ if self.is_linear() || has_network => Blending::Stored,
            // a row is looked up for every texel and pair all the same
            Blending::Auto if has_rows => Blending::Linear,
            Blending::Auto => Blending::Stored,
            chosen => chosen,
        }
    }

    /// Whether the numbers of the expression are linear light.
    pub fn is_linear(&self) -> bool {
        matches!(self.curve, Curve::Linear | Curve::Brdf)
    }

    /// Planes and tables in file order: as the expression first names them (for a dot product the ranges, the table,
    /// the plane), but wider numbers first, so that all are aligned.
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
                Expr::Model { plane, .. } | Expr::Shift { height: plane, .. } => (Some(plane), None, None),
                Expr::Network { plane, ref layers, .. } => {
                    layers.iter().for_each(|layer| name(Part::Table(*layer)));
                    (Some(plane), None, None)
                }
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

    /// The tensors of the file, in file order.
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

    /// Sets the number of rows of tables by name, if smaller than stated, and of the index planes that choose from
    /// them.
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

/// The largest number of rows that a 16-bit index can distinguish.
pub const MAX_ROWS: usize = 1 << 16;

/// Bytes per stored index.
pub(crate) fn index_bytes(rows: usize) -> usize {
    if rows <= 256 { 1 } else { 2 }
}
