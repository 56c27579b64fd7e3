//! Strips and tiles: where they are, and how they are unpacked to samples.

use std::borrow::Cow;
use std::io::Read;

use half::f16;

use super::super::{Problem, Result, jpeg};
use super::{
    BITS, COMPRESSION, FILL_ORDER, JPEG_TABLES, PHOTOMETRIC, PLANAR, PREDICTOR, Page, ROWS_PER_STRIP, SAMPLE_FORMAT,
    SAMPLES, STRIP_BYTES, STRIP_OFFSETS, TILE_BYTES, TILE_HEIGHT, TILE_OFFSETS, TILE_WIDTH, YCBCR_SUBSAMPLING,
};

/// Greatest number of unpacked bytes per byte of a file.
const MAX_RATIO: usize = 1 << 14;

/// Greatest number of channels.
const MAX_CHANNELS: usize = 64;

/// How samples are stored.
pub(super) struct Layout {
    pub width: usize,
    pub height: usize,
    /// Channels of a pixel.
    pub channels: usize,
    pub bits: usize,
    pub is_float: bool,
    /// Sizes of the blocks of chroma samples of YCbCr pixels; 1 x 1 for others and for JPEG.
    pub subsampling: [usize; 2],
    /// Size of a strip or tile in pixels.
    chunk: [usize; 2],
    /// Whether each channel has chunks of its own.
    is_planar: bool,
    compression: Compression,
    predictor: u64,
    /// Whether bits of a byte begin with the least significant one.
    is_reversed: bool,
    offsets: Vec<f64>,
    lengths: Option<Vec<f64>>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
    Jpeg,
}

/// All samples of a picture: `[pixel][channel]`.
pub(super) enum Samples {
    /// Up to 8 bits, as stored.
    U8(Vec<u8>),
    /// 9 to 16 bits, as stored.
    U16(Vec<u16>),
    /// More bits as fractions of the largest number, or floating-point numbers.
    F32(Vec<f32>),
}

impl Compression {
    fn new(number: u64) -> Result<Self> {
        let name = match number {
            1 => return Ok(Self::None),
            5 => return Ok(Self::Lzw),
            8 | 32_946 => return Ok(Self::Deflate),
            32_773 => return Ok(Self::PackBits),
            50_000 => return Ok(Self::Zstd),
            7 => return Ok(Self::Jpeg),
            2..=4 | 32_771 => "CCITT fax",
            6 => "old-style JPEG",
            32_809 => "ThunderScan",
            34_676 | 34_677 => "LogLuv",
            33_003 | 33_005 | 34_712 => "JPEG 2000",
            34_887 => "LERC",
            34_925 => "LZMA",
            50_001 => "WebP",
            50_002 | 52_546 => "JPEG XL",
            _ => {
                return Err(Problem::Unsupported(format!(
                    "TIFF images of the unknown compression {number} are not supported"
                )));
            }
        };
        Err(Problem::Unsupported(format!("TIFF images compressed by {name} are not supported")))
    }
}

