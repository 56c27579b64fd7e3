//! Packed files: every codec with every stage reproduces the same numbers, and damage is detected.
//!
//! With `LODEN_BLESS` in the environment, the frozen files are written anew, which only a new format version may do.

use std::fs;
use std::path::{Path, PathBuf};

use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use loden::codec::lossless::{STAGES, Stage};
use loden::codec::{self, CODECS, Codec, Finish, Goal, Outcome};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme};
use loden::metric;
use loden::params::Values;
use loden::progress::Silent;
use serde_json::{Value, json};

/// Waves over texels, views and lights.
fn source(side: usize, directions: usize) -> MemoryBtf {
    let set =
        || DirectionSet::from_degrees((0..directions).map(|i| [7.0 * i as f64, 100.0 * i as f64]).collect()).unwrap();
    let (views, lights, encoding) = (set(), set(), Encoding::Srgb);
    let (cosine, sample_type) = (Cosine::Included, SampleType::U8);
    let meta = BtfMeta { width: side, height: side, views, lights, encoding, cosine, sample_type };
    let value = |i: usize| 128.0 + 60.0 * (i as f64 * 0.37).sin() + 50.0 * (i as f64 * 0.0113).cos();
    let values: Vec<u8> = (0..meta.pairs() * meta.image_len()).map(|i| value(i) as u8).collect();
    MemoryBtf::new(meta, Texels::U8(values.into())).unwrap()
}

/// Components and clusters that suit a few texels.
fn params(codec: &dyn Codec, precision: &str) -> Values {
    let few = [("components", "3"), ("chroma", "2"), ("clusters", "4"), ("resolution", "3"), ("precision", precision)];
    let known = |(name, _): &(&str, &str)| codec.params().iter().any(|param| param.name == *name);
    Values::new(codec.params(), few.into_iter().filter(known)).unwrap()
}

fn write(codec: &dyn Codec, source: &dyn BtfSource, params: &Values, stage: &'static Stage, path: &Path) -> Outcome {
    let finish = Finish { measure: true, lossless: Some(stage) };
    codec::compress(codec, source, params, Goal::Params, finish, path, &Silent).unwrap()
}

fn views(path: &Path) -> loden::Result<Vec<Vec<f32>>> {
    let btf = codec::open(path)?;
    (0..btf.meta().views.len()).map(|view| Ok(btf.view(view)?.to_f32().into_owned())).collect()
}

#[test]
fn every_codec_by_every_stage_gives_back_the_same_numbers() {
    let (folder, source) = (tempfile::tempdir().unwrap(), source(8, 3));
    let (plain, packed) = (folder.path().join("plain"), folder.path().join("packed"));
    for codec in CODECS {
        let name = codec.name();
        let params = params(*codec, "f16");
        codec.encode(&source, &params, &plain, &Silent).unwrap();
        let expected = views(&plain).unwrap();
        for stage in STAGES {
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let done = pool.install(|| write(*codec, &source, &params, stage, &packed));
                assert_eq!(done.bytes, fs::metadata(&packed).unwrap().len(), "{name} {}", stage.name);
                // a stage that would enlarge the file is left out, with a note
                let is_said = done.warnings.iter().any(|w| w.contains(&format!("{} would enlarge", stage.name)));
                assert!(is_said != done.lossless.is_some(), "{name} {}: {:?}", stage.name, done.warnings);
                (fs::read(&packed).unwrap(), done.lossless, done.params)
            };
            let (file, lossless, lowered) = run(1);
            let again = run(2);
            assert!(
                (file, lossless) == (again.0, again.1),
                "{name} {}: the number of threads changes the file",
                stage.name
            );
            assert!(views(&packed).unwrap() == expected, "{name} {}", stage.name);
            let btf = codec::open(&packed).unwrap();
            assert_eq!(btf.lossless().map(|stage| stage.name), lossless, "{name}");
            assert_eq!(btf.error(), Some(&metric::compare(&source, &*btf, &Silent).unwrap()), "{name}");
            // parameters beyond what the BTF has a use for were lowered
            assert!(btf.params().iter().eq(lowered.iter()), "{name}");
            btf.release(0);
            assert!(btf.material(Scheme::Triangles).is_ok(), "{name}");
        }
        assert!(codec::open(&plain).unwrap().lossless().is_none(), "{name}");
    }
    // what repeats is packed by every stage
    let mut constant = source.meta().clone();
    (constant.width, constant.height) = (32, 32);
    let texels = Texels::U8(vec![77; constant.pairs() * constant.image_len()].into());
    let constant = MemoryBtf::new(constant, texels).unwrap();
    for stage in STAGES {
        let pca = codec::by_name("pca").unwrap();
        let done = write(pca, &constant, &params(pca, "f16"), stage, &packed);
        assert_eq!(done.lossless, Some(stage.name), "{:?}", done.warnings);
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "something is left behind");
}

