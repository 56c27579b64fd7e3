//! A material as rows: an index image, and the ABRDF of each row.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;
use half::f16;

use crate::btf::{BtfMeta, Cosine, Rect, SampleType};
use crate::codec::parts::{Axis, Expr, MemoryParts, Numbers, Parts, PlaneKind, PlaneSpec, Recipe, Shared, TableSpec};
use crate::color::domain::Domain;
use crate::{Error, Result};

/// The least cosine of the light that values are divided by.
const MIN_COSINE: f32 = 1e-3;

/// The largest number of rows that an index image can distinguish.
pub const MAX_ROWS: usize = 1 << 16;

/// A material as rows.
pub struct Rows {
    parts: Arc<dyn Parts>,
    plane: usize,
    table: usize,
    domain: Domain,
    index: Shared<u16>,
    block: Numbers,
    /// Offset and scale of 8-bit numbers for each view.
    range: Option<Shared<f32>>,
    count: usize,
}

impl Rows {
    /// The rows of a material whose recipe is a block chosen by an index image, as `kmeans`, `median-cut` and `tsvq` write it;
    /// `None` for other recipes.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] for a BTF with its own list of pairs; errors of reading the parts.
    pub fn new(parts: Arc<dyn Parts>) -> Result<Option<Self>> {
        parts.meta().check_grid("changing a material")?;
        let recipe = parts.recipe();
        let (Expr::Table { table, row: Some(plane) }, Some(domain)) = (&recipe.value, recipe.curve.domain()) else {
            return Ok(None);
        };
        let (table, plane, spec) = (*table, *plane, &recipe.tables[*table]);
        let PlaneKind::Index { rows: count } = recipe.planes[plane].kind else { return Ok(None) };
        let ranged = spec.range.map(|range| (range, &recipe.tables[range].axes[..]));
        if spec.axes != [Axis::Row(count), Axis::View, Axis::Light, Axis::Channel]
            || ranged.is_some_and(|(_, axes)| axes != [Axis::View, Axis::Range])
        {
            return Ok(None);
        }
        let Numbers::Index(index) = parts.plane(plane, 0, Rect::whole(parts.meta()))? else { return Ok(None) };
        let range = ranged.map(|(range, _)| parts.table(range)).transpose()?.map(|range| range.to_f32());
        let block = parts.table(table)?;
        Ok(Some(Self { plane, table, domain, index, block, range, count, parts }))
    }

    /// Size, directions and conventions.
    pub fn meta(&self) -> &BtfMeta {
        self.parts.meta()
    }

    /// The parts that hold the rows.
    pub fn parts(&self) -> &Arc<dyn Parts> {
        &self.parts
    }

    /// The row of each texel.
    pub fn index(&self) -> &[u16] {
        &self.index
    }

    /// Number of rows.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Number of texels of each row.
    pub fn populations(&self) -> Vec<f64> {
        let mut populations = vec![0.0; self.count];
        self.index.iter().for_each(|&row| populations[usize::from(row)] += 1.0);
        populations
    }

    /// Numbers per row.
    fn len(&self) -> usize {
        3 * self.meta().pairs()
    }

    /// The apparent values of a row in linear light, shape (view, light).
    ///
    /// # Panics
    /// If there is no such row.
    pub fn values(&self, row: usize) -> Vec<Vec3> {
        let (meta, numbers) = (self.meta(), self.numbers(row));
        let linear = |v: f32| self.domain.to_linear(meta.encoding, v);
        let cosines = cosines(meta);
        let texels = numbers.chunks_exact(3).zip(cosines.iter().cycle());
        texels.map(|(rgb, cosine)| Vec3::from_slice(rgb).map(linear) * *cosine).collect()
    }

    /// The numbers of a row in the domain of the block.
    fn numbers(&self, row: usize) -> Vec<f32> {
        let stored = self.block.part(row * self.len()..(row + 1) * self.len()).to_f32();
        let of_view = 3 * self.meta().lights.len();
        match &self.range {
            Some(range) => {
                let ranged = |(k, v): (usize, &f32)| range[2 * (k / of_view)] + range[2 * (k / of_view) + 1] * v;
                stored.iter().enumerate().map(ranged).collect()
            }
            None => stored.to_vec(),
        }
    }

    /// The numbers that stand for apparent values, in the domain of the block.
    fn coded(&self, values: &[Vec3]) -> Vec<f32> {
        self.coded_in(values, self.domain)
    }

    /// The numbers that stand for apparent values, in a domain.
    pub(super) fn coded_in(&self, values: &[Vec3], domain: Domain) -> Vec<f32> {
        let meta = self.meta();
        let cosines = cosines(meta);
        let code = |v: f32| domain.from_stored(meta.encoding, meta.encoding.encode(v));
        let texels = values.iter().zip(cosines.iter().cycle());
        texels.flat_map(|(rgb, cosine)| (*rgb / *cosine).to_array().map(code)).collect()
    }

