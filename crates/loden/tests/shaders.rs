//! Materials exported as shaders: a file of every codec gives WGSL and GLSL that naga accepts, with textures of the stated size,
//! and what cannot be exported is refused by name.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

use loden::acquire;
use loden::btf::BtfSource;
use loden::codec::{self, CODECS, Codec};
use loden::job::{self, export_to};
use loden::params::{Given, Values};
use loden::picture::Picture;
use loden::progress::Silent;
use loden::renderers::{self, RENDERERS};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// A small sample on the Bonn directions.
pub fn sample(folder: &Path) -> Arc<dyn BtfSource> {
    let path = folder.join("gravel.zip");
    let options = acquire::Options { size: 4, spp: 1, ..Default::default() };
    job::built_in("gravel", &options, &path, &Silent).unwrap();
    job::open_btf(&path, &Given::default(), &Silent).unwrap()
}

/// The sample compressed by `method` with these parameters.
pub fn compressed(source: &dyn BtfSource, method: &str, params: &[(&str, &str)], file: &Path) {
    let codec = codec::by_name(method).unwrap();
    let params = Values::new(codec.params(), params.iter().copied()).unwrap();
    let (params, _) = codec::suited(codec, source.meta(), &params).unwrap();
    codec.encode(source, &params, file, &Silent).unwrap();
}

/// A file of every codec that shaders can evaluate, and the folder that holds them until the program ends.
static FILES: LazyLock<(tempfile::TempDir, Vec<PathBuf>)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let source = sample(folder.path());
    let file = |codec: &&dyn Codec| {
        let path = folder.path().join(format!("{}.loden", codec.name()));
        compressed(&*source, codec.name(), &[], &path);
        path
    };
    let files = CODECS.iter().filter(|codec| codec.name() != "neural").map(file).collect();
    (folder, files)
});

/// The folder that a renderer writes, without the picture of the test scene.
fn exported(file: &Path, target: &str, folder: &Path) -> PathBuf {
    let out = folder.join(format!("{}-{target}", file.file_stem().unwrap().to_str().unwrap()));
    fs::create_dir(&out).unwrap();
    let (renderer, material) = (renderers::by_name(target).unwrap(), codec::open(file).unwrap());
    renderer.check(file, &material).unwrap();
    renderer.write("gravel", &material, &out, &Silent).unwrap();
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
    for file in &FILES.1 {
        let out = exported(file, "wgsl", folder.path());
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
    let files = &FILES.1;
    // two codecs are enough for targets that share the textures
    for (target, count) in [("glsl", files.len()), ("wgsl", 2), ("three", 2)] {
        for file in &files[..count] {
            let out = exported(file, target, folder.path());
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
            for name in ["README.md", "index.html"] {
                assert!(fs::metadata(out.join(name)).unwrap().len() > 100, "{name}");
            }
            let largest = description["half_precision"]["largest"].as_f64().unwrap();
            assert!((0.0..0.02).contains(&largest), "{}: {largest}", file.display());
        }
    }
}

/// Words of Open Shading Language that a shader of ours may use beside its own functions.
const OSL: &str = "abs acos atan atan2 backfacing clamp color concat cos cross diffuse dot emission exp float floor for gettextureinfo if int \
    inversesqrt ivec2 ivec3 ivec4 length loden_material log max min mix normalize pow return sin sqrt tan texture vector vector2 vector4";

#[test]
fn osl_calls_only_what_it_defines_and_has_its_textures() {
    let folder = tempfile::tempdir().unwrap();
    for file in &FILES.1 {
        let out = exported(file, "osl", folder.path());
        let text = fs::read_to_string(out.join("material.osl")).unwrap();
        let code: String = text.lines().map(|line| line.split("//").next().unwrap().to_owned() + "\n").collect();
        let mut called = Vec::new();
        let mut defined: Vec<&str> = OSL.split_whitespace().collect();
        for (at, _) in code.match_indices('(') {
            let name = code[..at].rsplit(|c: char| !c.is_ascii_alphanumeric() && c != '_').next().unwrap();
            let before = code[..at - name.len()].trim_end_matches(' ').rsplit(|c: char| !c.is_ascii_alphanumeric());
            let types = ["int", "float", "vector", "vector2", "vector4", "ivec2", "ivec3", "ivec4"];
            let is_definition = before.clone().next().is_some_and(|word| types.contains(&word));
            if is_definition { defined.push(name) } else { called.push(name) }
        }
        for name in called.into_iter().filter(|name| !name.is_empty()) {
            assert!(defined.contains(&name), "{}: {name}", file.display());
        }
        assert!(!code.contains("_WIDTH}") && !code.contains("_ROWS}"), "placeholders are left");
        for word in ["vec2", "vec3", "vec4", "bool"] {
            assert!(code.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').all(|other| other != word), "{word}");
        }
        for name in ["numbers", "indices", "directions"] {
            let (width, rows) = Picture::dimensions(out.join(format!("{name}.exr"))).unwrap();
            assert!(text.contains(&format!("\"/{name}.exr\"), {width}, {rows}, address")), "{name}: {width} x {rows}");
        }
        let script =
            fs::read_to_string(out.join("scene.py")).unwrap() + &fs::read_to_string(out.join("README.md")).unwrap();
        assert!(!script.contains("{TO_LIGHT}") && !script.contains("{mean}"));
    }
}

#[test]
fn what_a_shader_cannot_show_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let [facets, network] = ["facets.loden", "network.loden"].map(|name| folder.path().join(name));
    let source = sample(folder.path());
    compressed(&*source, "analytic", &[("model", "ggx")], &facets);
    compressed(&*source, "neural", &[("width", "8"), ("samples", "0.05")], &network);
    for (path, name, cause) in [(facets, "facets.loden", "ggx"), (network, "network.loden", "a neural network")] {
        for target in ["wgsl", "glsl", "three", "mitsuba", "osl"] {
            let out = folder.path().join(target);
            let error = export_to(&path, &Given::default(), renderers::by_name(target).unwrap(), &out, &Silent);
            let error = error.unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(cause), "{error}");
            assert!(!out.exists());
        }
    }
    let names: Vec<_> = RENDERERS.iter().map(|renderer| renderer.name()).collect();
    let unknown = renderers::by_name("povray").err().unwrap().to_string();
    assert!(names.iter().all(|name| unknown.contains(name)), "{unknown}");
}

