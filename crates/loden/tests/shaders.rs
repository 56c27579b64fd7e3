//! Materials exported as shaders: a stored file of every codec gives WGSL and GLSL that naga accepts, with textures of the stated size,
//! and what cannot be exported is refused by name.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use loden::codec::{self, CODECS};
use loden::job::export_to;
use loden::params::Values;
use loden::progress::Silent;
use loden::renderers::{self, RENDERERS};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// The stored files: at least one of every codec.
fn files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = paths.filter(|path| path.extension().is_some_and(|e| e == "loden")).collect();
    files.sort();
    let methods: BTreeSet<_> = files.iter().map(|path| codec::open(path).unwrap().method().to_owned()).collect();
    assert!(CODECS.iter().all(|codec| methods.contains(codec.name())), "only {methods:?}");
    files
}

fn exported(file: &Path, target: &str, folder: &Path) -> PathBuf {
    let out = folder.join(format!("{}-{target}", file.file_stem().unwrap().to_str().unwrap()));
    export_to(file, renderers::by_name(target).unwrap(), &out, &Silent).unwrap();
    out
}

fn validated(module: &naga::Module, about: &str) {
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::default());
    if let Err(error) = validator.validate(module) {
        panic!("{about}: {error:?}");
    }
}

#[test]
fn naga_accepts_the_wgsl_of_every_codec() {
    let folder = tempfile::tempdir().unwrap();
    for file in files() {
        let out = exported(&file, "wgsl", folder.path());
        let read = |name: &str| fs::read_to_string(out.join(name)).unwrap();
        let material = read("material.wgsl");
        for text in [material.clone(), format!("{material}\n{}", read("lights.wgsl"))] {
            let module = naga::front::wgsl::parse_str(&text)
                .unwrap_or_else(|error| panic!("{}: {}", file.display(), error.emit_to_string(&text)));
            validated(&module, &file.display().to_string());
            assert!(module.functions.iter().any(|(_, f)| f.name.as_deref() == Some("loden_apparent")));
        }
    }
}

#[test]
fn textures_have_the_stated_sizes_and_no_file_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    for target in ["wgsl", "glsl", "three"] {
        for file in files() {
            let out = exported(&file, target, folder.path());
            let text = fs::read_to_string(out.join(renderers::MANIFEST)).unwrap();
            let description: serde_json::Value = serde_json::from_str(&text).unwrap();
            for texture in description["textures"].as_array().unwrap() {
                let number = |value: &serde_json::Value| value.as_u64().unwrap();
                let [width, height, layers] = [0, 1, 2].map(|k| number(&texture["size"][k]));
                assert!(width <= 2048 && height <= 2048 && layers <= 256, "{texture}");
                let bytes = match texture["format"].as_str().unwrap() {
                    "rgba16float" => 8,
                    "rgba8unorm" => 4,
                    "rgba32float" => 16,
                    other => panic!("{other}"),
                };
                let path = out.join(texture["file"].as_str().unwrap());
                assert_eq!(fs::metadata(path).unwrap().len(), width * height * layers * bytes);
            }
            for name in ["README.md", "index.html", renderers::scene::PICTURE] {
                assert!(fs::metadata(out.join(name)).unwrap().len() > 100, "{name}");
            }
            let largest = description["half_precision"]["largest"].as_f64().unwrap();
            assert!((0.0..0.02).contains(&largest), "{}: {largest}", file.display());
        }
    }
}

#[test]
fn what_a_shader_cannot_show_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let stored = codec::open(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pvmf-f16.loden")).unwrap();
    let codec = codec::by_name("analytic").unwrap();
    let path = folder.path().join("facets.loden");
    let params = Values::new(codec.params(), [("model", "ggx"), ("samples", "12")]).unwrap();
    codec.encode(&*stored, &params, &path, &Silent).unwrap();
    for target in ["wgsl", "glsl", "three", "mitsuba"] {
        let out = folder.path().join(target);
        let error = export_to(&path, renderers::by_name(target).unwrap(), &out, &Silent).unwrap_err().to_string();
        assert!(error.contains("facets.loden") && error.contains("ggx"), "{error}");
        assert!(!out.exists());
    }
    let names: Vec<_> = RENDERERS.iter().map(|renderer| renderer.name()).collect();
    let unknown = renderers::by_name("povray").err().unwrap().to_string();
    assert!(names.iter().all(|name| unknown.contains(name)), "{unknown}");
}

#[test]
fn analytic_models_of_texels_are_exported_as_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let stored = codec::open(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pvmf-f16.loden")).unwrap();
    let codec = codec::by_name("analytic").unwrap();
    for model in ["lambert", "oren-nayar", "phong", "blinn-phong", "lafortune", "ward"] {
        let path = folder.path().join(format!("{model}.loden"));
        let params = Values::new(codec.params(), [("model", model), ("samples", "12")]).unwrap();
        codec.encode(&*stored, &params, &path, &Silent).unwrap();
        let out = exported(&path, "wgsl", folder.path());
        let text = fs::read_to_string(out.join("material.wgsl")).unwrap();
        validated(&naga::front::wgsl::parse_str(&text).unwrap(), model);
    }
}
