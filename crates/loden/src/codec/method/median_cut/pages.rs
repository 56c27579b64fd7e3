//! The texels of a source as points, one page per pair, read in stages.

use std::collections::HashMap;
use std::ops::Range;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::codec::budget;
use crate::color::domain::Domain;
use crate::factor::median_cut::{Measure, Pages, deviation, size};
use crate::progress::Task;
use crate::simd::wide;
use crate::stages::{Each, Kernel, Known, Piece, Site, Stage, Stages, collect, settings};
use crate::{Error, Result};

/// The texels of a source as points, with one page per pair.
pub struct Images<'a> {
    pub stages: &'a dyn Stages,
    pub domain: Domain,
    pub task: Task<'a>,
}

impl Images<'_> {
    /// Runs a stage with a unit for each item: a page, a dimension or none, and lists of points.
    fn run(&self, want: Want, items: &[(usize, usize, Vec<&[u32]>)]) -> Result<Vec<Piece>> {
        let (mut points, mut ends, mut place) = (Vec::new(), vec![0], HashMap::new());
        let mut lists = Vec::new();
        let mut units = Vec::new();
        for (page, dimension, groups) in items {
            let first = lists.len() as u32;
            for group in groups {
                // a list occurs in many pages, and is written once
                let number = *place.entry(group.as_ptr()).or_insert_with(|| {
                    points.extend_from_slice(group);
                    ends.push(points.len() as u32);
                    ends.len() as u32 - 2
                });
                lists.push(number);
            }
            units.extend([*page as u32, *dimension as u32, first, lists.len() as u32]);
        }
        let known = Known {
            settings: settings(&Settings { want, domain: self.domain })?,
            indices: vec![points.into(), ends.into(), lists.into(), units.into()],
            ..Known::default()
        };
        collect(self.stages, &Stage { kernel: &ReadPages, known, units: items.len(), steps: 0 }, &self.task)
    }
}

impl Pages for Images<'_> {
    fn points(&self) -> usize {
        self.stages.source().meta().texels()
    }

    fn pages(&self) -> usize {
        self.stages.source().meta().pairs()
    }

    fn together(&self) -> usize {
        // other processes would wait for each other after every view
        if self.stages.is_local() { self.stages.source().meta().lights.len() } else { self.pages() }
    }

    fn measure(&self, pages: &[(usize, Vec<&[u32]>)], measure: Measure) -> Result<Vec<Vec<(f32, usize)>>> {
        let want = if measure == Measure::Edge { Want::Edge } else { Want::Deviation };
        let items: Vec<_> = pages.iter().map(|(page, groups)| (*page, 0, groups.clone())).collect();
        let pairs = |piece: Piece| {
            piece
                .doubles
                .as_chunks::<2>()
                .0
                .iter()
                .map(|&[size, dimension]| (size as f32, dimension as usize))
                .collect()
        };
        Ok(self.run(want, &items)?.into_iter().map(pairs).collect())
    }

    fn values(&self, lists: &[(usize, usize, &[u32])]) -> Result<Vec<Vec<f32>>> {
        let items: Vec<_> = lists.iter().map(|&(page, dimension, points)| (page, dimension, vec![points])).collect();
        Ok(self.run(Want::Values, &items)?.into_iter().map(|piece| piece.floats).collect())
    }

    fn done(&self, pages: Range<usize>) -> Result<()> {
        let lights = self.stages.source().meta().lights.len();
        for view in pages.start / lights..pages.end.div_ceil(lights) {
            self.stages.source().release(view);
            self.task.advance(1)?;
        }
        Ok(())
    }
}

/// Measures boxes in images, or reads the values of their points: a unit is a page with its lists of points.
pub struct ReadPages;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Want {
    Edge,
    Deviation,
    Values,
}

#[derive(Serialize, Deserialize)]
struct Settings {
    want: Want,
    domain: Domain,
}

