use std::borrow::Cow;
use std::path::{Path, PathBuf};

use super::*;
use crate::btf::{BtfSource as _, Cosine, MemoryBtf, Rect, Texels};
use crate::codec::parts::Numbers;
use crate::codec::{Codec, by_name, open};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::metric::compare;
use crate::params::Values;
use crate::progress::Silent;

const QUANTISERS: [&str; 3] = ["kmeans", "median-cut", "tsvq"];

fn meta(width: usize, height: usize, encoding: Encoding, sample_type: SampleType) -> BtfMeta {
    let degrees = vec![[0.0, 0.0], [40.0, 10.0], [40.0, 130.0], [40.0, 250.0], [70.0, 60.0]];
    BtfMeta {
        width,
        height,
        views: DirectionSet::from_degrees(degrees[..4].to_vec()).unwrap(),
        lights: DirectionSet::from_degrees(degrees).unwrap(),
        encoding,
        cosine: Cosine::Included,
        sample_type,
    }
}

/// Texels of `kinds` kinds with a little noise.
fn source(meta: BtfMeta, kinds: usize, noise: f32) -> MemoryBtf {
    let hash = |i: usize| (i.wrapping_mul(0x9E37_79B9) >> 8) % 1000;
    let value = |i: usize| {
        let kind = hash(i % meta.image_len() / 3) % kinds;
        let pair = i / meta.image_len();
        let smooth = ((kind + 1) as f32 * 0.77 * (pair + i % 3 + 1) as f32).sin();
        (0.5 + 0.4 * smooth + noise * (hash(i) as f32 / 1000.0 - 0.5)).clamp(0.0, 1.0)
    };
    let values: Vec<f32> = (0..meta.views.len() * meta.view_len()).map(value).collect();
    let texels = match meta.sample_type {
        SampleType::U8 => Texels::U8(Cow::Owned(values.iter().map(|v| (v * 255.0).round() as u8).collect())),
        SampleType::F16 => Texels::F16(Cow::Owned(values.iter().map(|&v| half::f16::from_f32(v)).collect())),
        SampleType::F32 => Texels::F32(Cow::Owned(values)),
    };
    MemoryBtf::new(meta, texels).unwrap()
}

struct Encoded {
    _folder: tempfile::TempDir,
    path: PathBuf,
    summary: crate::codec::EncodeSummary,
}

fn encode(method: &str, source: &MemoryBtf, params: &[(&str, &str)]) -> Result<Encoded> {
    let codec: &dyn Codec = by_name(method)?;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let summary = codec.encode(source, &Values::new(codec.params(), params.iter().copied())?, &path, &Silent)?;
    assert_eq!(summary.bytes, std::fs::metadata(&path).unwrap().len());
    Ok(Encoded { _folder: folder, path, summary })
}

/// The index image and the block in single precision, one row per cluster.
fn parts(path: &Path) -> (Vec<u16>, Vec<Vec<f32>>) {
    let btf = open(path).unwrap();
    let meta = btf.meta();
    let Numbers::Index(index) = btf.parts().plane(0, 0, Rect::whole(meta)).unwrap() else { panic!("an index plane") };
    let block = btf.parts().table(0).unwrap().to_f32();
    (index.to_vec(), block.chunks_exact(3 * meta.pairs()).map(<[f32]>::to_vec).collect())
}

fn error(source: &MemoryBtf, path: &Path) -> f64 {
    compare(source, &*open(path).unwrap(), &Silent).unwrap().rmse
}

#[test]
fn as_many_clusters_as_kinds_reproduce_them() {
    // median cut halves the number of texels, which separates equal ones
    for (method, clusters) in [("kmeans", "8"), ("tsvq", "8"), ("median-cut", "221")] {
        for (sample_type, encoding) in
            [(SampleType::U8, Encoding::Srgb), (SampleType::F16, Encoding::Linear), (SampleType::F32, Encoding::Srgb)]
        {
            for domain in ["display", "linear", "log"] {
                let source = source(meta(17, 13, encoding, sample_type), 8, 0.0);
                let params = [("clusters", clusters), ("precision", "f32"), ("domain", domain)];
                let file = encode(method, &source, &params).unwrap();
                let error = error(&source, &file.path);
                assert!(error < 1e-5, "{method} {sample_type:?} {domain}: {error}");
            }
        }
    }
}

