//! OBJ files.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("x.obj");
    std::fs::write(&path, data).expect("a temporary file");
    let _ = loden::render::object::load(path.to_str().expect("a name in ASCII"));
});
