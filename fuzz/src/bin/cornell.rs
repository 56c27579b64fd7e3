//! A Cornell table.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    open("x.brdf", b"2\n500 600\n", data, &[]);
});
