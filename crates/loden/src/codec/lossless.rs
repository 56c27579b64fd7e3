//! Lossless stages: general-purpose compressors applied to the numbers of a file.
//!
//! # Model
//! Each tensor is packed separately, as it is and shuffled. A shuffle stores the lowest bytes of all numbers first,
//! then the next ones, so that signs and exponents, which change little, are adjacent.
//!
//! # References
//! welch1984, deutsch1996

use std::io::{Read, Write};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;
use serde::Serialize;
use weezl::BitOrder;
use weezl::decode::Decoder;
use weezl::encode::Encoder;

use super::CompressedBtf;
use super::container::Container;
use crate::input::guarded;
use crate::{Error, Result};

/// A general-purpose compressor.
#[derive(Debug)]
pub struct Stage {
    /// Name of the stage.
    pub name: &'static str,
    /// Compresses; `None` on failure.
    compress: fn(&[u8]) -> Option<Vec<u8>>,
    /// Decompresses into a slice; `None` if it is not filled exactly.
    decompress: fn(&[u8], &mut [u8]) -> Option<()>,
}

/// The stages: LZW as in TIFF files, Deflate as in PNG files, and Zstandard.
pub const STAGES: &[Stage] = &[
    Stage { name: "lzw", compress: lzw, decompress: un_lzw },
    Stage { name: "deflate", compress: deflate, decompress: inflate },
    Stage { name: "zstd", compress: zstd, decompress: un_zstd },
];

/// The stage of this name.
///
/// # Errors
/// [`Error::Parameter`] listing the known names.
pub fn by_name(name: &str) -> Result<&'static Stage> {
    let names = || STAGES.iter().map(|stage| stage.name).collect::<Vec<_>>().join(", ");
    let found = STAGES.iter().find(|stage| stage.name == name);
    found.ok_or_else(|| Error::parameter("lossless", format!("found {name:?}, expected one of {}", names())))
}

impl Stage {
    /// Packs numbers of `size` bytes each after a shuffle; `None` on failure.
    pub(super) fn pack(&self, bytes: &[u8], size: usize) -> Option<Vec<u8>> {
        (self.compress)(&shuffle(bytes, size))
    }

    /// Unpacks into `out`; `None` if it is not filled exactly.
    pub(super) fn unpack(&self, packed: &[u8], size: usize, out: &mut [u8]) -> Option<()> {
        let decompress = |out: &mut [u8]| guarded(self.name, || (self.decompress)(packed, out)).ok()?;
        if size == 1 {
            return decompress(out);
        }
        let mut shuffled = vec![0; out.len()];
        decompress(&mut shuffled)?;
        let count = out.len() / size;
        for (k, bytes) in shuffled.chunks_exact(count.max(1)).enumerate() {
            out[k..].iter_mut().step_by(size).zip(bytes).for_each(|(out, &byte)| *out = byte);
        }
        Some(())
    }
}

fn lzw(bytes: &[u8]) -> Option<Vec<u8>> {
    Encoder::with_tiff_size_switch(BitOrder::Msb, 8).encode(bytes).ok()
}

fn un_lzw(mut packed: &[u8], mut out: &mut [u8]) -> Option<()> {
    let mut decoder = Decoder::with_tiff_size_switch(BitOrder::Msb, 8);
    while !out.is_empty() {
        let done = decoder.decode_bytes(packed, out);
        done.status.ok()?;
        if done.consumed_out == 0 && done.consumed_in == 0 {
            return None;
        }
        packed = &packed[done.consumed_in..];
        out = &mut out[done.consumed_out..];
    }
    Some(())
}

fn deflate(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).ok()?;
    encoder.finish().ok()
}

fn inflate(packed: &[u8], out: &mut [u8]) -> Option<()> {
    ZlibDecoder::new(packed).read_exact(out).ok()
}

fn zstd(bytes: &[u8]) -> Option<Vec<u8>> {
    zstd::bulk::compress(bytes, 19).ok()
}

fn un_zstd(packed: &[u8], out: &mut [u8]) -> Option<()> {
    (zstd::bulk::decompress_to_buffer(packed, out).ok()? == out.len()).then_some(())
}

/// Size of a file after a lossless stage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rate {
    /// The name of the stage.
    pub stage: &'static str,
    /// Bytes of the tensors, packed as they are.
    pub plain: u64,
    /// Bytes of the tensors, packed after the shuffle.
    pub shuffled: u64,
}

/// Packs the tensors of the open file `btf` by every stage.
///
/// # Errors
/// [`Error::Invalid`] or [`Error::Io`] if the file cannot be read again or a stage fails.
pub fn rates(btf: &CompressedBtf) -> Result<Vec<Rate>> {
    let container = Container::open(btf.path())?;
    let rate = |stage: &Stage| {
        let sum = |shuffled: bool| -> Option<u64> {
            let packed = container.stored().into_iter().map(|(_, dtype, _, bytes)| match shuffled {
                true => stage.pack(bytes, dtype.bitsize() / 8),
                false => (stage.compress)(bytes),
            });
            packed.map(|packed| Some(packed?.len() as u64)).sum()
        };
        let failed = || Error::invalid(btf.path(), "tensors", format!("{} fails", stage.name));
        Ok(Rate { stage: stage.name, plain: sum(false).ok_or_else(failed)?, shuffled: sum(true).ok_or_else(failed)? })
    };
    STAGES.par_iter().map(rate).collect()
}

/// The first bytes of all numbers of `size` bytes, then all second bytes, and so on.
fn shuffle(bytes: &[u8], size: usize) -> Vec<u8> {
    (0..size).flat_map(|k| bytes.iter().skip(k).step_by(size).copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_lose_nothing_and_the_shuffle_pays() {
        let numbers: Vec<f32> = (0..5000).map(|i| 1.5 + (i as f32 * 0.01).sin() * 0.3).collect();
        let bytes: &[u8] = bytemuck::cast_slice(&numbers);
        let shuffled = shuffle(bytes, 4);
        assert_eq!((shuffled[1], shuffled[3 * 5000]), (bytes[4], bytes[3]));
        for stage in STAGES {
            let packed = [1, 4].map(|size| {
                let packed = stage.pack(bytes, size).unwrap();
                let mut out = vec![0; bytes.len()];
                stage.unpack(&packed, size, &mut out).unwrap();
                assert!(out == bytes, "{}", stage.name);
                // truncated input, and an output longer than the content
                assert_eq!(stage.unpack(&packed[..packed.len() / 2], size, &mut out), None);
                assert_eq!(stage.unpack(&packed, size, &mut vec![0; bytes.len() + 4]), None);
                packed.len()
            });
            assert!(packed[1] < packed[0], "{}: {packed:?}", stage.name);
        }
    }
}
