//! An ALTA file, text or binary.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    common::open("x.alta", b"#DIM 3 1\n#PARAM_IN RUSIN_TH_TD_PD\n", data, &[]);
});
