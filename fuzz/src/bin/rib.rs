//! RIB files, text, binary or compressed.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden::render::scene_file::SceneFile;

fuzz_target!(|data: &[u8]| {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("x.rib");
    std::fs::write(&path, data).expect("a temporary file");
    let Ok(file) = SceneFile::open(&path) else { return };
    assert_eq!(file.scene().bodies.len(), file.bodies.len());
});
