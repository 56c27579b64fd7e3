//! The layers of a network, and values from them.

use glam::Vec3;

use super::lanes::{Finish, LANES, Lanes, Packed};
use crate::btf::BtfMeta;
use crate::direction::DirectionSet;

/// Numbers that a network sees of a pair of directions.
pub const ANGLES: usize = 24;

/// What a network sees of the directions towards the light and the viewer: both and their half vector h; products of x and y of
/// each, and of both with each other; z of both multiplied; their dot product.
#[inline]
pub fn angles(wi: Vec3, wo: Vec3) -> [f32; ANGLES] {
    let h = (wi + wo).normalize_or_zero();
    [
        [wi.x, wi.y, wi.z, wo.x, wo.y, wo.z],
        [h.x, h.y, h.z, wi.x * wi.x, wi.x * wi.y, wi.y * wi.y],
        [wo.x * wo.x, wo.x * wo.y, wo.y * wo.y, wi.x * wo.x, wi.x * wo.y, wi.y * wo.x],
        [wi.y * wo.y, h.x * h.x, h.x * h.y, h.y * h.y, wi.z * wo.z, wi.dot(wo)],
    ]
    .as_flattened()
    .try_into()
    .unwrap_or([0.0; ANGLES])
}

/// The z of the lowest sampled directions towards the light and the viewer: a network is not asked for lower ones.
#[derive(Debug, Clone, Copy)]
pub struct Lowest {
    light: f32,
    view: f32,
}

impl Lowest {
    /// Of the directions of `meta`, at least 0.001.
    pub fn new(meta: &BtfMeta) -> Self {
        let views = meta.lights.seen_from().unwrap_or(&meta.views);
        let lowest = |set: &DirectionSet| set.directions().iter().fold(1.0f32, |least, w| least.min(w.z)).max(1e-3);
        Self { light: lowest(&meta.lights), view: lowest(views) }
    }

    /// Directions raised to the lowest ones.
    #[inline(always)]
    pub fn raised(self, wi: Vec3, wo: Vec3) -> (Vec3, Vec3) {
        (raised(wi, self.light), raised(wo, self.view))
    }
}

/// A direction with at least this z in the same azimuth.
#[inline(always)]
fn raised(w: Vec3, lowest: f32) -> Vec3 {
    if w.z >= lowest {
        return w;
    }
    let scale = ((1.0 - lowest * lowest) / (w.x * w.x + w.y * w.y).max(1e-20)).sqrt();
    Vec3::new(w.x * scale, w.y * scale, lowest)
}

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Numbers per texel, a multiple of 4.
    pub features: usize,
    /// Numbers in a hidden layer, a multiple of 8.
    pub width: usize,
    /// Number of hidden layers.
    pub hidden: usize,
}

impl Shape {
    /// Number of layers with weights.
    pub fn layers(self) -> usize {
        self.hidden + 1
    }

    /// Rows (outputs) and columns (inputs and a last one for a constant 1) of the weights of a layer.
    pub fn layer(self, layer: usize) -> [usize; 2] {
        let inputs = if layer == 0 { self.features + ANGLES } else { self.width };
        [if layer == self.hidden { 3 } else { self.width }, inputs + 1]
    }

    /// The place of each layer's weights, one after the other.
    pub fn places(self) -> Vec<std::ops::Range<usize>> {
        let mut end = 0;
        let place = |layer| {
            let [rows, columns] = self.layer(layer);
            end += rows * columns;
            end - rows * columns..end
        };
        (0..self.layers()).map(place).collect()
    }
}

/// A network, ready to be computed.
///
/// # Model
/// The first layer sees the features of a place and [`angles`]. Each layer multiplies by its weights; negative numbers become
/// zero except in the last, whose three rows are the channels.
#[derive(Debug, Clone)]
pub struct Network {
    pub shape: Shape,
    /// Without the columns of the angles and of the constant.
    pub layers: Vec<Packed>,
    /// Weights of the constant.
    pub biases: Vec<Vec<f32>>,
    /// Weights of the angles: (column, row) of the first layer.
    angles: Vec<f32>,
}

impl Network {
    /// Of the weights of all layers, one after the other, each (row, column).
    pub fn new(shape: Shape, weights: &[f32]) -> Self {
        let layer = |layer: usize| {
            let [rows, columns] = shape.layer(layer);
            Packed::new(rows, if layer == 0 { shape.features } else { columns - 1 })
        };
        let layers = (0..shape.layers()).map(layer).collect();
        let biases = (0..shape.layers()).map(|layer| vec![0.0; shape.layer(layer)[0]]).collect();
        let mut network = Self { shape, layers, biases, angles: vec![0.0; ANGLES * shape.width] };
        network.set(weights);
        network
    }

    /// Replaces the weights.
    pub fn set(&mut self, weights: &[f32]) {
        for (layer, place) in self.shape.places().into_iter().enumerate() {
            let [rows, columns] = self.shape.layer(layer);
            let weights = &weights[place];
            self.layers[layer].set(|row, column| weights[row * columns + column]);
            for row in 0..rows {
                self.biases[layer][row] = weights[row * columns + columns - 1];
            }
            if layer == 0 {
                for (k, number) in self.angles.iter_mut().enumerate() {
                    *number = weights[k % rows * columns + self.shape.features + k / rows];
                }
            }
        }
    }

    /// What the first layer starts from for a pair: constant and angles.
    #[inline(always)]
    pub fn start(&self, angles: &[f32; ANGLES], start: &mut [f32]) {
        start.copy_from_slice(&self.biases[0]);
        for (angle, column) in angles.iter().zip(self.angles.chunks_exact(self.shape.width)) {
            start.iter_mut().zip(column).for_each(|(sum, weight)| *sum += angle * weight);
        }
    }

    /// The three channels (channel, lane) of [`LANES`] samples with these features (row, lane), whose first layer starts from
    /// `start` (row). `layers` has room for two layers.
    #[inline(always)]
    pub fn values<V: Lanes>(&self, start: &[f32], features: &[f32], layers: &mut [Vec<f32>; 2]) -> [[f32; LANES]; 3] {
        let [from, to] = layers;
        let (mut from, mut to) = (from, to);
        self.layers[0].times::<V>(start, features, from, LANES, Finish::Rectify);
        for layer in 1..self.shape.hidden {
            self.layers[layer].times::<V>(&self.biases[layer], from, to, LANES, Finish::Rectify);
            std::mem::swap(&mut from, &mut to);
        }
        let (last, mut values) = (self.shape.hidden, [[0.0; LANES]; 3]);
        self.layers[last].times::<V>(&self.biases[last], from, values.as_flattened_mut(), LANES, Finish::Plain);
        values
    }
}
