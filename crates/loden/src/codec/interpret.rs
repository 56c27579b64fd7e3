//! The interpreter of recipes: what they mean, as code. It is slow, it knows no codec, and fast decoders are tested against it.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};

use super::decoder::Decoder;
use super::network::layers::{Lowest, angles};
use super::network::place::{Corners, Surface, shifted, slope, texel_place};
use super::parts::{Axis, Curve, Expr, Parts, PlaneKind, PlaneSpec, Recipe, Shared, TableSpec, free_of, whole_plane};
use crate::Result;
use crate::btf::{BtfMeta, Cosine};
use crate::color::model::{ColorModel, LOG_Y};
use crate::fit::Free;
use crate::material::angles::{Angles, AngularStencil, Footprint, LightStencil};
use crate::material::sampled::Sampled;
use crate::material::{Blending, Failure, Interpolation, Material};
use crate::model;
use crate::separable::{Grid, Projection};

/// Decodes and evaluates any parts.
///
/// # Model
/// An expression has a value in three channels at a texel and a pair of directions:
///
/// - [`Expr::Table`]: the table's number, of the row that the index plane has at the texel, interpolated linearly between the
///   sampled views and lights around the directions, and bilinearly around the half or difference vector.
/// - [`Expr::Dot`]: the sum over components of the table's number, interpolated in the same way, times the plane's; where
///   the plane has numbers for each view, each sampled view uses its own.
/// - [`Expr::Model`]: pi times the BRDF of the parameters that the plane has at the texel.
/// - [`Expr::Network`]: the outputs of its last layer at the point, whose features are interpolated bilinearly; at most
///   its largest.
/// - [`Expr::Shift`]: the mean of an expression at the four texels around the shifted point, with bilinear weights.
/// - [`Expr::Sum`], [`Expr::Product`], [`Expr::Channels`]: of their terms, channel by channel.
///
/// A material is the mean of the four texels around a texture coordinate with bilinear weights, then the curve to linear light,
/// then the light's cosine where it is not in the values, and a fade below the lowest measured light where it is. With
/// [`Blending::Linear`] the whole, curve included, is evaluated at every texel and sampled pair around a point, and averaged;
/// half and difference vectors are those of the point.
/// Images are values at texels and sampled directions, through the curve and the BTF's encoding.
///
/// # Limits
/// All numbers are held in single precision.
pub struct Interpreter {
    meta: BtfMeta,
    recipe: Recipe,
    /// (view if each has its own, texel, number)
    planes: Vec<Shared<f32>>,
    tables: Vec<Shared<f32>>,
    lowest: Lowest,
}

/// Where an expression is evaluated.
#[derive(Clone)]
struct Place {
    wi: Vec3,
    wo: Vec3,
    /// In texels, whose centres are whole numbers: to the right and down.
    point: Vec2,
    /// The sampled views and lights around these directions, and their weights.
    views: Vec<(usize, f32)>,
    lights: Vec<(usize, f32)>,
}

/// A number of a table: the place on each axis.
#[derive(Clone, Copy, Default)]
pub(crate) struct Cell {
    pub view: usize,
    pub light: usize,
    /// Of the grid over half or difference vectors.
    pub node: usize,
    pub row: usize,
    pub component: usize,
    pub channel: usize,
    /// Of a layer of a network.
    pub output: usize,
    pub input: usize,
    /// 0 for the offset, 1 for the scale.
    pub range: usize,
}

impl Interpreter {
    /// Reads all numbers.
    ///
    /// # Errors
    /// What reading the parts gives.
    pub fn new(parts: &dyn Parts) -> Result<Self> {
        let recipe = parts.recipe().clone();
        let planes =
            (0..recipe.planes.len()).map(|plane| Ok(whole_plane(parts, plane)?.to_f32())).collect::<Result<_>>()?;
        let tables = (0..recipe.tables.len()).map(|table| Ok(parts.table(table)?.to_f32())).collect::<Result<_>>()?;
        Ok(Self { meta: parts.meta().clone(), recipe, planes, tables, lowest: Lowest::new(parts.meta()) })
    }

