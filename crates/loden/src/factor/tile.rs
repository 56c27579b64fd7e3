//! Tiles: the same texels of many images, one row per image and channel, sized for a second-level cache.

use crate::simd::{prefetch, wide};

/// Bytes of a tile: half of a common second-level cache.
const BYTES: usize = 256 << 10;

/// Texels per block; 32 bytes of a row of a [`ByteTile`].
pub const STEP: usize = 16;

/// Rows of a [`ByteTile`] that are stored together.
pub const GROUP: usize = 6;

/// A tile that is read row by row, in blocks of [`STEP`] texels.
pub trait Tile {
    /// Rows in use: one per image and channel.
    fn rows(&self) -> usize;

    /// Capacity in texels, a multiple of [`STEP`].
    fn texels(&self) -> usize;

    /// The block of a row that starts at texel `STEP * step`.
    fn block(&self, row: usize, step: usize) -> [f32; STEP];
}

/// Texels that fit the cache, at most 512, for `rows` rows of numbers of `size` bytes.
fn texels(rows: usize, size: usize) -> usize {
    (BYTES / (rows * size) / 32 * 32).clamp(32, 512)
}

/// 16 numbers, aligned as a vector.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
struct Vector([i16; STEP]);

/// 8-bit values minus 128, in groups of six rows: (group, step, row of the group, texel of the step), so that kernels
/// read consecutive addresses. A spare row of ones follows the rows in use, then rows of zeros up to a whole group.
#[derive(Debug, Clone)]
pub struct ByteTile {
    vectors: Vec<Vector>,
    rows: usize,
    steps: usize,
}

impl ByteTile {
    /// A tile of `rows` rows of zeros and a spare row of ones.
    pub fn new(rows: usize) -> Self {
        let groups = (rows + 1).div_ceil(GROUP);
        let steps = texels(groups * GROUP, size_of::<i16>()) / STEP;
        let mut tile = Self { vectors: vec![Vector([0; STEP]); groups * GROUP * steps], rows, steps };
        for step in 0..steps {
            let place = tile.place(rows, step);
            tile.vectors[place].0.fill(1);
        }
        tile
    }

    /// Rows including spare ones, a multiple of [`GROUP`].
    pub fn rows_padded(&self) -> usize {
        (self.rows + 1).next_multiple_of(GROUP)
    }

    /// A tile of zeros with `rows` rows, a multiple of [`GROUP`], and the texels of this one.
    pub fn beside(&self, rows: usize) -> Self {
        assert!(rows.is_multiple_of(GROUP), "whole groups of rows");
        Self { vectors: vec![Vector([0; STEP]); rows * self.steps], rows, steps: self.steps }
    }

    /// The block of a row that starts at texel `STEP * step`, to be written.
    pub fn integers_mut(&mut self, row: usize, step: usize) -> &mut [i16; STEP] {
        let place = self.place(row, step);
        &mut self.vectors[place].0
    }

    #[inline(always)]
    fn place(&self, row: usize, step: usize) -> usize {
        (row / GROUP * self.steps + step) * GROUP + row % GROUP
    }

    /// The block of a row that starts at texel `STEP * step`: values minus 128.
    pub fn integers(&self, row: usize, step: usize) -> &[i16; STEP] {
        &self.vectors[self.place(row, step)].0
    }

    /// Adds the sum over all texels of each row in use.
    pub fn add_sums(&self, sums: &mut [i64]) {
        let mut part = vec![0; self.rows];
        add_sums(self, &mut part);
        sums.iter_mut().zip(part).for_each(|(sum, part)| *sum += i64::from(part));
    }

    /// All numbers, aligned to 32 bytes.
    pub fn data(&self) -> &[i16] {
        // SAFETY: a Vector is 16 numbers without padding.
        unsafe { std::slice::from_raw_parts(self.vectors.as_ptr().cast(), self.vectors.len() * STEP) }
    }

    /// Loads `count` texels from `first` of each of the RGB `images`, which have `image_len` bytes each. The rest of
    /// the tile becomes zero.
    pub fn load(&mut self, images: &[u8], image_len: usize, first: usize, count: usize) {
        for image in 0..images.len() / image_len {
            let texels = segment(images, image_len, image, first, count);
            // a group of six rows holds the three channels of two images
            let start = self.place(3 * image, 0);
            let rgb = self.vectors[start..].chunks_mut(GROUP).map(|v| &mut v[..3]);
            split_rgb(texels, rgb.take(self.steps));
        }
    }
}