#[test]
fn analytic_models_of_texels_are_exported_as_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let source = sample(folder.path());
    for model in ["lambert", "oren-nayar", "phong", "blinn-phong", "lafortune", "ward"] {
        let path = folder.path().join(format!("{model}.loden"));
        compressed(&*source, "analytic", &[("model", model)], &path);
        let out = exported(&path, "wgsl", folder.path());
        let text = fs::read_to_string(out.join("material.wgsl")).unwrap();
        validated(&naga::front::wgsl::parse_str(&text).unwrap(), model);
    }
}

#[test]
fn a_brdf_is_exported_by_its_parameters_or_as_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let export = |material: &str, target: &str| {
        let out = folder.path().join(format!("{}-{target}", material.split(':').next().unwrap()));
        let renderer = renderers::by_name(target).unwrap();
        (export_to(Path::new(material), &Given::default(), renderer, &out, &Silent).map(|made| made.table_error), out)
    };
    let (error, out) = export("ward:alpha-x=0.2:alpha-y=0.5:ks=0.3", "wgsl");
    let text = fs::read_to_string(out.join("material.wgsl")).unwrap();
    assert!(error.unwrap().is_none() && text.contains("loden_ward_lobe"));
    validated(&naga::front::wgsl::parse_str(&text).unwrap(), "ward");
    assert!(fs::metadata(out.join(renderers::scene::PICTURE)).unwrap().len() > 100);
    // fits do not vary this form
    let error = export("ward:form=ward:alpha-x=0.5:alpha-y=0.5", "glsl").0.unwrap().unwrap();
    assert!((0.0..0.05).contains(&error), "{error}");
    sample(folder.path());
    let raw = folder.path().join("gravel.zip");
    let problem = export(raw.to_str().unwrap(), "glsl").0.unwrap_err().to_string();
    assert!(problem.contains("gravel.zip") && problem.contains("loden compress"), "{problem}");
}
