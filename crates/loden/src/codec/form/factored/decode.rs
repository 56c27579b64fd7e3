//! Decoding of images from factors.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::table::bytes as table_bytes;
use super::{Compact, FactoredMaterial};
use crate::Result;
use crate::btf::{BtfMeta, Rect, SampleType};
use crate::codec::decoder::Decoder;
use crate::codec::parts::{Axis, Expr, Numbers, Parts, PlaneKind, Shared, Views};
use crate::color::domain::Domain;
use crate::material::{Interpolation, Material};

/// Factors: a mean and components times coefficients.
#[derive(Debug)]
pub struct FactoredBtf {
    meta: BtfMeta,
    c: usize,
    per_view: bool,
    domain: Domain,
    store: Store,
}

#[derive(Debug)]
enum Store {
    /// As stored.
    Parts {
        /// (view, light, rgb)
        mean: Option<Shared<f32>>,
        /// (view, component, light, rgb)
        basis: Numbers,
        /// (view or none, component): offset and scale of 8-bit coefficients
        range: Option<Shared<f32>>,
        /// (texel, component): one block, or one per view
        coefficients: Vec<Numbers>,
    },
    /// Decoded when the file was opened.
    Held(Arc<Compact>),
}

/// The factors of one view in single precision.
pub(super) struct ViewFactors<'a> {
    /// (light, rgb)
    pub mean: Cow<'a, [f32]>,
    /// (component, light, rgb)
    pub basis: Cow<'a, [f32]>,
    /// (component): offset and scale of 8-bit coefficients
    pub range: Option<&'a [[f32; 2]]>,
    /// (texel, component)
    pub coefficients: Coefficients<'a>,
}