impl Layout {
    pub(super) fn new(page: &Page, width: usize, height: usize) -> Result<Self> {
        let unsupported = |what: String| Err(Problem::Unsupported(format!("TIFF images of {what} are not supported")));
        let channels = page.number(SAMPLES, 1) as usize;
        if !(1..=MAX_CHANNELS).contains(&channels) {
            return unsupported(format!("{channels} channels"));
        }
        let bits = page.same(BITS, 1, "number of bits")? as usize;
        let is_float = match page.same(SAMPLE_FORMAT, 1, "sample format")? {
            1 | 4 => false,
            2 => return unsupported("signed integers".into()),
            3 => true,
            5 | 6 => return unsupported("complex numbers".into()),
            other => return unsupported(format!("the unknown sample format {other}")),
        };
        if is_float && ![16, 24, 32, 64].contains(&bits) || !(1..=64).contains(&bits) {
            let kind = if is_float { "floating-point numbers" } else { "integers" };
            return unsupported(format!("{kind} of {bits} bits"));
        }
        let compression = Compression::new(page.number(COMPRESSION, 1))?;
        let is_planar = match page.number(PLANAR, 1) {
            1 => false,
            2 => channels > 1,
            other => return unsupported(format!("the unknown planar configuration {other}")),
        };
        let predictor = page.number(PREDICTOR, 1);
        let fits = match predictor {
            1 => true,
            2 => [8, 16, 32, 64].contains(&bits) && !is_float || is_float && [16, 32, 64].contains(&bits),
            3 => is_float,
            _ => false,
        };
        if !fits {
            return unsupported(format!("the predictor {predictor} with {bits} bits"));
        }
        let is_tiled = page.directory.has(TILE_OFFSETS);
        let chunk = if is_tiled {
            [page.number(TILE_WIDTH, 0), page.number(TILE_HEIGHT, 0)]
        } else {
            [width as u64, page.number(ROWS_PER_STRIP, u64::MAX).min(height as u64)]
        };
        let chunk = chunk.map(|side| side.min(1 << 20) as usize);
        if chunk.contains(&0) || chunk[0] * chunk[1] > super::super::super::MAX_PIXELS {
            return Err(Problem::Invalid(format!("found tiles of {} x {} pixels", chunk[0], chunk[1])));
        }
        let (offsets, lengths) = if is_tiled { (TILE_OFFSETS, TILE_BYTES) } else { (STRIP_OFFSETS, STRIP_BYTES) };
        let missing = || Problem::Invalid("the TIFF image does not say where its pixels are".into());
        let mut subsampling = [1, 1];
        if page.number(PHOTOMETRIC, 1) == 6 && compression != Compression::Jpeg {
            let stated = page.numbers(YCBCR_SUBSAMPLING).unwrap_or(vec![2.0, 2.0]);
            subsampling = match stated[..] {
                [x, y] if [1.0, 2.0, 4.0].contains(&x) && [1.0, 2.0, 4.0].contains(&y) => [x as usize, y as usize],
                _ => return unsupported(format!("the chroma subsampling {stated:?}")),
            };
            if subsampling != [1, 1] && (is_planar || bits != 8 || channels != 3 || predictor != 1) {
                return unsupported("subsampled colours other than of three channels of 8 bits in one plane".into());
            }
        }
        Ok(Self {
            width,
            height,
            channels,
            bits,
            is_float,
            subsampling,
            chunk,
            is_planar,
            compression,
            predictor,
            is_reversed: page.number(FILL_ORDER, 1) == 2 && compression != Compression::Jpeg,
            offsets: page.numbers(offsets).ok_or_else(missing)?,
            lengths: page.numbers(lengths),
        })
    }

    /// Whether chunks are JPEG streams.
    pub(super) fn is_jpeg(&self) -> bool {
        self.compression == Compression::Jpeg
    }

    /// Checks that the file can hold so many samples, before memory is allocated for them.
    fn check_content(&self, bytes: usize) -> Result<()> {
        let total = self.width * self.height * self.channels * self.bits.div_ceil(8);
        let chunk = self.row_bytes().saturating_mul(self.chunk[1]);
        if total > bytes.saturating_mul(MAX_RATIO) || chunk > total.saturating_mul(4).max(1 << 24) {
            let problem = format!("{total} bytes of pixels in chunks of {chunk} do not fit in {bytes} bytes");
            return Err(Problem::Invalid(problem));
        }
        Ok(())
    }

