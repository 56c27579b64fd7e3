//! Opening what was fuzzed, and touching all that an opened file offers.

use std::path::Path;

use loden::direction::from_angles;
use loden::import::{self, Measured, Options};

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
    match import::open_named(path, &Options::default()) {
        Err(_) => {}
        Ok((_, Measured::Btf(source))) => {
            let meta = source.meta();
            if meta.image_len() < 1 << 20 {
                for (view, light) in [(0, 0), (meta.views.len() - 1, meta.lights.len() - 1)] {
                    let _ = source.image(view, light).map(|texels| assert_eq!(texels.len(), meta.image_len()));
                }
            }
        }
        Ok((_, Measured::Brdf(brdf))) => {
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