impl Kernel for ReadPages {
    fn name(&self) -> &'static str {
        "pages"
    }

    fn memory(&self, meta: &BtfMeta, known: &Known, _units: Range<usize>, threads: usize) -> u64 {
        let lists: u64 = known.indices.iter().map(|index| 4 * index.len() as u64).sum();
        threads as u64 * budget::singles(3 * meta.image_len()) + 4 * lists
    }

    fn run(&self, site: &Site, known: &Known, units: Range<usize>, each: Each) -> Result<()> {
        let Settings { want, domain } = known.settings()?;
        let [points, ends, lists, described] = [known.index(0)?, known.index(1)?, known.index(2)?, known.index(3)?];
        units.into_par_iter().try_for_each(|unit| {
            let [page, dimension, first, last] = described.as_chunks::<4>().0[unit].map(|v| v as usize);
            let list = |&i: &u32| &points[ends[i as usize] as usize..ends[i as usize + 1] as usize];
            let groups: Vec<&[u32]> = lists[first..last].iter().map(list).collect();
            let page = Page::read(site.source, page, domain)?;
            let piece = match want {
                Want::Values => {
                    let floats = groups.iter().flat_map(|points| page.values(dimension, points)).collect();
                    Piece { floats, ..Piece::default() }
                }
                Want::Edge | Want::Deviation => {
                    let measure = if want == Want::Edge { Measure::Edge } else { Measure::Deviation };
                    let found = page.measure(&groups, measure);
                    let doubles = found.iter().flat_map(|(size, at)| [f64::from(*size), *at as f64]).collect();
                    Piece { doubles, ..Piece::default() }
                }
            };
            each(unit, piece)
        })
    }
}

/// An image, whose three channels are the dimensions of a page.
struct Page<'a> {
    image: Texels<'a>,
    meta: &'a BtfMeta,
    domain: Domain,
}

impl<'a> Page<'a> {
    fn read(source: &'a dyn BtfSource, page: usize, domain: Domain) -> Result<Self> {
        let meta = source.meta();
        let (view, light) = (page / meta.lights.len(), page % meta.lights.len());
        let image = source.image(view, light)?;
        let (found, expected) = (image.len(), meta.image_len());
        if found != expected {
            let problem = format!("image ({view}, {light}) has {found} numbers, expected {expected}");
            return Err(Error::parameter("source", problem));
        }
        Ok(Self { image, meta, domain })
    }

    fn curve(&self, value: f32) -> f32 {
        self.domain.from_stored(self.meta.encoding, value)
    }

    fn is_stored(&self) -> bool {
        self.domain.is_stored(self.meta.encoding)
    }

    /// A value in the domain; 8-bit values that are their own domain remain integers, free of rounding.
    fn byte_curve(&self) -> [f32; 256] {
        let stored = self.is_stored();
        std::array::from_fn(|i| if stored { i as f32 } else { self.curve(i as f32 / 255.0) })
    }

    /// The largest measure of each group among the channels, and its channel.
    fn measure(&self, groups: &[&[u32]], measure: Measure) -> Vec<(f32, usize)> {
        let largest =
            |sizes: [f32; 3]| (1..3).fold((sizes[0], 0), |b, c| if sizes[c] > b.0 { (sizes[c], c) } else { b });
        let generic = |number: &dyn Fn(usize) -> f32| {
            let channel = |points: &[u32], c| size(points.iter().map(|&p| number(3 * p as usize + c)), measure);
            groups.iter().map(|points| largest([0, 1, 2].map(|c| channel(points, c)))).collect()
        };
        match &self.image {
            Texels::U8(values) => {
                let curve = self.byte_curve();
                // a texel is read together with a fourth byte
                let padded = [&values[..], &[0]].concat();
                let of_group = |points: &&[u32]| match measure {
                    Measure::Edge => {
                        let (low, high) = extent(&padded, points);
                        largest([0, 1, 2].map(|c| curve[usize::from(high[c])] - curve[usize::from(low[c])]))
                    }
                    Measure::Deviation if self.is_stored() => largest(whole_deviations(&padded, points)),
                    Measure::Deviation => largest(deviations(&padded, points, &curve)),
                };
                groups.iter().map(of_group).collect()
            }
            Texels::F16(values) => generic(&|i| self.curve(values[i].to_f32())),
            Texels::F32(values) => generic(&|i| self.curve(values[i])),
        }
    }