    /// Reads all samples.
    pub(super) fn read(&self, page: &Page) -> Result<Samples> {
        let mut samples = match () {
            () if self.is_float || self.bits > 16 => Samples::F32(Vec::new()),
            () if self.bits > 8 => Samples::U16(Vec::new()),
            () => Samples::U8(Vec::new()),
        };
        let across = self.width.div_ceil(self.chunk[0]);
        let down = self.height.div_ceil(self.chunk[1]);
        let planes = if self.is_planar { self.channels } else { 1 };
        if self.offsets.len() < across * down * planes {
            let problem = format!("found {} strips or tiles, expected {}", self.offsets.len(), across * down * planes);
            return Err(Problem::Invalid(problem));
        }
        self.check_content(page.bytes.len())?;
        for index in 0..across * down * planes {
            let (plane, tile) = (index / (across * down), index % (across * down));
            let corner = [tile % across * self.chunk[0], tile / across * self.chunk[1]];
            let problem = |problem: String| Problem::Invalid(format!("strip or tile {index}: {problem}"));
            let packed = self.packed(page, index).map_err(problem)?;
            let unpacked = self.unpack(page, packed, corner).map_err(|found| match found {
                Problem::Invalid(what) => problem(what),
                other => other,
            })?;
            // memory is allocated when the first chunk was read: a file must not demand it by its header alone
            samples.resize(self.width * self.height * self.channels);
            match &mut samples {
                Samples::U8(all) => self.place(&unpacked, corner, plane, all, |bits| bits as u8),
                Samples::U16(all) => self.place(&unpacked, corner, plane, all, |bits| bits as u16),
                Samples::F32(all) if self.is_float => {
                    self.place(&unpacked, corner, plane, all, |bits| self.float(bits))
                }
                Samples::F32(all) => {
                    let largest = if self.bits == 64 { u64::MAX } else { (1 << self.bits) - 1 } as f64;
                    self.place(&unpacked, corner, plane, all, |bits| (bits as f64 / largest) as f32);
                }
            }
        }
        Ok(samples)
    }

