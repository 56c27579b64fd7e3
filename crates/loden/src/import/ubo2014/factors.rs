//! The matrix factorisations of `.btf` files: DFMF, FMF and PVF.

use std::ops::Range;

use half::f16;

use super::header::{Header, Kind};
use crate::Result;
use crate::color::model::{ColorModel, EPSILON, NAMES};
use crate::color::spectrum::RgbWeights;
use crate::input::Cursor;

/// Maximum number of channels held at once.
const MAX_CHANNELS: usize = 64;

/// Products of a matrix over directions and a matrix over texels.
pub(super) struct Factors {
    /// One per channel, and for PVF per view: `[view][channel]`.
    products: Vec<Product>,
    per_view: bool,
    channels: usize,
    lights: usize,
    texels: usize,
    model: ColorModel,
    /// Whether the values are logarithms (FMF).
    logarithmic: bool,
    weights: Option<RgbWeights>,
}

/// One channel of M = directions x texels.
struct Product {
    directions: Matrix,
    texels: Matrix,
    /// The mean to add, from the rows of one of the two matrices (PVF).
    mean: Option<(Matrix, MeanOf)>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum MeanOf {
    Directions,
    Texels,
}

/// Some rows of a matrix in the file.
#[derive(Clone, Copy)]
struct Matrix {
    start: usize,
    scalar: usize,
    columns: usize,
    /// Row i of this channel is row i * stride + offset of the file.
    stride: usize,
    offset: usize,
}

impl Matrix {
    /// Reads the position of a `rows` x `columns` matrix and skips it.
    fn take(cursor: &mut Cursor<'_>, field: &str, scalar: u8, rows: u32, columns: u32) -> Result<Self> {
        let start = cursor.at();
        // at most 2^67, which saturates above any file's size
        let bytes = (u64::from(rows) * u64::from(columns)).saturating_mul(scalar.into());
        cursor.take(field, bytes)?;
        Ok(Self { start, scalar: scalar.into(), columns: columns as usize, stride: 1, offset: 0 })
    }

    fn every(self, stride: usize, offset: usize) -> Self {
        Self { stride, offset, ..self }
    }

    fn read(&self, bytes: &[u8], row: usize, out: &mut [f32]) {
        let first = self.start + (row * self.stride + self.offset) * self.columns * self.scalar;
        let bytes = &bytes[first..first + self.columns * self.scalar];
        match self.scalar {
            2 => bytes.as_chunks::<2>().0.iter().zip(out).for_each(|(b, v)| *v = f16::from_le_bytes(*b).to_f32()),
            4 => bytes.as_chunks::<4>().0.iter().zip(out).for_each(|(b, v)| *v = f32::from_le_bytes(*b)),
            _ => bytes.as_chunks::<8>().0.iter().zip(out).for_each(|(b, v)| *v = f64::from_le_bytes(*b) as f32),
        }
    }
}

impl Factors {
    pub(super) fn read(kind: Kind, header: &Header, size: [usize; 2], cursor: &mut Cursor<'_>) -> Result<Self> {
        let (pairs, texels) = (header.pairs(), size[0] * size[1]);
        let (channels, lights) = (header.channels, header.lights.len());
        if channels > MAX_CHANNELS {
            return Err(cursor.invalid("channels", format!("found {channels}, expected at most {MAX_CHANNELS}")));
        }
        let mut factors = Self {
            products: Vec::new(),
            per_view: kind == Kind::Pvf,
            channels,
            lights,
            texels,
            model: ColorModel { number: 0, mean: [0.0; 3], matrix: [0.0; 9] },
            logarithmic: false,
            weights: header.weights.clone(),
        };
        match kind {
            Kind::Dfmf => {
                cursor.u32("num_components")?;
                let number = cursor.i32("color_model")?;
                factors.model =
                    ColorModel { number, mean: cursor.f32s("color_mean")?, matrix: cursor.f32s("color_matrix")? };
                if !NAMES.iter().any(|(known, _)| *known == number) {
                    return Err(cursor.invalid("color_model", format!("unknown colour model {number}")));
                }
                for _ in 0..channels {
                    let scalar = scalar_size(cursor)?;
                    factors.products.push(product(cursor, scalar, [pairs, texels])?);
                }
            }
            Kind::Pvf => {
                cursor.u32("num_components")?;
                let views = cursor.u32("n_views")?;
                if views as usize != header.views.len() {
                    let problem = format!("found {views}, expected {} as in the view directions", header.views.len());
                    return Err(cursor.invalid("n_views", problem));
                }
                for _ in 0..views {
                    per_view(cursor, channels, lights, texels, &mut factors.products)?;
                }
            }
            _ => {
                if kind == Kind::FmfExtended {
                    factors.logarithmic = extended_header(cursor)?;
                }
                let k = cursor.u32("num_components")?;
                let scalar = scalar_size(cursor)?;
                let at = cursor.at();
                let both = product_of_all(cursor, scalar, channels, [pairs, texels])?;
                if both[0].directions.columns != k as usize {
                    return Err(cursor.invalid("num_components", format!("found {k}, but another number at byte {at}")));
                }
                factors.products = both;
            }
        }
        Ok(factors)
    }

