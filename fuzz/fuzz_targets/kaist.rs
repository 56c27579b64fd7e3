//! A tensor file with wavelengths.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // the first field, so that the importer is the one that takes it
    let head = b"tensor_file\0\x01\0\x02\0\0\0\x04\0wvls\x01\0\x03\x12\0\0\0\0\0\0\0\x02\0\0\0\0\0\0\0";
    common::open("x.pbsdf", head, data, &[]);
});
