//! Fast decoder of recipes that are a network of equally wide layers over the features of texels, with or without a shift by
//! a height.

use std::ops::Range;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use crate::Result;
use crate::btf::{BtfMeta, Rect};
use crate::codec::decoder::Decoder;
use crate::codec::network::lanes::{Finish, Kernel, LANES, Lanes, Packed, compute};
use crate::codec::network::layers::{ANGLES, Lowest, Network, Shape, angles};
use crate::codec::network::place::{Corners, Surface, shifted, slope, texel_place};
use crate::codec::parts::{Axis, Expr, Numbers, Parts, Recipe, Shared};
use crate::color::domain::{Domain, Linearizer};
use crate::material::angles::LightStencil;
use crate::material::texels::{Lookup, TexelMaterial, TexelPoint};
use crate::material::{Interpolation, Material};

/// Numbers of a plane as they are held; values follow by an offset and a scale of each component.
enum Held {
    U8(Shared<u8>),
    F32(Shared<f32>),
}

struct Plane {
    count: usize,
    numbers: Held,
    /// (offset, scale) by component.
    range: Vec<[f32; 2]>,
}

impl Plane {
    /// A plane of a recipe; `None` if its numbers have another form.
    fn new(parts: &dyn Parts, plane: usize) -> Result<Option<Self>> {
        let (recipe, meta) = (parts.recipe(), parts.meta());
        let count = recipe.planes[plane].count();
        let numbers = parts.plane(plane, 0, Rect::whole(meta))?;
        let range = match recipe.planes[plane].range() {
            None => vec![[0.0, 1.0]; count],
            Some(range) if recipe.tables[range].axes == [Axis::Component(count), Axis::Range] => {
                parts.table(range)?.to_f32().as_chunks::<2>().0.to_vec()
            }
            Some(_) => return Ok(None),
        };
        let numbers = match numbers {
            Numbers::U8(numbers) => Held::U8(numbers),
            numbers => Held::F32(numbers.to_f32()),
        };
        Ok(Some(Self { count, numbers, range }))
    }

    /// Adds up the numbers of four texels with weights, into `rows` (component, lane).
    #[inline(always)]
    fn look_up(&self, corners: &Corners, rows: &mut [f32], lane: usize) {
        match &self.numbers {
            Held::U8(numbers) => look_up(numbers, self.count, corners, rows, lane),
            Held::F32(numbers) => look_up(numbers, self.count, corners, rows, lane),
        }
    }

    /// The value of the first component at a texel.
    #[inline(always)]
    fn first(&self, texel: usize) -> f32 {
        let [offset, scale] = self.range[0];
        let number = match &self.numbers {
            Held::U8(numbers) => numbers[texel * self.count].single(),
            Held::F32(numbers) => numbers[texel * self.count],
        };
        offset + scale * number
    }

    fn bytes(&self) -> usize {
        match &self.numbers {
            Held::U8(numbers) => size_of_val(&numbers[..]),
            Held::F32(numbers) => size_of_val(&numbers[..]),
        }
    }
}

/// A plane of heights.
struct Heights<'a> {
    heights: &'a Plane,
    size: [usize; 2],
}

impl Surface for Heights<'_> {
    #[inline(always)]
    fn height(&self, place: Vec2) -> f32 {
        let corners = Corners::new(place, self.size);
        let ([a, b, c, d], [wa, wb, wc, wd]) = (corners.texel, corners.weights());
        let heights = self.heights;
        wa * heights.first(a) + wb * heights.first(b) + wc * heights.first(c) + wd * heights.first(d)
    }
}

#[inline(always)]
fn look_up<T: Number>(numbers: &[T], count: usize, corners: &Corners, rows: &mut [f32], lane: usize) {
    let ([a, b, c, d], [wa, wb, wc, wd]) = (corners.texel, corners.weights());
    let (a, b) = (&numbers[a * count..][..count], &numbers[b * count..][..count]);
    let (c, d) = (&numbers[c * count..][..count], &numbers[d * count..][..count]);
    for ((((row, a), b), c), d) in rows[lane..].iter_mut().step_by(LANES).zip(a).zip(b).zip(c).zip(d) {
        *row = wa * a.single() + wb * b.single() + wc * c.single() + wd * d.single();
    }
}

/// A type of stored numbers.
trait Number: Copy {
    fn single(self) -> f32;
}

impl Number for u8 {
    #[inline(always)]
    fn single(self) -> f32 {
        self.into()
    }
}

impl Number for f32 {
    #[inline(always)]
    fn single(self) -> f32 {
        self
    }
}

