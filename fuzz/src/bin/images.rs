//! A manifest with one picture beside it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::{PICTURE, open};

fuzz_target!(|data: &[u8]| {
    open("x.toml", b"loden_images = 1\n", data, &[("p1.png", PICTURE)]);
});
