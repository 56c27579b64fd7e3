//! Pictures of every kind, as an image set holds them.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    for name in [
        "tl0 pl0 tv0 pv0.jpg",
        "tl0 pl0 tv0 pv0.png",
        "tl0 pl0 tv0 pv0.hdr",
        "tl0 pl0 tv0 pv0.exr",
        "tl0 pl0 tv0 pv0.tif",
    ] {
        let dir = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(dir.path().join(name), data).expect("a temporary file");
        let Ok(source) = loden::import::open(dir.path(), &Default::default()) else { continue };
        let _ = source.image(0, 0);
    }
});
