//! A factored BRDF.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    open("x.loden", &[], data, &[]);
});
