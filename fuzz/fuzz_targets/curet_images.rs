//! Photographs of a CUReT sample; the directions are fuzzed, too.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let split = data.iter().position(|&b| b == 0).unwrap_or(data.len());
    common::open("01-001.bmp", b"", &data[split..], &[("table.txt", &data[..split])]);
});