#[derive(Clone, Copy)]
pub(super) enum Coefficients<'a> {
    F32(&'a [f32]),
    F16(&'a [f16]),
    U8(&'a [u8]),
    Held(&'a Compact),
}

/// Makes a decoder of recipes that are the dot product of a plane with a table over all pairs, with or without the
/// mean of each pair; `None` for other recipes.
///
/// # Errors
/// Errors of reading the parts.
pub fn form(parts: &Arc<dyn Parts>) -> Result<Option<Arc<dyn Decoder>>> {
    Ok(FactoredBtf::new(&**parts)?.map(|btf| Arc::new(btf) as Arc<dyn Decoder>))
}

impl FactoredBtf {
    /// Factors from parts whose recipe is the dot product of a plane with a table over all pairs, with or without the
    /// mean of each pair; `None` for other recipes.
    ///
    /// # Errors
    /// Errors of reading the parts.
    pub fn new(parts: &dyn Parts) -> Result<Option<Self>> {
        let (meta, recipe) = (parts.meta(), parts.recipe());
        let Expr::Sum(terms) = &recipe.value else { return Ok(None) };
        let (mean, plane, basis) = match terms[..] {
            [Expr::Table { table, row: None }, Expr::Dot { plane, table: basis, row: None }] => {
                (Some(table), plane, basis)
            }
            [Expr::Dot { plane, table: basis, row: None }] => (None, plane, basis),
            _ => return Ok(None),
        };
        let (Some(domain), PlaneKind::Numbers { count, views, range, .. }) =
            (recipe.curve.domain(), recipe.planes[plane].kind)
        else {
            return Ok(None);
        };
        let per_view = views == Views::Each;
        let is =
            |table: usize, axes: &[Axis]| recipe.tables[table].axes == axes && recipe.tables[table].range.is_none();
        let view = if per_view { Axis::View } else { Axis::Shared };
        let known = is(basis, &[Axis::View, Axis::Component(count), Axis::Light, Axis::Channel])
            && mean.is_none_or(|mean| is(mean, &[Axis::View, Axis::Light, Axis::Channel]))
            && range.is_none_or(|range| is(range, &[view, Axis::Component(count), Axis::Range]))
            // 8-bit coefficients always have ranges, others never
            && range.is_some() == (recipe.planes[plane].sample_type() == Some(SampleType::U8));
        if !known {
            return Ok(None);
        }
        let single = |table: Option<usize>| -> Result<Option<Shared<f32>>> {
            table.map(|table| Ok(parts.table(table)?.to_f32())).transpose()
        };
        let blocks = if per_view { meta.views.len() } else { 1 };
        let coefficients = (0..blocks).map(|view| parts.plane(plane, view, Rect::whole(meta)));
        let store = Store::Parts {
            mean: single(mean)?,
            basis: parts.table(basis)?,
            range: single(range)?,
            coefficients: coefficients.collect::<Result<_>>()?,
        };
        Ok(Some(Self { meta: meta.clone(), c: count, per_view, domain, store }))
    }

    /// Factors that were decoded and are shared by all views.
    pub fn held(meta: &BtfMeta, domain: Domain, factors: Arc<Compact>) -> Self {
        Self { meta: meta.clone(), c: factors.components(), per_view: false, domain, store: Store::Held(factors) }
    }

    /// The decoded factors, if held.
    pub(super) fn compact(&self) -> Option<Arc<Compact>> {
        match &self.store {
            Store::Held(factors) => Some(factors.clone()),
            Store::Parts { .. } => None,
        }
    }

    /// Size, directions and conventions.
    pub fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    /// Number of components.
    pub fn components(&self) -> usize {
        self.c
    }

    /// The domain of the factors.
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// Whether each view has its own coefficients.
    pub(super) fn per_view(&self) -> bool {
        self.per_view
    }

    pub(super) fn factors(&self, view: usize) -> ViewFactors<'_> {
        let row = 3 * self.meta.lights.len();
        let part = |len: usize| view * len..(view + 1) * len;
        let block = if self.per_view { view } else { 0 };
        let (mean, range, basis, coefficients) = match &self.store {
            Store::Held(factors) => return factors.factors(view, self.meta.lights.len()),
            Store::Parts { mean, range, basis, coefficients } => (mean, range, basis, &coefficients[block]),
        };
        ViewFactors {
            mean: match mean {
                Some(mean) => Cow::Borrowed(&mean[part(row)]),
                None => Cow::Owned(vec![0.0; row]),
            },
            basis: match basis {
                Numbers::F32(basis) => Cow::Borrowed(&basis[part(self.c * row)]),
                other => Cow::Owned(other.part(part(self.c * row)).to_f32().to_vec()),
            },
            range: range.as_ref().map(|range| &bytemuck::cast_slice(range)[block * self.c..(block + 1) * self.c]),
            coefficients: match coefficients {
                Numbers::F32(values) => Coefficients::F32(values),
                Numbers::F16(values) => Coefficients::F16(values),
                Numbers::U8(values) => Coefficients::U8(values),
                Numbers::Index(_) => Coefficients::U8(&[]),
            },
        }
    }
}

/// Results larger than this many bytes are written past the caches.
const STREAMING: usize = 4 << 20;

/// Size of a block of spread coefficients: most of a first-level cache.
const BLOCK_NUMBERS: usize = 5120;

/// Period after which the pattern r, g, b is again aligned with a vector.
const PERIOD: usize = 24;

type Pattern = [f32; PERIOD];

struct Scratch {
    /// (group of 24 numbers, component): each coefficient three times
    spread: Vec<Pattern>,
    /// the mean, then the components: the values of a light as r, g, b, r, g, b ...
    patterns: Vec<Pattern>,
    result: Vec<f32>,
}

impl Scratch {
    fn new(texels: usize, c: usize) -> Self {
        let groups = texels.div_ceil(8);
        Self {
            spread: vec![[0.0; PERIOD]; groups * c],
            patterns: vec![[0.0; PERIOD]; c + 1],
            result: vec![0.0; groups * PERIOD],
        }
    }

    fn load(&mut self, factors: &ViewFactors, first: usize, count: usize, c: usize) {
        let part = first * c..(first + count) * c;
        let expand = |v: u8, k: usize| {
            let range = factors.range.and_then(|range| range.get(k));
            range.map_or(0.0, |[offset, scale]| offset + scale * f32::from(v))
        };
        match factors.coefficients {
            Coefficients::F32(values) => spread(&values[part], c, &mut self.spread, |v, _| v),
            Coefficients::F16(values) => spread(&values[part].to_f32_vec(), c, &mut self.spread, |v, _| v),
            Coefficients::U8(values) => spread(&values[part], c, &mut self.spread, expand),
            Coefficients::Held(factors) => spread(&factors.numbers(first, count), c, &mut self.spread, expand),
        }
    }

    fn pattern(&mut self, factors: &ViewFactors, light: usize, c: usize) {
        let row = factors.mean.len();
        let rows = std::iter::once(&factors.mean[..]).chain(factors.basis.chunks_exact(row)).take(c + 1);
        for (pattern, row) in self.patterns.iter_mut().zip(rows) {
            let rgb = &row[3 * light..3 * light + 3];
            pattern.chunks_exact_mut(3).for_each(|p| p.copy_from_slice(rgb));
        }
    }
}

/// Repeats each coefficient for the three channels, component by component in groups of eight texels.
fn spread<T: Copy>(values: &[T], c: usize, out: &mut [Pattern], number: impl Fn(T, usize) -> f32) {
    for (texel, coefficients) in values.chunks_exact(c).enumerate() {
        let group = &mut out[texel / 8 * c..][..c];
        let place = 3 * (texel % 8);
        for (k, (pattern, &value)) in group.iter_mut().zip(coefficients).enumerate() {
            pattern[place..place + 3].fill(number(value, k));
        }
    }
}

/// Number of components whose patterns fit the registers.
const BLOCK: usize = 4;

impl Scratch {
    /// Mean plus components times coefficients, into `out`, past the caches if `streaming`.
    fn combine(&mut self, c: usize, out: &mut [f32], streaming: bool) {
        let (mean, basis) = (self.patterns[0], &self.patterns[1..]);
        if c <= BLOCK && out.len().is_multiple_of(PERIOD) {
            return Block { basis, spread: &self.spread, stride: c, start: Some(&mean) }.add(out, streaming);
        }
        for (i, basis) in basis.chunks(BLOCK).enumerate() {
            let start = (i == 0).then_some(&mean);
            Block { basis, spread: &self.spread[i * BLOCK..], stride: c, start }.add(&mut self.result, false);
        }
        let result = &self.result[..out.len()];
        if streaming { stream(result, out) } else { out.copy_from_slice(result) }
    }
}

/// At most [`BLOCK`] components.
struct Block<'a> {
    basis: &'a [Pattern],
    /// Spread coefficients, beginning with the first of these components; groups are [`Block::stride`] patterns
    /// apart.
    spread: &'a [Pattern],
    stride: usize,
    /// Start value of the sums; `None` adds to what `out` holds.
    start: Option<&'a Pattern>,
}

impl Block<'_> {
    /// Adds the products group by group; the length of `out` is a multiple of a group.
    fn add(&self, out: &mut [f32], streaming: bool) {
        #[cfg(target_arch = "x86_64")]
        if crate::simd::has_avx2() {
            let streaming = streaming && out.as_ptr().align_offset(16) == 0;
            // SAFETY: the processor has AVX2.
            return unsafe {
                match (self.basis.len(), streaming) {
                    (1, _) => self.add_avx2::<1, false>(out),
                    (2, _) => self.add_avx2::<2, false>(out),
                    (3, _) => self.add_avx2::<3, false>(out),
                    (_, false) => self.add_avx2::<4, false>(out),
                    (_, true) => self.add_avx2::<4, true>(out),
                }
            };
        }
        for (group, out) in out.chunks_exact_mut(PERIOD).enumerate() {
            if let Some(start) = self.start {
                out.copy_from_slice(start);
            }
            for (basis, coefficients) in self.basis.iter().zip(&self.spread[group * self.stride..]) {
                for (out, (basis, coefficient)) in out.iter_mut().zip(basis.iter().zip(coefficients)) {
                    *out += basis * coefficient;
                }
            }
        }
    }

    /// Keeps the patterns of a block in registers and writes each sum once, past the caches if `STREAM`.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn add_avx2<const K: usize, const STREAM: bool>(&self, out: &mut [f32]) {
        use std::arch::x86_64::*;
        const VECTORS: usize = PERIOD / 8;
        let groups = out.len() / PERIOD;
        assert!(self.basis.len() == K && (groups == 0 || self.spread.len() >= (groups - 1) * self.stride + K));
        // SAFETY: a pattern fills three vectors.
        let load = |pattern: *const f32, i: usize| unsafe { _mm256_loadu_ps(pattern.add(8 * i)) };
        let mut basis = [[_mm256_setzero_ps(); VECTORS]; K];
        for (basis, pattern) in basis.iter_mut().zip(self.basis) {
            for (i, vector) in basis.iter_mut().enumerate() {
                *vector = load(pattern.as_ptr(), i);
            }
        }
        for group in 0..groups {
            // SAFETY: checked above: the K patterns of this group and its numbers in `out` exist.
            let (coefficients, to) = unsafe {
                (self.spread.as_ptr().add(group * self.stride).cast::<f32>(), out.as_mut_ptr().add(group * PERIOD))
            };
            for i in 0..VECTORS {
                let mut sum = load(self.start.map_or(to.cast_const(), |start| start.as_ptr()), i);
                for (k, basis) in basis.iter().enumerate() {
                    // SAFETY: pattern k of the group.
                    let coefficient = load(unsafe { coefficients.add(k * PERIOD) }, i);
                    sum = _mm256_add_ps(sum, _mm256_mul_ps(coefficient, basis[i]));
                }
                // SAFETY: eight numbers of the group; `out` is aligned to 16 bytes where STREAM is set.
                unsafe {
                    if STREAM {
                        _mm_stream_ps(to.add(8 * i), _mm256_castps256_ps128(sum));
                        _mm_stream_ps(to.add(8 * i + 4), _mm256_extractf128_ps::<1>(sum));
                    } else {
                        _mm256_storeu_ps(to.add(8 * i), sum);
                    }
                }
            }
        }
    }
}

