//! An ALTA file, text or binary.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    open("x.alta", b"#DIM 3 1\n#PARAM_IN RUSIN_TH_TD_PD\n", data, &[]);
});
