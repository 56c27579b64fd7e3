//! A tensor file of Mueller matrices; without the seeds hardly any is one.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    common::open("x.pbsdf", b"tensor_file\0\x01\0", data, &[]);
});
