//! A zip in the Bonn layout: any bytes open or are refused, and what opens can be read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden::import;

fuzz_target!(|data: &[u8]| {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("fuzzed.zip");
    std::fs::write(&path, data).expect("a temporary file");
    let Ok(source) = import::open(&path, &Default::default()) else { return };
    let meta = source.meta();
    if meta.view_len() < 1 << 24 {
        for view in 0..meta.views.len() {
            let _ = source.view(view).map(|texels| assert_eq!(texels.len(), meta.view_len()));
        }
    }
});