#[test]
fn tensors_of_several_blocks_are_packed_smaller() {
    let (folder, source) = (tempfile::tempdir().unwrap(), source(256, 3));
    let (plain, packed) = (folder.path().join("plain"), folder.path().join("packed"));
    let codec = codec::by_name("pvmf").unwrap();
    let params = Values::new(codec.params(), [("components", "8"), ("precision", "f32")]).unwrap();
    let most = codec.encode(&source, &params, &plain, &Silent).unwrap().bytes;
    // 6.3 MB of coefficients, in blocks of 4 MiB
    assert!(most > 6 << 20, "{most}");
    let bytes = write(codec, &source, &params, &STAGES[1], &packed).bytes;
    assert!(bytes < most, "{bytes} {most}");
    assert!(views(&packed).unwrap() == views(&plain).unwrap());
}

fn frozen() -> [PathBuf; 3] {
    [("lzw", "dfmf", "f32"), ("deflate", "pvmf", "f16"), ("zstd", "kmeans", "u8")].map(|(stage, name, precision)| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
        let path = folder.join(format!("{name}-{precision}-{stage}.loden"));
        if std::env::var_os("LODEN_BLESS").is_some() {
            let codec = codec::by_name(name).unwrap();
            let stage = STAGES.iter().find(|other| other.name == stage).unwrap();
            write(codec, &source(6, 3), &params(codec, precision), stage, &path);
        }
        path
    })
}

#[test]
fn frozen_packed_files_decode_to_what_was_stored() {
    let source = source(6, 3);
    for path in frozen() {
        let btf = codec::open(&path).unwrap();
        let found = metric::compare(&source, &*btf, &Silent).unwrap();
        let stored = btf.error().unwrap();
        assert!((found.mean_abs_error - stored.mean_abs_error).abs() < 1e-6, "{}: {found:?}", path.display());
        assert!((found.max_abs_error - stored.max_abs_error).abs() < 1e-5, "{}: {found:?}", path.display());
    }
}

#[test]
fn every_changed_byte_of_packed_numbers_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    for bytes in frozen().map(|path| fs::read(path).unwrap()) {
        let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        for place in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[place] ^= 1 << (place % 8);
            fs::write(&path, &damaged).unwrap();
            match views(&path) {
                Err(error) => {
                    let error = error.to_string();
                    let field = if place < header { "" } else { "tensor" };
                    assert!(error.contains("x.loden") && error.contains(field), "{place}: {error}");
                }
                Ok(_) => assert!(place < header, "{place}"),
            }
        }
        for length in (0..bytes.len()).rev() {
            fs::write(&path, &bytes[..length]).unwrap();
            let error = views(&path).unwrap_err().to_string();
            assert!(error.contains("x.loden"), "{length}: {error}");
        }
    }
}

#[test]
fn what_is_said_of_packed_tensors_is_checked_before_it_is_believed() {
    let bytes = fs::read(&frozen()[1]).unwrap();
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    let entry: Value = serde_json::from_str(header["__metadata__"]["lossless"].as_str().unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    type Change = (&'static str, fn(&mut Value));
    let changes: [Change; 9] = [
        ("tensor mean: unpacked size is 18446744073709551615", |e| {
            e["tensors"]["mean"]["shape"] = json!([u64::MAX, 2, 3])
        }),
        ("tensor mean: unpacked size is 12000000000000", |e| {
            e["tensors"]["mean"]["shape"] = json!([1_000_000_000_000u64, 3])
        }),
        ("tensor coefficients: found 1 blocks, expected 2 for 6000000 bytes", |e| {
            e["tensors"]["coefficients"]["shape"] = json!([1_000_000, 1, 3])
        }),
        ("tensor mean: block 0 does not unpack to 1200 bytes", |e| e["tensors"]["mean"]["shape"] = json!([100, 1, 3])),
        ("tensor mean: found shape [9, 3], expected [3, 3, 3]", |e| e["tensors"]["mean"]["shape"] = json!([9, 3])),
        ("tensor mean: found type F64", |e| e["tensors"]["mean"]["dtype"] = json!("F64")),
        ("lossless: it does not describe tensor mean", |e| drop(e["tensors"].as_object_mut().unwrap().remove("mean"))),
        ("lossless: there is no tensor more", |e| {
            e["tensors"]["more"] = e["tensors"]["mean"].clone();
        }),
        ("found \"zip\", expected one of lzw, deflate, zstd", |e| e["stage"] = "zip".into()),
    ];
    for (expected, change) in changes {
        let (mut header, mut entry) = (header.clone(), entry.clone());
        change(&mut entry);
        header["__metadata__"]["lossless"] = entry.to_string().into();
        let mut text = header.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(8), b' ');
        fs::write(&path, [&(text.len() as u64).to_le_bytes()[..], &text, &bytes[8 + length..]].concat()).unwrap();
        let error = views(&path).unwrap_err().to_string();
        assert!(error.contains("x.loden") && error.contains(expected), "{expected}: {error}");
    }
}