    /// Calls back with the colours of all `lights` for each texel in turn.
    pub(super) fn decode(
        &self,
        bytes: &[u8],
        view: usize,
        lights: Range<usize>,
        put: &mut dyn FnMut(usize, &[[f32; 3]]),
    ) {
        let first = if self.per_view { view * self.channels } else { 0 };
        let products = &self.products[first..first + self.channels];
        let row = |light: usize| if self.per_view { light } else { view * self.lights + light };
        // there are few rows of directions, and every texel uses them
        let rows: Vec<Vec<f32>> = products
            .iter()
            .map(|p| {
                let k = p.directions.columns;
                let mut rows = vec![0.0; k * lights.len()];
                rows.chunks_exact_mut(k.max(1))
                    .zip(lights.clone())
                    .for_each(|(out, l)| p.directions.read(bytes, row(l), out));
                rows
            })
            .collect();
        let means: Vec<Vec<f32>> =
            products.iter().map(|p| p.means_of(bytes, MeanOf::Directions, lights.clone())).collect();
        let mut texel_rows: Vec<Vec<f32>> = products.iter().map(|p| vec![0.0; p.texels.columns]).collect();
        let mut colours = vec![[0.0; 3]; lights.len()];
        let mut values = [0.0; MAX_CHANNELS];
        for texel in 0..self.texels {
            let mut base = [0.0; MAX_CHANNELS];
            for (c, p) in products.iter().enumerate() {
                p.texels.read(bytes, texel, &mut texel_rows[c]);
                base[c] = p.means_of(bytes, MeanOf::Texels, texel..texel + 1).first().copied().unwrap_or(0.0);
            }
            for (light, colour) in colours.iter_mut().enumerate() {
                for c in 0..self.channels {
                    let k = texel_rows[c].len();
                    let dot: f32 =
                        rows[c][light * k..(light + 1) * k].iter().zip(&texel_rows[c]).map(|(a, b)| a * b).sum();
                    values[c] = dot + base[c] + means[c].get(light).copied().unwrap_or(0.0);
                }
                *colour = self.color(&mut values[..self.channels]);
            }
            put(texel, &colours);
        }
    }

