//! A tensor file.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    common::open("x.bsdf", b"tensor_file\0\x01\0", data, &[]);
});