#[test]
fn error_falls_with_clusters_and_precision_costs_little() {
    for method in QUANTISERS {
        let source = source(meta(24, 20, Encoding::Srgb, SampleType::U8), 100, 0.1);
        let run = |clusters: &str, precision: &str| {
            error(&source, &encode(method, &source, &[("clusters", clusters), ("precision", precision)]).unwrap().path)
        };
        let errors = ["1", "4", "16", "64", "256", "480"].map(|k| run(k, "f32"));
        assert!(errors.windows(2).all(|w| w[1] < w[0]), "{method}: {errors:?}");
        assert!(errors[5] < 1e-6, "{method}: {errors:?}");
        for (precision, bound) in [("f16", 1e-4), ("u8", 1e-3)] {
            assert!((run("64", precision) - errors[3]).abs() < bound, "{method} {precision}");
        }
    }
}

#[test]
fn the_block_holds_the_means_of_the_clusters() {
    let meta = meta(9, 8, Encoding::Srgb, SampleType::F32);
    let source = source(meta.clone(), 20, 0.2);
    for method in QUANTISERS {
        let file = encode(method, &source, &[("clusters", "5"), ("precision", "f32")]).unwrap();
        let btf = open(&file.path).unwrap();
        let (index, block) = parts(&file.path);
        assert_eq!((block.len(), index.len()), (5, 72));
        for (cluster, abrdf) in block.iter().enumerate() {
            for (pair, rgb) in abrdf.chunks_exact(3).enumerate() {
                let image = source.image(pair / 5, pair % 5).unwrap().to_f32().into_owned();
                let mine: Vec<usize> = (0..72).filter(|&t| usize::from(index[t]) == cluster).collect();
                for (c, found) in rgb.iter().enumerate() {
                    let mean = mine.iter().map(|t| f64::from(image[3 * t + c])).sum::<f64>() / mine.len() as f64;
                    assert!((f64::from(*found) - mean).abs() < 1e-6, "{method} {cluster} {pair}");
                }
            }
        }
        assert!(btf.resident_bytes() == (5 * 60 * 4 + 72 * 2) as u64);
    }
}

#[test]
fn bytes_do_not_depend_on_threads() {
    for method in QUANTISERS {
        for sample_type in [SampleType::U8, SampleType::F16] {
            let source = source(meta(40, 30, Encoding::Srgb, sample_type), 50, 0.2);
            let bytes = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let encoded = pool.install(|| encode(method, &source, &[("clusters", "30")]).unwrap());
                std::fs::read(&encoded.path).unwrap()
            };
            assert!(bytes(1) == bytes(2), "{method} {sample_type:?}");
        }
    }
}

#[test]
fn values_beyond_one_widen_the_range_and_are_told() {
    let meta = meta(6, 5, Encoding::Linear, SampleType::F32);
    let numbers: Vec<f32> = (0..4 * meta.view_len()).map(|i| (i % 90) as f32 * 0.05).collect();
    let source = MemoryBtf::new(meta.clone(), Texels::F32(Cow::Owned(numbers.clone()))).unwrap();
    let file = encode("kmeans", &source, &[("clusters", "30")]).unwrap();
    assert!(file.summary.warnings[0].contains("f16"), "{:?}", file.summary.warnings);
    let decoded = open(&file.path).unwrap();
    for view in 0..4 {
        let (a, b) = (source.view(view).unwrap(), decoded.view(view).unwrap());
        for (a, b) in a.to_f32().iter().zip(b.to_f32().iter()) {
            assert!((a - b).abs() < 0.03, "{a} {b}");
        }
    }
    let large = MemoryBtf::new(meta.clone(), Texels::F32(Cow::Owned(vec![1e20; numbers.len()]))).unwrap();
    let problem = encode("kmeans", &large, &[("precision", "f16")]).map(drop).unwrap_err().to_string();
    assert!(problem.starts_with("precision: "), "{problem}");
    let mut bad = numbers;
    bad[100] = f32::NAN;
    let bad = MemoryBtf::new(meta, Texels::F32(Cow::Owned(bad))).unwrap();
    for method in QUANTISERS {
        let problem = encode(method, &bad, &[]).map(drop).unwrap_err().to_string();
        assert!(problem.contains("not finite"), "{method}: {problem}");
    }
}

