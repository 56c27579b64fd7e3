//! One step of training: values, errors and gradients of some samples.

use glam::{Vec2, Vec3};

use super::pool::Pool;
use crate::codec::network::lanes::{Finish, Kernel, LANES, Lanes, Packed, Samples, sum};
use crate::codec::network::layers::{ANGLES, Network, Shape, angles};
use crate::codec::network::place::{Corners, Surface, shifted, slope};

/// Groups of [`LANES`] samples that are processed together; the groups of a step are divided among threads by this.
pub const UNIT: usize = 32;

/// Numbers from one row of a unit to the next: more than its samples, since rows a power of two apart would share a few lines
/// of the cache.
const STRIDE: usize = (UNIT + 1) * LANES;

/// A pair of directions as the network sees it.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    pub angles: [f32; ANGLES],
    pub slope: Vec2,
}

impl Pair {
    pub fn new(wi: Vec3, wo: Vec3, mirror: bool) -> Self {
        Self { angles: angles(wi, wo), slope: slope(wo, mirror) }
    }
}

/// The planes as they are looked up during a round.
#[derive(Debug, Clone)]
pub struct Planes {
    pub size: [usize; 2],
    /// (texel, feature)
    pub features: Vec<f32>,
    /// In texels.
    pub heights: Vec<f32>,
}

impl Surface for Planes {
    #[inline(always)]
    fn height(&self, place: Vec2) -> f32 {
        let corners = Corners::new(place, self.size);
        let ([a, b, c, d], [wa, wb, wc, wd]) = (corners.texel, corners.weights());
        let heights = &self.heights;
        wa * heights[a] + wb * heights[b] + wc * heights[c] + wd * heights[d]
    }
}

impl Planes {
    /// The features of the four texels around a place.
    #[inline(always)]
    fn around(&self, corners: &Corners, count: usize) -> [&[f32]; 4] {
        let [a, b, c, d] = corners.texel;
        let features = &self.features;
        [
            &features[a * count..][..count],
            &features[b * count..][..count],
            &features[c * count..][..count],
            &features[d * count..][..count],
        ]
    }
}

/// A network with what its gradient needs.
#[derive(Debug, Clone)]
pub struct Trained {
    pub network: Network,
    /// Transposed weights of each layer, without angles and constants.
    pub transposed: Vec<Packed>,
}

impl Trained {
    pub fn new(network: Network) -> Self {
        let shape = network.shape;
        let inputs = |layer| if layer == 0 { shape.features } else { shape.width };
        let transposed = (0..shape.layers()).map(|layer| Packed::new(inputs(layer), shape.layer(layer)[0])).collect();
        Self { network, transposed }
    }

    /// Replaces the weights.
    pub fn set(&mut self, weights: &[f32]) {
        self.network.set(weights);
        for ((layer, place), packed) in self.network.shape.places().into_iter().enumerate().zip(&mut self.transposed) {
            let [_, columns] = self.network.shape.layer(layer);
            let weights = &weights[place];
            packed.set(|row, column| weights[column * columns + row]);
        }
    }
}

/// What a round of training does not change.
pub struct Round<'a> {
    pub pool: &'a Pool,
    pub planes: &'a Planes,
    pub trained: &'a Trained,
    pub pairs: &'a [Pair],
    /// Errors beyond this count by their size, smaller ones by their square.
    pub knee: f32,
    /// Unit of the network's values.
    pub scale: f32,
}

/// Numbers of a record beside the gradient of the features: the place, the gradient of the height, and the place at which the
/// height was looked up.
pub const RECORD: usize = 5;

/// Numbers that a unit needs while it is processed, (row, sample).
pub struct Scratch {
    features: Vec<f32>,
    layers: Vec<Vec<f32>>,
    gradients: Vec<Vec<f32>>,
    values: Vec<f32>,
    errors: Vec<f32>,
    of_features: Vec<f32>,
    start: Vec<f32>,
}

impl Scratch {
    pub fn new(network: &Network) -> Self {
        let rows = |count: usize| vec![0.0; count * STRIDE];
        let shape = network.shape;
        let layers = || (0..shape.hidden).map(|_| rows(shape.width)).collect();
        Self {
            features: rows(shape.features),
            layers: layers(),
            gradients: layers(),
            values: rows(3),
            errors: rows(3),
            of_features: rows(shape.features),
            start: vec![0.0; shape.width],
        }
    }
}

