//! Stored files: frozen files stay readable; damaged ones give an error or a value, never a panic.
//!
//! With `LODEN_BLESS` in the environment, the frozen files are written anew, which only a new format version may do.

use std::borrow::Cow;
use std::fs;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use loden::Result;
use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use loden::codec::{self, CODECS, Finish, Goal};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme};
use loden::metric;
use loden::params::Values;
use loden::progress::Silent;
use serde_json::{Value, json};

/// Contents of the frozen files: 3 x 2 texels, 2 views, 3 lights.
fn sample() -> MemoryBtf {
    let meta = BtfMeta {
        width: 3,
        height: 2,
        views: DirectionSet::from_degrees(vec![[0.0, 0.0], [45.0, 90.0]]).unwrap(),
        lights: DirectionSet::from_degrees(vec![[0.0, 0.0], [60.0, 0.0], [60.0, 180.0]]).unwrap(),
        encoding: Encoding::Srgb,
        cosine: Cosine::Included,
        sample_type: SampleType::U8,
    };
    let values = (0..2 * meta.view_len()).map(|i| (i * i * 31 % 251) as u8).collect();
    MemoryBtf::new(meta, Texels::U8(Cow::Owned(values))).unwrap()
}

/// The full number of components at full precision, so that the six texels are reproduced.
const EXACT: [(&str, &str); 2] = [("components", "5"), ("precision", "f32")];
const EXACT_KLT: [(&str, &str); 2] = [("components", "5"), ("step", "0.02")];
const EXACT_QUANTISED: [(&str, &str); 2] = [("clusters", "6"), ("precision", "f32")];
const EXACT_LOCAL: [(&str, &str); 3] = [("clusters", "2"), ("components", "4"), ("precision", "f32")];

const EXACT_SVD: [(&str, &str); 2] = [("components", "6"), ("precision", "f32")];
const EXACT_CHANNELS: [(&str, &str); 3] = [("components", "6"), ("chroma", "6"), ("precision", "f32")];
const PRODUCTS: [(&str, &str); 3] = [("clusters", "5"), ("resolution", "3"), ("precision", "f32")];
const MODELS: [(&str, &str); 2] = [("model", "phong"), ("precision", "f32")];

const NETWORK: [(&str, &str); 3] = [("features", "2"), ("width", "8"), ("samples", "0.05")];

/// Largest error of a codec that fits a formula to texels: pseudo-random numbers follow none.
const ANYTHING: f32 = f32::INFINITY;

/// Parameters with which a codec reproduces [`sample`], and how well.
fn exact(codec: &str) -> (&'static [(&'static str, &'static str)], f32) {
    match codec {
        "svd" => (&EXACT_SVD, 1e-5),
        "dfmf" => (&EXACT_CHANNELS, 1e-3),
        "cmf" => (&PRODUCTS, ANYTHING),
        "analytic" => (&MODELS, ANYTHING),
        "neural" => (&NETWORK, ANYTHING),
        "klt" => (&EXACT_KLT, 1e-2),
        "kmeans" | "median-cut" | "tsvq" => (&EXACT_QUANTISED, 1e-5),
        "pcmf" => (&EXACT_LOCAL, 1e-5),
        _ => (&EXACT, 1e-5),
    }
}

fn frozen(precision: &str) -> PathBuf {
    frozen_of("pvmf", &format!("pvmf-{precision}"), &[("components", "5"), ("precision", precision)])
}

fn frozen_klt() -> PathBuf {
    frozen_of("klt", "klt", &EXACT_KLT)
}

