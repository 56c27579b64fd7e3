//! A text table with a `VARS` line.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    open("x.astm", b"VARS theta_i,phi_i,theta_s,phi_s,500nm,600nm\n", data, &[]);
});
