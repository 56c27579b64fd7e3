//! An anisotropic table; the fixed part of its header is right.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    let mut header = [0u8; 64];
    let Some((dims, data)) = data.split_first_chunk::<4>() else { return };
    (0..4).for_each(|i| header[4 * i] = dims[i] % 8);
    (header[24], header[36], header[40]) = (1, dims[0] >> 7, 3);
    open("x.mit", &header, data, &[]);
});
