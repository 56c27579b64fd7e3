//! A `.btf` file of any kind, chosen by the first byte.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden_fuzz::open;

fuzz_target!(|data: &[u8]| {
    let Some((&kind, data)) = data.split_first() else { return };
    let heads: [&[u8]; 6] = [b"!DFMF08FC", b"!DFMF08FCR", b"!FMF12FCE", b"!FMF06FCR", b"!PVF06FC", b"!BDIF06R2!"];
    open("x.btf", heads[usize::from(kind) % heads.len()], data, &[]);
});