wide! {
    fn add_sums(tile: &ByteTile, sums: &mut [i32]) {
        for group in 0..tile.rows.div_ceil(GROUP) {
            let first = group * GROUP;
            let mut lanes = [[0i16; STEP]; GROUP];
            // 128 times 512 texels in 16 lanes fits in 16 bits
            for vectors in tile.vectors[first * tile.steps..][..GROUP * tile.steps].chunks_exact(GROUP) {
                for (lanes, vector) in lanes.iter_mut().zip(vectors) {
                    for (sum, value) in lanes.iter_mut().zip(&vector.0) {
                        *sum += value;
                    }
                }
            }
            for (sum, lanes) in sums[first..].iter_mut().zip(&lanes) {
                *sum += lanes.iter().map(|&v| i32::from(v)).sum::<i32>();
            }
        }
    }
}

/// The bytes of `count` texels from `first` of an image. Prefetches the same texels of the next image.
fn segment(images: &[u8], image_len: usize, image: usize, first: usize, count: usize) -> &[u8] {
    let begin = image * image_len + 3 * first;
    for line in (0..3 * count).step_by(64) {
        prefetch(images, begin + image_len + line);
    }
    &images[begin..begin + 3 * count]
}

/// Texels of one image at a time, used while they are in the first-level cache.
#[derive(Debug, Clone)]
pub struct ImageStrip {
    vectors: Vec<Vector>,
}

impl ImageStrip {
    /// A strip for `steps` times [`STEP`] texels.
    pub fn new(steps: usize) -> Self {
        Self { vectors: vec![Vector([0; STEP]); 3 * steps] }
    }

    /// Capacity in texels.
    pub fn texels(&self) -> usize {
        self.vectors.len() / 3 * STEP
    }

    /// Loads `count` texels from `first` of an image, minus 128, and returns them as (step, channel, texel of the
    /// step).
    pub fn load(
        &mut self,
        images: &[u8],
        image_len: usize,
        image: usize,
        first: usize,
        count: usize,
    ) -> impl Iterator<Item = [&[i16; STEP]; 3]> {
        split_rgb(segment(images, image_len, image, first, count), self.vectors.chunks_exact_mut(3));
        self.vectors.chunks_exact(3).map(|v| [&v[0].0, &v[1].0, &v[2].0])
    }
}

impl Tile for ByteTile {
    fn rows(&self) -> usize {
        self.rows
    }

    fn texels(&self) -> usize {
        self.steps * STEP
    }

    #[inline(always)]
    fn block(&self, row: usize, step: usize) -> [f32; STEP] {
        self.integers(row, step).map(f32::from)
    }
}

/// Splits interleaved RGB bytes into channels, minus 128: three vectors per step, zero after the last texel.
fn split_rgb<'a>(rgb: &[u8], out: impl Iterator<Item = &'a mut [Vector]>) {
    #[cfg(target_arch = "x86_64")]
    if crate::simd::has_avx2() {
        // SAFETY: the processor has AVX2.
        return unsafe { split_rgb_avx2(rgb, out) };
    }
    for (step, out) in out.enumerate() {
        split_step(rgb, step, out);
    }
}

