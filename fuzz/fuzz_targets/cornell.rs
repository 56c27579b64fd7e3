//! A Cornell table.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    common::open("x.brdf", b"2\n500 600\n", data, &[]);
});
