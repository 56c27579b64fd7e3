//! Running the program in a folder of its own.

use std::path::Path;
use std::process::{Command, Output};

use loden::btf::{BtfMeta, Cosine, SampleType, Texels};
use loden::color::Encoding;
use loden::direction::DirectionSet;
use loden::export;
use loden::params::Given;
use loden::picture::Picture;
use serde_json::Value;
use tempfile::TempDir;

pub const LODEN: &str = env!("CARGO_BIN_EXE_loden");

pub fn loden(dir: &Path, line: &str) -> Output {
    Command::new(LODEN).args(line.split_whitespace()).current_dir(dir).output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must succeed, over its earlier outputs; its JSON.
pub fn json(dir: &Path, line: &str) -> Value {
    let output = loden(dir, &format!("{line} --json --force"));
    assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{line}: {e}\n{}", text(&output.stdout)))
}

/// Runs a command that must fail with `code`; its message.
pub fn failure(dir: &Path, line: &str, code: i32) -> String {
    let output = loden(dir, line);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{line}: {message}");
    assert!(output.stdout.is_empty(), "{line}: {}", text(&output.stdout));
    assert!(!message.contains("panicked"), "{line}: {message}");
    message
}

/// A folder with `small.zip`, `small` and `small.toml`: 7 x 7 pairs, 12 x 12 texels.
pub fn workshop() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let mut degrees = vec![[0.0, 0.0]];
    degrees.extend((0..6).map(|k| [40.0, 60.0 * f64::from(k)]));
    let set = DirectionSet::from_degrees(degrees).unwrap();
    let meta = BtfMeta {
        width: 12,
        height: 12,
        views: set.clone(),
        lights: set.clone(),
        encoding: Encoding::Srgb,
        cosine: Cosine::Included,
        sample_type: SampleType::U8,
    };
    for name in ["small.zip", "small", "small.toml"] {
        let options = match name {
            "small.toml" => Given::default(),
            _ => Given::from([("png", "yes")]),
        };
        let mut writer = export::create(dir.path().join(name), &meta, &options).unwrap();
        for (v, wo) in set.directions().iter().enumerate() {
            let value = |i: usize| {
                let (light, texel, channel) = (i / 432, i % 432 / 3, i % 3);
                let wi = set.directions()[light];
                let wave = (texel as f32 * 0.7 + channel as f32 + wo.x * wi.y).sin();
                (255.0 * wi.z * (0.5 + 0.2 * wave)) as u8 + ((i * 7 + v * 13) % 11) as u8
            };
            let texels: Vec<u8> = (0..meta.view_len()).map(value).collect();
            writer.view(&Texels::U8(texels.into())).unwrap();
        }
        writer.finish().unwrap();
    }
    dir
}

/// The numbers of a picture in linear light.
pub fn pixels(path: &Path) -> Vec<f32> {
    let picture = Picture::read(path, &mut Vec::new()).unwrap();
    picture.rgb.iter().flat_map(|rgb| rgb.to_array()).collect()
}
