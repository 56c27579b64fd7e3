//! A light-position file with one picture beside it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::{PICTURE, open};

fuzz_target!(|data: &[u8]| {
    open("x.lp", b"p.png 0 0 1\n", data, &[("p.png", PICTURE)]);
});