/// Files of the other methods that reproduce [`sample`], and how well.
fn frozen_exact() -> [(&'static str, PathBuf, f32); 7] {
    let quantised = |codec, precision| {
        frozen_of(codec, &format!("{codec}-{precision}"), &[("clusters", "6"), ("precision", precision)])
    };
    let local = [("clusters", "2"), ("components", "4"), ("precision", "f16")];
    [
        ("kmeans", quantised("kmeans", "u8"), 1e-6),
        ("median-cut", quantised("median-cut", "f16"), 1e-3),
        ("tsvq", quantised("tsvq", "f32"), 1e-6),
        ("pcmf", frozen_of("pcmf", "pcmf-f16", &local), 5e-3),
        ("pca", frozen_of("pca", "pca-u8", &[("components", "5"), ("precision", "u8")]), 1e-2),
        ("svd", frozen_of("svd", "svd-u8", &[("components", "6"), ("precision", "u8")]), 1e-2),
        ("dfmf", frozen_of("dfmf", "dfmf-f32", &EXACT_CHANNELS), 1e-3),
    ]
}

/// Files of the methods that describe texels by a formula, and the first two texels of their last image.
fn frozen_formulas() -> [(&'static str, PathBuf, [f32; 6]); 3] {
    [
        (
            "cmf",
            frozen_of("cmf", "cmf-f32", &PRODUCTS),
            [0.382_212_82, 0.564_910_4, 0.319_998_9, 0.377_043_6, 0.206_270_96, 0.897_064_75],
        ),
        (
            "analytic",
            frozen_of("analytic", "analytic-f32", &MODELS),
            [0.144_487, 0.386_771, 0.293_266, 0.386_616, 0.457_297, 0.489_564],
        ),
        (
            "neural",
            frozen_of("neural", "neural", &NETWORK),
            [0.371_036_2, 0.597_230_85, 0.410_295_46, 0.396_541_66, 0.583_651_6, 0.476_099_58],
        ),
    ]
}

fn frozen_others() -> impl Iterator<Item = PathBuf> {
    let formulas = frozen_formulas().map(|(_, path, _)| path);
    frozen_exact().map(|(_, path, _)| path).into_iter().chain(formulas)
}

fn frozen_of(codec: &str, name: &str, params: &[(&str, &str)]) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/{name}.loden"));
    if std::env::var_os("LODEN_BLESS").is_some() {
        let codec = codec::by_name(codec).unwrap();
        let params = Values::new(codec.params(), params.iter().copied()).unwrap();
        codec.encode(&sample(), &params, &path, &Silent).unwrap();
    }
    path
}

#[test]
fn every_codec_has_a_frozen_file() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files = files.filter(|path| path.extension().is_some_and(|e| e == "loden"));
    let methods: Vec<String> = files.map(|path| codec::open(path).unwrap().method().to_owned()).collect();
    for codec in CODECS {
        assert!(methods.iter().any(|method| method == codec.name()), "{}: no file in tests/data", codec.name());
    }
}

#[test]
fn frozen_files_decode_to_what_was_stored() {
    let source = sample();
    let files = [("f32", 1e-5), ("f16", 1e-3), ("u8", 1e-2)].map(|(p, tolerance)| (frozen(p), "pvmf", tolerance));
    for (path, method, tolerance) in files.into_iter().chain([(frozen_klt(), "klt", 1e-2)]) {
        let btf = codec::open(&path).unwrap();
        assert_eq!((btf.method(), btf.params().written("components").unwrap()), (method, "5"));
        decodes_to_the_sample(&*btf, &source, tolerance);
    }
    for (method, path, tolerance) in frozen_exact() {
        let btf = codec::open(&path).unwrap();
        assert_eq!(btf.method(), method);
        decodes_to_the_sample(&*btf, &source, tolerance);
    }
    for (method, path, expected) in frozen_formulas() {
        let btf = codec::open(&path).unwrap();
        assert_eq!(btf.method(), method);
        let image = btf.image(1, 2).unwrap().to_f32().into_owned();
        assert!(image.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{method}: {:?}", &image[..6]);
    }
}

fn decodes_to_the_sample(btf: &dyn BtfSource, source: &MemoryBtf, tolerance: f32) {
    assert_eq!(btf.meta(), &BtfMeta { sample_type: SampleType::F32, ..source.meta().clone() });
    for view in 0..2 {
        let (expected, found) = (source.view(view).unwrap(), btf.view(view).unwrap());
        for (a, b) in expected.to_f32().iter().zip(found.to_f32().iter()) {
            assert!((a - b).abs() < tolerance, "{a} {b}");
        }
    }
}

/// Opens and decodes a file.
fn use_file(path: &Path) -> Result<()> {
    let btf = codec::open(path)?;
    for view in 0..btf.meta().views.len() {
        btf.view(view)?;
    }
    btf.image(0, 0)?;
    Ok(())
}

/// Evaluates a file; preparing the interpolation takes most of the time.
fn evaluate(path: &Path) -> Result<()> {
    let material = codec::open(path)?.material(Scheme::Triangles)?;
    material.apparent(Vec2::splat(0.3), Vec3::Z, Vec3::new(0.6, 0.0, 0.8));
    Ok(())
}

#[test]
fn a_truncated_file_is_an_error_at_every_length() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    for frozen in [frozen("u8"), frozen_klt()].into_iter().chain(frozen_others()) {
        truncate(&path, &fs::read(frozen).unwrap());
    }
}