fn split_step(rgb: &[u8], step: usize, out: &mut [Vector]) {
    let texels = rgb.get(3 * STEP * step..).unwrap_or(&[]);
    for (channel, out) in out.iter_mut().enumerate() {
        out.0.fill(0);
        for (out, texel) in out.0.iter_mut().zip(texels.chunks_exact(3)) {
            *out = i16::from(texel[channel]) - 128;
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn split_rgb_avx2<'a>(rgb: &[u8], out: impl Iterator<Item = &'a mut [Vector]>) {
    use std::arch::x86_64::*;
    for (step, out) in out.enumerate() {
        let Some((source, _)) = rgb.get(3 * STEP * step..).and_then(|rgb| rgb.split_first_chunk()) else {
            split_step(rgb, step, out);
            continue;
        };
        for (out, bytes) in out.iter_mut().zip(channels(source)) {
            let signed = _mm_xor_si128(bytes, _mm_set1_epi8(-128));
            // SAFETY: a Vector is 32 aligned bytes.
            unsafe { _mm256_store_si256(out.0.as_mut_ptr().cast(), _mm256_cvtepi8_epi16(signed)) };
        }
    }
}

/// The bytes of each channel of 16 texels.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
fn channels(rgb: &[u8; 3 * STEP]) -> [std::arch::x86_64::__m128i; 3] {
    use std::arch::x86_64::*;
    /// For channel c and source vector s: the source byte of each result byte; -1 gives zero.
    const SHUFFLES: [[[i8; 16]; 3]; 3] = {
        let mut all = [[[-1i8; 16]; 3]; 3];
        let mut byte = 0;
        while byte < 48 {
            all[byte % 3][byte / 16][byte / 3] = (byte % 16) as i8;
            byte += 1;
        }
        all
    };
    // SAFETY: the 48 bytes hold three vectors of 16 bytes.
    let parts = [0, 16, 32].map(|o| unsafe { _mm_loadu_si128(rgb.as_ptr().add(o).cast()) });
    std::array::from_fn(|c| {
        // SAFETY: a shuffle is 16 bytes.
        let part = |s: usize| unsafe { _mm_shuffle_epi8(parts[s], _mm_loadu_si128(SHUFFLES[c][s].as_ptr().cast())) };
        _mm_or_si128(_mm_or_si128(part(0), part(1)), part(2))
    })
}

/// Splits interleaved RGB bytes into a row per channel, scaled so that 255 is 1, minus a number per channel.
fn split_rgb_fractions(rgb: &[u8], rows: [&mut [f32]; 3], less: [f32; 3]) {
    #[cfg(target_arch = "x86_64")]
    let done = if crate::simd::has_avx2() && is_x86_feature_detected!("fma") {
        let [r, g, b] = rows;
        // SAFETY: the processor has AVX2 and FMA.
        let done = unsafe { split_rgb_fractions_fma(rgb, [&mut *r, &mut *g, &mut *b], less) };
        return split_rgb_fractions_from(done, rgb, [r, g, b], less);
    } else {
        0
    };
    #[cfg(not(target_arch = "x86_64"))]
    let done = 0;
    split_rgb_fractions_from(done, rgb, rows, less);
}

fn split_rgb_fractions_from(first: usize, rgb: &[u8], rows: [&mut [f32]; 3], less: [f32; 3]) {
    for (channel, row) in rows.into_iter().enumerate() {
        for (out, texel) in row[first..].iter_mut().zip(rgb[3 * first..].chunks_exact(3)) {
            *out = f32::from(texel[channel]) / 255.0 - less[channel];
        }
    }
}

/// Splits as many texels as fill whole vectors; returns how many.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn split_rgb_fractions_fma(rgb: &[u8], mut rows: [&mut [f32]; 3], less: [f32; 3]) -> usize {
    use std::arch::x86_64::*;
    // 1/255 in two parts, so that products with bytes are rounded like quotients
    const HIGH: f32 = 1.0 / 255.0;
    const LOW: f32 = (1.0 / 255.0 - HIGH as f64) as f32;
    let steps = rgb.len() / (3 * STEP);
    let (high, low) = (_mm256_set1_ps(HIGH), _mm256_set1_ps(LOW));
    for (step, source) in rgb.as_chunks::<{ 3 * STEP }>().0.iter().enumerate() {
        for ((row, bytes), less) in rows.iter_mut().zip(channels(source)).zip(less) {
            let out: &mut [f32; STEP] = (&mut row[step * STEP..(step + 1) * STEP]).try_into().expect("a step");
            for (half, bytes) in [bytes, _mm_srli_si128::<8>(bytes)].into_iter().enumerate() {
                let value = _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes));
                let fraction = _mm256_fmadd_ps(value, high, _mm256_mul_ps(value, low));
                let number = _mm256_sub_ps(fraction, _mm256_set1_ps(less));
                // SAFETY: eight of the sixteen numbers, from 8 * half.
                unsafe { _mm256_storeu_ps(out.as_mut_ptr().add(8 * half), number) };
            }
        }
    }
    steps * STEP
}

/// Single-precision values, row by row.
#[derive(Debug, Clone)]
pub struct FloatTile {
    data: Vec<f32>,
    rows: usize,
    texels: usize,
}

impl FloatTile {
    /// A tile of `rows` rows of zeros.
    pub fn new(rows: usize) -> Self {
        let texels = Self::size(rows);
        Self { data: vec![0.0; rows * texels], rows, texels }
    }

    /// Texels of a tile of `rows` rows.
    pub fn size(rows: usize) -> usize {
        // use an odd number of steps: rows at multiples of a power of two would share few sets of a first-level cache
        ((texels(rows, size_of::<f32>()) / STEP) | 1) * STEP
    }

    /// All rows, one after the other.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// A tile of `rows` rows for [`STEP`] texels.
    pub fn narrow(rows: usize) -> Self {
        Self { data: vec![0.0; rows * STEP], rows, texels: STEP }
    }

