//! The values of a view in the compressed domain.

use std::ops::Range;

use half::f16;
use half::slice::HalfFloatSliceExt;

use crate::btf::{BtfMeta, BtfSource, FloatType, Texels};
use crate::color::domain::Domain;
use crate::factor::tile::FloatTile;
use crate::params::{Kind, Param};
use crate::{Error, Result};

/// Parameter: single or half precision.
pub const FLOAT_PRECISION: Param = Param {
    name: "precision",
    unit: "",
    kind: Kind::Choice(&["f32", "f16"]),
    default: "f16",
    doc: "Number type: single or half precision.",
};

/// Converts to half precision.
///
/// # Errors
/// [`Error::NonFinite`] if a number is infinite, [`Error::Parameter`] if it is too large; both name `what` holds it.
pub fn halves(values: &[f32], what: &str) -> Result<Vec<f16>> {
    let largest = values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    if largest > f16::MAX.to_f32() {
        if largest.is_infinite() {
            return Err(Error::non_finite(what));
        }
        let problem = format!("found f16, expected f32: {what} holds {largest}, but f16 ends at {}", f16::MAX);
        return Err(Error::parameter("precision", problem));
    }
    let mut halves = vec![f16::ZERO; values.len()];
    halves.convert_from_f32_slice(values);
    Ok(halves)
}

/// Numbers in single or half precision as bytes.
///
/// # Errors
/// As [`halves`].
pub fn stored(values: &[f32], precision: FloatType) -> Result<Vec<u8>> {
    Ok(match precision {
        FloatType::F32 => bytemuck::cast_slice(values).to_vec(),
        FloatType::F16 => bytemuck::cast_slice(&halves(values, "the BTF")?).to_vec(),
    })
}

/// The texels of a view, with their number checked.
///
/// # Errors
/// Errors of the source; [`Error::Parameter`] if the number of texels is wrong.
pub fn view_texels(source: &dyn BtfSource, view: usize) -> Result<Texels<'_>> {
    let (texels, expected) = (source.view(view)?, source.meta().view_len());
    if texels.len() != expected {
        let problem = format!("view {view} has {} numbers, expected {expected}", texels.len());
        return Err(Error::parameter("source", problem));
    }
    Ok(texels)
}

/// The values in `domain` of one light's image, from the texels of its view.
pub fn image(view: &Texels, light: usize, meta: &BtfMeta, domain: Domain) -> Vec<f32> {
    let curve = |value: f32| domain.from_stored(meta.encoding, value);
    match view.part(light * meta.image_len()..(light + 1) * meta.image_len()) {
        Texels::U8(values) => {
            let of_byte: [f32; 256] = std::array::from_fn(|i| curve(i as f32 / 255.0));
            values.iter().map(|&v| of_byte[usize::from(v)]).collect()
        }
        texels => texels.to_f32().iter().map(|&v| curve(v)).collect(),
    }
}

/// A view whose texels are loaded in tiles with one row per light and channel.
pub struct ViewValues<'a> {
    texels: Texels<'a>,
    /// Numbers of each image that were read, and the first texel among them.
    image_len: usize,
    first: usize,
    meta: &'a BtfMeta,
    domain: Domain,
    /// 8-bit values in the domain.
    of_byte: [f32; 256],
}

impl<'a> ViewValues<'a> {
    /// Reads one view.
    ///
    /// # Errors
    /// Errors of the source; [`Error::Parameter`] if the number of texels is wrong.
    pub fn read(source: &'a dyn BtfSource, view: usize, domain: Domain) -> Result<Self> {
        let (meta, texels) = (source.meta(), view_texels(source, view)?);
        Ok(Self::new(meta, domain, texels, 0, meta.image_len()))
    }

    /// Reads the rows of one view that hold some texels.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_some(source: &'a dyn BtfSource, view: usize, domain: Domain, texels: Range<usize>) -> Result<Self> {
        let meta = source.meta();
        let rows = texels.start / meta.width..texels.end.div_ceil(meta.width);
        if rows.len() == meta.height {
            return Self::read(source, view, domain);
        }
        let image_len = 3 * meta.width * rows.len();
        let (first, texels) = (rows.start * meta.width, source.rows(view, rows)?);
        let expected = image_len * meta.lights.len();
        if texels.len() != expected {
            let problem = format!("rows of view {view} have {} numbers, expected {expected}", texels.len());
            return Err(Error::parameter("source", problem));
        }
        Ok(Self::new(meta, domain, texels, first, image_len))
    }

    fn new(meta: &'a BtfMeta, domain: Domain, texels: Texels<'a>, first: usize, image_len: usize) -> Self {
        let of_byte = std::array::from_fn(|i| domain.from_stored(meta.encoding, i as f32 / 255.0));
        Self { texels, image_len, first, meta, domain, of_byte }
    }

    /// 8-bit values that need no conversion.
    pub fn bytes(&self) -> Option<&[u8]> {
        match &self.texels {
            Texels::U8(values) if self.domain.is_stored(self.meta.encoding) => Some(values),
            _ => None,
        }
    }

    /// Loads `count` texels from `first`; the rest of the tile becomes zero.
    pub fn load(&self, tile: &mut FloatTile, first: usize, count: usize) {
        self.load_centred(tile, first, count, &[]);
    }

    /// As [`Self::load`], minus the mean of each row as far as `mean` goes.
    ///
    /// # Panics
    /// If the texels were not read.
    pub fn load_centred(&self, tile: &mut FloatTile, first: usize, count: usize, mean: &[f64]) {
        let first = first - self.first;
        let curve = |value: f32| self.domain.from_stored(self.meta.encoding, value);
        match &self.texels {
            Texels::U8(values) if self.domain.is_stored(self.meta.encoding) => {
                return tile.load(values, self.image_len, first, count, mean);
            }
            Texels::U8(values) => self.convert(tile, values, first, count, |v| self.of_byte[usize::from(v)]),
            Texels::F16(values) => self.convert(tile, values, first, count, |v: f16| curve(v.to_f32())),
            Texels::F32(values) => self.convert(tile, values, first, count, curve),
        }
        tile.centre(count, mean);
    }

    fn convert<T: Copy>(
        &self,
        tile: &mut FloatTile,
        values: &[T],
        first: usize,
        count: usize,
        curve: impl Fn(T) -> f32,
    ) {
        for (light, image) in values.chunks_exact(self.image_len).enumerate() {
            let [r, g, b] = tile.rgb_mut(light);
            for (t, texel) in image[3 * first..3 * (first + count)].chunks_exact(3).enumerate() {
                (r[t], g[t], b[t]) = (curve(texel[0]), curve(texel[1]), curve(texel[2]));
            }
            [r, g, b].into_iter().for_each(|row| row[count..].fill(0.0));
        }
    }
}