fn truncate(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).unwrap();
    // change the file in place: writing it anew would flush it to the disk each time
    let file = fs::File::options().write(true).open(path).unwrap();
    for length in (0..bytes.len()).rev() {
        file.set_len(length as u64).unwrap();
        let error = use_file(path).unwrap_err().to_string();
        assert!(error.contains("x.loden"), "{length}: {error}");
    }
    fs::write(path, [bytes, &[0]].concat()).unwrap();
    assert!(use_file(path).is_err());
}

#[test]
fn a_changed_byte_is_an_error_or_a_value() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    for frozen in [frozen("f16")].into_iter().chain(frozen_others()) {
        change_bytes(&path, &fs::read(&frozen).unwrap());
    }
}

fn change_bytes(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).unwrap();
    let mut file = fs::File::options().write(true).open(path).unwrap();
    let mut put = |place: usize, byte: u8| {
        file.seek(SeekFrom::Start(place as u64)).unwrap();
        file.write_all(&[byte]).unwrap();
    };
    let mut errors = 0;
    for (place, &byte) in bytes.iter().enumerate() {
        for change in [1, 0x80, 0xff] {
            put(place, byte ^ change);
            if place % 7 == 0 && use_file(path).is_ok() {
                evaluate(path).unwrap();
            }
            if let Err(error) = use_file(path) {
                assert!(error.to_string().contains("x.loden"), "{place}: {error}");
                errors += 1;
            }
        }
        put(place, byte);
    }
    assert!(errors > 1000, "only {errors} changes were noticed");
}

/// Rewrites the header of a frozen file and returns the error.
fn failure(change: impl FnOnce(&mut Value)) -> String {
    let bytes = fs::read(frozen("f32")).unwrap();
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let mut header: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    change(&mut header);
    rebuilt(&header, &bytes[8 + length..])
}

fn rebuilt(header: &Value, data: &[u8]) -> String {
    let mut text = header.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(8), b' ');
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    fs::write(&path, [&(text.len() as u64).to_le_bytes()[..], &text, data].concat()).unwrap();
    let error = use_file(&path).unwrap_err().to_string();
    assert!(error.contains("x.loden"), "{error}");
    error
}

/// Replaces a field of a metadata entry that is JSON in a string.
fn set(header: &mut Value, entry: &str, field: &str, value: Value) {
    let text = &mut header["__metadata__"][entry];
    let mut inner: Value = serde_json::from_str(text.as_str().unwrap()).unwrap();
    inner[field] = value;
    *text = inner.to_string().into();
}