/// A network with its planes.
struct NetworkBtf {
    meta: BtfMeta,
    domain: Domain,
    network: Network,
    /// The first layer with its columns for angles.
    first: Packed,
    features: Plane,
    /// The plane of heights and whether slopes are mirrored.
    heights: Option<(Plane, bool)>,
    lowest: Lowest,
    /// The largest output.
    most: f32,
}

/// See [`super::FORMS`].
///
/// # Errors
/// Errors of reading the parts.
pub fn form(parts: &Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>> {
    let (meta, recipe) = (parts.meta(), parts.recipe());
    let (value, height) = match &recipe.value {
        Expr::Shift { height, mirror, value } => (&**value, Some((*height, *mirror))),
        value => (value, None),
    };
    let (Expr::Network { plane, layers, most }, Some(domain)) = (value, recipe.curve.domain()) else { return Ok(None) };
    let Some(shape) = shape(recipe, *plane, layers) else { return Ok(None) };
    let Some(features) = Plane::new(&**parts, *plane)? else { return Ok(None) };
    let heights = match height {
        Some((height, mirror)) => match Plane::new(&**parts, height)? {
            Some(plane) => Some((plane, mirror)),
            None => return Ok(None),
        },
        None => None,
    };
    let mut weights = Vec::new();
    for &layer in layers {
        weights.extend_from_slice(&parts.table(layer)?.to_f32());
    }
    unscale(&mut weights, shape, &features.range);
    let [rows, columns] = shape.layer(0);
    let mut first = Packed::new(rows, columns - 1);
    first.set(|row, column| weights[row * columns + column]);
    let network = Network::new(shape, &weights);
    let lowest = Lowest::new(meta);
    Ok(Some(Arc::new(NetworkBtf {
        meta: meta.clone(),
        domain,
        network,
        first,
        features,
        heights,
        lowest,
        most: *most,
    })))
}

/// The sizes of a network; `None` if its hidden layers differ.
fn shape(recipe: &Recipe, plane: usize, layers: &[usize]) -> Option<Shape> {
    let (_, hidden) = layers.split_last()?;
    let width = |layer: usize| match recipe.tables[layer].axes[0] {
        Axis::Output(width) => Some(width),
        _ => None,
    };
    let first = width(*hidden.first()?)?;
    let equal = hidden.iter().all(|layer| width(*layer) == Some(first));
    equal.then_some(Shape { features: recipe.planes[plane].count(), width: first, hidden: hidden.len() })
}

/// Weights for numbers as they are held instead of the values they stand for.
fn unscale(weights: &mut [f32], shape: Shape, range: &[[f32; 2]]) {
    let [rows, columns] = shape.layer(0);
    for row in weights.chunks_exact_mut(columns).take(rows) {
        let (inputs, constant) = row.split_at_mut(columns - 1);
        for (weight, [offset, scale]) in inputs.iter_mut().zip(range) {
            constant[0] += *weight * offset;
            *weight *= scale;
        }
    }
}

impl NetworkBtf {
    /// Writes the features at the place that a viewer sees to `rows` (feature, lane).
    #[inline(always)]
    fn look_up(&self, place: Vec2, wo: Vec3, rows: &mut [f32], lane: usize) {
        let size = [self.meta.width, self.meta.height];
        let place = match &self.heights {
            Some((heights, mirror)) => shifted(place, slope(wo, *mirror), &Heights { heights, size })[1],
            None => place,
        };
        self.features.look_up(&Corners::new(place, size), rows, lane);
    }
}

impl Decoder for NetworkBtf {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        compute(Images { btf: self, view, lights, out }, false);
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        let weights: usize =
            (0..self.network.shape.layers()).map(|layer| self.network.shape.layer(layer)).map(|[r, c]| 4 * r * c).sum();
        let heights = self.heights.as_ref().map_or(0, |(plane, _)| plane.bytes());
        (self.features.bytes() + heights + 2 * weights) as u64
    }

    fn material(self: Arc<Self>, Interpolation { scheme, .. }: Interpolation) -> Result<Arc<dyn Material>> {
        let lookup = Lookup::new(&self.meta, scheme)?;
        let linearizer = Linearizer::new(self.domain, self.meta.encoding);
        Ok(Arc::new(NetworkMaterial { lookup, linearizer, btf: self }))
    }
}

/// Decodes images of a view.
struct Images<'a> {
    btf: &'a NetworkBtf,
    view: usize,
    lights: Range<usize>,
    out: &'a mut [f32],
}