    /// The same material with some rows changed. New row k is the old row `origin[k]`, or has the apparent values
    /// `changed[k]`; `index` chooses from the new rows. Rows that are not changed keep their numbers as they are stored. A block
    /// of 8 bits becomes one of half precision if it cannot hold the values.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there are too many rows, or a value exceeds the precision of the block.
    pub fn rebuilt(
        &self,
        index: Shared<u16>,
        origin: &[usize],
        changed: &BTreeMap<usize, Vec<Vec3>>,
    ) -> Result<MemoryParts> {
        if origin.len() > MAX_ROWS {
            return Err(Error::parameter(
                "rows",
                format!("{} are needed, at most {MAX_ROWS} are possible", origin.len()),
            ));
        }
        let coded: BTreeMap<usize, Vec<f32>> = changed.iter().map(|(row, v)| (*row, self.coded(v))).collect();
        let kept = match &self.block {
            Numbers::U8(_) => coded.values().all(|numbers| self.fits(numbers)),
            _ => true,
        };
        let block = self.block(origin, &coded, kept)?;
        let mut recipe = self.parts.recipe().clone();
        let rows = origin.len();
        recipe.planes[self.plane].kind = PlaneKind::Index { rows };
        recipe.tables[self.table].axes[0] = Axis::Row(rows);
        let mut tables = (0..recipe.tables.len()).map(|table| self.parts.table(table)).collect::<Result<Vec<_>>>()?;
        if kept {
            tables[self.table] = block;
        } else {
            recipe = recipe_of(rows, SampleType::F16, &recipe);
            tables = vec![block];
        }
        MemoryParts::new(self.meta().clone(), recipe, vec![Numbers::Index(index)], tables)
    }

    /// Whether 8-bit numbers with the ranges of the block can stand for these.
    fn fits(&self, numbers: &[f32]) -> bool {
        let of_view = 3 * self.meta().lights.len();
        numbers.chunks_exact(of_view).enumerate().all(|(view, numbers)| {
            let [offset, scale] = self.range_of(view);
            numbers.iter().all(|v| (-0.5..255.5).contains(&((v - offset) / scale)))
        })
    }

    fn range_of(&self, view: usize) -> [f32; 2] {
        self.range.as_ref().map_or([0.0, 1.0], |range| [range[2 * view], range[2 * view + 1]])
    }

    /// The numbers of all rows, in the type of the block if it is `kept`, else in half precision.
    fn block(&self, origin: &[usize], coded: &BTreeMap<usize, Vec<f32>>, kept: bool) -> Result<Numbers> {
        let (len, of_view) = (self.len(), 3 * self.meta().lights.len());
        /// The rows, each copied or converted.
        fn rows<T: Copy>(
            origin: &[usize],
            coded: &BTreeMap<usize, Vec<f32>>,
            old: impl Fn(usize, &mut Vec<T>),
            number: impl Fn(usize, f32) -> T,
        ) -> Vec<T> {
            let mut all = Vec::new();
            for (row, origin) in origin.iter().enumerate() {
                match coded.get(&row) {
                    Some(numbers) => all.extend(numbers.iter().enumerate().map(|(k, v)| number(k, *v))),
                    None => old(*origin, &mut all),
                }
            }
            all
        }
        let part = |row: usize| row * len..(row + 1) * len;
        let half = |_: usize, v: f32| f16::from_f32(v);
        let block = match &self.block {
            Numbers::U8(all) if kept => {
                let byte = |k: usize, v: f32| {
                    let [offset, scale] = self.range_of(k / of_view);
                    ((v - offset) / scale + 0.5) as u8
                };
                let all = &all[..];
                Numbers::U8(rows(origin, coded, |row, out| out.extend_from_slice(&all[part(row)]), byte).into())
            }
            Numbers::F32(all) => {
                let all = &all[..];
                Numbers::F32(rows(origin, coded, |row, out| out.extend_from_slice(&all[part(row)]), |_, v| v).into())
            }
            Numbers::F16(all) => {
                let all = &all[..];
                Numbers::F16(rows(origin, coded, |row, out| out.extend_from_slice(&all[part(row)]), half).into())
            }
            _ => {
                let old = |row: usize, out: &mut Vec<f16>| {
                    out.extend(self.numbers(row).iter().map(|&v| f16::from_f32(v)));
                };
                Numbers::F16(rows(origin, coded, old, half).into())
            }
        };
        let bad = match &block {
            Numbers::F16(all) => all.iter().position(|v| !v.is_finite()),
            Numbers::F32(all) => all.iter().position(|v| !v.is_finite()),
            _ => None,
        };
        match bad {
            Some(place) => Err(Error::parameter("block", format!("row {} exceeds its precision", place / len))),
            None => Ok(block),
        }
    }

    /// A material with the pattern of `index` on `width` x `height` texels, and the block of these rows as it is.
    ///
    /// # Errors
    /// As [`MemoryParts::new`].
    pub fn with_pattern(&self, [width, height]: [usize; 2], index: Vec<u16>) -> Result<MemoryParts> {
        let meta = BtfMeta { width, height, ..self.meta().clone() };
        let recipe = self.parts.recipe().clone();
        let tables = (0..recipe.tables.len()).map(|table| self.parts.table(table)).collect::<Result<Vec<_>>>()?;
        MemoryParts::new(meta, recipe, vec![Numbers::Index(index.into())], tables)
    }
}

/// The recipe of a block of this many rows, with the names and the curve of another.
fn recipe_of(rows: usize, sample_type: SampleType, from: &Recipe) -> Recipe {
    Recipe {
        planes: vec![PlaneSpec::index("index", rows)],
        tables: vec![TableSpec::new("block", &[Axis::Row(rows), Axis::View, Axis::Light, Axis::Channel], sample_type)],
        value: Expr::Table { table: 0, row: Some(0) },
        curve: from.curve,
    }
}

/// For each light, what stored values are multiplied by to include the cosine.
fn cosines(meta: &BtfMeta) -> Vec<f32> {
    let cosine = |wi: &Vec3| match meta.cosine {
        Cosine::Included => 1.0,
        Cosine::Excluded => wi.z.max(MIN_COSINE),
    };
    meta.lights.directions().iter().map(cosine).collect()
}