    /// The value of an expression at a texel, in three channels.
    fn value(&self, expr: &Expr, texel: usize, at: &Place) -> Result<DVec3> {
        let channels = |value: &dyn Fn(usize) -> f64| DVec3::new(value(0), value(1), value(2));
        Ok(match expr {
            Expr::Table { table, row } => {
                let number = |cell: Cell| self.number(*table, cell);
                channels(&|channel| self.interpolated(*table, *row, texel, at, channel, false, &number))
            }
            Expr::Dot { plane, table, row } => {
                let spec = &self.recipe.planes[*plane];
                let product = |cell: Cell| {
                    let product = |component| {
                        let cell = Cell { component, ..cell };
                        self.coefficient(*plane, cell, texel) * self.number(*table, cell)
                    };
                    (0..spec.count()).map(product).sum()
                };
                channels(&|channel| self.interpolated(*table, *row, texel, at, channel, spec.per_view(), &product))
            }
            Expr::Model { name, lobes, grain, plane } => {
                let free = free_of(name, *lobes, *grain)?;
                self.model(name, &free, *plane, texel, at)?
            }
            Expr::Network { plane, layers, most } => {
                self.network(*plane, layers, at).min(DVec3::splat(f64::from(*most)))
            }
            Expr::Shift { height, mirror, value } => {
                let (_, wo) = self.lowest.raised(at.wi, at.wo);
                let [_, point] = shifted(at.point, slope(wo, *mirror), &Heights { interpreter: self, plane: *height });
                let at = Place { point, ..at.clone() };
                let mean = |(texel, weight)| Ok(f64::from(weight) * self.value(value, texel, &at)?);
                self.corners(point).map(mean).sum::<Result<DVec3>>()?
            }
            Expr::Sum(terms) => terms.iter().map(|term| self.value(term, texel, at)).sum::<Result<DVec3>>()?,
            Expr::Product(terms) => terms.iter().map(|term| self.value(term, texel, at)).product::<Result<DVec3>>()?,
            Expr::Channels(exprs) => {
                let [r, g, b] = exprs.each_ref().map(|expr| self.value(expr, texel, at));
                DVec3::new(r?.x, g?.y, b?.z)
            }
        })
    }

    /// The texels around a place and their weights.
    fn corners(&self, place: Vec2) -> impl Iterator<Item = (usize, f32)> + use<> {
        let corners = Corners::new(place, [self.meta.width, self.meta.height]);
        corners.texel.into_iter().zip(corners.weights())
    }

    /// The outputs of a network.
    fn network(&self, plane: usize, layers: &[usize], at: &Place) -> DVec3 {
        let count = self.recipe.planes[plane].count();
        let feature = |component| {
            let of_texel = |texel| self.coefficient(plane, Cell { component, ..Cell::default() }, texel);
            self.corners(at.point).map(|(texel, weight)| f64::from(weight) * of_texel(texel)).sum()
        };
        let mut inputs: Vec<f64> = (0..count).map(feature).collect();
        let (wi, wo) = self.lowest.raised(at.wi, at.wo);
        inputs.extend(angles(wi, wo).map(f64::from));
        for (place, &layer) in layers.iter().enumerate() {
            inputs.push(1.0);
            let last = place + 1 == layers.len();
            let outputs = self.recipe.tables[layer].axes[0].len(&self.meta);
            let output = |output| {
                let weight = |input| self.number(layer, Cell { output, channel: output, input, ..Cell::default() });
                let sum: f64 = inputs.iter().enumerate().map(|(input, value)| weight(input) * value).sum();
                if last { sum } else { sum.max(0.0) }
            };
            inputs = (0..outputs).map(output).collect();
        }
        DVec3::new(inputs[0], inputs[1], inputs[2])
    }

