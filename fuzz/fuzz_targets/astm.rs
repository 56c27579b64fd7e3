//! A text table with a `VARS` line.
#![no_main]

mod common;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    common::open("x.astm", b"VARS theta_i,phi_i,theta_s,phi_s,500nm,600nm\n", data, &[]);
});
