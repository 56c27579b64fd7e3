//! Checks of EXR files compressed by DWAA or DWAB, whose decoder allocates whatever a file asks for.
//!
//! # Format
//! A block that is smaller than its pixels begins with eleven little-endian counts of 64 bits: version; sizes of the
//! remaining channels, decompressed and compressed; compressed sizes of the AC, DC and run-length sections; the
//! run-length section without deflation, then without run lengths; numbers of AC and DC coefficients; the entropy coder.

use std::io::Cursor;

use ::exr::block::chunk::CompressedBlock;
use ::exr::compression::Compression;
use ::exr::error::{Error, Result};
use ::exr::meta::BlockDescription;
use ::exr::meta::header::Header;

/// Checks the counts of every block against the pixels that a block can have. Other compressions pass.
///
/// # Errors
/// [`Error::Invalid`] if a count is too large; errors of reading the blocks.
pub(crate) fn check(bytes: &[u8], headers: &[Header]) -> Result<()> {
    let is_dwa = |header: &Header| matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_));
    if !headers.iter().any(is_dwa) {
        return Ok(());
    }
    for chunk in ::exr::block::read(Cursor::new(bytes), false)?.filter_chunks(false, |_, _, _| true)? {
        let chunk = chunk?;
        let Some(header) = headers.get(chunk.layer_index).filter(|header| is_dwa(header)) else { continue };
        let block = match &chunk.compressed_block {
            CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
            CompressedBlock::Tile(block) => &block.compressed_pixels_le,
            // refused by both readers
            CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => continue,
        };
        check_block(block, header)?;
    }
    Ok(())
}

fn check_block(block: &[u8], header: &Header) -> Result<()> {
    let count = |k: usize| match block.get(8 * k..8 * k + 8) {
        Some(bytes) => bytes.try_into().map_or(u64::MAX, u64::from_le_bytes),
        // the decoder reports what is missing
        None => 0,
    };
    let size = header.layer_size;
    let [width, height] = match header.blocks {
        BlockDescription::Tiles(tiles) => {
            [tiles.tile_size.width().min(size.width()), tiles.tile_size.height().min(size.height())]
        }
        BlockDescription::ScanLines => [size.width(), header.compression.scan_lines_per_block()],
    };
    // Coefficients belong to squares of 8 x 8 pixels; a sample has at most four bytes
    let squares = [width.div_ceil(8), height.div_ceil(8), header.channels.list.len()];
    let squares = squares.into_iter().fold(1u64, |product, n| product.saturating_mul(n as u64));
    let [samples, bytes] = [squares.saturating_mul(64), squares.saturating_mul(64 * 4)];
    // run lengths that compress nothing need two bytes for one
    let limits = [(1, bytes), (6, bytes.saturating_mul(2)), (7, bytes), (8, samples), (9, squares)];
    match limits.into_iter().find(|&(k, limit)| count(k) > limit) {
        Some((k, limit)) => {
            Err(Error::Invalid(format!("count {k} of a DWA block is {}, over {limit}", count(k)).into()))
        }
        None => Ok(()),
    }
}
