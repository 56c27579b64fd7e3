//! A manifest of raw photographs with one picture beside it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden::progress::Silent;
use loden::rectify::{Options, Photographs};
use loden_fuzz::PICTURE;

fuzz_target!(|data: &[u8]| {
    let dir = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(dir.path().join("p1.png"), PICTURE).expect("a temporary file");
    let path = dir.path().join("x.toml");
    std::fs::write(&path, [b"loden_photographs = 1\n", data].concat()).expect("a temporary file");
    let Ok(photographs) = Photographs::open(&path) else { return };
    let options = Options { size: 2, max_error: 1.0 };
    let _ = photographs.rectify(&options, &Silent, &mut |texels| {
        assert_eq!(texels.len() % 12, 0);
        Ok(())
    });
});