    fn color(&self, values: &mut [f32]) -> [f32; 3] {
        if self.logarithmic {
            values.iter_mut().for_each(|v| *v = v.exp() - EPSILON);
        }
        match &self.weights {
            Some(weights) => weights.rgb(values.iter().copied()),
            None => self.model.decode([values[0], values[1], values[2]]),
        }
    }
}

impl Product {
    /// The means of these rows; empty if the file has none for them.
    fn means_of(&self, bytes: &[u8], of: MeanOf, rows: Range<usize>) -> Vec<f32> {
        let Some((matrix, _)) = self.mean.as_ref().filter(|mean| mean.1 == of) else { return Vec::new() };
        let mut means = vec![0.0; rows.len()];
        means.chunks_exact_mut(1).zip(rows).for_each(|(out, row)| matrix.read(bytes, row, out));
        means
    }
}

fn scalar_size(cursor: &mut Cursor<'_>) -> Result<u8> {
    let size = cursor.u8("scalar_size")?;
    if [2, 4, 8].contains(&size) {
        return Ok(size);
    }
    Err(cursor.invalid("scalar_size", format!("found {size} bytes, expected 2, 4 or 8")))
}

/// Reads FMF's own header: whether the values are logarithms.
fn extended_header(cursor: &mut Cursor<'_>) -> Result<bool> {
    let version = cursor.u8("header_version")?;
    if version > 2 {
        return Err(cursor.invalid("header_version", format!("found {version}, expected 0 to 2")));
    }
    let logarithmic = version >= 1 && cursor.u32("dynamic_range_reduction")? != 0;
    if version >= 2 {
        let [width, height] = [cursor.u32("height map")?, cursor.u32("height map")?].map(u64::from);
        cursor.take("height map", (width * height).saturating_mul(2))?;
    }
    Ok(logarithmic)
}

/// Reads k, rows, columns, the singular values and both matrices, and finds which of them is over texels.
fn matrices(cursor: &mut Cursor<'_>, scalar: u8, [directions, texels]: [usize; 2]) -> Result<([Matrix; 2], bool)> {
    let [k, rows, columns] = [cursor.u32("components")?, cursor.u32("rows")?, cursor.u32("columns")?];
    let size = [rows as usize, columns as usize];
    let transposed = match size {
        _ if size == [directions, texels] => false,
        _ if size == [texels, directions] => true,
        _ => {
            let problem = format!("found {rows} x {columns}, but {directions} directions and {texels} texels");
            return Err(cursor.invalid("rows", problem));
        }
    };
    Matrix::take(cursor, "singular values", scalar, k, 1)?;
    let u = Matrix::take(cursor, "U", scalar, rows, k)?;
    let v = Matrix::take(cursor, "SxV", scalar, columns, k)?;
    Ok((if transposed { [v, u] } else { [u, v] }, transposed))
}

fn product(cursor: &mut Cursor<'_>, scalar: u8, sizes: [usize; 2]) -> Result<Product> {
    let ([directions, texels], _) = matrices(cursor, scalar, sizes)?;
    Ok(Product { directions, texels, mean: None })
}

/// FMF: rows of one matrix run over the channels of each pair (or, transposed, of each texel).
fn product_of_all(
    cursor: &mut Cursor<'_>,
    scalar: u8,
    channels: usize,
    [pairs, texels]: [usize; 2],
) -> Result<Vec<Product>> {
    let [k, rows, columns] = [cursor.u32("components")?, cursor.u32("rows")?, cursor.u32("columns")?];
    let size = [rows as usize, columns as usize];
    let of_directions = size == [channels * pairs, texels];
    if !of_directions && size != [channels * texels, pairs] {
        let problem = format!("found {rows} x {columns}, but {channels} channels, {pairs} pairs and {texels} texels");
        return Err(cursor.invalid("rows", problem));
    }
    Matrix::take(cursor, "singular values", scalar, k, 1)?;
    let u = Matrix::take(cursor, "U", scalar, rows, k)?;
    let v = Matrix::take(cursor, "SxV", scalar, columns, k)?;
    let channel = |c: usize| match of_directions {
        true => Product { directions: u.every(channels, c), texels: v, mean: None },
        false => Product { directions: v, texels: u.every(channels, c), mean: None },
    };
    Ok((0..channels).map(channel).collect())
}

/// PVF: the images of a view as vectors with a weight per light, or its texels as vectors with a weight per texel.
fn per_view(
    cursor: &mut Cursor<'_>,
    channels: usize,
    lights: usize,
    texels: usize,
    products: &mut Vec<Product>,
) -> Result<()> {
    let scalar = scalar_size(cursor)?;
    let [k, count, dim] = [cursor.u32("components")?, cursor.u32("n_weights")?, cursor.u32("dim")?];
    let size = [count as usize, dim as usize];
    let images = size == [lights, channels * texels];
    if !images && size != [texels, channels * lights] {
        let problem =
            format!("found {count} weights of {dim}, but {lights} lights, {texels} texels, {channels} channels");
        return Err(cursor.invalid("n_weights", problem));
    }
    Matrix::take(cursor, "eigenvalues", scalar, k, 1)?;
    let mean = Matrix::take(cursor, "mean", scalar, dim, 1)?;
    let components = Matrix::take(cursor, "components", scalar, dim, k)?;
    let weights = Matrix::take(cursor, "weights", scalar, count, k)?;
    products.extend((0..channels).map(|c| {
        let (of_channel, mean) = (components.every(channels, c), mean.every(channels, c));
        if images {
            Product { directions: weights, texels: of_channel, mean: Some((mean, MeanOf::Texels)) }
        } else {
            Product { directions: of_channel, texels: weights, mean: Some((mean, MeanOf::Directions)) }
        }
    }));
    Ok(())
}
