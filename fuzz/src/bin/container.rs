//! A `.loden` file: any bytes open or are refused, and what opens can be decoded and evaluated.
#![no_main]

use libfuzzer_sys::fuzz_target;
use loden::btf::BtfSource;
use loden::direction::{Scheme, from_angles};

fuzz_target!(|data: &[u8]| {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("fuzzed.loden");
    std::fs::write(&path, data).expect("a temporary file");
    let Ok(compressed) = loden::codec::open(&path) else { return };
    if compressed.meta().image_len() < 1 << 22 {
        let texels = compressed.image(0, 0).expect("an opened container decodes");
        assert_eq!(texels.len(), compressed.meta().image_len());
    }
    if let Ok(material) = compressed.material(Scheme::Triangles) {
        let value = material.apparent([0.3, 0.7].into(), from_angles(0.4, 1.0), from_angles(1.2, 4.0));
        assert!(!value.is_nan());
    }
});