    /// The sum of weights times what `value` gives at the cells around a place; a table is not looked at along axes that it
    /// does not have, unless `per_view` says that something else depends on the view.
    #[expect(clippy::too_many_arguments, reason = "where, and what is there")]
    fn interpolated(
        &self,
        table: usize,
        row: Option<usize>,
        texel: usize,
        at: &Place,
        channel: usize,
        per_view: bool,
        value: &dyn Fn(Cell) -> f64,
    ) -> f64 {
        let axes = &self.recipe.tables[table].axes;
        let nowhere = [(0, 1.0)];
        let views = if per_view || axes.contains(&Axis::View) { &at.views[..] } else { &nowhere };
        let lights = if axes.contains(&Axis::Light) { &at.lights[..] } else { &nowhere };
        let grid = axes.iter().find_map(|axis| match axis {
            Axis::Half(side) => Some((*side, Projection::Half)),
            Axis::Difference(side) => Some((*side, Projection::Difference)),
            _ => None,
        });
        let around = |(side, projection): (usize, Projection)| Grid::stencil(side, projection.of(at.wi, at.wo));
        let nodes = grid.map_or(nowhere.to_vec(), |grid| around(grid).to_vec());
        let row = row.map_or(0, |plane| self.planes[plane][texel] as usize);
        let mut sum = 0.0;
        for &(view, view_weight) in views {
            for &(light, light_weight) in lights {
                for &(node, node_weight) in &nodes {
                    let weight = f64::from(view_weight) * f64::from(light_weight) * f64::from(node_weight);
                    sum += weight * value(Cell { view, light, node, row, channel, ..Cell::default() });
                }
            }
        }
        sum
    }

    /// The same with all numbers in the form of the values that they stand for, after `round`: without offsets and scales.
    #[cfg(feature = "renderers")]
    pub(crate) fn explicit(&self, round: &dyn Fn(f64) -> f32) -> Self {
        let (texels, mut recipe) = (self.meta.texels(), self.recipe.clone());
        let plane = |plane: usize| {
            let Some(count) = self.recipe.planes[plane].sample_type().map(|_| self.recipe.planes[plane].count()) else {
                return self.planes[plane].clone();
            };
            let value = |place: usize| {
                let cell = Cell { view: place / (count * texels), component: place % count, ..Cell::default() };
                round(self.coefficient(plane, cell, place / count % texels))
            };
            (0..self.planes[plane].len()).map(value).collect::<Vec<f32>>().into()
        };
        let table = |table: usize| {
            let axes = &self.recipe.tables[table].axes;
            if axes.contains(&Axis::Range) {
                return self.tables[table].clone();
            }
            let value = |mut place: usize| {
                let mut cell = Cell::default();
                for &axis in axes.iter().rev() {
                    let length = axis.len(&self.meta);
                    cell.set(axis, place % length);
                    place /= length;
                }
                round(self.number(table, cell))
            };
            (0..self.tables[table].len()).map(value).collect::<Vec<f32>>().into()
        };
        let planes = (0..self.planes.len()).map(plane).collect();
        let tables = (0..self.tables.len()).map(table).collect();
        recipe.tables.iter_mut().for_each(|spec| spec.range = None);
        for spec in &mut recipe.planes {
            if let PlaneKind::Numbers { range, .. } = &mut spec.kind {
                *range = None;
            }
        }
        Self { meta: self.meta.clone(), recipe, planes, tables, lowest: self.lowest }
    }

    /// Its recipe.
    #[cfg(feature = "picture")]
    pub(crate) fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// The numbers of a plane as they are stored.
    #[cfg(feature = "picture")]
    pub(crate) fn plane(&self, plane: usize) -> &[f32] {
        &self.planes[plane]
    }

    /// The numbers of a table as they are stored.
    #[cfg(feature = "renderers")]
    pub(crate) fn table(&self, table: usize) -> &[f32] {
        &self.tables[table]
    }

    /// The number of a table in a cell; places on axes that it does not have do not matter.
    pub(crate) fn number(&self, table: usize, cell: Cell) -> f64 {
        let TableSpec { axes, range, .. } = &self.recipe.tables[table];
        let place = axes.iter().fold(0, |place, &axis| place * axis.len(&self.meta) + cell.on(axis));
        self.unscaled(f64::from(self.tables[table][place]), *range, cell)
    }