    /// The values of a channel.
    fn values(&self, channel: usize, points: &[u32]) -> Vec<f32> {
        let places = points.iter().map(|&p| 3 * p as usize + channel);
        match &self.image {
            Texels::U8(values) => {
                let curve = self.byte_curve();
                places.map(|i| curve[usize::from(values[i])]).collect()
            }
            Texels::F16(values) => places.map(|i| self.curve(values[i].to_f32())).collect(),
            Texels::F32(values) => places.map(|i| self.curve(values[i])).collect(),
        }
    }
}

/// Reads four bytes, beginning at a texel.
#[inline(always)]
fn four(image: &[u8], texel: u32) -> [u8; 4] {
    let place = 3 * texel as usize;
    image.get(place..place + 4).and_then(|bytes| bytes.try_into().ok()).unwrap_or_default()
}

/// The least and greatest values of a list of texels; the fourth bytes are meaningless.
fn extent(image: &[u8], points: &[u32]) -> ([u8; 4], [u8; 4]) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_mm_cvtsi32_si128, _mm_cvtsi128_si32, _mm_max_epu8, _mm_min_epu8, _mm_set1_epi8};
        #[target_feature(enable = "sse2")]
        fn sse2(image: &[u8], points: &[u32]) -> ([u8; 4], [u8; 4]) {
            let (mut low, mut high) = (_mm_set1_epi8(-1), _mm_set1_epi8(0));
            for &point in points {
                let texel = _mm_cvtsi32_si128(i32::from_le_bytes(four(image, point)));
                low = _mm_min_epu8(low, texel);
                high = _mm_max_epu8(high, texel);
            }
            (_mm_cvtsi128_si32(low).to_le_bytes(), _mm_cvtsi128_si32(high).to_le_bytes())
        }
        // SAFETY: x86-64 has SSE2.
        unsafe { sse2(image, points) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        let (mut low, mut high) = ([255; 4], [0; 4]);
        for texel in points.iter().map(|&point| four(image, point)) {
            for c in 0..4 {
                low[c] = low[c].min(texel[c]);
                high[c] = high[c].max(texel[c]);
            }
        }
        (low, high)
    }
}

/// [`deviations`] for integers.
fn whole_deviations(image: &[u8], points: &[u32]) -> [f32; 3] {
    let mut sums = [[0.0f64; 2]; 3];
    // this many squares of bytes fit 32 bits
    for points in points.chunks(1 << 16) {
        let mut part = [[0u32; 4]; 2];
        add_squares(image, points, &mut part);
        for (channel, sums) in sums.iter_mut().enumerate() {
            (0..2).for_each(|i| sums[i] += f64::from(part[i][channel]));
        }
    }
    sums.map(|[sum, squares]| deviation(points.len() as f64, sum, squares))
}

wide! {
    /// Adds values and squares of a list of texels.
    fn add_squares(image: &[u8], points: &[u32], sums: &mut [[u32; 4]; 2]) {
        let [mut values, mut squares] = *sums;
        for &point in points {
            let texel = four(image, point).map(u32::from);
            for c in 0..4 {
                values[c] += texel[c];
                squares[c] += texel[c] * texel[c];
            }
        }
        *sums = [values, squares];
    }
}

/// Sums of squared deviations of a list of texels, per channel.
fn deviations(image: &[u8], points: &[u32], curve: &[f32; 256]) -> [f32; 3] {
    let mut sums = [[0.0f64; 2]; 3];
    for texel in points.iter().map(|&point| four(image, point)) {
        for (sums, byte) in sums.iter_mut().zip(texel) {
            let value = f64::from(curve[usize::from(byte)]);
            sums[0] += value;
            sums[1] += value * value;
        }
    }
    sums.map(|[sum, squares]| deviation(points.len() as f64, sum, squares))
}