    /// The bytes of a strip or tile in the file.
    fn packed<'a>(&self, page: &Page<'a>, index: usize) -> std::result::Result<Cow<'a, [u8]>, String> {
        let start = self.offsets[index] as usize;
        let rest = page.bytes.get(start..).ok_or("it begins behind the end of the file")?;
        let length = match self.lengths.as_ref().and_then(|lengths| lengths.get(index)) {
            Some(length) => *length as usize,
            None => rest.len(),
        };
        let packed = rest.get(..length).ok_or("it extends beyond the end of the file")?;
        if self.is_reversed {
            return Ok(packed.iter().map(|byte| byte.reverse_bits()).collect());
        }
        Ok(Cow::Borrowed(packed))
    }

    /// Rows of a chunk at a corner of the picture; tiles are whole, the last strip may be shorter.
    fn rows(&self, [_, y]: [usize; 2]) -> usize {
        if self.chunk[0] == self.width { self.chunk[1].min(self.height - y) } else { self.chunk[1] }
    }

    /// Channels of a pixel in a chunk.
    fn chunk_channels(&self) -> usize {
        if self.is_planar { 1 } else { self.channels }
    }

    /// Bytes of a row of a chunk; of a row of blocks if colours are subsampled.
    fn row_bytes(&self) -> usize {
        let [x, y] = self.subsampling;
        if x * y > 1 {
            return self.chunk[0].div_ceil(x) * (x * y + 2);
        }
        (self.chunk[0] * self.chunk_channels() * self.bits).div_ceil(8)
    }

    /// The bytes of a chunk, unpacked, with the predictor undone.
    fn unpack<'a>(&self, page: &Page, packed: Cow<'a, [u8]>, corner: [usize; 2]) -> Result<Cow<'a, [u8]>> {
        let rows = self.rows(corner).div_ceil(self.subsampling[1]);
        let expected = self.row_bytes() * rows;
        let mut bytes: Cow<[u8]> = match self.compression {
            Compression::None => packed,
            Compression::Lzw => unpack_lzw(&packed, expected)?.into(),
            Compression::Deflate => read_all(flate2::read::ZlibDecoder::new(&packed[..]), expected)?.into(),
            Compression::Zstd => match zstd::stream::read::Decoder::new(&packed[..]) {
                Ok(decoder) => read_all(decoder, expected)?.into(),
                Err(e) => return Err(Problem::Invalid(e.to_string())),
            },
            Compression::PackBits => unpack_bits(&packed, expected).into(),
            Compression::Jpeg => return self.unpack_jpeg(page, &packed, rows).map(Cow::Owned),
        };
        if bytes.len() < expected {
            return Err(Problem::Invalid(format!("found {} bytes, expected {expected}", bytes.len())));
        }
        if self.predictor > 1 {
            let bytes = bytes.to_mut();
            bytes.truncate(expected);
            for row in bytes.chunks_exact_mut(self.row_bytes().max(1)) {
                if self.predictor == 2 {
                    self.add_differences(row, page.tags.is_big_endian())
                } else {
                    self.join_bytes(row)
                }
            }
        } else if self.bits > 8 && self.bits.is_multiple_of(8) && !page.tags.is_big_endian() {
            // samples of whole bytes are read most significant byte first
            bytes.to_mut().chunks_exact_mut(self.bits / 8).for_each(<[u8]>::reverse);
        }
        Ok(bytes)
    }

    fn unpack_jpeg(&self, page: &Page, packed: &[u8], rows: usize) -> Result<Vec<u8>> {
        if self.bits != 8 {
            return Err(Problem::Unsupported(format!("JPEG of {} bits in TIFF images is not supported", self.bits)));
        }
        let tables = page.tags.bytes_of(page.directory, JPEG_TABLES);
        let is_ycbcr = page.number(PHOTOMETRIC, 1) == 6;
        let (size, channels, bytes) = jpeg::decode_part(tables, packed, is_ycbcr)?;
        if channels != self.chunk_channels() || size[0] != self.chunk[0] || size[1] < rows {
            let problem = format!("found a JPEG image of {} x {} pixels and {channels} channels", size[0], size[1]);
            return Err(Problem::Invalid(problem));
        }
        Ok(bytes)
    }

    /// Undoes the predictor of differences; the result has its most significant bytes first.
    fn add_differences(&self, row: &mut [u8], is_big_endian: bool) {
        let size = self.bits / 8;
        if !is_big_endian {
            row.chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        let stride = size * self.chunk_channels();
        for at in (stride..row.len()).step_by(size) {
            // add numbers of any size, from the last byte
            let mut carry = 0;
            for k in (at..at + size).rev() {
                let sum = u16::from(row[k]) + u16::from(row[k - stride]) + carry;
                (row[k], carry) = (sum as u8, sum >> 8);
            }
        }
    }

    /// Undoes the predictor of floating-point numbers: bytes of equal significance stand together, as differences.
    fn join_bytes(&self, row: &mut [u8]) {
        let (size, stride) = (self.bits / 8, self.chunk_channels());
        for k in stride..row.len() {
            row[k] = row[k].wrapping_add(row[k - stride]);
        }
        let count = row.len() / size;
        let apart = row.to_vec();
        for (k, sample) in row.chunks_exact_mut(size).enumerate() {
            sample.iter_mut().enumerate().for_each(|(b, byte)| *byte = apart[b * count + k]);
        }
    }

    /// Puts the samples of a chunk in their places.
    fn place<T: Copy>(
        &self,
        bytes: &[u8],
        corner @ [left, top]: [usize; 2],
        plane: usize,
        all: &mut [T],
        convert: impl Fn(u64) -> T,
    ) {
        let (columns, rows) = (self.chunk[0].min(self.width - left), self.rows(corner).min(self.height - top));
        let channels = self.chunk_channels();
        for y in 0..rows {
            for x in 0..columns {
                for channel in 0..channels {
                    let bits = if self.subsampling == [1, 1] {
                        let row = &bytes[y * self.row_bytes()..];
                        bits_at(row, (x * channels + channel) * self.bits, self.bits)
                    } else {
                        u64::from(bytes[self.subsampled(x, y, channel)])
                    };
                    let pixel = (top + y) * self.width + left + x;
                    all[pixel * self.channels + plane + channel] = convert(bits);
                }
            }
        }
    }

    /// The place of a sample of YCbCr in blocks: all samples of luma, then Cb and Cr.
    fn subsampled(&self, x: usize, y: usize, channel: usize) -> usize {
        let [sx, sy] = self.subsampling;
        let block = y / sy * self.row_bytes() + x / sx * (sx * sy + 2);
        block + if channel == 0 { y % sy * sx + x % sx } else { sx * sy + channel - 1 }
    }

    /// A floating-point number of its bits.
    fn float(&self, bits: u64) -> f32 {
        match self.bits {
            16 => f16::from_bits(bits as u16).to_f32(),
            24 => float24(bits as u32),
            32 => f32::from_bits(bits as u32),
            _ => f64::from_bits(bits) as f32,
        }
    }
}

