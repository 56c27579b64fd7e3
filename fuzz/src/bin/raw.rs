//! A raw array: the TOML file before the first zero byte, the data after it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden::import;

fuzz_target!(|data: &[u8]| {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let split = data.iter().position(|&b| b == 0).unwrap_or(data.len());
    let path = dir.path().join("x.toml");
    std::fs::write(&path, &data[..split]).expect("a temporary file");
    std::fs::write(dir.path().join("x.u8"), data.get(split + 1..).unwrap_or(&[])).expect("a temporary file");
    let Ok(source) = import::open(&path, &Default::default()) else { return };
    let meta = source.meta();
    for view in 0..meta.views.len() {
        let _ = source.view(view).map(|texels| assert_eq!(texels.len(), meta.view_len()));
    }
});
