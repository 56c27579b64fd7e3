//! Median cut: boxes of texels, each cut into two halves with equal numbers of texels.
//!
//! # Model
//! A texel is a point whose coordinates are its ABRDF: three values per pair of view and light. The box around all
//! texels is cut at the median of its longest edge, then one of the two boxes is cut, and so on until there are
//! enough boxes ([`crate::factor::median_cut`]). Each box is represented by the mean of its texels. Alternatively the
//! coordinates are principal components; boxes are then oblique to the values and follow the correlations of the
//! texels.
//!
//! # Limits
//! A cut considers one coordinate only, and an outlier makes a box long.
//!
//! # References
//! heckbert1982

use std::ops::Range;
use std::path::Path;

use crate::btf::{BtfMeta, BtfSource, Texels};
use crate::codec::form::quantised::{self, Block, CLUSTERS, DIMENSIONS};
use crate::codec::parts::{Curve, Recipe};
use crate::codec::{Codec, EncodeSummary};
use crate::color::domain::Domain;
use crate::factor::median_cut::{Columns, Measure, Pages, Rule, deviation, median_cut, size};
use crate::params::{Param, Params as _, Values};
use crate::progress::{Progress, Task};
use crate::simd::wide;
use crate::{Error, Result};

/// The codec.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MedianCut;

crate::words! {
    /// Choice of the next box to cut.
    enum Split { Balanced = "balanced", LongestEdge = "longest-edge", Population = "population", Variance = "variance" }
}

crate::words! {
    /// Coordinates of the boxes.
    enum Space { Abrdf = "abrdf", Pca = "pca" }
}

crate::params! {
    struct Settings {
        clusters: usize => CLUSTERS,
        /// Next box to cut: the topmost in the tree, the one with the longest edge, or that with the largest product
        /// of number of texels and longest edge, or of number of texels and variance in one dimension.
        split: Split = "population",
        /// Coordinates of the points: all values of a texel, or its principal components.
        space: Space = "abrdf",
        dimensions: usize => DIMENSIONS,
        block: Block,
    }
}

impl Codec for MedianCut {
    fn name(&self) -> &'static str {
        "median-cut"
    }

    fn doc(&self) -> &'static str {
        "Clusters of similar texels by median cut: an index image and the mean of each box."
    }

    fn params(&self) -> &'static [Param] {
        Settings::TABLE
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<EncodeSummary> {
        let Settings { clusters: count, split, space, dimensions, block } = Settings::from_values(params)?;
        let (meta, domain) = (source.meta(), block.domain);
        let rule = match split {
            Split::Balanced => Rule::Balanced,
            Split::LongestEdge => Rule::LongestEdge,
            Split::Population => Rule::Population,
            Split::Variance => Rule::Variance,
        };
        let views = meta.views.len() as u64;
        let partition = if space == Space::Pca {
            let (coordinates, dimensions) = quantised::coordinates(source, domain, dimensions, 1, progress)?;
            median_cut(&Columns::new(&coordinates, dimensions), count, rule)?
        } else {
            // at most two views for each level
            let levels = u64::from(usize::BITS - meta.texels().leading_zeros());
            let task = Task::new(progress, "cut", 2 * levels * views);
            median_cut(&Images { source, domain, task }, count, rule)?
        };
        let task = Task::new(progress, "compress", views);
        quantised::write(self, source, params, &block, path, &partition, &task)
    }

    fn dial(&self, meta: &BtfMeta, place: f64) -> Vec<(&'static str, String)> {
        vec![("clusters", crate::codec::count(place, meta.texels().min(crate::codec::form::quantised::MAX_CLUSTERS)))]
    }

    fn limits(&self, meta: &BtfMeta, params: &Values) -> Result<Vec<(&'static str, usize)>> {
        let space = Settings::from_values(params)?.space;
        let used = |name: &str| name != "dimensions" || space == Space::Pca;
        Ok(quantised::limits(meta).into_iter().filter(|(name, _)| used(name)).collect())
    }

    fn memory(&self, meta: &BtfMeta, params: &Values, threads: usize) -> Option<u64> {
        let Settings { clusters, space, dimensions, .. } = Settings::from_values(params).ok()?;
        Some(quantised::memory(meta, clusters, threads, (space == Space::Pca).then_some(dimensions), 0))
    }

    fn recipe(&self, _meta: &BtfMeta, params: &Values) -> Result<Recipe> {
        let Settings { clusters, block, .. } = Settings::from_values(params)?;
        Ok(quantised::recipe(clusters, 0, block.precision, Curve::Display))
    }
}

/// The texels of a source as points, with one page per pair.
struct Images<'a> {
    source: &'a dyn BtfSource,
    domain: Domain,
    task: Task<'a>,
}

impl Images<'_> {
    fn image(&self, page: usize) -> Result<Texels<'_>> {
        let lights = self.source.meta().lights.len();
        let image = self.source.image(page / lights, page % lights)?;
        let (found, expected) = (image.len(), self.source.meta().image_len());
        if found != expected {
            let (view, light) = (page / lights, page % lights);
            let problem = format!("image ({view}, {light}) has {found} numbers, expected {expected}");
            return Err(Error::parameter("source", problem));
        }
        Ok(image)
    }

    fn curve(&self, value: f32) -> f32 {
        self.domain.from_stored(self.source.meta().encoding, value)
    }

    fn is_stored(&self) -> bool {
        self.domain.is_stored(self.source.meta().encoding)
    }

    /// A value in the domain; 8-bit values that are their own domain remain integers, free of rounding.
    fn byte_curve(&self) -> [f32; 256] {
        let stored = self.is_stored();
        std::array::from_fn(|i| if stored { i as f32 } else { self.curve(i as f32 / 255.0) })
    }
}

impl Pages for Images<'_> {
    fn points(&self) -> usize {
        self.source.meta().texels()
    }

    fn pages(&self) -> usize {
        self.source.meta().pairs()
    }

    fn together(&self) -> usize {
        self.source.meta().lights.len()
    }

    fn measure(&self, page: usize, groups: &[&[u32]], measure: Measure) -> Result<Vec<(f32, usize)>> {
        let image = self.image(page)?;
        let largest =
            |sizes: [f32; 3]| (1..3).fold((sizes[0], 0), |b, c| if sizes[c] > b.0 { (sizes[c], c) } else { b });
        let generic = |number: &dyn Fn(usize) -> f32| {
            let channel = |points: &[u32], c| size(points.iter().map(|&p| number(3 * p as usize + c)), measure);
            groups.iter().map(|points| largest([0, 1, 2].map(|c| channel(points, c)))).collect()
        };
        Ok(match &image {
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
        })
    }

    fn values(&self, page: usize, dimension: usize, points: &[u32]) -> Result<Vec<f32>> {
        let image = self.image(page)?;
        let places = points.iter().map(|&p| 3 * p as usize + dimension);
        Ok(match &image {
            Texels::U8(values) => {
                let curve = self.byte_curve();
                places.map(|i| curve[usize::from(values[i])]).collect()
            }
            Texels::F16(values) => places.map(|i| self.curve(values[i].to_f32())).collect(),
            Texels::F32(values) => places.map(|i| self.curve(values[i])).collect(),
        })
    }

    fn done(&self, pages: Range<usize>) -> Result<()> {
        self.source.release(pages.start / self.together());
        self.task.advance(1)
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
