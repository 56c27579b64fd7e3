//! Photographs of a CUReT sample; the directions are fuzzed, too.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    let split = data.iter().position(|&b| b == 0).unwrap_or(data.len());
    let picture = data.get(split + 1..).unwrap_or_default();
    open("01-001.bmp", b"", picture, &[("table.txt", &data[..split])]);
});
