//! Decoding of images from clusters.

use std::ops::Range;
use std::sync::Arc;

use half::f16;

use super::QuantisedMaterial;
use crate::Result;
use crate::btf::{BtfMeta, Rect, SampleType};
use crate::codec::decoder::Decoder;
use crate::codec::parts::{Axis, Expr, Numbers, Parts, PlaneKind, Shared};
use crate::color::domain::Domain;
use crate::material::{Interpolation, Material};

/// An index image and a block of ABRDFs, with or without components.
#[derive(Debug)]
pub struct QuantisedBtf {
    meta: BtfMeta,
    clusters: usize,
    /// (texel)
    index: Vec<u16>,
    /// Domain of the block's numbers.
    domain: Domain,
    /// (cluster, view, light, rgb)
    block: Numbers,
    /// (view): offset and scale of 8-bit numbers
    range: Option<Shared<f32>>,
    c: usize,
    /// (cluster, component, view, light, rgb) and (texel, component)
    components: Option<[Numbers; 2]>,
}

/// Makes a decoder of recipes that take the row of a table over all pairs by an index plane, with or without a dot
/// product by the same index plane; `None` for other recipes.
///
/// # Errors
/// Errors of reading the parts.
pub fn form(parts: &Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>> {
    Ok(QuantisedBtf::new(&**parts)?.map(|btf| Arc::new(btf) as Arc<dyn Decoder>))
}

/// Stored numbers, borrowed.
#[derive(Clone, Copy)]
enum Slice<'a> {
    F32(&'a [f32]),
    F16(&'a [f16]),
    U8(&'a [u8]),
}

impl Slice<'_> {
    #[inline(always)]
    fn at(&self, place: usize) -> f32 {
        match self {
            Self::F32(values) => values[place],
            Self::F16(values) => values[place].to_f32(),
            Self::U8(values) => f32::from(values[place]),
        }
    }
}

/// Borrowed numbers of a whole file.
#[derive(Clone, Copy)]
pub(super) struct Tables<'a> {
    /// (cluster, pair, rgb)
    block: Slice<'a>,
    /// Offset and scale of 8-bit numbers, per view.
    range: &'a [[f32; 2]],
    pairs: usize,
    lights: usize,
    c: usize,
    /// (cluster, component, pair, rgb)
    components: Slice<'a>,
    /// (texel, component)
    coefficients: Slice<'a>,
}

impl Tables<'_> {
    /// The mean of a cluster in the pair with index `pair`.
    #[inline(always)]
    fn mean(&self, cluster: usize, pair: usize) -> [f32; 3] {
        let place = 3 * (cluster * self.pairs + pair);
        let rgb = std::array::from_fn(|channel| self.block.at(place + channel));
        match self.range.get(pair / self.lights) {
            Some([offset, scale]) => rgb.map(|v| offset + scale * v),
            None => rgb,
        }
    }

    /// 8-bit numbers of a cluster in the pair with index `pair`; `None` if the value has other numbers too.
    #[inline(always)]
    pub(super) fn bytes(&self, cluster: usize, pair: usize) -> Option<[u8; 3]> {
        match self.block {
            Slice::U8(values) if self.c == 0 && !self.range.is_empty() => {
                values[3 * (cluster * self.pairs + pair)..].first_chunk().copied()
            }
            _ => None,
        }
    }

    /// What 8-bit numbers stand for, for each view, or for all if that is the same.
    pub(super) fn of_byte(&self) -> Vec<[f32; 256]> {
        let same = self.range.windows(2).all(|range| range[0] == range[1]);
        let ranges = &self.range[..if same { self.range.len().min(1) } else { self.range.len() }];
        ranges.iter().map(|[offset, scale]| std::array::from_fn(|byte| offset + scale * byte as f32)).collect()
    }

    #[inline(always)]
    fn component(&self, cluster: usize, k: usize, pair: usize) -> [f32; 3] {
        let place = 3 * ((cluster * self.c + k) * self.pairs + pair);
        std::array::from_fn(|channel| self.components.at(place + channel))
    }

    /// The value of a texel of `cluster` in the pair with index `pair`.
    #[inline(always)]
    pub(super) fn value(&self, texel: usize, cluster: usize, pair: usize) -> [f32; 3] {
        let mut sum = self.mean(cluster, pair);
        for k in 0..self.c {
            let coefficient = self.coefficients.at(texel * self.c + k);
            add(&mut sum, coefficient, self.component(cluster, k, pair));
        }
        sum
    }
}

#[inline(always)]
fn add(sum: &mut [f32; 3], factor: f32, rgb: [f32; 3]) {
    sum.iter_mut().zip(rgb).for_each(|(sum, v)| *sum += factor * v);
}

impl<'a> From<&'a Numbers> for Slice<'a> {
    fn from(numbers: &'a Numbers) -> Self {
        match numbers {
            Numbers::F32(values) => Self::F32(values),
            Numbers::F16(values) => Self::F16(values),
            Numbers::U8(values) => Self::U8(values),
            Numbers::Index(_) => Self::U8(&[]),
        }
    }
}

