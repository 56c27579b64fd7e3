//! Materials exported as the closest standard material: whole glTF and MaterialX files, and what is lost is said.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use loden::job::{RendererExport, export_to};
use loden::params::Given;
use loden::picture::Picture;
use loden::progress::Silent;
use loden::render::object;
use loden::renderers::{self, scene};
use serde_json::Value;

use crate::shaders::{compressed, sample};

/// The folder that an export writes of a file, and its summary.
fn exported(file: &Path, target: &str, folder: &Path) -> (PathBuf, RendererExport) {
    let out = folder.join(target);
    let made = export_to(file, &Given::default(), renderers::by_name(target).unwrap(), &out, &Silent).unwrap();
    (out, made)
}

fn gravel(folder: &Path) -> PathBuf {
    let path = folder.join("gravel.loden");
    compressed(&*sample(folder), "klt", &[], &path);
    path
}

/// What a folder says about the error, and its pictures.
fn check_loss(folder: &Path, made: &RendererExport) {
    let loss = made.approximation.unwrap();
    assert!((0.001..0.9).contains(&loss.relative_error) && (0.001..0.9).contains(&loss.picture_error), "{loss:?}");
    let readme = fs::read_to_string(folder.join("README.md")).unwrap();
    assert!(readme.contains(&loss.sentence()) && !readme.contains('{'), "{readme}");
    let [ball, both] = [scene::PICTURE, scene::COMPARISON].map(|name| Picture::dimensions(folder.join(name)).unwrap());
    assert_eq!(both, (2 * ball.0, ball.1));
}

/// The JSON and the binary chunk of a GLB file, whose lengths are checked.
fn chunks(bytes: &[u8]) -> (Value, Vec<u8>) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let text = word(12);
    assert_eq!(&bytes[16..20], b"JSON");
    let binary = &bytes[20 + text..];
    assert_eq!((word(20 + text), &binary[4..8]), (binary.len() - 8, &b"BIN\0"[..]));
    (serde_json::from_slice(&bytes[20..20 + text]).unwrap(), binary[8..].to_vec())
}

#[test]
fn a_gltf_file_is_whole_and_its_ball_wears_the_maps() {
    let folder = tempfile::tempdir().unwrap();
    let (out, made) = exported(&gravel(folder.path()), "gltf", folder.path());
    check_loss(&out, &made);
    let file = out.join("ball.glb");
    let (document, binary) = chunks(&fs::read(&file).unwrap());
    let number = |value: &Value, name: &str| value[name].as_u64().unwrap() as usize;
    for image in document["images"].as_array().unwrap() {
        let view = &document["bufferViews"][number(image, "bufferView")];
        let bytes = &binary[number(view, "byteOffset")..][..number(view, "byteLength")];
        let path = folder.path().join("map.png");
        fs::write(&path, bytes).unwrap();
        assert_eq!(Picture::dimensions(&path).unwrap(), (4, 4), "{image}");
    }
    let names = |value: &Value| -> BTreeSet<String> { value.as_object().unwrap().keys().cloned().collect() };
    let used: BTreeSet<String> =
        document["extensionsUsed"].as_array().unwrap().iter().map(|name| name.as_str().unwrap().to_owned()).collect();
    let mut expected = names(&document["materials"][0]["extensions"]);
    expected.extend(names(&document["extensions"]));
    assert_eq!(used, expected);
    // our own reader takes it
    let mesh = object::read(&file).unwrap();
    assert!(mesh.warnings.is_empty(), "{:?}", mesh.warnings);
    let (paints, warnings) = object::paints(&file).unwrap();
    assert!(paints.len() == 2 && warnings.is_empty(), "{warnings:?}");
}

/// The values of an attribute, in the order of the text.
fn attributes<'a>(text: &'a str, name: &str) -> Vec<&'a str> {
    let start = format!(" {name}=\"");
    text.split(&start).skip(1).map(|rest| rest.split('"').next().unwrap()).collect()
}

#[test]
fn a_materialx_document_names_only_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let (out, made) = exported(&gravel(folder.path()), "materialx", folder.path());
    check_loss(&out, &made);
    let text = fs::read_to_string(out.join("material.mtlx")).unwrap();
    let names: BTreeSet<&str> = attributes(&text, "name").into_iter().collect();
    for attribute in ["nodename", "nodegraph", "output"] {
        for name in attributes(&text, attribute) {
            assert!(names.contains(name), "{attribute} {name}");
        }
    }
    let files: Vec<&str> = attributes(&text, "value").into_iter().filter(|value| value.ends_with(".png")).collect();
    assert!(files.len() >= 5, "{files:?}");
    for file in files {
        assert_eq!(Picture::dimensions(out.join(file)).unwrap(), (4, 4), "{file}");
    }
    let opened = text.matches('<').count() - text.matches("</").count();
    assert_eq!(opened, text.matches("</").count() + text.matches("/>").count() + 1, "elements are closed");
}

#[test]
fn every_brdf_has_a_closest_standard_material() {
    let folder = tempfile::tempdir().unwrap();
    // GGX with the reflectance of gold: a metal, but with shadowing and a Fresnel factor of its own
    let (_, made) = exported(Path::new("ggx:alpha-x=0.3:alpha-y=0.3:kd=0:ks=1:metal=gold"), "gltf", folder.path());
    let loss = made.approximation.unwrap();
    assert!(made.table_error.unwrap() < 0.02 && loss.relative_error < 0.07, "{loss:?}");
}