/// Copies past the caches, for memory that is not read again soon.
fn stream(from: &[f32], to: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_mm_loadu_ps, _mm_stream_ps};
        let head = to.as_ptr().align_offset(16).min(to.len());
        let (from_head, from) = from.split_at(head);
        let (to_head, to) = to.split_at_mut(head);
        to_head.copy_from_slice(from_head);
        let whole = to.len() / 4 * 4;
        for i in (0..whole).step_by(4) {
            // SAFETY: both have four numbers from i; `to` is aligned to 16 bytes; x86-64 has SSE.
            unsafe { _mm_stream_ps(to.as_mut_ptr().add(i), _mm_loadu_ps(from.as_ptr().add(i))) };
        }
        to[whole..].copy_from_slice(&from[whole..]);
    }
    #[cfg(not(target_arch = "x86_64"))]
    to.copy_from_slice(from);
}

/// Orders streaming stores before later stores.
fn finish_streaming() {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: x86-64 has SSE.
    unsafe {
        std::arch::x86_64::_mm_sfence();
    }
}

impl Decoder for FactoredBtf {
    fn decode(&self, view: usize, lights: Range<usize>, out: &mut [f32]) -> Result<()> {
        let (meta, factors) = (&self.meta, self.factors(view));
        let texels = BLOCK_NUMBERS / 3 / self.c / 8 * 8;
        let texels = texels.max(8).min(meta.texels().next_multiple_of(8));
        let mut scratch = Scratch::new(texels, self.c);
        // streaming stores pay if the result exceeds the caches
        let streaming = size_of_val(out) > STREAMING;
        for first in (0..meta.texels()).step_by(texels) {
            let count = texels.min(meta.texels() - first);
            scratch.load(&factors, first, count, self.c);
            for (image, light) in lights.clone().enumerate() {
                scratch.pattern(&factors, light, self.c);
                let place = image * meta.image_len() + 3 * first;
                let out = &mut out[place..place + 3 * count];
                if self.domain.is_stored(meta.encoding) {
                    scratch.combine(self.c, out, streaming);
                } else {
                    scratch.combine(self.c, out, false);
                    out.iter_mut().for_each(|v| *v = self.domain.to_stored(meta.encoding, *v));
                }
            }
        }
        finish_streaming();
        Ok(())
    }

    fn table_bytes(&self) -> u64 {
        match &self.store {
            Store::Parts { coefficients, .. } => {
                let precision = coefficients[0].sample_type().unwrap_or(SampleType::U8);
                table_bytes(&self.meta, self.c, precision, coefficients.len())
            }
            Store::Held(factors) => factors.bytes(),
        }
    }

    fn material(self: Arc<Self>, interpolation: Interpolation) -> Result<Arc<dyn Material>> {
        Ok(Arc::new(FactoredMaterial::new(&self, interpolation)?))
    }
}
