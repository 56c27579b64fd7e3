//! A CUReT table; the directions are fuzzed, too.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    let split = data.iter().position(|&b| b == 0).unwrap_or(data.len());
    let row = format!("1{}\n", " 0.25".repeat(205));
    open("abrdf.dat", row.as_bytes(), &data[..split], &[("table.txt", &data[split..])]);
});
