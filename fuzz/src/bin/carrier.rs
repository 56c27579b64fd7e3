//! Numbers in the pixels of pictures: the manifest, a zero byte, and an index image and a block image of equal length.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    let manifest = data.split(|&byte| byte == 0).next().unwrap_or_default();
    let pictures = data.get(manifest.len() + 1..).unwrap_or_default();
    let (index, block) = pictures.split_at(pictures.len() / 2);
    open("carrier.json", manifest, &[], &[("loden_x_index.tif", index), ("loden_x_block.tif", block)]);
});
