//! A tensor file of Mueller matrices; without the seeds hardly any is one.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    open("x.pbsdf", b"tensor_file\0\x01\0", data, &[]);
});