#[test]
fn median_cut_is_made_in_either_space_and_by_any_rule() {
    let source = source(meta(24, 20, Encoding::Srgb, SampleType::F16), 60, 0.1);
    for space in ["abrdf", "pca"] {
        for split in ["balanced", "longest-edge", "population", "variance"] {
            let params = [("clusters", "32"), ("split", split), ("space", space), ("precision", "f32")];
            let file = encode("median-cut", &source, &params).unwrap();
            let (index, block) = parts(&file.path);
            assert_eq!(block.len(), 32);
            let count = |k: u16| index.iter().filter(|&&i| i == k).count();
            if split == "balanced" {
                assert!((0..32).all(|k| count(k) == 15), "{space}");
            }
        }
    }
}

#[test]
fn half_precision_and_bytes_are_cut_alike() {
    let bytes = source(meta(24, 20, Encoding::Srgb, SampleType::U8), 60, 0.1);
    // whole numbers that half precision holds exactly
    let wide = bytes.meta().clone();
    let halves = (0..4).flat_map(|v| bytes.view(v).unwrap().to_f32().into_owned());
    let halves: Vec<half::f16> = halves.map(|v| half::f16::from_f32((v * 255.0).round())).collect();
    let meta = BtfMeta { sample_type: SampleType::F16, ..wide };
    let halves = MemoryBtf::new(meta, Texels::F16(Cow::Owned(halves))).unwrap();
    for split in ["longest-edge", "variance"] {
        let index = |source: &MemoryBtf| {
            let file = encode("median-cut", source, &[("clusters", "40"), ("split", split)]).unwrap();
            parts(&file.path).0
        };
        assert!(index(&bytes) == index(&halves), "{split}");
    }
}

#[test]
fn local_components_fit_the_texels_of_their_cluster() {
    let source = source(meta(24, 20, Encoding::Srgb, SampleType::U8), 40, 0.2);
    let run = |clusters: &str, components: &str, precision: &str, domain: &str| {
        let params = [("clusters", clusters), ("components", components), ("precision", precision), ("domain", domain)];
        error(&source, &encode("pcmf", &source, &params).unwrap().path)
    };
    let errors = ["1", "3", "8", "20"].map(|c| run("6", c, "f32", "display"));
    assert!(errors.windows(2).all(|w| w[1] < w[0]), "{errors:?}");
    assert!(run("12", "3", "f32", "display") < errors[1]);
    assert!((run("6", "8", "f16", "display") - errors[2]).abs() < 1e-3);
    // one cluster amounts to the principal components of the whole BTF
    let params = Values::new(by_name("pca").unwrap().params(), [("components", "5"), ("precision", "f32")]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pca.loden");
    by_name("pca").unwrap().encode(&source, &params, &path, &Silent).unwrap();
    let whole = error(&source, &path);
    assert!((run("1", "5", "f32", "display") - whole).abs() < 1e-3 * whole);
    for domain in ["display", "linear", "log"] {
        let all = run("2", "60", "f32", domain);
        assert!(all < 1e-3, "{domain}: {all}");
    }
    let problem = encode("pcmf", &source, &[("components", "65")]).map(drop).unwrap_err().to_string();
    assert!(problem.contains("at most 60"), "{problem}");
}

#[test]
fn bytes_of_local_components_do_not_depend_on_threads() {
    let source = source(meta(40, 30, Encoding::Srgb, SampleType::U8), 50, 0.2);
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let encoded = pool.install(|| encode("pcmf", &source, &[("clusters", "5")]).unwrap());
        std::fs::read(&encoded.path).unwrap()
    };
    assert!(bytes(1) == bytes(2));
}
