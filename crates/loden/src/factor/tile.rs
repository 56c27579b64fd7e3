//! Tiles: the same texels of many images as rows of equal length, one row per image and channel.

use super::simd::wide;

/// Bytes of a tile: half of a common second-level cache.
const BYTES: usize = 256 << 10;

/// A cache line, so that rows begin at one.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Line([u8; 64]);

// SAFETY: any bytes are a value, there is no padding (64 bytes of alignment 64).
unsafe impl bytemuck::Zeroable for Line {}
// SAFETY: as above.
unsafe impl bytemuck::Pod for Line {}

/// Rows of texels in cache-aligned memory; one spare row and rows up to a multiple of four follow the used ones.
#[derive(Debug, Clone)]
pub struct Tile<T> {
    lines: Vec<Line>,
    rows: usize,
    stride: usize,
    kind: std::marker::PhantomData<T>,
}

impl<T: bytemuck::Pod> Tile<T> {
    /// A tile of `rows` rows, as long as a cache allows, of zeros.
    pub fn new(rows: usize) -> Self {
        let rows_padded = (rows + 1).next_multiple_of(4);
        let per_line = 64 / size_of::<T>();
        let lines = (BYTES / (64 * rows_padded)).clamp(1, 16);
        let stride = lines * per_line;
        Self { lines: vec![Line([0; 64]); rows_padded * lines], rows, stride, kind: std::marker::PhantomData }
    }

    /// How many rows are used.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Rows with padding: more than [`Tile::rows`], a multiple of 4.
    pub fn rows_padded(&self) -> usize {
        (self.rows + 1).next_multiple_of(4)
    }

    /// Numbers in a row, a multiple of 16.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// All rows with padding.
    pub fn data(&self) -> &[T] {
        bytemuck::cast_slice(&self.lines)
    }

    /// All rows with padding.
    pub fn data_mut(&mut self) -> &mut [T] {
        bytemuck::cast_slice_mut(&mut self.lines)
    }

    /// The rows of the three channels of image `i`.
    pub fn rgb_mut(&mut self, i: usize) -> [&mut [T]; 3] {
        let stride = self.stride;
        let (r, rest) = self.data_mut()[3 * i * stride..3 * (i + 1) * stride].split_at_mut(stride);
        let (g, b) = rest.split_at_mut(stride);
        [r, g, b]
    }
}

impl Tile<i16> {
    /// Loads `count` texels from `first` of each of the 8-bit RGB `images`, less 128; zeros behind them.
    pub fn load(&mut self, images: &[u8], image_len: usize, first: usize, count: usize) {
        for (i, image) in images.chunks_exact(image_len).enumerate() {
            let [r, g, b] = self.rgb_mut(i);
            split_rgb(&image[3 * first..3 * (first + count)], r, g, b);
            for row in [r, g, b] {
                row[count..].fill(0);
            }
        }
    }
}

/// Splits interleaved RGB bytes into signed channels, less 128.
fn split_rgb(rgb: &[u8], r: &mut [i16], g: &mut [i16], b: &mut [i16]) {
    #[cfg(target_arch = "x86_64")]
    if super::simd::has_avx2() {
        // SAFETY: the processor has AVX2.
        return unsafe { split_rgb_avx2(rgb, r, g, b) };
    }
    split_rgb_portable(rgb, r, g, b);
}

fn split_rgb_portable(rgb: &[u8], r: &mut [i16], g: &mut [i16], b: &mut [i16]) {
    for (((texel, r), g), b) in rgb.chunks_exact(3).zip(r).zip(g).zip(b) {
        *r = i16::from(texel[0]) - 128;
        *g = i16::from(texel[1]) - 128;
        *b = i16::from(texel[2]) - 128;
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn split_rgb_avx2(rgb: &[u8], r: &mut [i16], g: &mut [i16], b: &mut [i16]) {
    use std::arch::x86_64::*;
    /// For channel c and source vector s: which of its 16 bytes go where; -1 gives zero.
    const SHUFFLES: [[[i8; 16]; 3]; 3] = {
        let mut all = [[[-1i8; 16]; 3]; 3];
        let mut c = 0;
        while c < 3 {
            let mut texel = 0;
            while texel < 16 {
                let byte = 3 * texel + c;
                all[c][byte / 16][texel] = (byte % 16) as i8;
                texel += 1;
            }
            c += 1;
        }
        all
    };
    let blocks = rgb.len() / 48;
    let channels = [&mut *r, &mut *g, &mut *b];
    assert!(channels.iter().all(|c| c.len() >= 16 * blocks));
    for block in 0..blocks {
        // SAFETY: 48 bytes from 48 * block lie in rgb, 16 numbers from 16 * block in each channel.
        unsafe {
            let source = rgb.as_ptr().add(48 * block);
            let vectors = [0, 16, 32].map(|o| _mm_loadu_si128(source.add(o).cast()));
            for (channel, shuffles) in channels.iter().zip(&SHUFFLES) {
                let part = |s: usize| _mm_shuffle_epi8(vectors[s], _mm_loadu_si128(shuffles[s].as_ptr().cast()));
                let bytes = _mm_or_si128(_mm_or_si128(part(0), part(1)), part(2));
                let signed = _mm_xor_si128(bytes, _mm_set1_epi8(-128));
                _mm256_storeu_si256(channel.as_ptr().cast_mut().add(16 * block).cast(), _mm256_cvtepi8_epi16(signed));
            }
        }
    }
    let done = 16 * blocks;
    split_rgb_portable(&rgb[3 * done..], &mut r[done..], &mut g[done..], &mut b[done..]);
}

wide! {
    /// Subtracts its mean from each used row's first `count` numbers.
    pub fn centre(data: &mut [f32], stride: usize, count: usize, mean: &[f64]) {
        for (row, &mean) in data.chunks_exact_mut(stride).zip(mean) {
            row[..count].iter_mut().for_each(|v| *v = (f64::from(*v) - mean) as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::simd::portable;

    #[test]
    fn loading_splits_channels_the_same_way_on_any_processor() {
        let (texels, images) = (150, 2);
        let data: Vec<u8> = (0..3 * texels * images).map(|i| (i * 37 % 251) as u8).collect();
        let load = || {
            let mut tile = Tile::<i16>::new(3 * images);
            tile.load(&data, 3 * texels, 20, 75);
            tile
        };
        let tile = load();
        for (row, values) in tile.data().chunks(tile.stride()).take(6).enumerate() {
            for (t, &value) in values.iter().enumerate() {
                let expected = data[row / 3 * 3 * texels + (20 + t).min(texels - 1) * 3 + row % 3];
                assert_eq!(value, if t < 75 { i16::from(expected) - 128 } else { 0 });
            }
        }
        assert_eq!(portable(load).data(), tile.data());
        assert_eq!(tile.data().as_ptr().align_offset(64), 0);
    }
}
