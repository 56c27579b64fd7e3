//! Pictures of every kind, by themselves and as an image set holds them; the content tells the kind.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("tl0 pl0 tv0 pv0.png");
    std::fs::write(&path, data).expect("a temporary file");
    let _ = loden::picture::Picture::read(&path, &mut Vec::new());
    let Ok(source) = loden::import::open(dir.path(), &Default::default()) else { return };
    let _ = source.image(0, 0);
});
