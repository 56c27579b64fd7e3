//! A MERL table of any dimensions.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    open("x.binary", &[], data, &[]);
});