impl Samples {
    fn resize(&mut self, count: usize) {
        match self {
            Self::U8(all) => all.resize(count, 0),
            Self::U16(all) => all.resize(count, 0),
            Self::F32(all) => all.resize(count, 0.0),
        }
    }
}

/// The number in `count` bits from a bit on, most significant first.
#[inline]
fn bits_at(bytes: &[u8], at: usize, count: usize) -> u64 {
    if count == 8 {
        return bytes[at / 8].into();
    }
    if count.is_multiple_of(8) {
        let join = |sum: u64, &byte: &u8| sum << 8 | u64::from(byte);
        return bytes[at / 8..(at + count) / 8].iter().fold(0, join);
    }
    (at..at + count).fold(0, |sum, bit| sum << 1 | u64::from(bytes[bit / 8] >> (7 - bit % 8) & 1))
}

/// One bit of sign, seven of the exponent, sixteen of the fraction.
fn float24(bits: u32) -> f32 {
    let (sign, exponent, fraction) = (bits >> 23, bits >> 16 & 0x7f, bits & 0xffff);
    let magnitude = match exponent {
        0 => fraction as f32 * (-78.0f32).exp2(),
        0x7f if fraction == 0 => f32::INFINITY,
        0x7f => f32::NAN,
        _ => f32::from_bits((exponent + 64) << 23 | fraction << 7),
    };
    if sign == 1 { -magnitude } else { magnitude }
}

fn read_all(decoder: impl Read, expected: usize) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    decoder.take(expected as u64).read_to_end(&mut bytes).map_err(|e| Problem::Invalid(e.to_string()))?;
    Ok(bytes)
}

fn unpack_lzw(packed: &[u8], expected: usize) -> Result<Vec<u8>> {
    let mut decoder = weezl::decode::Decoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8);
    let (mut bytes, mut filled, mut rest) = (vec![0; expected], 0, packed);
    while filled < expected {
        let result = decoder.decode_bytes(rest, &mut bytes[filled..]);
        filled += result.consumed_out;
        rest = &rest[result.consumed_in..];
        match result.status {
            Ok(weezl::LzwStatus::Ok) if result.consumed_in + result.consumed_out > 0 => {}
            Ok(_) => break,
            Err(e) => return Err(Problem::Invalid(format!("LZW: {e}"))),
        }
    }
    bytes.truncate(filled);
    Ok(bytes)
}

fn unpack_bits(packed: &[u8], expected: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = packed;
    while let [count, others @ ..] = rest
        && bytes.len() < expected
    {
        rest = match *count as i8 {
            -128 => others,
            count @ 0.. => {
                let (own, others) = others.split_at((count as usize + 1).min(others.len()));
                bytes.extend_from_slice(own);
                others
            }
            count => {
                let Some((&byte, others)) = others.split_first() else { break };
                bytes.resize(bytes.len() + 1 + usize::from(count.unsigned_abs()), byte);
                others
            }
        };
    }
    bytes
}