impl QuantisedBtf {
    /// Clusters from parts whose recipe takes the row of a table over all pairs by an index plane, with or without a
    /// dot product by the same index plane; `None` for other recipes.
    ///
    /// # Errors
    /// Errors of reading the parts.
    pub fn new(parts: &dyn Parts) -> Result<Option<Self>> {
        let (meta, recipe) = (parts.meta(), parts.recipe());
        // Match the formula
        let (block, index, product) = match recipe.value {
            Expr::Table { table, row: Some(row) } => (table, row, None),
            Expr::Sum(ref terms) => match terms[..] {
                [Expr::Table { table, row: Some(row) }, Expr::Dot { plane, table: other, row: Some(same) }]
                    if row == same =>
                {
                    (table, row, Some((plane, other)))
                }
                _ => return Ok(None),
            },
            _ => return Ok(None),
        };
        let (Some(domain), PlaneKind::Index { rows }) = (recipe.curve.domain(), &recipe.planes[index].kind) else {
            return Ok(None);
        };
        // Check the axes of all tables
        let axes = |table: usize| &recipe.tables[table].axes[..];
        let ranged = recipe.tables[block].range.map(|range| (range, axes(range) == [Axis::View, Axis::Range]));
        let known = axes(block) == [Axis::Row(*rows), Axis::View, Axis::Light, Axis::Channel]
            && ranged.is_none_or(|(_, known)| known)
            && product.is_none_or(|(plane, table)| {
                let c = recipe.planes[plane].count();
                axes(table) == [Axis::Row(*rows), Axis::Component(c), Axis::View, Axis::Light, Axis::Channel]
                    && recipe.tables[table].range.is_none()
                    && recipe.planes[plane].range().is_none()
                    && !recipe.planes[plane].per_view()
            });
        let Numbers::Index(indices) = parts.plane(index, 0, Rect::whole(meta))? else { return Ok(None) };
        if !known {
            return Ok(None);
        }
        // Read the numbers
        let components = match product {
            Some((plane, table)) => Some([parts.table(table)?, parts.plane(plane, 0, Rect::whole(meta))?]),
            None => None,
        };
        Ok(Some(Self {
            meta: meta.clone(),
            clusters: *rows,
            index: indices.to_vec(),
            domain,
            block: parts.table(block)?,
            range: match ranged {
                Some((range, _)) => Some(parts.table(range)?.to_f32()),
                None => None,
            },
            c: product.map_or(0, |(plane, _)| recipe.planes[plane].count()),
            components,
        }))
    }

    /// Size, directions and conventions.
    pub fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    /// The index image: the cluster of each texel, rows from the top.
    pub fn index(&self) -> &[u16] {
        &self.index
    }

    /// Domain of the block's numbers.
    pub(super) fn domain(&self) -> Domain {
        self.domain
    }

    pub(super) fn tables(&self) -> Tables<'_> {
        let [components, coefficients] = match &self.components {
            Some([components, coefficients]) => [components.into(), coefficients.into()],
            None => [Slice::U8(&[]); 2],
        };
        Tables {
            block: (&self.block).into(),
            range: self.range.as_ref().map_or(&[], |range| bytemuck::cast_slice(range)),
            pairs: self.meta.pairs(),
            lights: self.meta.lights.len(),
            c: self.c,
            components,
            coefficients,
        }
    }
}

impl Decoder for QuantisedBtf {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let (tables, c, encoding) = (self.tables(), self.c, self.meta.encoding);
        let coefficients: Vec<f32> = (0..c * self.meta.texels()).map(|i| tables.coefficients.at(i)).collect();
        // means and components of all clusters in one pair
        let mut palette = vec![[0.0; 3]; self.clusters * (1 + c)];
        for (light, out) in lights.zip(out.chunks_exact_mut(self.meta.image_len())) {
            let pair = view * self.meta.lights.len() + light;
            for (cluster, rows) in palette.chunks_exact_mut(1 + c).enumerate() {
                rows[0] = tables.mean(cluster, pair);
                rows[1..].iter_mut().enumerate().for_each(|(k, row)| *row = tables.component(cluster, k, pair));
                if c == 0 {
                    rows[0] = rows[0].map(|v| self.domain.to_stored(encoding, v));
                }
            }
            for (texel, (out, &cluster)) in out.chunks_exact_mut(3).zip(self.index()).enumerate() {
                let rows = &palette[usize::from(cluster) * (1 + c)..][..1 + c];
                let mut sum = rows[0];
                for (&coefficient, &row) in coefficients[texel * c..].iter().zip(&rows[1..]) {
                    add(&mut sum, coefficient, row);
                }
                out.copy_from_slice(&sum);
            }
            if c > 0 && !self.domain.is_stored(encoding) {
                out.iter_mut().for_each(|v| *v = self.domain.to_stored(encoding, *v));
            }
        }
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        let bytes = |numbers: &Numbers| numbers.len() * numbers.sample_type().map_or(2, SampleType::bytes);
        let tables: usize = self.components.iter().flatten().chain([&self.block]).map(bytes).sum();
        (tables + self.range.as_ref().map_or(0, |range| size_of_val(&range[..])) + size_of_val(&self.index[..])) as u64
    }

    fn material(self: Arc<Self>, interpolation: Interpolation) -> Result<Arc<dyn Material>> {
        Ok(Arc::new(QuantisedMaterial::new(self, interpolation)?))
    }
}