#[test]
fn wrong_headers_are_named() {
    type Change = (&'static str, fn(&mut Value));
    let changes: [Change; 20] = [
        ("loden", |h| drop(h["__metadata__"].as_object_mut().unwrap().remove("loden"))),
        ("version \"9\"", |h| h["__metadata__"]["loden"] = "9".into()),
        ("checksums: this metadata entry is missing", |h| h["__metadata__"]["loden"] = "3".into()),
        ("checksums: this metadata entry is missing", |h| h["__metadata__"]["loden"] = "2".into()),
        ("unknown method \"zip\"", |h| h["__metadata__"]["method"] = "zip".into()),
        ("method: this metadata entry is missing", |h| {
            drop(h["__metadata__"].as_object_mut().unwrap().remove("method"))
        }),
        ("btf", |h| h["__metadata__"]["btf"] = "{".into()),
        ("width", |h| set(h, "btf", "width", json!(0))),
        ("width is 4294967296", |h| set(h, "btf", "width", json!(1u64 << 32))),
        ("height is 18446744073709551615", |h| set(h, "btf", "height", json!(u64::MAX))),
        ("btf", |h| set(h, "btf", "height", json!(-2))),
        ("numbers in a decoded view", |h| {
            set(h, "btf", "height", json!(65536));
            set(h, "btf", "width", json!(65536));
        }),
        ("tensor coefficients: found shape", |h| set(h, "btf", "width", json!(4))),
        ("tensor mean: found shape", |h| set(h, "btf", "lights", json!("bonn81"))),
        ("btf", |h| set(h, "btf", "views", json!([]))),
        ("components", |h| set(h, "params", "components", json!("6"))),
        ("components", |h| set(h, "params", "components", json!(5))),
        ("tensor basis: found type", |h| set(h, "params", "precision", json!("f16"))),
        ("there is no pair (2, 0)", |h| set(h, "source", "missing", json!([[2, 0]]))),
        ("header", |h| h["mean"]["shape"] = json!([u64::MAX, u64::MAX, 3])),
    ];
    for (expected, change) in changes {
        let error = failure(change);
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

#[test]
fn numbers_that_are_not_finite_are_named() {
    let bytes = fs::read(frozen("f32")).unwrap();
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    for tensor in ["mean", "basis", "coefficients"] {
        for bad in [f32::NAN, f32::INFINITY] {
            let mut data = bytes[8 + length..].to_vec();
            let begin = header[tensor]["data_offsets"][0].as_u64().unwrap() as usize;
            data[begin + 8..begin + 12].copy_from_slice(&bad.to_le_bytes());
            let error = rebuilt(&header, &data);
            assert!(error.contains(&format!("tensor {tensor}")) && error.contains("not finite"), "{error}");
        }
    }
}

#[test]
fn an_empty_or_foreign_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    assert!(use_file(&path).unwrap_err().to_string().contains("x.loden"));
    for content in [&b""[..], b"PK\x03\x04", b"not a container at all", &[0xff; 64]] {
        fs::write(&path, content).unwrap();
        assert!(use_file(&path).unwrap_err().to_string().contains("x.loden"));
    }
}

#[test]
fn a_failed_encode_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let codec = codec::by_name("pvmf").unwrap();
    let params = Values::new(codec.params(), [("components", "6")]).unwrap();
    assert!(codec.encode(&sample(), &params, &folder.path().join("x.loden"), &Silent).is_err());
    let params = Values::defaults(codec.params());
    assert!(codec.encode(&sample(), &params, &folder.path().join("no folder/x.loden"), &Silent).is_err());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    if Path::new("/dev/full").exists() {
        assert!(codec.encode(&sample(), &params, Path::new("/dev/full/x"), &Silent).is_err());
    }
}

#[test]
fn every_changed_byte_of_entropy_coded_numbers_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let bytes = fs::read(frozen_klt()).unwrap();
    let stored = bytes.windows(6).position(|w| w == b"stream").unwrap();
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    assert!(stored < header);
    let mut noticed = 0;
    for place in header..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[place] ^= 1 << (place % 8);
        fs::write(&path, &damaged).unwrap();
        match use_file(&path) {
            Err(error) => {
                assert!(error.to_string().contains("tensor"), "{error}");
                noticed += 1;
            }
            // rotations before the stream are plain numbers
            Ok(()) => assert!(place < header + 2 * (2 * 2 + 3 * 3), "{place}"),
        }
    }
    assert!(noticed > 100, "{noticed}");
}