impl Kernel for Images<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { btf, view, lights, out } = self;
        let (meta, shape) = (&btf.meta, btf.network.shape);
        let stored = btf.domain.is_stored(meta.encoding);
        let pairs: Vec<(Vec3, Vec3)> = lights.map(|light| meta.pair(view, light)).collect();
        let raised: Vec<(Vec3, Vec3)> = pairs.iter().map(|&(wi, wo)| btf.lowest.raised(wi, wo)).collect();
        let mut starts = vec![0.0; pairs.len() * shape.width];
        for (start, &(wi, wo)) in starts.chunks_exact_mut(shape.width).zip(&raised) {
            btf.network.start(&angles(wi, wo), start);
        }
        let mut features = vec![0.0; shape.features * LANES];
        let mut layers = [vec![0.0; shape.width * LANES], vec![0.0; shape.width * LANES]];
        for first in (0..meta.texels()).step_by(LANES) {
            let count = LANES.min(meta.texels() - first);
            let mut seen = None;
            let images = out.chunks_exact_mut(meta.image_len());
            for ((image, start), &(_, wo)) in images.zip(starts.chunks_exact(shape.width)).zip(&raised) {
                // lights of a view share its places
                if seen.replace(wo) != Some(wo) {
                    for lane in 0..count {
                        let texel = first + lane;
                        let centre = Vec2::new((texel % meta.width) as f32, (texel / meta.width) as f32);
                        btf.look_up(centre, wo, &mut features, lane);
                    }
                }
                let [r, g, b] = btf.network.values::<V>(start, &features, &mut layers);
                for (lane, out) in image[3 * first..][..3 * count].chunks_exact_mut(3).enumerate() {
                    out.copy_from_slice(&[r[lane].min(btf.most), g[lane].min(btf.most), b[lane].min(btf.most)]);
                    if !stored {
                        out.iter_mut().for_each(|v| *v = btf.domain.to_stored(meta.encoding, *v));
                    }
                }
            }
        }
    }
}

/// Evaluates the network at the directions themselves.
struct NetworkMaterial {
    lookup: Lookup,
    linearizer: Linearizer,
    btf: Arc<NetworkBtf>,
}

/// Evaluates up to any number of points.
struct Points<'a, 'b> {
    material: &'a NetworkMaterial,
    points: &'a [&'b TexelPoint],
    wi: &'a [Vec3],
    values: &'a mut [Vec3],
}

impl Kernel for Points<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        let NetworkMaterial { lookup, linearizer, btf } = self.material;
        let (network, shape) = (&btf.network, btf.network.shape);
        let size = [btf.meta.width, btf.meta.height];
        let mut inputs = vec![0.0; (shape.features + ANGLES) * LANES];
        let mut layers = [vec![0.0; shape.width * LANES], vec![0.0; shape.width * LANES]];
        let groups = self.points.chunks(LANES).zip(self.wi.chunks(LANES)).zip(self.values.chunks_mut(LANES));
        for ((points, wi), values) in groups {
            let mut factors = [0.0; LANES];
            for (lane, (point, &wi)) in points.iter().zip(wi).enumerate() {
                let mut light = LightStencil::NONE;
                let stencil = lookup.angles.lit(&point.view, wi, point.wo, &mut light);
                factors[lane] = stencil.map_or(0.0, |stencil| stencil.factor);
                let (wi, wo) = btf.lowest.raised(wi, point.wo);
                btf.look_up(texel_place(point.uv, size), wo, &mut inputs, lane);
                let rows = inputs[shape.features * LANES + lane..].iter_mut().step_by(LANES);
                rows.zip(angles(wi, wo)).for_each(|(row, angle)| *row = angle);
            }
            let [from, to] = &mut layers;
            let (mut from, mut to) = (from, to);
            btf.first.times::<V>(&network.biases[0], &inputs, from, LANES, Finish::Rectify);
            for layer in 1..shape.hidden {
                network.layers[layer].times::<V>(&network.biases[layer], from, to, LANES, Finish::Rectify);
                std::mem::swap(&mut from, &mut to);
            }
            let (last, mut rgb) = (shape.hidden, [[0.0; LANES]; 3]);
            network.layers[last].times::<V>(&network.biases[last], from, rgb.as_flattened_mut(), LANES, Finish::Plain);
            for (lane, value) in values.iter_mut().enumerate() {
                let linear = Vec3::from(rgb.map(|lanes| linearizer.linear(lanes[lane].min(btf.most))));
                *value = if factors[lane] > 0.0 { linear.max(Vec3::ZERO) * factors[lane] } else { Vec3::ZERO };
            }
        }
    }
}

impl TexelMaterial for NetworkMaterial {
    fn lookup(&self) -> &Lookup {
        &self.lookup
    }

    fn value(&self, point: &TexelPoint, wi: Vec3) -> Vec3 {
        let mut value = [Vec3::ZERO];
        self.values(&[point], &[wi], &mut value);
        value[0]
    }

    fn values(&self, points: &[&TexelPoint], wi: &[Vec3], values: &mut [Vec3]) {
        compute(Points { material: self, points, wi, values }, false);
    }
}