    /// The number of a plane at a texel, in the view and of the component of a cell.
    fn coefficient(&self, plane: usize, cell: Cell, texel: usize) -> f64 {
        let PlaneSpec { kind, .. } = &self.recipe.planes[plane];
        let PlaneKind::Numbers { count, range, .. } = *kind else { return 0.0 };
        let view = if self.recipe.planes[plane].per_view() { cell.view } else { 0 };
        let place = (view * self.meta.texels() + texel) * count + cell.component;
        self.unscaled(f64::from(self.planes[plane][place]), range, cell)
    }

    /// What a stored number stands for.
    fn unscaled(&self, stored: f64, range: Option<usize>, cell: Cell) -> f64 {
        match range {
            Some(table) => {
                let [offset, scale] = [0, 1].map(|range| self.number(table, Cell { range, ..cell }));
                offset + scale * stored
            }
            None => stored,
        }
    }

    /// Pi times the BRDF of a texel, not negative.
    fn model(&self, name: &str, free: &Free, plane: usize, texel: usize, at: &Place) -> Result<DVec3> {
        let (wi, wo) = (at.wi.as_dvec3().normalize(), at.wo.as_dvec3().normalize());
        let number = |component| self.coefficient(plane, Cell { component, ..Cell::default() }, texel) as f32;
        let numbers: Vec<f32> = (0..free.count()).map(number).collect();
        let brdf = model::Analytic::new(model::by_name(name)?, free.values(&numbers)?)?;
        // the bound keeps the mean of texels finite
        Ok((std::f64::consts::PI * brdf.brdf(wi, wo)).min(DVec3::splat(1e9)))
    }

    /// What the curve makes of a value: linear light as far as the cosine is not concerned.
    fn linear(&self, value: DVec3) -> Vec3 {
        let value = value.as_vec3();
        match self.recipe.curve {
            Curve::LogYuv => {
                // the bound keeps a damaged file's values finite
                let bounded = [value.x.min(40.0), value.y, value.z];
                Vec3::from(ColorModel::plain(LOG_Y).decode(bounded)).max(Vec3::ZERO)
            }
            Curve::Brdf => value,
            curve => match curve.domain() {
                Some(domain) => Vec3::from(value.to_array().map(|v| domain.to_linear(self.meta.encoding, v))),
                None => value,
            },
        }
    }

    /// The place of a texel's centre.
    fn centre(&self, texel: usize) -> Vec2 {
        Vec2::new((texel % self.meta.width) as f32, (texel / self.meta.width) as f32)
    }

    /// A pixel of an image.
    fn pixel(&self, texel: usize, at: &Place) -> Result<[f32; 3]> {
        let value = self.value(&self.recipe.value, texel, at)?;
        if let Some(domain) = self.recipe.curve.domain() {
            return Ok(value.as_vec3().to_array().map(|v| domain.to_stored(self.meta.encoding, v)));
        }
        let cosine = if self.recipe.curve == Curve::Brdf { stored_cosine(&self.meta, at.wi) } else { 1.0 };
        Ok((self.linear(value) * cosine).to_array().map(|v| self.meta.encoding.encode(v)))
    }

    /// The apparent value at a texture coordinate.
    pub(crate) fn apparent(&self, uv: Vec2, angles: &Angles, blending: Blending, wi: Vec3, wo: Vec3) -> Result<Vec3> {
        let view = angles.views_around(wo);
        let mut light = LightStencil::NONE;
        let Some(stencil) = angles.lit(&view, wi, wo, &mut light) else { return Ok(Vec3::ZERO) };
        let footprint = Footprint::new(uv, self.meta.width, self.meta.height);
        if blending != Blending::Linear {
            let point = texel_place(uv, [self.meta.width, self.meta.height]);
            return self.around(&footprint, point, &stencil, wi, wo);
        }
        let mut failed = Ok(());
        let mean = stencil.averaged(&footprint, |stencil, footprint| {
            let centre = self.centre(footprint.texel[0]);
            self.around(footprint, centre, stencil, wi, wo).unwrap_or_else(|error| {
                failed = Err(error);
                Vec3::ZERO
            })
        });
        failed.map(|()| mean)
    }

