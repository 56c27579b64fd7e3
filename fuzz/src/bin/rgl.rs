//! A tensor file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    open("x.bsdf", b"tensor_file\0\x01\0", data, &[]);
});
