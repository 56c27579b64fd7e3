//! Opening what was fuzzed, and touching all that an opened file offers.

use std::path::Path;

use loden::direction::from_angles;
use loden::import;

/// A picture of 1 x 1 pixels.
pub const PICTURE: &[u8] = &[
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48, 0x44, 0x52, 0x00, 0x00, 0x00,
    0x01, 0x00, 0x00, 0x00, 0x01, 0x08, 0x02, 0x00, 0x00, 0x00, 0x90, 0x77, 0x53, 0xde, 0x00, 0x00, 0x00, 0x0c, 0x49,
    0x44, 0x41, 0x54, 0x78, 0x9c, 0x63, 0x60, 0x60, 0x60, 0x00, 0x00, 0x00, 0x04, 0x00, 0x01, 0xf6, 0x17, 0x38, 0x55,
    0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82,
];

/// Writes `head` and `data` as a file called `name` and opens it, with other files beside it; of a photograph the folder.
pub fn open(name: &str, head: &[u8], data: &[u8], beside: &[(&str, &[u8])]) {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (name, content) in beside {
        std::fs::write(dir.path().join(name), content).expect("a temporary file");
    }
    let path = dir.path().join(name);
    std::fs::write(&path, [head, data].concat()).expect("a temporary file");
    touch(if name.ends_with(".bmp") { dir.path() } else { &path });
}

fn touch(path: &Path) {
    let Ok((_, measured)) = import::open_named(path, &Default::default()) else { return };
    match measured.images() {
        Ok(source) => {
            let meta = source.meta();
            if meta.image_len() < 1 << 20 {
                for (view, light) in [(0, 0), (meta.views.len() - 1, meta.lights.len() - 1)] {
                    let _ = source.image(view, light).map(|texels| assert_eq!(texels.len(), meta.image_len()));
                }
            }
        }
        Err(brdf) => {
            for (theta_i, theta_o, turn) in [(0.0, 0.0, 0.0), (0.4, 1.2, 3.0), (1.5, 1.5, 1.0)] {
                let (wi, wo) = (from_angles(theta_i, 0.3), from_angles(theta_o, turn));
                let uv = Default::default();
                assert!(!brdf.eval(uv, wi, wo).is_nan());
                assert!(!brdf.pdf(uv, wi, wo).is_nan());
                let _ = brdf.sample(uv, wo, [0.3, 0.7].into());
                let _ = brdf.spectrum(wi, wo);
            }
        }
    }
}