#[test]
fn cancelling_stops_and_leaves_nothing() {
    struct Cancel;
    impl loden::progress::Progress for Cancel {
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let folder = tempfile::tempdir().unwrap();
    for codec in CODECS {
        let params = Values::new(codec.params(), exact(codec.name()).0.iter().copied()).unwrap();
        let result = codec.encode(&sample(), &params, &folder.path().join("x"), &Cancel);
        assert!(matches!(result, Err(loden::Error::Cancelled)));
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn every_codec_decodes_an_image_as_it_decodes_a_view_and_stores_the_same_bytes() {
    let (folder, source) = (tempfile::tempdir().unwrap(), sample());
    for codec in CODECS {
        let name = codec.name();
        let (params, tolerance) = exact(name);
        let params = Values::new(codec.params(), params.iter().copied()).unwrap();
        let path = folder.path().join(name);
        let encode = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| codec.encode(&source, &params, &path, &Silent)).unwrap();
            fs::read(&path).unwrap()
        };
        assert!(encode(1) == encode(2), "{name}: the number of threads changes the file");
        let btf = codec::open(&path).unwrap();
        let meta = btf.meta();
        let material = btf.clone().material(Scheme::Triangles).unwrap();
        for view in 0..meta.views.len() {
            let whole = btf.view(view).unwrap().to_f32().into_owned();
            let original = source.view(view).unwrap().to_f32().into_owned();
            for (light, expected) in whole.chunks_exact(meta.image_len()).enumerate() {
                assert_eq!(*btf.image(view, light).unwrap().to_f32(), *expected, "{name}");
                for (texel, stored) in expected.chunks_exact(3).enumerate() {
                    let uv = Vec2::new((texel % 3) as f32 + 0.5, 1.5 - (texel / 3) as f32) / Vec2::new(3.0, 2.0);
                    let (wi, wo) = (meta.lights.directions()[light], meta.views.directions()[view]);
                    let linear: Vec<f32> = stored.iter().map(|&v| meta.encoding.decode(v.max(0.0))).collect();
                    let found = material.apparent(uv, wi, wo);
                    let difference = (found - Vec3::from_slice(&linear)).abs().max_element();
                    assert!(difference < 2e-4, "{name} {view} {light} {texel}: {found} {linear:?}");
                }
            }
            for (a, b) in whole.iter().zip(&original) {
                assert!((a - b).abs() < tolerance, "{name}: {a} {b}");
            }
        }
    }
}

#[test]
fn the_error_of_every_codec_is_stored_as_measured() {
    let (folder, source) = (tempfile::tempdir().unwrap(), sample());
    for codec in CODECS {
        let name = codec.name();
        let (plain, path) = (folder.path().join("plain"), folder.path().join(name));
        // few clusters and components, so that the error is not zero
        let few = [("clusters", "2"), ("components", "1"), ("chroma", "1")];
        let known = |(name, _): &(&str, &str)| codec.params().iter().any(|param| param.name == *name);
        let params = Values::new(codec.params(), few.into_iter().filter(known)).unwrap();
        let compress = |measure, path: &Path| {
            codec::compress(*codec, &source, &params, Goal::Params, Finish { measure, lossless: None }, path, &Silent)
                .unwrap()
        };
        assert_eq!(compress(false, &plain).error, None);
        assert_eq!(codec::open(&plain).unwrap().error(), None);
        let outcome = compress(true, &path);
        let (found, expected) = (codec::open(&path).unwrap(), codec::open(&plain).unwrap());
        let measured = metric::compare(&source, &*found, &Silent).unwrap();
        assert!(measured.mean_abs_error > 0.0);
        assert_eq!((outcome.error, found.error()), (Some(measured), Some(&measured)), "{name}");
        assert_eq!((found.bytes(), outcome.bytes), (expected.bytes(), expected.bytes()));
        for view in 0..2 {
            assert_eq!(found.view(view).unwrap(), expected.view(view).unwrap());
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1 + CODECS.len(), "something is left behind");
}

#[test]
fn codecs_have_distinct_names_and_valid_defaults() {
    for (i, codec) in CODECS.iter().enumerate() {
        assert!(CODECS[..i].iter().all(|other| other.name() != codec.name()));
        assert!(!codec.doc().is_empty());
        for param in codec.params() {
            param.check(param.default).unwrap();
        }
    }
    assert!(codec::by_name("zip").map(|c| c.name()).unwrap_err().to_string().contains("pvmf"));
}
