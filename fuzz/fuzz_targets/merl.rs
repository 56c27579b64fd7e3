//! A MERL table of any dimensions.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    common::open("x.binary", &[], data, &[]);
});