/// Bytes of [`Scratch`].
pub fn scratch_bytes(shape: Shape) -> u64 {
    (4 * STRIDE * (2 * shape.features + 2 * shape.hidden * shape.width + 6)) as u64
}

/// A group of samples: texels of the pool and the slot of their pair.
#[derive(Debug, Clone, Copy)]
pub struct Group {
    pub group: usize,
    pub slot: usize,
}

/// Up to [`UNIT`] groups, and what they add to.
pub struct Unit<'a> {
    pub round: &'a Round<'a>,
    pub groups: &'a [Group],
    pub scratch: &'a mut Scratch,
    /// As the weights.
    pub gradient: &'a mut [f32],
    /// (group, lane, gradient of the features and [`RECORD`])
    pub records: &'a mut [f32],
}

/// Sums over samples and channels, in display units.
#[derive(Debug, Clone, Copy, Default)]
pub struct Errors {
    pub absolute: f64,
    pub square: f64,
    pub count: f64,
}

impl Errors {
    /// The mean absolute error.
    pub fn mean(&self) -> f64 {
        self.absolute / self.count.max(1.0)
    }

    pub fn add(&mut self, other: Self) {
        self.absolute += other.absolute;
        self.square += other.square;
        self.count += other.count;
    }
}

impl Kernel for Unit<'_> {
    type Output = Errors;

    #[inline(always)]
    fn run<V: Lanes>(mut self) -> Errors {
        let mut errors = Errors::default();
        for at in 0..self.groups.len() {
            self.look_up(at);
            self.forward::<V>(at);
            errors.add(self.compare(at));
            self.backward::<V>(at);
            self.record(at);
        }
        self.add_weights::<V>();
        errors
    }
}