    /// Loads `count` texels from `first` of each of the RGB `images`, which have `image_len` bytes each, scaled so
    /// that 255 is 1, minus the mean of each row in single precision as far as `mean` goes. The rest of the tile
    /// becomes zero.
    pub fn load(&mut self, images: &[u8], image_len: usize, first: usize, count: usize, mean: &[f64]) {
        for image in 0..images.len() / image_len {
            let texels = segment(images, image_len, image, first, count);
            let mut rows = self.rgb_mut(image);
            rows.iter_mut().for_each(|row| row[count..].fill(0.0));
            let less = [0, 1, 2].map(|channel| mean.get(3 * image + channel).map_or(0.0, |&mean| mean as f32));
            split_rgb_fractions(texels, rows.map(|row| &mut row[..count]), less);
        }
    }

    /// The three rows of image `i`.
    pub fn rgb_mut(&mut self, i: usize) -> [&mut [f32]; 3] {
        let n = self.texels;
        let (r, rest) = self.data[3 * i * n..3 * (i + 1) * n].split_at_mut(n);
        let (g, b) = rest.split_at_mut(n);
        [r, g, b]
    }

    /// Copies the texels of a step from a tile with the same rows and a single step; fills in zeros without one.
    pub fn set_step(&mut self, step: usize, from: Option<&Self>) {
        for (i, row) in self.data.chunks_exact_mut(self.texels).enumerate() {
            let out = &mut row[step * STEP..(step + 1) * STEP];
            match from {
                Some(from) => out.copy_from_slice(&from.data[i * STEP..(i + 1) * STEP]),
                None => out.fill(0.0),
            }
        }
    }

    /// Subtracts a mean from the first `count` numbers of each row, as far as `mean` goes.
    pub fn centre(&mut self, count: usize, mean: &[f64]) {
        centre(&mut self.data, self.texels, count, mean);
    }
}

impl Tile for FloatTile {
    fn rows(&self) -> usize {
        self.rows
    }

    fn texels(&self) -> usize {
        self.texels
    }

    #[inline(always)]
    fn block(&self, row: usize, step: usize) -> [f32; STEP] {
        let first = row * self.texels + step * STEP;
        std::array::from_fn(|i| self.data[first..first + STEP][i])
    }
}

wide! {
    fn centre(data: &mut [f32], texels: usize, count: usize, mean: &[f64]) {
        for (row, &mean) in data.chunks_exact_mut(texels).zip(mean) {
            row[..count].iter_mut().for_each(|v| *v = (f64::from(*v) - mean) as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::portable;

    #[test]
    fn loading_splits_channels_the_same_way_on_any_processor() {
        let (texels, images) = (150, 3);
        let data: Vec<u8> = (0..3 * texels * images).map(|i| (i * 37 % 251) as u8).collect();
        let load = || {
            let mut tile = ByteTile::new(3 * images);
            tile.load(&data, 3 * texels, 0, 150);
            tile.load(&data, 3 * texels, 20, 75);
            tile
        };
        let tile = load();
        for row in 0..tile.rows_padded() {
            for t in 0..tile.texels() {
                let expected = match row {
                    9 => 1,
                    _ if row > 9 || t >= 75 => 0,
                    _ => i16::from(data[row / 3 * 3 * texels + (20 + t) * 3 + row % 3]) - 128,
                };
                assert_eq!(tile.integers(row, t / STEP)[t % STEP], expected, "{row} {t}");
            }
        }
        assert_eq!(portable(load).data(), tile.data());
        assert_eq!(tile.data().as_ptr().align_offset(32), 0);
    }

    #[test]
    fn fractions_are_those_of_a_division_on_any_processor() {
        // every byte in every channel, and a remainder that does not fill a vector
        let data: Vec<u8> = (0..3 * 300).map(|i| (i % 256) as u8).collect();
        let less = [0.0f32, 0.25, 0.3];
        let load = || {
            let mut tile = FloatTile::new(3);
            tile.load(&data, data.len(), 0, 300, &less.map(f64::from));
            tile
        };
        let (tile, plain) = (load(), portable(load));
        for (row, less) in less.iter().enumerate() {
            for t in 0..tile.texels() {
                let expected = data.get(3 * t + row).map_or(0.0, |&v| f32::from(v) / 255.0 - less);
                assert_eq!(tile.data()[row * tile.texels() + t], expected, "{row} {t}");
            }
        }
        assert_eq!(tile.data(), plain.data());
    }
}
