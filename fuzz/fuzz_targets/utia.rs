//! A picture that may be a table.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    common::open("x.png", &[], data, &[]);
    common::open("x.exr", &[0x76, 0x2f, 0x31, 0x01], data, &[]);
});