impl Unit<'_> {
    #[inline(always)]
    fn record_len(&self) -> usize {
        self.round.trained.network.shape.features + RECORD
    }

    #[inline(always)]
    fn pair(&self, at: usize) -> &Pair {
        let Group { group, slot } = self.groups[at];
        &self.round.pairs[self.round.pool.pair(group, slot)]
    }

    /// Features at the places of a group's samples.
    #[inline(always)]
    fn look_up(&mut self, at: usize) {
        let (planes, length) = (self.round.planes, self.record_len());
        let (count, slope) = (length - RECORD, self.pair(at).slope);
        for lane in 0..LANES {
            let texel = self.round.pool.texel(self.groups[at].group, lane);
            let centre = Vec2::new((texel % planes.size[0]) as f32, (texel / planes.size[0]) as f32);
            let [first, place] = shifted(centre, slope, planes);
            let corners = Corners::new(place, planes.size);
            let texels = planes.around(&corners, count);
            let [wa, wb, wc, wd] = corners.weights();
            let rows = self.scratch.features[at * LANES + lane..].iter_mut().step_by(STRIDE);
            for ((((row, a), b), c), d) in rows.zip(texels[0]).zip(texels[1]).zip(texels[2]).zip(texels[3]) {
                *row = wa * a + wb * b + wc * c + wd * d;
            }
            let record = &mut self.records[(at * LANES + lane) * length + count..][..RECORD];
            record.copy_from_slice(&[place.x, place.y, 0.0, first.x, first.y]);
        }
    }

    #[inline(always)]
    fn forward<V: Lanes>(&mut self, at: usize) {
        let network = &self.round.trained.network;
        let angles = self.pair(at).angles;
        let Scratch { features, layers, values, start, .. } = &mut *self.scratch;
        network.start(&angles, start);
        let first = at * LANES;
        network.layers[0].times::<V>(start, &features[first..], &mut layers[0][first..], STRIDE, Finish::Rectify);
        for layer in 1..network.shape.hidden {
            let (done, rest) = layers.split_at_mut(layer);
            let (from, to) = (&done[layer - 1][first..], &mut rest[0][first..]);
            network.layers[layer].times::<V>(&network.biases[layer], from, to, STRIDE, Finish::Rectify);
        }
        let last = network.shape.hidden;
        let (from, to) = (&layers[last - 1][first..], &mut values[first..]);
        network.layers[last].times::<V>(&network.biases[last], from, to, STRIDE, Finish::Plain);
    }

    /// The errors of a group, and their derivative.
    #[inline(always)]
    fn compare(&mut self, at: usize) -> Errors {
        let Round { pool, knee, scale, .. } = *self.round;
        let Group { group, slot } = self.groups[at];
        let targets = pool.values(group, slot);
        let lanes = pool.lanes(group);
        let (mut absolute, mut square) = ([0.0f32; LANES], [0.0f32; LANES]);
        for (channel, targets) in targets.iter().enumerate() {
            let place = channel * STRIDE + at * LANES;
            let values = &self.scratch.values[place..][..LANES];
            let errors = &mut self.scratch.errors[place..][..LANES];
            for lane in 0..LANES {
                let on = if lane < lanes { 1.0 } else { 0.0 };
                let error = (values[lane] * scale - targets[lane]) * on;
                absolute[lane] += error.abs();
                square[lane] += error * error;
                errors[lane] = (error / knee).clamp(-1.0, 1.0);
            }
        }
        let count = 3.0 * lanes as f64;
        Errors { absolute: sum(&absolute).into(), square: sum(&square).into(), count }
    }

    #[inline(always)]
    fn backward<V: Lanes>(&mut self, at: usize) {
        let trained = self.round.trained;
        let Scratch { layers, gradients, errors, of_features, .. } = &mut *self.scratch;
        let first = at * LANES;
        let last = trained.network.shape.hidden;
        let finish = Finish::Where(&layers[last - 1][first..]);
        trained.transposed[last].times::<V>(&[], &errors[first..], &mut gradients[last - 1][first..], STRIDE, finish);
        for layer in (1..last).rev() {
            let (before, after) = gradients.split_at_mut(layer);
            let (from, to) = (&after[0][first..], &mut before[layer - 1][first..]);
            let finish = Finish::Where(&layers[layer - 1][first..]);
            trained.transposed[layer].times::<V>(&[], from, to, STRIDE, finish);
        }
        let (from, to) = (&gradients[0][first..], &mut of_features[first..]);
        trained.transposed[0].times::<V>(&[], from, to, STRIDE, Finish::Plain);
    }

    /// Writes the gradients of features and heights down.
    #[inline(always)]
    fn record(&mut self, at: usize) {
        let (planes, length) = (self.round.planes, self.record_len());
        let (count, slope) = (length - RECORD, self.pair(at).slope);
        for lane in 0..LANES {
            let record = &mut self.records[(at * LANES + lane) * length..][..length];
            let (gradient, rest) = record.split_at_mut(count);
            let column = self.scratch.of_features[at * LANES + lane..].iter().step_by(STRIDE);
            gradient.iter_mut().zip(column).for_each(|(to, from)| *to = *from);
            let corners = Corners::new(Vec2::new(rest[0], rest[1]), planes.size);
            let texels = planes.around(&corners, count);
            let [x, y] = corners.fraction;
            let (mut right, mut down) = (0.0, 0.0);
            for ((((g, a), b), c), d) in gradient.iter().zip(texels[0]).zip(texels[1]).zip(texels[2]).zip(texels[3]) {
                right += g * ((b - a) * (1.0 - y) + (d - c) * y);
                down += g * ((c - a) * (1.0 - x) + (d - b) * x);
            }
            rest[2] = right * slope.x + down * slope.y;
        }
    }

    /// Adds the gradient of the weights.
    #[inline(always)]
    fn add_weights<V: Lanes>(&mut self) {
        let shape = self.round.trained.network.shape;
        let samples = self.groups.len() * LANES;
        for (layer, place) in shape.places().into_iter().enumerate() {
            let [rows, pitch] = shape.layer(layer);
            let sums = &mut self.gradient[place];
            let left = if layer == shape.hidden { &self.scratch.errors } else { &self.scratch.gradients[layer] };
            let right = if layer == 0 { &self.scratch.features } else { &self.scratch.layers[layer - 1] };
            let columns = if layer == 0 { shape.features } else { shape.width };
            Samples { left, right, stride: STRIDE, samples }.add_products::<V>([rows, columns], sums, pitch);
            for (at, groups) in self.groups.iter().enumerate() {
                let angles = match layer {
                    0 => self.round.pairs[self.round.pool.pair(groups.group, groups.slot)].angles,
                    _ => [0.0; ANGLES],
                };
                for row in 0..rows {
                    let lanes = left[row * STRIDE + at * LANES..].first_chunk::<LANES>();
                    let total = lanes.map_or(0.0, sum);
                    let sums = &mut sums[row * pitch..][..pitch];
                    sums[pitch - 1] += total;
                    if layer == 0 {
                        let sums = &mut sums[columns..columns + ANGLES];
                        sums.iter_mut().zip(angles).for_each(|(sum, angle)| *sum += total * angle);
                    }
                }
            }
        }
    }
}