    /// The apparent value of the mean of texels and sampled pairs.
    fn around(&self, footprint: &Footprint, point: Vec2, stencil: &AngularStencil, wi: Vec3, wo: Vec3) -> Result<Vec3> {
        let (views, lights) = (stencil.view.iter().collect(), stencil.light.iter().collect());
        let place = Place { wi, wo, point, views, lights };
        let mut sum = DVec3::ZERO;
        for (texel, weight) in footprint.texel.into_iter().zip(footprint.weight) {
            sum += self.value(&self.recipe.value, texel, &place)? * f64::from(weight);
        }
        // a model is exact at every direction: it needs no fade
        let factor = if self.recipe.curve == Curve::Brdf { wi.z } else { stencil.factor };
        Ok(self.linear(sum).max(Vec3::ZERO) * factor)
    }
}

/// The heights of a plane.
struct Heights<'a> {
    interpreter: &'a Interpreter,
    plane: usize,
}

impl Surface for Heights<'_> {
    fn height(&self, place: Vec2) -> f32 {
        let of_texel = |texel| self.interpreter.coefficient(self.plane, Cell::default(), texel) as f32;
        self.interpreter.corners(place).map(|(texel, weight)| weight * of_texel(texel)).sum()
    }
}

/// What a stored value holds of the light's cosine, at least 0.01.
pub(super) fn stored_cosine(meta: &BtfMeta, wi: Vec3) -> f32 {
    match meta.cosine {
        Cosine::Included => wi.z.max(0.01),
        Cosine::Excluded => 1.0,
    }
}

impl Cell {
    #[cfg(feature = "renderers")]
    fn set(&mut self, axis: Axis, place: usize) {
        match axis {
            Axis::View => self.view = place,
            Axis::Light => self.light = place,
            Axis::Half(_) | Axis::Difference(_) => self.node = place,
            Axis::Row(_) => self.row = place,
            Axis::Component(_) => self.component = place,
            Axis::Channel => self.channel = place,
            Axis::Output(_) => self.output = place,
            Axis::Input(_) => self.input = place,
            Axis::Range => self.range = place,
            Axis::Shared => {}
        }
    }

    fn on(&self, axis: Axis) -> usize {
        match axis {
            Axis::View => self.view,
            Axis::Light => self.light,
            Axis::Half(_) | Axis::Difference(_) => self.node,
            Axis::Row(_) => self.row,
            Axis::Component(_) => self.component,
            Axis::Channel => self.channel,
            Axis::Output(_) => self.output,
            Axis::Input(_) => self.input,
            Axis::Range => self.range,
            Axis::Shared => 0,
        }
    }
}

impl Decoder for Interpreter {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        for (light, image) in lights.zip(out.chunks_exact_mut(self.meta.image_len())) {
            let (wi, wo) = self.meta.pair(view, light);
            let mut place = Place { wi, wo, point: Vec2::ZERO, views: vec![(view, 1.0)], lights: vec![(light, 1.0)] };
            for (texel, out) in image.chunks_exact_mut(3).enumerate() {
                place.point = self.centre(texel);
                out.copy_from_slice(&self.pixel(texel, &place)?);
            }
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        self.planes.iter().chain(&self.tables).map(|numbers| size_of_val(&numbers[..]) as u64).sum()
    }

    fn material(self: Arc<Self>, Interpolation { scheme, blending }: Interpolation) -> Result<Arc<dyn Material>> {
        let angles = Angles::new(&self.meta, scheme)?;
        let material = Interpreted { angles, blending, interpreter: self.clone(), failure: Failure::default() };
        Ok(Arc::new(Sampled::new(material, &self.meta, scheme)?))
    }
}

struct Interpreted {
    interpreter: Arc<Interpreter>,
    angles: Angles,
    blending: Blending,
    failure: Failure,
}

impl Material for Interpreted {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let value = self.interpreter.apparent(uv, &self.angles, self.blending, wi, wo);
        self.failure.ok(value).unwrap_or(Vec3::ZERO)
    }

    fn check(&self) -> Result<()> {
        self.failure.check()
    }
}
