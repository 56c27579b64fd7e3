//! Lossless stages: what general compressors make of the numbers in a file.
//!
//! # Model
//! Each tensor is packed on its own, as it is and shuffled: first the lowest bytes of all numbers, then the next ones, so
//! that signs and exponents, which change little, stand beside each other.
//!
//! # Limits
//! Rates only: files are not stored packed, since images and texels are read from the middle of them.
//!
//! # References
//! welch1984, deutsch1996

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;
use serde::Serialize;
use weezl::BitOrder;

use super::CompressedBtf;
use super::container::Container;
use crate::{Error, Result};

/// Packs bytes; `None` if it fails.
type Pack = fn(&[u8]) -> Option<Vec<u8>>;

/// The stages by name: that of TIFF files, that of PNG files, and a later one.
pub const STAGES: &[(&str, Pack)] = &[("lzw", lzw), ("deflate", deflate), ("zstd", zstd)];

fn lzw(bytes: &[u8]) -> Option<Vec<u8>> {
    weezl::encode::Encoder::with_tiff_size_switch(BitOrder::Msb, 8).encode(bytes).ok()
}

fn deflate(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).ok()?;
    encoder.finish().ok()
}

fn zstd(bytes: &[u8]) -> Option<Vec<u8>> {
    zstd::bulk::compress(bytes, 19).ok()
}

/// What a stage makes of a file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rate {
    /// The name of the stage.
    pub stage: &'static str,
    /// Bytes of the tensors packed as they are.
    pub plain: u64,
    /// Bytes of the tensors packed after the shuffle.
    pub shuffled: u64,
}

/// Packs the tensors of the file that `btf` was opened from by every stage.
///
/// # Errors
/// [`Error::Invalid`] or [`Error::Io`] if the file cannot be read again or a stage fails.
pub fn rates(btf: &dyn CompressedBtf) -> Result<Vec<Rate>> {
    let container = Container::open(btf.path())?;
    let rate = |&(stage, pack): &(&'static str, Pack)| {
        let sum = |shuffled: bool| -> Option<u64> {
            let packed = container.payloads().map(|(size, bytes)| match shuffled {
                true => pack(&shuffle(bytes, size)),
                false => pack(bytes),
            });
            packed.map(|packed| Some(packed?.len() as u64)).sum()
        };
        let failed = || Error::invalid(btf.path(), "tensors", format!("{stage} fails"));
        Ok(Rate { stage, plain: sum(false).ok_or_else(failed)?, shuffled: sum(true).ok_or_else(failed)? })
    };
    STAGES.par_iter().map(rate).collect()
}

/// All first bytes of numbers of `size` bytes, then all second ones, and so on.
fn shuffle(bytes: &[u8], size: usize) -> Vec<u8> {
    (0..size).flat_map(|k| bytes.iter().skip(k).step_by(size).copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    fn unpack(stage: &str, packed: &[u8], len: usize) -> Vec<u8> {
        let mut out = Vec::new();
        match stage {
            "lzw" => weezl::decode::Decoder::with_tiff_size_switch(BitOrder::Msb, 8).decode(packed).unwrap(),
            "deflate" => {
                flate2::read::ZlibDecoder::new(packed).read_to_end(&mut out).unwrap();
                out
            }
            _ => zstd::bulk::decompress(packed, len).unwrap(),
        }
    }

    #[test]
    fn stages_lose_nothing_and_the_shuffle_pays() {
        let numbers: Vec<f32> = (0..5000).map(|i| 1.5 + (i as f32 * 0.01).sin() * 0.3).collect();
        let bytes: &[u8] = bytemuck::cast_slice(&numbers);
        let shuffled = shuffle(bytes, 4);
        assert_eq!((shuffled[1], shuffled[3 * 5000]), (bytes[4], bytes[3]));
        for (name, pack) in STAGES {
            let [plain, better] = [bytes, &shuffled].map(|bytes| {
                let packed = pack(bytes).unwrap();
                assert!(unpack(name, &packed, bytes.len()) == bytes, "{name}");
                packed.len()
            });
            assert!(better < plain, "{name}: {better} {plain}");
        }
    }
}
