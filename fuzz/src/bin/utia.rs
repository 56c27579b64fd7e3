//! A picture that may be a table.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    open("x.png", &[], data, &[]);
    open("x.exr", &[0x76, 0x2f, 0x31, 0x01], data, &[]);
});
